//! The step function of the transmitter.

use shared_types::scenario::Scenario;
use shared_types::wiring::{RcOutputInputs, RcOutputOutputs};
use shared_types::{Now, Service, ServiceId};

use crate::link::Link;

shared_types::sample! {
    /// What the next step depends on besides the newest command.
    pub struct RcOutputState {
        /// Saturated frames since the start of the flight.
        pub saturated_frames: u32,
    }
}

/// The transmitter as a service.
#[derive(Clone, Debug)]
pub struct RcOutputService {
    link: Link,
    saturated_frames: u32,
}

impl RcOutputService {
    /// The transmitter of a scenario that has been checked, at the start of the flight.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            link: Link::new(scenario.rc_output.as_ref()),
            saturated_frames: 0,
        }
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
        self.link.transmit(inputs.command.newest(), frame);
        let counts = u32::from(frame.saturated.is_set());
        self.saturated_frames = self.saturated_frames.saturating_add(counts);
        frame.saturated_frames = self.saturated_frames;
    }

    fn save(&self) -> RcOutputState {
        RcOutputState {
            saturated_frames: self.saturated_frames,
        }
    }

    fn restore(&mut self, state: &RcOutputState) {
        self.saturated_frames = state.saturated_frames;
    }
}
