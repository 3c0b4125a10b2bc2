//! Motion of γ from step to step.

use crate::flight::{TICK_NS, generator, paper_path, scenario, step, step_at, step_on_old, vehicle};
use path_generator::{CurveError, PathGeneratorError, PathGeneratorService, PathGeneratorState};
use proptest::prelude::*;
use scenario::{Curve, Hover, Path, PathMode, Waypoints, YawStep};
use shared_types::Service;
use shared_types::samples::{PathReference, VehicleState};
use shared_types::service::{ErasedService, seconds};
use zerocopy::{FromZeros, IntoBytes};

fn hover_at_origin() -> Curve {
    Curve::Hover(Hover { position: [0.0; 3] })
}

/// A vehicle that moves through the transition of the timing law, out of it at both ends and out of the cameras' view.
fn wanderer(tick: u64) -> VehicleState {
    let time = tick as f64 * 1e-2;
    let (sine, cosine) = libm::sincos(time);
    VehicleState {
        tracked: (tick % 97 != 50).into(),
        ..vehicle(
            [1.4 * sine, 0.6 * cosine, -1.2 + 0.5 * sine],
            [1.4 * cosine, -0.6 * sine, 0.5 * cosine],
        )
    }
}

proptest! {
    #[test]
    fn gamma_and_its_rate_move_by_the_rates_of_the_step_before(
        places in proptest::collection::vec(proptest::array::uniform3(-1.5..1.5f64), 2..20),
        ticks in 1..30u64,
        initial_gamma in -3.0..3.0f64,
        initial_gamma_dot in -0.5..1.5f64,
    ) {
        let mut generator = generator(Path { initial_gamma, initial_gamma_dot, ..paper_path() });
        let mut before: Option<PathReference> = None;
        for (n, place) in (0..).zip(places) {
            let elapsed = if n == 0 { 0 } else { ticks };
            let now = step(&mut generator, n * ticks, elapsed, Some(&vehicle(place, [0.3, -0.2, 0.1])));
            let h = seconds(ticks * TICK_NS);
            let expected = before.map_or((initial_gamma, initial_gamma_dot), |before| {
                (before.gamma + h * before.gamma_dot, before.gamma_dot + h * before.gamma_ddot)
            });
            prop_assert_eq!((now.gamma, now.gamma_dot), expected);
            before = Some(now);
        }
    }

    #[test]
    fn close_to_the_path_the_rate_error_decays_exponentially(k4 in 0.2..5.0f64, initial_gamma_dot in -2.0..3.0f64) {
        let path = Path { k4, initial_gamma_dot, curve: hover_at_origin(), ..paper_path() };
        let mut generator = generator(path);
        let close = vehicle([0.1, -0.2, 0.3], [1.0, 2.0, -3.0]);
        let initial = initial_gamma_dot - 1.0;
        for tick in 0..=1000 {
            let reference = step_at(&mut generator, tick, Some(&close));
            let (h, time) = (1e-3, tick as f64 * 1e-3);
            let z4 = reference.gamma_dot - reference.gamma_dot_desired;
            // Explicit Euler: z4 = (1 − k4 h)ᵏ z4(0), which is exp(−k4 t) z4(0) up to t k4² h/2 of it.
            prop_assert!((z4 - libm::pow(1.0 - k4 * h, tick as f64) * initial).abs() < 1e-12);
            let exact = libm::exp(-k4 * time) * initial;
            prop_assert!((z4 - exact).abs() <= (0.51 * time * k4 * k4 * h) * exact.abs() + 1e-12);
        }
    }

    #[test]
    fn a_restored_generator_continues_with_equal_bytes(stop in 1..300u64) {
        let path = Path { curve: Curve::Waypoints(Waypoints {
            points: vec![[0.0, 0.0, -1.0], [1.0, 0.0, -1.2], [1.0, 1.0, -1.0], [0.0, 1.0, -0.8]],
            closed: true,
            interval: 0.7,
            ..Waypoints::default()
        }), initial_gamma_dot: 0.6, ..paper_path() };
        let mut whole = generator(path.clone());
        for tick in 0..stop {
            step_at(&mut whole, tick, Some(&wanderer(tick)));
        }
        let mut bytes = vec![0; ErasedService::state_size(&whole)];
        ErasedService::save(&whole, &mut bytes);
        let mut restarted = generator(path);
        ErasedService::restore(&mut restarted, &bytes);
        for tick in stop..stop + 100 {
            let (one, other) = (
                step_at(&mut whole, tick, Some(&wanderer(tick))),
                step_at(&mut restarted, tick, Some(&wanderer(tick))),
            );
            prop_assert_eq!(one.as_bytes(), other.as_bytes());
        }
    }
}

