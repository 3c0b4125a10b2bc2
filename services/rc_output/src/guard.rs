//! Guard: the decision whether a command may be sent. None is sent before the arming, after a kill, or beyond the envelope.
//!
//! | condition | consequence |
//! | --- | --- |
//! | the operator has not armed | failsafe frames |
//! | in a flight with phases the motors have not turned for [`GROUNDED_AFTER`] since the operator armed, or have stopped for that long | failsafe frames until the operator arms again |
//! | in a flight with phases the inputs have not been recent since the arming, or since a cold start of the transmitter | failsafe frames |
//! | the operator killed | failsafe frames until the end of the run |
//! | a limit is exceeded for [`after`](scenario::Envelope::after), action *warn* | frames state it while the limit is exceeded |
//! | … action *land* | frames demand it until the motors have stopped for [`GROUNDED_AFTER`], even if the limit holds again |
//! | … action *kill* | failsafe frames until the end of the run |
//! | the modelled battery is below its lowest voltage, action *warn* or *land* | as a limit, at once |
//! | a demanded landing takes too long, or moves further out of the box | failsafe frames until the end of the run |
//!
//! Limits are checked from the first command that moves the vehicle until the motors have stopped for [`GROUNDED_AFTER`]
//! without a break. Commands that stop the motors for a shorter time reset nothing: the vehicle may still be in the air,
//! and a controller that intersperses such commands must not evade the limits. Of several exceeded limits the most severe
//! action holds, and of equal ones the first limit. A kill is part of the checkpoint. After a cold start of the transmitter
//! the operator's kill still holds, because it is in the control block, and the envelope is checked from the start.

use scenario::{Action, Scenario};
use shared_types::Now;
use shared_types::flight_phase::GROUNDED_AFTER;
use shared_types::sample::Flag;
use shared_types::samples::{ControlCommand, RcFrame, VehicleState};
use shared_types::service::nanoseconds;

use crate::envelope::{Envelope, EnvelopeInput, LIMITS};

shared_types::sample! {
    /// State of the guard.
    pub struct GuardMemory {
        /// Time since which each limit has been exceeded without a break, ns, plus 1; 0 while it is not.
        pub since_ns: [u64; 7],
        /// Time since which the vehicle has been to land, ns.
        pub landing_since_ns: u64,
        /// Time since which the motors have stopped without a break, ns, plus 1; 0 while they run.
        pub resting_since_ns: u64,
        /// The limit for which the vehicle is to land or was killed.
        pub limit: u8,
        /// Action until the vehicle rests or for ever: none, land or kill.
        pub action: u8,
        /// `true` if the inputs have been recent since the arming.
        pub passes: Flag,
        /// `true` if a command has moved the vehicle, and the motors have not rested for [`GROUNDED_AFTER`] since.
        pub moves: Flag,
        /// Number of the newest request to arm.
        pub arm_count: u8,
        /// `true` if that request has lapsed.
        pub lapsed: Flag,
        /// Explicit padding.
        pub pad0: [u8; 2],
    }
}

#[derive(Clone, Copy, Debug)]
pub struct GuardInput<'a> {
    /// The command to be sent.
    pub command: Option<&'a ControlCommand>,
    /// The last valid state of the vehicle.
    pub state: Option<&'a VehicleState>,
    /// `true` if the state is recent.
    pub state_is_fresh: bool,
    /// `true` if all needed inputs exist and are recent.
    pub inputs_are_fresh: bool,
    /// Action of a battery below its lowest voltage; `None` above it.
    pub low_battery: Option<Action>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GuardDecision {
    /// `true` if commands are sent.
    pub passes: bool,
    /// The limit that acts.
    pub limit: u8,
    pub action: u8,
}

/// Guard over the sent commands.
#[derive(Clone, Debug)]
pub struct Guard {
    envelope: Option<Envelope>,
    has_phases: bool,
    /// Its state.
    pub persistent: GuardMemory,
}

impl GuardMemory {
    const NOTHING: Self = Self {
        since_ns: [0; LIMITS],
        landing_since_ns: 0,
        resting_since_ns: 0,
        limit: RcFrame::LIMIT_NONE,
        action: RcFrame::ACTION_NONE,
        passes: Flag::CLEAR,
        moves: Flag::CLEAR,
        arm_count: 0,
        lapsed: Flag::CLEAR,
        pad0: [0; 2],
    };
}

impl GuardMemory {
    /// Updates the motion of the motors. Returns whether they have just been stopped for [`GROUNDED_AFTER`] without a break,
    /// since the arming or their last motion. No command shortens that time.
    fn update_motion(&mut self, now: &Now, moves: bool) -> bool {
        if moves {
            (self.moves, self.resting_since_ns) = (true.into(), 0);
            return false;
        }
        if self.resting_since_ns == 0 {
            self.resting_since_ns = now.time_ns + 1;
        }
        now.time_ns + 1 - self.resting_since_ns >= nanoseconds(GROUNDED_AFTER)
    }

    /// Updates the operator's requests to arm: a new one restarts the time at rest.
    fn update_arming(&mut self, now: &Now) {
        if self.arm_count != now.operator.arm_count {
            self.arm_count = now.operator.arm_count;
            self.lapsed = false.into();
            self.resting_since_ns = 0;
        }
    }

    /// Resets the limits of a vehicle on the ground, and its arming unless `stays_armed`.
    fn reset(&mut self, stays_armed: bool) {
        *self = Self {
            passes: (self.passes.is_set() && stays_armed).into(),
            lapsed: (self.lapsed.is_set() || !stays_armed).into(),
            arm_count: self.arm_count,
            ..Self::NOTHING
        };
    }
}

