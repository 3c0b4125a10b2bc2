//! Steps of the hand test, with the axis and sign that each must show.

use nalgebra::Vector3;

/// Step of the hand test.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Step {
    /// It lies still on the ground.
    Rest,
    /// It is lifted.
    Lift,
    /// Its right side goes down.
    TiltRight,
    /// Its nose goes down.
    NoseDown,
    /// Its nose turns to the left, seen from above.
    TurnLeft,
    /// It is carried along the room's x axis.
    CarryAlongX,
}

/// Quantity that a step moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// None: the vehicle rests.
    None,
    /// Position in {I}.
    Position,
    /// Attitude, by the rotation vector in {B}.
    Attitude,
}

impl Step {
    /// All steps, in their order.
    pub const ALL: [Self; 6] = [
        Self::Rest,
        Self::Lift,
        Self::TiltRight,
        Self::NoseDown,
        Self::TurnLeft,
        Self::CarryAlongX,
    ];

    /// Returns the name, as in the file of the result.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rest => "rest",
            Self::Lift => "lift",
            Self::TiltRight => "tilt_right",
            Self::NoseDown => "nose_down",
            Self::TurnLeft => "turn_left",
            Self::CarryAlongX => "carry_along_x",
        }
    }

    /// Returns the instruction for the person who holds the vehicle.
    #[must_use]
    pub fn instruction(self) -> &'static str {
        match self {
            Self::Rest => "let it lie still on the ground, level",
            Self::Lift => "lift it by half a metre, straight up",
            Self::TiltRight => "tilt it to the right by 30° (right side down), then hold it level again",
            Self::NoseDown => "tilt its nose down by 30°, then hold it level again",
            Self::TurnLeft => "turn it to the left by 45°, seen from above; keep it level",
            Self::CarryAlongX => "carry it half a metre along the room's +x axis",
        }
    }

    /// Returns what must be seen.
    #[must_use]
    pub fn expected(self) -> &'static str {
        match self {
            Self::Rest => "nothing moves",
            Self::Lift => "z falls",
            Self::TiltRight => "roll rises",
            Self::NoseDown => "pitch falls",
            Self::TurnLeft => "yaw falls",
            Self::CarryAlongX => "x rises",
        }
    }

    /// Returns the quantity that the step moves.
    #[must_use]
    pub fn quantity(self) -> Quantity {
        match self {
            Self::Rest => Quantity::None,
            Self::Lift | Self::CarryAlongX => Quantity::Position,
            Self::TiltRight | Self::NoseDown | Self::TurnLeft => Quantity::Attitude,
        }
    }

    /// Returns the expected direction: in {I} of a displacement, in {B} of a rotation vector.
    #[must_use]
    pub fn direction(self) -> Vector3<f64> {
        match self {
            Self::Rest => Vector3::zeros(),
            Self::Lift | Self::TurnLeft => -Vector3::z(),
            Self::TiltRight | Self::CarryAlongX => Vector3::x(),
            Self::NoseDown => -Vector3::y(),
        }
    }

    /// Returns the least size of the movement, m or rad.
    #[must_use]
    pub fn least(self) -> f64 {
        match self {
            Self::Rest => 0.0,
            Self::Lift | Self::CarryAlongX => 0.3,
            Self::TiltRight | Self::NoseDown => 0.35,
            Self::TurnLeft => 0.5,
        }
    }

    /// Returns the words for a direction of this step's quantity, such as "y rises" or "roll falls".
    #[must_use]
    pub fn in_words(self, direction: &Vector3<f64>) -> String {
        let axis = direction.iamax();
        let names = match self.quantity() {
            Quantity::Attitude => ["roll", "pitch", "yaw"],
            _ => ["x", "y", "z"],
        };
        let sense = if direction[axis] > 0.0 { "rises" } else { "falls" };
        format!("{} {sense}", names[axis])
    }
}
