//! Sensors of flight outdoors: what the inertial measurement unit, the satellite receiver, the barometer and the magnetometer
//! measure of the motion of the body's origin.
//!
//! The inertial measurement unit measures means over the time since its last sample, from the differences between steps of the
//! plant, so that a touch-down, which stops the vehicle at once, is in its specific force. All others measure what is so at their tick; their latency is that of their edge.

use nalgebra::{Matrix3, Vector3};
use scenario::{GRAVITY, Scenario};
use sensor_models::barometer::Surroundings;
use sensor_models::imu::TriadParameters;
use sensor_models::{
    Barometer, BarometerParameters, BarometerState, Gnss, GnssParameters, GnssState, Imu, ImuParameters,
    ImuState, Magnetometer, MagnetometerParameters, TrueMotion,
};
use shared_types::geodesy::LocalFrame;
use shared_types::gnss::FixKind;
use shared_types::rotation::{from_row_major, to_row_major};
use shared_types::samples::{BaroAltitude, GnssBaseline, GnssFix, ImuSample};
use shared_types::service::seconds;
use shared_types::wiring::PlantOutputs;
use shared_types::{Now, Topic};
use vehicle_model::rigid_body::Motion;

/// Thrust above which rotors turn, N.
const TURNING: f64 = 1e-3;

/// Number of steps of a digital output over half its range: 16 bits.
const STEPS: f64 = 32_768.0;

shared_types::sample! {
    /// State of the sensors between steps of the plant.
    pub struct SensorState {
        /// State of the inertial measurement unit.
        pub imu: ImuState,
        /// State of the satellite receiver.
        pub gnss: GnssState,
        /// State of the barometer.
        pub barometer: BarometerState,
        /// Velocity of the body's origin in {I} at the last step, m/s.
        pub velocity_world: [f64; 3],
        /// Attitude at the last step, row-major.
        pub world_from_body: [f64; 9],
        /// Angular velocity in {B} at the last step, rad/s.
        pub angular_velocity_body: [f64; 3],
        /// Integrals of rate (rad) and specific force (m/s) in {B} since the last sample.
        pub sum: [f64; 6],
        /// Time over which they extend, s.
        pub span: f64,
    }
}

/// True state of the vehicle at a tick.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    /// Motion of the body's origin.
    pub motion: Motion,
    /// T, N.
    pub thrust: f64,
    /// Wind in {I}, m/s.
    pub wind_world: Vector3<f64>,
}

/// Change of what the receiver solves, from a time on.
#[derive(Clone, Copy, Debug)]
struct Change {
    from_ns: u64,
    kind: Option<FixKind>,
}

/// Drift of the fixes from `from_ns` (included) to `until_ns` (excluded).
#[derive(Clone, Copy, Debug)]
struct Spoofing {
    from_ns: u64,
    until_ns: u64,
    /// In {I}, m/s.
    velocity_world: Vector3<f64>,
}

/// Sensors of a flight.
#[derive(Clone, Debug)]
pub struct Sensors {
    imu: Imu,
    gnss: Gnss,
    barometer: Barometer,
    magnetometer: Magnetometer,
    frame: LocalFrame,
    kind: Option<FixKind>,
    /// Building inside of which no satellite is visible.
    building: Option<scenario::Volume>,
    changes: Vec<Change>,
    spoofing: Vec<Spoofing>,
    /// Frequency of the rotors at which they hold the vehicle, Hz.
    rotor_frequency: f64,
    /// Thrust that holds the vehicle, N.
    hover_thrust: f64,
    /// Largest thrust, N.
    largest_thrust: f64,
    /// z of the ground in {I}, m.
    ground: f64,
    /// Motion at the last step; its position is not used.
    last: Motion,
    sum: [Vector3<f64>; 2],
    /// s.
    span: f64,
}

