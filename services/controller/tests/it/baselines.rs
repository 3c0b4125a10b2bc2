//! Baselines: their nominal loop by finite differences, their estimates by what they converge to, their memory.

use controller::law::Law;
use controller::law::baseline_law::BaselineLaw;
use controller::law::nominal::Nominal;
use controller::rate_controller::RateController;
use controller::{Measured, Reference};
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;
use scenario::{Baseline, GRAVITY, LawKind, RateCommand, Scenario};
use shared_types::rotation;

use crate::rates::{HOLD, MASS, Rig, resting_reference, scenario};

const BASELINES: [LawKind; 5] = [
    LawKind::GeometricPid,
    LawKind::L1,
    LawKind::Indi,
    LawKind::NfConstant,
    LawKind::Px4,
];

const NOMINAL: Nominal = Nominal {
    position_gain: Vector3::new(36.0, 36.0, 36.0),
    velocity_gain: Vector3::new(12.0, 12.0, 12.0),
    attitude_gain: 39.24,
    error_limit: f64::INFINITY,
};

fn with_law(law: LawKind) -> Scenario {
    let mut scenario = scenario(0.25, true, RateCommand::default());
    scenario.controller.law = law;
    scenario
}

fn level() -> Measured {
    Measured {
        position_world: Vector3::zeros(),
        world_from_body: Matrix3::identity(),
        velocity_body: Vector3::zeros(),
        angular_velocity_body: Vector3::zeros(),
    }
}

/// Motion of the reference along a curve, with all derivatives in play.
fn moving_reference() -> Reference {
    Reference {
        gamma_dot: 0.8,
        gamma_ddot: 0.1,
        derivative1_world: Vector3::new(1.0, -0.5, 0.2),
        derivative2_world: Vector3::new(0.3, 0.6, -0.4),
        derivative3_world: Vector3::new(-0.2, 0.5, 0.7),
        ..resting_reference()
    }
}

/// Flies a hover with a disturbance for some seconds; returns the law and the vehicle.
fn flown(scenario: &Scenario, seconds: f64) -> (BaselineLaw, Rig) {
    let mut law = BaselineLaw::new(scenario).unwrap();
    let mut rate_controller = RateController::new(scenario, scenario.controller.rates.as_ref().unwrap());
    let mut rig = Rig::new([0.3, -0.2, 0.1], [0.05, -0.03, 0.0]);
    let reference = resting_reference();
    for _ in 0..(seconds / HOLD) as u32 {
        let (measured, acting) = (rig.motion, rig.acting());
        let output = rate_controller.fly(&law, &measured, &acting, &reference, 0.0);
        let seen = law.seen(&measured, &acting, &reference);
        law.learner_mut().learn(&seen, HOLD);
        rig.fly(output.thrust, &output.rates_body);
    }
    (law, rig)
}

#[test]
fn every_baseline_holds_the_vehicle_at_its_place_against_a_disturbance() {
    for kind in BASELINES {
        let (law, rig) = flown(&with_law(kind), 20.0);
        let away = rig.motion.position_world.norm();
        assert!(away < 1e-3, "{kind:?}: {away} m away");
        // The mass estimate of PX4 explains the vertical part of it, and the predictor of L1 leaks: a h = 2.2 %.
        let compensated = law.learner().compensation();
        let error = (compensated - rig.disturbance).xy().norm();
        assert!(
            error < 0.025 * rig.disturbance.xy().norm(),
            "{kind:?}: {compensated} compensated of {}",
            rig.disturbance
        );
    }
}

#[test]
fn a_restored_memory_commands_and_learns_the_same_to_the_bit() {
    for kind in BASELINES {
        let scenario = with_law(kind);
        let (mut law, rig) = flown(&scenario, 1.0);
        let mut restored = BaselineLaw::new(&scenario).unwrap();
        assert_ne!(law, restored, "{kind:?} has learned nothing");
        restored.learner_mut().restore(&law.learner().memory());
        assert_eq!(law, restored, "{kind:?}");
        let seen = law.seen(&rig.motion, &rig.acting(), &resting_reference());
        law.learner_mut().learn(&seen, HOLD);
        restored.learner_mut().learn(&seen, HOLD);
        assert_eq!(law, restored, "{kind:?}");
    }
}

