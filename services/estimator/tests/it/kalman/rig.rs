//! Small simulator of the rig, independent of the plant: fine Runge–Kutta steps, captures, frames.

use std::collections::VecDeque;

use estimator::Estimate;
use estimator::kalman::error_state::{
    ATTITUDE, DISTURBANCE, ErrorVector, MARKER_OFFSET, POSITION, RATE_BIAS, VELOCITY,
};
use estimator::kalman::filter_state::FilterState;
use estimator::kalman::{KalmanFilter, Outcome};
use nalgebra::{Matrix3, Vector3};
use scenario::{Curve, GRAVITY, Hover, Kalman, Model, Path, RcLink, Scenario, Vehicle};
use shared_types::noise::{Noise, Stream};
use shared_types::rotation::log;
use shared_types::rotation::{exp, orthonormalized, skew, to_row_major};
use shared_types::samples::{MocapPose, RcFrame};
use zerocopy::FromZeros;

/// Steps of the simulator a tick.
const STEPS_A_TICK: u32 = 2;
const TICK: f64 = 1e-3;
pub const TICK_NS: u64 = 1_000_000;
const CAPTURE_LATENCY: u64 = 5;
pub const CAPTURE_PERIOD: u64 = 10;

/// The true state of the vehicle at a tick.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    pub position_world: Vector3<f64>,
    pub velocity_world: Vector3<f64>,
    pub world_from_body: Matrix3<f64>,
    pub thrust: f64,
    /// Body rates without their bias.
    pub rates_body: Vector3<f64>,
    pub rate_bias_body: Vector3<f64>,
    pub disturbance_world: Vector3<f64>,
    pub marker_offset_body: Vector3<f64>,
    turbulence_world: Vector3<f64>,
}

/// Command of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    pub thrust: f64,
    pub rates_body: Vector3<f64>,
}

impl Asked {
    pub const NOTHING: Self = Self {
        thrust: 0.0,
        rates_body: Vector3::new(0.0, 0.0, 0.0),
    };

    /// As the paper's radio link can carry it.
    pub fn quantized(self) -> Self {
        let link = RcLink::default();
        let steps = f64::from(1 << (link.resolution - 1));
        let channel = |value: f64| libm::round(value.clamp(-1.0, 1.0) * steps) / steps;
        let slope = Vector3::from(link.rate_slope);
        Self {
            thrust: (link.thrust_offset
                + link.thrust_slope * channel((self.thrust - link.thrust_offset) / link.thrust_slope))
            .max(0.0),
            rates_body: self
                .rates_body
                .component_div(&slope)
                .map(channel)
                .component_mul(&slope),
        }
    }
}

/// Truth of the simulated rig; the filter uses its model instead.
#[derive(Clone, Debug)]
pub struct World {
    pub seed: u64,
    pub mass: f64,
    /// From this tick on the mass is another, kg.
    pub mass_step: Option<(u64, f64)>,
    pub thrust_lag: f64,
    pub rate_lag: f64,
    pub radio_latency: u64,
    pub frame_period: u64,
    pub thrust_factor: f64,
    pub rate_factor: f64,
    /// Turbulence of 1 s correlation: standard deviation of each component, m/s².
    pub turbulence: f64,
    /// `true` if the noise of the filter's model drives the vehicle.
    pub process_noise: bool,
    /// `true` if captures have the noise that the filter expects.
    pub capture_noise: bool,
    /// Lost captures, by the tick of exposure.
    pub hidden: std::ops::Range<u64>,
    /// Ticks at which a frame does not come to the filter; the vehicle receives it.
    pub silence: std::ops::Range<u64>,
    /// Wrong captures, by the tick of exposure.
    pub swapped: std::ops::Range<u64>,
    /// Way by which the position is wrong then, m.
    pub swapped_position: Vector3<f64>,
    /// Rotation by which the attitude is wrong then.
    pub swapped_rotation: Vector3<f64>,
}

impl World {
    /// The filter's model, without noise.
    pub fn perfect() -> Self {
        Self {
            seed: 1,
            mass: 0.2,
            mass_step: None,
            thrust_lag: 0.03,
            rate_lag: 0.02,
            radio_latency: 5,
            frame_period: 22,
            thrust_factor: 1.0,
            rate_factor: 1.0,
            turbulence: 0.0,
            process_noise: false,
            capture_noise: false,
            hidden: 0..0,
            silence: 0..0,
            swapped: 0..0,
            swapped_position: Vector3::new(0.0, 0.1, 0.05),
            swapped_rotation: Vector3::new(0.0, 0.0, 1.5),
        }
    }

    /// Noisy captures in slightly turbulent air.
    pub fn laboratory(seed: u64) -> Self {
        Self {
            seed,
            turbulence: 0.05,
            capture_noise: true,
            ..Self::perfect()
        }
    }
}

