//! History of the stick travels with the vehicle's response: zero-order hold between frames and a first-order lag.

use scenario::RcLink;
use shared_types::samples::RcFrame;
use vehicle_model::lag::{Lag, between};

/// Step of the history, s.
const STEP: f64 = 0.001;

/// Time for which the sticks must be known before the lagged travels are valid, s.
const SETTLING: f64 = 0.2;

/// The sticks of a frame, and the time at which they begin to act.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    acts_at: f64,
    /// Travels of thrust, roll, pitch and yaw; `None` while the motors are stopped or the vehicle is not on its path.
    travels: Option<[f64; 4]>,
}

impl Frame {
    pub(super) fn new(frame: &RcFrame, link: &RcLink, acts_at: f64, is_on_path: bool) -> Self {
        let largest = f64::from((1_u32 << link.resolution.clamp(1, 16)) - 1);
        let is_flown = is_on_path && !frame.failsafe.is_set() && frame.mode == RcFrame::MODE_RATES;
        Self {
            acts_at,
            travels: is_flown.then(|| {
                let mut travels =
                    [0, 1, 2, 3].map(|stick| 2.0 * f64::from(frame.channels[stick]) / largest - 1.0);
                // The channel of a corrected thrust has the battery in it, and the calibration is that without.
                if frame.battery().is_some_and(|battery| battery.factor.is_some()) {
                    travels[0] = (frame.thrust - link.thrust_offset) / link.thrust_slope;
                }
                travels
            }),
        }
    }
}

/// Lagged travels at every step, and their cumulative sums.
#[derive(Debug)]
pub(super) struct History {
    begins_at: f64,
    travels: Vec<[f64; 4]>,
    /// Sum of the travels over all earlier steps.
    sums: Vec<[f64; 4]>,
    /// Number of earlier steps with unknown travels.
    unknown: Vec<usize>,
}

impl History {
    /// Makes the history of frames in the order of time, with lags of these time constants, s.
    pub(super) fn new(frames: &[Frame], lags: [f64; 4]) -> Self {
        let begins_at = frames.first().map_or(0.0, |frame| frame.acts_at);
        let mut history = Self {
            begins_at,
            travels: Vec::new(),
            sums: vec![[0.0; 4]],
            unknown: vec![0],
        };
        let decays = lags.map(|time_constant| Lag::new(time_constant).remaining(STEP));
        let mut lagging = frames.iter().find_map(|frame| frame.travels).unwrap_or_default();
        for (index, frame) in frames.iter().enumerate() {
            let ends_at = frames.get(index + 1).map_or(frame.acts_at, |next| next.acts_at);
            while history.time_of(history.travels.len()) < ends_at - STEP / 2.0 {
                history.push(lagging, frame.travels.is_some());
                if let Some(travels) = frame.travels {
                    for stick in 0..4 {
                        lagging[stick] = between(travels[stick], lagging[stick], decays[stick]);
                    }
                }
            }
        }
        history
    }

    fn time_of(&self, step: usize) -> f64 {
        self.begins_at + step as f64 * STEP
    }

    fn push(&mut self, travels: [f64; 4], is_known: bool) {
        let last = self.sums.len() - 1;
        let sum = [0, 1, 2, 3].map(|stick| self.sums[last][stick] + travels[stick]);
        let unknown = self.unknown[last] + usize::from(!is_known);
        self.travels.push(travels);
        self.sums.push(sum);
        self.unknown.push(unknown);
    }

    /// Returns the steps of two times, if the sticks are known from [`SETTLING`] before the first to the second.
    fn steps(&self, from: f64, to: f64) -> Option<[usize; 2]> {
        let step = |time: f64| {
            let step = libm::round((time - self.begins_at) / STEP);
            (0.0 <= step && step < self.travels.len() as f64).then_some(step as usize)
        };
        let settled = step(from - SETTLING)?;
        let steps = [step(from)?, step(to)?];
        (self.unknown[settled] == self.unknown[steps[1] + 1]).then_some(steps)
    }

    /// Returns the lagged travels at a time, s; `None` where unknown.
    pub(super) fn at(&self, time: f64) -> Option<[f64; 4]> {
        self.steps(time, time).map(|[step, _]| self.travels[step])
    }

    /// Returns the mean of the lagged travels between two times, s; `None` where unknown.
    pub(super) fn mean(&self, from: f64, to: f64) -> Option<[f64; 4]> {
        let [first, last] = self.steps(from, to)?;
        let count = (last > first).then(|| (last - first) as f64)?;
        Some([0, 1, 2, 3].map(|stick| (self.sums[last][stick] - self.sums[first][stick]) / count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    fn frame(acts_at: f64, travel: Option<f64>) -> Frame {
        Frame {
            acts_at,
            travels: travel.map(|travel| [travel; 4]),
        }
    }

    #[test]
    fn a_stick_that_a_modelled_battery_corrects_counts_as_that_of_the_thrust() {
        let link = RcLink::default();
        let travel = 0.25;
        let mut sent = RcFrame::new_zeroed();
        sent.mode = RcFrame::MODE_RATES;
        sent.thrust = link.thrust_offset + link.thrust_slope * travel;
        sent.channels[0] = 1800;
        let plain = Frame::new(&sent, &link, 0.0, true).travels.unwrap()[0];
        assert!((plain - (2.0 * 1800.0 / 2047.0 - 1.0)).abs() < 1e-12);
        sent.set_battery(7.0, Some(1.25));
        let corrected = Frame::new(&sent, &link, 0.0, true).travels.unwrap()[0];
        assert!((corrected - travel).abs() < 1e-12);
    }

    #[test]
    fn a_step_of_the_stick_is_followed_with_its_lag() {
        let frames = [
            frame(0.0, Some(0.0)),
            frame(1.0, Some(1.0)),
            frame(2.0, Some(1.0)),
        ];
        let history = History::new(&frames, [0.1, 0.0, 0.1, 0.1]);
        let after = history.at(1.1).unwrap();
        assert!((after[0] - (1.0 - libm::exp(-1.0))).abs() < 1e-9);
        assert_eq!(after[1], 1.0);
        assert_eq!(history.at(0.9).unwrap(), [0.0; 4]);
        // ∫ (1 − e^(−t/0.1)) over the second, in steps of a thousandth.
        assert!((history.mean(1.0, 1.999).unwrap()[0] - 0.9).abs() < 2e-3);
    }

    #[test]
    fn nothing_is_known_while_the_motors_rest_and_shortly_after() {
        let frames = [
            frame(0.0, Some(0.5)),
            frame(1.0, None),
            frame(1.1, Some(0.5)),
            frame(2.0, Some(0.5)),
        ];
        let history = History::new(&frames, [0.02; 4]);
        assert_eq!(history.at(0.1), None);
        assert!(history.at(0.9).is_some());
        assert_eq!(history.at(1.25), None);
        assert!(history.at(1.4).is_some());
        assert_eq!(history.mean(0.9, 1.4), None);
        assert_eq!(history.at(3.0), None);
    }
}
