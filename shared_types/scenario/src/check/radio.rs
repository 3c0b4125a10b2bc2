//! A radio link that can carry what a flight needs.

use std::ops::RangeInclusive;

use super::{Findings, six_digits};
use crate::{Key, RcLink};

/// Resolutions that a channel can have, bits.
const RESOLUTIONS: RangeInclusive<u32> = 1..=16;

impl RcLink {
    pub(super) fn check(&self, at: &Key, found: &mut Findings) {
        let mut good = found.number(&at.then("thrust_offset"), self.thrust_offset);
        good &= check_slope(self.thrust_slope, &at.then("thrust_slope"), found);
        for (axis, &slope) in self.rate_slope.iter().enumerate() {
            good &= check_slope(slope, &at.then("rate_slope").then(axis), found);
        }
        good &= check_range(&self.thrust_range, &at.then("thrust_range"), found);
        good &= self.check_rate_range(&at.then("rate_range"), found);
        if !RESOLUTIONS.contains(&self.resolution) {
            let (least, most) = (RESOLUTIONS.start(), RESOLUTIONS.end());
            found.add(
                at.then("resolution"),
                format!("a channel of {} bits", self.resolution),
                format!("give a resolution from {least} to {most} bits; 11 is usual"),
            );
        } else if good {
            self.check_codes(at, found);
        }
    }

    fn check_rate_range(&self, key: &Key, found: &mut Findings) -> bool {
        let good = check_range(&self.rate_range, key, found);
        let [least, most] = self.rate_range;
        let turns_both_ways = least < 0.0 && 0.0 < most;
        if good && !turns_both_ways {
            found.add(
                key.clone(),
                format!("with rate channels from {least:?} to {most:?} the vehicle cannot turn both ways"),
                "give a range with 0 inside, such as [-1.0, 1.0]",
            );
        }
        good && turns_both_ways
    }

    /// Requires a step of the link's resolution in each range.
    fn check_codes(&self, at: &Key, found: &mut Findings) {
        let quantum = 2.0 / f64::from((1_u32 << self.resolution) - 1);
        let [least, most] = self.thrust_limits();
        if most <= 0.0 {
            found.add(
                at.then("thrust_range"),
                "no travel of the thrust channel means a thrust above 0 N",
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

fn check_slope(slope: f64, key: &Key, found: &mut Findings) -> bool {
    let good = found.number(key, slope);
    if slope == 0.0 {
        found.add(
            key.clone(),
            "the slope is 0, so the channel means the same everywhere",
            "give a slope other than 0; a negative one turns the channel around",
        );
    }
    good && slope != 0.0
}

/// Part of the travel from −1 to 1.
fn check_range(range: &[f64; 2], key: &Key, found: &mut Findings) -> bool {
    let [least, most] = *range;
    let good = -1.0 <= least && least < most && most <= 1.0;
    if !good {
        found.add(
            key.clone(),
            format!("from {least:?} to {most:?} is no range of a channel"),
            "give the lower end first, and both from -1.0 to 1.0",
        );
    }
    good
}
