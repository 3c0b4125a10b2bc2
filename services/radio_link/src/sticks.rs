//! Sticks: the part of a transmitter's frame that a link needs, and the cell that hands the newest to the sender thread.

use std::sync::atomic::{AtomicU64, Ordering, fence};

use scenario::RcLink;
use shared_types::Now;
use shared_types::flight_phase::GROUNDED_AFTER;
use shared_types::samples::RcFrame;
use shared_types::service::nanoseconds;

use crate::channel_map::largest_code;

/// Sticks of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sticks {
    /// Codes of thrust, roll rate, pitch rate and yaw rate, as in the frame; `None` to stop the motors, for which no code
    /// is valid on all links.
    pub codes: Option<[u16; 4]>,
    /// `true` if the motors stop because the transmitter has lost its inputs, not because of a request.
    pub is_lost: bool,
    /// `true` to keep the arming switch off, also with codes: for tests on the ground.
    pub disarmed: bool,
    /// `true` if the motors stop until the end of the run.
    pub is_killed: bool,
    /// `true` if the vehicle is to be disarmed: the operator has not armed it, or its motors have stopped for longer than a fall
    /// takes. A command that stops the motors in the air, because it is lost or because the law has lost its inputs, may be
    /// followed by others.
    pub rests: bool,
}

impl Sticks {
    /// Sticks that stop the motors.
    pub const MOTORS_OFF: Self = Self {
        codes: None,
        is_lost: false,
        disarmed: true,
        is_killed: false,
        rests: true,
    };

    /// Returns armed sticks with these codes.
    #[must_use]
    pub const fn flying(codes: [u16; 4]) -> Self {
        Self {
            codes: Some(codes),
            is_lost: false,
            disarmed: false,
            is_killed: false,
            rests: false,
        }
    }

    /// Converts a frame. A frame without body rates stops the motors.
    #[must_use]
    #[inline]
    fn from_frame(frame: &RcFrame) -> Self {
        let [thrust, roll, pitch, yaw, ..] = frame.channels;
        let failsafe = frame.failsafe.is_set() || frame.mode != RcFrame::MODE_RATES;
        Self {
            codes: (!failsafe).then_some([thrust, roll, pitch, yaw]),
            // The frames of a disarmed vehicle are failsafe frames too, but its inputs are not lost.
            is_lost: failsafe && !frame.inputs_fresh.is_set(),
            disarmed: failsafe,
            is_killed: failsafe && frame.action == RcFrame::ACTION_KILL,
            rests: false,
        }
    }
}

/// Thrust stick at no thrust. A flight controller does not arm while that stick is off its end (`min_check` of Betaflight), and
/// the calibrated code of no thrust may be far from it: with the paper's radio at an eighth of the way. In flight the calibration
/// holds, because a flight controller may stop levelling at that end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThrustRest {
    /// Code of the stick's end.
    end: u16,
    /// Thrust of one code, N.
    one_code: f64,
    /// `true` from the first thrust after arming on.
    has_pulled: bool,
}

impl ThrustRest {
    /// Makes it for a checked link.
    #[must_use]
    pub fn new(link: &RcLink) -> Self {
        let largest = largest_code(link);
        Self {
            end: if link.thrust_slope > 0.0 { 0 } else { largest },
            has_pulled: false,
            one_code: 2.0 * link.thrust_slope.abs() / f64::from(largest),
        }
    }

    /// Returns the sticks of the next frame, the thrust stick at its end until the first thrust.
    #[must_use]
    #[inline]
    pub fn sticks(&mut self, frame: &RcFrame) -> Sticks {
        let mut sticks = Sticks::from_frame(frame);
        let is_armed = sticks.codes.is_some();
        self.has_pulled = is_armed && (self.has_pulled || frame.thrust >= self.one_code);
        if let Some([thrust, ..]) = &mut sticks.codes
            && !self.has_pulled
        {
            *thrust = self.end;
        }
        sticks
    }
}

/// Time after which stopped motors are those of a vehicle at rest, s: a fall from 11 m. A flight with phases ends
/// [`GROUNDED_AFTER`] after the landing, and the request to disarm needs the frames before.
const RESTS_AFTER: f64 = 0.75 * GROUNDED_AFTER;

/// Motors that have stopped, and whether the vehicle is at rest with them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StoppedMotors {
    since_ns: Option<u64>,
}

