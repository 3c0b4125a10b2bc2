//! Measurements at their time of validity, gates, resets, and the motion at present.
//!
//! Failure policy, by the faults of the samples:
//! * a sample with a number that is not finite is refused, as is one older than the horizon, and one from the future;
//! * a measurement is fused when its innovation is within the 99.9 % quantile of its source; the position and the velocity
//!   of a fix are two sources, and so are position and attitude of a pose;
//! * a source that is refused for [`reset_after`](Parameters::reset_after) without a break, and without a silence of more than a second,
//!   is accepted again: what it measures is forgotten and taken from it, and the jump of the position is counted ([`InertialFilter::resets`]).
//!   A fix is not, while poses are fused; the position of a pose is not, while fixes are, and else after a second, as the motion drifts
//!   away meanwhile; its attitude is not, while the motors turn or gravity contradicts it;
//! * a baseline of two antennas that is accepted again gives the heading alone, and is not while its length or its angle to gravity is
//!   another, or while attitudes of poses are fused;
//! * poses that scatter show no place: the time for which they are refused starts again with each that contradicts the one before;
//! * when the kind of the fixes changes, their slow errors are new;
//! * a step over a gap of the inertial measurement unit, or with a sample at the end of its range, adds the variance of a
//!   motion that was not measured;
//! * without fixes and poses the motion is that of the inertial measurement unit, with a covariance that grows;
//! * near the ground, while the motors turn, an altitude that is too low says next to nothing: the air below the rotors is compressed;
//! * when motors start, the field of the vehicle may change;
//! * while they turn, there is no alignment: a filter that begins in the air gives no state;
//! * while their thrust could not carry the vehicle, and it is seen to be still, its velocity is zero and the gyroscope measures its bias.

use nalgebra::{Matrix3, Vector3};
use shared_types::gnss::{FixErrors, FixKind};
use shared_types::navigation_limits::LONGEST_IMU_PERIOD_NS;
pub(crate) use shared_types::navigation_limits::{STORED_MEASUREMENTS as QUEUE, STORED_SAMPLES as RING};
use shared_types::rotation::{angle_between, exp, from_row_major, to_row_major};
use shared_types::sample::{Field as _, Flag};
use shared_types::service::{nanoseconds, seconds};
use zerocopy::FromZeros;

use crate::alignment::{Alignment, MOST_TILT, is_baseline};
use crate::error_state::{
    ATTITUDE, FIELD_BIAS, FIX_POSITION, FIX_VELOCITY, POSITION, VELOCITY, add_to_diagonal,
    slow_position_variance,
};
use crate::horizon::Horizon;
use crate::measurement::{self, Altitude, Baseline, Field, Fix, ImuSample, Linearized, Pose};
use crate::nominal::{Kinematics, Unbiased};
use crate::parameters::Parameters;

/// 99.9 % quantiles of χ² with one and three degrees of freedom.
const GATES: [f64; 2] = [10.83, 16.27];

/// Time by which a measurement may be newer than the newest sample of the inertial measurement unit, ns.
const FUTURE_NS: u64 = 500_000_000;
/// Longest span of a sample that the alignment counts, s.
const LONGEST_SPAN: f64 = 0.1;
/// Standard deviations of an acceleration (m/s²) and of a rate (rad/s) that were not measured: over a gap, and beyond the end of
/// a range of 16 g.
const OVER_GAP: [f64; 2] = [10.0, 2.0];
const BEYOND_RANGE: [f64; 2] = [160.0, 2.0];

/// Longest time between two measurements that are refused in a row, ns.
const SILENCE_NS: u64 = 1_000_000_000;

/// Time after which a vehicle that its motors do not carry may be at rest, ns.
const SETTLED_NS: u64 = 1_000_000_000;
/// Time over which rate and force of a vehicle at rest are averaged, s.
const REST_SPAN: f64 = 0.1;
/// Rate (rad/s), and difference of the specific force from gravity (m/s²), above which it is not at rest.
const STILL: [f64; 2] = [0.05, 0.5];
/// Standard deviation of the velocity of a vehicle at rest, m/s.
const REST_DEVIATION: f64 = 0.01;

/// Height below which a barometer may read too little while the rotors turn, m.
const NEAR_THE_GROUND: f64 = 1.0;

/// Variances after which a state is as good as forgotten: of a position (m²), of a velocity ((m/s)²) and of an attitude (rad²).
const FORGOTTEN: [f64; 3] = [1e6, 400.0, 10.0];

/// Speed (m/s) and rate (rad/s) with which the motion may drift away from poses that are refused, and the standard deviations of a
/// pose by which two of these may differ besides.
const POSE_DRIFT: [f64; 2] = [3.0, 0.1];
const POSE_DEVIATIONS: f64 = 8.0;

/// Change of the present motion by measurements.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Correction {
    /// In {I}, m.
    pub position_world: Vector3<f64>,
    /// In {I}, m/s.
    pub velocity_world: Vector3<f64>,
}

