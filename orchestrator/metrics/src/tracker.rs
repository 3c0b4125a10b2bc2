//! The vehicle and its path at each tick.
//!
//! The distance from the path is ‖p − pd(γ(t))‖, between the true position and the position of the path at the same time.
//! In a laboratory the truth is unknown: there it is the estimated position at the time of the state, and all output states
//! so.

use scenario::Vector;
use shared_types::samples::{PathReference, VehicleState, VehicleTruth};
use shared_types::{FlightPhase, Schedule, Topic};

use super::path_clock::{Demand, PathClock, carried};
use super::view;
use run_log::{LogReadError, LogReader};

/// The source of the vehicle's position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StateSource {
    /// `vehicle/truth`.
    Truth,
    /// `vehicle/state`, if the truth is unknown.
    Estimate,
}

impl StateSource {
    /// Returns the source in a flight of this schedule.
    #[must_use]
    pub fn of(schedule: &Schedule) -> Self {
        if schedule.simulates_the_world() {
            Self::Truth
        } else {
            Self::Estimate
        }
    }

    /// Returns the topic of the source.
    #[must_use]
    pub fn topic(self) -> Topic {
        match self {
            Self::Truth => Topic::VehicleTruth,
            Self::Estimate => Topic::VehicleState,
        }
    }
}

/// The vehicle at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vehicle {
    /// Tick of the sample.
    pub tick: u64,
    /// Time at which the sample holds, ns since the start of the flight.
    pub time_ns: u64,
    /// p in {I}, m.
    pub position_world: Vector,
    /// R, body to inertial, row-major.
    pub world_from_body: [f64; 9],
    /// v in {B}, m/s.
    pub velocity_body: Vector,
    /// ω in {B}, rad/s.
    pub angular_velocity_body: Vector,
    /// T, N.
    pub thrust: f64,
}

impl From<&VehicleTruth> for Vehicle {
    #[inline]
    fn from(truth: &VehicleTruth) -> Self {
        Self {
            tick: truth.header.tick,
            time_ns: truth.header.stamp_ns,
            position_world: truth.position_world,
            world_from_body: truth.world_from_body,
            velocity_body: truth.velocity_body,
            angular_velocity_body: truth.angular_velocity_body,
            thrust: truth.thrust,
        }
    }
}

impl From<&VehicleState> for Vehicle {
    #[inline]
    fn from(state: &VehicleState) -> Self {
        Self {
            tick: state.header.tick,
            time_ns: state.state_time_ns,
            position_world: state.position_world,
            world_from_body: state.world_from_body,
            velocity_body: state.velocity_body,
            angular_velocity_body: state.angular_velocity_body,
            thrust: state.thrust,
        }
    }
}

impl Vehicle {
    /// Returns the estimated vehicle, if it is tracked: otherwise the sample is old or dead-reckoned.
    #[must_use]
    #[inline]
    pub fn tracked(state: &VehicleState) -> Option<Self> {
        state.tracked.is_set().then(|| state.into())
    }
}

/// The vehicle and the path at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// The vehicle.
    pub vehicle: Vehicle,
    /// The path; `None` before the first reference.
    pub path: Option<Demand>,
    /// Distance from the path, m; `None` before the first reference, and while the vehicle is disarmed or armed on the
    /// ground.
    pub distance: Option<f64>,
}

impl Moment {
    /// Returns the distance while the vehicle flies along the path, m; `None` during take-off and landing.
    #[must_use]
    #[inline]
    pub fn distance_on_path(&self) -> Option<f64> {
        let flies = self.path.is_some_and(|path| path.phase == FlightPhase::Fly);
        self.distance.filter(|_| flies)
    }
}

/// Matches vehicle and path of the same time, given all samples in the order of the log.
///
/// In the log the vehicle precedes the path of its tick. So they are compared at the next sample of the vehicle, or at the
/// end.
#[derive(Clone, Debug)]
pub struct Tracker {
    source: StateSource,
    /// `true` if references have phases; without phases the vehicle follows the path from the start.
    has_phases: bool,
    clock: PathClock,
    /// The newest vehicle; its path is evaluated when the moment is complete.
    newest: Option<Moment>,
}

