//! The rules as shown by the manual and `gerono check`.

/// Relation between gains and vehicle for a stable flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Share by which one step of the sampled law reduces z3.
    AngularVelocityStep,
    /// Rate of the angular velocity loop relative to that of the attitude loop around it.
    AngularVelocityRate,
    /// Λw relative to the damping of k3 in a step.
    InertiaLearning,
    /// Rate of the attitude loop relative to those of position and velocity.
    AttitudeRate,
    /// Damping of the adaptation of b̂ and η̂.
    LearningDamping,
    /// Share by which one hold reduces the prediction error.
    PredictionStep,
    /// Maximum thrust relative to the largest weight of the flight.
    ThrustReserve,
}

impl Rule {
    /// All rules, innermost loop first.
    pub const ALL: [Self; 7] = [
        Self::AngularVelocityStep,
        Self::AngularVelocityRate,
        Self::InertiaLearning,
        Self::AttitudeRate,
        Self::LearningDamping,
        Self::PredictionStep,
        Self::ThrustReserve,
    ];

    /// Returns the name of the rule's left side.
    #[must_use]
    pub fn quantity(self) -> &'static str {
        match self {
            Self::AngularVelocityStep => "the share of z3 that a step removes",
            Self::AngularVelocityRate => "the rate of the angular velocity loop",
            Self::InertiaLearning => "Λw",
            Self::AttitudeRate => "the rate of the attitude loop",
            Self::LearningDamping => "the damping of the learning loop",
            Self::PredictionStep => "the share of ε that a hold removes",
            Self::ThrustReserve => "thrust over weight",
        }
    }

    /// Returns the rule as a formula, with the limit as a number or a symbol.
    #[must_use]
    pub fn relation(self) -> &'static str {
        match self {
            Self::AngularVelocityStep => "h k3 σmax / (β Jmin) ≤ 1",
            Self::AngularVelocityRate => "k3 σmax / (β Jmax) ≥ g / (4 |δ|)",
            Self::InertiaLearning => "Λw ≤ 27 k3 σmax / (2 h β² ω̄² (ω̄ + κ)³)",
            Self::AttitudeRate => "g / |δ| ≥ 2 max(k1, k2) σmax",
            Self::LearningDamping => "k2 σmax / (2 √(Λb + λm (m g)²)) ≥ 0.35",
            Self::PredictionStep => "H κ (Λb + λm (m g)²) ≤ 1",
            Self::ThrustReserve => "Tmax / (m g) ≥ 1.1",
        }
    }

    /// Returns the unit of both sides after a space; empty for a ratio.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::AngularVelocityRate | Self::AttitudeRate => " 1/s",
            _ => "",
        }
    }

    /// Returns the effect of violating the rule.
    #[must_use]
    pub fn consequence(self) -> &'static str {
        match self {
            Self::AngularVelocityStep => "above 2 the loop diverges",
            Self::AngularVelocityRate => "slower, it swings with the attitude loop",
            Self::InertiaLearning => {
                "above, a step learns more than k3 damps, and a vehicle that starts tilted may be lost"
            }
            Self::AttitudeRate => "slower, the position loop waits for the attitude",
            Self::LearningDamping => {
                "below, estimates and vehicle oscillate with the delays of cameras and radio"
            }
            Self::PredictionStep => "above, the estimates overshoot, and the mass estimate is spoilt first",
            Self::ThrustReserve => "below, the vehicle sinks while the mass estimate learns",
        }
    }

    /// Returns whether the limit is an upper one.
    #[must_use]
    pub fn is_upper_limit(self) -> bool {
        matches!(
            self,
            Self::AngularVelocityStep | Self::InertiaLearning | Self::PredictionStep
        )
    }
}

/// Returns the rules as a Markdown table.
#[must_use]
pub fn table() -> String {
    let mut table = "| quantity | rule | otherwise |\n| --- | --- | --- |\n".to_owned();
    for rule in Rule::ALL {
        let cells = [rule.quantity(), rule.relation(), rule.consequence()];
        // A bar would end the cell.
        let cells = cells.map(|cell| cell.replace('|', "\\|"));
        table += &format!("| {} |\n", cells.join(" | "));
    }
    table
}
