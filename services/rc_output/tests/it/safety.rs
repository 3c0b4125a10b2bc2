//! Transmitter on commands that are too old or invalid.

use proptest::prelude::*;
use rc_output::RcOutputService;
use shared_types::Now;
use shared_types::sample::Field;
use shared_types::samples::{ControlCommand, RcFrame};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use zerocopy::{FromBytes, FromZeros, IntoBytes};

const POLICY: &str = "[safety.\"control/command -> rc_output\"]\nmax_age = 0.04\nfailsafe = 0.1";
const RADIO: &str = "[rc_output]";
const TICK_NS: u64 = 1_000_000;

fn service(sections: &[&str]) -> RcOutputService {
    let head = "duration = 1.0\n\
                vehicle = { mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4] }\n\
                path.curve.hover.position = [0.0, 0.0, -1.0]\n";
    RcOutputService::new(&toml::from_str(&(head.to_owned() + &sections.join("\n"))).unwrap())
}

fn command(tick: u64, thrust: f64) -> ControlCommand {
    let mut command = ControlCommand::new_zeroed();
    command.header.seq = tick;
    command.header.stamp_ns = tick * TICK_NS;
    (command.thrust, command.rates_body, command.mode) =
        (thrust, [0.1, 0.2, 0.3], ControlCommand::MODE_RATES);
    command
}

fn step(service: &mut RcOutputService, tick: u64, command: Option<&ControlCommand>) -> RcFrame {
    let now = Now {
        tick,
        time_ns: tick * TICK_NS,
        elapsed_ns: TICK_NS,
        operator: shared_types::Operator::FLYING,
    };
    let mut frame = RcFrame::new_zeroed();
    let inputs = [
        InputView {
            bytes: command.map(IntoBytes::as_bytes),
            fresh: command.is_some_and(|command| command.header.stamp_ns == now.time_ns),
        },
        InputView::default(),
    ];
    let mut outputs = [OutputSlot {
        bytes: Some(frame.as_mut_bytes()),
    }];
    ErasedService::step(service, &now, &inputs, &mut outputs);
    frame
}

fn restarted(service: &RcOutputService, sections: &[&str]) -> RcOutputService {
    crate::restart::restarted(service, self::service(sections))
}

#[test]
fn stages_begin_above_exactly_the_stated_ages_and_the_held_frame_is_the_last_one_again() {
    let mut transmitter = service(&[RADIO, POLICY]);
    let last = command(5, 2.0);
    let sent = step(&mut transmitter, 5, Some(&last));
    for tick in 6..200 {
        transmitter = restarted(&transmitter, &[RADIO, POLICY]);
        let frame = step(&mut transmitter, tick, Some(&last));
        let expected = match tick - 5 {
            0..=40 => RcFrame::STAGE_COMMAND,
            41..=100 => RcFrame::STAGE_HOLD,
            _ => RcFrame::STAGE_FAILSAFE,
        };
        assert_eq!(frame.stage, expected, "age {} ms", tick - 5);
        let is_failsafe = expected == RcFrame::STAGE_FAILSAFE;
        assert_eq!(frame.failsafe.is_set(), is_failsafe);
        assert_eq!(
            (frame.channels, frame.thrust) == (sent.channels, sent.thrust),
            !is_failsafe
        );
    }
    assert_eq!(
        step(&mut transmitter, 200, Some(&command(200, 2.0))).stage,
        RcFrame::STAGE_COMMAND
    );
}

#[test]
fn a_restarted_transmitter_holds_the_last_command_until_it_receives_one() {
    let mut transmitter = service(&[RADIO, POLICY]);
    let sent = step(&mut transmitter, 5, Some(&command(5, 2.0)));
    for tick in [6, 44, 45, 105] {
        let held = step(&mut restarted(&transmitter, &[RADIO, POLICY]), tick, None);
        assert_eq!((held.channels, held.stage), (sent.channels, RcFrame::STAGE_HOLD));
        assert!(!held.failsafe.is_set() && !held.inputs_fresh.is_set());
    }
    let too_late = step(&mut restarted(&transmitter, &[RADIO, POLICY]), 106, None);
    assert!(too_late.failsafe.is_set());
}

#[test]
fn without_a_policy_no_command_is_too_old() {
    let mut transmitter = service(&[RADIO]);
    let last = command(5, 2.0);
    let sent = step(&mut transmitter, 5, Some(&last));
    let much_later = RcFrame {
        inputs_fresh: false.into(),
        ..sent
    };
    assert_eq!(step(&mut transmitter, 1_000_000, Some(&last)), much_later);
}

#[test]
fn an_invalid_command_is_counted_and_the_last_good_one_is_held() {
    for sections in [&[RADIO][..], &[RADIO, POLICY], &[], &[POLICY]] {
        let mut transmitter = service(sections);
        let sent = step(&mut transmitter, 1, Some(&command(1, 2.0)));
        let unknown_mode = ControlCommand {
            mode: 7,
            ..command(3, 2.0)
        };
        for (tick, garbage) in [
            (2, command(2, f64::NAN)),
            (3, unknown_mode),
            (4, command(4, f64::INFINITY)),
        ] {
            let frame = step(&mut transmitter, tick, Some(&garbage));
            assert_eq!((frame.thrust, frame.rates_body), (sent.thrust, sent.rates_body));
            assert_eq!(
                (frame.stage, frame.commands_refused),
                (RcFrame::STAGE_HOLD, tick as u32 - 1)
            );
        }
        let good = step(&mut transmitter, 5, Some(&command(5, 2.0)));
        assert_eq!((good.stage, good.commands_refused), (RcFrame::STAGE_COMMAND, 3));
    }
}

#[test]
fn a_command_to_rest_is_obeyed_on_every_link_at_once() {
    for sections in [&[RADIO][..], &[]] {
        let mut transmitter = service(sections);
        step(&mut transmitter, 1, Some(&command(1, 2.0)));
        let rest = ControlCommand {
            mode: ControlCommand::MODE_FAILSAFE,
            ..command(2, 2.0)
        };
        let frame = step(&mut transmitter, 2, Some(&rest));
        assert!(frame.failsafe.is_set() && frame.thrust == 0.0 && frame.rates_body == [0.0; 3]);
        assert_eq!(frame.stage, RcFrame::STAGE_FAILSAFE);
    }
}

proptest! {
    #[test]
    fn any_input_bits_give_a_finite_frame_and_a_restart_changes_nothing(
        commands in proptest::collection::vec(
            proptest::collection::vec(any::<u8>(), size_of::<ControlCommand>()), 1..12),
    ) {
        for sections in [&[RADIO][..], &[RADIO, POLICY], &[], &[POLICY]] {
            let (mut steady, mut other) = (service(sections), service(sections));
            for (tick, bytes) in (0..).step_by(17).zip(&commands) {
                let command = ControlCommand::read_from_bytes(bytes).unwrap();
                let frame = step(&mut steady, tick, Some(&command));
                prop_assert!(frame.is_finite(), "{:?}", frame);
                other = restarted(&other, sections);
                let again = step(&mut other, tick, Some(&command));
                prop_assert_eq!(again.as_bytes(), frame.as_bytes());
            }
        }
    }
}