impl StoppedMotors {
    /// Marks sticks as those of a vehicle at rest: it is not armed by the operator, or the motors have stopped for
    /// three quarters of [`GROUNDED_AFTER`] without a break.
    #[inline]
    pub fn mark(&mut self, now: &Now, sticks: &mut Sticks) {
        if sticks.codes.is_some() {
            self.since_ns = None;
            return;
        }
        let since_ns = *self.since_ns.get_or_insert(now.time_ns);
        sticks.rests =
            !now.operator.armed || now.time_ns.saturating_sub(since_ns) >= nanoseconds(RESTS_AFTER);
    }
}

/// Lock-free cell of the newest sticks, with one writer and one reader.
///
/// A sequence lock: its count is odd during a write. The writer never waits. A read during a write returns `None`, and
/// the sender uses the previous sticks.
#[derive(Debug, Default)]
pub struct SticksCell {
    count: AtomicU64,
    codes: AtomicU64,
    flags: AtomicU64,
    written_at_ns: AtomicU64,
}

impl SticksCell {
    /// Writes the newest sticks with their time of `CLOCK_MONOTONIC`. Must be called from one thread only: two writers
    /// could leave an even count over mixed words.
    #[inline]
    pub fn write(&self, sticks: &Sticks, now_ns: u64) {
        let count = self.count.load(Ordering::Relaxed);
        self.count.store(count + 1, Ordering::Relaxed);
        // Release fence: the odd count becomes visible before any of the new words. Otherwise a reader could mix new words
        // with old ones under an unchanged even count.
        fence(Ordering::Release);
        let codes = sticks.codes.unwrap_or_default();
        let word = codes
            .iter()
            .rev()
            .fold(0, |word, &code| word << 16 | u64::from(code));
        self.codes.store(word, Ordering::Relaxed);
        let flags = [
            sticks.codes.is_none(),
            sticks.is_lost,
            sticks.disarmed,
            sticks.is_killed,
            sticks.rests,
        ];
        let flags = flags
            .iter()
            .rev()
            .fold(0, |word, &flag| word << 1 | u64::from(flag));
        self.flags.store(flags, Ordering::Relaxed);
        self.written_at_ns.store(now_ns, Ordering::Relaxed);
        // Release: the words become visible before the even count.
        self.count.store(count + 2, Ordering::Release);
    }

