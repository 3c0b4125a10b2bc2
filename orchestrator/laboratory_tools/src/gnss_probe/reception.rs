//! What `gerono gnss probe` has received, and what follows from it.

use std::fmt::Write;

use navigation_receivers::Packet;
use navigation_receivers::counts::{Counts, Message, Reason};
use navigation_receivers::ubx::{Carrier, RelativePosition};
use shared_types::gnss::FixKind;
use shared_types::receiver_source::ReceiverSource;

/// Least rate of fixes for a flight, Hz.
const LEAST_RATE: f64 = 5.0;
/// Least rate of inertial samples for a flight, Hz: two spans of the filter's largest one of 10 ms.
const LEAST_INERTIAL: f64 = 200.0;
/// Largest field that can be that of the Earth with the iron of a vehicle, G.
const FIELD: f64 = 2.0;
/// Number of periods without a packet that are a gap.
const GAP: f64 = 3.0;
/// Reported deviations beyond which PX4 does not arm: of the horizontal position, of the height (m), of the speed (m/s).
const ACCURACIES: [f64; 3] = [3.0, 5.0, 0.5];
/// Least number of satellites with which PX4 arms.
const SATELLITES: u8 = 6;
/// Age of a fix on arrival beyond which the filter's defaults refuse it, s.
const HORIZON: f64 = 0.12;
/// Ages that are those of fixes and not of clocks that differ, s.
const AGES: std::ops::Range<f64> = -0.01..2.0;
/// Share of a serial line's capacity beyond which packets wait.
const FULL: f64 = 0.8;

/// Time of the arrival of a packet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Arrival {
    /// Since the start, s.
    pub seconds: f64,
    /// By this machine's clock, ns since 1970.
    pub utc_ns: i64,
}

/// Packets of one message.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Packets {
    count: u64,
    /// Number since the last printed line.
    recent: u64,
    first: f64,
    last: f64,
    /// Largest time between two, s.
    gap: f64,
}

impl Packets {
    /// Adds a packet at a time, s.
    fn add(&mut self, time: f64) {
        if self.count == 0 {
            self.first = time;
        } else {
            self.gap = self.gap.max(time - self.last);
        }
        self.last = time;
        self.count += 1;
        self.recent += 1;
    }

    /// Returns the rate between the first and the last, Hz; 0 for less than two.
    fn rate(&self) -> f64 {
        let span = self.last - self.first;
        if span > 0.0 {
            (self.count - 1) as f64 / span
        } else {
            0.0
        }
    }
}

/// Fix of a receiver, as far as it is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Fix {
    kind: Option<FixKind>,
    satellites: Option<u8>,
    accuracies: Option<[f64; 3]>,
    has_corrections: bool,
    has_vertical_velocity: bool,
}

/// Baselines of two antennas with a heading.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Baselines {
    /// Shortest and longest, m.
    lengths: [f64; 2],
    /// How far the rover of the newest is below the moving base, m.
    down: f64,
    /// Direction of the newest from true north to the right, rad.
    heading: f64,
}

impl Baselines {
    const NONE: Self = Self {
        lengths: [f64::INFINITY, 0.0],
        down: 0.0,
        heading: 0.0,
    };

    fn add(&mut self, relative: &RelativePosition, heading: f64) {
        let [shortest, longest] = self.lengths;
        self.lengths = [shortest.min(relative.length), longest.max(relative.length)];
        (self.down, self.heading) = (relative.baseline_ned[2], heading);
    }
}

/// Everything that was received.
#[derive(Clone, Debug, Default)]
pub(super) struct Reception {
    packets: [Packets; Message::ALL.len()],
    /// Fixes without a position, and of each kind.
    kinds: [u64; 4],
    newest: Option<Fix>,
    /// The newest latitude and longitude, degrees, and height above the ellipsoid, m.
    position: Option<[f64; 3]>,
    /// Ages on arrival, s.
    ages: Vec<f64>,
    recent_age: Option<f64>,
    /// Norm of the newest magnetic field, G.
    field: Option<f64>,
    baselines: Option<Baselines>,
    /// Duration of a live reception, s.
    pub listened: Option<f64>,
    /// Speed of a serial line, baud.
    pub line: Option<u32>,
}

