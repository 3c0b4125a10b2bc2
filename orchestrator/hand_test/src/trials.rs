//! Hand tests in laboratories with wrong signs and axes.

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::{exp, from_roll_pitch_yaw, log};

use crate::cause::{Cause, causes};
use crate::steps::Step;
use crate::test::{HandTest, Pose, Verdict};

const QUARTER: f64 = std::f64::consts::FRAC_PI_2;
const HALF: f64 = std::f64::consts::PI;

/// Height and rotation that a hand gives the vehicle: displacement, m, and rotation in {B}, rad.
fn by_hand(step: Step) -> (Vector3<f64>, Vector3<f64>) {
    match step {
        Step::Rest => (Vector3::zeros(), Vector3::zeros()),
        Step::Lift => (Vector3::new(0.03, 0.02, -0.5), Vector3::zeros()),
        Step::TiltRight => (Vector3::zeros(), Vector3::new(0.5, 0.05, -0.05)),
        Step::NoseDown => (Vector3::zeros(), Vector3::new(0.05, -0.5, 0.05)),
        Step::TurnLeft => (Vector3::zeros(), Vector3::new(0.0, 0.05, -0.8)),
        Step::CarryAlongX => (Vector3::new(0.5, 0.04, 0.03), Vector3::zeros()),
    }
}

/// Plays the test through distorted poses: every movement as often as the test asks for it. Returns the test.
fn play(distort: &dyn Fn(&Pose) -> Pose, hand: &dyn Fn(Step) -> (Vector3<f64>, Vector3<f64>)) -> HandTest {
    let mut test = HandTest::default();
    let mut time = 0.0;
    let mut hold = |test: &mut HandTest, duration: f64, moved: Vector3<f64>, turned: Vector3<f64>| {
        let end = time + duration;
        while time < end {
            time += 0.01;
            // Noise of 1 mm that repeats.
            let noise = Vector3::repeat(1e-3 * libm::sin(1e3 * time));
            let pose = Pose {
                position_world: moved + noise,
                world_from_body: exp(&turned),
            };
            test.add(time, &distort(&pose));
        }
    };
    hold(&mut test, 3.0, Vector3::zeros(), Vector3::zeros());
    for step in &Step::ALL[1..] {
        for _ in 0..2 {
            if test.step() != Some(*step) {
                break;
            }
            let (moved, turned) = hand(*step);
            for share in 0..50 {
                let share = f64::from(share) / 50.0;
                hold(&mut test, 0.01, moved * share, turned * share);
            }
            hold(&mut test, 1.5, moved, turned);
            for share in (0..50).rev() {
                let share = f64::from(share) / 50.0;
                hold(&mut test, 0.01, moved * share, turned * share);
            }
            hold(&mut test, 1.0, Vector3::zeros(), Vector3::zeros());
        }
    }
    test
}

fn found(test: &HandTest) -> Vec<Cause> {
    assert_eq!(test.step(), None, "{:?}", test.awaits());
    causes(test.rest(), test.results(), [0.0, 0.1])
}

/// A proper system with axes W and a body with axes B: W R Bᵀ.
fn through(world: Matrix3<f64>, body: Matrix3<f64>) -> Vec<Cause> {
    let distort = |pose: &Pose| Pose {
        position_world: world * pose.position_world,
        world_from_body: world * pose.world_from_body * body.transpose(),
    };
    found(&play(&distort, &by_hand))
}

fn rpy(roll: f64, pitch: f64, yaw: f64) -> Matrix3<f64> {
    from_roll_pitch_yaw([roll, pitch, yaw])
}

#[test]
fn a_laboratory_without_an_error_passes() {
    assert_eq!(through(rpy(0.0, 0.0, 0.0), rpy(0.0, 0.0, 0.0)), []);
    let test = play(&|pose| *pose, &by_hand);
    assert!(
        test.results()
            .iter()
            .all(|result| result.verdict == Verdict::Passed)
    );
    let rest = test.rest().unwrap();
    assert!((rest.rate - 100.0).abs() < 1.0, "{rest:?}");
    assert!((5e-4..2e-3).contains(&rest.position_deviation), "{rest:?}");
    assert!(rest.tilt < 1e-6 && rest.yaw.abs() < 1e-6);
}

