//! Measured battery: the newest voltage, its low-pass filter, and the thrust sticks that follow from it.
//!
//! The thrust of a stick is proportional to u² (`exponent` says otherwise), so the stick of a thrust T at the filtered voltage
//! u is that of T (calibrated/u)². Sagging under the corrected thrust, the battery closes a loop of its own. Its gain at rest is
//! 2d/(1 + 2d) for a droop d of the voltage per thrust, and so below 1 for every battery: with the filter it settles, and is
//! slower than the law.
//!
//! Failure policy: before the first voltage there is no correction. Without a new voltage the last correction stays: a battery
//! discharges slowly, and a step of the thrust would disturb the flight more.

use scenario::{LinkBattery, RcLink, VoltageSource};
use shared_types::battery::BatteryReading;
use shared_types::service::{nanoseconds, seconds};

use crate::channel_map::largest_code;
use crate::sticks::Sticks;

/// Monitor of the battery of a link's vehicle.
#[derive(Clone, Debug)]
pub(crate) struct BatteryMonitor {
    /// `None` without a measured battery in the scenario: the voltage is shown, and changes nothing.
    stated: Option<LinkBattery>,
    /// Thrust at a stick of 0, per unit of its travel, and the range of the travel.
    calibration: [f64; 2],
    range: [f64; 2],
    largest_code: f64,
    /// The newest voltage, V, with its time, ns.
    newest: Option<(f64, u64)>,
    /// Voltage behind the low-pass filter, V.
    filtered: f64,
}

impl BatteryMonitor {
    pub(crate) fn new(link: &RcLink) -> Self {
        let measured = |battery: &LinkBattery| battery.source == VoltageSource::Measured;
        Self {
            stated: link.battery.clone().filter(measured),
            calibration: [link.thrust_offset, link.thrust_slope],
            range: link.thrust_range,
            largest_code: f64::from(largest_code(link)),
            newest: None,
            filtered: 0.0,
        }
    }

    /// Returns whether the vehicle is to be asked for the voltage.
    pub(crate) fn asks(&self) -> bool {
        self.stated.is_some()
    }

    /// Continues with the last reading of a dead process.
    pub(crate) fn continue_from(&mut self, reading: &BatteryReading, now_ns: u64) {
        let at_ns = now_ns.saturating_sub(nanoseconds(reading.age));
        self.newest = Some((reading.voltage, at_ns));
        self.filtered = reading.voltage;
    }

    /// Adds a voltage, V.
    pub(crate) fn add(&mut self, voltage: f64, now_ns: u64) {
        let lag = self.stated.as_ref().map_or(0.0, |stated| stated.lag);
        self.filtered = match self.newest {
            None => voltage,
            Some((_, at_ns)) => {
                let pause = seconds(now_ns.saturating_sub(at_ns));
                voltage + (self.filtered - voltage) * libm::exp(-pause / lag.max(1e-9))
            }
        };
        self.newest = Some((voltage, now_ns));
    }

    /// Returns the reading for display, if there has been a voltage.
    pub(crate) fn reading(&self, now_ns: u64) -> Option<BatteryReading> {
        self.newest.map(|(voltage, at_ns)| BatteryReading {
            voltage,
            age: seconds(now_ns.saturating_sub(at_ns)),
            factor: self.factor(),
        })
    }

    fn factor(&self) -> Option<f64> {
        let stated = self.stated.as_ref().filter(|_| self.newest.is_some())?;
        stated.thrust_factor(self.filtered)
    }

