//! A step of the transmitter allocates nothing.

use crate::allocations;
use rc_output::RcOutputService;
use shared_types::Now;
use shared_types::samples::{ControlCommand, RcFrame};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use zerocopy::{FromZeros, IntoBytes};

#[test]
fn a_step_of_the_transmitter_does_not_allocate() {
    for link in ["", "[rc_output]"] {
        assert_eq!(allocations_and_failsafes(link), (0, 50), "{link}");
    }
}

/// Returns the allocations of 100 steps and their failsafe frames, when every other command stops the motors.
fn allocations_and_failsafes(link: &str) -> (u64, u32) {
    let text = format!(
        "duration = 1.0\n\
         vehicle = {{ mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4] }}\n\
         path.curve.hover.position = [0.0, 0.0, -1.0]\n\
         {link}",
    );
    let mut service = RcOutputService::new(&toml::from_str(&text).unwrap());
    let commands = [ControlCommand::MODE_RATES, ControlCommand::MODE_FAILSAFE].map(|mode| ControlCommand {
        mode,
        ..ControlCommand::new_zeroed()
    });
    let mut frame = RcFrame::new_zeroed();
    let mut state = vec![0; service.state_size()];
    let mut failsafes = 0;
    let count = allocations::allocations_during(|| {
        for (tick, command) in (0..100).zip(commands.iter().cycle()) {
            let now = Now {
                tick,
                time_ns: tick * 1_000_000,
                elapsed_ns: tick.min(1) * 1_000_000,
                operator: shared_types::Operator::FLYING,
            };
            let inputs = [
                InputView {
                    bytes: Some(command.as_bytes()),
                    fresh: true,
                },
                InputView::default(),
            ];
            let mut outputs = [OutputSlot {
                bytes: Some(frame.as_mut_bytes()),
            }];
            ErasedService::step(&mut service, &now, &inputs, &mut outputs);
            ErasedService::save(&service, &mut state);
            ErasedService::restore(&mut service, &state);
            failsafes += u32::from(frame.failsafe.is_set());
        }
    });
    (count, failsafes)
}
