//! True distance of a vehicle from its path; the truth may be in another log than the flight.
//!
//! The error is the distance from the path of [`metrics`] at every tick of the truth. The log of a flight in a
//! laboratory has no truth. If the laboratory was simulated (`gerono world`), the simulator recorded it by its own
//! clock; both logs record when their clocks started.
//!
//! The vehicle is evaluated along the path: from the first reference of the phase `fly` to its last.

use std::path::{Path, PathBuf};

use scenario::Scenario;
use serde::Serialize;
use shared_types::Topic;
use shared_types::samples::{ControlAdaptation, PathReference, VehicleTruth};
use shared_types::service::{nanoseconds, seconds};

use metrics::path_clock::PathClock;
use metrics::statistics::Statistics;
use metrics::{ULTIMATE_WINDOW, read};
use reproduce::windows::AVERAGED;
use run_log::{LogReadError, LogReader, flight_start, host_log_beside};

/// Reason why a flight cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    #[error("{0}")]
    Log(#[from] LogReadError),
    /// The start of a clock is not recorded.
    #[error(
        "nothing beside {} says when the flight's clock began; keep host.mcap beside run.mcap, of flights in real time", .0.display()
    )]
    NoStart(PathBuf),
    #[error("in {} the vehicle never flew along its path", .0.display())]
    NeverFlew(PathBuf),
    /// The log contains no truth for that time.
    #[error(
        "{} does not know the truth of the time in which the vehicle flew along its path; in a laboratory, name the log of \
         `gerono world` with --world", .0.display()
    )]
    NoTruth(PathBuf),
}

/// Statistics of the distance in a part of a flight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    pub name: &'static str,
    /// Begin and end, s since the start of the truth's clock.
    pub span: [f64; 2],
    /// Root mean square, m.
    pub rmse: f64,
    /// Standard deviation, m.
    pub deviation: f64,
    /// Maximum, m.
    pub largest: f64,
}

/// Result of the comparison with the truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Truth {
    pub parts: Vec<Part>,
    /// Mean of the true disturbance in the last [`AVERAGED`] seconds, in {I}, m/s².
    pub disturbance: [f64; 3],
    /// Mean of π(b̂) in the same time, in {I}, m/s².
    pub disturbance_estimate: [f64; 3],
}

/// Interval of time, ns since the start of the truth's clock.
type Span = [u64; 2];

/// Samples of a flight.
struct FlightSamples {
    references: Vec<PathReference>,
    adaptations: Vec<ControlAdaptation>,
    /// Interval of the phase `fly`, by the flight's clock, ns.
    on_path: Span,
}

/// Offset from the flight's clock to the truth's, ns.
#[derive(Clone, Copy)]
struct Shift(i64);

impl Shift {
    /// Converts a time of the flight to one of the truth; `None` before the start of the truth's clock.
    fn of_flight(self, time_ns: u64) -> Option<u64> {
        time_ns.checked_add_signed(self.0)
    }

    /// Converts a time of the truth to one of the flight.
    fn of_truth(self, time_ns: u64) -> Option<u64> {
        time_ns.checked_add_signed(-self.0)
    }
}

/// Compares a flight with the truth in its own log, or in that of a simulator. `last` is the length of the last part,
/// s.
///
/// # Errors
/// [`TruthError`].
pub fn compare(flight: &Path, world: Option<&Path>, last: f64) -> Result<Truth, TruthError> {
    let flown = FlightSamples::read(flight)?;
    let shift = match world {
        None => Shift(0),
        Some(world) => Shift(start_of(flight)?.wrapping_sub(start_of(world)?).cast_signed()),
    };
    let truth = LogReader::open(world.unwrap_or(flight))?;
    let [begin, end] = flown.on_path;
    let no_truth = || TruthError::NoTruth(world.unwrap_or(flight).to_owned());
    let [begin, end] = [
        shift.of_flight(begin).unwrap_or(0),
        shift.of_flight(end).ok_or_else(no_truth)?,
    ];
    let mut parts = parts(&truth.manifest().scenario, [begin, end], last);
    let averaged = [end.saturating_sub(nanoseconds(AVERAGED)).max(begin), end];
    let disturbance = flown.judge(truth, shift, &averaged, &mut parts)?;
    parts.retain(|(_, _, error)| error.count() > 0);
    if parts.is_empty() {
        return Err(no_truth());
    }
    Ok(Truth {
        parts: parts.iter().map(Part::of).collect(),
        disturbance,
        disturbance_estimate: flown.estimate(shift, &averaged),
    })
}

impl FlightSamples {
    fn read(flight: &Path) -> Result<Self, TruthError> {
        let mut reader = LogReader::open(flight)?;
        let (mut references, mut adaptations) = (Vec::new(), Vec::new());
        while let Some(sample) = reader.next_sample()? {
            match sample.topic {
                Topic::PathReference => references.push(read::<PathReference>(sample.bytes)),
                Topic::ControlAdaptation => adaptations.push(read::<ControlAdaptation>(sample.bytes)),
                _ => {}
            }
        }
        let mut on_path = references
            .iter()
            .filter(|reference| reference.phase == PathReference::PHASE_FLY)
            .map(|reference| reference.reference_time_ns);
        let first = on_path.next();
        let on_path = first.map(|first| [first, on_path.next_back().unwrap_or(first)]);
        Ok(Self {
            on_path: on_path.ok_or_else(|| TruthError::NeverFlew(flight.to_owned()))?,
            references,
            adaptations,
        })
    }