    /// Returns the newest sticks with their time; `None` before the first write and during a write.
    #[must_use]
    #[inline]
    pub fn read(&self) -> Option<(Sticks, u64)> {
        let count = self.count.load(Ordering::Acquire);
        let (codes, flags) = (
            self.codes.load(Ordering::Relaxed),
            self.flags.load(Ordering::Relaxed),
        );
        let written_at_ns = self.written_at_ns.load(Ordering::Relaxed);
        // Acquire fence: the words are read before the second load of the count. Otherwise they could be read after it,
        // and a torn copy would pass.
        fence(Ordering::Acquire);
        let is_consistent = count == self.count.load(Ordering::Relaxed) && count.is_multiple_of(2);
        let code = |stick: usize| {
            let bytes = codes.to_le_bytes();
            u16::from_le_bytes([bytes[2 * stick], bytes[2 * stick + 1]])
        };
        (is_consistent && count > 0).then(|| {
            let sticks = Sticks {
                codes: (flags & 1 == 0).then(|| [0, 1, 2, 3].map(code)),
                is_lost: flags & 2 != 0,
                disarmed: flags & 4 != 0,
                is_killed: flags & 8 != 0,
                rests: flags & 16 != 0,
            };
            (sticks, written_at_ns)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::service::Operator;
    use zerocopy::FromZeros;

    #[test]
    fn the_cell_is_empty_before_the_first_sticks_and_then_holds_the_newest() {
        let cell = SticksCell::default();
        assert_eq!(cell.read(), None);
        let sticks = Sticks {
            codes: Some([1, 0xffff, 3, 0x8000]),
            is_lost: true,
            disarmed: false,
            is_killed: true,
            rests: true,
        };
        cell.write(&Sticks::MOTORS_OFF, 1);
        cell.write(&sticks, 2);
        assert_eq!([cell.read(), cell.read()], [Some((sticks, 2)); 2]);
    }

    #[test]
    fn a_reader_beside_a_writer_sees_sticks_that_were_written_together() {
        let cell = SticksCell::default();
        let last = 200_000_u64;
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for now_ns in 1..=last {
                    let code = now_ns.to_le_bytes();
                    let codes = [u16::from_le_bytes([code[0], code[1]]); 4];
                    let sticks = Sticks {
                        codes: (now_ns % 2 != 0).then_some(codes),
                        is_lost: now_ns % 3 == 0,
                        disarmed: now_ns % 5 == 0,
                        is_killed: now_ns % 7 == 0,
                        rests: now_ns % 11 == 0,
                    };
                    cell.write(&sticks, now_ns);
                }
            });
            let mut newest = 0;
            while newest < last {
                let Some((sticks, now_ns)) = cell.read() else {
                    continue;
                };
                assert!(newest <= now_ns);
                newest = now_ns;
                let code = u16::from_le_bytes([now_ns.to_le_bytes()[0], now_ns.to_le_bytes()[1]]);
                assert_eq!(sticks.codes, (now_ns % 2 != 0).then_some([code; 4]));
                let flags = [sticks.is_lost, sticks.disarmed, sticks.is_killed, sticks.rests];
                assert_eq!(flags, [3, 5, 7, 11].map(|divisor| now_ns % divisor == 0));
            }
        });
    }

    #[test]
    fn a_frame_of_a_disarmed_vehicle_is_not_lost_and_one_without_fresh_inputs_is() {
        let mut frame = RcFrame {
            mode: RcFrame::MODE_RATES,
            stage: RcFrame::STAGE_FAILSAFE,
            failsafe: true.into(),
            inputs_fresh: true.into(),
            ..RcFrame::new_zeroed()
        };
        let stopped = Sticks {
            rests: false,
            ..Sticks::MOTORS_OFF
        };
        assert_eq!(Sticks::from_frame(&frame), stopped);
        frame.action = RcFrame::ACTION_KILL;
        assert!(Sticks::from_frame(&frame).is_killed);
        frame.action = RcFrame::ACTION_NONE;
        frame.inputs_fresh = false.into();
        assert!(Sticks::from_frame(&frame).is_lost);
        frame.failsafe = false.into();
        assert_eq!(
            Sticks::from_frame(&frame),
            Sticks::flying([0; 4]),
            "a command is followed for as long as the transmitter does"
        );
    }

    #[test]
    fn the_thrust_stick_is_at_its_end_until_the_first_thrust() {
        for slope in [3.138, -3.138] {
            let link = RcLink {
                thrust_offset: 2.3071,
                thrust_slope: slope,
                ..RcLink::default()
            };
            let frame = |thrust, code| RcFrame {
                thrust,
                channels: [code; 16],
                mode: RcFrame::MODE_RATES,
                ..RcFrame::new_zeroed()
            };
            let mut rest = ThrustRest::new(&link);
            let mut thrust_stick = |frame| rest.sticks(&frame).codes.unwrap()[0];
            let end = if slope > 0.0 { 0 } else { 2047 };
            assert_eq!(
                [thrust_stick(frame(0.0, 271)), thrust_stick(frame(0.001, 271))],
                [end; 2]
            );
            assert_eq!(thrust_stick(frame(0.5, 434)), 434);
            assert_eq!(thrust_stick(frame(0.0, 271)), 271, "in flight");
        }
    }

    #[test]
    fn motors_that_stop_for_less_than_a_fall_takes_disarm_only_at_the_operators_request() {
        let at = |seconds: f64, operator| Now {
            tick: 0,
            time_ns: nanoseconds(seconds),
            elapsed_ns: 0,
            operator,
        };
        let disarmed = Operator {
            armed: false,
            ..Operator::FLYING
        };
        let stopped = Sticks {
            rests: false,
            ..Sticks::MOTORS_OFF
        };
        let mut motors = StoppedMotors::default();
        let mut rests = |seconds, operator, mut sticks| {
            motors.mark(&at(seconds, operator), &mut sticks);
            sticks.rests
        };
        assert!(rests(0.0, disarmed, stopped));
        assert!(!rests(1.0, Operator::FLYING, Sticks::flying([0; 4])));
        assert!(!rests(2.0, Operator::FLYING, stopped));
        assert!(!rests(3.4, Operator::FLYING, stopped));
        assert!(!rests(3.45, Operator::FLYING, Sticks::flying([0; 4])));
        assert!(!rests(4.0, Operator::FLYING, stopped));
        assert!(!rests(5.4, Operator::FLYING, stopped));
        assert!(rests(5.41, disarmed, stopped));
        assert!(rests(5.5, Operator::FLYING, stopped), "longer than a fall takes");
    }

    #[test]
    fn a_frame_without_body_rates_stops_the_motors() {
        let frame = RcFrame {
            mode: RcFrame::MODE_TORQUE,
            ..RcFrame::new_zeroed()
        };
        assert_eq!(Sticks::from_frame(&frame).codes, None);
    }
}