impl Sensors {
    /// Makes the sensors of a checked scenario; `None` if it states none.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Option<Box<Self>> {
        let sensors = scenario.sensors.as_ref()?;
        let schedule = scenario.schedule().ok()?;
        let period = |topic| seconds(schedule.time_ns(schedule.topic_rate(topic).period));
        let time_ns = |time| schedule.time_ns(scenario.tick_of(time));
        let seed = scenario.seed;
        let datum = scenario.datum_or_default();
        let hover_thrust = scenario.vehicle.mass * GRAVITY;
        let actuators = scenario.vehicle.actuators.as_ref();
        Some(Box::new(Self {
            imu: Imu::new(&imu_parameters(&sensors.imu), seed, period(Topic::ImuSample)),
            gnss: Gnss::new(
                &GnssParameters {
                    errors: sensors.gnss.errors(),
                    antenna_body: sensors.gnss.antenna.into(),
                    baseline_body: sensors.gnss.baseline.map(Vector3::from),
                    // The latency is that of the edge.
                    latency: [0.0; 2],
                },
                seed,
                period(Topic::GnssFix),
            ),
            barometer: Barometer::new(
                &barometer_parameters(&sensors.barometer),
                seed,
                period(Topic::BaroAltitude),
            ),
            magnetometer: Magnetometer::new(
                &MagnetometerParameters {
                    field_world: datum.field_world().into(),
                    white: sensors.magnetometer.white,
                    hard_iron_deviation: sensors.magnetometer.hard_iron,
                    soft_iron_deviation: sensors.magnetometer.soft_iron,
                    current_body: sensors.magnetometer.current.into(),
                    resolution: sensors.magnetometer.resolution,
                },
                seed,
            ),
            frame: datum.frame(),
            kind: sensors.gnss.kind.kind(),
            building: sensors.gnss.building,
            changes: sensors
                .gnss
                .change
                .iter()
                .map(|change| Change {
                    from_ns: time_ns(change.at),
                    kind: change.kind.kind(),
                })
                .collect(),
            spoofing: sensors
                .gnss
                .spoofing
                .iter()
                .map(|spoofing| Spoofing {
                    from_ns: time_ns(spoofing.at),
                    until_ns: time_ns(spoofing.at + spoofing.lasts),
                    velocity_world: spoofing.velocity.into(),
                })
                .collect(),
            rotor_frequency: sensors.imu.rotor_frequency,
            hover_thrust,
            largest_thrust: actuators.map_or(2.0 * hover_thrust, |actuators| actuators.thrust_max),
            ground: scenario.vehicle.initial.position[2],
            last: Motion {
                position_world: Vector3::zeros(),
                world_from_body: Matrix3::identity(),
                velocity_world: Vector3::zeros(),
                angular_velocity_body: Vector3::zeros(),
            },
            sum: [Vector3::zeros(); 2],
            span: 0.0,
        }))
    }

    /// Measures at a step of the plant, and writes the samples that are due.
    pub fn measure(&mut self, truth: &Truth, now: &Now, outputs: &mut PlantOutputs<'_>) {
        if now.elapsed_ns > 0 {
            self.integrate(&truth.motion, now.elapsed());
        }
        self.last = truth.motion;
        if let Some(sample) = outputs.imu.due() {
            self.write_imu(truth, now, sample);
        }
        if let Some(sample) = outputs.fix.due() {
            self.write_fix(truth, now, sample);
        }
        if let Some(sample) = outputs.baseline.due() {
            self.write_baseline(truth, now, sample);
        }
        if let Some(sample) = outputs.altitude.due() {
            self.write_altitude(truth, now, sample);
        }
        if let Some(sample) = outputs.field.due() {
            let throttle = (truth.thrust / self.largest_thrust).clamp(0.0, 1.0);
            let field = self
                .magnetometer
                .sample(now.tick, &truth.motion.world_from_body, throttle);
            sample.measured_ns = now.time_ns;
            sample.field_body = field.into();
            sample.measured = true.into();
        }
    }

    /// Adds a step of `h` s to `motion`: with the mean motion over it, whose attitude is right to second order in the turn.
    fn integrate(&mut self, motion: &Motion, h: f64) {
        let last = &self.last;
        let mean = TrueMotion {
            position_world: motion.position_world,
            velocity_world: motion.velocity_world,
            acceleration_world: (motion.velocity_world - last.velocity_world) / h,
            world_from_body: (motion.world_from_body + last.world_from_body) * 0.5,
            angular_velocity_body: (motion.angular_velocity_body + last.angular_velocity_body) * 0.5,
            angular_acceleration_body: (motion.angular_velocity_body - last.angular_velocity_body) / h,
        };
        let [rate, force] = &mut self.sum;
        *rate += mean.angular_velocity_body * h;
        *force += self.imu.specific_force(&mean) * h;
        self.span += h;
    }

    fn write_imu(&mut self, truth: &Truth, now: &Now, sample: &mut ImuSample) {
        // The first sample has no time before it: it is of a vehicle at rest.
        let [rate, force] = if self.span > 0.0 {
            self.sum.map(|sum| sum / self.span)
        } else {
            let motion = TrueMotion {
                world_from_body: truth.motion.world_from_body,
                ..TrueMotion::AT_REST
            };
            [Vector3::zeros(), self.imu.specific_force(&motion)]
        };
        (self.sum, self.span) = ([Vector3::zeros(); 2], 0.0);
        let frequency = if truth.thrust > TURNING {
            self.rotor_frequency * (truth.thrust / self.hover_thrust).sqrt()
        } else {
            0.0
        };
        let measured = self.imu.measured(now.tick, &rate, &force, frequency);
        sample.measured_ns = now.time_ns;
        sample.angular_velocity_body = measured.angular_velocity_body.into();
        sample.specific_force_body = measured.specific_force_body.into();
        sample.measured = true.into();
        sample.clipped = measured.is_clipped.into();
    }

    /// Returns what the receiver solves.
    fn solved(&self, truth: &Truth, now: &Now) -> Option<FixKind> {
        let newest = self.changes.iter().rfind(|change| change.from_ns <= now.time_ns);
        let is_inside = |building: scenario::Volume| building.contains(&truth.motion.position_world.into());
        newest
            .map_or(self.kind, |change| change.kind)
            .filter(|_| !self.building.is_some_and(is_inside))
    }

    fn write_baseline(&mut self, truth: &Truth, now: &Now, sample: &mut GnssBaseline) {
        let motion = true_motion(&truth.motion);
        let kind = self.solved(truth, now);
        let Some(baseline) = kind.and_then(|kind| self.gnss.baseline(now.tick, &motion, kind)) else {
            return;
        };
        sample.valid_ns = now.time_ns;
        sample.baseline_ned = self
            .frame
            .world_from_ned()
            .tr_mul(&baseline.baseline_world)
            .into();
        // The horizontal deviations are the same in all directions.
        sample.accuracies_ned = baseline.accuracies.into();
        sample.fixed = baseline.is_fixed.into();
        sample.measured = true.into();
    }

    fn write_fix(&mut self, truth: &Truth, now: &Now, sample: &mut GnssFix) {
        let solved = self.solved(truth, now);
        // The slow errors are those of the satellites: they go on where none is seen.
        let kind = solved.unwrap_or(FixKind::RtkFixed);
        let fix = self.gnss.sample(now.tick, &true_motion(&truth.motion), kind);
        if solved.is_none() {
            return;
        }
        let mut position_world = fix.position_world;
        let mut velocity_world = fix.velocity_world;
        let drifting = self
            .spoofing
            .iter()
            .find(|drift| (drift.from_ns..drift.until_ns).contains(&now.time_ns));
        if let Some(drift) = drifting {
            position_world += drift.velocity_world * seconds(now.time_ns - drift.from_ns);
            velocity_world += drift.velocity_world;
        }
        let place = self.frame.to_geodetic(&position_world);
        sample.valid_ns = now.time_ns;
        sample.latitude = place.latitude;
        sample.longitude = place.longitude;
        sample.height = place.height;
        sample.velocity_ned = self.frame.world_from_ned().tr_mul(&velocity_world).into();
        sample.horizontal_accuracy = fix.horizontal_accuracy;
        sample.vertical_accuracy = fix.vertical_accuracy;
        sample.speed_accuracy = fix.speed_accuracy;
        sample.kind = kind as u8;
        sample.measured = true.into();
    }

    fn write_altitude(&mut self, truth: &Truth, now: &Now, sample: &mut BaroAltitude) {
        let z = truth.motion.position_world.z;
        let surroundings = Surroundings {
            altitude: -z,
            above_ground: self.ground - z,
            airspeed: (truth.motion.velocity_world - truth.wind_world).norm(),
            rotors_turn: truth.thrust > TURNING,
        };
        sample.altitude = self.barometer.sample(now.tick, &surroundings);
        sample.measured_ns = now.time_ns;
        sample.measured = true.into();
    }

    /// Returns the state.
    #[must_use]
    pub fn save(&self) -> SensorState {
        let flat =
            |[first, second]: &[Vector3<f64>; 2]| [first.x, first.y, first.z, second.x, second.y, second.z];
        SensorState {
            imu: self.imu.save(),
            gnss: self.gnss.save(),
            barometer: self.barometer.save(),
            velocity_world: self.last.velocity_world.into(),
            world_from_body: to_row_major(&self.last.world_from_body),
            angular_velocity_body: self.last.angular_velocity_body.into(),
            sum: flat(&self.sum),
            span: self.span,
        }
    }

    /// Restores a state.
    pub fn restore(&mut self, state: &SensorState) {
        let pair = |[a, b, c, d, e, f]: [f64; 6]| [Vector3::new(a, b, c), Vector3::new(d, e, f)];
        self.imu.restore(&state.imu);
        self.gnss.restore(&state.gnss);
        self.barometer.restore(&state.barometer);
        self.last.velocity_world = state.velocity_world.into();
        self.last.world_from_body = from_row_major(&state.world_from_body);
        self.last.angular_velocity_body = state.angular_velocity_body.into();
        (self.sum, self.span) = (pair(state.sum), state.span);
    }
}

