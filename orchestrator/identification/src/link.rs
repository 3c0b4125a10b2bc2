//! The calibration of a radio link from a log: what the travel of each stick meant, as the paper found it for its vehicle.
//!
//! Each stick is fitted: thrust or body rate = offset + slope · travel, where the travel is taken when it
//! acted and lags as the model believes (`history`). Thrust and rates are measured (`measured`) from the captured poses,
//! which every laboratory has, or taken from the simulated truth.
//!
//! A stick that hardly moved tells nothing, which shows in how much of what was measured it explains; below [`EXPLAINS`] a fit
//! is not to be used. Nor does a short log: gusts last for seconds, and an interval rests on how far some stretches of the
//! flight contradict each other (`fit`). A controller moves the thrust stick against pushes from outside, so that more thrust goes with gusts
//! downwards and not with acceleration upwards: it is fitted by the thrust that the path asks for (`fit`). A flight up and
//! down and around both axes is good.

mod fit;
mod history;
mod measured;
mod words;

use std::path::Path;

use scenario::{Model, RcLink, Recorded, Scenario};
use serde::Serialize;
use shared_types::samples::{MocapPose, PathReference, RcFrame, VehicleTruth};
use shared_types::{Topic, service::seconds};

pub use fit::Fit;

use fit::Point;
use history::{Frame, History};
use measured::{Asked, Pose, Truth};
use metrics::read;
use run_log::{LogReadError, LogReader};

/// Share of what was measured that a stick must explain for its fit to be used.
pub const EXPLAINS: f64 = 0.8;

/// Share of a slope by which a calibration may be wrong before it matters.
pub const MATTERS: f64 = 0.03;

/// Names of the sticks in the order of a frame's channels.
pub const STICKS: [&str; 4] = ["thrust", "roll rate", "pitch rate", "yaw rate"];

/// Reason why nothing can be fitted.
#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    /// The log cannot be read.
    #[error("{0}")]
    Log(#[from] LogReadError),
    /// The link had no channels.
    #[error("the flight had no radio link with channels; add `[rc_output]` to its scenario")]
    NoLink,
    /// The log has nothing of a topic that the fit needs.
    #[error("the log has nothing of `{topic}`{}: {remedy}", if *is_left_out { ", which `record.leave_out` of its scenario left out" } else { "" })]
    Missing {
        /// The topic.
        topic: Topic,
        /// Whether the scenario has left it out of the log.
        is_left_out: bool,
        /// What to do instead.
        remedy: &'static str,
    },
}

/// The measure of thrust and rates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FrameSource {
    /// The poses that the cameras captured.
    #[default]
    Poses,
    /// The simulated truth.
    Truth,
}

/// A stick's calibration: as configured, and as it was.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Calibration {
    /// Name of the stick.
    pub stick: &'static str,
    /// Value at a travel of 0, and value per unit of travel, as the scenario states: N or rad/s.
    pub stated: [f64; 2],
    /// As fitted; `None` if the stick had too little to say.
    pub fitted: Option<Fit>,
    /// Time in the air that a fit of the stick needs, s; only if the log has less.
    pub needed: Option<f64>,
}

impl Calibration {
    /// Returns whether the flight shows another calibration than the stated one: by more than chance, which is
    /// outside of the 99.9 % interval, and by more than [`MATTERS`] of what the stick commands.
    #[must_use]
    pub fn differs(&self) -> bool {
        self.usable().is_some_and(|fit| {
            let [offset, slope] = self.stated;
            let beyond = |by: f64, error: f64| by.abs() > error.max(MATTERS * slope.abs());
            let [of_offset, of_slope] = fit.certain;
            // A rate of 0 at the middle is no key of a scenario.
            let has_offset = self.stick == STICKS[0];
            beyond(fit.slope - slope, of_slope) || has_offset && beyond(fit.offset - offset, of_offset)
        })
    }

    /// The fit, if the stick explains enough of what was measured.
    #[must_use]
    pub fn usable(&self) -> Option<Fit> {
        self.fitted.filter(|fit| fit.explained >= EXPLAINS)
    }
}