/// World, cameras, radio and filter together, tick by tick.
pub struct Rig {
    pub filter: KalmanFilter,
    pub tick: u64,
    pub world: World,
    /// The truth at every tick so far.
    pub truths: Vec<Truth>,
    kalman: Kalman,
    commands: VecDeque<(u64, Asked)>,
    acting: Asked,
    captures: VecDeque<MocapPose>,
    pending: Option<RcFrame>,
    stamps_are_wrong: bool,
    noises: [Noise; 3],
}

/// Events of a tick.
pub struct RigTick {
    /// The frame that the filter received.
    pub heard: Option<RcFrame>,
    /// The capture that arrived.
    pub seen: Option<MocapPose>,
    /// Its outcome.
    pub outcome: Option<Outcome>,
    /// The estimate when a frame was due.
    pub told: Option<Estimate>,
}

pub fn scenario(model: &Model, kalman: &Kalman) -> Scenario {
    let path = Path::new(Curve::Hover(Hover { position: [0.0; 3] }));
    let mut scenario = Scenario::new(10.0, Vehicle::new(0.2, [1e-3; 3]), path);
    let schedule = &mut scenario.schedule;
    for (name, period) in [
        ("mocap/pose", 0.01),
        ("vehicle/state", 0.022),
        ("path_generator", 0.022),
        ("controller", 0.022),
        ("rc_output", 0.022),
    ] {
        schedule.period.insert(name.to_owned(), period);
    }
    schedule
        .latency
        .insert("mocap/pose -> estimator".to_owned(), 0.005);
    schedule.latency.insert("rc/frame -> plant".to_owned(), 0.005);
    scenario.model = Some(model.clone());
    scenario.estimator = Some(scenario::Estimator {
        kalman: kalman.clone(),
    });
    scenario
}

impl Rig {
    /// A rig that hovers level at the origin.
    pub fn new(world: World, kalman: &Kalman, model: &Model) -> Self {
        let hover = Asked {
            thrust: world.mass * GRAVITY,
            ..Asked::NOTHING
        };
        let truth = Truth {
            position_world: Vector3::zeros(),
            velocity_world: Vector3::zeros(),
            world_from_body: Matrix3::identity(),
            thrust: hover.thrust,
            rates_body: Vector3::zeros(),
            rate_bias_body: Vector3::zeros(),
            disturbance_world: Vector3::zeros(),
            marker_offset_body: Vector3::zeros(),
            turbulence_world: Vector3::zeros(),
        };
        Self {
            filter: KalmanFilter::new(&scenario(model, kalman), kalman).unwrap(),
            tick: 0,
            truths: vec![truth],
            kalman: kalman.clone(),
            commands: VecDeque::new(),
            acting: hover,
            captures: VecDeque::new(),
            pending: None,
            stamps_are_wrong: false,
            noises: [Stream::CameraNoise, Stream::Turbulence, Stream::Fan]
                .map(|stream| Noise::new(world.seed, stream)),
            world,
        }
    }

    /// Starts from another state.
    pub fn starting(mut self, change: impl FnOnce(&mut Truth)) -> Self {
        change(&mut self.truths[0]);
        self
    }

    pub fn now_ns(&self) -> u64 {
        self.tick * TICK_NS
    }

    pub fn truth_at(&self, time_ns: u64) -> &Truth {
        &self.truths[usize::try_from(time_ns / TICK_NS).unwrap()]
    }

    /// Makes one tick: captures and frames arrive, the estimate is made if due, `pilot` sends a frame for it (s at
    /// which it acts, estimate), and the rig moves on.
    pub fn step(&mut self, pilot: impl FnOnce(f64, Option<&Estimate>) -> Asked) -> RigTick {
        let now_ns = self.now_ns();
        if self.tick.is_multiple_of(CAPTURE_PERIOD) {
            let capture = self.capture();
            self.captures.push_back(capture);
        }
        let pending = self.pending.take();
        let heard = pending.filter(|_| !self.world.silence.contains(&self.tick));
        if let Some(frame) = &heard {
            self.filter.add_frame(now_ns, frame);
        }
        let has_arrived =
            |capture: &mut MocapPose| capture.capture_time_ns + CAPTURE_LATENCY * TICK_NS == now_ns;
        let mut seen = self.captures.pop_front_if(has_arrived);
        if let Some(capture) = seen.as_mut().filter(|_| self.stamps_are_wrong) {
            capture.capture_time_ns = 0;
        }
        let outcome = seen
            .as_ref()
            .map(|capture| self.filter.add_capture(now_ns, capture));
        let mut told = None;
        if self.tick.is_multiple_of(self.world.frame_period) {
            told = self.filter.estimate(now_ns);
            let acts_at = self.tick + self.world.radio_latency;
            let asked = pilot(acts_at as f64 * TICK, told.as_ref());
            self.pending = Some(frame(now_ns, asked));
            self.commands.push_back((acts_at, asked));
        }
        self.advance();
        RigTick {
            heard,
            seen,
            outcome,
            told,
        }
    }

