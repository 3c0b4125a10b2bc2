//! Control modes by the phase of the flight, which the path generator states with each reference.
//!
//! | phase | command | estimates |
//! | --- | --- | --- |
//! | disarmed, and before the first reference | failsafe: the motors stop | frozen |
//! | armed | no thrust, no torque and no rates: the motors idle | frozen |
//! | take-off, fly, land | the law's | learn while the vehicle is airborne |
//!
//! A flight without phases is flown from the first reference to the last.

use scenario::Scenario;
use shared_types::FlightPhase;
use shared_types::samples::PathReference;

/// Control mode in a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControlMode {
    /// The motors stop.
    Rest,
    /// The motors idle.
    Idle,
    /// The law flies the vehicle, which stands on the ground or is regarded as standing there; the estimates do not
    /// learn.
    FlyUntaught,
    /// The law flies the vehicle, and the estimates learn from its motion.
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
    pub fn of(self, reference: Option<&PathReference>) -> ControlMode {
        if !self.has_phases {
            return ControlMode::Fly;
        }
        let Some(reference) = reference else {
            return ControlMode::Rest;
        };
        match FlightPhase::from_code(reference.phase) {
            FlightPhase::Disarmed => ControlMode::Rest,
            FlightPhase::Armed => ControlMode::Idle,
            FlightPhase::TakeOff | FlightPhase::Fly | FlightPhase::Land if reference.airborne.is_set() => {
                ControlMode::Fly
            }
            FlightPhase::TakeOff | FlightPhase::Fly | FlightPhase::Land => ControlMode::FlyUntaught,
        }
    }
}
