//! A flight outdoors and what its sensors measure, independent of the plant: a tilted eight in gusts after 20 s at rest.
//!
//! `ekf2/` includes this file: both filters get the same samples.
#![allow(dead_code, reason = "each of the two uses a part of it")]

use std::collections::VecDeque;

use inertial_navigation::{
    Altitude, Baseline, Field, Fix, ImuSample, InertialFilter, Parameters, Pose, Source,
};
use nalgebra::{Matrix3, Vector3};
use sensor_models::barometer::Surroundings;
use sensor_models::{
    Barometer, BarometerParameters, Gnss, GnssParameters, Imu, ImuParameters, Magnetometer,
    MagnetometerParameters, TrueMotion,
};
use shared_types::GRAVITY;
use shared_types::gnss::FixKind;
use shared_types::noise::{Noise, Stream};
use shared_types::rotation::{exp, log};

/// Period of the inertial measurement unit, s and ns.
pub const H: f64 = 0.004;
pub const H_NS: u64 = 4_000_000;
/// Samples of it for each field, altitude and fix: 50, 25 and 10 Hz.
const FIELD_EVERY: u64 = 5;
const ALTITUDE_EVERY: u64 = 10;
const FIX_EVERY: u64 = 25;
/// Samples of it for each pose, 83 Hz, and until a pose arrives.
const POSE_EVERY: u64 = 3;
pub const POSE_LATE: u64 = 2;

/// Times at which the motors start, and at which the vehicle takes off, s.
const MOTORS: f64 = 19.0;
const TAKE_OFF: f64 = 20.0;

/// Drag of a vehicle over its mass, 1/s.
const DRAG: f64 = 0.3;

/// What a filter receives.
#[derive(Clone, Copy, Debug)]
pub enum Event {
    Imu(ImuSample),
    Fix(Fix),
    Field(Field),
    Altitude(Altitude),
    Pose(Pose),
    Baseline(Baseline),
    /// The motors turn from now on.
    Motors,
}

/// What is flown, and by which sensors.
#[derive(Clone, Debug)]
pub struct Flight {
    pub seed: u64,
    /// Duration, s.
    pub duration: f64,
    pub kind: FixKind,
    pub imu: ImuParameters,
    pub gnss: GnssParameters,
    pub barometer: BarometerParameters,
    pub magnetometer: MagnetometerParameters,
    /// Standard deviations of the poses of cameras, m and rad; `None` without cameras.
    pub cameras: Option<[f64; 2]>,
    /// Angular rate along the eight, rad/s.
    pub path_rate: f64,
    /// Standard deviation of each component of the gusts, m/s.
    pub gusts: f64,
}

impl Flight {
    /// Sensors with white and slow noise, biases and hard iron: all that the filter models.
    pub fn modelled(seed: u64, kind: FixKind) -> Self {
        let mut imu = ImuParameters {
            gyroscope_sensitivity: 0.0,
            vibration: [0.0; 2],
            ..ImuParameters::default()
        };
        (imu.gyroscope.scale_deviation, imu.accelerometer.scale_deviation) = (0.0, 0.0);
        Self {
            seed,
            duration: 110.0,
            kind,
            imu,
            gnss: GnssParameters::default(),
            barometer: BarometerParameters {
                airspeed_factor: 0.0,
                ground_effect: 0.0,
                ..BarometerParameters::default()
            },
            magnetometer: MagnetometerParameters {
                soft_iron_deviation: 0.0,
                current_body: Vector3::zeros(),
                resolution: 1e-4,
                ..MagnetometerParameters::default()
            },
            cameras: None,
            path_rate: 0.9,
            gusts: 1.0,
        }
    }