/// What corrects the filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Source {
    FixPosition = 0,
    FixVelocity = 1,
    Field = 2,
    Altitude = 3,
    /// Velocity of a vehicle at rest, without a gate while the motors are stopped.
    ZeroVelocity = 4,
    /// Rate of a vehicle at rest, without a gate while the motors are stopped.
    RestingRate = 5,
    PosePosition = 6,
    PoseAttitude = 7,
    Baseline = 8,
}

impl Source {
    /// All sources.
    pub const ALL: [Self; 9] = [
        Self::FixPosition,
        Self::FixVelocity,
        Self::Field,
        Self::Altitude,
        Self::ZeroVelocity,
        Self::RestingRate,
        Self::PosePosition,
        Self::PoseAttitude,
        Self::Baseline,
    ];
}

shared_types::sample! {
    /// What has become of the measurements of a source.
    pub struct SourceStatus {
        /// Time of validity of the last that was fused, ns since the start of the flight; 0 for none.
        pub fused_ns: u64,
        /// Time of validity of the first of those refused in a row, ns since the start of the flight; all ones for none.
        pub refused_since_ns: u64,
        /// Time of validity of the last that was refused, ns since the start of the flight; 0 for none.
        pub refused_ns: u64,
        /// The last innovation; an altitude has one number.
        pub innovation: [f64; 3],
        /// Its predicted variances.
        pub variance: [f64; 3],
        /// Its squared Mahalanobis distance, of as many degrees of freedom as it has numbers.
        pub squared_distance: f64,
        /// Number of those fused.
        pub fused: u32,
        /// Number of those beyond the gate.
        pub refused: u32,
        /// Number of those that were late, from the future, not finite, or too many.
        pub unusable: u32,
        /// Number of resets to this source.
        pub resets: u32,
    }
}

shared_types::sample! {
    /// Sample of the inertial measurement unit between horizon and present.
    pub struct ImuRecord {
        /// End of the time of which it is the mean, ns since the start of the flight.
        pub time_ns: u64,
        /// Length of this time, ns.
        pub span_ns: u64,
        /// ω_m in {B}, rad/s.
        pub rate_body: [f64; 3],
        /// a_m in {B}, m/s².
        pub force_body: [f64; 3],
        /// `true` if a component is at the end of its range.
        pub is_clipped: Flag,
        /// Explicit padding.
        pub pad0: [u8; 7],
    }
}

shared_types::sample! {
    /// Measurement that waits for the horizon.
    pub struct QueuedMeasurement {
        /// Time at which it is valid, ns since the start of the flight.
        pub time_ns: u64,
        /// Position (m), velocity (m/s) and accuracies of a fix; a field (G), an altitude (m), position (m) or attitude
        /// (row-major) of a pose, or a baseline and its accuracies (m).
        pub numbers: [f64; 9],
        /// Its [`Source`]; `FixPosition` of a fix.
        pub source: u8,
        /// Its [`FixKind`].
        pub kind: u8,
        /// Explicit padding.
        pub pad0: [u8; 6],
    }
}

shared_types::sample! {
    /// The vehicle that rests where its motors do not carry it.
    pub struct Rest {
        /// Time from which the vehicle may rest, ns since the start of the flight.
        pub from_ns: u64,
        /// Time from which the motors carry it, ns since the start of the flight; all ones while they do not.
        pub until_ns: u64,
        /// Time over which the sums extend, s.
        pub span: f64,
        /// Sum of rate and time, rad.
        pub turn_body: [f64; 3],
        /// Sum of specific force and time, m/s.
        pub push_body: [f64; 3],
        /// Position along z where it rested last, in {I}, m.
        pub ground_z: f64,
    }
}

/// State of the filter from step to step.
#[derive(Clone, Debug)]
pub(crate) struct Memory {
    /// Samples after the horizon, in a ring that begins at `first`.
    pub ring: [ImuRecord; RING],
    pub first: usize,
    pub count: usize,
    /// Measurements after the horizon, by their time.
    pub queue: [QueuedMeasurement; QUEUE],
    pub queued: usize,
    pub newest: ImuRecord,
    pub alignment: Alignment,
    /// `None` before the alignment.
    pub horizon: Option<Horizon>,
    /// The motion at the time of the newest sample.
    pub present: Kinematics,
    pub rest: Rest,
    pub motors_turn: bool,
    /// Time at which the motors have started, until the horizon has come there, ns since the start of the flight.
    pub starts_ns: Option<u64>,
    /// Kind of the last fix; `None` before the first.
    pub kind: Option<FixKind>,
    pub sources: [SourceStatus; 9],
    /// Sum of the jumps of the position by resets in {I}, m.
    pub jump_world: Vector3<f64>,
}

/// Error-state filter of a flight.
#[derive(Clone, Debug)]
pub struct InertialFilter {
    parameters: Parameters,
    horizon_ns: u64,
    reset_after_ns: u64,
    pub(crate) memory: Memory,
}

/// Outcome of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Fused,
    Refused,
    /// Refused for so long that the state has to be reset to it.
    Overdue,
}

