//! Step function of the estimator of flight outdoors: inertial navigation, with the frames already sent for what it predicts.
//!
//! [`InertialFilter`] estimates position, velocity and attitude at the newest sample of the inertial measurement unit. Thrust
//! follows the frames with the lag of the model, and what it and gravity do not explain of the measured specific force is
//! a push, low-passed:
//!
//! ```text
//!     y = R (a_m − b_a) + (T̂/m) R e3        ḋ = (y − d)/τ        v̇ = g e3 − (T̂/m) R e3 + d
//! ```
//!
//! With T̂, d and the measured rates the state is predicted to the time at which a frame sent now takes effect.
//!
//! Failure policy, besides that of the filter (`inertial_navigation::filter`):
//! * an impossible sample is refused and counted, and so is one from the future;
//! * a state counts as tracked once fixes or positions of poses have been fused for [`healthy_for`](scenario::Navigation::healthy_for)
//!   without a break of a second, in which poses and baselines, if there are any, were fused too, and a stated baseline
//!   does not contradict the field by 1.4 rad: else the heading may be wrong; then
//!   as long as the last one is at most [`coast`](scenario::Navigation::coast) old, and samples of the inertial measurement unit
//!   arrive. It coasts while they are missing for more than a second. A vehicle at rest whose poses or baselines are refused for half
//!   a second has to be healthy again;
//! * once tracked, a correction of the position by more than 5 cm (a better kind of fixes, the first fix after a silence, a source
//!   that is accepted again) is no step of the published one, which follows over [`ramp`](scenario::Navigation::ramp), and by at
//!   most 1 m/s; and so with the velocity, above 0.1 m/s and by at most 1 m/s². After a silence, or when the position is more than
//!   0.2 m behind, the state coasts until 3 cm are left: who asks where a vehicle was found gets the answer at the end.

use inertial_navigation::error_state::POSITION;
use inertial_navigation::parameters::InertialNoise;
use inertial_navigation::{
    Altitude, Baseline, Correction, Field, Fix, ImuSample as Measured, InertialFilter, InertialState,
    Parameters, Pose, Source, SourceStatus,
};
use nalgebra::Vector3;
use scenario::{Datum, Imu, Key, Model, Navigation, Problem, Scenario};
use shared_types::flight_phase::airborne_thrust;
use shared_types::geodesy::{Geodetic, LocalFrame};
use shared_types::gnss::FixKind;
use shared_types::input_validator::{GateState, InputValidator, LARGEST, Validity};
use shared_types::rotation::{from_row_major, to_row_major};
use shared_types::sample::{Field as _, Flag};
use shared_types::samples::{
    BaroAltitude, BaselineInnovations, GnssBaseline, GnssFix, ImuSample, MagField, MocapPose,
    NavigationInnovations, PoseInnovations, RcFrame,
};
use shared_types::service::{nanoseconds, seconds};
use shared_types::wiring::{EstimatorInputs, EstimatorOutputs};
use shared_types::{Input, Now, Schedule, Service, ServiceId, Topic};
use vehicle_model::lag::Lag;

use crate::kalman::commands::{Command, CommandHistory, Stretch};
use crate::kalman::filter::schedule_of;
use crate::kalman::motion::{Actuation, NominalState, VehicleModel};
use crate::source::{Estimate, is_attitude};

/// Largest magnitudes of a sample: rate (rad/s), specific force (m/s²), velocity (m/s), height and altitude (m), and field (G).
const LARGEST_RATE: f64 = 200.0;
const LARGEST_FORCE: f64 = 2000.0;
const LARGEST_VELOCITY: f64 = 600.0;
const LARGEST_HEIGHT: f64 = 50_000.0;
const LARGEST_FIELD: f64 = 20.0;

/// Lowest frequency at which a vibration may appear in the samples, Hz: below it the vehicle follows.
const LOWEST_VIBRATION: f64 = 25.0;

/// Bias of the field over the horizontal field of the earth above which a heading by two antennas is wrong: that of 1.4 rad.
const MOST_BENT: f64 = 1.3;

/// Latitude from which the vertical component of the earth's field has the sign of the latitude, degrees.
const LATITUDE_OF_DIP: f64 = 30.0;

/// Time without a fused position above which the state coasts, ns.
const COASTS_AFTER_NS: u64 = 1_000_000_000;
/// Time for which poses or baselines must be refused in a row for a vehicle at rest to lose its trust, ns: less than the time after
/// which they are accepted again.
const CONTRADICTED_FOR_NS: u64 = 500_000_000;
/// Correction of the position (m) above which the published one follows slowly, and the highest speed at which it does, m/s.
const POSITION_FOLLOWS: [f64; 2] = [0.05, 1.0];
/// The same of the velocity, m/s and m/s².
const VELOCITY_FOLLOWS: [f64; 2] = [0.1, 1.0];
/// Distances of the published position from the estimate, m: above the one it begins to coast, and below the other it ceases.
const FAR_BEHIND: f64 = 0.2;
const CAUGHT_UP: f64 = 0.03;
/// Age of the newest sample of the inertial measurement unit up to which the state is predicted and counts as tracked, ns.
const OLDEST_IMU_NS: u64 = 100_000_000;

