//! Battery of the vehicle, as the transmitter knows it: its voltage, and the thrust that follows from it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::vehicle::is_zero_number;
use crate::range::{between, positive, share};

/// Source of the battery's voltage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VoltageSource {
    /// What the vehicle sends back over the radio link of a laboratory; nothing in simulated time.
    #[default]
    Measured,
    /// The stated model, which adds up the charge of the commanded thrust.
    Modelled,
}

/// Action below the lowest voltage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LowVoltageAction {
    /// A warning.
    #[default]
    Warn,
    /// The vehicle must land; needs `[flight]`.
    Land,
}

/// Battery of the vehicle: with `calibrated` the link sends a thrust T as the stick of T (calibrated/now)^exponent.
///
/// `calibrated` and the measured voltage are under the load of flight; at rest a battery shows more.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LinkBattery {
    /// Source of the voltage.
    pub source: VoltageSource,
    /// Voltage, under the load of flight, at which thrust was calibrated, V; no correction of the thrust unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(1.0, 100.0), extend("x-hint" = "such as 3.8 V a cell: the mean of the flight in which it was calibrated"))]
    pub calibrated: Option<f64>,
    /// Exponent of the voltage in the thrust of a stick: 2 for a motor whose stick is a share of the voltage.
    #[schemars(transform = between(0.5, 3.0), extend("x-hint" = "2 unless a thrust stand shows another"))]
    pub exponent: f64,
    /// Least and largest factor of the thrust.
    #[schemars(transform = between(0.5, 1.5))]
    pub factor: [f64; 2],
    /// Time constant of the low-pass filter of a measured voltage, s.
    #[schemars(transform = between(0.5, 60.0), extend("x-hint" = "slower than the sag of a manoeuvre, faster than the discharge; 2 is usual"))]
    pub lag: f64,
    /// Age above which a measured voltage counts as old, s; the thrust keeps its last correction.
    #[schemars(transform = between(0.5, 600.0), extend("x-hint" = "receivers send it about once a second"))]
    pub max_age: f64,
    /// Lowest voltage under load, V; no limit unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(1.0, 100.0), extend("x-hint" = "3.3 to 3.5 V a cell"))]
    pub lowest: Option<f64>,
    /// Action below the lowest voltage.
    pub below: LowVoltageAction,
    /// Model of the battery, for the source `modelled`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<BatteryModel>,
}

/// Model of the battery, that of `vehicle.actuators.battery`: its voltage is `full` (1 − fade q − droop T/thrust).
///
/// q is the spent share of the charge, with dq/dt = T/(thrust endurance), and T the commanded thrust.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BatteryModel {
    /// Open-circuit voltage of the full battery, V.
    #[schemars(transform = between(1.0, 100.0), extend("x-hint" = "4.2 V a cell"))]
    pub full: f64,
    /// Thrust to which the other values refer, that of hover, N.
    #[schemars(transform = positive)]
    pub thrust: f64,
    /// Share of the charge that is spent at the start of the flight.
    #[serde(default, skip_serializing_if = "is_zero_number")]
    #[schemars(transform = share)]
    pub spent: f64,
    /// Time for which the battery sustains `thrust`, s.
    #[schemars(transform = positive)]
    pub endurance: f64,
    /// Share of the voltage lost from full to empty.
    #[schemars(transform = share)]
    pub fade: f64,
    /// Share of the voltage lost at the battery's resistance at `thrust`.
    #[serde(default)]
    #[schemars(transform = share)]
    pub droop: f64,
}

impl Default for LinkBattery {
    fn default() -> Self {
        Self {
            source: VoltageSource::Measured,
            calibrated: None,
            exponent: 2.0,
            factor: [0.7, 1.5],
            lag: 2.0,
            max_age: 5.0,
            lowest: None,
            below: LowVoltageAction::Warn,
            model: None,
        }
    }
}

impl BatteryModel {
    /// Returns the voltage at a spent share of the charge and a thrust, V and N; never below half of the full voltage.
    #[must_use]
    pub fn voltage(&self, spent: f64, thrust: f64) -> f64 {
        self.full * (1.0 - self.fade * spent - self.droop * thrust / self.thrust).max(0.5)
    }

    /// Returns the share of the charge that a thrust (N) spends in a time (s).
    #[must_use]
    pub fn spending(&self, thrust: f64, time: f64) -> f64 {
        time * thrust / (self.thrust * self.endurance)
    }
}

impl LinkBattery {
    /// Returns the factor of a thrust at a voltage, V, within its limits; `None` without a correction.
    #[must_use]
    pub fn thrust_factor(&self, voltage: f64) -> Option<f64> {
        let [least, most] = self.factor;
        Some(self.unlimited_factor(voltage)?.clamp(least, most))
    }

    /// Returns whether the factor of a voltage, V, lies within its limits.
    #[must_use]
    pub fn is_correctable(&self, voltage: f64) -> bool {
        let [least, most] = self.factor;
        let factor = self.unlimited_factor(voltage);
        factor.is_some_and(|factor| (least..=most).contains(&factor))
    }

    fn unlimited_factor(&self, voltage: f64) -> Option<f64> {
        Some(libm::pow(self.calibrated? / voltage, self.exponent))
    }
}