impl Tracker {
    /// Makes the tracker of a flight of `schedule`, with or without `[flight]`.
    #[must_use]
    pub fn new(schedule: &Schedule, has_phases: bool) -> Self {
        Self {
            source: StateSource::of(schedule),
            has_phases,
            clock: PathClock::default(),
            newest: None,
        }
    }

    /// Returns the source of the vehicle's position.
    #[must_use]
    pub fn source(&self) -> StateSource {
        self.source
    }

    /// Adds a sample. Returns the previous moment if it is complete now.
    #[inline]
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) -> Option<Moment> {
        let vehicle = match (topic, self.source) {
            (Topic::VehicleTruth, StateSource::Truth) => {
                Some(view(bytes, |truth: &VehicleTruth| Vehicle::from(truth)))
            }
            (Topic::VehicleState, StateSource::Estimate) => view(bytes, Vehicle::tracked),
            (Topic::PathReference, _) => {
                view(bytes, |reference| self.observe_reference(reference));
                None
            }
            _ => None,
        };
        let vehicle = vehicle?;
        let whole = self.moment().copied();
        self.turn_to(vehicle);
        whole
    }

    /// Adds a reference.
    #[inline]
    pub fn observe_reference(&mut self, reference: &PathReference) {
        self.clock.observe(reference);
    }

    /// Adds a newer vehicle. Call [`moment`](Self::moment) before: the previous moment is complete then.
    #[inline]
    pub fn turn_to(&mut self, vehicle: impl Into<Vehicle>) {
        self.newest = Some(Moment {
            vehicle: vehicle.into(),
            path: None,
            distance: None,
        });
    }

    /// Returns the newest vehicle with its path, as far as known.
    #[inline]
    pub fn moment(&mut self) -> Option<&Moment> {
        let newest = self.newest.as_mut()?;
        let path = self.clock.at(newest.vehicle.time_ns);
        newest.path = path.map(|path| Demand {
            phase: if self.has_phases {
                path.phase
            } else {
                FlightPhase::Fly
            },
            ..path
        });
        let followed = newest.path.as_ref().filter(|path| is_followed(path.phase));
        newest.distance = followed.and_then(|path| path.distance(&newest.vehicle.position_world));
        Some(newest)
    }

    /// Returns the last moment, after the last sample.
    pub fn last(&mut self) -> Option<Moment> {
        let moment = self.moment().copied();
        self.newest = None;
        moment
    }

    /// Passes every moment of a recorded flight to `sink`.
    ///
    /// # Errors
    /// [`LogReadError`] where the log breaks off; the moments before it have been handed over.
    pub fn follow(&mut self, log: &mut LogReader, mut sink: impl FnMut(&Moment)) -> Result<(), LogReadError> {
        while let Some(logged) = log.next_sample()? {
            if let Some(moment) = self.observe(logged.topic, logged.bytes) {
                sink(&moment);
            }
        }
        self.last().iter().for_each(sink);
        Ok(())
    }
}

/// Returns whether the vehicle follows a reference in a phase.
fn is_followed(phase: FlightPhase) -> bool {
    matches!(phase, FlightPhase::TakeOff | FlightPhase::Fly | FlightPhase::Land)
}

/// Returns the distance of a flying vehicle from the path of the newest reference, m.
#[must_use]
pub fn newest_distance(vehicle: &Vehicle, reference: &PathReference, has_phases: bool) -> Option<f64> {
    let path = carried(reference, vehicle.time_ns);
    let followed = !has_phases || is_followed(path.phase);
    path.distance(&vehicle.position_world).filter(|_| followed)
}

#[cfg(test)]
impl Moment {
    /// An upright vehicle at rest, 1 m above the ground, so far from its path (m).
    pub(crate) fn hovering(time_ns: u64, distance: Option<f64>, phase: FlightPhase) -> Self {
        Self {
            vehicle: Vehicle {
                tick: 0,
                time_ns,
                position_world: [0.0, 0.0, -1.0],
                world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
                velocity_body: [0.0; 3],
                angular_velocity_body: [0.0; 3],
                thrust: 2.0,
            },
            path: Some(Demand {
                position_world: [0.0; 3],
                gamma: 0.0,
                yaw: 0.0,
                phase,
            }),
            distance,
        }
    }
}
