//! The transmitter as hosts see it: commands, their absence, restarts.

use proptest::prelude::*;
use rc_output::RcOutputService;
use shared_types::Now;
use shared_types::samples::{ControlCommand, RcFrame};
use shared_types::scenario::Scenario;
use shared_types::service::{ErasedService, InputView, OutputSlot};
use zerocopy::{FromZeros, IntoBytes};

fn service() -> RcOutputService {
    let scenario: Scenario = toml::from_str(
        "duration = 1.0\n\
         vehicle = { mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4] }\n\
         path.curve.hover.position = [0.0, 0.0, -1.0]",
    )
    .unwrap();
    RcOutputService::new(&scenario)
}

fn step(service: &mut RcOutputService, command: Option<&ControlCommand>) -> RcFrame {
    let mut frame = RcFrame::new_zeroed();
    step_into(service, command, Some(frame.as_mut_bytes()));
    frame
}

fn step_into(service: &mut RcOutputService, command: Option<&ControlCommand>, frame: Option<&mut [u8]>) {
    let now = Now {
        tick: 9,
        time_ns: 9_000_000,
        elapsed_ns: 1_000_000,
    };
    let inputs = [InputView {
        bytes: command.map(IntoBytes::as_bytes),
        fresh: command.is_some(),
    }];
    ErasedService::step(service, &now, &inputs, &mut [OutputSlot { bytes: frame }]);
}

fn commands() -> impl Strategy<Value = ControlCommand> {
    let vector = || [-100.0..100.0, -100.0..100.0, -100.0..100.0];
    let modes = vec![ControlCommand::MODE_TORQUE, ControlCommand::MODE_RATES];
    (-1e3..1e3, vector(), vector(), prop::sample::select(modes)).prop_map(
        |(thrust, torque_body, rates_body, mode)| ControlCommand {
            thrust,
            torque_body,
            rates_body,
            mode,
            ..ControlCommand::new_zeroed()
        },
    )
}

/// The frame of the ideal link.
fn carrying(command: &ControlCommand) -> RcFrame {
    RcFrame {
        thrust: command.thrust,
        torque_body: command.torque_body,
        rates_body: command.rates_body,
        mode: command.mode,
        ..RcFrame::new_zeroed()
    }
}

#[test]
fn without_a_command_the_frame_is_a_failsafe_with_the_motors_at_rest() {
    let failsafe = RcFrame {
        failsafe: true.into(),
        ..RcFrame::new_zeroed()
    };
    assert_eq!(step(&mut service(), None), failsafe);
}

#[test]
fn the_modes_of_commands_and_frames_are_the_same_numbers() {
    assert_eq!(ControlCommand::MODE_TORQUE, RcFrame::MODE_TORQUE);
    assert_eq!(ControlCommand::MODE_RATES, RcFrame::MODE_RATES);
}

proptest! {
    #[test]
    fn the_ideal_link_carries_a_command_as_it_is(command in commands()) {
        prop_assert_eq!(step(&mut service(), Some(&command)), carrying(&command));
    }

    #[test]
    fn a_frame_depends_on_the_newest_command_alone(earlier in commands(), newest in commands()) {
        let mut service = service();
        step(&mut service, Some(&earlier));
        step_into(&mut service, Some(&earlier), None);
        prop_assert_eq!(step(&mut service, Some(&newest)), carrying(&newest));
    }

    #[test]
    fn a_restored_transmitter_continues_with_the_same_bytes(
        commands in proptest::collection::vec(proptest::option::of(commands()), 1..20), restart in 0..20usize,
    ) {
        let mut steady = service();
        let mut restarted = service();
        for (index, command) in commands.iter().enumerate() {
            let expected = step(&mut steady, command.as_ref());
            let got = step(&mut restarted, command.as_ref());
            prop_assert_eq!(got.as_bytes(), expected.as_bytes());
            if index == restart {
                let mut state = vec![0; restarted.state_size()];
                ErasedService::save(&restarted, &mut state);
                restarted = service();
                ErasedService::restore(&mut restarted, &state);
            }
        }
    }
}
