//! Late cameras of a laboratory, told apart from a late flight.
//!
//! A sample of `mocap/pose` has the tick of the step that read the pose. A capture counts as late if the step before that one did
//! not find it, although it was due for more than [`LATE_NS`]: a capture is due at its stamp plus the median age of all captures.
//! A step that begins late reads captures late, but the one before it has looked: the lateness of the flight does not count.
//! Only captures in the air count: a hand hides the markers of a vehicle on the ground.
//! Captures whose stamps are too late to be mapped (docs/motion_capture.md) are refused, so that the pauses matter as well.

use std::fmt::{Display, Formatter, Result};

use hdrhistogram::Histogram;
use serde::Serialize;
use shared_types::capture_figures::LATE_NS;
use shared_types::flight_phase::FlightPhase;
use shared_types::samples::{MocapPose, PathReference};
use shared_types::service::seconds;

use super::timing::{self, TimingReport};

/// Pause between poses above which it is worth mentioning, ns: ten captures at 100 Hz.
const PAUSE_NS: u64 = 100_000_000;

/// Captures that came late, and pauses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LateCameras {
    /// Captures that were used in the air.
    pub captures: u64,
    /// Captures that came late.
    pub late: u64,
    /// Maximum lateness, s; 0 if none was late.
    pub worst: f64,
    /// Longest time in the air in which the flight read no pose that it could use, s.
    pub pause: f64,
    /// Maximum delay of the begin of one of the flight's own steps, s.
    pub flight: f64,
}

/// Collects the poses of a flight.
#[derive(Clone, Debug)]
pub(super) struct CameraWatch {
    /// `true` from take-off until touch-down; always in a flight without phases.
    is_airborne: bool,
    /// `true` in a flight that leaves the cameras' sight, in which pauses are no lateness.
    leaves_sight: bool,
    /// `true` from the first pose on: before it nothing is missing.
    has_begun: bool,
    /// Tick of the previous sample, ns.
    previous_ns: Option<u64>,
    /// Minimum time between two samples, ns: without steps that were left out.
    period_ns: u64,
    pause_ns: u64,
    longest_pause_ns: u64,
    /// Ages of captures at the step that read them, and at the step before it, ns.
    ages_ns: Histogram<u64>,
    missed_ages_ns: Histogram<u64>,
}

impl CameraWatch {
    /// Makes the watch over a flight with phases, or without, that leaves the cameras' sight or not.
    pub(super) fn new(has_phases: bool, leaves_sight: bool) -> Self {
        Self {
            is_airborne: !has_phases,
            leaves_sight,
            has_begun: false,
            previous_ns: None,
            period_ns: u64::MAX,
            pause_ns: 0,
            longest_pause_ns: 0,
            ages_ns: timing::histogram(),
            missed_ages_ns: timing::histogram(),
        }
    }

    /// Adds a reference of a flight with phases.
    pub(super) fn observe_reference(&mut self, reference: &PathReference) {
        self.is_airborne = matches!(
            FlightPhase::from_code(reference.phase),
            FlightPhase::TakeOff | FlightPhase::Fly | FlightPhase::Land
        );
    }

    pub(super) fn observe(&mut self, pose: &MocapPose) {
        let now_ns = pose.header.stamp_ns;
        let Some(previous_ns) = self.previous_ns.replace(now_ns) else {
            return;
        };
        let since_ns = now_ns.saturating_sub(previous_ns);
        self.period_ns = self.period_ns.min(since_ns.max(1));
        self.has_begun |= pose.tracked.is_set();
        if !self.is_airborne {
            self.pause_ns = 0;
            return;
        }
        if !pose.tracked.is_set() {
            if self.has_begun && !self.leaves_sight {
                self.pause_ns += since_ns.min(self.period_ns);
                self.longest_pause_ns = self.longest_pause_ns.max(self.pause_ns);
            }
            return;
        }
        self.pause_ns = 0;
        let captured_ns = pose.capture_time_ns;
        self.ages_ns.saturating_record(now_ns.saturating_sub(captured_ns));
        self.missed_ages_ns
            .saturating_record(previous_ns.saturating_sub(captured_ns));
    }

    /// Returns the lateness; `None` if the cameras were on time.
    pub(super) fn finish(&self, timing: Option<&TimingReport>) -> Option<LateCameras> {
        let limit_ns = self.ages_ns.value_at_quantile(0.5) + LATE_NS;
        let worst_ns = self.missed_ages_ns.max();
        let late = self
            .missed_ages_ns
            .iter_recorded()
            .filter(|value| value.value_iterated_to() > limit_ns)
            .map(|value| value.count_at_value())
            .sum();
        (late > 0 || self.longest_pause_ns > PAUSE_NS).then(|| LateCameras {
            captures: self.ages_ns.len(),
            late,
            worst: if late > 0 {
                seconds(worst_ns.saturating_sub(limit_ns - LATE_NS))
            } else {
                0.0
            },
            pause: seconds(self.longest_pause_ns),
            flight: timing.and_then(TimingReport::worst_wake).unwrap_or(0.0),
        })
    }
}

