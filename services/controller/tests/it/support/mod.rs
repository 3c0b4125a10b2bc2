//! Steps of the controller as a host makes them.

use controller::ControllerService;
use shared_types::Now;
use shared_types::samples::{ControlAdaptation, ControlCommand, ControlErrors};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use zerocopy::{FromZeros, IntoBytes};

pub(crate) const TICK_NS: u64 = 1_000_000;

/// Outputs of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Published {
    pub(crate) command: ControlCommand,
    pub(crate) adaptation: ControlAdaptation,
    pub(crate) errors: ControlErrors,
}

/// One step at a tick, one after the step before, on a state and a reference.
pub(crate) fn step(service: &mut ControllerService, tick: u64, inputs: [InputView<'_>; 2]) -> Published {
    let mut published = Published {
        command: ControlCommand::new_zeroed(),
        adaptation: ControlAdaptation::new_zeroed(),
        errors: ControlErrors::new_zeroed(),
    };
    let mut outputs = [
        Some(published.command.as_mut_bytes()),
        Some(published.adaptation.as_mut_bytes()),
        Some(published.errors.as_mut_bytes()),
        None, // telemetry, of controllers that are not Gerono's own
    ]
    .map(|bytes| OutputSlot { bytes });
    let now = Now {
        tick,
        time_ns: tick * TICK_NS,
        elapsed_ns: if tick == 0 { 0 } else { TICK_NS },
        operator: shared_types::Operator::FLYING,
    };
    ErasedService::step(service, &now, &inputs, &mut outputs);
    published
}
