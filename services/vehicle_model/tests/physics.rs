//! Integrated motion against the equations of the paper and the laws of mechanics.

use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;
use shared_types::GRAVITY;
use shared_types::rotation::{defect, exp, skew};
use vehicle_model::integrator::advanced;
use vehicle_model::rigid_body::{Body, Motion, Wrench};

/// The step of the paper's simulations, s.
const H: f64 = 1e-3;

/// Returns the largest effect of rounding on a number of size `scale` over a flight: a bit in its last place at every
/// step.
fn rounding(steps: u32, scale: f64) -> f64 {
    f64::from(steps) * f64::EPSILON * scale
}

fn flown(mut motion: Motion, body: &Body, wrench: &Wrench, h: f64, steps: u32) -> Motion {
    for _ in 0..steps {
        motion = advanced(&motion, h, |motion, _| body.motion_rate(motion, wrench));
    }
    motion
}

fn vector(bound: f64) -> impl Strategy<Value = Vector3<f64>> {
    [-bound..bound, -bound..bound, -bound..bound].prop_map(Vector3::from)
}

/// Any mass distribution: each moment of inertia is at most the sum of the others.
fn bodies() -> impl Strategy<Value = Body> {
    let second_moments = [1e-4..1e-3, 1e-4..1e-3, 1e-4..1e-3];
    (0.1..2.0, second_moments, vector(3.0)).prop_map(|(mass, [x, y, z], disturbance_world)| Body {
        mass,
        inertia: Vector3::new(y + z, z + x, x + y),
        disturbance_world,
        center_of_mass: Vector3::zeros(),
    })
}

fn motions() -> impl Strategy<Value = Motion> {
    (vector(10.0), vector(3.0), vector(10.0), vector(10.0)).prop_map(|(position, theta, velocity, omega)| {
        Motion {
            position_world: position,
            world_from_body: exp(&theta),
            velocity_world: velocity,
            angular_velocity_body: omega,
        }
    })
}

fn wrenches() -> impl Strategy<Value = Wrench> {
    (-5.0..5.0, vector(0.01)).prop_map(|(thrust, torque_body)| Wrench { thrust, torque_body })
}

fn level_at_rest() -> Motion {
    Motion {
        position_world: Vector3::zeros(),
        world_from_body: Matrix3::identity(),
        velocity_world: Vector3::zeros(),
        angular_velocity_body: Vector3::zeros(),
    }
}

/// Turns fast about all axes, in a body with three different moments of inertia.
fn tumbling() -> (Motion, Body) {
    let motion = Motion {
        position_world: Vector3::new(1.0, -2.0, 3.0),
        world_from_body: exp(&Vector3::new(0.5, -1.0, 2.0)),
        velocity_world: Vector3::new(1.0, -1.0, 0.5),
        angular_velocity_body: Vector3::new(8.0, -5.0, 3.0),
    };
    let body = Body {
        mass: 0.2,
        inertia: Vector3::new(6.5e-4, 9.0e-4, 13.0e-4),
        disturbance_world: Vector3::new(0.3, 0.2, 0.1),
        center_of_mass: Vector3::zeros(),
    };
    (motion, body)
}

#[test]
fn the_order_of_convergence_is_four_in_every_member_of_the_motion() {
    let (start, body) = tumbling();
    let wrench = Wrench {
        thrust: 2.3,
        torque_body: Vector3::new(8e-3, -6e-3, 5e-3),
    };
    let at_half_a_second = |steps: u32| flown(start, &body, &wrench, 0.5 / f64::from(steps), steps);
    let reference = at_half_a_second(12_800);
    let errors = |steps| {
        let motion = at_half_a_second(steps);
        [
            (motion.position_world - reference.position_world).norm(),
            (motion.world_from_body - reference.world_from_body).norm(),
            (motion.velocity_world - reference.velocity_world).norm(),
            (motion.angular_velocity_body - reference.angular_velocity_body).norm(),
        ]
    };
    for (coarse, fine) in errors(200).into_iter().zip(errors(400)) {
        let slope = libm::log2(coarse / fine);
        assert!(
            (slope - 4.0).abs() < 0.1,
            "slope {slope}, errors {coarse:e} and {fine:e}"
        );
    }
}