shared_types::sample! {
    /// Everything that the next step depends on besides its inputs.
    pub struct InertialEstimatorState {
        /// The last state.
        pub last: Estimate,
        /// State of the filter.
        pub filter: InertialState,
        /// The commands that act or are under way, oldest first.
        pub commands: [Command; 64],
        /// Number of these commands.
        pub command_count: u64,
        /// Time of thrust, rates and push, ns since the start of the flight.
        pub time_ns: u64,
        /// T̂, N.
        pub thrust: f64,
        /// Body rates by the frames in {B}, rad/s.
        pub rates_body: [f64; 3],
        /// d in {I}, m/s².
        pub push_world: [f64; 3],
        /// Published minus estimated position, m.
        pub position_offset: Offset,
        /// Published minus estimated velocity, m/s.
        pub velocity_offset: Offset,
        /// Time since which positions are fused without a break, ns since the start of the flight; all ones while they are not.
        pub healthy_since_ns: u64,
        /// State of the input validator of samples of the inertial measurement unit.
        pub imu: GateState,
        /// State of that of fixes.
        pub fix: GateState,
        /// State of that of altitudes.
        pub altitude: GateState,
        /// State of that of fields.
        pub field: GateState,
        /// State of that of poses.
        pub pose: GateState,
        /// State of that of baselines.
        pub baseline: GateState,
        /// The last good ones.
        pub imu_held: ImuSample,
        /// The last good fix.
        pub fix_held: GnssFix,
        /// The last good altitude.
        pub altitude_held: BaroAltitude,
        /// The last good field.
        pub field_held: MagField,
        /// The last good pose.
        pub pose_held: MocapPose,
        /// The last good baseline.
        pub baseline_held: GnssBaseline,
        /// `true` if positions have been healthy for long enough once.
        pub was_healthy: Flag,
        /// `true` if the motors turn.
        pub motors_turn: Flag,
        /// `true` if the state coasts.
        pub coasts: Flag,
        /// Explicit padding.
        pub pad0: [u8; 5],
    }
}

/// Writes the last innovation of these sources to a sample, which has a place for each.
macro_rules! write_sources {
    ($service:ident, $sample:ident, $sources:expr) => {
        for (index, source) in $sources.iter().enumerate() {
            let status = $service.filter.source(*source);
            let three = 3 * index..3 * index + 3;
            $sample.valid_ns[index] = status.fused_ns.max(status.refused_ns);
            $sample.innovations[three.clone()].copy_from_slice(&status.innovation);
            $sample.variances[three].copy_from_slice(&status.variance);
            $sample.normalised_squares[index] = status.squared_distance;
            $sample.fused[index] = status.fused;
            $sample.refused[index] = status.refused;
            $sample.unusable[index] = status.unusable;
            $sample.accepted[index] = (status.fused > 0 && status.fused_ns >= status.refused_ns).into();
        }
    };
}

shared_types::sample! {
    /// Published minus estimated value after the last large correction, from which the published one follows.
    pub struct Offset {
        /// At the time of that correction, in {I}.
        pub world: [f64; 3],
        /// That time, ns since the start of the flight.
        pub corrected_ns: u64,
    }
}

impl Offset {
    const NONE: Self = Self {
        world: [0.0; 3],
        corrected_ns: 0,
    };

    /// Returns the offset now: it vanishes over `ramp` s, and not faster than `fastest` in a second.
    fn now(&self, now: &Now, ramp: f64, [_, fastest]: [f64; 2]) -> Vector3<f64> {
        let world = Vector3::from(self.world);
        let since = seconds(now.time_ns.saturating_sub(self.corrected_ns));
        world * (1.0 - since / ramp.max(world.norm() / fastest)).max(0.0)
    }

    /// Begins again after a large correction of the estimate.
    fn correct(&mut self, now: &Now, ramp: f64, follows: [f64; 2], correction_world: &Vector3<f64>) {
        if correction_world.norm() > follows[0] {
            self.world = (self.now(now, ramp, follows) - correction_world).into();
            self.corrected_ns = now.time_ns;
        }
    }
}