/// Names of the kinds of fixes.
fn name(kind: Option<FixKind>) -> &'static str {
    match kind {
        None => "no position",
        Some(FixKind::SinglePoint) => "single point",
        Some(FixKind::RtkFloat) => "RTK float",
        Some(FixKind::RtkFixed) => "RTK fixed",
    }
}

impl Reception {
    /// Adds a packet; one of a file has no arrival, so that its own time counts.
    pub fn add(&mut self, packet: &Packet, arrival: Option<Arrival>) {
        let time = arrival.map_or_else(|| stamp(packet), |arrival| Some(arrival.seconds));
        let packets = &mut self.packets[packet.message() as usize];
        packets.add(time.unwrap_or(packets.last));
        match packet {
            Packet::NavPvt(pvt) => {
                self.add_position(pvt.kind(), [pvt.latitude, pvt.longitude, pvt.height]);
                self.add_fix(Fix {
                    kind: pvt.kind(),
                    satellites: Some(pvt.satellites),
                    accuracies: Some([pvt.horizontal_accuracy, pvt.vertical_accuracy, pvt.speed_accuracy]),
                    has_corrections: pvt.has_corrections,
                    has_vertical_velocity: true,
                });
                if let (Some(arrival), Some(valid_ns)) = (arrival, pvt.utc_ns) {
                    let age = (arrival.utc_ns - valid_ns) as f64 * 1e-9;
                    self.ages.push(age);
                    self.recent_age = Some(age);
                }
            }
            Packet::GpsRawInt(_, fix) => {
                if let Some(height) = fix.height {
                    self.add_position(fix.kind(), [fix.latitude, fix.longitude, height]);
                }
                self.add_fix(Fix {
                    kind: fix.kind(),
                    satellites: fix.satellites,
                    accuracies: fix.accuracies,
                    has_corrections: fix.fix_type >= 4,
                    has_vertical_velocity: false,
                });
            }
            Packet::RelativePosition(relative) => {
                let is_used = relative.is_valid && relative.is_moving && relative.carrier == Carrier::Fixed;
                let heading = relative.heading.filter(|_| is_used);
                if let Some(heading) = heading {
                    let baselines = self.baselines.get_or_insert(Baselines::NONE);
                    baselines.add(relative, heading.angle);
                }
            }
            Packet::HighresImu(_, measured) => {
                let norm = |field: [f64; 3]| field.iter().map(|part| part * part).sum::<f64>().sqrt();
                self.field = measured.field_body.map(norm).or(self.field);
            }
            Packet::Odometry(..) | Packet::Heartbeat(..) => {}
        }
    }

    fn add_position(&mut self, kind: Option<FixKind>, position: [f64; 3]) {
        self.position = kind.map(|_| position).or(self.position);
    }

    fn add_fix(&mut self, fix: Fix) {
        self.kinds[fix.kind.map_or(0, |kind| 1 + kind as usize)] += 1;
        self.newest = Some(fix);
    }

    /// Returns whether one of the fixes has a position.
    fn has_position(&self) -> bool {
        self.kinds[1..].iter().any(|count| *count > 0)
    }

    /// Returns whether something arrived that a flight could use: a position, or what an autopilot measures.
    pub fn is_usable(&self) -> bool {
        self.has_position() || self.of(Message::HighresImu).count > 0
    }

    fn of(&self, message: Message) -> &Packets {
        &self.packets[message as usize]
    }