#[test]
fn a_body_that_was_created_turned_is_named_with_side_and_angle() {
    for yaw in [QUARTER, -QUARTER, 0.8, -0.4] {
        let found = through(rpy(0.0, 0.0, 0.0), rpy(0.0, 0.0, yaw));
        let [Cause::BodyTurned(angle)] = found[..] else {
            panic!("{yaw}: {found:?}");
        };
        assert!((angle - yaw).abs() < 0.1, "{yaw}: {angle}");
    }
    let found = through(rpy(0.0, 0.0, 0.0), rpy(0.0, 0.0, HALF));
    assert!(
        matches!(found[..], [Cause::BodyTurned(angle)] if angle.abs() > 3.0),
        "{found:?}"
    );
    let words = Cause::BodyTurned(QUARTER).to_string();
    assert!(
        words.starts_with("the body was created turned by 90° to the right"),
        "{words}"
    );
}

#[test]
fn turned_axes_of_the_cameras_are_named_with_side_and_angle() {
    for yaw in [QUARTER, -QUARTER, 0.8] {
        let found = through(rpy(0.0, 0.0, yaw), rpy(0.0, 0.0, 0.0));
        let [Cause::CamerasTurned(angle)] = found[..] else {
            panic!("{yaw}: {found:?}");
        };
        assert!((angle + yaw).abs() < 0.2, "{yaw}: {angle}");
    }
    let words = Cause::CamerasTurned(-QUARTER).to_string();
    assert!(words.contains("turned by 90° to the left"), "{words}");
}

#[test]
fn another_up_axis_is_named_once_for_world_and_body() {
    for roll in [QUARTER, -QUARTER] {
        for body in [rpy(roll, 0.0, 0.0), rpy(0.0, 0.0, 0.0)] {
            let found = through(rpy(roll, 0.0, 0.0), body);
            assert!(
                matches!(&found[..], [Cause::UpAxis { seen }] if seen.starts_with('y')),
                "{found:?}"
            );
        }
    }
    for body in [rpy(HALF, 0.0, 0.0), rpy(0.0, 0.0, 0.0)] {
        let found = through(rpy(HALF, 0.0, 0.0), body);
        assert_eq!(found, [Cause::UpsideDown]);
    }
}

#[test]
fn a_body_created_upside_down_or_tilted_is_named() {
    for body in [rpy(HALF, 0.0, 0.0), rpy(0.0, HALF, 0.0)] {
        assert_eq!(through(rpy(0.0, 0.0, 0.0), body), [Cause::BodyUpsideDown]);
    }
    let found = through(rpy(0.0, 0.0, 0.0), rpy(QUARTER, 0.0, 0.0));
    assert!(matches!(found[..], [Cause::BodyRotated(_)]), "{found:?}");
    let found = through(rpy(0.0, 0.0, 0.0), rpy(0.15, 0.0, 0.0));
    assert!(
        matches!(found[..], [Cause::NotLevel(tilt)] if (tilt - 0.15).abs() < 0.01),
        "{found:?}"
    );
}

/// A mirrored system reports M R M.
fn mirrored(mirror: Vector3<f64>) -> Vec<Cause> {
    let mirror = Matrix3::from_diagonal(&mirror);
    let distort = |pose: &Pose| Pose {
        position_world: mirror * pose.position_world,
        world_from_body: mirror * pose.world_from_body * mirror,
    };
    found(&play(&distort, &by_hand))
}

#[test]
fn mirrored_axes_are_named_whichever_axis_it_is() {
    for axis in 0..3 {
        let mut mirror = Vector3::repeat(1.0);
        mirror[axis] = -1.0;
        assert_eq!(mirrored(mirror), [Cause::Mirrored], "{axis}");
    }
    assert_eq!(
        mirrored(Vector3::repeat(-1.0)),
        [Cause::Mirrored, Cause::UpsideDown][..1]
    );
}

/// A relay that changes rotation vectors, which only an improper map of axes does.
fn relayed(axes: Matrix3<f64>) -> Vec<Cause> {
    let distort = |pose: &Pose| Pose {
        world_from_body: exp(&(axes * log(&pose.world_from_body))),
        ..*pose
    };
    found(&play(&distort, &by_hand))
}