/// Estimator of flight outdoors as a service.
#[derive(Clone, Debug)]
pub struct InertialEstimatorService {
    frame: LocalFrame,
    vehicle: VehicleModel,
    mass: f64,
    /// Minimum thrust of a flying vehicle, N.
    airborne_thrust: f64,
    radio_latency_ns: u64,
    push: Lag,
    ramp: f64,
    healthy_for_ns: u64,
    coast_ns: u64,
    filter: Box<InertialFilter>,
    history: CommandHistory,
    time_ns: u64,
    actuation: Actuation,
    push_world: Vector3<f64>,
    position_offset: Offset,
    velocity_offset: Offset,
    healthy_since_ns: Option<u64>,
    was_healthy: bool,
    coasts: bool,
    motors_turn: bool,
    last: Estimate,
    imu: InputValidator<ImuSample>,
    fix: InputValidator<GnssFix>,
    altitude: InputValidator<BaroAltitude>,
    field: InputValidator<MagField>,
    pose: InputValidator<MocapPose>,
    baseline: InputValidator<GnssBaseline>,
    fuses_poses: bool,
    has_baseline: bool,
    /// Horizontal field of the earth, G.
    horizontal_field: f64,
}

impl InertialEstimatorService {
    /// Makes the estimator of a checked scenario with inertial navigation.
    ///
    /// # Errors
    /// If its times make that it can never be tracked, if more frames are under way than it stores, if the vibration of the
    /// rotors looks like a motion, or if the field is not that of the earth.
    pub fn new(scenario: &Scenario) -> Result<Self, Problem> {
        let navigation = scenario.navigation.clone().unwrap_or_default();
        let model = scenario.model.clone().unwrap_or_default();
        let datum = scenario.datum_or_default();
        let schedule = schedule_of(scenario)?;
        check_times(scenario, &navigation, &model, &schedule)?;
        if let Some(sensors) = &scenario.sensors {
            check_vibration(&sensors.imu, &schedule)?;
        }
        check_field(&datum)?;
        Ok(Self {
            frame: datum.frame(),
            vehicle: VehicleModel::new(&model),
            mass: model.mass,
            airborne_thrust: airborne_thrust(scenario.controller.bounds.mass_min),
            radio_latency_ns: nanoseconds(model.radio_latency),
            push: Lag::new(1.0 / navigation.push_bandwidth),
            ramp: navigation.ramp,
            healthy_for_ns: nanoseconds(navigation.healthy_for),
            coast_ns: nanoseconds(navigation.coast),
            filter: Box::new(InertialFilter::new(&parameters(&navigation, datum.field_world()))),
            history: CommandHistory::resting(),
            time_ns: 0,
            actuation: Actuation {
                thrust: 0.0,
                rates_body: Vector3::zeros(),
            },
            push_world: Vector3::zeros(),
            position_offset: Offset::NONE,
            velocity_offset: Offset::NONE,
            healthy_since_ns: None,
            was_healthy: false,
            coasts: true,
            motors_turn: false,
            last: Estimate::UNMEASURED,
            imu: InputValidator::default(),
            fix: InputValidator::default(),
            altitude: InputValidator::default(),
            field: InputValidator::default(),
            pose: InputValidator::default(),
            baseline: InputValidator::default(),
            fuses_poses: navigation.poses.is_some(),
            has_baseline: navigation.baseline.is_some(),
            horizontal_field: Vector3::from(datum.field_world()).xy().norm(),
        })
    }

    fn add_frame(&mut self, now: &Now, frame: &RcFrame) {
        if !frame.is_whole() {
            return;
        }
        let acts_from_ns = frame.header.stamp_ns.saturating_add(self.radio_latency_ns);
        if self.history.is_full() {
            self.history.drop_oldest();
        }
        self.history.push(self.history.command_of(acts_from_ns, frame));
        self.motors_turn = !frame.failsafe.is_set();
        let carries = self.motors_turn && frame.thrust >= self.airborne_thrust;
        self.filter.set_motors(now.time_ns, self.motors_turn, carries);
    }

