//! Channel of the radio link: calibration and quantisation.
//!
//! A value x has the stick travel s = (x − offset)/slope in [−1, 1]. The link sends it as one of the codes 0 to 2^bits − 1,
//! equidistant with both ends included: s = 2 code/(2^bits − 1) − 1. With this even number of codes no code is exactly the
//! middle.

/// Calibration of a channel, and the codes within its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Channel {
    /// The value at a travel of 0.
    offset: f64,
    /// The value per unit of travel; not 0.
    slope: f64,
    /// The largest code of the link, 2^bits − 1.
    largest_code: f64,
    /// Minimum and maximum code within the limits.
    codes: [f64; 2],
}

/// Sent value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sent {
    pub code: u16,
    /// `true` if a limit changed the value by more than a quantum.
    pub saturated: bool,
}

impl Channel {
    /// Makes a channel on which a travel s within `range` is the value `offset` + `slope` s, in `resolution` bits.
    ///
    /// Sent codes are within the range: its limits are rounded inwards to codes.
    #[must_use]
    pub fn new(offset: f64, slope: f64, range: [f64; 2], resolution: u32) -> Self {
        let largest_code = f64::from((1_u32 << resolution.clamp(1, 16)) - 1);
        let [least, most] = range.map(|travel| (travel + 1.0) / 2.0 * largest_code);
        Self {
            offset,
            slope,
            largest_code,
            codes: [libm::ceil(least).max(0.0), libm::floor(most).min(largest_code)],
        }
    }

    /// Returns the code nearest to a value, within the limits.
    #[must_use]
    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a whole number within the codes of the link, of at most 16 bits"
    )]
    pub fn send(&self, value: f64) -> Sent {
        let travel = (value - self.offset) / self.slope;
        let wanted = (travel + 1.0) / 2.0 * self.largest_code;
        let [least, most] = self.codes;
        let limited = wanted.max(least).min(most);
        Sent {
            code: libm::round(limited) as u16,
            saturated: (wanted - limited).abs() > 1.0,
        }
    }

    /// Returns the value of a code.
    #[must_use]
    #[inline]
    pub fn meaning(&self, code: u16) -> f64 {
        self.offset + self.slope * (2.0 * f64::from(code) / self.largest_code - 1.0)
    }

    /// Returns the difference of the values of successive codes.
    #[must_use]
    pub fn quantum(&self) -> f64 {
        2.0 * self.slope.abs() / self.largest_code
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A channel with both senses of travel, from coarse to the finest, and the values at the ends of its range.
    fn channels() -> impl Strategy<Value = (Channel, [f64; 2])> {
        let slope = prop_oneof![-30.0..-0.1f64, 0.1..30.0f64];
        (-5.0..5.0f64, slope, 2..=16u32, 0.5..=1.0f64, 0.5..=1.0f64).prop_map(
            |(offset, slope, resolution, below, above)| {
                let ends = [-below, above].map(|travel| offset + slope * travel);
                let limits = [ends[0].min(ends[1]), ends[0].max(ends[1])];
                (Channel::new(offset, slope, [-below, above], resolution), limits)
            },
        )
    }

    proptest! {
        #[test]
        fn every_code_within_the_limits_means_a_value_that_is_sent_as_this_code((channel, _) in channels()) {
            let [least, most] = channel.codes.map(|code| code as u16);
            for code in (least..=most).step_by(usize::from(most - least) / 300 + 1) {
                let sent = channel.send(channel.meaning(code));
                prop_assert_eq!(sent, Sent { code, saturated: false });
            }
        }

        #[test]
        fn a_sent_value_within_the_limits_differs_by_half_a_step_at_most(
            (channel, [least, most]) in channels(), part in 0.0..=1.0f64,
        ) {
            // At the ends the limits are narrowed to codes, by less than a step.
            let half = 0.5 * channel.quantum();
            let value = least + half + part * (most - least - 2.0 * half);
            prop_assume!(least + half <= value && value <= most - half);
            let sent = channel.send(value);
            prop_assert!(!sent.saturated);
            let error = channel.meaning(sent.code) - value;
            prop_assert!(error.abs() <= half * (1.0 + 1e-9) + 1e-12, "{} of {}", error, half);
        }

        #[test]
        fn nothing_outside_of_the_limits_is_ever_sent((channel, [least, most]) in channels(), value in -1e3..1e3f64) {
            let meant = channel.meaning(channel.send(value).code);
            prop_assert!((least - 1e-12..=most + 1e-12).contains(&meant), "{} in {}..{}", meant, least, most);
        }

        #[test]
        fn a_value_is_saturated_when_it_lies_more_than_a_step_beyond_the_codes(
            (channel, _) in channels(), steps in 0.0..5.0f64, at_most in any::<bool>(),
        ) {
            prop_assume!((steps - 1.0).abs() > 1e-6);
            let [least, most] = channel.codes.map(|code| channel.meaning(code as u16));
            let outwards = (most - least).signum() * channel.quantum();
            let (end, value) = if at_most { (most, most + steps * outwards) } else { (least, least - steps * outwards) };
            let sent = channel.send(value);
            prop_assert_eq!(sent.saturated, steps > 1.0);
            prop_assert_eq!(channel.meaning(sent.code), end);
        }
    }

    #[test]
    fn the_ends_of_the_travel_are_the_first_and_the_last_code() {
        for resolution in 1..=16 {
            let channel = Channel::new(0.0, -19.0, [-1.0, 1.0], resolution);
            let last = ((1_u32 << resolution) - 1) as u16;
            assert_eq!(channel.send(19.0).code, 0);
            assert_eq!(channel.send(-19.0).code, last);
            assert_eq!([channel.meaning(0), channel.meaning(last)], [19.0, -19.0]);
        }
    }
}