#[test]
fn the_error_limit_bounds_the_tilt_and_freezes_the_integral() {
    let mut scenario = with_law(LawKind::GeometricPid);
    scenario.controller.baseline = Some(Baseline {
        error_limit: Some(0.4),
        ..Baseline::default()
    });
    let mut law = BaselineLaw::new(&scenario).unwrap();
    let far = Measured {
        position_world: Vector3::new(80.0, 0.0, 0.0),
        ..level()
    };
    let command = law.evaluate(&far, &resting_reference(), &Vector3::zeros());
    let tilt = libm::atan2(command.force.x.abs(), command.force.z);
    assert!(tilt < 1.0, "{tilt} rad");
    let before = law;
    let acting = Rig::new([0.0; 3], [0.0; 3]).acting();
    let seen = law.seen(&far, &acting, &resting_reference());
    law.learner_mut().learn(&seen, HOLD);
    assert_eq!(law, before);
}

proptest! {
    /// With f held along its own rate, ω turns the desired thrust axis as fast as it moves.
    #[test]
    fn on_its_way_the_angular_velocity_is_that_of_the_desired_axis(
        velocity in prop::array::uniform3(-1.0..1.0),
        position in prop::array::uniform3(-0.2..0.2),
    ) {
        let reference = moving_reference();
        // A vehicle whose thrust axis is the desired one: the angle θ is zero, and only ṅd is left.
        let mut vehicle = Measured { position_world: position.into(), ..level() };
        let velocity: Vector3<f64> = Vector3::from(velocity);
        vehicle.velocity_body = velocity;
        let none = Vector3::zeros();
        let force = NOMINAL.command(&vehicle, &reference, MASS, &none, &none).force;
        vehicle.world_from_body = aligned(&force);
        vehicle.velocity_body = vehicle.world_from_body.tr_mul(&velocity);
        let command = NOMINAL.command(&vehicle, &reference, MASS, &none, &none);
        prop_assert!(command.force.xy().norm() < 1e-9, "aligned: {}", command.force);

        // A short time later, under the thrust that was commanded.
        let h = 1e-6;
        let axis: Vector3<f64> = vehicle.world_from_body.column(2).into();
        let acceleration = Vector3::z() * GRAVITY - axis * (command.thrust / MASS);
        let mut later = vehicle;
        later.position_world += velocity * h;
        later.velocity_body = vehicle.world_from_body.tr_mul(&(velocity + acceleration * h));
        let moved = NOMINAL.command(&later, &reference.ahead(h), MASS, &none, &none);
        let desired = moved.force.normalize();
        let expected = Vector3::z().cross(&(desired - Vector3::z())) / h;
        prop_assert!((command.omega - expected).norm() < 1e-3 * (1.0 + expected.norm()), "{} {expected}", command.omega);
    }

    /// Level and near the path, the force is that of a PID with the stated gains.
    #[test]
    fn the_force_is_linear_in_the_errors(position in prop::array::uniform3(-5.0..5.0), velocity in prop::array::uniform3(-5.0..5.0)) {
        let vehicle = Measured { position_world: position.into(), velocity_body: velocity.into(), ..level() };
        let reference = resting_reference();
        let compensation = Vector3::new(0.1, 0.2, 0.3);
        let command = NOMINAL.command(&vehicle, &reference, MASS, &compensation, &Vector3::zeros());
        let expected = Vector3::z() * GRAVITY + Vector3::from(velocity) * 12.0 + Vector3::from(position) * 36.0 + compensation;
        prop_assert!((command.force - expected).norm() < 1e-9);
        prop_assert!((command.thrust - MASS * expected.z).abs() < 1e-9);
    }

    /// From any attitude, upside down too, the command is finite.
    #[test]
    fn a_command_is_finite_from_any_attitude(attitude in prop::array::uniform3(-3.2..3.2), position in prop::array::uniform3(-50.0..50.0)) {
        let vehicle = Measured {
            position_world: position.into(),
            world_from_body: rotation::from_roll_pitch_yaw(attitude),
            ..level()
        };
        let command = NOMINAL.command(&vehicle, &moving_reference(), MASS, &Vector3::zeros(), &Vector3::zeros());
        prop_assert!(command.thrust.is_finite() && command.omega.iter().all(|rate| rate.is_finite()));
        prop_assert!((command.omega.z).abs() < f64::EPSILON);
    }
}

/// Attitude whose third axis is along a vector.
fn aligned(force: &Vector3<f64>) -> Matrix3<f64> {
    let z = force.normalize();
    let x = Vector3::y().cross(&z).normalize();
    Matrix3::from_columns(&[x, z.cross(&x), z])
}