    /// As [`Self::step`], with cameras whose stamps are wrong.
    pub fn step_with_wrong_stamps(&mut self, pilot: impl FnOnce(f64, Option<&Estimate>) -> Asked) -> RigTick {
        self.stamps_are_wrong = true;
        self.step(pilot)
    }

    fn capture(&mut self) -> MocapPose {
        let mut pose = MocapPose {
            capture_time_ns: self.now_ns(),
            ..MocapPose::new_zeroed()
        };
        if self.world.hidden.contains(&self.tick) {
            return pose;
        }
        let truth = self.truths[self.truths.len() - 1];
        let mut position = truth.tracked_point();
        let mut attitude = truth.world_from_body;
        if self.world.capture_noise {
            let mut draws = self.noises[0].at(self.tick);
            position += draws.normal3() * self.kalman.position_deviation;
            attitude *= exp(&(draws.normal3() * self.kalman.attitude_deviation));
        }
        if self.world.swapped.contains(&self.tick) {
            position += self.world.swapped_position;
            attitude *= exp(&self.world.swapped_rotation);
        }
        pose.position_world = position.into();
        pose.world_from_body = to_row_major(&attitude);
        pose.tracked = true.into();
        pose
    }

    fn advance(&mut self) {
        if self
            .commands
            .front()
            .is_some_and(|(acts_at, _)| *acts_at <= self.tick)
        {
            self.acting = self.commands.pop_front().unwrap().1;
        }
        if let Some((at, mass)) = self.world.mass_step
            && self.tick >= at
        {
            self.world.mass = mass;
        }
        let h = TICK / f64::from(STEPS_A_TICK);
        let mut truth = self.truths[self.truths.len() - 1];
        for part in 0..STEPS_A_TICK {
            truth = self.runge_kutta(&truth, h);
            if self.world.process_noise {
                self.diffuse(
                    &mut truth,
                    h,
                    self.tick * u64::from(STEPS_A_TICK) + u64::from(part),
                );
            }
        }
        truth.world_from_body = orthonormalized(&truth.world_from_body);
        let kick = self.noises[1].at(self.tick).normal3();
        let deviation = self.world.turbulence;
        truth.turbulence_world =
            truth.turbulence_world * (1.0 - TICK) + kick * (deviation * (2.0 * TICK).sqrt());
        self.truths.push(truth);
        self.tick += 1;
    }

    /// White noise in the places and of the densities of the filter's model.
    fn diffuse(&mut self, truth: &mut Truth, h: f64, at: u64) {
        let mut draws = self.noises[2].at(at);
        let mut kick = |density: f64| draws.normal3() * (density * h).sqrt();
        truth.velocity_world += kick(self.kalman.acceleration_noise);
        truth.world_from_body *= exp(&kick(self.kalman.rate_noise));
        truth.rate_bias_body += kick(self.kalman.rate_bias_drift);
        truth.disturbance_world += kick(self.kalman.disturbance_drift);
        truth.marker_offset_body += kick(self.kalman.marker_offset_drift);
    }

    fn runge_kutta(&self, start: &Truth, h: f64) -> Truth {
        let k1 = self.derivative(start);
        let k2 = self.derivative(&k1.moved(start, 0.5 * h));
        let k3 = self.derivative(&k2.moved(start, 0.5 * h));
        let k4 = self.derivative(&k3.moved(start, h));
        let mut end = k1.moved(start, h / 6.0);
        for (k, weight) in [(k2, h / 3.0), (k3, h / 3.0), (k4, h / 6.0)] {
            end = k.moved(&end, weight);
        }
        end
    }

    fn derivative(&self, truth: &Truth) -> Truth {
        let world = &self.world;
        let specific_thrust = truth.thrust * world.thrust_factor / world.mass;
        Truth {
            position_world: truth.velocity_world,
            velocity_world: Vector3::new(0.0, 0.0, GRAVITY)
                - truth.world_from_body.column(2) * specific_thrust
                + truth.disturbance_world
                + truth.turbulence_world,
            world_from_body: truth.world_from_body
                * skew(&(truth.rates_body * world.rate_factor + truth.rate_bias_body)),
            thrust: (self.acting.thrust - truth.thrust) / world.thrust_lag,
            rates_body: (self.acting.rates_body - truth.rates_body) / world.rate_lag,
            rate_bias_body: Vector3::zeros(),
            disturbance_world: Vector3::zeros(),
            marker_offset_body: Vector3::zeros(),
            turbulence_world: Vector3::zeros(),
        }
    }
}

