//! Feed of receivers: from packets to samples with their times of validity.
//!
//! An autopilot's `HIGHRES_IMU` has inertial samples, fields and altitudes; fixes are `NAV-PVT` of a receiver, or, while none has
//! come, `GPS_RAW_INT` of an autopilot; baselines of two antennas are `NAV-RELPOSNED` of a receiver whose first antenna moves, which need
//! not be that of the fixes. The first sender of each is used, packets of others are counted. If it is silent, the same
//! autopilot by another source replaces it, or another receiver.
//!
//! **Times.** A stamp is mapped by the arrivals to the machine's monotonic clock ([`RemoteClock`]), as if the fastest packet had
//! taken the stated latency. `NAV-PVT` is mapped in the same way, by its time of the week: by UTC a fix would be as wrong as this
//! machine's clock, and the clock may be set in flight.
//!
//! **Spans** of inertial samples are those of the autopilot's stamps, because a rate is integrated over them: where the relation of the
//! clocks moves, times follow it by 1 % of a span. After a move of more than 10 ms there is a gap, which the filter knows; after one
//! back more motion may be missing than the gap is long.
//!
//! **Samples.** The mean of the inertial samples since the publication before is published, with the time of the last one, so that
//! rates need not agree; of other sensors the newest sample.
//!
//! **Altitudes** are above a pressure level. The first one counts as that of the vehicle on the ground, where the scenario states
//! it; a driver that is started in flight without a memory publishes none.
//!
//! `GPS_RAW_INT` has no vertical velocity, so that its velocity is published with an accuracy with which nothing follows from it.
//!
//! Failure policy: a packet without a known time, or that is not newer than the one before, is counted and dropped.

use std::collections::VecDeque;

use motion_capture::clock::{ClockLine, Mapped, RemoteClock};
use navigation_receivers::Packet;
use navigation_receivers::autopilot::{GpsRawInt, HighresImu};
use navigation_receivers::ubx::{Carrier, NavPvt, RelativePosition};
use shared_types::gnss::FixKind;
use shared_types::navigation_limits::LONGEST_IMU_PERIOD_NS;
use shared_types::receiver_figures::ReceiverFigures;
use shared_types::sample::{Field, Flag};
use shared_types::samples::{GnssBaseline, GnssFix};
use shared_types::wiring::PlantOutputs;
use zerocopy::FromZeros;

/// Samples of a sensor that wait for their tick.
const WAITING: usize = 64;
/// Maximum age of a sample on arrival, and of a memory, ns.
const MAX_AGE_NS: u64 = 2_000_000_000;
/// Silence after which another sender replaces that of fixes, ns.
const FIX_SILENCE_NS: u64 = 1_000_000_000;
/// The same of inertial samples, ns.
const IMU_SILENCE_NS: u64 = 100_000_000;
/// Distance of a time from the clock's line up to which it continues by the stamps, ns.
const FOLLOWS_NS: u64 = LONGEST_IMU_PERIOD_NS;
/// Share of a span by which its end comes nearer to the line.
const FOLLOWS_BY: i64 = 100;
/// Length of a week, ns.
const WEEK_NS: i64 = 604_800_000_000_000;
/// Accuracy of a velocity from which nothing follows, m/s.
const UNKNOWN_VELOCITY: f64 = 100.0;
/// Time over which rates are measured, ns.
const SECOND_NS: u64 = 1_000_000_000;

/// Sender of a sensor's packets. MAVLink has no system 0, which stands for UBX.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Origin {
    source: u8,
    system: u8,
    component: u8,
}

impl Origin {
    fn new(source: u8, system: u8, component: u8) -> Self {
        Self {
            source,
            system,
            component,
        }
    }

    /// Returns whether a sender may replace another one that is silent: the same autopilot by another source, or another receiver. The
    /// autopilot of another vehicle may not.
    fn may_replace(self, other: Self) -> bool {
        (self.system, self.component) == (other.system, other.component)
    }
}

