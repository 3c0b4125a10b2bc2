//! The poses and frames of a log, and the filter over them.

use std::path::Path;

use estimator::kalman::filter_state::FilterState;
use estimator::kalman::{KalmanFilter, Outcome};
use metrics::read;
use nalgebra::{SMatrix, SVector};
use run_log::LogReader;
use scenario::{Kalman, Model, Scenario};
use shared_types::samples::{MocapPose, RcFrame};
use shared_types::service::{header_of, nanoseconds, seconds};
use shared_types::{ServiceId, Topic};
use statistics::quantile;

use super::IdentifyError;
use crate::lateness;
use crate::rehearsal::Rehearsal;

/// Minimum number of captures and of frames: those of ten seconds at slow rates.
const ENOUGH: usize = 200;

/// Minimum time between the first and the last of them, ns: that of a flight of twenty seconds.
const LONG_ENOUGH_NS: u64 = 19_500_000_000;

/// Parameters of the filter.
#[derive(Clone, Debug, PartialEq)]
pub struct FilterSettings {
    /// Model of the vehicle and its links.
    pub model: Model,
    /// Noise and gates.
    pub kalman: Kalman,
}

/// Innovation of a capture.
#[derive(Clone, Copy, Debug)]
pub struct Innovation {
    /// Whitened innovation of position and attitude, of unit covariance if the filter is consistent.
    pub whitened: SVector<f64, 6>,
    /// Logarithm of the determinant of its covariance.
    pub log_determinant: f64,
}

/// A sample as the estimator received it.
enum Arrival {
    Frame(RcFrame),
    Pose(MocapPose),
}

/// The captures and frames of a flight in the order of their arrival at the estimator.
pub struct Recording {
    scenario: Scenario,
    settings: FilterSettings,
    /// Latencies of poses and of frames, ns.
    latencies_ns: [u64; 2],
    arrivals: Vec<(u64, Arrival)>,
    /// `true` if the machine was late in the flight.
    pub is_late: bool,
}

