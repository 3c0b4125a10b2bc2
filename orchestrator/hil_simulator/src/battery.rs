//! Battery of the simulated vehicle: the plant's, read from the thrust that acts, and reported as telemetry.

use scenario::Scenario;
use shared_types::samples::VehicleTruth;
use shared_types::service::seconds;

/// Period of reports, ns.
const PERIOD_NS: u64 = 250_000_000;

/// The battery of a vehicle that reports it.
#[derive(Debug)]
pub(super) struct SimulatedBattery {
    stated: scenario::Battery,
    /// Voltage at u = 1, V.
    full: f64,
    /// T0, N.
    initial_thrust: f64,
    /// q, the share of the charge that is spent.
    spent: f64,
    due_ns: u64,
}

impl SimulatedBattery {
    /// Makes the battery of a scenario; `None` without one that states its voltage.
    pub(super) fn new(scenario: &Scenario) -> Option<Self> {
        let actuators = scenario.vehicle.actuators.as_ref()?;
        let stated = actuators.battery.clone()?;
        Some(Self {
            full: stated.voltage?,
            stated,
            initial_thrust: actuators.initial_thrust,
            spent: 0.0,
            due_ns: 0,
        })
    }

    /// Spends the charge of a tick. Returns the voltage, V, if it is due to be reported.
    pub(super) fn advance(&mut self, truth: &VehicleTruth, tick_ns: u64) -> Option<f64> {
        let load = truth.thrust / self.initial_thrust;
        self.spent += seconds(tick_ns) * load / self.stated.endurance;
        let share = self.stated.voltage_share(self.spent, load);
        let now_ns = truth.header.stamp_ns;
        (now_ns >= self.due_ns).then(|| {
            self.due_ns = now_ns + PERIOD_NS;
            self.full * share
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    #[test]
    fn the_voltage_falls_with_load_and_charge_and_is_reported_four_times_a_second() {
        let scenario: Scenario = toml::from_str(
            "duration = 1.0\n\
             [vehicle]\nmass = 0.2\ninertia = [6.5e-4, 6.5e-4, 13.0e-4]\n\
             [vehicle.actuators]\ninitial_thrust = 2.0\n\
             battery = { endurance = 100.0, fade = 0.2, droop = 0.1, voltage = 8.0 }\n\
             [path.curve.hover]\nposition = [0.0, 0.0, -1.0]",
        )
        .unwrap();
        let mut battery = SimulatedBattery::new(&scenario).unwrap();
        let mut truth = VehicleTruth::new_zeroed();
        let mut reports = Vec::new();
        for ms in 0..50_000 {
            truth.header.stamp_ns = ms * 1_000_000;
            truth.thrust = 2.0;
            reports.extend(battery.advance(&truth, 1_000_000));
        }
        assert_eq!(reports.len(), 200);
        assert!((reports[0] - 8.0 * 0.9).abs() < 1e-3, "{}", reports[0]);
        assert!((reports[199] - 8.0 * 0.8).abs() < 0.01, "{}", reports[199]);
        let mut without = scenario.clone();
        without
            .vehicle
            .actuators
            .as_mut()
            .unwrap()
            .battery
            .as_mut()
            .unwrap()
            .voltage = None;
        assert!(SimulatedBattery::new(&without).is_none());
    }
}