    /// Sensors without any error, and fixes that are late.
    pub fn perfect(latency: f64) -> Self {
        let mut flight = Self::modelled(1, FixKind::RtkFixed);
        for triad in [&mut flight.imu.gyroscope, &mut flight.imu.accelerometer] {
            (triad.noise_density, triad.bias_deviation, triad.bias_walk) = (0.0, 0.0, 0.0);
            triad.resolution = 0.0;
        }
        for errors in &mut flight.gnss.errors {
            (errors.position_white, errors.position_slow) = (0.0, 0.0);
            (errors.velocity_white, errors.velocity_slow) = (0.0, 0.0);
        }
        flight.gnss.latency = [latency; 2];
        (
            flight.barometer.white,
            flight.barometer.slow,
            flight.barometer.resolution,
        ) = (0.0, 0.0, 0.0);
        let magnetometer = &mut flight.magnetometer;
        (
            magnetometer.white,
            magnetometer.hard_iron_deviation,
            magnetometer.resolution,
        ) = (0.0, 0.0, 0.0);
        flight
    }

    /// Sensors with all errors of their models.
    pub fn with_all_errors(seed: u64, kind: FixKind) -> Self {
        Self {
            imu: ImuParameters::default(),
            barometer: BarometerParameters::default(),
            magnetometer: MagnetometerParameters::default(),
            ..Self::modelled(seed, kind)
        }
    }

    /// With an inertial measurement unit whose white noise is `factor` times as large.
    pub fn shaken(mut self, factor: f64) -> Self {
        self.imu.gyroscope.noise_density *= factor;
        self.imu.accelerometer.noise_density *= factor;
        self
    }

    /// With cameras that have the errors of which the filter knows by default.
    pub fn seen(mut self) -> Self {
        self.cameras = Some(Parameters::default().pose_deviations);
        self
    }

    /// With a second antenna, 1 m in front of the first.
    pub fn with_two_antennas(mut self) -> Self {
        self.gnss.baseline_body = Some(Vector3::x());
        self
    }

    /// Returns the parameters of a filter that fits these sensors.
    pub fn parameters(&self) -> Parameters {
        let mut parameters = Parameters {
            altitude_ground_effect: self.barometer.ground_effect,
            baseline_body: self.gnss.baseline_body,
            ..Parameters::default()
        };
        for (assumed, triad) in [
            (&mut parameters.gyroscope, &self.imu.gyroscope),
            (&mut parameters.accelerometer, &self.imu.accelerometer),
        ] {
            // Rounding is white noise too.
            let rounding = triad.resolution * triad.resolution / 12.0 * H;
            assumed.noise_density = (triad.noise_density * triad.noise_density + rounding).sqrt();
        }
        let MagnetometerParameters {
            white,
            hard_iron_deviation,
            soft_iron_deviation,
            current_body,
            ..
        } = self.magnetometer;
        // Soft iron is a bias at a constant attitude. A fifth of it changes with the attitude in these flights, which is no white
        // noise: it counts by its time of about a second, at 50 Hz.
        let soft = soft_iron_deviation * self.magnetometer.field_world.norm();
        let changing = 0.2 * soft * (1.0 + 2.0 * 50.0_f64).sqrt();
        parameters.field_white = (white * white + changing * changing).sqrt().max(1e-3);
        parameters.field_bias_deviation = (hard_iron_deviation * hard_iron_deviation + soft * soft)
            .sqrt()
            .max(1e-3);
        parameters.field_bias_walk = 1e-5;
        parameters.field_arming_deviation = 0.5 * current_body.norm();
        parameters.altitude_deviation = 0.5;
        parameters
    }