/// Clock of a sensor's sender, and its last sample.
#[derive(Clone, Debug, Default)]
struct Timeline {
    origin: Option<Origin>,
    clock: RemoteClock,
    /// Stamp of the last sample.
    last_stamp_ns: Option<i64>,
    /// Arrival of the last packet of this sender, ns of the local clock.
    arrived_ns: u64,
    /// Time of the last sample, ns of the local clock.
    last_ns: u64,
}

/// What the times of a sensor's samples are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Times {
    /// A motion is integrated over the spans between them.
    Spans,
    /// Each stands for itself.
    Instants,
}

impl Timeline {
    /// Returns whether packets of a sender are used. The first sender is, a receiver instead of an autopilot, and a sender that replaces
    /// one from which nothing has arrived for a silence. Its clock is another one, and samples remain in order.
    fn is_from(&mut self, origin: Origin, arrived_ns: u64, silence_ns: u64) -> bool {
        let is_silent = arrived_ns.saturating_sub(self.arrived_ns) > silence_ns;
        let is_better = |used: Origin| {
            used.system != 0 && origin.system == 0 || used != origin && is_silent && origin.may_replace(used)
        };
        if self.origin.is_none_or(is_better) {
            *self = Self {
                origin: Some(origin),
                last_ns: self.last_ns,
                ..Self::default()
            };
        }
        let is_used = self.origin == Some(origin);
        if is_used {
            self.arrived_ns = arrived_ns;
        }
        is_used
    }

    /// Returns the time of a sample, ns of the local clock.
    fn measured_ns(
        &mut self,
        times: Times,
        stamp_ns: i64,
        arrived_ns: u64,
        latency_ns: u64,
        figures: &mut ReceiverFigures,
    ) -> Option<u64> {
        let sent_ns = match self.clock.map(stamp_ns, arrived_ns) {
            Mapped::At(sent_ns) => sent_ns,
            Mapped::Collecting => {
                figures.unsettled += 1;
                return None;
            }
            Mapped::Rejected => {
                figures.mistimed += 1;
                return None;
            }
            Mapped::Stepped => {
                figures.clock_steps += 1;
                self.last_stamp_ns = None;
                return None;
            }
        };
        if self.last_stamp_ns.is_some_and(|last| stamp_ns <= last) {
            figures.repeated += 1;
            return None;
        }
        let by_line_ns = u64::try_from(sent_ns)
            .unwrap_or(0)
            .min(arrived_ns)
            .saturating_sub(latency_ns);
        let measured_ns = match times {
            Times::Spans => self.continued_ns(stamp_ns, by_line_ns),
            Times::Instants => Some(by_line_ns),
        };
        let is_possible = |measured_ns: &u64| {
            *measured_ns > self.last_ns && arrived_ns.saturating_sub(*measured_ns) <= MAX_AGE_NS
        };
        let Some(measured_ns) = measured_ns.filter(is_possible) else {
            figures.mistimed += 1;
            return None;
        };
        (self.last_stamp_ns, self.last_ns) = (Some(stamp_ns), measured_ns);
        Some(measured_ns)
    }

    /// Returns the time of a sample that continues the last one by their stamps, and approaches that by the clock's line, ns of the local
    /// clock. Where the two are far apart it is that by the line, once the span is long enough for a gap; `None` until then.
    fn continued_ns(&self, stamp_ns: i64, by_line_ns: u64) -> Option<u64> {
        let Some(last_stamp_ns) = self.last_stamp_ns else {
            return Some(by_line_ns);
        };
        let span_ns = stamp_ns.saturating_sub(last_stamp_ns);
        let continued_ns = self.last_ns.saturating_add_signed(span_ns);
        let behind_ns = by_line_ns.checked_signed_diff(continued_ns)?;
        if behind_ns.unsigned_abs() > FOLLOWS_NS {
            return Some(by_line_ns).filter(|time_ns| *time_ns > self.last_ns + FOLLOWS_NS);
        }
        let most_ns = span_ns / FOLLOWS_BY;
        Some(continued_ns.saturating_add_signed(behind_ns.clamp(-most_ns, most_ns)))
    }