    /// Returns the line of the last second.
    pub fn line_of_second(&mut self, counts: &Counts) -> String {
        let mut parts = Vec::new();
        for message in Message::ALL {
            let recent = std::mem::take(&mut self.packets[message as usize].recent);
            if recent > 0 {
                parts.push(format!("{} {recent} Hz", message.name()));
            }
        }
        if parts.is_empty() {
            parts.push("no packet".to_owned());
        }
        if let Some(fix) = &self.newest {
            parts.push(describe_fix(fix));
        }
        if let Some(age) = self.recent_age.take().filter(|age| AGES.contains(age)) {
            parts.push(format!("age {:.0} ms", 1e3 * age));
        }
        parts.push(format!("refused {}", counts.total_refused()));
        parts.join("; ") + "\n"
    }

    /// Returns the whole reception: packets, fixes, ages, refusals.
    pub fn describe(&self, counts: &Counts) -> String {
        let mut text = format!("{} bytes, {} outside of packets\n", counts.bytes, counts.skipped);
        let mut line =
            |words: std::fmt::Arguments<'_>| writeln!(text, "{words}").expect("a String takes all");
        for message in Message::ALL {
            let packets = self.of(message);
            if packets.count > 0 {
                line(format_args!(
                    "{:13} {:6} packets, {:6.2} Hz, largest gap {:.3} s",
                    message.name(),
                    packets.count,
                    packets.rate(),
                    packets.gap
                ));
            }
        }
        let all: u64 = self.kinds.iter().sum();
        if let Some(fix) = &self.newest {
            let kinds = [None].into_iter().chain(FixKind::ALL.map(Some));
            let shares: Vec<String> = kinds
                .zip(self.kinds)
                .filter(|(_, count)| *count > 0)
                .map(|(kind, count)| format!("{} {:.1} %", name(kind), 100.0 * count as f64 / all as f64))
                .collect();
            line(format_args!(
                "fixes: {}; the last: {}",
                shares.join(", "),
                describe_fix(fix)
            ));
        }
        if let Some([latitude, longitude, height]) = self.position {
            line(format_args!(
                "position: {latitude:.7}°, {longitude:.7}°, {height:.2} m above the ellipsoid"
            ));
        }
        if let Some(baselines) = &self.baselines {
            let [shortest, longest] = baselines.lengths;
            line(format_args!(
                "baseline: {shortest:.3} to {longest:.3} m long, the length of `navigation.baseline`; the last from the moving base to \
                 the rover: {:.1}° from true north, {:.3} m down (compare with a compass)",
                baselines.heading.to_degrees(),
                baselines.down
            ));
        }
        if let Some([least, median, _, largest]) = self.age() {
            line(format_args!(
                "age on arrival by this machine's clock: least {:.0} ms (`receivers.fix_latency`), median {:.0} ms, largest {:.0} ms",
                1e3 * least,
                1e3 * median,
                1e3 * largest
            ));
        }
        for (others, what) in [
            (counts.other_ubx, "other UBX messages"),
            (counts.other_mavlink, "other MAVLink messages"),
            (counts.nmea, "NMEA sentences"),
        ] {
            if others > 0 {
                line(format_args!("{others} {what}, not used"));
            }
        }
        for (message, reason, count) in counts.refusals() {
            line(format_args!("refused: {count} {} with {reason}", message.name()));
        }
        text
    }

    /// Returns the least age, the median, the 95 % quantile and the largest, s; `None` without ages that can be those of fixes.
    fn age(&self) -> Option<[f64; 4]> {
        let mut ages = self.ages.clone();
        ages.sort_by(f64::total_cmp);
        let least = *ages.first()?;
        let median = *ages.get(ages.len() / 2)?;
        let late = *ages.get(ages.len() * 95 / 100)?;
        AGES.contains(&median)
            .then(|| [least, median, late, *ages.last().unwrap_or(&median)])
    }

