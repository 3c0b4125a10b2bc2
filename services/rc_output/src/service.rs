//! Step function of the transmitter.

use scenario::Scenario;
use shared_types::input_validator::{
    GateState, InputValidator, StateGateState, StateValidator, Validity, is_of_the_past,
};
use shared_types::samples::{ControlCommand, RcFrame};
use shared_types::service::nanoseconds;
use shared_types::wiring::{RcOutputInputs, RcOutputOutputs};
use shared_types::{Now, Service, ServiceId, Topic};

use crate::battery::ModelledBattery;
use crate::guard::{Guard, GuardInput, GuardMemory};
use crate::link::Link;

shared_types::sample! {
    /// State of the transmitter between steps, besides the newest command.
    pub struct RcOutputState {
        /// The last valid command; all zero before the first.
        pub held: ControlCommand,
        /// State of the input validator of commands.
        pub gate: GateState,
        /// State of the input validator of the vehicle's states; as at the start without an envelope.
        pub states: StateGateState,
        /// State of the guard.
        pub guard: GuardMemory,
        /// Saturated frames since the start of the flight.
        pub saturated_frames: u32,
        /// Charge that the modelled battery has spent, in 2⁻³¹; 0 without one. Named as the padding that it was, so that
        /// checkpoints of earlier logs keep their layout.
        pub pad0: u32,
    }
}

/// Transmitter as a service.
#[derive(Clone, Debug)]
pub struct RcOutputService {
    link: Link,
    patience: Option<AgeLimits>,
    commands: InputValidator<ControlCommand>,
    states: StateValidator,
    guard: Guard,
    battery: Option<ModelledBattery>,
    /// Maximum ages of recent commands and states, ns.
    fresh_ns: [u64; 2],
    saturated_frames: u32,
}

/// Age limits of a command.
#[derive(Clone, Copy, Debug)]
struct AgeLimits {
    max_age_ns: u64,
    failsafe_ns: u64,
}

impl RcOutputService {
    /// Makes the transmitter of a checked scenario, at the start of the flight.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let safety = scenario.safety_of(Topic::ControlCommand, ServiceId::RcOutput);
        Self {
            link: Link::new(scenario.rc_output.as_ref()),
            patience: safety.map(|safety| AgeLimits {
                max_age_ns: nanoseconds(safety.max_age),
                failsafe_ns: safety.failsafe.map_or(u64::MAX, nanoseconds),
            }),
            commands: InputValidator::default(),
            states: StateValidator::new(
                scenario
                    .safety_of(Topic::VehicleState, ServiceId::RcOutput)
                    .map(scenario::InputSafety::policy),
            ),
            guard: Guard::new(scenario),
            battery: ModelledBattery::new(scenario.rc_output.as_ref()),
            fresh_ns: [Topic::ControlCommand, Topic::VehicleState]
                .map(|topic| scenario.fresh_age_ns(topic, ServiceId::RcOutput)),
            saturated_frames: 0,
        }
    }

    /// Returns whether the newest command and, if needed, the newest state are valid and recent.
    fn freshness(&self, now: &Now, inputs: &RcOutputInputs<'_>) -> [bool; 2] {
        let [oldest_command, oldest_state] = self.fresh_ns;
        let is_within = |age: Option<u64>, oldest: u64| age.is_some_and(|age| age <= oldest);
        let command = self.commands.is_newest(&inputs.command)
            && self.commands.held().is_some()
            && is_within(self.commands.age_ns(now), oldest_command);
        let state = self.states.held().is_some_and(|state| state.tracked.is_set())
            && is_within(self.states.age_ns(now), oldest_state);
        [command, state]
    }

    /// Selects the command of this step's frame, and its stage.
    fn choose(&self, now: &Now, inputs: &RcOutputInputs<'_>) -> (Option<&ControlCommand>, u8) {
        let (held, age) = (self.commands.held(), self.commands.age_ns(now));
        let is_older_than = |most: fn(AgeLimits) -> u64| {
            let most = self.patience.map_or(u64::MAX, most);
            age.is_some_and(|age| age > most)
        };
        match held.filter(|_| !is_older_than(|patience| patience.failsafe_ns)) {
            None => (None, RcFrame::STAGE_FAILSAFE),
            Some(held)
                if self.commands.is_newest(&inputs.command)
                    && !is_older_than(|patience| patience.max_age_ns) =>
            {
                (Some(held), RcFrame::STAGE_COMMAND)
            }
            Some(held) => (Some(held), RcFrame::STAGE_HOLD),
        }
    }
}

