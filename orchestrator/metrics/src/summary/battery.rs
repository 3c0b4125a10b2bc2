//! Modelled battery of a flight.

use std::fmt::{Display, Formatter, Result};

use serde::Serialize;
use shared_types::samples::RcFrame;

/// The modelled battery, as the frames state it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ModelledBattery {
    /// Least voltage while the motors turned, V.
    pub least_voltage: f64,
    /// Largest factor of the thrust; `None` without a correction.
    pub largest_factor: Option<f64>,
    /// `true` if it fell below its lowest voltage.
    pub was_low: bool,
}

impl ModelledBattery {
    /// Adds a frame to a battery, if its motors turn and it states one.
    pub(super) fn observe(battery: &mut Option<Self>, frame: &RcFrame) {
        let Some(reading) = frame.battery().filter(|_| frame.thrust > 0.0) else {
            return;
        };
        let battery = battery.get_or_insert(Self {
            least_voltage: reading.voltage,
            largest_factor: None,
            was_low: false,
        });
        battery.least_voltage = battery.least_voltage.min(reading.voltage);
        if let Some(factor) = reading.factor {
            let largest = battery.largest_factor.unwrap_or(factor);
            battery.largest_factor = Some(largest.max(factor));
        }
        battery.was_low |= frame.limit == RcFrame::LIMIT_BATTERY;
    }
}

impl Display for ModelledBattery {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        write!(
            formatter,
            "Modelled battery: {:.2} V at least",
            self.least_voltage
        )?;
        if let Some(factor) = self.largest_factor {
            write!(formatter, ", thrust sent times {factor:.3} at most")?;
        }
        formatter.write_str(".")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    #[test]
    fn the_least_voltage_under_load_and_the_largest_factor_are_told() {
        let mut battery = None;
        let mut observe = |thrust, voltage, factor, limit| {
            let mut frame = RcFrame::new_zeroed();
            frame.set_battery(voltage, factor);
            (frame.thrust, frame.limit) = (thrust, limit);
            ModelledBattery::observe(&mut battery, &frame);
        };
        observe(0.0, 3.0, Some(1.5), RcFrame::LIMIT_NONE);
        observe(1.0, 8.0, Some(1.125), RcFrame::LIMIT_NONE);
        observe(1.0, 7.5, Some(1.25), RcFrame::LIMIT_BATTERY);
        observe(1.0, 7.6, Some(1.2), RcFrame::LIMIT_NONE);
        let battery = battery.unwrap();
        let text = battery.to_string();
        assert_eq!(
            text,
            "Modelled battery: 7.50 V at least, thrust sent times 1.250 at most."
        );
        assert!(battery.was_low);
        let mut none = None;
        ModelledBattery::observe(&mut none, &RcFrame::new_zeroed());
        assert_eq!(none, None);
    }
}
