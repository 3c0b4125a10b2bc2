//! The step function of the transmitter.

use shared_types::gate::{Gate, GateState, Verdict, is_of_the_past};
use shared_types::samples::{ControlCommand, RcFrame};
use shared_types::scenario::Scenario;
use shared_types::service::nanoseconds;
use shared_types::wiring::{RcOutputInputs, RcOutputOutputs};
use shared_types::{Now, Service, ServiceId, Topic};

use crate::link::Link;

shared_types::sample! {
    /// What the next step depends on besides the newest command.
    pub struct RcOutputState {
        /// The last command that could be meant; all zero before the first.
        pub held: ControlCommand,
        /// What is remembered of the commands.
        pub gate: GateState,
        /// Saturated frames since the start of the flight.
        pub saturated_frames: u32,
        /// Explicit padding.
        pub pad0: u32,
    }
}

/// The transmitter as a service.
#[derive(Clone, Debug)]
pub struct RcOutputService {
    link: Link,
    patience: Option<Patience>,
    commands: Gate<ControlCommand>,
    saturated_frames: u32,
}

/// How old a command may be.
#[derive(Clone, Copy, Debug)]
struct Patience {
    max_age_ns: u64,
    failsafe_ns: u64,
}

impl RcOutputService {
    /// The transmitter of a scenario that has been checked, at the start of the flight.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let safety = scenario.safety_of(Topic::ControlCommand, ServiceId::RcOutput);
        Self {
            link: Link::new(scenario.rc_output.as_ref()),
            patience: safety.map(|safety| Patience {
                max_age_ns: nanoseconds(safety.max_age),
                failsafe_ns: safety.failsafe.map_or(u64::MAX, nanoseconds),
            }),
            commands: Gate::default(),
            saturated_frames: 0,
        }
    }

    /// What the frame of this step is to carry, and its stage.
    fn choose(&self, now: &Now, inputs: &RcOutputInputs<'_>) -> (Option<&ControlCommand>, u8) {
        let (held, age) = (self.commands.held(&inputs.command), self.commands.age_ns(now));
        let is_older_than = |most: fn(Patience) -> u64| {
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

/// Whether a command can be meant, its numbers being finite.
fn judge(command: &ControlCommand, now: &Now, has_patience: bool) -> Verdict {
    let has_mode = matches!(
        command.mode,
        ControlCommand::MODE_TORQUE | ControlCommand::MODE_RATES | ControlCommand::MODE_FAILSAFE
    );
    if has_mode && (!has_patience || is_of_the_past(command, now)) {
        Verdict::Good
    } else {
        Verdict::Refused
    }
}

impl Service for RcOutputService {
    const ID: ServiceId = ServiceId::RcOutput;
    type Inputs<'a> = RcOutputInputs<'a>;
    type Outputs<'a> = RcOutputOutputs<'a>;
    type State = RcOutputState;

    fn step(&mut self, now: &Now, inputs: &RcOutputInputs<'_>, outputs: &mut RcOutputOutputs<'_>) {
        let has_patience = self.patience.is_some();
        self.commands.look(&inputs.command, f64::MAX, |command, _| {
            judge(command, now, has_patience)
        });
        let Some(frame) = outputs.frame.due() else {
            return;
        };
        let (command, stage) = self.choose(now, inputs);
        self.link.transmit(command, frame);
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
            saturated_frames: self.saturated_frames,
            pad0: 0,
        }
    }

    fn restore(&mut self, state: &RcOutputState) {
        self.commands.restore(&state.gate, &state.held);
        self.saturated_frames = state.saturated_frames;
    }
}