    /// Returns what is wrong, each with the next step, the most fundamental first.
    pub fn findings(&self, counts: &Counts, source: &ReceiverSource) -> Vec<String> {
        let mut found = Vec::new();
        let mut add = |finding: String| found.push(finding);
        let is_autopilot = counts.has_mavlink();
        let has_fixes = self.newest.is_some();
        if counts.bytes == 0 {
            add(self.silence(source));
        } else if counts.total() == 0 && !is_autopilot && counts.other_ubx == 0 && counts.nmea == 0 {
            add(self.gibberish(counts, source));
        } else if !has_fixes && !is_autopilot && counts.refused(Message::NavPvt, Reason::Length) > 0 {
            add("NAV-PVT has not 92 bytes: receivers before u-blox 8 are not supported".to_owned());
        } else if !has_fixes && !is_autopilot {
            add("NAV-PVT is not enabled: in u-center, set CFG-MSGOUT-UBX_NAV_PVT_USB, or _UART1 with CFG-UART1OUTPROT-UBX, \
                 to 1, in RAM and flash"
                .to_owned());
        }
        if is_autopilot {
            self.add_missing(&mut add);
            self.add_sample_findings(&mut add);
        }
        self.add_fix_findings(&mut add);
        self.add_timing_findings(counts, &mut add);
        for message in Message::ALL {
            let refused = counts.refused(message, Reason::Checksum);
            if refused > 0 {
                add(format!(
                    "{refused} times {} had a wrong checksum: bytes were lost or changed; check ground and length of the cable, and \
                     use a port with flow control or USB",
                    message.name()
                ));
            }
        }
        found
    }

    fn silence(&self, source: &ReceiverSource) -> String {
        let time = self.listened.unwrap_or(0.0);
        match source {
            ReceiverSource::Path(_) if self.listened.is_none() => format!("{source} is empty"),
            ReceiverSource::Path(_) => format!(
                "nothing was received from {source} in {time:.1} s: check power and wiring (the receiver's TX to this RX), and \
                 that output is enabled on this port"
            ),
            ReceiverSource::Tcp(_) => {
                format!(
                    "nothing was received from {source} in {time:.1} s: does the server have its receiver?"
                )
            }
            ReceiverSource::Udp(_) => format!(
                "nothing was received at {source} in {time:.1} s: let the sender send to this machine and port, and check the \
                 firewall"
            ),
        }
    }

    fn gibberish(&self, counts: &Counts, source: &ReceiverSource) -> String {
        let what = format!(
            "{} bytes were received from {source}, but no UBX and no MAVLink",
            counts.bytes
        );
        match self.line {
            Some(baud) => format!(
                "{what}: is {baud} the speed of the device? Try --baud 9600, 38400, 57600, 115200, 230400, 460800, 921600"
            ),
            None => format!("{what}: let the source send one of them, as raw bytes"),
        }
    }

    /// Adds the messages of an autopilot that do not come.
    fn add_missing(&self, add: &mut dyn FnMut(String)) {
        let has_fixes = self.of(Message::NavPvt).count > 0 && self.has_position();
        let missing: Vec<&str> = [(Message::HighresImu, true), (Message::GpsRawInt, !has_fixes)]
            .into_iter()
            .filter(|(message, is_needed)| *is_needed && self.of(*message).count == 0)
            .map(|(message, _)| message)
            .map(Message::name)
            .collect();
        if let [first, ..] = missing[..] {
            let rate = if first == Message::HighresImu.name() {
                250
            } else {
                10
            };
            add(format!(
                "the autopilot does not send {}: in PX4's shell, `mavlink stream -d DEVICE -s {first} -r {rate}`; with others, \
                 MAV_CMD_SET_MESSAGE_INTERVAL",
                missing.join(" and ")
            ));
        }
    }