    fn save(&self) -> TimelineMemory {
        let line = self.clock.line();
        let origin = self
            .origin
            .map(|origin| [origin.source, origin.system, origin.component]);
        TimelineMemory {
            line_arrived_ns: line.map_or(0, |line| line.arrived_ns),
            offset_ns: line.map_or(0, |line| line.offset_ns),
            slope: line.map_or(0.0, |line| line.slope),
            last_stamp_ns: self.last_stamp_ns.unwrap_or(i64::MIN),
            last_ns: self.last_ns,
            origin: origin.unwrap_or_default(),
            has_origin: origin.is_some().into(),
            is_timed: line.is_some().into(),
            pad0: [0; 3],
        }
    }

    /// Makes the timeline of a memory, whose last packet arrived at a time of the local clock, ns.
    fn restored(memory: &TimelineMemory, arrived_ns: u64) -> Self {
        let [source, system, component] = memory.origin;
        let line = ClockLine {
            arrived_ns: memory.line_arrived_ns,
            offset_ns: memory.offset_ns,
            slope: memory.slope,
        };
        Self {
            origin: memory
                .has_origin
                .is_set()
                .then(|| Origin::new(source, system, component)),
            arrived_ns,
            clock: match memory.is_timed.is_set() {
                true => RemoteClock::with_line(line),
                false => RemoteClock::new(),
            },
            last_stamp_ns: Some(memory.last_stamp_ns).filter(|stamp| *stamp != i64::MIN),
            last_ns: memory.last_ns,
        }
    }
}

shared_types::sample! {
    /// Memory of a sender's clock. Times are of the local clock.
    pub struct TimelineMemory {
        /// Arrival of the packet through which the clock's line goes, ns.
        pub line_arrived_ns: u64,
        /// Its arrival minus its stamp, ns.
        pub offset_ns: i64,
        /// Rate at which the local clock gains on the sender's.
        pub slope: f64,
        /// Stamp of the last sample, ns of the sender's clock; the least number for none.
        pub last_stamp_ns: i64,
        /// Time of the last sample, ns.
        pub last_ns: u64,
        /// The sender: source, system, component.
        pub origin: [u8; 3],
        /// `true` if there is a sender.
        pub has_origin: Flag,
        /// `true` if the clock's line is known.
        pub is_timed: Flag,
        /// Explicit padding.
        pub pad0: [u8; 3],
    }

    /// Memory of a feed, so that a restarted driver continues with the clocks and the altitude of its predecessor.
    pub struct ReceiverMemory {
        /// Arrival of the last packet, ns of the local clock; 0 before the first.
        pub arrived_ns: u64,
        /// Clock of the inertial samples.
        pub motion: TimelineMemory,
        /// Clock of the fixes.
        pub fixes: TimelineMemory,
        /// Clock of the baselines.
        pub baselines: TimelineMemory,
        /// Time of the week of the last `NAV-PVT`, ns, which continues at the end of a week.
        pub week_stamp_ns: i64,
        /// The same of the last `NAV-RELPOSNED`.
        pub baseline_stamp_ns: i64,
        /// Altitude by the barometer of the origin of {I}, m.
        pub altitude_of_origin: f64,
        /// `true` if this altitude is known.
        pub has_altitude: Flag,
        /// Explicit padding.
        pub pad0: [u8; 7],
    }
}

/// Samples of a sensor that wait for their tick, oldest first, with their times, ns of the local clock.
#[derive(Clone, Debug)]
struct Waiting<T>(VecDeque<(u64, T)>);

impl<T> Default for Waiting<T> {
    fn default() -> Self {
        Self(VecDeque::with_capacity(WAITING))
    }
}