    /// Returns all truths, and all events in the order of their arrival.
    pub fn flown(&self) -> (Vec<TrueMotion>, Vec<Event>) {
        let truths = self.truths();
        let mut imu = Imu::new(&self.imu, self.seed, H);
        let mut gnss = Gnss::new(&self.gnss, self.seed, FIX_EVERY as f64 * H);
        let mut barometer = Barometer::new(&self.barometer, self.seed, ALTITUDE_EVERY as f64 * H);
        let mut magnetometer = Magnetometer::new(&self.magnetometer, self.seed);
        let mut camera_noise = Noise::new(self.seed, Stream::CameraNoise);
        let (mut events, mut late) = (Vec::new(), VecDeque::new());
        for (tick, pair) in (1..).zip(truths.windows(2)) {
            let (truth, time_ns, time) = (&pair[1], tick * H_NS, tick as f64 * H);
            if (time - MOTORS).abs() < 0.5 * H {
                events.push(Event::Motors);
            }
            let motors = time >= MOTORS;
            let sample = imu.sample(tick, &mean_of(&pair[0], truth), 200.0);
            events.push(Event::Imu(ImuSample {
                time_ns,
                rate_body: sample.angular_velocity_body,
                force_body: sample.specific_force_body,
                is_clipped: sample.is_clipped,
            }));
            if tick % FIELD_EVERY == 0 {
                let field_body =
                    magnetometer.sample(tick, &truth.world_from_body, if motors { 0.4 } else { 0.0 });
                events.push(Event::Field(Field { time_ns, field_body }));
            }
            if tick % ALTITUDE_EVERY == 0 {
                let surroundings = Surroundings {
                    altitude: -truth.position_world.z,
                    above_ground: -truth.position_world.z,
                    airspeed: (truth.velocity_world - Vector3::new(0.0, 3.0, 0.0)).norm(),
                    rotors_turn: motors,
                };
                let altitude = barometer.sample(tick, &surroundings);
                events.push(Event::Altitude(Altitude { time_ns, altitude }));
            }
            if let Some([position, attitude]) = self.cameras
                && tick % POSE_EVERY == POSE_LATE
                && tick > POSE_LATE
            {
                let seen = &truths[(tick - POSE_LATE) as usize];
                let mut draws = camera_noise.at(tick);
                events.push(Event::Pose(Pose {
                    time_ns: (tick - POSE_LATE) * H_NS,
                    position_world: Some(seen.position_world + draws.normal3() * position),
                    world_from_body: Some(seen.world_from_body * exp(&(draws.normal3() * attitude))),
                }));
            }
            if tick % FIX_EVERY == 0 {
                let fix = gnss.sample(tick, truth, self.kind);
                let baseline = gnss.baseline(tick, truth, self.kind);
                if let Some(baseline) = baseline.filter(|baseline| baseline.is_fixed) {
                    late.push_back((
                        time + fix.latency,
                        Event::Baseline(Baseline {
                            time_ns,
                            baseline_world: baseline.baseline_world,
                            accuracies: [baseline.accuracies.x, baseline.accuracies.z],
                        }),
                    ));
                }
                late.push_back((
                    time + fix.latency,
                    Event::Fix(Fix {
                        time_ns,
                        kind: fix.kind,
                        position_world: fix.position_world,
                        velocity_world: fix.velocity_world,
                        accuracies: [fix.horizontal_accuracy, fix.vertical_accuracy, fix.speed_accuracy],
                    }),
                ));
            }
            while late
                .front()
                .is_some_and(|(arrival, _)| *arrival <= time + 0.5 * H)
            {
                events.extend(late.pop_front().map(|(_, event)| event));
            }
        }
        (truths, events)
    }

    /// Returns the truth at each multiple of H.
    fn truths(&self) -> Vec<TrueMotion> {
        let count = (self.duration / H) as u64;
        let gusts = self.gusts_over(count);
        let motion = |k: u64| {
            let t = k as f64 * H;
            let place = |s: f64| self.place(s);
            let d = 1e-3;
            let velocity = (place(t - 2.0 * d) - place(t - d) * 8.0 + place(t + d) * 8.0
                - place(t + 2.0 * d))
                / (12.0 * d);
            let d = 4e-3;
            let acceleration = (place(t + d) - place(t) * 2.0 + place(t - d)) / (d * d);
            let drag = (gusts[k as usize] - velocity) * (DRAG * step((t - TAKE_OFF) / 2.0));
            let thrust = acceleration - Vector3::new(0.0, 0.0, GRAVITY) - drag;
            TrueMotion {
                position_world: place(t),
                velocity_world: velocity,
                acceleration_world: acceleration,
                world_from_body: attitude(&-thrust, 0.3),
                ..TrueMotion::AT_REST
            }
        };
        let mut truths: Vec<_> = (0..=count).map(motion).collect();
        for k in 1..truths.len() - 1 {
            let turn = log(&(truths[k - 1].world_from_body.transpose() * truths[k + 1].world_from_body));
            truths[k].angular_velocity_body = turn / (2.0 * H);
        }
        truths
    }