#[test]
fn the_attitude_stays_in_so3_over_a_million_steps() {
    let (mut motion, body) = tumbling();
    for _ in 0..10_000 {
        motion = flown(motion, &body, &Wrench::default(), H, 100);
        assert!(defect(&motion.world_from_body) < 1e-14);
    }
    assert!(motion.angular_velocity_body.norm() > 5.0, "it still tumbles");
}

#[test]
fn a_vehicle_whose_thrust_is_its_weight_hovers_without_a_bit_of_drift() {
    // A power of two: the quotient m g / m is g exactly.
    let body = Body {
        mass: 0.25,
        inertia: Vector3::new(6.5e-4, 6.5e-4, 13.0e-4),
        disturbance_world: Vector3::zeros(),
        center_of_mass: Vector3::zeros(),
    };
    let weight = Wrench {
        thrust: 0.25 * GRAVITY,
        torque_body: Vector3::zeros(),
    };
    assert_eq!(flown(level_at_rest(), &body, &weight, H, 10_000), level_at_rest());
}

/// The closed form for J1 = J2: the momentum L is constant in {I}, and relative to the precession L/J1 the body
/// turns about e3 at −λ, λ = (J3 − J1) ω3 / J1.
#[test]
fn a_symmetric_top_without_torque_follows_its_closed_form() {
    let (start, body) = tumbling();
    let body = Body {
        inertia: Vector3::new(6.5e-4, 6.5e-4, 13.0e-4),
        ..body
    };
    let (r0, omega0) = (start.world_from_body, start.angular_velocity_body);
    let lambda = (body.inertia.z - body.inertia.x) / body.inertia.x * omega0.z;
    let precession_world = r0 * body.inertia.component_mul(&omega0) / body.inertia.x;

    let end = flown(start, &body, &Wrench::default(), H, 1000);

    let spin = exp(&(Vector3::z() * lambda));
    let error_omega = (end.angular_velocity_body - spin * omega0).norm();
    let error_r = (end.world_from_body - exp(&precession_world) * r0 * spin.transpose()).norm();
    assert!(error_omega < 1e-10, "{error_omega:e}");
    assert!(error_r < 1e-9, "{error_r:e}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Five-point differences of the flow against the four equations, (3) as the paper states it, in {B}.
    #[test]
    fn the_flow_satisfies_equations_1_to_4(motion in motions(), body in bodies(), wrench in wrenches()) {
        const STEP: f64 = 1e-4;
        let flow = |steps: f64| advanced(&motion, steps * STEP, |motion, _| body.motion_rate(motion, &wrench));
        let [back2, back1, ahead1, ahead2] = [-2.0, -1.0, 1.0, 2.0].map(flow);
        macro_rules! derivative {
            ($of:expr) => {
                ((($of)(&ahead1) - ($of)(&back1)) * 8.0 - (($of)(&ahead2) - ($of)(&back2))) / (12.0 * STEP)
            };
        }
        let (r, v, omega) = (motion.world_from_body, motion.velocity_body(), motion.angular_velocity_body);
        let (m, j, b) = (body.mass, Matrix3::from_diagonal(&body.inertia), body.disturbance_world);
        let e3 = Vector3::z();

        let p_dot = derivative!(|motion: &Motion| motion.position_world);
        prop_assert!((p_dot - r * v).norm() < 1e-9); // (1)
        let r_dot = derivative!(|motion: &Motion| motion.world_from_body);
        prop_assert!((r_dot - r * skew(&omega)).norm() < 1e-9); // (2)
        let v_dot = derivative!(Motion::velocity_body);
        let equation3 = -skew(&omega) * v - e3 * (wrench.thrust / m) + r.transpose() * e3 * GRAVITY + r.transpose() * b;
        prop_assert!((v_dot - equation3).norm() < 1e-8);
        let omega_dot = derivative!(|motion: &Motion| motion.angular_velocity_body);
        let equation4 = j.try_inverse().unwrap() * (wrench.torque_body - skew(&omega) * j * omega);
        prop_assert!((omega_dot - equation4).norm() < 1e-8); // (4)
    }

    /// p̈ = g e3 − (T/m) R e3 + b, also by differences, of second order.
    #[test]
    fn the_acceleration_in_the_inertial_frame_is_gravity_thrust_and_disturbance(
        motion in motions(), body in bodies(), wrench in wrenches(),
    ) {
        const STEP: f64 = 1e-3;
        let position = |steps: f64| {
            advanced(&motion, steps * STEP, |motion, _| body.motion_rate(motion, &wrench)).position_world
        };
        let second = |steps: f64| (position(steps) - motion.position_world * 2.0 + position(-steps)) / (steps * steps * STEP * STEP);
        // Richardson's extrapolation leaves an error of fourth order.
        let acceleration = (second(1.0) * 4.0 - second(2.0)) / 3.0;
        let thrust_world = motion.world_from_body.column(2) * wrench.thrust;
        let expected = Vector3::z() * GRAVITY - thrust_world / body.mass + body.disturbance_world;
        prop_assert!((acceleration - expected).norm() < 1e-5);
    }

    #[test]
    fn a_tumbling_vehicle_without_thrust_falls_along_a_parabola(motion in motions(), body in bodies()) {
        let end = flown(motion, &body, &Wrench::default(), H, 1000);
        let acceleration = Vector3::z() * GRAVITY + body.disturbance_world;
        let position = motion.position_world + motion.velocity_world + acceleration * 0.5;
        let velocity = motion.velocity_world + acceleration;
        let bound = rounding(1000, motion.position_world.norm() + motion.velocity_world.norm() + acceleration.norm());
        prop_assert!((end.velocity_world - velocity).norm() < bound);
        prop_assert!((end.position_world - position).norm() < bound);
    }

    #[test]
    fn a_free_tumble_conserves_energy_and_angular_momentum(motion in motions(), body in bodies()) {
        let acceleration = Vector3::z() * GRAVITY + body.disturbance_world;
        let translational = |motion: &Motion| {
            0.5 * motion.velocity_world.norm_squared() - acceleration.dot(&motion.position_world)
        };
        let rotational = |motion: &Motion| {
            let omega = &motion.angular_velocity_body;
            0.5 * omega.dot(&body.inertia.component_mul(omega))
        };
        let momentum_world =
            |motion: &Motion| motion.world_from_body * body.inertia.component_mul(&motion.angular_velocity_body);

        let end = flown(motion, &body, &Wrench::default(), H, 1000);

        let drift = (translational(&end) - translational(&motion)).abs();
        let speed = motion.velocity_world.norm() + acceleration.norm();
        let scale = speed * speed + acceleration.norm() * (motion.position_world.norm() + speed);
        prop_assert!(drift < rounding(1000, scale), "translational {drift:e}");
        let drift = (rotational(&end) / rotational(&motion) - 1.0).abs();
        prop_assert!(drift < 1e-9, "rotational {drift:e}");
        let drift = (momentum_world(&end) - momentum_world(&motion)).norm() / momentum_world(&motion).norm();
        prop_assert!(drift < 1e-8, "momentum {drift:e}");
    }

    #[test]
    fn a_hovering_vehicle_of_any_mass_drifts_only_by_the_rounding_of_its_thrust(body in bodies()) {
        let body = Body { disturbance_world: Vector3::zeros(), ..body };
        let weight = Wrench { thrust: body.mass * GRAVITY, torque_body: Vector3::zeros() };
        let speed = flown(level_at_rest(), &body, &weight, H, 1000).velocity_world.norm();
        prop_assert!(speed <= 2.0 * f64::EPSILON * GRAVITY, "{speed:e}");
    }

    #[test]
    fn no_spin_drives_the_attitude_out_of_so3(motion in motions(), body in bodies(), faster in 1.0..1e3f64) {
        let motion = Motion { angular_velocity_body: motion.angular_velocity_body * faster, ..motion };
        let next = flown(motion, &body, &Wrench::default(), H, 1);
        prop_assert!(defect(&next.world_from_body) < 1e-14);
    }
}
