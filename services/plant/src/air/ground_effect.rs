//! Ground effect: rotors near the ground have more thrust at the same power.
//!
//! ```text
//!     T/T∞ = 1 / (1 − ρ (R/4z)²)
//! ```
//!
//! R radius of a rotor, z height of the rotors above the ground, m; ρ = 1 for a single rotor (Cheeseman and Bennett, 1955),
//! up to 8.6 for four (Sanchez-Cuevas et al., 2017). T/T∞ is limited to 1.5: the model is not valid closer to the ground.

/// The ground and the rotors above it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundEffect {
    /// ρ (R/4)², m².
    strength: f64,
    /// z of the ground in {I}, m.
    ground: f64,
}

/// Upper limit of ρ (R/4z)²: T/T∞ = 1.5.
const LARGEST: f64 = 1.0 / 3.0;

impl GroundEffect {
    /// Makes the ground effect of a scenario.
    #[must_use]
    pub fn new(config: &scenario::GroundEffect) -> Self {
        let quarter = config.rotor_radius / 4.0;
        Self {
            strength: config.factor * quarter * quarter,
            ground: config.ground,
        }
    }

    /// Returns T/T∞ − 1 of a vehicle at z (in {I}, m).
    #[must_use]
    #[inline]
    pub fn gain(&self, z: f64) -> f64 {
        let height = self.ground - z;
        let share = if height > 0.0 {
            (self.strength / (height * height)).min(LARGEST)
        } else {
            LARGEST
        };
        share / (1.0 - share)
    }
}
