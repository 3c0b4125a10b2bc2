//! The poses and frames of a log, and the filter over them.

use std::path::Path;

use estimator::kalman::{KalmanFilter, Outcome};
use metrics::read;
use run_log::LogReader;
use scenario::{Kalman, Model, Scenario};
use shared_types::samples::{MocapPose, RcFrame};
use shared_types::service::header_of;
use shared_types::{ServiceId, Topic};

use crate::IdentifyError;

/// Captures and frames with which a flight has enough to say: those of ten seconds of slow ones.
const ENOUGH: usize = 200;

/// What the filter believes.
#[derive(Clone, Debug, PartialEq)]
pub struct Believed {
    /// The vehicle and its links.
    pub model: Model,
    /// The weights.
    pub kalman: Kalman,
}

/// A sample as the estimator received it.
enum Arrival {
    Frame(RcFrame),
    Pose(MocapPose),
}

/// The captures and frames of a flight in the order of their arrival at the estimator.
pub struct Recording {
    scenario: Scenario,
    believed: Believed,
    /// Of poses and of frames, ns.
    latencies_ns: [u64; 2],
    arrivals: Vec<(u64, Arrival)>,
}

/// A filter after the whole recording.
pub struct Filtered {
    /// The filter.
    pub filter: KalmanFilter,
    /// Sum of the squared Mahalanobis distances of the captures; a refused one counts as the filter's gate.
    pub squared_distances: f64,
}

impl Recording {
    /// Makes an empty recording of a flight of a scenario.
    ///
    /// # Errors
    /// [`IdentifyError`] if the scenario has no filter.
    pub fn new(scenario: &Scenario) -> Result<Self, IdentifyError> {
        let estimator = scenario.estimator.as_ref().ok_or(IdentifyError::NoFilter)?;
        let schedule = scenario
            .schedule()
            .map_err(|mut problems| IdentifyError::Scenario(problems.swap_remove(0)))?;
        let latency_ns = |input| schedule.time_ns(schedule.latency(ServiceId::Estimator, input));
        Ok(Self {
            believed: Believed {
                model: scenario.model.clone().unwrap_or_default(),
                kalman: estimator.kalman.clone(),
            },
            latencies_ns: [0, 1].map(latency_ns),
            scenario: scenario.clone(),
            arrivals: Vec::new(),
        })
    }

    /// Reads a whole log.
    ///
    /// # Errors
    /// [`IdentifyError`], also if the log breaks off or is damaged.
    pub fn read(log: &Path) -> Result<Self, IdentifyError> {
        let mut reader = LogReader::open(log)?;
        let mut recording = Self::new(&reader.manifest().scenario)?;
        while let Some(logged) = reader.next_sample()? {
            recording.observe(logged.topic, logged.bytes);
        }
        recording.complete()
    }

    /// Takes a sample.
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) {
        let [poses_late, frames_late] = self.latencies_ns;
        let (late, arrival) = match topic {
            Topic::MocapPose => (poses_late, Arrival::Pose(read(bytes))),
            Topic::RcFrame => (frames_late, Arrival::Frame(read(bytes))),
            _ => return,
        };
        self.arrivals
            .push((header_of(bytes).stamp_ns.saturating_add(late), arrival));
    }

    /// Returns the recording in the order of arrival.
    ///
    /// # Errors
    /// [`IdentifyError::TooShort`].
    pub fn complete(mut self) -> Result<Self, IdentifyError> {
        // A step hears frames before it sees poses.
        self.arrivals
            .sort_by_key(|(at_ns, arrival)| (*at_ns, matches!(arrival, Arrival::Pose(_))));
        let captures = self.poses().filter(|pose| pose.tracked.is_set()).count();
        let frames = self.arrivals.len() - self.poses().count();
        if captures < ENOUGH || frames < ENOUGH {
            return Err(IdentifyError::TooShort { captures, frames });
        }
        Ok(self)
    }

    /// Returns what the filter of the flight believed.
    #[must_use]
    pub fn believed(&self) -> Believed {
        self.believed.clone()
    }

    /// Returns the captures.
    pub fn poses(&self) -> impl Iterator<Item = &MocapPose> {
        self.arrivals.iter().filter_map(|(_, arrival)| match arrival {
            Arrival::Pose(pose) => Some(pose),
            Arrival::Frame(_) => None,
        })
    }

    /// Runs a filter with other beliefs over the recording.
    ///
    /// # Errors
    /// [`IdentifyError::Scenario`] if more frames are under way than a filter remembers.
    pub fn filtered(&self, believed: &Believed) -> Result<Filtered, IdentifyError> {
        let mut scenario = self.scenario.clone();
        scenario.model = Some(believed.model.clone());
        let mut filter = KalmanFilter::new(&scenario, &believed.kalman).map_err(IdentifyError::Scenario)?;
        let mut squared_distances = 0.0;
        for (at_ns, arrival) in &self.arrivals {
            match arrival {
                Arrival::Frame(frame) => filter.hear(*at_ns, frame),
                Arrival::Pose(pose) => {
                    squared_distances += match filter.see(*at_ns, pose) {
                        Outcome::Used(whitened) => whitened.norm_squared(),
                        Outcome::Refused => believed.kalman.gate,
                        Outcome::Started | Outcome::Ignored => 0.0,
                    };
                }
            }
        }
        Ok(Filtered {
            filter,
            squared_distances,
        })
    }
}
