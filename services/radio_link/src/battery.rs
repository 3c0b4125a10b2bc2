//! Measured battery: the newest voltage, its low-pass filter, and the thrust sticks that follow from it.
//!
//! The thrust of a stick is proportional to u² (`exponent` says otherwise), so the stick of a thrust T at the filtered voltage
//! u is that of T (calibrated/u)². Sagging under the corrected thrust, the battery closes a loop of its own. Its gain at rest is
//! 2d/(1 + 2d) for a droop d of the voltage per thrust, if the current is proportional to the thrust. A real current grows faster,
//! and the gain comes near 1 for a battery at its largest power: there the limits of the factor hold.
//!
//! Failure policy: the thrust never steps. The correction begins at a factor of 1 and follows voltages under thrust alone: that of
//! a resting battery is not the one that acts. A voltage whose own factor lies beyond the limits is of another kind, such as that
//! of one cell, or of another vehicle, and corrects nothing. Without a new voltage the last correction stays, and after a pause
//! one voltage counts as after half a time constant.

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
    /// Voltage behind the low-pass filter, V, and the time of the last one that it took, ns.
    filtered: f64,
    taken_ns: u64,
    /// `true` if the last sticks had a thrust.
    pulls: bool,
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
            filtered: calibrated(link.battery.as_ref()),
            taken_ns: 0,
            pulls: false,
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
        if let Some((factor, stated)) = reading.factor.zip(self.stated.as_ref()) {
            self.filtered = calibrated(Some(stated)) / libm::pow(factor, stated.exponent.recip());
            self.taken_ns = at_ns;
        }
    }

    /// Adds a voltage, V.
    pub(crate) fn add(&mut self, voltage: f64, now_ns: u64) {
        self.newest = Some((voltage, now_ns));
        let Some(stated) = self
            .stated
            .as_ref()
            .filter(|stated| stated.is_correctable(voltage))
        else {
            return;
        };
        if self.pulls {
            let pause = seconds(now_ns.saturating_sub(self.taken_ns)).min(stated.lag / 2.0);
            self.filtered = voltage + (self.filtered - voltage) * libm::exp(-pause / stated.lag.max(1e-9));
            self.taken_ns = now_ns;
        }
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

    /// Corrects the thrust stick. One of no thrust, and one at an end of its way, stays where it is.
    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "limited to the codes of the link"
    )]
    pub(crate) fn correct(&mut self, sticks: &mut Sticks) {
        let factor = self.factor();
        self.pulls = false;
        let Some([code, ..]) = &mut sticks.codes else {
            return;
        };
        let [offset, slope] = self.calibration;
        let thrust = offset + slope * (2.0 * f64::from(*code) / self.largest_code - 1.0);
        let is_at_an_end = *code == 0 || f64::from(*code) >= self.largest_code;
        self.pulls = thrust > 0.0 && !is_at_an_end;
        let Some(factor) = factor.filter(|_| self.pulls) else {
            return;
        };
        let [least, most] = self.range;
        let travel = ((factor * thrust - offset) / slope).clamp(least, most);
        *code = libm::round((travel + 1.0) / 2.0 * self.largest_code) as u16;
    }
}

/// Returns the voltage at which the thrust was calibrated, V; 1 without.
fn calibrated(stated: Option<&LinkBattery>) -> f64 {
    stated.and_then(|stated| stated.calibrated).unwrap_or(1.0)
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

    /// Adds a voltage each second for 40 s, with the motors turning.
    fn settle(monitor: &mut BatteryMonitor, voltage: f64, from_ns: u64) {
        for second in 1..=40 {
            monitor.correct(&mut Sticks::flying([1500, 1024, 1024, 1024]));
            monitor.add(voltage, from_ns + second * S);
        }
    }

    fn factor(monitor: &BatteryMonitor) -> f64 {
        monitor.reading(0).unwrap().factor.unwrap()
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
            settle(&mut monitor, voltage, 0);
            let mut sticks = Sticks::flying([code, 1, 2, 3]);
            monitor.correct(&mut sticks);
            let [sent, others @ ..] = sticks.codes.unwrap();
            prop_assert_eq!(others, [1, 2, 3]);
            let share = voltage / 8.0;
            let acts = share * share * thrust(&link, sent);
            let most = thrust(&link, if up { 2047 } else { 0 });
            if meant <= 0.0 || [0, 2047].contains(&code) {
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
    fn a_voltage_acts_slowly_from_a_factor_of_1_on_and_keeps_acting_when_no_other_follows() {
        let mut monitor = BatteryMonitor::new(&link(3.138));
        assert_eq!(monitor.reading(S), None);
        monitor.pulls = true;
        monitor.add(8.0, 100 * S);
        assert_eq!(factor(&monitor), 1.0);
        // A sag of a tenth of a second: the time constant is 2 s.
        monitor.add(6.6, 100 * S + S / 10);
        monitor.add(8.0, 100 * S + S / 5);
        assert!((1.0..1.03).contains(&factor(&monitor)));
        settle(&mut monitor, 7.0, 100 * S);
        let settled = 64.0 / 49.0;
        assert!((factor(&monitor) - settled).abs() < 1e-4);
        let reading = monitor.reading(200 * S).unwrap();
        assert_eq!(
            (reading.age, reading.voltage, reading.factor),
            (60.0, 7.0, Some(factor(&monitor)))
        );
        // After a minute without a voltage one counts as after half a time constant.
        monitor.add(8.0, 200 * S);
        assert!(factor(&monitor) > 1.0 + 0.5 * (settled - 1.0));
    }

    #[test]
    fn a_voltage_at_rest_or_of_another_kind_corrects_nothing() {
        let mut monitor = BatteryMonitor::new(&link(3.138));
        let mut off = Sticks::MOTORS_OFF;
        for second in 1..60 {
            monitor.correct(&mut off);
            monitor.add(8.4, second * S);
        }
        assert_eq!(factor(&monitor), 1.0);
        // The mean of a cell, a battery with twice the cells, a flight controller on USB.
        for voltage in [3.8, 15.2, 4.9] {
            settle(&mut monitor, voltage, 0);
            assert_eq!(
                (factor(&monitor), monitor.reading(0).unwrap().voltage),
                (1.0, voltage)
            );
        }
    }

    #[test]
    fn a_process_that_takes_over_continues_with_the_factor_and_not_with_the_last_voltage() {
        let mut monitor = BatteryMonitor::new(&link(3.138));
        settle(&mut monitor, 7.0, 0);
        monitor.add(6.7, 40 * S + 1);
        let reading = monitor.reading(41 * S).unwrap();
        let told = BatteryReading::from_word(reading.to_word()).unwrap();
        let mut successor = BatteryMonitor::new(&link(3.138));
        successor.continue_from(&told, 50 * S);
        assert!((factor(&successor) - factor(&monitor)).abs() < 0.5 / 160.0 + 1e-9);
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
        for droop in [0.05, 0.1, 0.15] {
            let link = link(3.138);
            let mut monitor = BatteryMonitor::new(&link);
            let (wanted, mut acting) = (1.8, 1.8);
            let mut largest: f64 = 0.0;
            for step in 0..600_u64 {
                let share = 1.0 - droop * (acting / wanted - 0.5) - 0.05;
                if step % 5 == 0 {
                    monitor.pulls = true;
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
