//! Baselines: their nominal loop by finite differences, the limits of their estimates, their state.

use control_law::adaptive::harmonics::Harmonics;
use control_law::law::baseline_law::CompensatedLoop;
use control_law::law::flight_law::FlightLaw;
use control_law::law::geometric_pid::GeometricPid;
use control_law::law::immersion_inertia::ImmersionInertia;
use control_law::law::nominal::Nominal;
use control_law::law::{LawOutput, Moment, RollOutLaw, registry};
use control_law::{Measured, Reference};
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;
use scenario::{Baseline, Curve, GRAVITY, LawKind, RateCommand, Scenario, TiltedEight};
use shared_types::rotation;

use crate::rates::{HOLD, MASS, Rig, resting_reference, scenario};

/// The laws that compensate a disturbance.
const BASELINES: [LawKind; 6] = [
    LawKind::GeometricPid,
    LawKind::L1,
    LawKind::Indi,
    LawKind::NfConstant,
    LawKind::Px4,
    LawKind::Nmpc,
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
        gamma: 0.0,
        gamma_dot: 0.8,
        gamma_ddot: 0.1,
        derivative1_world: Vector3::new(1.0, -0.5, 0.2),
        derivative2_world: Vector3::new(0.3, 0.6, -0.4),
        derivative3_world: Vector3::new(-0.2, 0.5, 0.7),
        ..resting_reference()
    }
}

/// A law and a vehicle that hovers.
struct Flight {
    law: Box<dyn FlightLaw>,
    rig: Rig,
}

impl Flight {
    fn new(scenario: &Scenario) -> Self {
        Self {
            law: registry::flight_law(scenario),
            rig: Rig::new([0.3, -0.2, 0.1], [0.05, -0.03, 0.0]),
        }
    }

    /// The command of a hold.
    fn command(&mut self) -> LawOutput {
        self.command_after(HOLD)
    }

    /// The command `elapsed` seconds after the previous one.
    fn command_after(&mut self, elapsed: f64) -> LawOutput {
        self.law.advance(elapsed);
        let reference = resting_reference();
        let moment = Moment {
            elapsed,
            ..self.rig.moment(&reference, 0.0)
        };
        self.law.command(&moment)
    }

    /// The estimates of mass and disturbance.
    fn estimate(&self) -> (f64, Vector3<f64>) {
        let estimate = self.law.estimate().unwrap();
        (1.0 / estimate.eta, estimate.disturbance_world)
    }

    fn fly(&mut self, seconds: f64) {
        for _ in 0..(seconds / HOLD) as u32 {
            let output = self.command();
            self.rig
                .fly(output.command.thrust, &output.command.rates_body.into());
        }
    }
}

#[test]
fn every_baseline_holds_the_vehicle_at_its_place_against_a_disturbance() {
    for kind in BASELINES {
        let mut flight = Flight::new(&with_law(kind));
        flight.fly(20.0);
        let away = flight.rig.motion.position_world.norm();
        assert!(away < 1e-3, "{kind:?}: {away} m away");
        // The mass estimate of PX4 explains the vertical part of it, and the predictor of L1 leaks: 1 − e^(−ah) = 2.2 %.
        let (_, compensated) = flight.estimate();
        let error = (compensated - flight.rig.disturbance).xy().norm();
        assert!(
            error < 0.025 * flight.rig.disturbance.xy().norm(),
            "{kind:?}: {compensated} compensated of {}",
            flight.rig.disturbance
        );
    }
}

#[test]
fn an_estimate_of_the_mass_alone_finds_the_mass_and_leaves_the_rest() {
    let mut scenario = with_law(LawKind::ImmersionMass);
    scenario.controller.initial.mass = 0.8 * MASS;
    let mut flight = Flight::new(&scenario);
    flight.rig.disturbance = Vector3::new(0.3, 0.0, 0.0);
    flight.fly(20.0);
    let (mass, _) = flight.estimate();
    assert!((mass / MASS - 1.0).abs() < 1e-3, "{mass} kg");
    // What nothing compensates, the position gain holds: e = d/Kp.
    let away = flight.rig.motion.position_world;
    assert!(
        (away - Vector3::new(0.3 / 36.0, 0.0, 0.0)).norm() < 3e-4,
        "{away}"
    );
}

#[test]
fn integrals_grow_by_the_time_since_the_previous_step() {
    for kind in [LawKind::GeometricPid, LawKind::Px4] {
        // The vehicle stays where it is for three steps, or for one of their length.
        let [three, one] = [&[HOLD; 3][..], &[3.0 * HOLD]].map(|times| {
            let mut flight = Flight::new(&with_law(kind));
            flight.command_after(0.0);
            times.iter().for_each(|elapsed| {
                let _ = flight.command_after(*elapsed);
            });
            flight.estimate()
        });
        assert!((three.0 - one.0).abs() < 1e-12, "{kind:?}: {three:?} {one:?}");
        assert!((three.1 - one.1).norm() < 1e-12, "{kind:?}: {three:?} {one:?}");
        assert!(one.1.norm() > 0.1, "{kind:?}: {one:?}");
    }
}