    /// Returns the path: at rest, up, and along a tilted eight that begins slowly.
    fn place(&self, t: f64) -> Vector3<f64> {
        let rise = 1.5 * step((t - TAKE_OFF) / 3.0);
        // The integral of a smooth step of 4 s.
        let s = ((t - TAKE_OFF - 2.0) / 4.0).max(0.0);
        let along = if s < 1.0 {
            s * s * s * s * (2.5 - 3.0 * s + s * s) * 4.0
        } else {
            (s - 0.5) * 4.0
        };
        let phi = self.path_rate * along;
        let (x, y) = (2.0 * libm::sin(phi), 1.0 * libm::sin(2.0 * phi));
        Vector3::new(x, y, -rise - 0.4 * x)
    }

    /// Returns wind and gusts at each tick: 3 m/s along y, and noise with a correlation time of 1 s through a lag of 0.2 s.
    fn gusts_over(&self, count: u64) -> Vec<Vector3<f64>> {
        let mut noise = Noise::new(self.seed, Stream::Gusts);
        let (mut raw, mut smooth) = (Vector3::zeros(), Vector3::zeros());
        let wind = Vector3::new(0.0, 3.0, 0.0);
        (0..=count)
            .map(|tick| {
                raw += noise.at(tick).normal3() * (self.gusts * (2.0 * H).sqrt()) - raw * H;
                smooth += (raw - smooth) * (H / 0.2);
                wind + smooth
            })
            .collect()
    }
}

/// The smooth step from 0 to 1 over [0, 1].
fn step(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
}

/// The attitude with the body's z axis along `down` and this heading.
fn attitude(down: &Vector3<f64>, heading: f64) -> Matrix3<f64> {
    let z = down.normalize();
    let x = Vector3::new(libm::cos(heading), libm::sin(heading), 0.0);
    let y = z.cross(&x).normalize();
    Matrix3::from_columns(&[y.cross(&z), y, z])
}

/// The motion whose rate and acceleration are the means between two truths, at the attitude between them.
fn mean_of(from: &TrueMotion, to: &TrueMotion) -> TrueMotion {
    let turn = log(&(from.world_from_body.transpose() * to.world_from_body));
    TrueMotion {
        acceleration_world: (to.velocity_world - from.velocity_world) / H,
        world_from_body: from.world_from_body * exp(&(turn * 0.5)),
        angular_velocity_body: turn / H,
        ..*from
    }
}

/// Gives an event to a filter; `now_ns` is the time of the newest sample of the inertial measurement unit.
pub fn give(filter: &mut InertialFilter, event: &Event, now_ns: u64) {
    match event {
        Event::Imu(sample) => {
            filter.add_imu(sample);
        }
        Event::Fix(fix) => filter.add_fix(fix),
        Event::Field(field) => filter.add_field(field),
        Event::Altitude(altitude) => filter.add_altitude(altitude),
        Event::Pose(pose) => filter.add_pose(pose),
        Event::Baseline(baseline) => filter.add_baseline(baseline),
        Event::Motors => filter.set_motors(now_ns, true, true),
    }
}

/// Error of an estimate: position (m), velocity (m/s) and attitude (rad).
#[derive(Clone, Copy, Debug)]
pub struct Errors {
    pub position: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub attitude: Vector3<f64>,
}

impl Errors {
    pub fn new(truth: &TrueMotion, position: Vector3<f64>, velocity: Vector3<f64>, r: &Matrix3<f64>) -> Self {
        Self {
            position: truth.position_world - position,
            velocity: truth.velocity_world - velocity,
            attitude: log(&(r.transpose() * truth.world_from_body)),
        }
    }
}