impl Display for LateCameras {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        let Self {
            captures,
            late,
            worst,
            pause,
            flight,
        } = self;
        let mut parts = Vec::new();
        if *late > 0 {
            parts.push(format!(
                "{late} of {captures} captures came more than {:.0} ms late, the latest by {:.0} ms at least",
                1e3 * seconds(LATE_NS),
                1e3 * worst
            ));
        }
        if *pause > seconds(PAUSE_NS) {
            parts.push(format!("for {pause:.2} s no pose came that could be used"));
        }
        let flight_late = 1e3 * flight;
        let whose = if *flight <= seconds(LATE_NS) {
            format!("the flight was not: its steps began {flight_late:.1} ms late at most")
        } else {
            format!("so was the flight, by {flight_late:.1} ms at most, which is not in these numbers")
        };
        write!(
            formatter,
            "The cameras were late: {}; {whose}.",
            parts.join(", and ")
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::sample::Flag;
    use zerocopy::FromZeros;

    const TICK_NS: u64 = 1_000_000;

    /// Flies with a step per tick, except those that are left out, and a capture each 10 ms that comes after `age_of` it, ms.
    fn flown(left_out: impl Fn(u64) -> bool, age_of: impl Fn(u64) -> u64) -> Option<LateCameras> {
        flown_from(&[], left_out, age_of)
    }

    /// The same, with phases that begin at these ticks; without any for the whole time if there are none.
    fn flown_from(
        phases: &[(u64, u8)],
        left_out: impl Fn(u64) -> bool,
        age_of: impl Fn(u64) -> u64,
    ) -> Option<LateCameras> {
        let mut watch = CameraWatch::new(!phases.is_empty(), false);
        let mut coming: Vec<[u64; 2]> = (0..100)
            .map(|index| [10 * index, 10 * index + age_of(10 * index)])
            .collect();
        for tick in (0..1000).filter(|tick| !left_out(*tick)) {
            for (_, phase) in phases.iter().filter(|(begins, _)| *begins == tick) {
                watch.observe_reference(&PathReference {
                    phase: *phase,
                    ..PathReference::new_zeroed()
                });
            }
            let newest = coming.iter().rev().find(|[_, arrives]| *arrives <= tick).copied();
            coming.retain(|[_, arrives]| *arrives > tick);
            let mut pose = MocapPose::new_zeroed();
            pose.header.stamp_ns = tick * TICK_NS;
            pose.capture_time_ns = newest.map_or(0, |[captured, _]| captured * TICK_NS);
            pose.tracked = Flag::from(newest.is_some());
            watch.observe(&pose);
        }
        watch.finish(None)
    }

    #[test]
    fn cameras_on_time_are_not_late_even_in_a_late_flight() {
        assert_eq!(flown(|_| false, |_| 5), None);
        assert_eq!(flown(|tick| (300..500).contains(&tick), |_| 5), None);
    }

    #[test]
    fn markers_that_are_hidden_on_the_ground_are_not_late_cameras() {
        let [disarmed, take_off] = [PathReference::PHASE_DISARMED, PathReference::PHASE_TAKE_OFF];
        let hidden = |at: u64| match at {
            100..300 => 305 - at,
            800..950 => 955 - at,
            _ => 5,
        };
        let phases = [(0, disarmed), (400, take_off), (700, disarmed)];
        assert_eq!(flown_from(&phases, |_| false, hidden), None);
        let early = [(0, disarmed), (200, take_off), (700, disarmed)];
        let late = flown_from(&early, |_| false, hidden).unwrap();
        assert!((late.pause - 0.106).abs() < 0.011, "{late:?}");
    }

    #[test]
    fn late_captures_count_with_their_lateness() {
        let late = flown(|_| false, |at| if at == 500 { 13 } else { 5 }).unwrap();
        assert_eq!(late.late, 1);
        assert!((late.worst - 0.007).abs() < 5e-4, "{late:?}");
        assert!(
            late.to_string()
                .contains("came more than 5 ms late, the latest by 7 ms")
        );
    }

    #[test]
    fn a_standstill_of_the_cameras_is_a_pause() {
        let standstill = |at: u64| if (500..800).contains(&at) { 805 - at } else { 5 };
        let late = flown(|_| false, standstill).unwrap();
        assert!((late.pause - 0.309).abs() < 0.011, "{late:?}");
        let text = late.to_string();
        assert!(
            text.contains("s no pose came") && text.contains("the flight was not"),
            "{text}"
        );
    }
}