#[test]
fn a_restored_law_commands_and_adapts_the_same_to_the_bit() {
    let mut harmonics = with_law(LawKind::Adaptive);
    harmonics.controller.harmonics = Some(scenario::Harmonics::default());
    harmonics.path.curve = Curve::TiltedEight(TiltedEight::default());
    assert!(Harmonics::from_scenario(&harmonics).is_some());
    let scenarios = BASELINES.map(with_law);
    for scenario in scenarios
        .into_iter()
        .chain([with_law(LawKind::ImmersionMass), harmonics])
    {
        let kind = scenario.controller.law;
        let mut flight = Flight::new(&scenario);
        flight.fly(1.0);
        let mut restored = Flight {
            rig: Rig::new([0.0; 3], [0.0; 3]),
            ..Flight::new(&scenario)
        };
        let state = flight.law.save();
        assert_ne!(
            restored.law.save().record,
            state.record,
            "{kind:?} has not adapted"
        );
        restored.law.restore(&state);
        assert_eq!(restored.law.save(), state, "{kind:?}");
        std::mem::swap(&mut restored.rig, &mut flight.rig);
        let output = restored.command();
        std::mem::swap(&mut restored.rig, &mut flight.rig);
        assert_eq!(flight.command(), output, "{kind:?}");
        assert_eq!(flight.law.save(), restored.law.save(), "{kind:?}");
    }
}

#[test]
fn the_inertia_is_found_while_the_vehicle_turns_and_restored_to_the_bit() {
    let mut scenario = with_law(LawKind::ImmersionInertia);
    scenario.controller.rates = None;
    let prior = Vector3::from(scenario.controller.initial.inertia);
    let inertia = prior.component_mul(&Vector3::new(1.6, 0.7, 1.2));
    let mut law = ImmersionInertia::new(&scenario);
    let (h, mut omega) = (1e-3, Vector3::zeros());
    for tick in 0..40_000 {
        // A reference that swings about all axes, which a tilted vehicle at a place far away sees.
        let t = f64::from(tick) * h;
        let measured = Measured {
            position_world: Vector3::new(libm::sin(3.0 * t), libm::cos(2.0 * t), 0.0),
            angular_velocity_body: omega,
            ..level()
        };
        let reference = resting_reference();
        let moment = Moment {
            measured,
            acting: Rig::new([0.0; 3], [0.0; 3]).acting(),
            reference: &reference,
            yaw: 0.0,
            elapsed: h,
            may_adapt: true,
        };
        let output = law.command(&moment);
        let torque = Vector3::from(output.command.torque_body) + Vector3::z() * (1e-3 * libm::sin(5.0 * t));
        if tick == 20_000 {
            let mut restored = ImmersionInertia::new(&scenario);
            assert_ne!(restored, law);
            restored.restore(&law.save());
            assert_eq!(restored, law);
        }
        for _ in 0..20 {
            let momentum = inertia.component_mul(&omega);
            omega += (torque - omega.cross(&momentum)).component_div(&inertia) * (h / 20.0);
        }
    }
    // The third torque is not the law's alone, so that it cannot find the third inertia.
    let found = law.inertia().component_div(&inertia);
    assert!(
        (found.xy() - nalgebra::Vector2::repeat(1.0)).norm() < 0.02,
        "{found} of the truth"
    );
}

#[test]
fn the_error_limit_bounds_the_tilt_and_freezes_the_integral() {
    let mut scenario = with_law(LawKind::GeometricPid);
    scenario.controller.baseline = Some(Baseline {
        error_limit: Some(0.4),
        ..Baseline::default()
    });
    let mut law = CompensatedLoop::<GeometricPid>::new(&scenario);
    let far = Measured {
        position_world: Vector3::new(80.0, 0.0, 0.0),
        ..level()
    };
    let command = law.evaluate(&far, &resting_reference(), &Vector3::zeros());
    let tilt = libm::atan2(command.force.x.abs(), command.force.z);
    assert!(tilt < 1.0, "{tilt} rad");
    let before = law.state;
    let acting = Rig::new([0.0; 3], [0.0; 3]).acting();
    let motion = law.motion(&far, &acting, &resting_reference());
    law.adapt(&motion, HOLD);
    assert_eq!(law.state, before);
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
        prop_assume!(force.z > 0.31 * GRAVITY);
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

    /// However far it is above its reference, as on the ground under a reference that sinks on, a vehicle stays upright.
    #[test]
    fn a_vehicle_above_its_reference_is_not_turned_over(above in 0.0..50.0f64, beside in -0.05..0.05f64, sinks in 0.0..2.0f64) {
        let vehicle = Measured {
            position_world: Vector3::new(beside, 0.0, -above),
            velocity_body: Vector3::new(0.0, 0.0, -sinks),
            ..level()
        };
        let none = Vector3::zeros();
        let command = NOMINAL.command(&vehicle, &resting_reference(), MASS, &none, &none);
        let tilt = libm::atan2((NOMINAL.position_gain.x * beside).abs(), 0.3 * GRAVITY);
        prop_assert!(command.omega.norm() <= NOMINAL.attitude_gain * tilt + 1e-9, "{} {tilt}", command.omega);
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