    /// Validates the samples of all sensors, and passes those that are possible to the filter. That of the inertial measurement
    /// unit is the last, as it advances the filter.
    fn add_samples(&mut self, now: &Now, inputs: &EstimatorInputs<'_>) {
        let is_past = |time_ns: u64| time_ns <= now.time_ns;
        let verdict = self.fix.look(&inputs.fix, LARGEST, |fix, _| {
            judged(fix.measured, is_past(fix.valid_ns) && is_possible(fix))
        });
        if let (Some(Validity::Good), Some(fix)) = (verdict, self.fix.held()) {
            self.filter.add_fix(&local_fix(&self.frame, fix));
        }
        let verdict = self.baseline.look(&inputs.baseline, LARGEST, |sample, _| {
            let is_possible = sample.accuracies_ned.iter().all(|accuracy| *accuracy >= 0.0);
            judged(sample.measured, is_past(sample.valid_ns) && is_possible)
        });
        if let (Some(Validity::Good), Some(sample)) = (verdict, self.baseline.held())
            && sample.fixed.is_set()
        {
            let [north, east, down] = sample.accuracies_ned;
            self.filter.add_baseline(&Baseline {
                time_ns: sample.valid_ns,
                baseline_world: self.frame.world_from_ned() * Vector3::from(sample.baseline_ned),
                accuracies: [north.max(east), down],
            });
        }
        let verdict = self.altitude.look(&inputs.altitude, LARGEST_HEIGHT, |sample, _| {
            judged(sample.measured, is_past(sample.measured_ns))
        });
        if let (Some(Validity::Good), Some(sample)) = (verdict, self.altitude.held()) {
            self.filter.add_altitude(&Altitude {
                time_ns: sample.measured_ns,
                altitude: sample.altitude,
            });
        }
        let verdict = self.field.look(&inputs.field, LARGEST_FIELD, |sample, _| {
            judged(sample.measured, is_past(sample.measured_ns))
        });
        if let (Some(Validity::Good), Some(sample)) = (verdict, self.field.held()) {
            self.filter.add_field(&Field {
                time_ns: sample.measured_ns,
                field_body: sample.field_body.into(),
            });
        }
        if self.fuses_poses {
            self.add_pose(now, &inputs.pose);
        }
        let verdict = self.imu.look(&inputs.imu, LARGEST, |sample, held| {
            let is_next = held.is_none_or(|held| sample.measured_ns > held.measured_ns);
            let is_possible = sample.angular_velocity_body.is_within(LARGEST_RATE)
                && sample.specific_force_body.is_within(LARGEST_FORCE);
            judged(
                sample.measured,
                is_past(sample.measured_ns) && is_next && is_possible,
            )
        });
        if let (Some(Validity::Good), Some(sample)) = (verdict, self.imu.held()) {
            let correction = self.filter.add_imu(&Measured {
                time_ns: sample.measured_ns,
                rate_body: sample.angular_velocity_body.into(),
                force_body: sample.specific_force_body.into(),
                is_clipped: sample.clipped.is_set(),
            });
            let time_ns = sample.measured_ns;
            self.follow(time_ns);
            // Before it is tracked, no service uses it.
            if self.was_healthy {
                let Correction {
                    position_world,
                    velocity_world,
                } = &correction;
                self.position_offset
                    .correct(now, self.ramp, POSITION_FOLLOWS, position_world);
                self.velocity_offset
                    .correct(now, self.ramp, VELOCITY_FOLLOWS, velocity_world);
            }
        }
    }

    /// Validates a pose, and passes its measured parts to the filter.
    fn add_pose(&mut self, now: &Now, input: &Input<'_, MocapPose>) {
        let position = |pose: &MocapPose| {
            let is_there = pose.has_position() && pose.position_world.is_within(LARGEST);
            is_there.then(|| pose.position_world.into())
        };
        let attitude = |pose: &MocapPose| {
            let is_there = pose.has_attitude() && is_attitude(pose);
            is_there.then(|| from_row_major(&pose.world_from_body))
        };
        let verdict = self.pose.look(input, LARGEST, |pose, held| {
            let is_next = held.is_none_or(|held| pose.capture_time_ns > held.capture_time_ns);
            let is_possible = pose.capture_time_ns <= now.time_ns
                && is_next
                && (position(pose).is_some() || attitude(pose).is_some());
            judged(pose.tracked, is_possible)
        });
        if let (Some(Validity::Good), Some(pose)) = (verdict, self.pose.held()) {
            self.filter.add_pose(&Pose {
                time_ns: pose.capture_time_ns,
                position_world: position(pose),
                world_from_body: attitude(pose),
            });
        }
    }

    /// Brings thrust, rates and push to the time of the newest sample of the inertial measurement unit.
    fn follow(&mut self, time_ns: u64) {
        for Stretch { command, steps, h } in self.history.stretches(self.time_ns, time_ns) {
            for _ in 0..steps {
                self.actuation = self.vehicle.actuated(&self.actuation, &command, h);
            }
        }
        let h = seconds(time_ns.saturating_sub(self.time_ns));
        self.time_ns = time_ns;
        self.history.drop_before(time_ns);
        if let (Some(motion), Some(unbiased)) = (self.filter.motion(), self.filter.unbiased()) {
            let r = &motion.world_from_body;
            let unexplained = r * unbiased.force_body + r.column(2) * (self.actuation.thrust / self.mass);
            self.push_world = self.push.end(self.push_world, unexplained, h);
        }
    }