/// The calibration of all sticks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identification {
    /// The source of the measurement.
    pub source: FrameSource,
    /// Mass that accelerations were multiplied with, kg; only with poses.
    pub mass: Option<f64>,
    /// Thrust, roll, pitch and yaw.
    pub sticks: [Calibration; 4],
}

/// Gathers what a log has to say.
#[derive(Debug)]
pub struct Gatherer {
    link: RcLink,
    model: Model,
    mass: f64,
    source: FrameSource,
    recorded: [Recorded; Topic::ALL.len()],
    frames: Vec<Frame>,
    poses: Vec<Pose>,
    truths: Vec<Truth>,
    asked: Vec<Asked>,
}

impl Gatherer {
    /// For a flight of a scenario. `mass` is in kg; the scenario's unless given.
    ///
    /// # Errors
    /// [`IdentifyError::NoLink`].
    pub fn new(scenario: &Scenario, source: FrameSource, mass: Option<f64>) -> Result<Self, IdentifyError> {
        Ok(Self {
            link: scenario.rc_output.clone().ok_or(IdentifyError::NoLink)?,
            model: scenario.model.clone().unwrap_or_default(),
            mass: mass.unwrap_or(scenario.vehicle.mass),
            source,
            recorded: Recorded::of_topics(scenario),
            frames: Vec::new(),
            poses: Vec::new(),
            truths: Vec::new(),
            asked: Vec::new(),
        })
    }

    /// Takes a sample.
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) {
        match (topic, self.source) {
            (Topic::RcFrame, _) => {
                let frame = read::<RcFrame>(bytes);
                let acts_at = seconds(frame.header.stamp_ns) + self.model.radio_latency;
                self.frames.push(Frame::new(&frame, &self.link, acts_at));
            }
            (Topic::PathReference, FrameSource::Poses) => {
                self.asked.push(Asked::new(&read::<PathReference>(bytes)));
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
            FrameSource::Poses => measured::by_poses(&self.poses, &self.asked, self.mass, &history),
            FrameSource::Truth => measured::by_truth(&self.truths, &history),
        };
        Ok(Identification {
            source: self.source,
            mass: (self.source == FrameSource::Poses).then_some(self.mass),
            sticks: [0, 1, 2, 3].map(|stick| self.calibration(stick, &points[stick])),
        })
    }

    /// Refuses a log without a topic that the fit needs.
    fn check_topics(&self) -> Result<(), IdentifyError> {
        let by_truth = "record it, or fit with `--from truth`";
        let needed: &[(Topic, bool, &'static str)] = match self.source {
            FrameSource::Poses => &[
                (Topic::MocapPose, self.poses.is_empty(), by_truth),
                (Topic::PathReference, self.asked.is_empty(), by_truth),
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
            let place = Topic::ALL.iter().position(|&other| other == topic);
            Err(IdentifyError::Missing {
                topic,
                is_left_out: place.is_some_and(|place| self.recorded[place] == Recorded::Nothing),
                remedy,
            })
        })
    }

    fn calibration(&self, stick: usize, points: &[Point]) -> Calibration {
        let cluster = measured::DEPENDENT[stick];
        let fewest = Fit::fewest(cluster);
        let needed = measured::needed(fewest, measured::spacings(self.source)[stick]);
        Calibration {
            stick: STICKS[stick],
            stated: match stick {
                0 => [self.link.thrust_offset, self.link.thrust_slope],
                rate => [0.0, self.link.rate_slope[rate - 1]],
            },
            fitted: Fit::of(points, cluster),
            needed: (points.len() < fewest).then_some(needed),
        }
    }
}

/// Fits the calibration of the link that a log was flown with.
///
/// # Errors
/// [`IdentifyError`].
pub fn identify(log: &Path, source: FrameSource, mass: Option<f64>) -> Result<Identification, IdentifyError> {
    let mut reader = LogReader::open(log)?;
    let mut gatherer = Gatherer::new(&reader.manifest().scenario, source, mass)?;
    while let Some(logged) = reader.next_sample()? {
        gatherer.observe(logged.topic, logged.bytes);
    }
    gatherer.finish()
}

#[cfg(test)]
mod tests;
