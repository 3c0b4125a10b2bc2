//! Filter on captures that are wrong, late or missing.

use estimator::kalman::{KalmanFilter, Outcome};
use proptest::prelude::*;
use scenario::{Kalman, Model};
use shared_types::rotation::angle_between;
use shared_types::samples::{MocapPose, RcFrame};
use zerocopy::{FromZeros, IntoBytes};

use super::consistency::{assert_is_chi_square, matched_flight, squared_error};
use super::rig::{CAPTURE_PERIOD, Rig, TICK_NS, World, pilot_on_the_eight, restless_pilot, scenario};

fn laboratory(change: impl FnOnce(&mut World)) -> Rig {
    let mut world = World::laboratory(7);
    change(&mut world);
    Rig::new(world, &Kalman::default(), &Model::default())
}

/// Returns the outcomes of the captures up to a tick.
fn outcomes(rig: &mut Rig, until: u64) -> Vec<(u64, Outcome)> {
    let mut outcomes = Vec::new();
    while rig.tick < until {
        let tick = rig.tick;
        outcomes.extend(
            rig.step(pilot_on_the_eight)
                .outcome
                .map(|outcome| (tick, outcome)),
        );
    }
    outcomes
}

fn count(outcomes: &[(u64, Outcome)], is: impl Fn(&Outcome) -> bool) -> usize {
    outcomes.iter().filter(|(_, outcome)| is(outcome)).count()
}

#[test]
fn a_short_jump_is_refused_as_a_whole_and_leaves_the_state_where_it_was() {
    let mut rig = laboratory(|world| world.swapped = 1000..1200);
    let outcomes = outcomes(&mut rig, 1205);
    assert_eq!(rig.filter.captures_refused(), 20);
    assert_eq!(count(&outcomes, |outcome| matches!(outcome, Outcome::Started)), 1);
    let told = rig.filter.estimate(rig.now_ns()).unwrap();
    while rig.tick < 1220 {
        assert!(!matches!(
            rig.step(pilot_on_the_eight).outcome,
            Some(Outcome::Refused)
        ));
    }
    let [position, ..] = rig.truth_at(told.state_time_ns).distances_to(&told);
    assert!(position < 0.01, "{position}");
    assert_eq!(rig.filter.captures_refused(), 20);
}

#[test]
fn a_lasting_jump_is_accepted_after_the_stated_time_and_again_at_its_end() {
    // Of the position alone: a turned attitude is never accepted.
    let mut rig = laboratory(|world| {
        world.swapped = 1000..2000;
        world.swapped_rotation = nalgebra::Vector3::zeros();
    });
    let outcomes = outcomes(&mut rig, 2600);
    let started: Vec<u64> = outcomes
        .iter()
        .filter(|(_, outcome)| matches!(outcome, Outcome::Started))
        .map(|(tick, _)| *tick)
        .collect();
    assert_eq!(started, [5, 1305, 2305]);
    assert_eq!(rig.filter.captures_refused(), 60);
    let told = rig.filter.estimate(rig.now_ns()).unwrap();
    while rig.now_ns() <= told.state_time_ns {
        rig.step(pilot_on_the_eight);
    }
    let [position, velocity, attitude] = rig.truth_at(told.state_time_ns).distances_to(&told);
    assert!(position < 2e-3 && velocity < 0.05 && attitude < 0.01);
}

/// A body whose markers were confused, after a gap or without one. Positions that are right keep the state tracked.
#[test]
fn a_lasting_turn_of_the_captures_is_never_accepted_and_the_truth_is_after_it() {
    for (gap, degrees, off) in [
        (0, 30.0, 0.0),
        (100, 30.0, 0.0),
        (500, 30.0, 0.0),
        (0, 90.0, 0.5),
        (0, 90.0, 0.0),
        (100, 180.0, 0.5),
        (500, 180.0, 0.0),
    ] {
        for axis in [nalgebra::Vector3::x(), nalgebra::Vector3::z()] {
            let mut rig = laboratory(|world| {
                world.hidden = 2500..2500 + gap;
                world.swapped = 2500 + gap..4500;
                world.swapped_position = nalgebra::Vector3::x() * off;
                world.swapped_rotation = axis * f64::to_radians(degrees);
            });
            let seen = outcomes(&mut rig, 4500);
            let late = seen.iter().filter(|(tick, _)| *tick > 2510 + gap);
            for (tick, outcome) in late {
                assert!(
                    matches!(outcome, Outcome::Refused),
                    "{degrees}° about {axis} after {gap} ms: {outcome:?} at {tick}"
                );
            }
            let (what, is_right) = (format!("{degrees}° about {axis}, {off} m off"), off == 0.0);
            assert_eq!(rig.filter.is_tracking(rig.now_ns()), is_right, "{what}");
            if is_right {
                let state = rig.filter.state().unwrap();
                let truth = rig.truth_at(state.time_ns);
                let turned = angle_between(&state.nominal.world_from_body, &truth.world_from_body);
                assert!(turned < 0.1, "{what}: {turned} rad");
            }
        }
    }
}

