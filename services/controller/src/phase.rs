//! What the controller does by the phase of the flight, which the path generator tells with each reference.
//!
//! | phase | what is commanded | the estimates |
//! | --- | --- | --- |
//! | disarmed, and before the first reference | failsafe: the motors rest | rest |
//! | armed | no thrust, no torque and no rates: the motors idle | rest |
//! | take-off, fly, land | what the law says | learn while the vehicle is airborne |
//!
//! A flight without phases is flown from the first reference to the last.

use scenario::Scenario;
use shared_types::FlightPhase;
use shared_types::samples::PathReference;

/// What a phase leaves to the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControlMode {
    /// The motors rest.
    Rest,
    /// The motors idle.
    Idle,
    /// The law flies the vehicle, which stands on the ground or is taken to.
    FlyUntaught,
    /// The law flies the vehicle and learns from its motion.
    Fly,
}

/// What the phases of a flight leave to the controller.
#[derive(Clone, Copy, Debug)]
pub struct ControlModes {
    has_phases: bool,
}

impl ControlModes {
    /// Those of a scenario's flight.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            has_phases: scenario.flight.is_some(),
        }
    }

    /// What the last good reference leaves to the controller.
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
