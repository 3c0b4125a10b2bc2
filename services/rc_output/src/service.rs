//! The step function of the transmitter.

use shared_types::scenario::Scenario;
use shared_types::wiring::{RcOutputInputs, RcOutputOutputs};
use shared_types::{Now, Service, ServiceId};

use crate::link;

shared_types::sample! {
    /// Nothing: on the ideal link a frame depends on the newest command alone.
    pub struct RcOutputState {
        /// A record has at least one member; always 0.
        pub structure_needs_at_least_one_member: u8,
    }
}

/// The transmitter as a service.
#[derive(Clone, Debug)]
pub struct RcOutputService(());

impl RcOutputService {
    /// The transmitter of a scenario that has been checked; every scenario has the ideal link.
    #[must_use]
    pub fn new(_scenario: &Scenario) -> Self {
        Self(())
    }
}

impl Service for RcOutputService {
    const ID: ServiceId = ServiceId::RcOutput;
    type Inputs<'a> = RcOutputInputs<'a>;
    type Outputs<'a> = RcOutputOutputs<'a>;
    type State = RcOutputState;

    fn step(&mut self, _now: &Now, inputs: &RcOutputInputs<'_>, outputs: &mut RcOutputOutputs<'_>) {
        let Some(frame) = outputs.frame.due() else {
            return;
        };
        match inputs.command.newest() {
            Some(command) => link::transmit(command, frame),
            None => link::transmit_failsafe(frame),
        }
    }

    fn save(&self) -> RcOutputState {
        RcOutputState {
            structure_needs_at_least_one_member: 0,
        }
    }

    fn restore(&mut self, _state: &RcOutputState) {}
}