impl InertialFilter {
    /// Makes a filter that is not aligned yet, of a vehicle with stopped motors.
    #[must_use]
    pub fn new(parameters: &Parameters) -> Self {
        let mut source = SourceStatus::new_zeroed();
        source.refused_since_ns = u64::MAX;
        let mut rest = Rest::new_zeroed();
        rest.until_ns = u64::MAX;
        Self {
            parameters: *parameters,
            horizon_ns: nanoseconds(parameters.horizon),
            reset_after_ns: nanoseconds(parameters.reset_after),
            memory: Memory {
                ring: [ImuRecord::new_zeroed(); RING],
                first: 0,
                count: 0,
                queue: [QueuedMeasurement::new_zeroed(); QUEUE],
                queued: 0,
                newest: ImuRecord::new_zeroed(),
                alignment: Alignment::new_zeroed(),
                horizon: None,
                present: Kinematics::AT_REST,
                rest,
                motors_turn: false,
                starts_ns: None,
                kind: None,
                sources: [source; 9],
                jump_world: Vector3::zeros(),
            },
        }
    }

    /// Returns whether there is a state.
    #[must_use]
    pub fn is_aligned(&self) -> bool {
        self.memory.horizon.is_some()
    }

    /// Returns the motion at the time of the newest sample; `None` before the alignment.
    #[must_use]
    pub fn motion(&self) -> Option<Kinematics> {
        self.memory.horizon.as_ref().map(|_| self.memory.present)
    }

    /// Returns the newest rate (rad/s) and specific force (m/s²) without their biases; `None` before the alignment.
    #[must_use]
    pub fn unbiased(&self) -> Option<Unbiased> {
        let horizon = self.memory.horizon.as_ref()?;
        let ImuRecord {
            rate_body,
            force_body,
            ..
        } = self.memory.newest;
        Some(horizon.biases.removed_from(&rate_body.into(), &force_body.into()))
    }

    /// Returns mean and covariance at the delayed time; `None` before the alignment.
    #[must_use]
    pub fn horizon(&self) -> Option<&Horizon> {
        self.memory.horizon.as_ref()
    }

    /// Returns what has become of the measurements of a source.
    #[must_use]
    pub fn source(&self, source: Source) -> &SourceStatus {
        &self.memory.sources[source as usize]
    }

    /// Returns the number of resets of position or velocity, and the sum of the jumps of the position in {I}, m.
    #[must_use]
    pub fn resets(&self) -> (u32, Vector3<f64>) {
        let sources = [Source::FixPosition, Source::FixVelocity, Source::PosePosition];
        let resets = sources.map(|source| self.source(source).resets);
        (resets.iter().sum(), self.memory.jump_world)
    }

    /// Returns the time of validity of the last position that was fused, ns since the start of the flight; `None` before the first.
    #[must_use]
    pub fn positioned_ns(&self) -> Option<u64> {
        let statuses = [Source::FixPosition, Source::PosePosition].map(|source| self.source(source));
        let fused = statuses.into_iter().filter(|status| status.fused > 0);
        fused.map(|status| status.fused_ns).max()
    }

    /// Returns the time since the last fused position at the horizon, s; `None` before the first.
    #[must_use]
    pub fn without_position_for(&self) -> Option<f64> {
        let horizon = self.memory.horizon.as_ref()?;
        let positioned_ns = self.positioned_ns()?;
        Some(seconds(horizon.time_ns.saturating_sub(positioned_ns)))
    }

    /// States that the motors turn from now on, or not, and whether their thrust could carry the vehicle. One that is not carried
    /// rests if it is still: in the air it would fall.
    pub fn set_motors(&mut self, now_ns: u64, turn: bool, carry: bool) {
        if turn && !self.memory.motors_turn {
            self.memory.starts_ns = Some(now_ns);
        }
        self.memory.motors_turn = turn;
        let rest = &mut self.memory.rest;
        let was_carried = rest.until_ns != u64::MAX;
        if carry && !was_carried {
            rest.until_ns = now_ns;
        } else if !carry && was_carried {
            rest.from_ns = now_ns.saturating_add(SETTLED_NS);
            rest.until_ns = u64::MAX;
        }
    }

    /// Adds a fix.
    pub fn add_fix(&mut self, fix: &Fix) {
        let mut numbers = [0.0; 9];
        let values = fix
            .position_world
            .iter()
            .chain(&fix.velocity_world)
            .chain(&fix.accuracies);
        for (number, value) in numbers.iter_mut().zip(values) {
            *number = *value;
        }
        if self.memory.horizon.is_none() && numbers.is_finite() {
            self.memory.alignment.add_position(&fix.position_world);
            return;
        }
        self.enqueue(Source::FixPosition, fix.kind, fix.time_ns, numbers);
    }

