//! Camera model with noise, trigger jitter, lost frames, occlusions markers and swapped markers.
//!
//! ```text
//! te = t − j                                                   j ~ U(0, jitter)
//! p_seen = p(te) + Δp + εp                                     εp ~ N(0, σp² I)
//! R_seen = R(te) exp S(Δθ) exp S(εθ)                           εθ ~ N(0, σθ² I)
//! p(te) = p − j ṗ + ½ j² p̈ + O(j³)      R(te) = R exp S(−j ω) + O(j²)
//! ```
//!
//! p position of the body's origin in {I}, m; R body to inertial; t time of the tick and te of the exposure, s; Δp, Δθ
//! offset during a marker swap, otherwise zero. Velocities are not measured. The body is not tracked in a frame that is
//! lost or exposed during an occlusion, or while it is outside of the volume that the cameras see. Errors of different frames
//! are independent, and so are a frame's jitter, loss and noise. The model has no state.

use nalgebra::{Matrix3, Vector3};
use shared_types::Now;
use shared_types::noise::{Noise, Stream};
use shared_types::rotation::{exp, to_row_major};
use shared_types::samples::MocapPose;
use shared_types::service::{nanoseconds, seconds};
use vehicle_model::rigid_body::Motion;

/// Imperfect cameras over the course of a flight.
#[derive(Clone, Debug)]
pub struct Imperfect {
    position_deviation: f64,
    attitude_deviation: f64,
    jitter: f64,
    jitter_stamped: bool,
    frame_loss: f64,
    volume: Option<scenario::Volume>,
    occlusions: Vec<Window>,
    swaps: Vec<Swap>,
    noise: Noise,
    jitters: Noise,
    losses: Noise,
}

/// Interval from `begin_ns` (included) to `end_ns` (excluded).
#[derive(Clone, Copy, Debug)]
struct Window {
    begin_ns: u64,
    end_ns: u64,
}

/// Offset during a marker swap.
#[derive(Clone, Copy, Debug)]
struct Swap {
    window: Window,
    /// Δp in {I}, m.
    position: Vector3<f64>,
    /// exp S(Δθ).
    rotation: Matrix3<f64>,
}

/// Pose of the body at a time.
#[derive(Clone, Copy, Debug)]
struct Pose {
    position_world: Vector3<f64>,
    world_from_body: Matrix3<f64>,
}

impl Imperfect {
    /// Makes the cameras of a scenario.
    #[must_use]
    pub fn new(config: &scenario::Cameras, seed: u64) -> Self {
        let occlusions = config.occlusion.iter();
        let swaps = config.marker_swap.iter();
        Self {
            position_deviation: config.position_deviation,
            attitude_deviation: config.attitude_deviation,
            jitter: config.jitter,
            jitter_stamped: config.jitter_stamped,
            frame_loss: config.frame_loss,
            volume: config.volume,
            occlusions: occlusions
                .map(|occlusion| Window::new(occlusion.at, occlusion.lasts))
                .collect(),
            swaps: swaps.map(Swap::new).collect(),
            noise: Noise::new(seed, Stream::CameraNoise),
            jitters: Noise::new(seed, Stream::CameraJitter),
            losses: Noise::new(seed, Stream::CameraLoss),
        }
    }

    /// Writes the capture of a tick from the origin's motion and its acceleration (`acceleration_world`, in {I}, m/s²).
    /// `pose` must be zeroed except for its header.
    pub fn capture(
        &mut self,
        origin: &Motion,
        acceleration_world: &Vector3<f64>,
        now: &Now,
        pose: &mut MocapPose,
    ) {
        let early_ns = self.exposed_earlier_ns(now);
        let exposure_ns = now.time_ns - early_ns;
        pose.capture_time_ns = if self.jitter_stamped {
            exposure_ns
        } else {
            now.time_ns
        };
        if self.is_lost(now.tick) || self.occlusions.iter().any(|window| window.contains(exposure_ns)) {
            return;
        }
        let exposed = Pose::before(origin, acceleration_world, seconds(early_ns));
        let is_within = |volume: &scenario::Volume| volume.contains(&exposed.position_world.into());
        if !self.volume.as_ref().is_none_or(is_within) {
            return;
        }
        let seen = self.with_noise(self.with_swaps(exposed, exposure_ns), now.tick);
        pose.position_world = seen.position_world.into();
        pose.world_from_body = to_row_major(&seen.world_from_body);
        pose.tracked = true.into();
    }

    /// Returns j in whole ns, so that stamp and pose are of the same time. The exposure is never before time 0.
    fn exposed_earlier_ns(&mut self, now: &Now) -> u64 {
        if self.jitter > 0.0 {
            nanoseconds(self.jitter * self.jitters.at(now.tick).uniform()).min(now.time_ns)
        } else {
            0
        }
    }

    fn is_lost(&mut self, tick: u64) -> bool {
        self.frame_loss > 0.0 && self.losses.at(tick).uniform() < self.frame_loss
    }

    fn with_swaps(&self, pose: Pose, exposure_ns: u64) -> Pose {
        let swaps = self.swaps.iter();
        swaps
            .filter(|swap| swap.window.contains(exposure_ns))
            .fold(pose, |pose, swap| Pose {
                position_world: pose.position_world + swap.position,
                world_from_body: pose.world_from_body * swap.rotation,
            })
    }

    fn with_noise(&mut self, pose: Pose, tick: u64) -> Pose {
        let mut draws = self.noise.at(tick);
        let position_error = draws.normal3() * self.position_deviation;
        let attitude_error = draws.normal3() * self.attitude_deviation;
        Pose {
            position_world: pose.position_world + position_error,
            world_from_body: pose.world_from_body * exp(&attitude_error),
        }
    }
}

impl Pose {
    /// Returns the pose `early` s before `motion`.
    fn before(motion: &Motion, acceleration_world: &Vector3<f64>, early: f64) -> Self {
        Self {
            position_world: motion.position_world - motion.velocity_world * early
                + acceleration_world * (0.5 * early * early),
            world_from_body: motion.world_from_body * exp(&(motion.angular_velocity_body * -early)),
        }
    }
}

impl Window {
    fn new(at: f64, lasts: f64) -> Self {
        Self {
            begin_ns: nanoseconds(at),
            end_ns: nanoseconds(at + lasts),
        }
    }

    fn contains(&self, time_ns: u64) -> bool {
        (self.begin_ns..self.end_ns).contains(&time_ns)
    }
}

impl Swap {
    fn new(config: &scenario::MarkerSwap) -> Self {
        Self {
            window: Window::new(config.at, config.lasts),
            position: config.position.into(),
            rotation: exp(&config.rotation.into()),
        }
    }
}
