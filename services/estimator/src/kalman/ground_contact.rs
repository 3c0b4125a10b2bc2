//! Detection of the touch-down.
//!
//! The ground is neither measured nor part of the filter's model: the prediction of a standing vehicle would sink, the
//! further the older the captures are, and the filter would attribute the support of the ground to a disturbance. A law
//! that uses such a state tilts the vehicle and lifts it off again.
//!
//! Two hypotheses explain a capture. In *free flight* the vehicle continues from an earlier capture with its velocity and
//! disturbance, under the thrust sent since. At *rest* it has the pose of that capture. The vehicle stands if all captures
//! since then agree with rest, while within the time t free flight would have descended further than errors of model and
//! cameras explain:
//!
//! ```text
//!     (p_free − p_captured)·e3 > max(1 cm, 24 σ) + ½ · 1 m/s² · t²
//! ```
//!
//! At 0.3 m/s the detection takes 40 ms. For a hovering vehicle both hypotheses agree, and it counts as flying. When a
//! capture shows a motion, the comparison restarts.

use nalgebra::Vector3;
use shared_types::rotation::angle_between;
use shared_types::service::seconds;

use super::commands::CommandHistory;
use super::filter_state::{Pose, PoseNoise};
use super::motion::{NominalState, VehicleModel};

/// Largest motion of a vehicle at rest between two captures, in standard deviations of a capture.
const STILL: f64 = 8.0;
/// Minimum distance between the hypotheses, m, and in standard deviations of a capture.
const APART: f64 = 0.01;
const APART_DEVIATIONS: f64 = 24.0;
/// Error of the free flight's acceleration, as of a gust, m/s².
const UNEXPLAINED: f64 = 1.0;
/// Minimum number of captures at rest after the first.
const CAPTURES: u32 = 2;
/// Maximum change of a repeated height, and minimum change of another coordinate of a moved body, m.
const REPEATED: f64 = 1e-9;
const MOVED: f64 = 1e-6;
/// Maximum duration of a comparison, s: later the free flight is too uncertain.
const LONGEST: f64 = 1.0;
/// Rise of a vehicle that has taken off, m.
const RISEN: f64 = 0.05;

/// Comparison of rest since a capture with free flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Exposure of that capture, ns since the start of the flight.
    pub since_ns: u64,
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
    /// Value of [`Rest::captures`] when the comparison is over.
    const OVER: u32 = u32::MAX;

    /// Begins at a capture, with the estimate there. The free flight begins at the captured position: a false position is no
    /// evidence of ground contact.
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

    /// Returns whether a pose agrees with rest.
    #[must_use]
    pub fn holds(&self, pose: &Pose, noise: PoseNoise) -> bool {
        let distance = (pose.position_world - self.pose.position_world).norm();
        let turn = angle_between(&self.pose.world_from_body, &pose.world_from_body);
        distance <= STILL * noise.position.sqrt() && turn <= STILL * noise.attitude.sqrt()
    }

    /// Returns whether a pose repeats the height of the first one although the body has moved. Cameras have noise in every
    /// coordinate, so such a height is stale and no evidence against a descent.
    fn repeats_height(&self, pose: &Pose) -> bool {
        let [dx, dy, dz] = (pose.position_world - self.pose.position_world).abs().into();
        dz <= REPEATED && dx.max(dy) > MOVED
    }

    /// Ends the comparison. It restarts with the next used capture.
    pub fn end(&mut self) {
        self.captures = Self::OVER;
    }

    /// Returns whether the comparison is over, because of a motion or of dropped commands.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.captures == Self::OVER
    }

    /// Propagates the free flight to a later time, ns.
    pub fn fly(&mut self, time_ns: u64, vehicle: &VehicleModel, history: &CommandHistory) {
        if !self.is_over() {
            self.free = vehicle.flown(&self.free, history, self.free_ns, time_ns);
            self.free_ns = time_ns;
        }
    }

    /// Compares a capture at the time of the free flight. Returns whether the vehicle stands.
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

    /// Detects the take-off by a captured position, in {I}, m.
    pub fn observe_rise(&mut self, position_world: &Vector3<f64>) {
        if !self.has_flown && position_world.z < self.stood_z - RISEN {
            self.has_flown = true;
            self.rest.end();
        }
    }
}