/// Asserts that no attitude that is turned at once is used after the filter has restarted at a tick.
fn assert_no_turn_is_accepted_after(what: &str, spoil: fn(&mut World), restarted: u64) {
    for (after, degrees) in [(20, 30.0), (20, 180.0), (300, 90.0), (1500, 180.0)] {
        let mut rig = laboratory(spoil);
        let seen = outcomes(&mut rig, restarted + 1);
        assert!(matches!(seen.last(), Some((_, Outcome::Started))), "{what}");
        outcomes(&mut rig, restarted + after);
        // Captures on the way were exposed before.
        let from = rig.tick;
        if !rig.world.swapped.contains(&from) {
            rig.world.swapped_position = nalgebra::Vector3::zeros();
        }
        rig.world.swapped = from..from + 2000;
        rig.world.swapped_rotation = nalgebra::Vector3::new(0.0, f64::to_radians(degrees), 0.0);
        let seen = outcomes(&mut rig, from + 2000);
        let late: Vec<_> = seen.iter().filter(|(tick, _)| *tick > from + 10).collect();
        assert!(late.len() > 190);
        for (tick, outcome) in late {
            assert!(
                matches!(outcome, Outcome::Refused),
                "{degrees}° {after} ms after {what}: {outcome:?} at {tick}"
            );
        }
        assert!(
            rig.filter.is_tracking(rig.now_ns()),
            "{degrees}° after {what}: by positions"
        );
    }
}

#[test]
fn a_lasting_turn_soon_after_a_restart_is_never_accepted() {
    let jump = |world: &mut World| {
        world.swapped = 2500..6500;
        world.swapped_rotation = nalgebra::Vector3::zeros();
    };
    assert_no_turn_is_accepted_after("a jump", jump, 2805);
    let loss = |world: &mut World| world.hidden = 2500..3200;
    assert_no_turn_is_accepted_after("a loss of sight", loss, 3205);
}

/// Nothing says how a vehicle turned that was neither seen nor commanded, so the attitude at which it comes back may be a
/// false one.
#[test]
fn a_false_attitude_at_a_restart_without_a_known_turn_does_not_lock_the_truth_out() {
    for degrees in [40.0, 90.0, 180.0] {
        for axis in [nalgebra::Vector3::x(), nalgebra::Vector3::z()] {
            let mut rig = laboratory(|world| {
                world.hidden = 2500..3200;
                world.silence = 2600..3300;
                world.swapped = 3200..3700;
                world.swapped_position = nalgebra::Vector3::zeros();
                world.swapped_rotation = axis * f64::to_radians(degrees);
            });
            let seen = outcomes(&mut rig, 5700);
            let restarts = seen
                .iter()
                .filter(|(tick, outcome)| matches!(outcome, Outcome::Started) && (3200..3710).contains(tick));
            assert_eq!(restarts.count(), 1, "the false attitude is used");
            assert!(rig.filter.is_tracking(rig.now_ns()), "{degrees}° about {axis}");
            let state = rig.filter.state().unwrap();
            let truth = rig.truth_at(state.time_ns);
            let error = truth.error_of(state).fixed_rows::<3>(6).norm();
            assert!(error < 0.02, "{error} rad after {degrees}° about {axis}");
        }
    }
}

/// Nor does a pause of the frames let in an attitude that was refused before it.
#[test]
fn a_false_attitude_that_was_refused_is_refused_through_a_pause_of_the_frames() {
    for pause in [260, 500, 1000] {
        let mut rig = laboratory(|world| {
            world.swapped = 2500..5500;
            world.swapped_position = nalgebra::Vector3::zeros();
            world.swapped_rotation = nalgebra::Vector3::x() * f64::to_radians(90.0);
            world.silence = 3000..3000 + pause;
        });
        let seen = outcomes(&mut rig, 5505);
        let late = seen.iter().filter(|(tick, _)| *tick > 2510);
        for (tick, outcome) in late {
            assert!(
                matches!(outcome, Outcome::Refused),
                "{pause} ms: {outcome:?} at {tick}"
            );
        }
        assert!(rig.filter.is_tracking(rig.now_ns()), "{pause} ms");
        let seen = outcomes(&mut rig, 6000);
        let used = count(&seen, |outcome| matches!(outcome, Outcome::Used(_)));
        assert!(used > 45, "{pause} ms: {used} of the true ones");
    }
}

