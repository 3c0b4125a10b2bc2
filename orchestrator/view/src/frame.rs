//! Conversion of a run's samples to the frames that the page draws.

use std::collections::BTreeSet;
use std::sync::Arc;

use metrics::summary::cause_in_words;
use metrics::tracker::{StateSource, Vehicle, newest_distance};
use nalgebra::Vector3;
use report::marks::{Mark, Marks};
use report::{channels, panels};
use run_client::{Description, NewestSamples};
use runtime::control::Host;
use scenario::Scenario;
use serde::Serialize;
use serde_json::json;
use shared_types::rotation::{from_row_major, roll_pitch_yaw};
use shared_types::samples::{
    ControlAdaptation, ControlCommand, ControlErrors, ControlTelemetry, PathReference, RunEvent,
    VehicleState, VehicleTruth,
};
use shared_types::service::seconds;
use shared_types::{Schedule, Topic};
use zerocopy::IntoBytes;

use crate::path;

/// Encoder of the frames of a flight.
pub struct Encoder {
    description: Description,
    scenario: Arc<Scenario>,
    schedule: Schedule,
    source: StateSource,
    marks: Marks,
    /// Planned events in the future, the next one last.
    planned: Vec<RunEvent>,
}

/// State of the flight at one time, in the page's format. A number that is not finite becomes null.
#[derive(Debug, PartialEq, Serialize)]
pub struct Frame {
    /// Time of the flight, s.
    #[serde(rename = "t")]
    pub time: f64,
    /// Wall-clock time, ms since 1970; `None` in simulated time.
    #[serde(rename = "w", skip_serializing_if = "Option::is_none")]
    pub wall_ms: Option<f64>,
    /// Position (m), reference position (m), roll, pitch and yaw (rad).
    #[serde(rename = "p")]
    pub place: [f32; 9],
    /// Distance from the path (m), speed (m/s), body rate (rad/s), commanded thrust (N), m̂ (kg), ‖b̂‖ (m/s²).
    #[serde(rename = "q")]
    pub quantities: [f32; 6],
    /// Why the last take-off was given up, while the vehicle is not armed again.
    #[serde(rename = "g", skip_serializing_if = "Option::is_none")]
    pub given_up: Option<String>,
    /// Values of the channels, in their order.
    #[serde(rename = "v")]
    pub values: Vec<f32>,
}

impl Encoder {
    /// Creates the encoder of a flight; `None` if its scenario has no valid schedule.
    #[must_use]
    pub fn new(description: Description) -> Option<Self> {
        let schedule = description.scenario.schedule().ok()?;
        let mut planned = flight::recording_sink::planned_events(&description.scenario, &schedule);
        planned.reverse();
        Some(Self {
            source: StateSource::of(&schedule),
            schedule,
            scenario: Arc::new(description.scenario.clone()),
            description,
            marks: Marks::default(),
            planned,
        })
    }

    #[must_use]
    pub fn scenario(&self) -> &Arc<Scenario> {
        &self.scenario
    }