#[test]
fn a_far_path_waits_and_a_close_one_moves_on() {
    let mut generator = generator(paper_path());
    let far = vehicle([5.0, 5.0, -5.0], [0.0; 3]);
    for tick in 0..5000 {
        assert_eq!(step_at(&mut generator, tick, Some(&far)).gamma, 0.0);
    }
    let mut reference = PathReference::new_zeroed();
    for tick in 5000..15_000 {
        let close = if tick == 5000 {
            vehicle([0.0, -0.19, -1.19], [0.0; 3])
        } else {
            vehicle(reference.position_world, [0.0; 3])
        };
        reference = step_at(&mut generator, tick, Some(&close));
    }
    // ten seconds at 1 − exp(−t)
    assert!((reference.gamma - 9.0).abs() < 2e-3, "{}", reference.gamma);
    assert!((reference.gamma_dot - 1.0).abs() < 1e-4);
}

#[test]
fn trajectory_tracking_moves_at_constant_rate_however_far_the_vehicle_is() {
    let mut generator = generator(Path {
        mode: PathMode::TrajectoryTracking,
        speed: 0.5,
        initial_gamma: 2.0,
        ..paper_path()
    });
    for tick in 0..1000 {
        let reference = step_at(
            &mut generator,
            tick,
            Some(&vehicle([100.0 * (tick % 3) as f64, 0.0, 0.0], [9.0; 3])),
        );
        assert!((reference.gamma - (2.0 + 0.5e-3 * tick as f64)).abs() < 1e-12);
        assert_eq!((reference.gamma_dot, reference.gamma_dot_desired), (0.5, 0.5));
        let rates = [
            reference.gamma_ddot,
            reference.gamma_dddot_constant,
            reference.gamma_dddot_slope,
        ];
        assert_eq!(rates, [0.0; 3]);
    }
}

#[test]
fn without_a_tracked_vehicle_the_path_stands_still_and_says_so() {
    let unseen = VehicleState {
        tracked: false.into(),
        ..vehicle([0.0, -0.19, -1.19], [0.0; 3])
    };
    let seen = vehicle([0.0, -0.19, -1.19], [0.0; 3]);
    for mode in [PathMode::Following, PathMode::TrajectoryTracking] {
        let mut generator = generator(Path {
            mode,
            initial_gamma_dot: 0.8,
            ..paper_path()
        });
        let stands_still_at = |tick: u64, reference: &PathReference, first: &PathReference| {
            assert_eq!(reference.gamma, first.gamma, "tick {tick}");
            assert_eq!(reference.position_world, first.position_world);
            let rates = [
                reference.gamma_dot,
                reference.gamma_ddot,
                reference.gamma_dot_desired,
            ];
            assert_eq!(rates, [0.0; 3]);
        };
        let begin = step_at(&mut generator, 0, None);
        for tick in 1..10 {
            stands_still_at(tick, &step_at(&mut generator, tick, None), &begin);
        }
        for tick in 10..20 {
            step_at(&mut generator, tick, Some(&seen));
        }
        let first = step_at(&mut generator, 20, Some(&unseen));
        assert!(first.gamma > begin.gamma);
        for tick in 21..30 {
            stands_still_at(tick, &step_at(&mut generator, tick, Some(&unseen)), &first);
        }
        let again = step_at(&mut generator, 30, Some(&seen));
        assert_eq!(again.gamma, first.gamma);
        let expected = match mode {
            PathMode::Following => (0.0, 1.0),
            PathMode::TrajectoryTracking => (1.0, 0.0),
        };
        assert_eq!((again.gamma_dot, again.gamma_ddot), expected);
    }
}

#[test]
fn the_reference_carries_the_curve_the_yaw_and_the_hosts_header() {
    let path = Path {
        yaw: 0.7,
        initial_gamma: 1.3,
        ..paper_path()
    };
    let curve = path_generator::Curve::new(&path.curve).unwrap();
    let point = curve.at(1.3);
    let reference = step_at(&mut generator(path), 0, Some(&vehicle([0.0; 3], [0.0; 3])));
    assert_eq!(reference.position_world, <[f64; 3]>::from(point.position));
    assert_eq!(reference.derivative1_world, <[f64; 3]>::from(point.derivative1));
    assert_eq!(reference.derivative2_world, <[f64; 3]>::from(point.derivative2));
    assert_eq!(reference.derivative3_world, <[f64; 3]>::from(point.derivative3));
    assert_eq!((reference.yaw, reference.yaw_rate), (0.7, 0.0));
}

/// A path whose yaw steps twice.
fn turning_path() -> Path {
    let steps = [(20.0, 0.8), (20.007, -1.0)];
    Path {
        yaw: 0.25,
        yaw_step: steps.map(|(at, yaw)| YawStep { at, yaw }).to_vec(),
        ..paper_path()
    }
}