/// A capture of which a part was used is none that was refused.
#[test]
fn an_outlier_after_captures_that_were_used_in_part_restarts_nothing() {
    let mut rig = laboratory(|world| {
        world.swapped = 2500..2510;
        world.swapped_position = nalgebra::Vector3::y() * 0.5;
        world.swapped_rotation = nalgebra::Vector3::zeros();
    });
    outcomes(&mut rig, 2510);
    rig.world.swapped = 2510..4520;
    rig.world.swapped_position = nalgebra::Vector3::zeros();
    rig.world.swapped_rotation = nalgebra::Vector3::x() * f64::to_radians(90.0);
    outcomes(&mut rig, 4520);
    rig.world.swapped = 4520..4530;
    rig.world.swapped_position = nalgebra::Vector3::y() * 0.5;
    rig.world.swapped_rotation = nalgebra::Vector3::zeros();
    let seen = outcomes(&mut rig, 4700);
    assert_eq!(count(&seen, |outcome| matches!(outcome, Outcome::Started)), 0);
    assert!(count(&seen, |outcome| matches!(outcome, Outcome::Used(_))) >= 16);
}

/// As after a death of the estimator that lasted too long.
#[test]
fn true_attitudes_after_a_gap_in_the_frames_are_used() {
    for seed in 0..10 {
        let mut rig = laboratory(|world| {
            world.seed = seed;
            world.hidden = 2500..2900;
            world.silence = 2500..2900;
        });
        let restless = restless_pilot(seed);
        let mut refused = 0;
        while rig.tick < 3400 {
            let outcome = rig.step(&restless).outcome;
            refused += u32::from(matches!(outcome, Some(Outcome::Refused)) && rig.tick > 3300);
        }
        assert_eq!(refused, 0, "seed {seed}");
        assert!(rig.filter.is_tracking(rig.now_ns()));
    }
}

#[test]
fn a_restart_keeps_disturbance_and_rate_bias() {
    let mut rig = laboratory(|world| {
        world.swapped = 1000..2000;
        world.swapped_rotation = nalgebra::Vector3::zeros();
    })
    .starting(|truth| {
        truth.disturbance_world = nalgebra::Vector3::new(0.5, -0.9, 0.3);
        truth.rate_bias_body = nalgebra::Vector3::new(0.1, 0.2, -0.1);
    });
    outcomes(&mut rig, 1305);
    let before = *rig.filter.state().unwrap();
    assert!(matches!(
        rig.step(pilot_on_the_eight).outcome,
        Some(Outcome::Started)
    ));
    let after = rig.filter.state().unwrap();
    assert_eq!(after.nominal.disturbance_world, before.nominal.disturbance_world);
    assert_eq!(after.nominal.rate_bias_body, before.nominal.rate_bias_body);
    assert!(before.nominal.disturbance_world.norm() > 0.5 && before.nominal.rate_bias_body.norm() > 0.1);
    assert!(after.covariance[(12, 12)] < 2.0 * before.covariance[(12, 12)]);
    assert_eq!(after.nominal.velocity_world.norm(), 0.0);
}

#[test]
fn a_drop_out_is_coasted_then_untracked_then_lost() {
    let mut rig = laboratory(|world| world.hidden = 1000..2000);
    outcomes(&mut rig, 996);
    // The last capture before was used at tick 995.
    let mut last_told = None;
    while rig.tick < 2005 {
        let (tick, now_ns) = (rig.tick, rig.now_ns());
        assert_eq!(
            rig.filter.is_tracking(now_ns),
            tick <= 995 + 250,
            "at tick {tick}"
        );
        assert_eq!(
            rig.filter.estimate(now_ns).is_some(),
            tick <= 995 + 550,
            "at tick {tick}"
        );
        last_told = rig.step(pilot_on_the_eight).told.or(last_told);
    }
    assert!(matches!(
        rig.step(pilot_on_the_eight).outcome,
        Some(Outcome::Started)
    ));
    assert!(rig.filter.is_tracking(rig.now_ns()));
    assert_eq!(rig.filter.captures_refused(), 0);
    // What was told last was the prediction for half a second ahead of what was seen.
    assert!(last_told.unwrap().position_sigma > 0.01);
}

#[test]
fn after_a_drop_out_longer_than_the_coasting_the_error_is_that_of_the_covariance() {
    let mut squares = Vec::new();
    for seed in 200..225 {
        let mut rig = matched_flight(seed);
        rig.world.hidden = 600..1000;
        while rig.tick < 1000 {
            rig.step(restless_pilot(seed));
        }
        assert!(!rig.filter.is_tracking(rig.now_ns()));
        while rig.tick < 1005 {
            rig.step(restless_pilot(seed));
        }
        assert!(matches!(
            rig.step(restless_pilot(seed)).outcome,
            Some(Outcome::Used(_))
        ));
        assert!(rig.filter.is_tracking(rig.now_ns()));
        squares.push(squared_error(&rig));
    }
    assert_is_chi_square(&squares, 18.0);
}

