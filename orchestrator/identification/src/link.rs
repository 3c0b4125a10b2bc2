//! Calibration of a radio link from a log, as the paper did it for its vehicle.
//!
//! For each stick, thrust or body rate = offset + slope · travel is fitted. The travel is taken at the time at which it acts,
//! with the model's lag (`history`). Thrust and rates are measured from the captured poses (`measured`), which every
//! laboratory has, or taken from the simulated truth.
//!
//! A stick that hardly moves is not identifiable: it explains little of the measured variance, and below [`EXPLAINS`] a fit must
//! not be used. A short log is not sufficient either: gusts last for seconds, and the intervals are based on the differences
//! between stretches of the flight (`fit`). A controller moves the thrust stick against disturbances, which correlates the stick
//! with them: the desired thrust of the path is the instrument of its fit (`fit`). A flight up and down and around both axes
//! suits well. Of a flight with phases only the time along the path counts: on the ground the thrust carries nothing.

mod fit;
mod history;
mod measured;
mod words;

use std::path::Path;

use scenario::{Model, RcLink, Recorded, Scenario};
use serde::Serialize;
use shared_types::flight_phase::FlightPhase;
use shared_types::samples::{MocapPose, PathReference, RcFrame, VehicleTruth};
use shared_types::{Topic, service::seconds};

pub use fit::Fit;

use crate::lateness;
use crate::rehearsal::Rehearsal;
use fit::Point;
use history::{Frame, History};
use measured::{DesiredAcceleration, Pose, Truth};
use metrics::read;
use metrics::response::ResponseWatch;
use run_log::{LogReadError, LogReader};

/// Minimum share of the variance that a stick must explain for its fit to be used.
pub const EXPLAINS: f64 = 0.8;

/// Relevance threshold for an error of the calibration, as a share of the slope.
pub const MATTERS: f64 = 0.03;

/// Least share of the stated slope that a reversed stick has.
const REVERSED: f64 = 0.3;

/// Names of the sticks in the order of a frame's channels.
pub const STICKS: [&str; 4] = ["thrust", "roll rate", "pitch rate", "yaw rate"];

/// Reason why a link cannot be calibrated.
#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    /// The log cannot be read.
    #[error("{0}")]
    Log(#[from] LogReadError),
    /// The link had no channels.
    #[error("the flight had no radio link with channels; add `[rc_output]` to its scenario")]
    NoLink,
    /// The log lacks a topic that the fit needs.
    #[error("the log has no samples of `{topic}`{}: {remedy}", if *is_left_out { ", which `record.leave_out` of its scenario left out" } else { "" })]
    Missing {
        /// The topic.
        topic: Topic,
        /// Whether the scenario excludes it from the log.
        is_left_out: bool,
        /// The fix.
        remedy: &'static str,
    },
}

/// Source of the measured thrust and rates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FrameSource {
    /// The captured poses.
    #[default]
    Poses,
    /// The simulated truth.
    Truth,
}

/// A stick's calibration, as configured and as fitted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Calibration {
    /// Name of the stick.
    pub stick: &'static str,
    /// The scenario's offset and slope per unit of travel, N or rad/s.
    pub stated: [f64; 2],
    /// The fit; `None` if the stick is not identifiable.
    pub fitted: Option<Fit>,
    /// Flight time that a fit of the stick needs, s; only if the log is shorter.
    pub needed: Option<f64>,
}

impl Calibration {
    /// Returns whether the fit differs from the stated calibration: significantly, outside of the 99.9 % interval, and by
    /// more than [`MATTERS`] of the slope.
    #[must_use]
    pub fn differs(&self) -> bool {
        self.usable().is_some_and(|fit| {
            let [offset, slope] = self.stated;
            let beyond = |by: f64, error: f64| by.abs() > error.max(MATTERS * slope.abs());
            let [of_offset, of_slope] = fit.certain;
            // Scenarios have no offset of the rates.
            let has_offset = self.stick == STICKS[0];
            beyond(fit.slope - slope, of_slope) || has_offset && beyond(fit.offset - offset, of_offset)
        })
    }

    /// Returns whether the vehicle answers to the stick with the opposite of the stated sign, outside of the 99.9 % interval.
    #[must_use]
    pub fn is_reversed(&self) -> bool {
        self.fitted.is_some_and(|fit| {
            let along = fit.slope * self.stated[1].signum();
            along < -fit.certain[1] && along < -REVERSED * self.stated[1].abs()
        })
    }

    /// Returns the fit if the stick explains enough of the variance.
    #[must_use]
    pub fn usable(&self) -> Option<Fit> {
        self.fitted.filter(|fit| fit.explained >= EXPLAINS)
    }
}

/// The calibration of all sticks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identification {
    /// What replaced the laboratory; `None` for a laboratory, and for a scenario without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rehearsal: Option<Rehearsal>,
    /// `true` if the machine was late, so that nothing of it is fit for a scenario: not known to the samples.
    #[serde(skip)]
    pub is_late: bool,
    /// Source of the measurement.
    pub source: FrameSource,
    /// Mass for the conversion of accelerations to thrust, kg; only with poses.
    pub mass: Option<f64>,
    /// Thrust, roll, pitch and yaw.
    pub sticks: [Calibration; 4],
    /// A wrong axis or sign in the response to the first commands off the ground; none unless found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub response: Option<String>,
}

/// Collects the samples of a log for the fit.
#[derive(Debug)]
pub struct Gatherer {
    rehearsal: Option<Rehearsal>,
    link: RcLink,
    model: Model,
    mass: f64,
    source: FrameSource,
    recorded: [Recorded; Topic::ALL.len()],
    frames: Vec<Frame>,
    poses: Vec<Pose>,
    truths: Vec<Truth>,
    desired: Vec<DesiredAcceleration>,
    response: ResponseWatch,
    has_phases: bool,
    /// `true` if the vehicle flies along its path, by the newest reference.
    is_on_path: bool,
}

