//! Scenario files for a vehicle of which little is known: its mass, its size, its propellers and its battery.
//!
//! Each estimated value has a comment with its origin and with a way to measure it. The estimates are in [`estimates`], the gains in
//! [`gain_rules`](scenario_file::gain_rules).

pub mod arguments;
mod command;
pub mod estimates;
mod text;

use scenario::{CaptureSystem, RadioProtocol};

pub use command::new;
pub use text::text;

/// A quadcopter as its owner knows it without a measurement other than its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Airframe {
    /// Mass with battery, kg.
    pub mass: f64,
    /// Diagonal from motor to motor, m.
    pub size: f64,
    /// Diameter of a propeller, inch.
    pub propeller: f64,
    /// Cells of the battery in series.
    pub cells: u32,
}

/// Limits of [`Airframe::mass`], kg.
pub const MASS: [f64; 2] = [0.02, 10.0];
/// Limits of [`Airframe::size`], m.
pub const SIZE: [f64; 2] = [0.05, 1.5];
/// Limits of [`Airframe::propeller`], inch.
pub const PROPELLER: [f64; 2] = [1.0, 30.0];
/// Limits of [`Airframe::cells`].
pub const CELLS: [u32; 2] = [1, 12];

/// Cameras and radio link of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surroundings {
    /// Simulated ones.
    Simulated,
    /// Those of a laboratory.
    Laboratory {
        /// Its motion-capture system.
        cameras: CaptureSystem,
        /// Its radio link.
        radio: RadioProtocol,
    },
}

impl Surroundings {
    /// Returns the radio link of a laboratory.
    fn radio(self) -> Option<RadioProtocol> {
        match self {
            Self::Simulated => None,
            Self::Laboratory { radio, .. } => Some(radio),
        }
    }
}

/// Reason why no vehicle has the stated properties.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{reason}; {fix}")]
pub struct Implausible {
    /// The contradiction.
    pub reason: String,
    /// The fix.
    pub fix: String,
}

#[cfg(test)]
mod tests;