/// Validates a command whose numbers are finite.
fn validity(command: &ControlCommand, now: &Now, has_age_limits: bool) -> Validity {
    let has_mode = matches!(
        command.mode,
        ControlCommand::MODE_TORQUE | ControlCommand::MODE_RATES | ControlCommand::MODE_FAILSAFE
    );
    if has_mode && (!has_age_limits || is_of_the_past(command, now)) {
        Validity::Good
    } else {
        Validity::Refused
    }
}

impl Service for RcOutputService {
    const ID: ServiceId = ServiceId::RcOutput;
    type Inputs<'a> = RcOutputInputs<'a>;
    type Outputs<'a> = RcOutputOutputs<'a>;
    type State = RcOutputState;

    fn step(&mut self, now: &Now, inputs: &RcOutputInputs<'_>, outputs: &mut RcOutputOutputs<'_>) {
        let has_age_limits = self.patience.is_some();
        self.commands.look(&inputs.command, f64::MAX, |command, _| {
            validity(command, now, has_age_limits)
        });
        let needs_state = self.guard.needs_state();
        if needs_state {
            self.states.look(now, &inputs.state);
        }
        let [command_is_fresh, state_is_fresh] = self.freshness(now, inputs);
        let inputs_are_fresh = command_is_fresh && (state_is_fresh || !needs_state);
        let (command, stage) = self.choose(now, inputs);
        let command = command.copied();
        let decision = self.guard.decide(
            now,
            &GuardInput {
                command: command.as_ref(),
                state: self.states.held(),
                state_is_fresh,
                inputs_are_fresh,
                low_battery: self.battery.as_ref().and_then(ModelledBattery::low),
            },
        );
        let sent = command
            .filter(|_| decision.passes)
            .map(|command| self.guard.limited(&command));
        let thrust = sent
            .filter(|command| command.mode != ControlCommand::MODE_FAILSAFE)
            .map_or(0.0, |command| command.thrust);
        if let Some(battery) = &mut self.battery {
            battery.spend(thrust, now.elapsed_ns);
        }
        let Some(frame) = outputs.frame.due() else {
            return;
        };
        let effect = self.battery.as_ref().map(|battery| battery.effect(thrust));
        self.link.transmit(sent.as_ref(), effect.as_ref(), frame);
        if let Some(effect) = effect {
            frame.set_battery(effect.voltage, effect.factor);
        }
        if !frame.failsafe.is_set() && sent.zip(command).is_some_and(|(sent, asked)| sent != asked) {
            frame.saturated = true.into();
        }
        (frame.limit, frame.action) = (decision.limit, decision.action);
        frame.inputs_fresh = inputs_are_fresh.into();
        frame.stage = if frame.failsafe.is_set() {
            RcFrame::STAGE_FAILSAFE
        } else {
            stage
        };
        let counts = u32::from(frame.saturated.is_set());
        self.saturated_frames = self.saturated_frames.saturating_add(counts);
        frame.saturated_frames = self.saturated_frames;
        frame.commands_refused = self.commands.refused();
    }

    fn save(&self) -> RcOutputState {
        let (gate, held) = self.commands.save();
        RcOutputState {
            held,
            gate,
            states: self.states.save(),
            guard: self.guard.persistent,
            saturated_frames: self.saturated_frames,
            pad0: self.battery.as_ref().map_or(0, ModelledBattery::save),
        }
    }

    fn restore(&mut self, state: &RcOutputState) {
        self.commands.restore(&state.gate, &state.held);
        self.states.restore(&state.states);
        self.guard.persistent = state.guard;
        self.saturated_frames = state.saturated_frames;
        if let Some(battery) = &mut self.battery {
            battery.restore(state.pad0.min(ModelledBattery::WHOLLY_SPENT));
        }
    }
}