#[test]
fn a_repeated_an_older_and_an_unseen_capture_change_nothing() {
    let mut rig = laboratory(|_| ());
    outcomes(&mut rig, 500);
    let before = rig.filter.save();
    let now_ns = rig.now_ns();
    let mut capture = MocapPose {
        capture_time_ns: rig.filter.state().unwrap().time_ns,
        world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        tracked: true.into(),
        ..MocapPose::new_zeroed()
    };
    assert!(matches!(
        rig.filter.add_capture(now_ns, &capture),
        Outcome::Ignored
    ));
    capture.capture_time_ns -= CAPTURE_PERIOD * TICK_NS;
    assert!(matches!(
        rig.filter.add_capture(now_ns, &capture),
        Outcome::Ignored
    ));
    capture.capture_time_ns = now_ns;
    capture.tracked = false.into();
    assert!(matches!(
        rig.filter.add_capture(now_ns, &capture),
        Outcome::Ignored
    ));
    assert_eq!(rig.filter.save().as_bytes(), before.as_bytes());
}

#[test]
fn a_capture_from_the_future_and_one_that_is_no_pose_are_refused_and_never_started_from() {
    let mut filter = KalmanFilter::new(
        &scenario(&Model::default(), &Kalman::default()),
        &Kalman::default(),
    )
    .unwrap();
    let good = MocapPose {
        capture_time_ns: 5 * TICK_NS,
        world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        tracked: true.into(),
        ..MocapPose::new_zeroed()
    };
    let reflected = MocapPose {
        world_from_body: [-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        ..good
    };
    let far = MocapPose {
        position_world: [0.0, 1e10, 0.0],
        ..good
    };
    assert!(matches!(
        filter.add_capture(5 * TICK_NS - 1, &good),
        Outcome::Refused
    ));
    assert!(matches!(
        filter.add_capture(10 * TICK_NS, &reflected),
        Outcome::Refused
    ));
    assert!(matches!(filter.add_capture(10 * TICK_NS, &far), Outcome::Refused));
    assert!(filter.state().is_none() && filter.captures_refused() == 3);
    assert!(matches!(
        filter.add_capture(10 * TICK_NS, &good),
        Outcome::Started
    ));
}

/// A number of any size.
fn wild() -> impl Strategy<Value = f64> {
    prop_oneof![
        -1.0..1.0,
        -1e3..1e3,
        Just(0.0),
        (-300.0..300.0f64, any::<bool>()).prop_map(|(exponent, negative)| {
            let size = libm::pow(10.0, exponent);
            if negative { -size } else { size }
        }),
    ]
}

fn wild_rotation() -> impl Strategy<Value = [f64; 9]> {
    prop_oneof![
        proptest::array::uniform9(wild()),
        proptest::array::uniform3(-4.0..4.0).prop_map(|theta| shared_types::rotation::to_row_major(
            &shared_types::rotation::exp(&theta.into())
        )),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn any_captures_and_frames_keep_the_state_finite(
        captures in proptest::collection::vec(
            (proptest::array::uniform3(wild()), wild_rotation(), 0..30u64, any::<bool>()), 1..60,
        ),
        frames in proptest::collection::vec((wild(), proptest::array::uniform3(wild()), any::<bool>()), 60),
        restart_after in prop_oneof![Just(0.0), Just(0.05), Just(0.3)],
    ) {
        let kalman = Kalman { restart_after, ..Kalman::default() };
        let mut filter = KalmanFilter::new(&scenario(&Model::default(), &kalman), &kalman).unwrap();
        for (number, ((position, attitude, age, seen), (thrust, rates, failsafe))) in captures.into_iter().zip(frames).enumerate() {
            let now_ns = (number as u64 + 3) * 10 * TICK_NS;
            let mut frame = RcFrame {
                thrust,
                rates_body: rates,
                mode: RcFrame::MODE_RATES,
                failsafe: failsafe.into(),
                ..RcFrame::new_zeroed()
            };
            frame.header.stamp_ns = now_ns - TICK_NS;
            filter.add_frame(now_ns, &frame);
            filter.add_capture(now_ns, &MocapPose {
                capture_time_ns: now_ns - age * TICK_NS,
                position_world: position,
                world_from_body: attitude,
                tracked: seen.into(),
                ..MocapPose::new_zeroed()
            });
            if let Some(state) = filter.estimate(now_ns) {
                prop_assert!(shared_types::sample::Field::is_finite(&state), "{state:?}");
            }
        }
    }
}