/// Root of the mean square of each error's norm, and of the position about its mean.
#[derive(Clone, Copy, Debug)]
pub struct Figures {
    pub position: f64,
    pub position_about_mean: f64,
    pub velocity: f64,
    pub attitude: f64,
}

impl Figures {
    pub fn new(errors: &[Errors]) -> Self {
        let count = errors.len() as f64;
        let mean = errors.iter().map(|error| error.position).sum::<Vector3<f64>>() / count;
        let root = |square: &dyn Fn(&Errors) -> f64| (errors.iter().map(square).sum::<f64>() / count).sqrt();
        Self {
            position: root(&|error| error.position.norm_squared()),
            position_about_mean: root(&|error| (error.position - mean).norm_squared()),
            velocity: root(&|error| error.velocity.norm_squared()),
            attitude: root(&|error| error.attitude.norm_squared()),
        }
    }
}

/// A filter on a flight.
pub struct Flown {
    pub filter: InertialFilter,
    pub truths: Vec<TrueMotion>,
    /// Errors at each sample of the inertial measurement unit since the alignment, with its tick.
    pub errors: Vec<(u64, Errors)>,
    /// Squared distances of the innovations of each source, the last of each step, with the times of the horizon, ns.
    pub innovations: [Vec<(u64, f64)>; Source::ALL.len()],
}

impl Flown {
    /// Flies with events that `change` may alter or drop.
    pub fn new(flight: &Flight, parameters: &Parameters, mut change: impl FnMut(&mut Event) -> bool) -> Self {
        let (truths, events) = flight.flown();
        let mut flown = Self {
            filter: InertialFilter::new(parameters),
            truths,
            errors: Vec::new(),
            innovations: [const { Vec::new() }; Source::ALL.len()],
        };
        let mut tick = 0;
        for mut event in events {
            if matches!(event, Event::Imu(_)) {
                tick += 1;
            }
            if !change(&mut event) {
                continue;
            }
            let counts = flown.counts();
            give(&mut flown.filter, &event, tick * H_NS);
            if let Event::Imu(_) = event {
                flown.observe(tick, counts);
            }
        }
        flown
    }

    fn counts(&self) -> [u32; Source::ALL.len()] {
        Source::ALL.map(|source| {
            let status = self.filter.source(source);
            status.fused + status.refused
        })
    }

    fn observe(&mut self, tick: u64, before: [u32; Source::ALL.len()]) {
        let after = self.counts();
        for source in Source::ALL {
            let place = source as usize;
            if after[place] > before[place] {
                let status = self.filter.source(source);
                let time_ns = self.filter.horizon().unwrap().time_ns;
                self.innovations[place].push((time_ns, status.squared_distance));
            }
        }
        if let Some(motion) = self.filter.motion() {
            let truth = &self.truths[usize::try_from(tick).unwrap()];
            let errors = Errors::new(
                truth,
                motion.position_world,
                motion.velocity_world,
                &motion.world_from_body,
            );
            self.errors.push((tick, errors));
        }
    }

    /// Figures of the errors from a time on, s.
    pub fn figures(&self, from: f64) -> Figures {
        let errors = self.errors.iter().filter(|(tick, _)| *tick as f64 * H >= from);
        Figures::new(&errors.map(|(_, errors)| *errors).collect::<Vec<_>>())
    }

    /// The largest errors between two times, s: position (m), velocity (m/s), attitude (rad).
    pub fn largest(&self, from: f64, to: f64) -> [f64; 3] {
        let within = self
            .errors
            .iter()
            .filter(|(tick, _)| (from..to).contains(&(*tick as f64 * H)));
        within.fold([0.0; 3], |largest: [f64; 3], (_, errors)| {
            let norms = [
                errors.position.norm(),
                errors.velocity.norm(),
                errors.attitude.norm(),
            ];
            [0, 1, 2].map(|at| largest[at].max(norms[at]))
        })
    }
}

/// All events as they are.
pub fn unchanged(_: &mut Event) -> bool {
    true
}