    /// Corrects the thrust stick. A stick of no thrust stays where it is.
    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "limited to the codes of the link"
    )]
    pub(crate) fn correct(&self, sticks: &mut Sticks) {
        let (Some(factor), Some([code, ..])) = (self.factor(), &mut sticks.codes) else {
            return;
        };
        let [offset, slope] = self.calibration;
        let thrust = offset + slope * (2.0 * f64::from(*code) / self.largest_code - 1.0);
        if thrust <= 0.0 {
            return;
        }
        let [least, most] = self.range;
        let travel = ((factor * thrust - offset) / slope).clamp(least, most);
        *code = libm::round((travel + 1.0) / 2.0 * self.largest_code) as u16;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const S: u64 = 1_000_000_000;

    fn link(slope: f64) -> RcLink {
        RcLink {
            thrust_slope: slope,
            battery: Some(LinkBattery {
                calibrated: Some(8.0),
                ..LinkBattery::default()
            }),
            ..RcLink::default()
        }
    }

    fn thrust(link: &RcLink, code: u16) -> f64 {
        link.thrust_offset + link.thrust_slope * (2.0 * f64::from(code) / 2047.0 - 1.0)
    }

    proptest! {
        #[test]
        fn the_thrust_at_the_voltage_is_that_of_the_stick_before(
            code in 0..2048_u16, voltage in 6.6..9.0_f64, up in any::<bool>(),
        ) {
            let link = link(if up { 3.138 } else { -3.138 });
            let meant = thrust(&link, code);
            let mut monitor = BatteryMonitor::new(&link);
            monitor.add(voltage, S);
            let mut sticks = Sticks::flying([code, 1, 2, 3]);
            monitor.correct(&mut sticks);
            let [sent, others @ ..] = sticks.codes.unwrap();
            prop_assert_eq!(others, [1, 2, 3]);
            let share = voltage / 8.0;
            let acts = share * share * thrust(&link, sent);
            let most = thrust(&link, if up { 2047 } else { 0 });
            if meant <= 0.0 {
                prop_assert_eq!(sent, code);
            } else if meant / (share * share) < most {
                let half_a_step = 0.5 * 2.0 * 3.138 / 2047.0 * share * share;
                prop_assert!((acts - meant).abs() <= half_a_step + 1e-9, "{acts} for {meant}");
            } else {
                prop_assert_eq!(sent, if up { 2047 } else { 0 });
            }
        }
    }

    #[test]
    fn a_voltage_acts_slowly_and_keeps_acting_when_no_other_follows() {
        let mut monitor = BatteryMonitor::new(&link(3.138));
        let factor = |monitor: &BatteryMonitor, at_ns| monitor.reading(at_ns).unwrap().factor.unwrap();
        assert_eq!(monitor.reading(S), None);
        monitor.add(8.0, S);
        assert_eq!(factor(&monitor, S), 1.0);
        // A sag of a tenth of a second: the time constant is 2 s.
        monitor.add(6.0, S + S / 10);
        monitor.add(8.0, S + S / 5);
        assert!((1.0..1.03).contains(&factor(&monitor, S + S / 5)));
        for second in 2..30 {
            monitor.add(7.0, second * S);
        }
        let settled = 64.0 / 49.0;
        assert!((factor(&monitor, 30 * S) - settled).abs() < 1e-4);
        let reading = monitor.reading(90 * S).unwrap();
        assert_eq!((reading.age, reading.voltage), (61.0, 7.0));
        assert_eq!(factor(&monitor, 90 * S), factor(&monitor, 30 * S));
    }

    #[test]
    fn the_factor_stays_within_its_limits() {
        for (voltage, factor) in [(2.0, 1.5), (30.0, 0.7)] {
            let mut monitor = BatteryMonitor::new(&link(3.138));
            monitor.add(voltage, 0);
            assert_eq!(monitor.reading(0).unwrap().factor, Some(factor));
        }
    }

    #[test]
    fn a_voltage_without_a_stated_battery_or_calibration_changes_no_stick() {
        let without_calibration = Some(LinkBattery::default());
        for battery in [None, without_calibration] {
            let link = RcLink {
                battery,
                ..RcLink::default()
            };
            let mut monitor = BatteryMonitor::new(&link);
            monitor.add(7.0, 0);
            let mut sticks = Sticks::flying([1500, 1, 2, 3]);
            monitor.correct(&mut sticks);
            assert_eq!(sticks, Sticks::flying([1500, 1, 2, 3]));
            let reading = monitor.reading(0).unwrap();
            assert_eq!((reading.voltage, reading.factor), (7.0, None));
        }
    }

    /// The loop through a battery that sags under the thrust, at constant wanted thrust: the worst droop settles.
    #[test]
    fn a_battery_that_sags_under_the_corrected_thrust_settles_at_the_wanted_thrust() {
        for droop in [0.05, 0.15, 0.25] {
            let link = link(3.138);
            let mut monitor = BatteryMonitor::new(&link);
            let (wanted, mut acting) = (1.8, 1.8);
            let mut largest: f64 = 0.0;
            for step in 0..600_u64 {
                let share = 1.0 - droop * (acting / wanted - 0.5) - 0.05;
                if step % 5 == 0 {
                    monitor.add(8.0 * share, S + step * S / 10);
                }
                let factor = monitor.reading(S + step * S / 10).unwrap().factor.unwrap();
                acting = factor * share * share * wanted;
                largest = largest.max(acting);
            }
            assert!((acting / wanted - 1.0).abs() < 0.002, "{droop}: {acting}");
            assert!(largest < 1.1 * wanted, "{droop}: {largest}");
        }
    }
}