#[test]
fn the_yaw_steps_at_its_tick_and_not_before() {
    let mut generator = generator(turning_path());
    let seen = vehicle([0.0; 3], [0.0; 3]);
    let mut yaw_at = |tick, state: Option<&VehicleState>| step(&mut generator, tick, 1, state).yaw;
    for (tick, yaw) in [
        (0, 0.25),
        (19_999, 0.25),
        (20_000, 0.8),
        (20_006, 0.8),
        (20_007, -1.0),
        (60_000, -1.0),
    ] {
        assert_eq!(yaw_at(tick, Some(&seen)), yaw, "tick {tick}");
        assert_eq!(yaw_at(tick, None), yaw, "tick {tick}, nothing seen");
    }
}

#[test]
fn a_yaw_step_between_two_steps_of_the_generator_holds_from_the_next_on() {
    let mut generator = generator(turning_path());
    let seen = vehicle([0.0; 3], [0.0; 3]);
    let yaws = [19_998, 20_020].map(|tick| step(&mut generator, tick, 22, Some(&seen)).yaw);
    assert_eq!(yaws, [0.25, -1.0]);
}

#[test]
fn a_yaw_step_at_the_start_holds_from_the_start() {
    let mut generator = generator(Path {
        yaw_step: vec![YawStep { at: 0.0, yaw: 1.5 }],
        ..paper_path()
    });
    assert_eq!(step_at(&mut generator, 0, None).yaw, 1.5);
}

#[test]
fn a_generator_restored_between_yaw_steps_goes_on_with_the_yaw_of_the_time() {
    let mut whole = generator(turning_path());
    let seen = vehicle([0.0; 3], [0.0; 3]);
    step(&mut whole, 20_003, 1, Some(&seen));
    let state = Service::save(&whole);
    let mut restarted = generator(turning_path());
    Service::restore(&mut restarted, &state);
    for tick in 20_004..20_010 {
        let references = [&mut whole, &mut restarted].map(|generator| step(generator, tick, 1, Some(&seen)));
        assert_eq!(references[0].as_bytes(), references[1].as_bytes());
    }
}

/// A state of tick 10 that is predicted 5 ms ahead.
fn predicted() -> VehicleState {
    let mut state = vehicle([0.0; 3], [0.0; 3]);
    (state.header.stamp_ns, state.state_time_ns) = (10_000_000, 15_000_000);
    state
}

#[test]
fn the_reference_speaks_of_the_time_of_the_state_it_was_made_for() {
    // A state, seen or not; without any there is only the time of the step.
    let predicted = |tracked: bool| VehicleState {
        tracked: tracked.into(),
        ..predicted()
    };
    let mut generator = generator(paper_path());
    for (state, time_ns) in [
        (None, 10_000_000),
        (Some(&predicted(true)), 15_000_000),
        (Some(&predicted(false)), 15_000_000),
    ] {
        assert_eq!(step(&mut generator, 10, 1, state).reference_time_ns, time_ns);
    }
}

#[test]
fn the_time_of_a_reference_goes_on_with_the_path_while_states_are_late() {
    let mut generator = generator(paper_path());
    let state = predicted();
    step(&mut generator, 10, 1, Some(&state));
    for late in 1..50 {
        let reference = step_on_old(&mut generator, 10 + late, &state);
        assert_eq!(reference.reference_time_ns, (15 + late) * 1_000_000);
    }
}

#[test]
fn the_path_moves_on_also_in_a_step_without_a_due_reference() {
    let mut generator = generator(Path {
        initial_gamma_dot: 1.0,
        ..paper_path()
    });
    let seen = vehicle([0.0, -0.19, -1.19], [0.0; 3]);
    let mut slot = [shared_types::service::OutputSlot::default()];
    for tick in 0..=2 {
        let now = shared_types::Now {
            tick,
            time_ns: tick * 1_000_000,
            elapsed_ns: tick.min(1) * 1_000_000,
            operator: shared_types::Operator::FLYING,
        };
        let input = shared_types::service::InputView {
            bytes: Some(seen.as_bytes()),
            fresh: false,
        };
        ErasedService::step(&mut generator, &now, &[input, Default::default()], &mut slot);
    }
    let PathGeneratorState { motion, .. } = Service::save(&generator);
    assert!((motion.gamma - 2e-3).abs() < 1e-15);
}

#[test]
fn a_scenario_without_a_valid_path_is_refused() {
    let no_room = Path {
        alpha1: 1.5,
        ..paper_path()
    };
    let error = PathGeneratorService::new(&scenario(no_room)).unwrap_err();
    assert!(matches!(error, PathGeneratorError::Transition(_)), "{error}");
    let one_point = Waypoints {
        points: vec![[0.0; 3]],
        ..Waypoints::default()
    };
    let no_curve = Path {
        curve: Curve::Waypoints(one_point),
        ..paper_path()
    };
    let error = PathGeneratorService::new(&scenario(no_curve)).unwrap_err();
    assert_eq!(
        error,
        PathGeneratorError::Curve(CurveError::TooFewPoints { found: 1, needed: 2 })
    );
    assert!(error.to_string().contains("give at least 2"), "{error}");
}