    /// Adds a field.
    pub fn add_field(&mut self, field: &Field) {
        let [x, y, z]: [f64; 3] = field.field_body.into();
        let numbers = [x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        if self.memory.horizon.is_none() && numbers.is_finite() {
            self.memory.alignment.add_field(&field.field_body);
            return;
        }
        self.enqueue(Source::Field, FixKind::SinglePoint, field.time_ns, numbers);
    }

    /// Adds an altitude.
    pub fn add_altitude(&mut self, altitude: &Altitude) {
        let mut numbers = [0.0; 9];
        numbers[0] = altitude.altitude;
        if self.memory.horizon.is_none() && numbers.is_finite() {
            self.memory.alignment.add_altitude(altitude.altitude);
            return;
        }
        self.enqueue(Source::Altitude, FixKind::SinglePoint, altitude.time_ns, numbers);
    }

    /// Adds the measured parts of a pose.
    pub fn add_pose(&mut self, pose: &Pose) {
        let kind = FixKind::SinglePoint;
        if let Some(position_world) = &pose.position_world
            && self.memory.horizon.is_some()
        {
            let [x, y, z]: [f64; 3] = (*position_world).into();
            let numbers = [x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            self.enqueue(Source::PosePosition, kind, pose.time_ns, numbers);
        }
        if let Some(world_from_body) = &pose.world_from_body {
            let numbers = to_row_major(world_from_body);
            if self.memory.horizon.is_none() && numbers.is_finite() {
                self.memory
                    .alignment
                    .add_attitude(world_from_body, &self.parameters);
                return;
            }
            self.enqueue(Source::PoseAttitude, kind, pose.time_ns, numbers);
        }
    }

    /// Adds a baseline; nothing without [`baseline_body`](Parameters::baseline_body).
    pub fn add_baseline(&mut self, baseline: &Baseline) {
        if self.parameters.baseline_body.is_none() {
            return;
        }
        let [x, y, z]: [f64; 3] = baseline.baseline_world.into();
        let [horizontal, vertical] = baseline.accuracies;
        let numbers = [x, y, z, horizontal, vertical, 0.0, 0.0, 0.0, 0.0];
        if self.memory.horizon.is_none() && numbers.is_finite() {
            self.memory.alignment.add_baseline(baseline, &self.parameters);
            return;
        }
        self.enqueue(Source::Baseline, FixKind::RtkFixed, baseline.time_ns, numbers);
    }

    /// Inserts a measurement into the queue, by its time.
    fn enqueue(&mut self, source: Source, kind: FixKind, time_ns: u64, numbers: [f64; 9]) {
        let memory = &mut self.memory;
        let latest_ns = memory.newest.time_ns.saturating_add(FUTURE_NS);
        let is_in_time = memory
            .horizon
            .as_ref()
            .is_some_and(|horizon| (horizon.time_ns..=latest_ns).contains(&time_ns));
        if !is_in_time || !numbers.is_finite() || memory.queued == QUEUE {
            let unusable = &mut memory.sources[source as usize].unusable;
            *unusable = unusable.saturating_add(1);
            return;
        }
        let waiting = &memory.queue[..memory.queued];
        let place = waiting.partition_point(|other| other.time_ns <= time_ns);
        memory.queue.copy_within(place..memory.queued, place + 1);
        memory.queue[place] = QueuedMeasurement {
            time_ns,
            numbers,
            source: source as u8,
            kind: kind as u8,
            pad0: [0; 6],
        };
        memory.queued += 1;
    }

    /// Adds a sample of the inertial measurement unit, and brings the state to its time. A sample that is not newer than the one
    /// before is refused. Returns by how much the measurements fused in this step have changed the present motion: its difference
    /// from the motion before, continued by the sample.
    pub fn add_imu(&mut self, sample: &ImuSample) -> Correction {
        let record = ImuRecord {
            time_ns: sample.time_ns,
            span_ns: sample.time_ns.saturating_sub(self.memory.newest.time_ns),
            rate_body: sample.rate_body.into(),
            force_body: sample.force_body.into(),
            is_clipped: sample.is_clipped.into(),
            pad0: [0; 7],
        };
        if record.span_ns == 0 || !record.is_finite() {
            return Correction::default();
        }
        self.memory.newest = record;
        if self.memory.horizon.is_none() {
            self.align(sample, seconds(record.span_ns));
            return Correction::default();
        }
        let mut is_corrected = self.memory.count == RING && self.process_oldest();
        let memory = &mut self.memory;
        memory.ring[(memory.first + memory.count) % RING] = record;
        memory.count += 1;
        while self.memory.count > 0
            && self.memory.ring[self.memory.first].time_ns + self.horizon_ns <= record.time_ns
        {
            is_corrected |= self.process_oldest();
        }
        self.predict(is_corrected)
    }

    /// Aligns a vehicle whose motors have been stopped for long enough: in hover the specific force shows no tilt.
    fn align(&mut self, sample: &ImuSample, h: f64) {
        let memory = &mut self.memory;
        if memory.motors_turn || sample.time_ns < memory.rest.from_ns {
            memory.alignment = Alignment::new_zeroed();
            return;
        }
        // The first sample has no beginning, and after a gap the vehicle may stand elsewhere.
        if h >= LONGEST_SPAN {
            memory.alignment = Alignment::new_zeroed();
            return;
        }
        memory.alignment.add_imu(&sample.rate_body, &sample.force_body, h);
        memory.horizon = memory.alignment.start(sample.time_ns, &self.parameters);
        if let Some(horizon) = &memory.horizon {
            memory.present = horizon.kinematics;
        }
    }

    /// Brings the motion to the time of the newest sample: by that sample alone, or from a corrected horizon. Returns what the
    /// correction has changed.
    fn predict(&mut self, is_corrected: bool) -> Correction {
        let memory = &mut self.memory;
        let Some(horizon) = &memory.horizon else {
            return Correction::default();
        };
        let step = |kinematics: Kinematics, record: &ImuRecord| {
            let unbiased = horizon
                .biases
                .removed_from(&record.rate_body.into(), &record.force_body.into());
            kinematics.advanced(&unbiased, seconds(record.span_ns))
        };
        let predicted = step(memory.present, &memory.newest);
        memory.present = if is_corrected {
            (0..memory.count)
                .map(|index| &memory.ring[(memory.first + index) % RING])
                .fold(horizon.kinematics, step)
        } else {
            predicted
        };
        Correction {
            position_world: memory.present.position_world - predicted.position_world,
            velocity_world: memory.present.velocity_world - predicted.velocity_world,
        }
    }

    /// Moves the horizon over the oldest sample, and fuses the measurements on the way. Returns whether the mean was corrected.
    fn process_oldest(&mut self) -> bool {
        let memory = &mut self.memory;
        let record = memory.ring[memory.first];
        memory.first = (memory.first + 1) % RING;
        memory.count -= 1;
        let Some(mut horizon) = memory.horizon.take() else {
            return false;
        };
        let mut is_corrected = false;
        while self.memory.queued > 0 && self.memory.queue[0].time_ns <= record.time_ns {
            let measurement = self.memory.queue[0];
            self.memory.queue.copy_within(1..self.memory.queued, 0);
            self.memory.queued -= 1;
            self.advance(&mut horizon, &record, measurement.time_ns);
            is_corrected |= self.fuse_queued(&mut horizon, &measurement, &record);
        }
        self.advance(&mut horizon, &record, record.time_ns);
        self.start_motors(&mut horizon);
        is_corrected |= self.rest(&mut horizon, &record);
        self.memory.horizon = Some(horizon);
        is_corrected
    }

    fn fix_errors(&self) -> &FixErrors {
        &self.parameters.fixes[self.memory.kind.unwrap_or(FixKind::SinglePoint) as usize]
    }

    /// Propagates the horizon to a time within a sample.
    fn advance(&self, horizon: &mut Horizon, record: &ImuRecord, to_ns: u64) {
        if to_ns <= horizon.time_ns {
            return;
        }
        let h = seconds(to_ns - horizon.time_ns);
        let unbiased = horizon
            .biases
            .removed_from(&record.rate_body.into(), &record.force_body.into());
        horizon.advance(&unbiased, h, &self.parameters, self.fix_errors());
        horizon.time_ns = to_ns;
        self.add_unmeasured(horizon, record, h);
    }

    /// Adds the variance of `h` s of a motion that was not measured: the part of the sample's up to the next measurement, which
    /// else would be compared with a motion that counts as known.
    fn add_unmeasured(&self, horizon: &mut Horizon, record: &ImuRecord, h: f64) {
        if record.span_ns <= LONGEST_IMU_PERIOD_NS && !record.is_clipped.is_set() {
            return;
        }
        horizon.carry(&self.parameters, self.fix_errors());
        // Over the whole sample the variances of velocity and attitude are those of a constant error.
        let h2 = h * seconds(record.span_ns);
        let [acceleration, rate] = if record.is_clipped.is_set() {
            BEYOND_RANGE
        } else {
            OVER_GAP
        };
        let in_velocity = acceleration * acceleration * h2;
        for (row, variance) in [
            (POSITION, 0.25 * h * h * in_velocity),
            (VELOCITY, in_velocity),
            (ATTITUDE, rate * rate * h2),
        ] {
            add_to_diagonal(&mut horizon.covariance, row, row, Vector3::repeat(variance));
        }
    }

    /// Lets the field of the vehicle change when its motors start.
    fn start_motors(&mut self, horizon: &mut Horizon) {
        if self
            .memory
            .starts_ns
            .is_some_and(|starts_ns| horizon.time_ns >= starts_ns)
        {
            self.memory.starts_ns = None;
            let deviation = self.parameters.field_arming_deviation;
            horizon.carry(&self.parameters, self.fix_errors());
            add_to_diagonal(
                &mut horizon.covariance,
                FIELD_BIAS,
                FIELD_BIAS,
                Vector3::repeat(deviation * deviation),
            );
        }
    }

    /// Corrects the state of a vehicle at rest. Returns whether it was.
    fn rest(&mut self, horizon: &mut Horizon, record: &ImuRecord) -> bool {
        let rest = &mut self.memory.rest;
        let mut sums = Rest {
            from_ns: rest.from_ns,
            until_ns: rest.until_ns,
            ground_z: rest.ground_z,
            ..Rest::new_zeroed()
        };
        if (rest.from_ns..rest.until_ns).contains(&horizon.time_ns) {
            let h = seconds(record.span_ns);
            let sum = |sum: [f64; 3], value: [f64; 3]| (Vector3::from(sum) + Vector3::from(value) * h).into();
            sums.span = rest.span + h;
            sums.turn_body = sum(rest.turn_body, record.rate_body);
            sums.push_body = sum(rest.push_body, record.force_body);
        }
        *rest = sums;
        if sums.span < REST_SPAN {
            return false;
        }
        (rest.span, rest.turn_body, rest.push_body) = (0.0, [0.0; 3], [0.0; 3]);
        let mean = |sum: [f64; 3]| Vector3::from(sum) / sums.span;
        let (rate, force) = (mean(sums.turn_body), mean(sums.push_body));
        let unbiased = horizon.biases.removed_from(&rate, &force);
        let is_still = unbiased.rate_body.norm() < STILL[0]
            && (unbiased.force_body.norm() - shared_types::GRAVITY).abs() < STILL[1];
        if !is_still {
            return false;
        }
        if !self.memory.motors_turn {
            self.memory.rest.ground_z = horizon.kinematics.position_world.z;
        }
        horizon.carry(&self.parameters, self.fix_errors());
        let time_ns = horizon.time_ns;
        let velocity = measurement::zero_velocity(&horizon.kinematics, REST_DEVIATION);
        self.fuse(horizon, Source::ZeroVelocity, time_ns, &velocity);
        let rate = measurement::resting_rate(&rate, sums.span, &horizon.biases, &self.parameters);
        self.fuse(horizon, Source::RestingRate, time_ns, &rate);
        true
    }

    /// Fuses a measurement whose time the horizon has reached. Returns whether the mean was corrected.
    fn fuse_queued(&mut self, horizon: &mut Horizon, queued: &QueuedMeasurement, record: &ImuRecord) -> bool {
        horizon.carry(&self.parameters, self.fix_errors());
        let numbers = &queued.numbers;
        let three = |at: usize| Vector3::from_row_slice(&numbers[at..at + 3]);
        let source = Source::ALL
            .into_iter()
            .find(|source| *source as u8 == queued.source);
        let kind = FixKind::ALL.into_iter().find(|kind| *kind as u8 == queued.kind);
        let (Some(source), Some(kind)) = (source, kind) else {
            return false;
        };
        match source {
            Source::FixPosition | Source::FixVelocity => {
                let fix = Fix {
                    time_ns: queued.time_ns,
                    kind,
                    position_world: three(0),
                    velocity_world: three(3),
                    accuracies: three(6).into(),
                };
                self.fuse_fix(horizon, &fix, &record.rate_body.into())
            }
            Source::Field => {
                let field = Field {
                    time_ns: queued.time_ns,
                    field_body: three(0),
                };
                self.fuse_field(horizon, &field)
            }
            Source::Altitude => {
                let altitude = Altitude {
                    time_ns: queued.time_ns,
                    altitude: numbers[0],
                };
                self.fuse_altitude(horizon, &altitude)
            }
            Source::PosePosition => self.fuse_pose_position(horizon, queued.time_ns, &three(0)),
            Source::PoseAttitude => {
                self.fuse_pose_attitude(horizon, queued.time_ns, &from_row_major(numbers))
            }
            Source::Baseline => {
                let baseline = Baseline {
                    time_ns: queued.time_ns,
                    baseline_world: three(0),
                    accuracies: [numbers[3], numbers[4]],
                };
                self.fuse_baseline(horizon, &baseline)
            }
            Source::ZeroVelocity | Source::RestingRate => false,
        }
    }

    fn fuse_fix(&mut self, horizon: &mut Horizon, fix: &Fix, rate_body: &Vector3<f64>) -> bool {
        let parameters = self.parameters;
        let errors = &parameters.fixes[fix.kind as usize];
        let slow_position = slow_position_variance(errors);
        let slow_velocity = Vector3::repeat(errors.velocity_slow * errors.velocity_slow);
        let forget_errors = |horizon: &mut Horizon| {
            horizon.biases.fix_position_world = Vector3::zeros();
            horizon.biases.fix_velocity_world = Vector3::zeros();
            horizon.forget(FIX_POSITION, slow_position);
            horizon.forget(FIX_VELOCITY, slow_velocity);
        };
        if self.memory.kind != Some(fix.kind) {
            self.memory.kind = Some(fix.kind);
            forget_errors(horizon);
        }

        let position =
            |horizon: &Horizon| measurement::position(fix, &horizon.kinematics, &horizon.biases, &parameters);
        let verdict = self.fuse(horizon, Source::FixPosition, fix.time_ns, &position(horizon));
        let mut is_corrected = verdict == Verdict::Fused;
        if verdict == Verdict::Overdue {
            forget_errors(horizon);
            is_corrected |= self.reset_position(horizon, &position);
        }

        let velocity = |horizon: &Horizon| {
            let rate = rate_body - horizon.biases.gyroscope_body;
            measurement::velocity(fix, &horizon.kinematics, &horizon.biases, &rate, &parameters)
        };
        let verdict = self.fuse(horizon, Source::FixVelocity, fix.time_ns, &velocity(horizon));
        is_corrected |= verdict == Verdict::Fused;
        if verdict == Verdict::Overdue {
            horizon.forget(VELOCITY, Vector3::repeat(FORGOTTEN[1]));
            let innovation = horizon.innovation(&velocity(horizon));
            is_corrected |= horizon.correct(&innovation);
        }
        is_corrected
    }

    fn fuse_field(&mut self, horizon: &mut Horizon, sample: &Field) -> bool {
        let parameters = self.parameters;
        let field =
            |horizon: &Horizon| measurement::field(sample, &horizon.kinematics, &horizon.biases, &parameters);
        let verdict = self.fuse(horizon, Source::Field, sample.time_ns, &field(horizon));
        if verdict == Verdict::Overdue {
            let deviation = parameters.field_bias_deviation + parameters.field_arming_deviation;
            horizon.forget(FIELD_BIAS, Vector3::repeat(deviation * deviation));
            horizon.biases.field_body += field(horizon).residual;
        }
        verdict != Verdict::Refused
    }

    fn fuse_altitude(&mut self, horizon: &mut Horizon, sample: &Altitude) -> bool {
        let mut altitude =
            measurement::altitude(sample, &horizon.kinematics, &horizon.biases, &self.parameters);
        let effect = self.parameters.altitude_ground_effect;
        let is_within = (-effect..0.0).contains(&altitude.residual.x);
        if is_within && self.memory.motors_turn && self.is_near_the_ground(horizon) {
            altitude.noise.x += (10.0 * effect) * (10.0 * effect);
        }
        let verdict = self.fuse(horizon, Source::Altitude, sample.time_ns, &altitude);
        if verdict == Verdict::Overdue {
            horizon.biases.altitude += altitude.residual.x;
        }
        verdict != Verdict::Refused
    }

    fn fuse_pose_position(&mut self, horizon: &mut Horizon, time_ns: u64, position: &Vector3<f64>) -> bool {
        let parameters = self.parameters;
        let measured =
            |horizon: &Horizon| measurement::pose_position(position, &horizon.kinematics, &parameters);
        let without = seconds(time_ns.saturating_sub(self.positioned_ns().unwrap_or(0)));
        let verdict = self.fuse(horizon, Source::PosePosition, time_ns, &measured(horizon));
        if verdict == Verdict::Overdue {
            // Poses do not measure the velocity, which is as wrong as the position: by 2 x/t after a constant acceleration.
            let drift = 2.0 * measured(horizon).residual.norm() / without;
            let deviation = drift.max(horizon.deviation(VELOCITY));
            horizon.forget(VELOCITY, Vector3::repeat(deviation * deviation));
            self.reset_position(horizon, &measured);
        }
        verdict != Verdict::Refused
    }

    fn fuse_pose_attitude(&mut self, horizon: &mut Horizon, time_ns: u64, attitude: &Matrix3<f64>) -> bool {
        let measured = measurement::pose_attitude(attitude, &horizon.kinematics, &self.parameters);
        let verdict = self.fuse(horizon, Source::PoseAttitude, time_ns, &measured);
        if verdict == Verdict::Overdue {
            horizon.forget(ATTITUDE, Vector3::repeat(FORGOTTEN[2]));
            let innovation = horizon.innovation(&measured);
            horizon.correct(&innovation);
        }
        verdict != Verdict::Refused
    }

    fn fuse_baseline(&mut self, horizon: &mut Horizon, sample: &Baseline) -> bool {
        let parameters = self.parameters;
        let Some(baseline_body) = parameters.baseline_body else {
            return false;
        };
        let measured = |horizon: &Horizon| {
            measurement::baseline(sample, &baseline_body, &horizon.kinematics, &parameters)
        };
        let verdict = self.fuse(horizon, Source::Baseline, sample.time_ns, &measured(horizon));
        if verdict == Verdict::Overdue {
            // Half a turn is too large for a linearised correction: the mean is turned first.
            let mean = horizon.kinematics.world_from_body * baseline_body;
            let (from, to) = (mean.xy(), sample.baseline_world.xy());
            horizon.turn(libm::atan2(from.perp(&to), from.dot(&to)), FORGOTTEN[2]);
            let innovation = horizon.innovation(&measured(horizon));
            horizon.correct(&innovation);
        }
        verdict != Verdict::Refused
    }

    /// Forgets the position, takes it from a measurement, and counts the jump.
    fn reset_position(
        &mut self,
        horizon: &mut Horizon,
        measured: &dyn Fn(&Horizon) -> Linearized<3>,
    ) -> bool {
        let before = horizon.kinematics.position_world;
        horizon.forget(POSITION, Vector3::repeat(FORGOTTEN[0]));
        let innovation = horizon.innovation(&measured(horizon));
        let is_corrected = horizon.correct(&innovation);
        self.memory.jump_world += horizon.kinematics.position_world - before;
        is_corrected
    }

    /// Returns whether poses are fused, so that no fix and no baseline needs to be accepted again.
    fn is_seen(&self, source: Source, time_ns: u64) -> bool {
        let status = match source {
            Source::FixPosition | Source::FixVelocity => self.source(Source::PosePosition),
            Source::Baseline => self.source(Source::PoseAttitude),
            _ => return false,
        };
        status.fused > 0 && time_ns.saturating_sub(status.fused_ns) <= SILENCE_NS
    }

    /// Returns whether a residual is that of the pose or baseline before it, which was refused, but for noise and drift. Of other
    /// sources it always is.
    fn is_repeated(&self, source: Source, time_ns: u64, residual: &[f64]) -> bool {
        let status = self.source(source);
        let three = |numbers: &[f64]| Vector3::from_row_slice(numbers);
        let (index, change) = match source {
            Source::PosePosition => (0, (three(residual) - three(&status.innovation)).norm()),
            // Half a turn is one about either direction of its axis.
            Source::PoseAttitude => (
                1,
                angle_between(&exp(&three(residual)), &exp(&three(&status.innovation))),
            ),
            // It counts at rest only, where the mean does not turn.
            Source::Baseline => {
                let change = (three(residual) - three(&status.innovation)).norm();
                return change
                    <= POSE_DEVIATIONS * measurement::baseline_deviations(&[0.0; 2], &self.parameters)[1];
            }
            _ => return true,
        };
        let h = seconds(time_ns.saturating_sub(status.refused_ns));
        change <= POSE_DRIFT[index] * h + POSE_DEVIATIONS * self.parameters.pose_deviations[index]
    }

    /// Returns whether the air below the rotors may be pressed against the ground on which the vehicle rested last.
    fn is_near_the_ground(&self, horizon: &Horizon) -> bool {
        let z = POSITION + 2;
        let height = self.memory.rest.ground_z - horizon.kinematics.position_world.z;
        height < NEAR_THE_GROUND * (1.0 + horizon.covariance[(z, z)].max(0.0).sqrt().min(0.5))
    }

    /// Corrects the horizon by a measurement within its gate, if it has one.
    fn fuse<const M: usize>(
        &mut self,
        horizon: &mut Horizon,
        source: Source,
        time_ns: u64,
        measured: &Linearized<M>,
    ) -> Verdict {
        let innovation = horizon.innovation(measured);
        let motors_turn = self.memory.motors_turn;
        let is_seen = self.is_seen(source, time_ns);
        let is_repeated = self.is_repeated(source, time_ns, measured.residual.as_slice());
        let positioned_ns = self.positioned_ns().unwrap_or(0);
        let status = &mut self.memory.sources[source as usize];
        status.innovation[..M].copy_from_slice(measured.residual.as_slice());
        status.variance[..M].copy_from_slice(innovation.variances().as_slice());
        // What is published must be finite.
        status.squared_distance = innovation.squared_distance().unwrap_or(f64::MAX).min(f64::MAX);
        let gate = match source {
            Source::Altitude => GATES[0],
            Source::FixPosition
            | Source::FixVelocity
            | Source::Field
            | Source::PosePosition
            | Source::PoseAttitude
            | Source::Baseline => GATES[1],
            // Motors that turn may carry a vehicle that is lighter than stated.
            Source::ZeroVelocity | Source::RestingRate if motors_turn => GATES[1],
            Source::ZeroVelocity | Source::RestingRate => f64::MAX,
        };
        if status.squared_distance <= gate && horizon.correct(&innovation) {
            (status.fused_ns, status.refused_since_ns) = (time_ns, u64::MAX);
            status.fused = status.fused.saturating_add(1);
            return Verdict::Fused;
        }
        status.refused = status.refused.saturating_add(1);
        // After a silence it is not known what the source would have measured.
        let is_in_a_row = is_repeated && time_ns.saturating_sub(status.refused_ns) <= SILENCE_NS;
        if status.refused_since_ns == u64::MAX || !is_in_a_row {
            status.refused_since_ns = time_ns;
        }
        status.refused_ns = time_ns;
        let drifts = time_ns.saturating_sub(positioned_ns) > SILENCE_NS;
        let patience_ns = match source {
            Source::PosePosition if drifts => SILENCE_NS.min(self.reset_after_ns),
            Source::PosePosition => u64::MAX,
            // In the air a wrong attitude is worse than an old one.
            Source::PoseAttitude | Source::Baseline if motors_turn => u64::MAX,
            Source::PoseAttitude if tilt(horizon, &status.innovation) > MOST_TILT => u64::MAX,
            Source::Baseline if !shows_heading(horizon, &status.innovation, &self.parameters) => u64::MAX,
            _ => self.reset_after_ns,
        };
        if is_seen || time_ns - status.refused_since_ns < patience_ns {
            return Verdict::Refused;
        }
        status.refused_since_ns = u64::MAX;
        status.resets = status.resets.saturating_add(1);
        Verdict::Overdue
    }
}

/// Returns whether a baseline with this residual (m) differs from the mean in the heading alone.
fn shows_heading(horizon: &Horizon, residual: &[f64; 3], parameters: &Parameters) -> bool {
    let r = &horizon.kinematics.world_from_body;
    parameters.baseline_body.is_some_and(|baseline_body| {
        let baseline_world = r * baseline_body + Vector3::from(*residual);
        is_baseline(
            &baseline_world,
            &baseline_body,
            &r.tr_mul(&Vector3::z()),
            &measurement::baseline_deviations(&[0.0; 2], parameters),
        )
    })
}

/// Returns the angle between the vertical of the mean and that of a pose with this residual, rad.
fn tilt(horizon: &Horizon, residual: &[f64; 3]) -> f64 {
    let down_body = horizon.kinematics.world_from_body.tr_mul(&Vector3::z());
    (exp(&Vector3::from(*residual)).tr_mul(&down_body) - down_body).norm()
}