#[test]
fn each_reversed_rotation_is_named_and_an_exchange_of_roll_and_pitch() {
    for (axis, name) in ["roll", "pitch", "yaw"].into_iter().enumerate() {
        let mut signs = Vector3::repeat(1.0);
        signs[axis] = -1.0;
        assert_eq!(relayed(Matrix3::from_diagonal(&signs)), [Cause::Reversed(name)]);
    }
    let all = relayed(-Matrix3::identity());
    assert_eq!(all, ["roll", "pitch", "yaw"].map(Cause::Reversed));
    let exchanged = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    assert_eq!(relayed(exchanged), [Cause::RollAndPitchExchanged]);
    let others = Matrix3::new(0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0);
    assert_eq!(relayed(others), [Cause::Exchanged]);
}

/// Returns the 24 rotations between axes.
fn right_angles() -> Vec<Matrix3<f64>> {
    let mut all: Vec<Matrix3<f64>> = Vec::new();
    for [a, b, c] in (0..64).map(|code| [code % 4, code / 4 % 4, code / 16]) {
        let angles = [a, b, c].map(|quarters| f64::from(quarters) * QUARTER);
        let rotation = from_roll_pitch_yaw(angles).map(f64::round);
        if !all.contains(&rotation) {
            all.push(rotation);
        }
    }
    all
}

#[test]
fn every_pair_of_axes_of_cameras_and_body_is_found_wrong_but_the_right_one() {
    let all = right_angles();
    assert_eq!(all.len(), 24);
    for world in &all {
        for body in &all {
            let found = through(*world, *body);
            let is_right = *world == Matrix3::identity() && *body == Matrix3::identity();
            assert_eq!(found.is_empty(), is_right, "{world} {body} {found:?}");
            assert!(
                !found
                    .iter()
                    .any(|cause| matches!(cause, Cause::Unexplained(_) | Cause::SameAxis))
            );
        }
    }
}

#[test]
fn two_errors_are_both_named() {
    let found = through(rpy(0.0, 0.0, QUARTER), rpy(0.0, 0.0, -QUARTER));
    assert!(
        matches!(found[..], [Cause::CamerasTurned(cameras), Cause::BodyTurned(body)] if cameras < -1.0 && body < -1.0),
        "{found:?}"
    );
    let found = through(rpy(QUARTER, 0.0, 0.0), rpy(QUARTER, 0.0, QUARTER));
    assert!(
        matches!(found[0], Cause::UpAxis { .. }) && found.len() == 2,
        "{found:?}"
    );
    let swapped = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let turn = rpy(0.0, 0.0, QUARTER);
    let distort = |pose: &Pose| Pose {
        position_world: turn * pose.position_world,
        world_from_body: exp(&(swapped * log(&pose.world_from_body))),
    };
    let found = found_with(&distort);
    assert!(
        matches!(found[..], [Cause::RollAndPitchExchanged, Cause::CamerasTurned(_)]),
        "{found:?}"
    );
}

fn found_with(distort: &dyn Fn(&Pose) -> Pose) -> Vec<Cause> {
    found(&play(distort, &by_hand))
}

#[test]
fn an_origin_off_the_ground_is_named() {
    let distort = |pose: &Pose| Pose {
        position_world: pose.position_world + Vector3::new(0.0, 0.0, -0.4),
        ..*pose
    };
    let found = found_with(&distort);
    assert!(
        matches!(found[..], [Cause::OffTheGround([z, _])] if (z + 0.4).abs() < 0.01),
        "{found:?}"
    );
}

/// A first wrong movement may be the hand's; the step passes with the next one.
#[test]
fn a_movement_that_is_wrong_once_is_asked_for_again() {
    let wrong = std::cell::Cell::new(true);
    let hand = |step: Step| {
        if step == Step::TiltRight && wrong.replace(false) {
            (Vector3::zeros(), Vector3::new(-0.5, 0.0, 0.0))
        } else {
            by_hand(step)
        }
    };
    let test = play(&|pose| *pose, &hand);
    assert_eq!(found(&test), []);
    let small = |step: Step| {
        let (moved, turned) = by_hand(step);
        (moved * 0.4, turned * 0.4)
    };
    let test = play(&|pose| *pose, &small);
    assert_eq!(
        test.step(),
        Some(Step::Lift),
        "movements that are too small decide nothing"
    );
}

#[test]
fn a_movement_that_nothing_explains_is_named_by_its_step() {
    let hand = |step: Step| match step {
        // Between two axes: neither right nor another axis.
        Step::CarryAlongX => (Vector3::new(0.3, 0.0, -0.4), Vector3::zeros()),
        step => by_hand(step),
    };
    let test = play(&|pose| *pose, &hand);
    assert_eq!(found(&test), [Cause::Unexplained(Step::CarryAlongX)]);
}