    /// Adds the distances from the path to the parts that contain them; returns the mean of the true disturbance in
    /// `averaged`.
    fn judge(
        &self,
        truth: LogReader,
        shift: Shift,
        averaged: &Span,
        parts: &mut [(&'static str, Span, Statistics)],
    ) -> Result<[f64; 3], TruthError> {
        let mut clock = PathClock::default();
        self.references
            .iter()
            .for_each(|reference| clock.observe(reference));
        let mut disturbance: [Statistics; 3] = Default::default();
        for sample in truth.samples::<VehicleTruth>() {
            let truth = sample?;
            let at = truth.header.stamp_ns;
            let Some(demand) = shift.of_truth(at).and_then(|time| clock.at(time)) else {
                continue;
            };
            let Some(error) = demand.distance(&truth.position_world) else {
                continue;
            };
            for (_, _, statistics) in parts.iter_mut().filter(|(_, span, _)| is_within(span, at)) {
                statistics.add(error);
            }
            if is_within(averaged, at) {
                add_each(&mut disturbance, &truth.disturbance_world);
            }
        }
        Ok(disturbance.map(|component| component.mean()))
    }

    /// Returns the mean of π(b̂) in a span, in {I}, m/s².
    fn estimate(&self, shift: Shift, averaged: &Span) -> [f64; 3] {
        let mut estimate: [Statistics; 3] = Default::default();
        for adaptation in &self.adaptations {
            if shift
                .of_flight(adaptation.header.stamp_ns)
                .is_some_and(|at| is_within(averaged, at))
            {
                add_each(&mut estimate, &adaptation.disturbance_projected_world);
            }
        }
        estimate.map(|component| component.mean())
    }
}

fn start_of(log: &Path) -> Result<u64, TruthError> {
    host_log_beside(log)
        .and_then(|host| flight_start::read(&host))
        .ok_or_else(|| TruthError::NoStart(log.to_owned()))
}

/// Returns the parts of a flight along the path: before the first event of the scenario, from there to the last part,
/// the last part, all.
fn parts(scenario: &Scenario, [begin, end]: Span, last: f64) -> Vec<(&'static str, Span, Statistics)> {
    let event = metrics::changes(scenario).min_by(f64::total_cmp).map(nanoseconds);
    let event = event.filter(|event| (begin..end).contains(event));
    let last = end.saturating_sub(nanoseconds(last)).max(begin);
    let before = event.map(|at| {
        (
            "before",
            [at.saturating_sub(nanoseconds(ULTIMATE_WINDOW)).max(begin), at],
        )
    });
    let after = event.filter(|at| *at < last).map(|at| ("after", [at, last]));
    before
        .into_iter()
        .chain(after)
        .chain([("last", [last, end]), ("all", [begin, end])])
        .map(|(name, span)| (name, span, Statistics::default()))
        .collect()
}

impl Part {
    fn of((name, span, error): &(&'static str, Span, Statistics)) -> Self {
        Self {
            name,
            span: span.map(seconds),
            rmse: error.rmse(),
            deviation: error.deviation(),
            largest: error.max(),
        }
    }
}

fn is_within([from, to]: &Span, at: u64) -> bool {
    (*from..=*to).contains(&at)
}

fn add_each(statistics: &mut [Statistics; 3], values: &[f64; 3]) {
    for (statistics, value) in statistics.iter_mut().zip(values) {
        statistics.add(*value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use reproduce::flight::ScenarioSource;

    fn spans(on_path: [f64; 2], last: f64) -> Vec<(&'static str, [f64; 2])> {
        let scenario = ScenarioSource::FIG7.load(&[], 1).unwrap();
        parts(&scenario, on_path.map(nanoseconds), last)
            .into_iter()
            .map(|(name, span, _)| (name, span.map(seconds)))
            .collect()
    }

    #[test]
    fn parts_lie_around_the_fan_and_at_the_end() {
        assert_eq!(
            spans([9.0, 81.5], 20.0),
            [
                ("before", [25.0, 30.0]),
                ("after", [30.0, 61.5]),
                ("last", [61.5, 81.5]),
                ("all", [9.0, 81.5]),
            ]
        );
    }

    #[test]
    fn a_flight_that_ends_before_the_fan_or_begins_with_it_has_no_parts_around_it() {
        assert_eq!(
            spans([9.0, 29.0], 5.0),
            [("last", [24.0, 29.0]), ("all", [9.0, 29.0])]
        );
        assert_eq!(
            spans([9.0, 29.0], 50.0),
            [("last", [9.0, 29.0]), ("all", [9.0, 29.0])]
        );
        assert_eq!(spans([28.0, 33.0], 1.0)[0], ("before", [28.0, 30.0]));
        assert!(spans([28.0, 33.0], 4.0).iter().all(|(name, _)| *name != "after"));
    }

    #[test]
    fn a_world_that_began_earlier_is_further_on() {
        let shift = Shift(nanoseconds(1.5).cast_signed());
        assert_eq!(shift.of_flight(nanoseconds(2.0)), Some(nanoseconds(3.5)));
        assert_eq!(shift.of_truth(nanoseconds(3.5)), Some(nanoseconds(2.0)));
        assert_eq!(shift.of_truth(nanoseconds(1.0)), None, "before the flight");
        assert_eq!(Shift(-1_500_000_000).of_flight(nanoseconds(1.0)), None);
    }
}
