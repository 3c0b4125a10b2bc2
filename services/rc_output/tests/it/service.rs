//! Transmitter as hosts see it: commands, their absence, restarts.

use proptest::prelude::*;
use rc_output::RcOutputService;
use scenario::{RcLink, Scenario};
use shared_types::Now;
use shared_types::samples::{ControlCommand, RcFrame};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use zerocopy::{FromZeros, IntoBytes};

fn service_with(link: Option<RcLink>) -> RcOutputService {
    let scenario: Scenario = toml::from_str(
        "duration = 1.0\n\
         vehicle = { mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4] }\n\
         path.curve.hover.position = [0.0, 0.0, -1.0]",
    )
    .unwrap();
    RcOutputService::new(&Scenario {
        rc_output: link,
        ..scenario
    })
}

/// The transmitter of the ideal link.
fn service() -> RcOutputService {
    service_with(None)
}

/// The transmitter with the paper's calibration.
fn radio() -> RcOutputService {
    service_with(Some(RcLink::default()))
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
        operator: shared_types::Operator::FLYING,
    };
    let inputs = [
        InputView {
            bytes: command.map(IntoBytes::as_bytes),
            fresh: command.is_some(),
        },
        InputView::default(),
    ];
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
        inputs_fresh: true.into(),
        ..RcFrame::new_zeroed()
    }
}

fn rates_command(thrust: f64, rates_body: [f64; 3]) -> ControlCommand {
    ControlCommand {
        thrust,
        rates_body,
        mode: ControlCommand::MODE_RATES,
        ..ControlCommand::new_zeroed()
    }
}

/// Commands that the paper's link carries without saturation.
fn carried_commands() -> impl Strategy<Value = ControlCommand> {
    (0.01..5.44, -18.9..18.9, -18.9..18.9, -7.95..7.95)
        .prop_map(|(thrust, x, y, z)| rates_command(thrust, [x, y, z]))
}

#[test]
fn without_a_command_the_frame_is_a_failsafe_with_the_motors_at_rest() {
    let failsafe = RcFrame {
        failsafe: true.into(),
        stage: RcFrame::STAGE_FAILSAFE,
        ..RcFrame::new_zeroed()
    };
    assert_eq!(step(&mut service(), None), failsafe);
}

#[test]
fn the_modes_of_commands_and_frames_are_the_same_numbers() {
    assert_eq!(ControlCommand::MODE_TORQUE, RcFrame::MODE_TORQUE);
    assert_eq!(ControlCommand::MODE_RATES, RcFrame::MODE_RATES);
}

#[test]
fn the_channels_are_those_of_the_papers_calibration() {
    // TRC = (T − 2.3071)/3.138, ωRC = −[ωx/19, ωy/19, ωz/8], each in codes 0 to 2047 over [−1, 1].
    let frame = step(&mut radio(), Some(&rates_command(1.962, [1.9, -3.8, 4.0])));
    let code = |travel: f64| libm::round((travel + 1.0) / 2.0 * 2047.0) as u16;
    let mut channels = [0; 16];
    channels[..4].copy_from_slice(&[code((1.962 - 2.3071) / 3.138), code(-0.1), code(0.2), code(-0.5)]);
    assert_eq!(frame.channels, channels);
    assert_eq!(frame.mode, RcFrame::MODE_RATES);
    assert_eq!(frame.torque_body, [0.0; 3]);
    assert!(!frame.failsafe.is_set() && !frame.saturated.is_set());
}

#[test]
fn a_command_beyond_the_sticks_is_sent_at_their_ends_and_said_to_be_saturated() {
    // The most that the paper's link carries: 2.3071 + 3.138 N and 19, 19, 8 rad/s.
    let mut radio = radio();
    let frame = step(&mut radio, Some(&rates_command(9.0, [-30.0, 30.0, 10.0])));
    assert_eq!(frame.channels[..4], [2047, 2047, 0, 0]);
    assert!((frame.thrust - 5.4451).abs() < 1e-12, "{}", frame.thrust);
    assert_eq!(frame.rates_body, [-19.0, 19.0, 8.0]);
    assert!(frame.saturated.is_set());

    let alone = step(&mut radio, Some(&rates_command(2.0, [0.0, 0.0, 8.1])));
    assert!(alone.saturated.is_set(), "one axis is enough");
}

#[test]
fn no_frame_asks_for_a_thrust_below_zero() {
    let frame = step(&mut radio(), Some(&rates_command(-1.0, [0.0; 3])));
    let quantum = 2.0 / 2047.0 * 3.138;
    assert!((0.0..quantum).contains(&frame.thrust), "{}", frame.thrust);
    assert!(frame.saturated.is_set());
    // The same on a link whose thrust falls with the travel, and on one on which no thrust is a code.
    for (thrust_offset, thrust_slope) in [(2.3071, -3.138), (0.0, 3.0), (3.0, 3.0), (3.0, -3.0)] {
        let link = RcLink {
            thrust_offset,
            thrust_slope,
            ..RcLink::default()
        };
        let frame = step(
            &mut service_with(Some(link)),
            Some(&rates_command(-1.0, [0.0; 3])),
        );
        let quantum = 2.0 / 2047.0 * thrust_slope.abs();
        assert!(frame.thrust >= 0.0 && frame.thrust < quantum, "{}", frame.thrust);
    }
}