    /// Returns the state at the time at which a frame sent now takes effect; `None` before the alignment.
    fn estimate(&self, now: &Now) -> Option<Estimate> {
        let (motion, unbiased) = (self.filter.motion()?, self.filter.unbiased()?);
        let position_sigma = self.filter.horizon()?.deviation(POSITION);
        let offset = self.position_offset.now(now, self.ramp, POSITION_FOLLOWS);
        let velocity_offset = self.velocity_offset.now(now, self.ramp, VELOCITY_FOLLOWS);
        let mut nominal = NominalState {
            position_world: motion.position_world,
            velocity_world: motion.velocity_world,
            world_from_body: motion.world_from_body,
            rate_bias_body: unbiased.rate_body - self.actuation.rates_body,
            disturbance_world: self.push_world,
            marker_offset_body: Vector3::zeros(),
            actuation: self.actuation,
        };
        let mut state_time_ns = self.time_ns;
        if self.motors_turn && self.measures_motion(now) {
            state_time_ns = now.time_ns.saturating_add(self.radio_latency_ns);
            nominal = self
                .vehicle
                .flown(&nominal, &self.history, self.time_ns, state_time_ns);
        }
        let r = &nominal.world_from_body;
        Some(Estimate {
            state_time_ns,
            position_world: (nominal.position_world + offset).into(),
            world_from_body: to_row_major(r),
            velocity_body: r.tr_mul(&(nominal.velocity_world + velocity_offset)).into(),
            angular_velocity_body: (nominal.actuation.rates_body + nominal.rate_bias_body).into(),
            acceleration_world: if self.motors_turn {
                self.vehicle.acceleration(&nominal).into()
            } else {
                [0.0; 3]
            },
            thrust: nominal.actuation.thrust,
            position_sigma,
        })
    }

    /// Returns the time since a position was fused last, ns; `None` before the first.
    fn without_position_for_ns(&self, now: &Now) -> Option<u64> {
        let positioned_ns = self.filter.positioned_ns()?;
        Some(now.time_ns.saturating_sub(positioned_ns))
    }

    /// Returns whether the newest sample of the inertial measurement unit is recent.
    fn measures_motion(&self, now: &Now) -> bool {
        now.time_ns.saturating_sub(self.time_ns) <= OLDEST_IMU_NS
    }

    /// Returns for how long poses or baselines have been refused in a row, ns, if some were in the last second, and none was fused.
    fn contradicted_for_ns(&self, now: &Now) -> Option<u64> {
        [Source::PosePosition, Source::PoseAttitude, Source::Baseline]
            .into_iter()
            .filter_map(|source| {
                let status = self.filter.source(source);
                let is_refused = status.refused > 0 && is_recent(status.refused_ns, now);
                (is_refused && !self.is_fused(source, now))
                    .then(|| status.refused_ns.saturating_sub(status.refused_since_ns))
            })
            .max()
    }

    /// Returns whether a source was fused in the last second.
    fn is_fused(&self, source: Source, now: &Now) -> bool {
        let status = self.filter.source(source);
        status.fused > 0 && is_recent(status.fused_ns, now)
    }

    /// Returns whether the heading is known well enough for the first flight with it: where two antennas are stated, by a pose, or by a
    /// baseline and a field that agree. A baseline that is stated the wrong way round turns the heading by half a turn, and the filter
    /// takes what it then sees of the field for its bias.
    fn knows_heading(&self, now: &Now) -> bool {
        if !self.has_baseline || self.is_fused(Source::PoseAttitude, now) {
            return true;
        }
        let bias = self
            .filter
            .horizon()
            .map(|horizon| horizon.biases.field_body.norm());
        let is_bent = bias.is_none_or(|bias| bias > MOST_BENT * self.horizontal_field);
        self.is_fused(Source::Baseline, now) && self.is_fused(Source::Field, now) && !is_bent
    }

    /// Returns whether the state is tracked, and whether it coasts.
    fn trust(&mut self, now: &Now) -> [bool; 2] {
        let without_ns = self.without_position_for_ns(now);
        let coasts = without_ns.is_none_or(|without| without > COASTS_AFTER_NS);
        // At rest poses and baselines reset the heading after some seconds: which of the two is right is not known then.
        let rests = !self.motors_turn && self.is_fused(Source::ZeroVelocity, now);
        let contradicted_for_ns = self.contradicted_for_ns(now);
        self.was_healthy &=
            !(rests && contradicted_for_ns.is_some_and(|for_ns| for_ns >= CONTRADICTED_FOR_NS));
        let is_healthy =
            !coasts && contradicted_for_ns.is_none() && (self.was_healthy || self.knows_heading(now));
        let since_ns = self.healthy_since_ns.or(Some(now.time_ns)).filter(|_| is_healthy);
        self.healthy_since_ns = since_ns;
        self.was_healthy |=
            since_ns.is_some_and(|since| now.time_ns.saturating_sub(since) >= self.healthy_for_ns);
        let is_recent = without_ns.is_some_and(|without| without <= self.coast_ns);
        let behind = self.position_offset.now(now, self.ramp, POSITION_FOLLOWS).norm();
        self.coasts = coasts || behind > if self.coasts { CAUGHT_UP } else { FAR_BEHIND };
        [
            self.was_healthy && is_recent && self.measures_motion(now),
            self.coasts,
        ]
    }