/// Returns a motion without its derivative, which instantaneous measurements do not need.
fn true_motion(motion: &Motion) -> TrueMotion {
    TrueMotion {
        position_world: motion.position_world,
        velocity_world: motion.velocity_world,
        acceleration_world: Vector3::zeros(),
        world_from_body: motion.world_from_body,
        angular_velocity_body: motion.angular_velocity_body,
        angular_acceleration_body: Vector3::zeros(),
    }
}

fn imu_parameters(imu: &scenario::Imu) -> ImuParameters {
    ImuParameters {
        gyroscope: TriadParameters {
            noise_density: imu.gyroscope_noise,
            bias_deviation: imu.gyroscope_bias,
            bias_walk: imu.gyroscope_walk,
            scale_deviation: imu.gyroscope_scale,
            range: imu.gyroscope_range,
            resolution: imu.gyroscope_range / STEPS,
        },
        accelerometer: TriadParameters {
            noise_density: imu.accelerometer_noise,
            bias_deviation: imu.accelerometer_bias,
            bias_walk: imu.accelerometer_walk,
            scale_deviation: imu.accelerometer_scale,
            range: imu.accelerometer_range,
            resolution: imu.accelerometer_range / STEPS,
        },
        gyroscope_sensitivity: imu.gyroscope_sensitivity,
        lever_arm_body: imu.lever_arm.into(),
        vibration: imu.vibration,
    }
}

fn barometer_parameters(barometer: &scenario::Barometer) -> BarometerParameters {
    BarometerParameters {
        white: barometer.white,
        slow: barometer.slow,
        slow_time: barometer.slow_time,
        airspeed_factor: barometer.airspeed_factor,
        ground_effect: barometer.ground_effect,
        ground_effect_altitude: barometer.ground_effect_altitude,
        resolution: barometer.resolution,
    }
}
