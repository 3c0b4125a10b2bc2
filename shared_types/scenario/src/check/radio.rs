//! Checks of the radio link's calibration.

use super::{Findings, six_digits};
use crate::{Key, RcLink};

/// Keys that calibrate the link.
const CALIBRATION: [&str; 6] = [
    "thrust_offset",
    "thrust_slope",
    "rate_slope",
    "thrust_range",
    "rate_range",
    "resolution",
];

impl RcLink {
    /// Checks the calibration. Returns whether travels and thrusts can be computed with it.
    pub(super) fn check(&self, at: &Key, found: &mut Findings) -> bool {
        let before = found.problems.len();
        check_range(&self.thrust_range, &at.then("thrust_range"), found);
        let rate_range = at.then("rate_range");
        check_range(&self.rate_range, &rate_range, found);
        let [least, most] = self.rate_range;
        if least < most && (least >= 0.0 || most <= 0.0) {
            found.add(
                rate_range,
                format!("with rate channels from {least:?} to {most:?} the vehicle cannot turn both ways"),
                "give a range with 0 inside, such as [-1.0, 1.0]",
            );
        }
        let is_in_range = found.are_in_range(at, &CALIBRATION);
        if is_in_range && found.problems.len() == before {
            self.check_codes(at, found);
        }
        is_in_range && found.problems.len() == before
    }

    /// Requires at least one step of the link's resolution in each range.
    fn check_codes(&self, at: &Key, found: &mut Findings) {
        let quantum = 2.0 / f64::from((1_u32 << self.resolution) - 1);
        let [least, most] = self.thrust_limits();
        if most <= 0.0 {
            found.add(
                at.then("thrust_range"),
                "no travel of the thrust channel commands a thrust above 0 N",
                "check `thrust_offset`, `thrust_slope` and `thrust_range`; the paper uses 2.3071 and 3.138",
            );
            return;
        }
        let [low, high] = self.rate_range;
        for (name, width) in [
            ("thrust_range", (most - least) / self.thrust_slope.abs()),
            ("rate_range", high - low),
        ] {
            if width < quantum {
                found.add(
                    at.then(name),
                    format!(
                        "the range is {} wide, less than one of the steps of {}",
                        six_digits(width),
                        six_digits(quantum)
                    ),
                    "widen the range or raise `resolution`",
                );
            }
        }
    }
}

/// Requires a range of a channel's travel, from its lower to its upper end.
fn check_range(range: &[f64; 2], key: &Key, found: &mut Findings) {
    let [least, most] = *range;
    if least >= most {
        found.add(
            key.clone(),
            format!("from {least:?} to {most:?} is not a range of a channel"),
            "give the lower end first, and both from -1.0 to 1.0",
        );
    }
}