impl Gatherer {
    /// Starts a flight of a scenario. `mass` is in kg, by default the scenario's.
    ///
    /// # Errors
    /// [`IdentifyError::NoLink`].
    pub fn new(scenario: &Scenario, source: FrameSource, mass: Option<f64>) -> Result<Self, IdentifyError> {
        Ok(Self {
            rehearsal: Rehearsal::of(scenario),
            link: scenario.rc_output.clone().ok_or(IdentifyError::NoLink)?,
            model: scenario.model.clone().unwrap_or_default(),
            mass: mass.unwrap_or(scenario.vehicle.mass),
            source,
            recorded: Recorded::of_topics(scenario),
            frames: Vec::new(),
            poses: Vec::new(),
            truths: Vec::new(),
            desired: Vec::new(),
            response: ResponseWatch::new(scenario),
            has_phases: scenario.flight.is_some(),
            is_on_path: scenario.flight.is_none(),
        })
    }

    /// Records a sample.
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) {
        self.response.observe(topic, bytes);
        if topic == Topic::PathReference && self.has_phases {
            let reference = read::<PathReference>(bytes);
            self.is_on_path = FlightPhase::from_code(reference.phase) == FlightPhase::Fly;
        }
        match (topic, self.source) {
            (Topic::RcFrame, _) => {
                let frame = read::<RcFrame>(bytes);
                let acts_at = seconds(frame.header.stamp_ns) + self.model.radio_latency;
                self.frames
                    .push(Frame::new(&frame, &self.link, acts_at, self.is_on_path));
            }
            (Topic::PathReference, FrameSource::Poses) => {
                self.desired
                    .push(DesiredAcceleration::new(&read::<PathReference>(bytes)));
            }
            (Topic::MocapPose, FrameSource::Poses) => {
                let pose = read::<MocapPose>(bytes);
                self.poses.extend(pose.is_whole().then(|| Pose::new(&pose)));
            }
            (Topic::VehicleTruth, FrameSource::Truth) => {
                self.truths.push(Truth::new(&read::<VehicleTruth>(bytes)));
            }
            _ => {}
        }
    }

    /// Fits all sticks.
    ///
    /// # Errors
    /// [`IdentifyError::Missing`].
    pub fn finish(self) -> Result<Identification, IdentifyError> {
        self.check_topics()?;
        let lags = [
            self.model.thrust_lag,
            self.model.rate_lag,
            self.model.rate_lag,
            self.model.rate_lag,
        ];
        let history = History::new(&self.frames, lags);
        let points = match self.source {
            FrameSource::Poses => measured::by_poses(&self.poses, &self.desired, self.mass, &history),
            FrameSource::Truth => measured::by_truth(&self.truths, &history),
        };
        Ok(Identification {
            rehearsal: self.rehearsal,
            is_late: false,
            source: self.source,
            mass: (self.source == FrameSource::Poses).then_some(self.mass),
            sticks: [0, 1, 2, 3].map(|stick| self.calibration(stick, &points[stick])),
            response: self.response.verdict().map(str::to_owned),
        })
    }

    /// Refuses a log without a topic that the fit needs.
    fn check_topics(&self) -> Result<(), IdentifyError> {
        let by_truth = "record it, or fit with `--from truth`";
        let needed: &[(Topic, bool, &'static str)] = match self.source {
            FrameSource::Poses => &[
                (Topic::MocapPose, self.poses.is_empty(), by_truth),
                (Topic::PathReference, self.desired.is_empty(), by_truth),
            ],
            FrameSource::Truth => &[(
                Topic::VehicleTruth,
                self.truths.is_empty(),
                "fit with `--from poses`",
            )],
        };
        let frames = (Topic::RcFrame, self.frames.is_empty(), "record it");
        let mut all = needed.iter().copied().chain([frames]);
        let missing = all.find(|&(_, is_missing, _)| is_missing);
        missing.map_or(Ok(()), |(topic, _, remedy)| {
            let index = Topic::ALL.iter().position(|&other| other == topic);
            Err(IdentifyError::Missing {
                topic,
                is_left_out: index.is_some_and(|index| self.recorded[index] == Recorded::Nothing),
                remedy,
            })
        })
    }

    fn calibration(&self, stick: usize, points: &[Point]) -> Calibration {
        let cluster = measured::DEPENDENT[stick];
        let min_points = Fit::min_points(cluster);
        let needed = measured::needed(min_points, measured::spacings(self.source)[stick]);
        Calibration {
            stick: STICKS[stick],
            stated: match stick {
                0 => [self.link.thrust_offset, self.link.thrust_slope],
                rate => [0.0, self.link.rate_slope[rate - 1]],
            },
            fitted: Fit::new(points, cluster),
            needed: (points.len() < min_points).then_some(needed),
        }
    }
}

/// Fits the calibration of the link that a log was recorded with.
///
/// # Errors
/// [`IdentifyError`].
pub fn identify(log: &Path, source: FrameSource, mass: Option<f64>) -> Result<Identification, IdentifyError> {
    let mut reader = LogReader::open(log)?;
    let mut gatherer = Gatherer::new(&reader.manifest().scenario, source, mass)?;
    while let Some(logged) = reader.next_sample()? {
        gatherer.observe(logged.topic, logged.bytes);
    }
    Ok(Identification {
        is_late: lateness::warning(log).is_some(),
        ..gatherer.finish()?
    })
}

#[cfg(test)]
mod tests;