    /// Writes the last innovation of each source but of poses and baselines.
    fn write_innovations(&self, sample: &mut NavigationInnovations) {
        write_sources!(self, sample, Source::ALL[..Source::PosePosition as usize]);
    }

    /// Writes the last innovations of poses.
    fn write_pose_innovations(&self, sample: &mut PoseInnovations) {
        write_sources!(self, sample, [Source::PosePosition, Source::PoseAttitude]);
    }

    /// Writes the last innovation of baselines.
    fn write_baseline_innovations(&self, sample: &mut BaselineInnovations) {
        write_sources!(self, sample, [Source::Baseline]);
    }

    /// Returns the number of samples that were refused, by the validators and by the filter.
    fn refused(&self) -> u32 {
        let validators = [
            self.imu.refused(),
            self.fix.refused(),
            self.altitude.refused(),
            self.field.refused(),
            self.pose.refused(),
            self.baseline.refused(),
        ];
        let of_filter = Source::ALL.map(|source| {
            let SourceStatus {
                refused, unusable, ..
            } = self.filter.source(source);
            refused.saturating_add(*unusable)
        });
        validators
            .into_iter()
            .chain(of_filter)
            .fold(0, u32::saturating_add)
    }
}

impl Service for InertialEstimatorService {
    const ID: ServiceId = ServiceId::Estimator;
    type Inputs<'a> = EstimatorInputs<'a>;
    type Outputs<'a> = EstimatorOutputs<'a>;
    type State = InertialEstimatorState;

    /// Before the alignment the state is level at the origin and at rest, and not tracked.
    fn step(&mut self, now: &Now, inputs: &EstimatorInputs<'_>, outputs: &mut EstimatorOutputs<'_>) {
        if let Some(frame) = inputs.frame.fresh() {
            self.add_frame(now, frame);
        }
        self.add_samples(now, inputs);
        let [tracked, coasting] = self.trust(now);
        if let Some(state) = outputs.state.due() {
            self.last = self.estimate(now).unwrap_or(self.last);
            self.last.write(state);
            state.tracked = tracked.into();
            state.coasting = coasting.into();
            state.captures_refused = self.refused();
        }
        if let Some(innovations) = outputs.innovations.due() {
            self.write_innovations(innovations);
        }
        if let Some(poses) = outputs.poses.due() {
            self.write_pose_innovations(poses);
        }
        if let Some(baselines) = outputs.baselines.due() {
            self.write_baseline_innovations(baselines);
        }
    }

    fn save(&self) -> InertialEstimatorState {
        let (commands, command_count) = self.history.save();
        let (imu, imu_held) = self.imu.save();
        let (fix, fix_held) = self.fix.save();
        let (altitude, altitude_held) = self.altitude.save();
        let (field, field_held) = self.field.save();
        let (pose, pose_held) = self.pose.save();
        let (baseline, baseline_held) = self.baseline.save();
        InertialEstimatorState {
            last: self.last,
            filter: self.filter.save(),
            commands,
            command_count: command_count as u64,
            time_ns: self.time_ns,
            thrust: self.actuation.thrust,
            rates_body: self.actuation.rates_body.into(),
            push_world: self.push_world.into(),
            position_offset: self.position_offset,
            velocity_offset: self.velocity_offset,
            healthy_since_ns: self.healthy_since_ns.unwrap_or(u64::MAX),
            imu,
            fix,
            altitude,
            field,
            pose,
            baseline,
            imu_held,
            fix_held,
            altitude_held,
            field_held,
            pose_held,
            baseline_held,
            was_healthy: self.was_healthy.into(),
            coasts: self.coasts.into(),
            motors_turn: self.motors_turn.into(),
            pad0: [0; 5],
        }
    }

