//! Modelled battery: the charge that the commanded thrust has spent, the voltage, and the factor of the thrust.
//!
//! ```text
//! u = full (1 − fade q − droop T/T0)      q̇ = T/(T0 endurance)      factor = (calibrated/u)^exponent, within limits
//! ```
//!
//! T is the commanded thrust, T0 that to which the model refers. The thrust that acts does not enter, so there is no loop: the
//! factor is a function of the command. What the model does not have: a battery that was not full, cold or worn, and currents
//! besides those of hover. Its state is the charge alone, a part of the checkpoint.

use scenario::{Action, BatteryModel, LinkBattery, LowVoltageAction, RcLink, VoltageSource};
use shared_types::samples::RcFrame;
use shared_types::service::seconds;

/// Steps of the whole charge in the checkpoint.
const WHOLE: f64 = 2_147_483_648.0;

/// Modelled battery of a flight.
#[derive(Clone, Debug)]
pub struct ModelledBattery {
    stated: LinkBattery,
    model: BatteryModel,
    /// q in 2⁻³¹.
    spent: u32,
}

/// What the battery means for a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatteryEffect {
    /// Voltage under the commanded thrust, V.
    pub voltage: f64,
    /// Factor of the thrust, rounded to what a frame states; `None` without a correction.
    pub factor: Option<f64>,
}

impl ModelledBattery {
    /// State of a battery whose charge is spent.
    pub const WHOLLY_SPENT: u32 = (1 << 31) - 1;

    /// Makes the battery of a checked link, as at the start of the flight; `None` unless it is modelled.
    #[must_use]
    pub fn new(link: Option<&RcLink>) -> Option<Self> {
        let stated = link?.battery.as_ref()?;
        let model = stated.model.as_ref()?;
        (stated.source == VoltageSource::Modelled).then(|| Self {
            stated: stated.clone(),
            model: model.clone(),
            spent: steps(model.spent),
        })
    }

    /// Adds the charge that a thrust (N) spends in a time (ns).
    #[inline]
    pub fn spend(&mut self, thrust: f64, elapsed_ns: u64) {
        let spending = self.model.spending(thrust.max(0.0), seconds(elapsed_ns));
        self.spent = (self.spent + steps(spending)).min(Self::WHOLLY_SPENT);
    }

    /// Returns the effect on a frame of this commanded thrust, N.
    #[must_use]
    #[inline]
    pub fn effect(&self, thrust: f64) -> BatteryEffect {
        let voltage = self.model.voltage(self.share(), thrust.max(0.0));
        BatteryEffect {
            voltage,
            factor: self.stated.thrust_factor(voltage).map(RcFrame::rounded_factor),
        }
    }

    /// Returns the action of a voltage below the lowest one. It is compared at the thrust of the model, so that no manoeuvre
    /// is the reason.
    #[must_use]
    pub fn low(&self) -> Option<Action> {
        let voltage = self.model.voltage(self.share(), self.model.thrust);
        let is_low = self.stated.lowest.is_some_and(|lowest| voltage < lowest);
        is_low.then_some(match self.stated.below {
            LowVoltageAction::Warn => Action::Warn,
            LowVoltageAction::Land => Action::Land,
        })
    }

    /// Returns q, the share of the charge that is spent.
    #[must_use]
    pub fn share(&self) -> f64 {
        f64::from(self.spent) / WHOLE
    }

    /// Returns the state.
    #[must_use]
    pub fn save(&self) -> u32 {
        self.spent
    }

    /// Restores the state.
    pub fn restore(&mut self, spent: u32) {
        self.spent = spent;
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "limited to the range of the number"
)]
fn steps(share: f64) -> u32 {
    libm::round((share * WHOLE).clamp(0.0, f64::from(ModelledBattery::WHOLLY_SPENT))) as u32
}