    /// Returns the constants of a flight, in the page's format.
    #[must_use]
    pub fn flight(&self, run: &str) -> String {
        let scenario = &self.description.scenario;
        let telemetry: BTreeSet<_> = scenario.controller.telemetry.iter().map(String::as_str).collect();
        let flight = json!({
            "run": run,
            "description": scenario.description,
            "seed": scenario.seed,
            "duration": seconds(self.schedule.time_ns(self.schedule.last_tick())),
            "bound": scenario.theorem_bound(),
            "is_in_real_time": self.description.host == Host::RealTime,
            "is_estimated": self.source == StateSource::Estimate,
            "panels": panels::panels(&telemetry),
            "channels": self.channels(),
            "path": path::points(scenario),
            "envelope_box": scenario.envelope.as_ref().and_then(|envelope| envelope.r#box.as_ref()),
            "version": env!("CARGO_PKG_VERSION"),
        });
        flight.to_string()
    }

    /// Returns topic and name of each channel, in the order of a frame's values.
    fn channels(&self) -> Vec<(&'static str, &str)> {
        let vehicle = match self.source {
            StateSource::Truth => (Topic::VehicleTruth, &channels::TRUTH[..]),
            StateSource::Estimate => (Topic::VehicleState, &channels::STATE[..]),
        };
        let of_topics = [
            vehicle,
            (Topic::ControlErrors, &channels::ERRORS[..]),
            (Topic::ControlCommand, &channels::COMMAND[..]),
            (Topic::ControlAdaptation, &channels::ADAPTATION[..]),
            (Topic::PathReference, &channels::REFERENCE[..]),
        ];
        let ours = of_topics
            .into_iter()
            .flat_map(|(topic, names)| names.iter().map(move |&name| (topic.name(), name)));
        let telemetry = self.description.scenario.controller.telemetry.iter();
        let telemetry = telemetry.map(|name| (Topic::ControlTelemetry.name(), name.as_str()));
        ours.chain(telemetry).collect()
    }

    /// Returns the frame of the samples; `None` before the vehicle's state is available.
    pub fn frame(&mut self, newest: &NewestSamples) -> Option<Frame> {
        let truth = newest.get::<VehicleTruth>();
        let vehicle = match self.source {
            StateSource::Truth => Vehicle::from(truth.as_ref()?),
            StateSource::Estimate => {
                let state = newest
                    .get::<VehicleState>()
                    .filter(|state| state.tracked.is_set())?;
                Vehicle::from(&state)
            }
        };
        self.observe(newest);
        let reference = newest.get::<PathReference>();
        let distance = reference
            .as_ref()
            .and_then(|reference| newest_distance(&vehicle, reference, self.has_phases()));
        let command = newest.get::<ControlCommand>();
        let adaptation = newest.get::<ControlAdaptation>();
        Some(Frame {
            time: seconds(vehicle.time_ns),
            wall_ms: self
                .description
                .start_ns
                .map(|start| wall_ms(start + vehicle.time_ns)),
            place: place(&vehicle, reference.as_ref()),
            quantities: quantities(&vehicle, distance, command.as_ref(), adaptation.as_ref()),
            given_up: reference.as_ref().and_then(given_up),
            values: self.values(newest, distance, reference.as_ref()),
        })
    }

    fn has_phases(&self) -> bool {
        self.description.scenario.flight.is_some()
    }

    /// Adds the events that the samples report.
    fn observe(&mut self, newest: &NewestSamples) {
        let tick = newest.tick().unwrap_or_default();
        while let Some(event) = self.planned.pop_if(|event| event.header.tick <= tick) {
            self.marks.observe(Topic::RunEvent, event.as_bytes());
        }
        // Flights without phases have samples of all these topics, too.
        let topics = [Topic::PathReference, Topic::ControlAdaptation, Topic::RcFrame];
        for topic in topics {
            if let Some(bytes) = newest.bytes(topic) {
                self.marks.observe(topic, bytes);
            }
        }
    }

    /// Returns the events up to a time, s.
    #[must_use]
    pub fn marks(&self, time: f64) -> Vec<Mark> {
        self.marks.clone().finish(&self.description.scenario, time)
    }

    fn values(
        &self,
        newest: &NewestSamples,
        distance: Option<f64>,
        reference: Option<&PathReference>,
    ) -> Vec<f32> {
        let scenario = &self.description.scenario;
        let adaptation = newest.get::<ControlAdaptation>();
        let is_following_path = reference.is_none() || distance.is_some();
        let is_in_law = |adaptation: &ControlAdaptation| adaptation.stage == ControlAdaptation::STAGE_LAW;
        let is_law_active = is_following_path && adaptation.as_ref().is_none_or(is_in_law);
        let mut values = Vec::new();
        // A topic without a sample contributes NaN.
        let mut add = |known: Option<&[f64]>, count: usize| match known {
            Some(known) => values.extend(known.iter().map(|&value| value as f32)),
            None => values.extend(std::iter::repeat_n(f32::NAN, count)),
        };
        match self.source {
            StateSource::Truth => {
                let yaw = reference.map(|reference| reference.yaw);
                let truth = newest.get::<VehicleTruth>();
                let known = truth.map(|truth| channels::truth(&truth, distance, yaw));
                add(known.as_ref().map(<[_; _]>::as_slice), channels::TRUTH.len());
            }
            StateSource::Estimate => add(Some(&channels::state(distance)), channels::STATE.len()),
        }
        let errors = newest.get::<ControlErrors>();
        let errors = errors.map(|errors| channels::errors(&errors, is_law_active));
        add(errors.as_ref().map(<[_; _]>::as_slice), channels::ERRORS.len());
        let command = newest.get::<ControlCommand>();
        let command = command.map(|command| channels::command(&command));
        add(command.as_ref().map(<[_; _]>::as_slice), channels::COMMAND.len());
        let has_observer = scenario.controller.observer_gain.is_some();
        let adaptation = adaptation.map(|adaptation| channels::adaptation(&adaptation, has_observer));
        add(
            adaptation.as_ref().map(<[_; _]>::as_slice),
            channels::ADAPTATION.len(),
        );
        let reference = reference.map(channels::reference);
        add(
            reference.as_ref().map(<[_; _]>::as_slice),
            channels::REFERENCE.len(),
        );
        let names = &scenario.controller.telemetry;
        let telemetry = newest.get::<ControlTelemetry>();
        let count = names.len().min(ControlTelemetry::NUMBERS);
        add(
            telemetry.as_ref().map(|telemetry| &telemetry.values[..count]),
            count,
        );
        values
    }
}

/// Returns why a take-off was given up, as long as the phase that began then lasts.
fn given_up(reference: &PathReference) -> Option<String> {
    (reference.cause == PathReference::CAUSE_OVERDUE)
        .then(|| cause_in_words(reference.cause))
        .flatten()
}

fn place(vehicle: &Vehicle, reference: Option<&PathReference>) -> [f32; 9] {
    let attitude = roll_pitch_yaw(&from_row_major(&vehicle.world_from_body));
    // Before the vehicle is known, the reference is zero.
    let known = reference.filter(|reference| reference.vehicle_known.is_set());
    let desired = known.map_or([f64::NAN; 3], |reference| reference.position_world);
    let mut place = [0.0; 9];
    let numbers = vehicle.position_world.into_iter().chain(desired).chain(attitude);
    for (place, number) in place.iter_mut().zip(numbers) {
        *place = number as f32;
    }
    place
}

fn quantities(
    vehicle: &Vehicle,
    distance: Option<f64>,
    command: Option<&ControlCommand>,
    adaptation: Option<&ControlAdaptation>,
) -> [f32; 6] {
    let thrust = command.filter(|command| command.mode != ControlCommand::MODE_FAILSAFE);
    let norm = |vector: [f64; 3]| Vector3::from(vector).norm();
    let known = |value: Option<f64>| value.unwrap_or(f64::NAN) as f32;
    [
        known(distance),
        norm(vehicle.velocity_body) as f32,
        norm(vehicle.angular_velocity_body) as f32,
        known(thrust.map(|command| command.thrust)),
        known(adaptation.map(|adaptation| adaptation.mass_estimate)),
        known(adaptation.map(|adaptation| norm(adaptation.disturbance_projected_world))),
    ]
}

/// Converts a time of `CLOCK_MONOTONIC` (ns) to ms since 1970.
fn wall_ms(monotonic_ns: u64) -> f64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let since = runtime::flight_clock::monotonic_ns() as f64 - monotonic_ns as f64;
    now.map_or(0.0, |now| now.as_secs_f64() * 1e3) - since * 1e-6
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    #[test]
    fn a_take_off_that_was_given_up_says_why_until_the_next_phase() {
        let mut reference = PathReference::new_zeroed();
        assert_eq!(given_up(&reference), None);
        reference.cause = PathReference::CAUSE_OVERDUE;
        let why = given_up(&reference).unwrap();
        assert!(why.starts_with("the take-off took too long"), "{why}");
        reference.cause = PathReference::CAUSE_TOUCHED_DOWN;
        assert_eq!(given_up(&reference), None);
    }
}