impl Truth {
    /// Returns `start` moved along this derivative.
    fn moved(&self, start: &Self, h: f64) -> Self {
        Self {
            position_world: start.position_world + self.position_world * h,
            velocity_world: start.velocity_world + self.velocity_world * h,
            world_from_body: start.world_from_body + self.world_from_body * h,
            thrust: start.thrust + self.thrust * h,
            rates_body: start.rates_body + self.rates_body * h,
            ..*start
        }
    }

    /// Returns the point that the cameras track.
    fn tracked_point(&self) -> Vector3<f64> {
        self.position_world + self.world_from_body * self.marker_offset_body
    }

    /// Returns the error of a state: true minus nominal.
    pub fn error_of(&self, state: &FilterState) -> ErrorVector {
        let nominal = &state.nominal;
        let mut error = ErrorVector::zeros();
        for (row, part) in [
            (POSITION, self.position_world - nominal.position_world),
            (VELOCITY, self.velocity_world - nominal.velocity_world),
            (
                ATTITUDE,
                log(&(nominal.world_from_body.transpose() * self.world_from_body)),
            ),
            (RATE_BIAS, self.rate_bias_body - nominal.rate_bias_body),
            (DISTURBANCE, self.disturbance_world - nominal.disturbance_world),
            (
                MARKER_OFFSET,
                self.marker_offset_body - nominal.marker_offset_body,
            ),
        ] {
            error.fixed_rows_mut::<3>(row).copy_from(&part);
        }
        error
    }

    /// Returns the errors of an estimate: position (m), velocity (m/s), attitude (rad).
    pub fn distances_to(&self, told: &Estimate) -> [f64; 3] {
        let attitude = shared_types::rotation::from_row_major(&told.world_from_body);
        let velocity_world = attitude * Vector3::from(told.velocity_body);
        [
            (self.tracked_point() - Vector3::from(told.position_world)).norm(),
            (self.velocity_world - velocity_world).norm(),
            log(&(attitude.transpose() * self.world_from_body)).norm(),
        ]
    }
}

fn frame(stamp_ns: u64, asked: Asked) -> RcFrame {
    let mut frame = RcFrame {
        thrust: asked.thrust,
        rates_body: asked.rates_body.into(),
        mode: RcFrame::MODE_RATES,
        ..RcFrame::new_zeroed()
    };
    frame.header.stamp_ns = stamp_ns;
    frame
}

/// Flies the paper's tilted eight (27) by the estimate: feedback on position, velocity and attitude.
pub fn pilot_on_the_eight(time: f64, told: Option<&Estimate>) -> Asked {
    let Some(told) = told else {
        return Asked {
            thrust: 0.2 * GRAVITY,
            ..Asked::NOTHING
        };
    };
    let (size, w) = (1.2, 0.6);
    let (sine, cosine) = libm::sincos(w * time);
    let (sine2, cosine2) = libm::sincos(2.0 * w * time);
    let tilt = shared_types::rotation::paper_rx(std::f64::consts::PI / 20.0);
    let path = tilt * Vector3::new(0.5 * size * sine2, size * sine, 0.0);
    let path_dot = tilt * Vector3::new(size * w * cosine2, size * w * cosine, 0.0);
    let path_ddot = tilt * Vector3::new(-2.0 * size * w * w * sine2, -size * w * w * sine, 0.0);

    let r = shared_types::rotation::from_row_major(&told.world_from_body);
    let velocity = r * Vector3::from(told.velocity_body);
    let acceleration =
        path_ddot + (path - Vector3::from(told.position_world)) * 9.0 + (path_dot - velocity) * 5.0;
    let lift_body = r.tr_mul(&(Vector3::new(0.0, 0.0, GRAVITY) - acceleration));
    let yaw = libm::atan2(r[(1, 0)], r[(0, 0)]);
    let mut rates_body = Vector3::z().cross(&lift_body.normalize()) * 10.0;
    rates_body.z -= 2.0 * yaw;
    Asked {
        thrust: 0.2 * lift_body.z,
        rates_body,
    }
    .quantized()
}

/// Tumbles about all axes, always differently.
pub fn restless_pilot(seed: u64) -> impl Fn(f64, Option<&Estimate>) -> Asked {
    move |time, _| {
        let wave = |frequency: f64, phase: u64| libm::sin(frequency * time + (seed * 7 + phase) as f64);
        Asked {
            thrust: 2.0 + wave(5.0, 1),
            rates_body: Vector3::new(6.0 * wave(3.1, 2), 6.0 * wave(4.3, 3), 3.0 * wave(2.3, 4)),
        }
    }
}

/// Three independent standard normal numbers for the beginning of a flight.
pub fn normal3(seed: u64, number: u64) -> Vector3<f64> {
    Noise::new(seed, Stream::RadioLoss).at(number).normal3()
}