    fn restore(&mut self, state: &InertialEstimatorState) {
        self.last = state.last;
        self.filter.restore(&state.filter);
        let count = usize::try_from(state.command_count).unwrap_or(usize::MAX);
        self.history = CommandHistory::restored(state.commands, count);
        self.time_ns = state.time_ns;
        self.actuation = Actuation {
            thrust: state.thrust,
            rates_body: state.rates_body.into(),
        };
        self.push_world = state.push_world.into();
        self.position_offset = state.position_offset;
        self.velocity_offset = state.velocity_offset;
        self.healthy_since_ns = Some(state.healthy_since_ns).filter(|&since| since != u64::MAX);
        self.was_healthy = state.was_healthy.is_set();
        self.coasts = state.coasts.is_set();
        self.motors_turn = state.motors_turn.is_set();
        self.imu.restore(&state.imu, &state.imu_held);
        self.fix.restore(&state.fix, &state.fix_held);
        self.altitude.restore(&state.altitude, &state.altitude_held);
        self.field.restore(&state.field, &state.field_held);
        self.pose.restore(&state.pose, &state.pose_held);
        self.baseline.restore(&state.baseline, &state.baseline_held);
    }
}

/// Returns whether a source's last sample at a time of validity is recent.
fn is_recent(time_ns: u64, now: &Now) -> bool {
    now.time_ns.saturating_sub(time_ns) <= COASTS_AFTER_NS
}

/// Returns the result for a sample: nothing new if nothing was measured.
fn judged(measured: Flag, is_possible: bool) -> Validity {
    match (measured.is_set(), is_possible) {
        (false, _) => Validity::NothingNew,
        (true, true) => Validity::Good,
        (true, false) => Validity::Refused,
    }
}

/// Returns the kind of a fix; `None` for an unknown one.
fn kind_of(fix: &GnssFix) -> Option<FixKind> {
    FixKind::ALL.into_iter().find(|kind| *kind as u8 == fix.kind)
}

/// Returns whether a fix is a place near the earth with a plausible velocity and accuracies.
fn is_possible(fix: &GnssFix) -> bool {
    let accuracies = [fix.horizontal_accuracy, fix.vertical_accuracy, fix.speed_accuracy];
    kind_of(fix).is_some()
        && fix.latitude.is_within(90.0)
        && fix.longitude.is_within(180.0)
        && fix.height.is_within(LARGEST_HEIGHT)
        && fix.velocity_ned.is_within(LARGEST_VELOCITY)
        && accuracies.iter().all(|accuracy| *accuracy >= 0.0)
}

/// Returns a fix in {I}.
fn local_fix(frame: &LocalFrame, fix: &GnssFix) -> Fix {
    let place = Geodetic {
        latitude: fix.latitude,
        longitude: fix.longitude,
        height: fix.height,
    };
    Fix {
        time_ns: fix.valid_ns,
        kind: kind_of(fix).unwrap_or(FixKind::SinglePoint),
        position_world: frame.to_world(place),
        velocity_world: frame.world_from_ned() * Vector3::from(fix.velocity_ned),
        accuracies: [fix.horizontal_accuracy, fix.vertical_accuracy, fix.speed_accuracy],
    }
}

/// Returns the parameters of the filter, for a field of the earth in {I}, G.
fn parameters(navigation: &Navigation, field_world: [f64; 3]) -> Parameters {
    let poses = navigation.poses.unwrap_or_default();
    Parameters {
        gyroscope: InertialNoise {
            noise_density: navigation.gyroscope_noise,
            bias_deviation: navigation.gyroscope_bias,
            bias_walk: navigation.gyroscope_walk,
        },
        accelerometer: InertialNoise {
            noise_density: navigation.accelerometer_noise,
            bias_deviation: navigation.accelerometer_bias,
            bias_walk: navigation.accelerometer_walk,
        },
        fixes: navigation.errors(),
        antenna_body: navigation.antenna.into(),
        baseline_body: navigation.baseline.map(Vector3::from),
        field_world: field_world.into(),
        field_white: navigation.field_white,
        field_bias_deviation: navigation.field_bias,
        field_bias_walk: navigation.field_walk,
        field_arming_deviation: navigation.field_arming,
        altitude_deviation: navigation.altitude_bias,
        altitude_white: navigation.altitude_white,
        altitude_ground_effect: navigation.altitude_ground_effect,
        altitude_walk: navigation.altitude_walk,
        pose_deviations: [poses.position_deviation, poses.attitude_deviation],
        horizon: navigation.horizon,
        reset_after: navigation.reset_after,
    }
}

/// Checks that the vibration of the rotors does not look like a motion: a sampled frequency above half the rate appears below it.
fn check_vibration(imu: &Imu, schedule: &Schedule) -> Result<(), Problem> {
    let rate = 1.0 / seconds(schedule.time_ns(schedule.topic_rate(Topic::ImuSample).period));
    for (times, _) in (1..).zip(imu.vibration).filter(|(_, amplitude)| *amplitude > 0.0) {
        let frequency = f64::from(times) * imu.rotor_frequency;
        let apparent = (frequency - libm::round(frequency / rate) * rate).abs();
        if apparent < LOWEST_VIBRATION {
            return Err(Problem::new(
                Key::root().then("sensors").then("imu").then("rotor_frequency"),
                format!(
                    "the vehicle would follow its own vibration: in samples at {rate:.0} Hz, {frequency} Hz look like \
                     {apparent:.1} Hz"
                ),
                "give `imu/sample` another period, or state another frequency, or no `vibration`",
            ));
        }
    }
    Ok(())
}