impl<T> Waiting<T> {
    /// Adds a sample. Returns the number of samples that are dropped for it.
    fn push(&mut self, measured_ns: u64, sample: T) -> u64 {
        let is_full = self.0.len() == WAITING;
        if is_full {
            self.0.pop_front();
        }
        self.0.push_back((measured_ns, sample));
        u64::from(is_full)
    }

    /// Removes the next sample that was measured by a time.
    fn next_by(&mut self, tick_ns: u64) -> Option<(u64, T)> {
        self.0.pop_front_if(|(measured_ns, _)| *measured_ns <= tick_ns)
    }

    /// Removes all samples by a time. Returns the newest of a flight that began at `start_ns`, with its time since then, and counts the
    /// others.
    fn newest_by(&mut self, tick_ns: u64, start_ns: u64, left_out: &mut u64) -> Option<(u64, T)> {
        let (mut measured_ns, mut sample) = self.next_by(tick_ns)?;
        let mut others = 0;
        while let Some(next) = self.next_by(tick_ns) {
            (measured_ns, sample) = next;
            others += 1;
        }
        let since_start_ns = measured_ns.checked_sub(start_ns)?;
        *left_out += others;
        Some((since_start_ns, sample))
    }
}

/// Angular velocity, rad/s, and specific force, m/s², in {B}.
type Inertial = [[f64; 3]; 2];

/// Filter from packets to samples.
#[derive(Debug)]
pub(super) struct ReceiverFeed {
    latency_ns: u64,
    fix_latency_ns: u64,
    /// Altitude of the vehicle on the ground above the origin of {I}, m.
    ground_altitude: f64,
    /// `false` after a start in flight.
    is_on_ground: bool,
    /// `true` if the flight has `gnss/baseline`.
    uses_baselines: bool,
    altitude_of_origin: Option<f64>,
    motion: Timeline,
    fixes: Timeline,
    baselines: Timeline,
    week_stamp_ns: i64,
    baseline_stamp_ns: i64,
    arrived_ns: u64,
    inertial: Waiting<Inertial>,
    fix: Waiting<GnssFix>,
    baseline: Waiting<GnssBaseline>,
    altitude: Waiting<f64>,
    field: Waiting<[f64; 3]>,
    figures: ReceiverFigures,
    second_began_ns: u64,
    in_second: [u64; 4],
}

impl ReceiverFeed {
    /// Makes a feed with these latencies, ns, of a vehicle on the ground at an altitude above the origin of {I}, m, or in flight.
    pub(super) fn new(
        [latency_ns, fix_latency_ns]: [u64; 2],
        ground_altitude: f64,
        is_on_ground: bool,
    ) -> Self {
        Self {
            latency_ns,
            fix_latency_ns,
            ground_altitude,
            is_on_ground,
            uses_baselines: false,
            altitude_of_origin: None,
            motion: Timeline::default(),
            fixes: Timeline::default(),
            baselines: Timeline::default(),
            week_stamp_ns: 0,
            baseline_stamp_ns: 0,
            arrived_ns: 0,
            inertial: Waiting::default(),
            fix: Waiting::default(),
            baseline: Waiting::default(),
            altitude: Waiting::default(),
            field: Waiting::default(),
            figures: ReceiverFigures::new_zeroed(),
            second_began_ns: 0,
            in_second: [0; 4],
        }
    }

    /// Uses baselines of two antennas, or not.
    pub(super) fn with_baselines(mut self, uses_baselines: bool) -> Self {
        self.uses_baselines = uses_baselines;
        self
    }

