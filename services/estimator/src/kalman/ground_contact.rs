//! Touch-down: the ground holds a vehicle that has flown.
//!
//! Nothing measures the ground, and the filter's model has none: it would let a vehicle that stands there sink on, the more
//! the older the captures are, and take the ground's support for a disturbance that lifts it. A law that acts on such a
//! state tilts the vehicle and lifts it off again.
//!
//! Two hypotheses explain a capture. In *free flight* the vehicle goes on from an earlier capture with the velocity and
//! the disturbance that it had there, under the thrust that was sent since. At *rest* it has the pose of that capture.
//! The vehicle stands when all captures since then show it at rest, while free flight would have taken it further down,
//! within the time t, than errors of model and cameras explain:
//!
//! ```text
//!     (p_free − p_captured)·e3 > max(1 cm, 24 σ) + ½ · 1 m/s² · t²
//! ```
//!
//! At 0.3 m/s that takes 40 ms. A vehicle that hovers still stands in both hypotheses, and goes on flying. One that is seen
//! to move is at rest no longer, and the comparison begins again.

use nalgebra::Vector3;
use shared_types::rotation::angle_between;
use shared_types::service::seconds;

use super::commands::CommandHistory;
use super::filter_state::{Pose, PoseNoise};
use super::motion::{NominalState, VehicleModel};

/// Largest motion of a vehicle at rest between two captures, in standard deviations of a capture.
const STILL: f64 = 8.0;
/// Smallest way between the hypotheses, m, and in standard deviations of a capture.
const APART: f64 = 0.01;
const APART_DEVIATIONS: f64 = 24.0;
/// Error of the free flight's acceleration, as of a gust, m/s².
const UNEXPLAINED: f64 = 1.0;
/// Captures at rest after the first, at least.
const CAPTURES: u32 = 2;
/// Change of a height up to which it is repeated, and of another coordinate above which the body has moved, m.
const REPEATED: f64 = 1e-9;
const MOVED: f64 = 1e-6;
/// Longest comparison, s: later the free flight is too uncertain.
const LONGEST: f64 = 1.0;
/// Rise after which a vehicle that stood flies, m.
const RISEN: f64 = 0.05;

/// Vehicle at rest since a capture, beside the same vehicle in free flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Exposure of that capture, ns since the start of the flight.
    pub since_ns: u64,
    /// Its pose.
    pub pose: Pose,
    /// Captures that have shown the vehicle at rest since.
    pub captures: u32,
    /// The vehicle in free flight since then.
    pub free: NominalState,
    /// Time of the free flight, ns since the start of the flight.
    pub free_ns: u64,
}

/// Ground of a flight with phases, as far as the vehicle's motion shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// z of the tracked point where the vehicle last stood before it flew, in {I}, m.
    pub stood_z: f64,
    /// `true` if it has flown since.
    pub has_flown: bool,
    /// The vehicle at rest.
    pub rest: Rest,
}

impl Rest {
    /// Value of [`Rest::captures`] once the comparison is over.
    const OVER: u32 = u32::MAX;

    /// Begins at a capture, with the estimate there. The free flight begins at the captured place: a false place is no
    /// sign of the ground.
    #[must_use]
    pub fn new(time_ns: u64, pose: &Pose, estimate: &NominalState) -> Self {
        let mut free = *estimate;
        free.position_world += pose.position_world - estimate.tracked_point();
        Self {
            since_ns: time_ns,
            pose: *pose,
            captures: 0,
            free,
            free_ns: time_ns,
        }
    }

    /// Returns whether a pose is the one since which the vehicle has been at rest.
    #[must_use]
    pub fn holds(&self, pose: &Pose, noise: PoseNoise) -> bool {
        let way = (pose.position_world - self.pose.position_world).norm();
        let turn = angle_between(&self.pose.world_from_body, &pose.world_from_body);
        way <= STILL * noise.position.sqrt() && turn <= STILL * noise.attitude.sqrt()
    }

    /// Returns whether a pose has the height of the first one although it has moved: cameras have noise in every coordinate, so
    /// such a height is an old one, and says nothing of a descent.
    fn repeats_height(&self, pose: &Pose) -> bool {
        let [dx, dy, dz] = (pose.position_world - self.pose.position_world).abs().into();
        dz <= REPEATED && dx.max(dy) > MOVED
    }

    /// Ends the comparison: it begins again with the next capture that is used.
    pub fn end(&mut self) {
        self.captures = Self::OVER;
    }

    /// Returns whether the comparison is over: the vehicle was seen to move, or what it rests on is not known any more.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.captures == Self::OVER
    }

    /// Lets the free flight go on to a later time, ns.
    pub fn fly(&mut self, time_ns: u64, vehicle: &VehicleModel, history: &CommandHistory) {
        if !self.is_over() {
            self.free = vehicle.flown(&self.free, history, self.free_ns, time_ns);
            self.free_ns = time_ns;
        }
    }

    /// Compares a capture of the time to which the free flight has gone. Returns whether the vehicle stands.
    pub fn observe(&mut self, pose: &Pose, noise: PoseNoise) -> bool {
        let time = seconds(self.free_ns.saturating_sub(self.since_ns));
        if self.is_over() || time > LONGEST || !self.holds(pose, noise) {
            self.end();
            return false;
        }
        if self.repeats_height(pose) {
            return false;
        }
        self.captures += 1;
        let below = self.free.tracked_point().z - pose.position_world.z;
        let explained = APART.max(APART_DEVIATIONS * noise.position.sqrt()) + 0.5 * UNEXPLAINED * time * time;
        self.captures >= CAPTURES && below > explained
    }
}

impl Ground {
    /// Makes the ground of a vehicle that starts at a pose, and stands there or is in the air.
    #[must_use]
    pub fn new(time_ns: u64, estimate: &NominalState, stands: bool) -> Self {
        let pose = Pose {
            position_world: estimate.tracked_point(),
            world_from_body: estimate.world_from_body,
        };
        Self {
            stood_z: pose.position_world.z,
            has_flown: !stands,
            rest: Rest::new(time_ns, &pose, estimate),
        }
    }

    /// Takes a captured place into account, in {I}, m.
    pub fn observe_rise(&mut self, position_world: &Vector3<f64>) {
        if !self.has_flown && position_world.z < self.stood_z - RISEN {
            self.has_flown = true;
            self.rest.end();
        }
    }
}