/// Checks that a field is that of the earth, which is nowhere outside of 0.2 to 0.7 G, and away from the equator points down in the
/// north and up in the south.
fn check_field(datum: &Datum) -> Result<(), Problem> {
    let field = Vector3::from(datum.field_world());
    let strength = field.norm();
    let (reason, fix) = if !(0.15..0.75).contains(&strength) {
        (
            format!("{strength:.3} G is not the field of the earth, which has 0.2 to 0.7 G"),
            "give it in gauss: 1 µT are 0.01 G, and 1000 nT too",
        )
    } else if datum.latitude.abs() > LATITUDE_OF_DIP && field.z * datum.latitude < 0.0 {
        let side = if field.z > 0.0 { "down" } else { "up" };
        (
            format!(
                "the field points {side}, and at a latitude of {:?}° it does not",
                datum.latitude
            ),
            "its third component is the one downwards, positive in the north and negative in the south",
        )
    } else {
        return Ok(());
    };
    Err(Problem::new(Key::root().then("datum").then("field"), reason, fix))
}

/// Checks the times between measurements and frames: with these the state is tracked while all samples arrive.
fn check_times(
    scenario: &Scenario,
    navigation: &Navigation,
    model: &Model,
    schedule: &Schedule,
) -> Result<(), Problem> {
    let key_of = |table, name: &str| Key::root().then("schedule").then(table).then(name);
    let period_ns = |topic| schedule.time_ns(schedule.topic_rate(topic).period);
    let latency_ns = schedule.time_ns(schedule.latency_of(ServiceId::Estimator, Topic::ImuSample));
    let imu_age_ns = latency_ns + period_ns(Topic::ImuSample);
    if imu_age_ns > OLDEST_IMU_NS {
        return Err(Problem::new(
            key_of("latency", "imu/sample -> estimator"),
            format!(
                "the vehicle would never be tracked: its motion is unknown once the newest sample is {:?} s old",
                seconds(OLDEST_IMU_NS)
            ),
            "shorten it",
        ));
    }
    // A sample is fused when the horizon has come to the time at which it is valid.
    let oldest_ns = |topic| period_ns(topic) + nanoseconds(navigation.horizon) + imu_age_ns;
    // Where one source measures the position, another may not.
    let sensors = scenario.sensors.as_ref();
    let has_fixes = sensors.is_none_or(|sensors| sensors.gnss.least_accurate().is_some());
    let sources = [
        (has_fixes || navigation.poses.is_none(), Topic::GnssFix, "fix"),
        (navigation.poses.is_some(), Topic::MocapPose, "pose"),
    ];
    for (_, topic, what) in sources.into_iter().filter(|(is_there, ..)| *is_there) {
        let age_ns = oldest_ns(topic);
        let age = seconds(age_ns);
        if age_ns > COASTS_AFTER_NS {
            return Err(Problem::new(
                key_of("period", topic.name()),
                format!(
                    "the state would coast before each {what}: the last one is up to {age:?} s old by then, and after {:?} s it counts \
                     as lost",
                    seconds(COASTS_AFTER_NS)
                ),
                "shorten it, or `navigation.horizon`",
            ));
        }
        if age_ns > nanoseconds(navigation.coast) {
            return Err(Problem::new(
                Key::root().then("navigation").then("coast"),
                format!(
                    "the vehicle would be lost before each {what}: the last one is up to {age:?} s old by then"
                ),
                "give it several seconds",
            ));
        }
    }
    // Without poses the heading of two antennas is trusted only beside a field.
    let is_needed = navigation.baseline.is_some() && navigation.poses.is_none();
    for topic in [Topic::GnssBaseline, Topic::MagField]
        .into_iter()
        .filter(|_| is_needed)
    {
        let age_ns = oldest_ns(topic);
        if age_ns > COASTS_AFTER_NS {
            return Err(Problem::new(
                key_of("period", topic.name()),
                format!(
                    "the vehicle would never be tracked: with two antennas one has to be fused each {:?} s, and the last is up to {:?} s \
                     old by then",
                    seconds(COASTS_AFTER_NS),
                    seconds(age_ns)
                ),
                "shorten it, or `navigation.horizon`",
            ));
        }
    }
    CommandHistory::check_capacity(
        imu_age_ns,
        model,
        schedule,
        "the newest sample of `imu/sample`",
        "that of `imu/sample -> estimator`, the period of `imu/sample`",
    )
}