    /// Adds a packet of a source with its arrival, ns of the local clock, never decreasing.
    pub(super) fn add(&mut self, packet: &Packet, source: u8, arrived_ns: u64) {
        self.figures.packets += 1;
        self.arrived_ns = arrived_ns;
        match packet {
            Packet::HighresImu(sender, sample) => {
                self.add_inertial(
                    sample,
                    Origin::new(source, sender.system, sender.component),
                    arrived_ns,
                );
            }
            Packet::NavPvt(pvt) => {
                if let Some(fix) = self.used_fix(fix_of_receiver(pvt), Origin::new(source, 0, 0), arrived_ns)
                {
                    let stamp_ns = in_week(pvt.time_of_week_ms, &mut self.week_stamp_ns);
                    self.add_fix(fix, stamp_ns, arrived_ns);
                }
            }
            Packet::GpsRawInt(sender, packet) => {
                let origin = Origin::new(source, sender.system, sender.component);
                if let Some(fix) = self.used_fix(fix_of_autopilot(packet), origin, arrived_ns) {
                    self.add_fix(fix, microseconds(packet.time_us), arrived_ns);
                }
            }
            Packet::RelativePosition(relative) if self.uses_baselines => {
                self.add_baseline(relative, Origin::new(source, 0, 0), arrived_ns);
            }
            // Not measurements.
            Packet::Heartbeat(..) | Packet::Odometry(..) | Packet::RelativePosition(_) => {}
        }
    }

    fn add_inertial(&mut self, sample: &HighresImu, origin: Origin, arrived_ns: u64) {
        if !self.motion.is_from(origin, arrived_ns, IMU_SILENCE_NS) {
            self.figures.foreign += 1;
            return;
        }
        let stamp_ns = microseconds(sample.time_us);
        let Some(measured_ns) = self.motion.measured_ns(
            Times::Spans,
            stamp_ns,
            arrived_ns,
            self.latency_ns,
            &mut self.figures,
        ) else {
            return;
        };
        let mut dropped = 0;
        if let (Some(rate), Some(force)) = (sample.angular_velocity_body, sample.specific_force_body) {
            dropped += self.inertial.push(measured_ns, [rate, force]);
            self.count(ReceiverFigures::IMU, arrived_ns);
        }
        if let Some(field) = sample.field_body {
            dropped += self.field.push(measured_ns, field);
            self.count(ReceiverFigures::FIELD, arrived_ns);
        }
        if let Some(altitude) = sample.pressure_altitude {
            if self.altitude_of_origin.is_none() && self.is_on_ground {
                self.altitude_of_origin = Some(altitude - self.ground_altitude);
            }
            if let Some(of_origin) = self.altitude_of_origin {
                dropped += self.altitude.push(measured_ns, altitude - of_origin);
                self.count(ReceiverFigures::ALTITUDE, arrived_ns);
            }
        }
        self.figures.left_out += dropped;
    }

    /// Returns a sender's fix if it is used, and counts others. A sender without a position keeps no place from another one, nor does
    /// the second of two antennas take that of the first, whose place on the vehicle is another one.
    fn used_fix(&mut self, fix: Option<GnssFix>, origin: Origin, arrived_ns: u64) -> Option<GnssFix> {
        if fix.is_none() {
            self.figures.without_position += 1;
            return None;
        }
        let is_second = |used: Origin| used != origin && [used.system, origin.system] == [0; 2];
        let is_used = !(self.uses_baselines && self.fixes.origin.is_some_and(is_second))
            && self.fixes.is_from(origin, arrived_ns, FIX_SILENCE_NS);
        self.figures.foreign += u64::from(!is_used);
        fix.filter(|_| is_used)
    }

    fn add_fix(&mut self, fix: GnssFix, stamp_ns: i64, arrived_ns: u64) {
        let Some(valid_ns) = self.fixes.measured_ns(
            Times::Instants,
            stamp_ns,
            arrived_ns,
            self.fix_latency_ns,
            &mut self.figures,
        ) else {
            return;
        };
        self.figures.left_out += self.fix.push(valid_ns, fix);
        self.count(ReceiverFigures::FIX, arrived_ns);
    }