#[test]
fn a_narrower_range_of_the_sticks_is_kept() {
    // The paper's range of the thrust channel, with which its vehicle of 0.2 kg could not go down.
    let link = RcLink {
        thrust_range: [0.0, 1.0],
        rate_range: [-0.5, 0.5],
        ..RcLink::default()
    };
    let frame = step(
        &mut service_with(Some(link)),
        Some(&rates_command(1.962, [19.0, -19.0, 8.0])),
    );
    assert!(
        (2.3071..2.3071 + 3.138 / 1023.0).contains(&frame.thrust),
        "{}",
        frame.thrust
    );
    for (rate, most) in frame.rates_body.into_iter().zip([9.5, 9.5, 4.0]) {
        assert!(
            rate.abs() <= most && rate.abs() > 0.998 * most,
            "{rate} of {most}"
        );
    }
}

#[test]
fn saturated_frames_are_counted_where_they_are_sent() {
    let mut radio = radio();
    let (good, bad) = (rates_command(2.0, [0.0; 3]), rates_command(7.0, [0.0; 3]));
    let counts = [&good, &bad, &bad, &good].map(|command| step(&mut radio, Some(command)).saturated_frames);
    assert_eq!(counts, [0, 1, 2, 2]);
    step_into(&mut radio, Some(&bad), None);
    assert_eq!(
        step(&mut radio, Some(&good)).saturated_frames,
        2,
        "nothing was sent between"
    );
}

#[test]
fn a_command_that_the_link_cannot_carry_becomes_a_failsafe_frame() {
    let torque = ControlCommand {
        mode: ControlCommand::MODE_TORQUE,
        ..rates_command(2.0, [0.1; 3])
    };
    let nothing = RcFrame {
        mode: RcFrame::MODE_RATES,
        failsafe: true.into(),
        stage: RcFrame::STAGE_FAILSAFE,
        ..RcFrame::new_zeroed()
    };
    assert_eq!(step(&mut radio(), None), nothing);
    let fresh = RcFrame {
        inputs_fresh: true.into(),
        ..nothing
    };
    assert_eq!(step(&mut radio(), Some(&torque)), fresh);
    for number in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for command in [
            rates_command(number, [0.0; 3]),
            rates_command(2.0, [0.0, number, 0.0]),
        ] {
            let refused = RcFrame {
                commands_refused: 1,
                ..nothing
            };
            assert_eq!(step(&mut radio(), Some(&command)), refused);
            let ideal = step(&mut service(), Some(&command));
            assert!(ideal.failsafe.is_set() && ideal.thrust == 0.0 && ideal.rates_body == [0.0; 3]);
        }
    }
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
    fn the_meaning_of_the_channels_is_the_command_within_half_a_step(command in carried_commands()) {
        let frame = step(&mut radio(), Some(&command));
        prop_assert!(!frame.saturated.is_set() && !frame.failsafe.is_set());
        let half = 1.0 / 2047.0 + 1e-12;
        prop_assert!((frame.thrust - command.thrust).abs() <= 3.138 * half);
        for (axis, slope) in [19.0, 19.0, 8.0].into_iter().enumerate() {
            prop_assert!((frame.rates_body[axis] - command.rates_body[axis]).abs() <= slope * half);
        }
    }

    #[test]
    fn the_meaning_of_a_frame_is_sent_again_as_the_same_frame(command in commands()) {
        let command = ControlCommand { mode: ControlCommand::MODE_RATES, ..command };
        let frame = step(&mut radio(), Some(&command));
        let again = step(&mut radio(), Some(&rates_command(frame.thrust, frame.rates_body)));
        prop_assert_eq!(again.channels, frame.channels);
        prop_assert_eq!((again.thrust, again.rates_body), (frame.thrust, frame.rates_body));
        prop_assert!(!again.saturated.is_set());
    }

    #[test]
    fn a_restored_transmitter_continues_with_the_same_bytes(
        commands in proptest::collection::vec(proptest::option::of(commands()), 1..20), restart in 0..20usize,
    ) {
        for link in [None, Some(RcLink::default())] {
        let mut steady = service_with(link.clone());
        let mut restarted = service_with(link.clone());
        for (index, command) in commands.iter().enumerate() {
            let expected = step(&mut steady, command.as_ref());
            let got = step(&mut restarted, command.as_ref());
            prop_assert_eq!(got.as_bytes(), expected.as_bytes());
            if index == restart {
                let mut state = vec![0; restarted.state_size()];
                ErasedService::save(&restarted, &mut state);
                restarted = service_with(link.clone());
                ErasedService::restore(&mut restarted, &state);
            }
        }
        }
    }
}
