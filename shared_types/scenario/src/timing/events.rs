//! Events in flight, their durations, and modelled latencies: whole ticks too.

use super::ticks::TickReader;
use super::{LONGEST_DELAY, LONGEST_FLIGHT};
use crate::{Key, Scenario};

/// Longest latency that a model may state, ns: what a vehicle does in a longer time cannot be predicted.
const LONGEST_PREDICTION_NS: u64 = 200_000_000;

/// A time of the scenario, s, and its place.
type StatedTime = (Key, f64);

impl Scenario {
    /// Reads the times that belong to no service or topic.
    pub(super) fn read_event_times(&self, reader: &mut TickReader) {
        for (key, time) in self.moments() {
            reader.read(&key, time, 0..=LONGEST_FLIGHT);
        }
        for (key, time) in self.lengths() {
            reader.read(&key, time, 1..=LONGEST_FLIGHT);
        }
        for (key, time) in self.planned_delays() {
            reader.read(&key, time, 1..=LONGEST_DELAY);
        }
        for (key, time) in self.input_ages() {
            reader.read(&key, time, 1..=LONGEST_FLIGHT);
        }
        for (key, time) in self.recoveries() {
            reader.read(&key, time, 0..=LONGEST_DELAY);
        }
        let longest = LONGEST_PREDICTION_NS / reader.tick_ns();
        for (key, time) in self.modelled_latencies() {
            reader.read(&key, time, 0..=longest);
        }
    }

    /// Returns the times of events.
    fn moments(&self) -> Vec<StatedTime> {
        let root = Key::root();
        let vehicle = root.then("vehicle");
        let changes = &self.vehicle.change;
        let mut moments = in_array(&vehicle.then("change"), "at", changes, |change| change.at);
        let gains = &self.controller.change;
        let at = root.then("controller").then("change");
        moments.extend(in_array(&at, "at", gains, |change| change.at));
        let steps = &self.path.yaw_step;
        moments.extend(in_array(
            &root.then("path").then("yaw_step"),
            "at",
            steps,
            |step| step.at,
        ));
        moments.extend(in_array(&root.then("fault"), "at", &self.fault, |fault| fault.at));
        if let Some(fan) = &self.vehicle.fan {
            let at = vehicle.then("fan");
            moments.push((at.then("on_at"), fan.on_at));
            moments.extend(fan.off_at.map(|time| (at.then("off_at"), time)));
            moments.extend(in_array(&at.then("moves"), "at", &fan.moves, |place| place.at));
        }
        if let Some(flight) = &self.flight {
            let at = root.then("flight");
            let requests = flight.requests().into_iter();
            moments.extend(requests.filter_map(|(name, time)| Some((at.then(name), time?))));
        }
        if let Some(cameras) = &self.cameras {
            let at = root.then("cameras");
            moments.extend(in_array(&at.then("occlusion"), "at", &cameras.occlusion, |one| {
                one.at
            }));
            moments.extend(in_array(
                &at.then("marker_swap"),
                "at",
                &cameras.marker_swap,
                |one| one.at,
            ));
        }
        moments
    }

    /// Returns the durations of events.
    fn lengths(&self) -> Vec<StatedTime> {
        let faults = self.fault.iter().enumerate();
        let outages = faults.filter_map(|(index, fault)| {
            let key = Key::root().then("fault").then(index).then("for");
            Some((key, fault.lasts?))
        });
        let at = Key::root().then("cameras");
        self.cameras
            .iter()
            .fold(outages.collect(), |mut lengths: Vec<_>, cameras| {
                let (occlusions, swaps) = (&cameras.occlusion, &cameras.marker_swap);
                lengths.extend(in_array(&at.then("occlusion"), "lasts", occlusions, |one| {
                    one.lasts
                }));
                lengths.extend(in_array(&at.then("marker_swap"), "lasts", swaps, |one| one.lasts));
                lengths
            })
    }

    /// Returns the delays of samples.
    fn planned_delays(&self) -> Vec<StatedTime> {
        let faults = self.fault.iter().enumerate();
        faults
            .filter_map(|(index, fault)| Some((Key::root().then("fault").then(index).then("by"), fault.by?)))
            .collect()
    }

    /// From which ages on samples are too old.
    fn input_ages(&self) -> Vec<StatedTime> {
        let inputs = self.safety.iter();
        inputs
            .flat_map(|(edge, safety)| {
                let at = Key::root().then("safety").then(edge);
                let ages = safety.ages().into_iter();
                ages.filter_map(move |(name, age)| Some((at.then(name), age?)))
            })
            .collect()
    }

    /// Returns the durations of transfers to the law's commands.
    fn recoveries(&self) -> Vec<StatedTime> {
        let inputs = self.safety.iter();
        inputs
            .filter_map(|(edge, safety)| {
                Some((
                    Key::root().then("safety").then(edge).then("recover"),
                    safety.recover?,
                ))
            })
            .collect()
    }

    /// Returns the modelled latencies of estimator and controller.
    fn modelled_latencies(&self) -> Vec<StatedTime> {
        let at = Key::root().then("model");
        self.model.iter().fold(Vec::new(), |mut latencies, model| {
            latencies.push((at.then("radio_latency"), model.radio_latency));
            let capture = model.capture_latency;
            latencies.extend(capture.map(|time| (at.then("capture_latency"), time)));
            latencies
        })
    }
}

/// A time of each element of an array, by the name that it has there.
fn in_array<T>(array: &Key, name: &str, elements: &[T], time: fn(&T) -> f64) -> Vec<StatedTime> {
    let elements = elements.iter().enumerate();
    elements
        .map(|(index, element)| (array.then(index).then(name), time(element)))
        .collect()
}