    /// Adds what is wrong with the samples of an autopilot.
    fn add_sample_findings(&self, add: &mut dyn FnMut(String)) {
        let samples = self.of(Message::HighresImu);
        if samples.count > 1 && samples.rate() < 0.98 * LEAST_INERTIAL {
            add(format!(
                "HIGHRES_IMU comes at {:.1} Hz, and a flight needs {LEAST_INERTIAL} Hz: in PX4's shell, `mavlink stream -d DEVICE -s \
                 HIGHRES_IMU -r 250`; with others, MAV_CMD_SET_MESSAGE_INTERVAL of message 105 to 4000 us",
                samples.rate()
            ));
        }
        if let Some(field) = self.field.filter(|field| *field > FIELD) {
            add(format!(
                "a field of {field:.1} G, and that of the Earth has 0.25 to 0.65 G: ArduPilot states milligauss, a thousand times as \
                 much, and a flight refuses it"
            ));
        }
    }

    fn add_fix_findings(&self, add: &mut dyn FnMut(String)) {
        let Some(fix) = &self.newest else { return };
        match fix.kind {
            None => add(
                "the receiver has no position: its antenna must see the sky; a cold start takes half a minute".to_owned(),
            ),
            Some(FixKind::SinglePoint) if !fix.has_corrections => add(
                "single point: the position is wrong by a metre or more; for centimetres the receiver needs corrections \
                 (RTCM 3 of a base station, or NTRIP)"
                    .to_owned(),
            ),
            Some(FixKind::SinglePoint) => {
                add("single point with corrections: for centimetres, let the base station send RTCM 3 MSM4 or MSM7".to_owned());
            }
            Some(FixKind::RtkFloat) => add(
                "RTK float: wait for fixed; if it does not come, move the antenna away from walls, trees and USB 3, onto a ground \
                 plane"
                    .to_owned(),
            ),
            Some(FixKind::RtkFixed) => {}
        }
        if fix.kind.is_some() && fix.satellites.is_some_and(|count| count < SATELLITES) {
            add(format!(
                "{} satellites: wait for {SATELLITES}, with a free view of the sky",
                fix.satellites.unwrap_or(0)
            ));
        }
        if let (Some(_), Some(accuracies)) = (fix.kind, fix.accuracies) {
            let names = ["horizontal accuracy", "vertical accuracy", "speed accuracy"];
            for ((name, value), (limit, unit)) in names
                .iter()
                .zip(accuracies)
                .zip(ACCURACIES.into_iter().zip(["m", "m", "m/s"]))
            {
                if value > limit {
                    add(format!(
                        "the {name} is {value:.1} {unit}: wait until it is below {limit} {unit}"
                    ));
                }
            }
        }
        if !fix.has_vertical_velocity {
            add("GPS_RAW_INT has no vertical velocity: connect the receiver itself for a flight".to_owned());
        }
        if self.of(Message::NavRelposned).count > 0 && self.baselines.is_none() {
            add("NAV-RELPOSNED has no valid heading of a moving base: both antennas must see the sky, and the moving base must send \
                 its corrections to the rover (RTCM 4072.0 and MSM)"
                .to_owned());
        }
    }

    fn add_timing_findings(&self, counts: &Counts, add: &mut dyn FnMut(String)) {
        let pvt = self.of(Message::NavPvt);
        if pvt.count > 1 && pvt.rate() < LEAST_RATE {
            add(format!(
                "NAV-PVT comes at {:.1} Hz: set CFG-RATE-MEAS to 100 ms for 10 Hz",
                pvt.rate()
            ));
        }
        for message in Message::ALL {
            let packets = self.of(message);
            let period = 1.0 / packets.rate();
            if packets.count > 2 && packets.gap > GAP * period {
                add(format!(
                    "{} had a gap of {:.2} s at {:.1} Hz: check the load of the line and of this machine",
                    message.name(),
                    packets.gap,
                    packets.rate()
                ));
            }
        }
        if let (Some(baud), Some(listened)) = (self.line, self.listened) {
            // Ten bits a byte.
            let load = 10.0 * counts.bytes as f64 / (f64::from(baud) * listened.max(1e-3));
            if load > FULL {
                add(format!(
                    "the line would be at {:.0} % of {baud} baud: raise its speed (CFG-UART1-BAUDRATE), or switch other messages off; \
                     on USB the speed does not matter",
                    100.0 * load
                ));
            }
        }
        match self.age() {
            Some([.., late, _]) if late > HORIZON => add(format!(
                "more than 5 % of the fixes are {:.0} ms old on arrival or older, more than the filter's horizon of {:.0} ms: raise the speed of the line, or the horizon",
                1e3 * late,
                1e3 * HORIZON
            )),
            None if !self.ages.is_empty() => add(format!(
                "this machine's clock and the receiver's differ by {:.2} s, so that no age is known: synchronise it (`chronyc makestep`)",
                self.ages[self.ages.len() / 2].abs()
            )),
            _ => {}
        }
    }
}