    fn add_baseline(&mut self, relative: &RelativePosition, origin: Origin, arrived_ns: u64) {
        // That of a base station is no baseline of the vehicle.
        if !relative.is_moving || !self.baselines.is_from(origin, arrived_ns, FIX_SILENCE_NS) {
            self.figures.foreign += 1;
            return;
        }
        let stamp_ns = in_week(relative.time_of_week_ms, &mut self.baseline_stamp_ns);
        let Some(valid_ns) = self.baselines.measured_ns(
            Times::Instants,
            stamp_ns,
            arrived_ns,
            self.fix_latency_ns,
            &mut self.figures,
        ) else {
            return;
        };
        if !relative.is_valid || relative.carrier == Carrier::None {
            self.figures.without_position += 1;
            return;
        }
        let baseline = GnssBaseline {
            baseline_ned: relative.baseline_ned,
            accuracies_ned: relative.accuracies_ned,
            fixed: (relative.carrier == Carrier::Fixed && relative.heading.is_some()).into(),
            measured: true.into(),
            ..GnssBaseline::new_zeroed()
        };
        self.figures.left_out += self.baseline.push(valid_ns, baseline);
    }

    fn count(&mut self, sensor: usize, arrived_ns: u64) {
        self.figures.samples[sensor] += 1;
        self.figures.arrived_ns[sensor] = arrived_ns;
        self.in_second[sensor] += 1;
    }

    /// Counts packets that were dropped before they were added.
    pub(super) fn add_left_out(&mut self, count: u64) {
        self.figures.left_out += count;
    }

    /// Writes the samples that are due at a tick that begins at `tick_ns` into outputs of a flight that began at `start_ns`, both ns
    /// of the local clock.
    pub(super) fn publish(&mut self, tick_ns: u64, start_ns: u64, outputs: &mut PlantOutputs<'_>) {
        let left_out = &mut self.figures.left_out;
        if let Some(sample) = outputs.imu.due() {
            let mut sum: Inertial = [[0.0; 3]; 2];
            let mut count = 0.0;
            let mut last_ns = 0;
            while let Some((measured_ns, inertial)) = self.inertial.next_by(tick_ns) {
                if let Some(since_start_ns) = measured_ns.checked_sub(start_ns) {
                    for (sum, value) in sum.as_flattened_mut().iter_mut().zip(inertial.as_flattened()) {
                        *sum += value;
                    }
                    count += 1.0;
                    last_ns = since_start_ns;
                }
            }
            if count > 0.0 {
                [sample.angular_velocity_body, sample.specific_force_body] =
                    sum.map(|vector| vector.map(|component| component / count));
                sample.measured_ns = last_ns;
                sample.measured = true.into();
            }
        }
        if let Some(sample) = outputs.fix.due()
            && let Some((valid_ns, fix)) = self.fix.newest_by(tick_ns, start_ns, left_out)
        {
            *sample = GnssFix {
                header: sample.header,
                valid_ns,
                ..fix
            };
        }
        if let Some(sample) = outputs.baseline.due()
            && let Some((valid_ns, baseline)) = self.baseline.newest_by(tick_ns, start_ns, left_out)
        {
            *sample = GnssBaseline {
                header: sample.header,
                valid_ns,
                ..baseline
            };
        }
        if let Some(sample) = outputs.altitude.due()
            && let Some((measured_ns, altitude)) = self.altitude.newest_by(tick_ns, start_ns, left_out)
        {
            sample.measured_ns = measured_ns;
            sample.altitude = altitude;
            sample.measured = true.into();
        }
        if let Some(sample) = outputs.field.due()
            && let Some((measured_ns, field)) = self.field.newest_by(tick_ns, start_ns, left_out)
        {
            sample.measured_ns = measured_ns;
            sample.field_body = field;
            sample.measured = true.into();
        }
    }

    /// Returns the figures at a time, of a flight that began at `start_ns`, both ns of the local clock.
    pub(super) fn figures(&mut self, now_ns: u64, start_ns: u64) -> ReceiverFigures {
        let lasts_ns = now_ns.saturating_sub(self.second_began_ns);
        if lasts_ns >= SECOND_NS {
            let counts = std::mem::take(&mut self.in_second);
            self.figures.rates = counts.map(|count| count as f64 * 1e9 / lasts_ns as f64);
            self.second_began_ns = now_ns;
        }
        ReceiverFigures {
            arrived_ns: self
                .figures
                .arrived_ns
                .map(|arrived_ns| arrived_ns.saturating_sub(start_ns)),
            ..self.figures
        }
    }