impl Guard {
    /// Makes the guard of a checked scenario, at the start of its flight.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            envelope: scenario.envelope.as_ref().map(Envelope::new),
            has_phases: scenario.flight.is_some(),
            persistent: GuardMemory::NOTHING,
        }
    }

    /// Returns whether the guard uses the vehicle's state.
    #[must_use]
    pub fn needs_state(&self) -> bool {
        self.envelope.as_ref().is_some_and(Envelope::needs_state)
    }

    /// Decides on the command of this step.
    pub fn decide(&mut self, now: &Now, case: &GuardInput<'_>) -> GuardDecision {
        if now.operator.killed && self.persistent.action != RcFrame::ACTION_KILL {
            self.kill(RcFrame::LIMIT_NONE);
        }
        let is_killed = self.persistent.action == RcFrame::ACTION_KILL;
        self.persistent.update_arming(now);
        if !is_killed && !now.operator.armed {
            self.persistent.reset(false);
        }
        let may_begin = !self.has_phases || case.inputs_are_fresh && !self.persistent.lapsed.is_set();
        if now.operator.armed && may_begin {
            self.persistent.passes = true.into();
        }
        if is_killed || !self.persistent.passes.is_set() {
            return self.decision(None);
        }
        let moving = case
            .command
            .filter(|command| command.mode != ControlCommand::MODE_FAILSAFE);
        if self.persistent.update_motion(now, moving.is_some()) {
            // Without phases a flight is armed only once.
            self.persistent.reset(!self.has_phases);
        }
        let warned = self.check(now, case, moving);
        self.decision(warned)
    }

    #[must_use]
    pub fn limited(&self, command: &ControlCommand) -> ControlCommand {
        let envelope = self.envelope.as_ref();
        envelope.map_or(*command, |envelope| envelope.limited(command))
    }

    /// Checks the limits and records their actions. Returns the limit with a warning only.
    fn check(&mut self, now: &Now, case: &GuardInput<'_>, moving: Option<&ControlCommand>) -> Option<u8> {
        if !self.persistent.moves.is_set() {
            return None;
        }
        let battery = case.low_battery.map(|action| (RcFrame::LIMIT_BATTERY, action));
        let Some(envelope) = self.envelope.as_ref() else {
            self.demand_landing(now, battery);
            return battery.map(|(limit, _)| limit);
        };
        let situation = EnvelopeInput {
            state: case.state,
            state_is_fresh: case.state_is_fresh,
            command: moving,
        };
        let exceeded = envelope.exceeded(&situation);
        let (after_ns, land_within_ns) = (envelope.after_ns(), envelope.land_within_ns());
        let is_leaving = envelope.is_leaving(case.state);
        let gravest = most_severe(now, &mut self.persistent.since_ns, &exceeded, after_ns);
        let gravest = match (gravest, battery) {
            (Some(limit), Some(battery)) if battery.1 > limit.1 => Some(battery),
            (limit, battery) => limit.or(battery),
        };
        match gravest {
            Some((limit, Action::Kill)) => self.kill(limit),
            gravest => self.demand_landing(now, gravest),
        }
        // Stopped motors need no kill, and a landed vehicle may be armed again.
        if self.persistent.action == RcFrame::ACTION_LAND && moving.is_some() {
            if is_leaving {
                self.kill(RcFrame::LIMIT_BOX);
            } else if now.time_ns.saturating_sub(self.persistent.landing_since_ns) > land_within_ns {
                self.kill(RcFrame::LIMIT_LANDING_TIME);
            }
        }
        gravest.map(|(limit, _)| limit)
    }

    /// Demands a landing if the action of a limit does, and nothing was demanded before.
    fn demand_landing(&mut self, now: &Now, gravest: Option<(u8, Action)>) {
        if let Some((limit, Action::Land)) = gravest
            && self.persistent.action == RcFrame::ACTION_NONE
        {
            (self.persistent.limit, self.persistent.action) = (limit, RcFrame::ACTION_LAND);
            self.persistent.landing_since_ns = now.time_ns;
        }
    }

    fn kill(&mut self, limit: u8) {
        (self.persistent.limit, self.persistent.action) = (limit, RcFrame::ACTION_KILL);
    }

    fn decision(&self, warned: Option<u8>) -> GuardDecision {
        let GuardMemory {
            limit,
            action,
            passes,
            ..
        } = self.persistent;
        let (limit, action) = match warned {
            Some(limit) if action == RcFrame::ACTION_NONE => (limit, RcFrame::ACTION_WARN),
            _ => (limit, action),
        };
        GuardDecision {
            passes: passes.is_set() && action != RcFrame::ACTION_KILL,
            limit,
            action,
        }
    }
}

/// Returns the most severe action of the limits exceeded for long enough, and the first limit with it.
fn most_severe(
    now: &Now,
    since_ns: &mut [u64; LIMITS],
    exceeded: &[Option<(u8, Action, bool)>; LIMITS],
    after_ns: u64,
) -> Option<(u8, Action)> {
    let mut gravest: Option<(u8, Action)> = None;
    for (since, limit) in since_ns.iter_mut().zip(exceeded) {
        let Some((limit, action, true)) = *limit else {
            *since = 0;
            continue;
        };
        if *since == 0 {
            *since = now.time_ns + 1;
        }
        let acts = now.time_ns + 1 - *since >= after_ns;
        if acts && gravest.is_none_or(|(_, other)| action > other) {
            gravest = Some((limit, action));
        }
    }
    gravest
}
