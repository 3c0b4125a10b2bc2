//! What the controller does about the age of the vehicle's state: which stage it is in, what it reckons, and how it
//! comes back to the law.
//!
//! While the last good state is no older than it is when nothing fails, the law has it as it is. An older one is
//! reckoned on to now, for the law as for what comes after it: the law of this paper on a state that stands still is
//! worse than no law at all, because it keeps turning the vehicle by an error that it has long mended.

use scenario::{EdgeName, GRAVITY, InputSafety, Scenario};
use shared_types::samples::VehicleState;
use shared_types::service::seconds;
use shared_types::{Now, ServiceId, Topic};

use crate::bumpless_transfer::Transfer;
use crate::dead_reckoning::{Commanded, DeadReckoning, ModelEstimate, Reckoned};
use crate::failsafe::{DESCENT, FailsafeStage, FailsafeStages, Leveler};

/// The policy for the vehicle's state, and what it remembers.
#[derive(Clone, Copy, Debug)]
pub struct Safety {
    stages: FailsafeStages,
    recover_ns: u64,
    /// The oldest that the state is while nothing fails, ns.
    ordinary_age_ns: u64,
    dead_reckoning: DeadReckoning,
    leveller: Leveler,
    /// The vehicle as reckoned.
    pub reckoned: Reckoned,
    /// The way back to the law.
    pub transfer: Transfer,
}

impl Safety {
    /// What a scenario that has been checked states for the state of the vehicle.
    #[must_use]
    pub fn new(scenario: &Scenario, stated: &InputSafety) -> Self {
        let dead_reckoning = DeadReckoning::new(scenario);
        let edge = EdgeName::of(Topic::VehicleState, ServiceId::Controller);
        Self {
            stages: FailsafeStages::new(stated),
            recover_ns: stated.recover_ns(),
            ordinary_age_ns: edge.map_or(0, |edge| scenario.ordinary_age_ns(edge)),
            dead_reckoning,
            leveller: Leveler::new(dead_reckoning.inertia, scenario.command_hold()),
            reckoned: Reckoned::NOTHING,
            transfer: Transfer::NONE,
        }
    }

    /// The stage of a state's age, ns. Without a last command there is none to hold: the vehicle levels out instead.
    #[must_use]
    pub fn stage(&self, age_ns: u64, last: Option<&Commanded>) -> FailsafeStage {
        match self.stages.at(age_ns) {
            FailsafeStage::Hold if last.is_none() => FailsafeStage::Level,
            stage => stage,
        }
    }

    /// Reckons the vehicle on to now: from the last good state, if it `is_new`, else from where it was reckoned to be.
    pub fn reckon(
        &mut self,
        now: &Now,
        state: &VehicleState,
        is_new: bool,
        age_ns: u64,
        last: Option<&Commanded>,
        estimate: &ModelEstimate,
    ) {
        let hover = Commanded {
            thrust: estimate.mass * GRAVITY,
            ..Commanded::NOTHING
        };
        let last = last.unwrap_or(&hover);
        if is_new || !self.reckoned.has_begun.is_set() {
            self.reckoned = self.dead_reckoning.begin(state, last, estimate);
            let late_ns = age_ns.saturating_sub(self.ordinary_age_ns);
            self.pass(late_ns, last, estimate);
        } else {
            self.pass(now.elapsed_ns, last, estimate);
        }
    }

    fn pass(&mut self, elapsed_ns: u64, last: &Commanded, estimate: &ModelEstimate) {
        if elapsed_ns > 0 {
            self.reckoned = self
                .dead_reckoning
                .advanced(&self.reckoned, last, estimate, seconds(elapsed_ns));
        }
    }

    /// The state for the law: the last good one, or if that is later than it should be the reckoned one.
    #[must_use]
    pub fn state_for_law(&self, state: &VehicleState, age_ns: u64, estimate: &ModelEstimate) -> VehicleState {
        if age_ns > self.ordinary_age_ns {
            self.reckoned.state(state, estimate)
        } else {
            *state
        }
    }

    /// What is commanded in a stage without the law.
    #[must_use]
    pub fn command(
        &self,
        stage: FailsafeStage,
        last: Option<&Commanded>,
        estimate: &ModelEstimate,
    ) -> Commanded {
        match stage {
            FailsafeStage::Nominal | FailsafeStage::Hold => last.copied().unwrap_or(Commanded::NOTHING),
            FailsafeStage::Level => self.leveller.command(&self.reckoned, estimate, 0.0),
            FailsafeStage::Descend => self.leveller.command(&self.reckoned, estimate, DESCENT),
            FailsafeStage::Failsafe => Commanded::NOTHING,
        }
    }

    /// The command when the law says `law`, after a step in the stage `before`.
    ///
    /// There is no way back from motors at rest: the law takes over at once.
    #[must_use]
    pub fn pass_over(
        &mut self,
        now: &Now,
        before: FailsafeStage,
        last: Option<&Commanded>,
        law: &Commanded,
    ) -> Commanded {
        self.transfer = match (before, last) {
            (FailsafeStage::Nominal, _) => self.transfer.advanced(now.elapsed_ns),
            (FailsafeStage::Failsafe, _) | (_, None) => Transfer::NONE,
            (_, Some(last)) => Transfer::new(last, law, self.recover_ns),
        };
        self.transfer.command(law)
    }
}