    /// Returns the state.
    pub(super) fn save(&self) -> ReceiverMemory {
        ReceiverMemory {
            arrived_ns: self.arrived_ns,
            motion: self.motion.save(),
            fixes: self.fixes.save(),
            baselines: self.baselines.save(),
            week_stamp_ns: self.week_stamp_ns,
            baseline_stamp_ns: self.baseline_stamp_ns,
            altitude_of_origin: self.altitude_of_origin.unwrap_or(0.0),
            has_altitude: self.altitude_of_origin.is_some().into(),
            pad0: [0; 7],
        }
    }

    /// Restores a state at a time of the local clock, ns. The altitude holds for the whole flight; clocks that are too old do not.
    pub(super) fn restore(&mut self, memory: &ReceiverMemory, now_ns: u64) {
        if !memory.is_finite() {
            return;
        }
        self.altitude_of_origin = memory.has_altitude.is_set().then_some(memory.altitude_of_origin);
        if now_ns.saturating_sub(memory.arrived_ns) <= MAX_AGE_NS {
            self.arrived_ns = memory.arrived_ns;
            self.motion = Timeline::restored(&memory.motion, memory.arrived_ns);
            self.fixes = Timeline::restored(&memory.fixes, memory.arrived_ns);
            self.baselines = Timeline::restored(&memory.baselines, memory.arrived_ns);
            self.week_stamp_ns = memory.week_stamp_ns;
            self.baseline_stamp_ns = memory.baseline_stamp_ns;
        }
    }
}

/// Returns a time of the week, ns, which continues at the end of a week: that of the week which is nearest to the stamp before, so that
/// a late packet of the old week does not begin another one.
fn in_week(time_of_week_ms: u32, stamp_ns: &mut i64) -> i64 {
    let half_ns = WEEK_NS / 2;
    let after_ns = i64::from(time_of_week_ms) * 1_000_000 - *stamp_ns;
    *stamp_ns += (after_ns + half_ns).rem_euclid(WEEK_NS) - half_ns;
    *stamp_ns
}

fn microseconds(time_us: u64) -> i64 {
    i64::try_from(time_us).unwrap_or(i64::MAX).saturating_mul(1000)
}

/// Makes a fix, without its header and its time, of `NAV-PVT`; `None` without a position.
fn fix_of_receiver(pvt: &NavPvt) -> Option<GnssFix> {
    Some(GnssFix {
        latitude: pvt.latitude,
        longitude: pvt.longitude,
        height: pvt.height,
        velocity_ned: pvt.velocity_ned,
        horizontal_accuracy: pvt.horizontal_accuracy,
        vertical_accuracy: pvt.vertical_accuracy,
        speed_accuracy: pvt.speed_accuracy,
        ..fix_of_kind(pvt.kind()?)
    })
}

/// Makes a fix, without its header and its time, of `GPS_RAW_INT`; `None` without a position above the ellipsoid and its accuracies.
fn fix_of_autopilot(fix: &GpsRawInt) -> Option<GnssFix> {
    let [horizontal_accuracy, vertical_accuracy, _] = fix.accuracies?;
    Some(GnssFix {
        latitude: fix.latitude,
        longitude: fix.longitude,
        height: fix.height?,
        horizontal_accuracy,
        vertical_accuracy,
        speed_accuracy: UNKNOWN_VELOCITY,
        ..fix_of_kind(fix.kind()?)
    })
}

fn fix_of_kind(kind: FixKind) -> GnssFix {
    GnssFix {
        kind: kind as u8,
        measured: true.into(),
        ..GnssFix::new_zeroed()
    }
}

#[cfg(test)]
mod tests;