fn describe_fix(fix: &Fix) -> String {
    let mut text = name(fix.kind).to_owned();
    if let Some(satellites) = fix.satellites {
        write!(text, ", {satellites} satellites").expect("a String takes all");
    }
    if let Some([horizontal, vertical, speed]) = fix.accuracies {
        write!(text, ", ±{horizontal:.3} m, ±{vertical:.3} m up, ±{speed:.3} m/s")
            .expect("a String takes all");
    }
    text
}

/// Returns the time that a packet states, s.
fn stamp(packet: &Packet) -> Option<f64> {
    match packet {
        Packet::NavPvt(pvt) => Some(f64::from(pvt.time_of_week_ms) * 1e-3),
        Packet::RelativePosition(relative) => Some(f64::from(relative.time_of_week_ms) * 1e-3),
        Packet::Heartbeat(..) => None,
        Packet::GpsRawInt(_, fix) => Some(fix.time_us as f64 * 1e-6),
        Packet::HighresImu(_, sample) => Some(sample.time_us as f64 * 1e-6),
        Packet::Odometry(_, motion) => Some(motion.time_us as f64 * 1e-6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use navigation_receivers::stream::Stream;
    use navigation_receivers::ubx::{self, Heading};

    fn source() -> ReceiverSource {
        ReceiverSource::Path("/dev/ttyACM0".into())
    }

    /// Returns a `NAV-PVT` at a time of the week, ms, of a kind of the carrier's solution.
    fn pvt(time_ms: u32, solution: u8, carrier: u8) -> Vec<u8> {
        let mut payload = [0; 92];
        payload[..4].copy_from_slice(&time_ms.to_le_bytes());
        payload[20] = solution;
        payload[21] = 0b11 | carrier << 6;
        payload[23] = 21;
        for (offset, value) in [
            (24, 115_761_240_u32),
            (28, 481_371_540),
            (32, 565_000),
            (36, 518_000),
            (40, 14),
            (44, 21),
            (68, 50),
        ] {
            payload[offset..offset + 4].copy_from_slice(&value.to_le_bytes());
        }
        let mut packet = vec![0xb5, 0x62, 0x01, 0x07, 92, 0];
        packet.extend(payload);
        let sum = ubx::checksum(&packet[2..]);
        packet.extend(sum);
        packet
    }

    /// Returns the reception of a file.
    fn received(bytes: &[u8]) -> (Reception, Counts) {
        let (mut reception, mut stream) = (Reception::default(), Stream::default());
        stream.push(bytes, &mut |packet| reception.add(packet, None));
        stream.finish(&mut |packet| reception.add(packet, None));
        (reception, *stream.counts())
    }

    fn findings(bytes: &[u8]) -> (bool, String) {
        let (reception, counts) = received(bytes);
        let findings = reception.findings(&counts, &source());
        (reception.is_usable(), findings.join("; "))
    }

    #[test]
    fn a_good_receiver_has_no_findings() {
        let bytes: Vec<u8> = (0..50).flat_map(|k| pvt(100 * k, 3, 2)).collect();
        assert_eq!(findings(&bytes), (true, String::new()));
        let (reception, counts) = received(&bytes);
        let text = reception.describe(&counts);
        assert!(
            text.contains("50 packets,  10.00 Hz, largest gap 0.100 s"),
            "{text}"
        );
        assert!(
            text.contains("RTK fixed 100.0 %; the last: RTK fixed, 21 satellites, ±0.014 m"),
            "{text}"
        );
        assert!(
            text.contains("position: 48.1371540°, 11.5761240°, 565.00 m above the ellipsoid"),
            "{text}"
        );
    }

    #[test]
    fn the_baseline_of_two_antennas_is_shown_with_its_heading() {
        let mut reception = Reception::default();
        for (k, east) in [0.5, 0.52].into_iter().enumerate() {
            let relative = RelativePosition {
                time_of_week_ms: 100 * k as u32,
                baseline_ned: [0.5, east, -0.02],
                accuracies_ned: [0.01; 3],
                length: libm::sqrt(0.25 + east * east + 0.0004),
                carrier: Carrier::Fixed,
                is_valid: true,
                is_moving: true,
                heading: Some(Heading {
                    angle: libm::atan2(east, 0.5),
                    deviation: 0.01,
                }),
            };
            reception.add(&Packet::RelativePosition(relative), None);
        }
        let text = reception.describe(&Counts::default());
        assert!(text.contains("baseline: 0.707 to 0.722 m long"), "{text}");
        assert!(text.contains("46.1° from true north, -0.020 m down"), "{text}");
    }

    #[test]
    fn what_is_wrong_is_said_with_the_next_step() {
        let sentences = b"$GNRMC,001031.00,A,4404.13993,N,12118.86023,W,0.146,,100117,,,A*7B\r\n".repeat(3);
        let several = |solution, carrier, step: u32| -> Vec<u8> {
            (0..20).flat_map(|k| pvt(step * k, solution, carrier)).collect()
        };
        let mut with_gap = several(3, 2, 100);
        with_gap.extend(pvt(2_900, 3, 2));
        let mut spoilt = several(3, 2, 100);
        spoilt[150] ^= 1;
        for (bytes, is_usable, words) in [
            (Vec::new(), false, "/dev/ttyACM0 is empty"),
            (
                vec![0x55; 300],
                false,
                "300 bytes were received from /dev/ttyACM0, but no UBX",
            ),
            (sentences, false, "NAV-PVT is not enabled"),
            (several(0, 0, 100), false, "its antenna must see the sky"),
            (several(3, 0, 100), true, "let the base station send RTCM 3"),
            (several(3, 1, 100), true, "RTK float: wait for fixed"),
            (
                several(3, 2, 1000),
                true,
                "NAV-PVT comes at 1.0 Hz: set CFG-RATE-MEAS",
            ),
            (with_gap, true, "NAV-PVT had a gap of 1.00 s"),
            (spoilt, true, "1 times NAV-PVT had a wrong checksum"),
        ] {
            let (usable, found) = findings(&bytes);
            assert_eq!(usable, is_usable, "{found}");
            assert!(found.contains(words), "{words}: {found}");
        }
    }

    /// Returns a frame of MAVLink 2.
    fn mavlink(id: u8, crc_extra: u8, payload: &[u8]) -> Vec<u8> {
        let mut frame = vec![u8::try_from(payload.len()).unwrap(), 0, 0, 0, 1, 1, id, 0, 0];
        frame.extend(payload);
        let checksum = frame
            .iter()
            .chain([&crc_extra])
            .fold(0xffff_u16, |checksum, byte| {
                let mixed = byte ^ checksum.to_le_bytes()[0];
                let mixed = u16::from(mixed ^ mixed << 4);
                checksum >> 8 ^ mixed << 8 ^ mixed << 3 ^ mixed >> 4
            });
        frame.extend(checksum.to_le_bytes());
        [vec![0xfd], frame].concat()
    }

    #[test]
    fn an_autopilot_is_never_told_to_send_as_a_receiver() {
        let mut imu = [0; 62];
        imu[..8].copy_from_slice(&1_000_000_u64.to_le_bytes());
        imu[60] = 0x3f;
        let imu = mavlink(105, 93, &imu);
        let mut spoilt = imu.clone();
        spoilt[20] ^= 1;
        for (bytes, is_usable) in [
            (imu.clone(), true),
            (spoilt, false),
            (mavlink(0, 50, &[0, 0, 0, 0, 2, 12, 0, 4, 3]), false),
            // `ATTITUDE`, which is not used.
            (mavlink(30, 39, &[1; 28]), false),
        ] {
            let (usable, found) = findings(&bytes.repeat(3));
            assert_eq!(usable, is_usable, "{found}");
            assert!(
                found.contains("the autopilot does not send") && !found.contains("NAV-PVT"),
                "{found}"
            );
        }
        // Beside the packets of a receiver it is not the receiver that is missing.
        let both: Vec<u8> = (0..20)
            .flat_map(|k| [pvt(100 * k, 3, 2), imu.clone()].concat())
            .collect();
        assert!(!findings(&both).1.contains("NAV-PVT"));
    }

    #[test]
    fn an_autopilot_is_told_what_a_flight_needs_of_its_samples() {
        for (period_us, field, words) in [
            (4000_u64, 0.48_f32, ""),
            (
                20_000,
                0.48,
                "HIGHRES_IMU comes at 50.0 Hz, and a flight needs 200 Hz",
            ),
            (4000, 480.0, "a field of 480.0 G"),
        ] {
            let samples = (0..50).flat_map(|k: u64| {
                let mut payload = [0; 62];
                payload[..8].copy_from_slice(&(period_us * k).to_le_bytes());
                payload[40..44].copy_from_slice(&field.to_le_bytes());
                payload[60..].copy_from_slice(&0x1ff_u16.to_le_bytes());
                mavlink(105, 93, &payload)
            });
            let fixes = (0..10).flat_map(|k| pvt(100 * k, 3, 2));
            let (is_usable, found) = findings(&samples.chain(fixes).collect::<Vec<_>>());
            assert!(
                is_usable && found.contains(words) && found.is_empty() == words.is_empty(),
                "{found}"
            );
        }
    }

    #[test]
    fn ages_are_those_of_fixes_only_if_the_clocks_agree() {
        for (offset_ns, every_tenth_ns, words) in [
            (60_000_000, 0, ""),
            (200_000_000, 0, "200 ms old on arrival"),
            // The median does not show them.
            (60_000_000, 90_000_000, "150 ms old on arrival"),
            (37_000_000_000, 0, "differ by 37.00 s"),
        ] {
            let mut reception = Reception::default();
            let mut stream = Stream::default();
            for k in 0..20 {
                stream.push(&pvt(100 * k, 3, 2), &mut |packet| {
                    let Packet::NavPvt(mut pvt) = *packet else {
                        unreachable!()
                    };
                    pvt.utc_ns = Some(i64::from(pvt.time_of_week_ms) * 1_000_000);
                    let arrival = Arrival {
                        seconds: f64::from(k) * 0.1,
                        utc_ns: i64::from(pvt.time_of_week_ms) * 1_000_000
                            + offset_ns
                            + if k % 10 == 9 { every_tenth_ns } else { 0 },
                    };
                    reception.add(&Packet::NavPvt(pvt), Some(arrival));
                });
            }
            let found = reception.findings(stream.counts(), &source()).join("; ");
            assert!(
                found.contains(words) && found.is_empty() == words.is_empty(),
                "{found}"
            );
            let text = reception.describe(stream.counts());
            assert_eq!(
                text.contains("least 60 ms (`receivers.fix_latency`), median 60 ms"),
                offset_ns == 60_000_000,
                "{text}"
            );
        }
    }
}
