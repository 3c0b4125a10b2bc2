//! Checks of the kill switch. Opening the device checks whether it exists.

use super::Findings;
use crate::{Key, KillSwitchLoss, OrchestratorLoss, Scenario};

impl Scenario {
    /// Checks the devices of the operator.
    pub(super) fn check_operator(&self, found: &mut Findings) {
        let Some(operator) = &self.operator else { return };
        let at = Key::root().then("operator");
        if operator.kill_device.is_empty() {
            found.add(
                at.then("kill_device"),
                "the kill switch has no name",
                "give its path, such as one of /dev/input/by-id; `gerono operator probe` tests it",
            );
        }
        let after_loss = self.real_time.unwrap_or_default().orchestrator_loss;
        if after_loss == OrchestratorLoss::Continue && operator.on_loss != KillSwitchLoss::Ignore {
            found.add(
                at.then("on_loss"),
                "the orchestrator reads the kill switch, but the services are to fly on without the orchestrator",
                "leave out `real_time.orchestrator_loss`, or state `on_loss = \"ignore\"`",
            );
        }
    }
}
