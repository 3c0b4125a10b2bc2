//! Control modes by the phase of the flight, which the path generator states with each reference.
//!
//! | phase | command | estimates |
//! | --- | --- | --- |
//! | disarmed, and before the first reference | failsafe: the motors stop | frozen |
//! | armed | no thrust, no torque and no rates: the motors idle | frozen |
//! | take-off, fly, land | the law's | adapt while the vehicle is airborne |
//!
//! A flight without phases is flown from the first reference to the last.

use scenario::Scenario;
use shared_types::FlightPhase;
use shared_types::samples::PathReference;

/// Control mode in a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControlMode {
    /// The motors stop.
    Stop,
    /// The motors idle.
    Idle,
    /// The law commands, and the estimates are frozen: the vehicle stands on the ground, or counts as standing there.
    FlyFrozen,
    /// The law commands, and the estimates adapt to the motion.
    Fly,
}

/// Control modes of a flight.
#[derive(Clone, Copy, Debug)]
pub struct ControlModes {
    has_phases: bool,
}

impl ControlModes {
    /// Returns the control modes of a scenario's flight.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            has_phases: scenario.flight.is_some(),
        }
    }

    /// Returns the control mode of the last good reference.
    #[must_use]
    #[inline]
    pub fn mode(self, reference: Option<&PathReference>) -> ControlMode {
        if !self.has_phases {
            return ControlMode::Fly;
        }
        let Some(reference) = reference else {
            return ControlMode::Stop;
        };
        match FlightPhase::from_code(reference.phase) {
            FlightPhase::Disarmed => ControlMode::Stop,
            FlightPhase::Armed => ControlMode::Idle,
            FlightPhase::TakeOff | FlightPhase::Fly | FlightPhase::Land if reference.airborne.is_set() => {
                ControlMode::Fly
            }
            FlightPhase::TakeOff | FlightPhase::Fly | FlightPhase::Land => ControlMode::FlyFrozen,
        }
    }
}
