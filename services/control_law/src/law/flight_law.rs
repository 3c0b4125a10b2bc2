//! Law of a flight: the interface between the control supervisor and any law.

use std::fmt::Debug;

use nalgebra::Vector3;
use shared_types::Gains;
use shared_types::sample::Record;
use shared_types::samples::ControlAdaptation;
use zerocopy::FromZeros;

use super::{LawOutput, Moment};
use crate::rate_controller::{RateController, RateControllerState};
use crate::signals::VehicleEstimate;

/// Law of a flight with its gains and its state.
///
/// At each step the supervisor calls [`advance`](Self::advance), and then at most one of [`command`](Self::command),
/// [`skip`](Self::skip) and [`pause`](Self::pause). No call allocates.
pub trait FlightLaw: Debug + Send {
    /// Returns the command at a moment.
    fn command(&mut self, moment: &Moment<'_>) -> LawOutput;

    /// Advances the estimates by `elapsed` seconds at the rates of the previous step, which end with it.
    fn advance(&mut self, _elapsed: f64) {}

    /// Discards the rates of this step: the vehicle does not follow the law's command, or its motion was not measured.
    fn discard(&mut self) {}

    /// Passes a step, `elapsed` seconds after the previous one, in which a failsafe stage commands.
    fn skip(&mut self, elapsed: f64);

    /// Drops all but the estimates: the next command begins a flight.
    fn pause(&mut self);

    /// Continues after commands that were not the law's, with ω of the vehicle (in {B}, rad/s).
    fn resume(&mut self, _omega: Vector3<f64>) {}

    /// Replaces the gains that can be tuned in flight.
    fn set_gains(&mut self, _gains: &Gains) {}

    /// Returns the estimates of η and b before projection; `None` for a law without, to which the initial ones apply.
    fn estimate(&self) -> Option<VehicleEstimate> {
        None
    }

    /// Writes those fields of the telemetry that follow neither from the estimate nor from the initial values.
    fn write_adaptation(&self, _adaptation: &mut ControlAdaptation) {}

    /// Returns the state.
    fn save(&self) -> LawState;

    /// Restores a saved state.
    fn restore(&mut self, state: &LawState);

    /// Returns the layout hash of the law's record, of which a [`LawState`] shows bytes only.
    fn record_layout(&self) -> String;
}

/// Largest size of a law's record, bytes.
const RECORD_SIZE: usize = 2016;

shared_types::sample! {
    /// State of a law in the controller's checkpoint.
    pub struct LawState {
        /// State of the rate controller; zero with commands of torque.
        pub rate_controller: RateControllerState,
        /// Record of the law's own, then zeros.
        pub record: [u8; RECORD_SIZE],
    }
}

impl LawState {
    /// Makes the state from the law's record; with commands of body rates from its rate controller as well.
    #[must_use]
    pub fn new<R: Record>(record: &R, rate_controller: Option<&RateController>) -> Self {
        const { assert!(size_of::<R>() <= RECORD_SIZE) };
        let mut state = Self::new_zeroed();
        state.record[..size_of::<R>()].copy_from_slice(record.as_bytes());
        if let Some(rate_controller) = rate_controller {
            state.rate_controller = rate_controller.state;
        }
        state
    }

    /// Returns the record from which the state was made.
    ///
    /// # Panics
    /// If the record is larger than a state, which [`new`](Self::new) refuses at compile time.
    #[must_use]
    pub fn read<R: Record>(&self) -> R {
        R::read_from_bytes(&self.record[..size_of::<R>()]).expect("the slice has the size of the record")
    }
}