/// The filter after the whole recording.
pub struct Filtered {
    pub filter: KalmanFilter,
    /// Sum of the squared Mahalanobis distances of the captures; a refused capture counts with the filter's gate.
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
            settings: FilterSettings {
                model: scenario.model.clone().unwrap_or_default(),
                kalman: estimator.kalman.clone(),
            },
            latencies_ns: [0, 1].map(latency_ns),
            scenario: scenario.clone(),
            arrivals: Vec::new(),
            is_late: false,
        })
    }

    /// Reads a whole log.
    ///
    /// # Errors
    /// [`IdentifyError`], also if the log breaks off or is damaged.
    pub fn read(log: &Path) -> Result<Self, IdentifyError> {
        let mut reader = LogReader::open(log)?;
        let mut recording = Self::new(&reader.manifest().scenario)?;
        recording.is_late = lateness::warning(log).is_some();
        while let Some(logged) = reader.next_sample()? {
            recording.observe(logged.topic, logged.bytes);
        }
        recording.complete()
    }

    /// Records a sample.
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
        // A step of the estimator processes frames before poses.
        self.arrivals
            .sort_by_key(|(at_ns, arrival)| (*at_ns, matches!(arrival, Arrival::Pose(_))));
        let (captures, frames) = (self.captures(), self.frames());
        let [from_ns, to_ns] = self.span_ns();
        if captures < ENOUGH || frames < ENOUGH || to_ns - from_ns < LONG_ENOUGH_NS {
            return Err(IdentifyError::TooShort { captures, frames });
        }
        Ok(self)
    }

    /// Returns the filter settings of the flight.
    #[must_use]
    pub fn stated_settings(&self) -> FilterSettings {
        self.settings.clone()
    }

    /// Returns the captures.
    pub fn poses(&self) -> impl Iterator<Item = &MocapPose> {
        self.arrivals.iter().filter_map(|(_, arrival)| match arrival {
            Arrival::Pose(pose) => Some(pose),
            Arrival::Frame(_) => None,
        })
    }

    /// Returns the number of captures that show the vehicle.
    #[must_use]
    pub fn captures(&self) -> usize {
        self.poses().filter(|pose| pose.tracked.is_set()).count()
    }

    /// Returns the median of the time from a capture to its arrival, s; 0 without a capture that shows the vehicle.
    #[must_use]
    pub fn capture_age(&self) -> f64 {
        let ages = self.arrivals.iter().filter_map(|(at_ns, arrival)| match arrival {
            Arrival::Pose(pose) if pose.tracked.is_set() => {
                Some(seconds(at_ns.saturating_sub(pose.capture_time_ns)))
            }
            _ => None,
        });
        quantile::median_of(ages).unwrap_or(0.0)
    }

    /// Returns what replaced a laboratory.
    #[must_use]
    pub fn rehearsal(&self) -> Option<Rehearsal> {
        Rehearsal::of(&self.scenario)
    }

    /// Returns the number of frames.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.arrivals.len() - self.poses().count()
    }

    /// Returns the time of the first arrival and that of the last one, ns.
    #[must_use]
    pub fn span_ns(&self) -> [u64; 2] {
        [self.arrivals.first(), self.arrivals.last()].map(|arrival| arrival.map_or(0, |(at_ns, _)| *at_ns))
    }

    /// Runs a filter over the arrivals between two times. Returns for each capture that shows the vehicle its arrival and its
    /// innovation, which is `None` if the filter starts with the capture or refuses it.
    ///
    /// # Errors
    /// [`IdentifyError::Scenario`] if more frames are in flight than the filter can store.
    pub fn innovations(
        &self,
        settings: &FilterSettings,
        from_ns: u64,
        to_ns: u64,
    ) -> Result<Vec<(u64, Option<Innovation>)>, IdentifyError> {
        let (mut filter, later_ns) = self.filter(settings)?;
        let from = self.arrivals.partition_point(|(at_ns, _)| *at_ns < from_ns);
        let arrivals = self.arrivals[from..].iter();
        let mut innovations = Vec::new();
        for (at_ns, arrival) in arrivals.take_while(|(at_ns, _)| *at_ns < to_ns) {
            match arrival {
                Arrival::Frame(frame) => filter.add_frame(*at_ns, &stamped_later(frame, later_ns)),
                Arrival::Pose(pose) if pose.tracked.is_set() => {
                    let innovation = match filter.add_capture(*at_ns, pose) {
                        Outcome::Used(whitened) => Some(Innovation {
                            whitened,
                            log_determinant: log_determinant(&filter, &settings.kalman),
                        }),
                        Outcome::Refused | Outcome::Started | Outcome::Ignored => None,
                    };
                    innovations.push((*at_ns, innovation));
                }
                Arrival::Pose(_) => {}
            }
        }
        Ok(innovations)
    }

    /// Returns a filter with these settings, and the time to add to the stamps of its frames, ns: a scenario's latency is a whole
    /// number of ticks, that of a radio need not be.
    fn filter(&self, settings: &FilterSettings) -> Result<(KalmanFilter, u64), IdentifyError> {
        let mut scenario = self.scenario.clone();
        let mut model = settings.model.clone();
        let latency_ns = nanoseconds(model.radio_latency);
        let rest_ns = latency_ns % nanoseconds(scenario.schedule.tick);
        model.radio_latency = seconds(latency_ns - rest_ns);
        scenario.model = Some(model);
        let filter = KalmanFilter::new(&scenario, &settings.kalman).map_err(IdentifyError::Scenario)?;
        Ok((filter, rest_ns))
    }

    /// Runs a filter with other settings over the recording.
    ///
    /// # Errors
    /// [`IdentifyError::Scenario`] if more frames are in flight than the filter can store.
    pub fn filtered(&self, settings: &FilterSettings) -> Result<Filtered, IdentifyError> {
        let (mut filter, later_ns) = self.filter(settings)?;
        let mut squared_distances = 0.0;
        for (at_ns, arrival) in &self.arrivals {
            match arrival {
                Arrival::Frame(frame) => filter.add_frame(*at_ns, &stamped_later(frame, later_ns)),
                Arrival::Pose(pose) => {
                    squared_distances += match filter.add_capture(*at_ns, pose) {
                        Outcome::Used(whitened) => whitened.norm_squared(),
                        Outcome::Refused => settings.kalman.gate,
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

/// Returns the logarithm of the determinant of the covariance Z of the last innovation. After its correction the pose of the
/// state has the covariance V − V Z⁻¹ V, where V is that of the captures.
fn log_determinant(filter: &KalmanFilter, kalman: &Kalman) -> f64 {
    let variances =
        [kalman.position_deviation, kalman.attitude_deviation].map(|deviation| deviation * deviation);
    let noise = SVector::from_fn(|component: usize, _| variances[component / 3]);
    let corrected = filter
        .state()
        .map_or_else(SMatrix::zeros, FilterState::pose_covariance);
    let explained: SMatrix<f64, 6, 6> = SMatrix::from_diagonal(&noise) - corrected;
    let determinant = explained.determinant().max(f64::MIN_POSITIVE);
    2.0 * noise.map(libm::log).sum() - libm::log(determinant)
}

fn stamped_later(frame: &RcFrame, by_ns: u64) -> RcFrame {
    let mut frame = *frame;
    frame.header.stamp_ns += by_ns;
    frame
}
