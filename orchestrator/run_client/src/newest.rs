//! The newest samples that a recorder has received, and the quantities that clients read from them.

use scenario::Scenario;
use shared_types::flight_phase::FlightPhase;
use shared_types::samples::{ControlAdaptation, PathReference, RcFrame, VehicleState, VehicleTruth};
use shared_types::{Published, Schedule, Topic};

use crate::{NewestSamples, Snapshot};
use metrics::summary::limit_in_words;
use metrics::tracker::{StateSource, Vehicle, newest_distance};

/// Recorder that gives access to the newest sample of each topic.
pub trait Newest {
    /// Returns the bytes of the newest sample of a topic, if one was received.
    fn newest_bytes(&self, topic: Topic) -> Option<&[u8]>;

    /// Returns the newest sample of a topic, if one was received.
    fn newest<T: Published>(&self) -> Option<T> {
        T::read_from_bytes(self.newest_bytes(T::TOPIC)?).ok()
    }

    /// Returns the newest samples of all topics.
    fn newest_samples(&self) -> NewestSamples {
        NewestSamples::of(|topic| self.newest_bytes(topic))
    }

    /// Returns the phase of a flight of `scenario`; `None` if it has no phases.
    fn phase(&self, scenario: &Scenario) -> Option<FlightPhase> {
        scenario.flight.as_ref()?;
        let reference = self.newest::<PathReference>();
        Some(reference.map_or(FlightPhase::Disarmed, |reference| {
            FlightPhase::from_code(reference.phase)
        }))
    }

    /// Returns whether the newest frame carries the kill command.
    fn has_killed(&self) -> bool {
        let frame = self.newest::<RcFrame>();
        frame.is_some_and(|frame| frame.action == RcFrame::ACTION_KILL)
    }

    /// Returns what killed the motors, in words, if they were killed: a limit of the envelope by the newest frame, or else the
    /// request, whose cause is `requested_for` if it is known; `is_requested` states whether there is one.
    fn killed_by(&self, is_requested: bool, requested_for: Option<&str>) -> Option<String> {
        let frame = self.newest::<RcFrame>();
        let frame = frame.filter(|frame| frame.action == RcFrame::ACTION_KILL);
        match frame {
            Some(frame) if frame.limit != RcFrame::LIMIT_NONE => Some(limit_in_words(frame.limit)),
            frame => (is_requested || frame.is_some()).then(|| {
                requested_for
                    .unwrap_or("the operator or the kill switch")
                    .to_owned()
            }),
        }
    }

    /// Returns the distance of the vehicle from the path, m: the true one, or in a laboratory the estimated one.
    fn position_error(&self, scenario: &Scenario, schedule: &Schedule) -> Option<f64> {
        let vehicle = match StateSource::of(schedule) {
            StateSource::Truth => Vehicle::from(&self.newest::<VehicleTruth>()?),
            StateSource::Estimate => {
                let state = self.newest::<VehicleState>()?;
                Vehicle::from(&Some(state).filter(|state| state.tracked.is_set())?)
            }
        };
        let reference = self.newest::<PathReference>()?;
        newest_distance(&vehicle, &reference, scenario.flight.is_some())
    }

    /// Returns a snapshot with the quantities that the samples contain; all others have default values.
    fn snapshot(&self, scenario: &Scenario, schedule: &Schedule) -> Snapshot {
        let adaptation = self.newest::<ControlAdaptation>();
        Snapshot {
            scenario: scenario.description.clone(),
            duration: shared_types::service::seconds(schedule.time_ns(schedule.last_tick())),
            // Of a run that was taken over and has sent no reference since, it is not known.
            phase: self
                .phase(scenario)
                .filter(|_| self.newest_bytes(Topic::PathReference).is_some())
                .map(|phase| phase.name().to_owned()),
            position_error: self.position_error(scenario, schedule),
            mass_estimate: adaptation.map(|adaptation| adaptation.mass_estimate),
            disturbance_estimate: adaptation.map(|adaptation| {
                let [x, y, z] = adaptation.disturbance_projected_world;
                (x * x + y * y + z * z).sqrt()
            }),
            ..Snapshot::default()
        }
    }
}
