//! Battery voltage beside a frame or in a status word, where a sample has no field of its own.

use crate::samples::RcFrame;

/// Voltage of a battery, and what followed from it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatteryReading {
    /// Voltage, V.
    pub voltage: f64,
    /// Age of the voltage, s; at most [`OLDEST`](Self::OLDEST).
    pub age: f64,
    /// Factor of the thrust; `None` without a correction.
    pub factor: Option<f64>,
}

/// Volts of a step.
const MILLIVOLT: f64 = 1e-3;
/// Seconds of a step of the age.
const AGE_STEP: f64 = 0.1;
/// Steps of a factor of 1 in a status word, and in a frame.
const WORD_STEPS: f64 = 160.0;
const FRAME_STEPS: f64 = 16_384.0;

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "limited to the range of the field"
)]
fn steps(value: f64, step: f64, most: u16) -> u16 {
    libm::round((value / step).clamp(0.0, f64::from(most))) as u16
}

impl BatteryReading {
    /// Largest age that a reading states, s.
    pub const OLDEST: f64 = 25.5;

    /// Packs the reading into a status word: voltage in mV, age in 0.1 s, factor in 1/160. It is never 0.
    #[must_use]
    pub fn to_word(&self) -> u32 {
        let voltage = steps(self.voltage, MILLIVOLT, u16::MAX).max(1);
        let age = steps(self.age, AGE_STEP, 255);
        let factor = self
            .factor
            .map_or(0, |factor| steps(factor, 1.0 / WORD_STEPS, 255).max(1));
        u32::from(voltage) | u32::from(age) << 16 | u32::from(factor) << 24
    }

    /// Unpacks a status word; `None` if there has been no voltage.
    #[must_use]
    pub fn from_word(word: u32) -> Option<Self> {
        let [low, high, age, factor] = word.to_le_bytes();
        let voltage = u16::from_le_bytes([low, high]);
        (voltage > 0).then(|| Self {
            voltage: MILLIVOLT * f64::from(voltage),
            age: AGE_STEP * f64::from(age),
            factor: (factor > 0).then(|| f64::from(factor) / WORD_STEPS),
        })
    }
}

/// The modelled battery stands in the padding of a frame: voltage in mV, then the factor of the thrust in 1/16384, 0 without
/// one. It is not in the message definition, which would change the layout of every log.
impl RcFrame {
    /// Rounds a factor of the thrust to what a frame can state.
    #[must_use]
    #[inline]
    pub fn rounded_factor(factor: f64) -> f64 {
        f64::from(steps(factor, 1.0 / FRAME_STEPS, u16::MAX)) / FRAME_STEPS
    }

    /// States the voltage of the modelled battery, V, and the factor of the thrust.
    #[inline]
    pub fn set_battery(&mut self, voltage: f64, factor: Option<f64>) {
        let voltage = steps(voltage, MILLIVOLT, u16::MAX).max(1).to_le_bytes();
        let factor = factor.map_or(0, |factor| steps(factor, 1.0 / FRAME_STEPS, u16::MAX));
        let factor = factor.to_le_bytes();
        [self.pad0[0], self.pad0[1], self.pad0[2], self.pad0[3]] =
            [voltage[0], voltage[1], factor[0], factor[1]];
    }

    /// Returns the voltage of the modelled battery and the factor of the thrust; `None` unless it is modelled.
    #[must_use]
    pub fn battery(&self) -> Option<BatteryReading> {
        let voltage = u16::from_le_bytes([self.pad0[0], self.pad0[1]]);
        (voltage > 0).then(|| BatteryReading {
            voltage: MILLIVOLT * f64::from(voltage),
            age: 0.0,
            factor: Some(self.factor()).filter(|factor| *factor > 0.0),
        })
    }

    /// Returns the factor of the thrust that the channels contain and `thrust` does not; 0 without a correction.
    fn factor(&self) -> f64 {
        f64::from(u16::from_le_bytes([self.pad0[2], self.pad0[3]])) / FRAME_STEPS
    }

    /// Returns the thrust that the thrust channel means at the voltage of its calibration, N.
    #[must_use]
    #[inline]
    pub fn calibrated_thrust(&self) -> f64 {
        match self.factor() {
            0.0 => self.thrust,
            factor => factor * self.thrust,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    #[test]
    fn a_reading_survives_a_status_word_to_half_a_step_of_each_part() {
        assert_eq!(BatteryReading::from_word(0), None);
        for step in 0..1000_u32 {
            let part = f64::from(step) / 1000.0;
            let reading = BatteryReading {
                voltage: 1.0 + 60.0 * part,
                age: 40.0 * part,
                factor: (step % 3 > 0).then_some(0.5 + part),
            };
            let read = BatteryReading::from_word(reading.to_word()).unwrap();
            assert!((read.voltage - reading.voltage).abs() <= 0.000_501, "{reading:?}");
            assert!((read.age - reading.age.min(BatteryReading::OLDEST)).abs() <= 0.0501);
            assert_eq!(read.factor.is_some(), reading.factor.is_some());
            let difference = read.factor.zip(reading.factor).map(|(one, other)| one - other);
            assert!(difference.is_none_or(|difference| difference.abs() <= 0.5 / 160.0 + 1e-9));
        }
    }

    #[test]
    fn a_frame_without_a_modelled_battery_is_as_it_was_and_with_one_its_channel_means_more() {
        let mut frame = RcFrame::new_zeroed();
        frame.thrust = 2.0;
        assert_eq!((frame.battery(), frame.calibrated_thrust()), (None, 2.0));
        frame.set_battery(7.4, None);
        assert_eq!(frame.calibrated_thrust(), 2.0);
        let factor = RcFrame::rounded_factor(1.234_56);
        frame.set_battery(7.4, Some(factor));
        let battery = frame.battery().unwrap();
        assert_eq!((battery.voltage, battery.factor), (7.4, Some(factor)));
        assert_eq!(frame.calibrated_thrust(), 2.0 * factor);
    }
}
