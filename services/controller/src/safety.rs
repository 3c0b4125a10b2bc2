//! Policy for the age of the vehicle's state: the failsafe stage, the predicted state, and the return to the law.
//!
//! While the last good state is no older than without faults, the law uses it unchanged. An older one is predicted to
//! the present, for the law and for the later stages. On a state that stands still this law is worse than none, because
//! it keeps turning the vehicle by an error that has long been corrected.

use scenario::{EdgeName, GRAVITY, InputSafety, Scenario};
use shared_types::samples::{PathReference, VehicleState};
use shared_types::service::nanoseconds;
use shared_types::{Now, ServiceId, Topic};

use crate::bumpless_transfer::Transfer;
use crate::command_history::CommandHistory;
use crate::control_supervisor::ControlInput;
use crate::dead_reckoning::{DeadReckoning, ModelEstimate, Reckoned};
use crate::failsafe::{FailsafeStage, FailsafeStages, Leveler};
use control_law::signals::Commanded;

/// Policy for the vehicle's state, with its own state.
#[derive(Clone, Copy, Debug)]
pub struct Safety {
    stages: FailsafeStages,
    recover_ns: u64,
    /// Age up to which the law commands on a predicted state, ns.
    max_age_ns: u64,
    /// Oldest age of the state without faults, ns.
    ordinary_age_ns: u64,
    /// `true` if a state that coasts rests on inertial sensors: its attitude, height and velocity are measured.
    measures_motion: bool,
    dead_reckoning: DeadReckoning,
    leveller: Leveler,
    /// State from step to step.
    pub state: SafetyState,
}

shared_types::sample! {
    /// State of the policy.
    pub struct SafetyState {
        /// The predicted vehicle.
        pub reckoned: Reckoned,
        /// The transfer back to the law.
        pub transfer: Transfer,
        /// Time for which nothing has measured the vehicle, ns.
        pub unseen_ns: u64,
    }
}

impl SafetyState {
    /// State before the first step.
    pub const INITIAL: Self = Self {
        reckoned: Reckoned::NOTHING,
        transfer: Transfer::NONE,
        unseen_ns: 0,
    };
}

impl Safety {
    /// Makes the policy that a checked scenario states for the vehicle's state.
    #[must_use]
    pub fn new(scenario: &Scenario, stated: &InputSafety) -> Self {
        let dead_reckoning = DeadReckoning::new(scenario);
        let edge = EdgeName::between(Topic::VehicleState, ServiceId::Controller);
        Self {
            stages: FailsafeStages::new(stated),
            recover_ns: stated.recover_ns(),
            max_age_ns: nanoseconds(stated.max_age),
            ordinary_age_ns: edge.map_or(0, |edge| scenario.ordinary_age_ns(edge)),
            measures_motion: scenario.navigation.is_some(),
            dead_reckoning,
            leveller: Leveler::new(dead_reckoning.inertia, scenario.command_hold()),
            state: SafetyState::INITIAL,
        }
    }

    /// Returns the stage for the age of the state. Without a last command to hold, the vehicle levels out instead.
    pub fn stage(&mut self, now: &Now, input: &ControlInput<'_>, last: Option<&Commanded>) -> FailsafeStage {
        self.state.unseen_ns = if input.state.coasting.is_set() && !self.measures_motion {
            self.state.unseen_ns.saturating_add(now.elapsed_ns)
        } else {
            0
        };
        let late_ns = self.late_ns(input);
        let stage = if is_straight_down(input.reference) {
            self.stages
                .at_landing(input.age_ns, self.state.unseen_ns.max(late_ns))
        } else {
            self.stages.at(input.age_ns)
        };
        match stage {
            FailsafeStage::Hold if last.is_none() => FailsafeStage::Level,
            stage => stage,
        }
    }

    /// Predicts the present state of the vehicle: from a new state and the `commands` since, else from the last prediction.
    pub fn reckon(
        &mut self,
        now: &Now,
        input: &ControlInput<'_>,
        last: Option<&Commanded>,
        estimate: &ModelEstimate,
        commands: &mut CommandHistory,
    ) {
        let hover = Commanded {
            thrust: estimate.mass * GRAVITY,
            ..Commanded::NOTHING
        };
        let last = last.unwrap_or(&hover);
        commands.push(last, now.elapsed_ns, self.max_age_ns);
        let reckoned = &mut self.state.reckoned;
        if input.is_new || !reckoned.has_begun.is_set() {
            *reckoned = self
                .dead_reckoning
                .begin(reckoned, input.state, last, estimate, input.may_adapt);
            for (command, time) in commands.last(self.late_ns(input)) {
                self.pass(time, command, estimate);
            }
        } else {
            self.pass(now.elapsed(), last, estimate);
        }
    }

    /// Returns by how much the state is older than without faults, ns.
    fn late_ns(&self, input: &ControlInput<'_>) -> u64 {
        input.age_ns.saturating_sub(self.ordinary_age_ns)
    }

    fn pass(&mut self, elapsed: f64, command: &Commanded, estimate: &ModelEstimate) {
        if elapsed > 0.0 {
            self.state.reckoned =
                self.dead_reckoning
                    .advanced(&self.state.reckoned, command, estimate, elapsed);
        }
    }

    /// Returns the state for the law: the last good one, or if that is late the predicted one.
    #[must_use]
    pub fn state_for_law(&self, state: &VehicleState, age_ns: u64, estimate: &ModelEstimate) -> VehicleState {
        if age_ns > self.ordinary_age_ns {
            self.state.reckoned.state(state, estimate)
        } else {
            *state
        }
    }

    /// Returns the command of a stage without the law.
    #[must_use]
    pub fn command(
        &self,
        stage: FailsafeStage,
        last: Option<&Commanded>,
        estimate: &ModelEstimate,
    ) -> Commanded {
        match stage {
            FailsafeStage::Nominal | FailsafeStage::Hold => last.copied().unwrap_or(Commanded::NOTHING),
            FailsafeStage::Level => self.leveller.level(&self.state.reckoned, estimate),
            FailsafeStage::Descend => self.leveller.descend(&self.state.reckoned, estimate),
            FailsafeStage::Failsafe => Commanded::NOTHING,
        }
    }

    /// Returns the command for the law's command `law`, after a step in the stage `before`.
    ///
    /// There is no transfer from stopped motors: the law takes over at once.
    #[must_use]
    pub fn pass_over(
        &mut self,
        now: &Now,
        before: FailsafeStage,
        last: Option<&Commanded>,
        law: &Commanded,
    ) -> Commanded {
        let transfer = &mut self.state.transfer;
        *transfer = match (before, last) {
            (FailsafeStage::Nominal, _) => transfer.advanced(now.elapsed_ns),
            (FailsafeStage::Failsafe, _) | (_, None) => Transfer::NONE,
            (_, Some(last)) => Transfer::new(last, law, self.recover_ns),
        };
        transfer.command(law)
    }
}

/// Returns whether a reference is that of a landing straight down.
fn is_straight_down(reference: &PathReference) -> bool {
    let [x, y, z] = reference.derivative1_world;
    reference.phase == PathReference::PHASE_LAND && x == 0.0 && y == 0.0 && z > 0.0
}
