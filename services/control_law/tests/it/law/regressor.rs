//! Identity W w ≡ −S(ω)Jω + J δm ζ̇ along the closed loop, timing law included.

use control_law::Estimates;
use control_law::Measured;
use control_law::adaptive::parameter_vector::parameter_vector;
use nalgebra::Vector3;
use proptest::prelude::*;
use shared_types::rotation;

use super::closed_loop::{ClosedLoop, State, closed_loop, state};
use super::path::tilted_eight;

/// Distance between W w and −S(ω)Jω − J ω̇d, in units of the larger of the latter's two terms.
fn defect(closed_loop: &ClosedLoop, state: &State) -> f64 {
    let evaluation = closed_loop.evaluate(state);
    let rates = closed_loop.rates(state, &evaluation);
    let omega_desired = closed_loop.omega_desired(state, &rates);
    let omega = state.measured.angular_velocity_body;
    let actual = &closed_loop.actual;

    let gyroscopic = omega.cross(&actual.inertia.component_mul(&omega));
    let inertial = actual.inertia.component_mul(&omega_desired.rate);
    let w = parameter_vector(&actual.inertia, actual.eta, &closed_loop.disturbance(state));
    let difference = evaluation.regressor.times(&w) + gyroscopic + inertial;
    difference.norm() / gyroscopic.norm().max(inertial.norm())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12_000))]

    #[test]
    fn the_regressor_times_the_truth_is_the_torque_that_follows_omega_desired(
        closed_loop in closed_loop(), state in state(),
    ) {
        let defect = defect(&closed_loop, &state.with_gain(closed_loop.lambda_harmonics));
        prop_assert!(defect < 1e-8, "{}", defect);
    }

    #[test]
    fn omega_desired_is_that_of_its_definition(closed_loop in closed_loop(), state in state()) {
        let evaluation = closed_loop.evaluate(&state);
        let wanted = closed_loop.omega_desired(&state, &closed_loop.rates(&state, &evaluation)).value;
        prop_assert!((evaluation.omega_desired - wanted).norm() < 1e-12 * (1.0 + wanted.norm()));
    }
}

/// A state at a given z1, exactly: at γ = 0 the eight is at x = 0.
fn state_at(z1_x: f64) -> State {
    let pd = tilted_eight(0.0)[0];
    assert_eq!(pd.x, 0.0);
    State {
        harmonics: super::closed_loop::no_harmonics(),
        measured: Measured {
            position_world: pd + Vector3::x() * z1_x,
            world_from_body: rotation::from_roll_pitch_yaw([0.2, -0.3, 0.5]),
            velocity_body: Vector3::new(0.4, -0.2, 0.3),
            angular_velocity_body: Vector3::new(1.0, -0.5, 0.2),
        },
        gamma: 0.0,
        gamma_dot: 0.7,
        estimates: Estimates {
            eta: 4.5,
            disturbance_world: Vector3::new(0.1, 3.05, -0.2),
            w: parameter_vector(
                &Vector3::new(6e-4, 7e-4, 12e-4),
                4.5,
                &Vector3::new(0.1, 0.2, -0.2),
            ),
        },
    }
}

#[test]
fn the_identity_holds_on_the_path_and_exactly_at_the_ends_of_the_transition_zone() {
    let closed_loop = ClosedLoop::paper();
    let (alpha1, alpha2) = (closed_loop.timing_law.alpha1, closed_loop.timing_law.alpha2);
    for z1_x in [0.0, alpha1, alpha2] {
        let state = state_at(z1_x);
        let evaluation = closed_loop.evaluate(&state);
        assert_eq!(evaluation.z1, Vector3::x() * z1_x);
        assert_eq!(closed_loop.reference(&state).gamma_dddot_slope, 0.0);
        assert!(evaluation.torque.iter().all(|torque| torque.is_finite()));
        assert!(evaluation.rates.w.iter().all(|rate| rate.is_finite()));
        let defect = defect(&closed_loop, &state);
        assert!(defect < 1e-12, "z1 = {z1_x}: {defect}");
    }
}

#[test]
fn the_law_is_continuous_across_the_ends_of_the_transition_zone() {
    let closed_loop = ClosedLoop::paper();
    for end in [closed_loop.timing_law.alpha1, closed_loop.timing_law.alpha2] {
        let torque = |z1_x| closed_loop.evaluate(&state_at(z1_x)).torque;
        for neighbour in [end.next_down(), end.next_up(), end - 1e-9, end + 1e-9] {
            assert!((torque(neighbour) - torque(end)).norm() < 1e-6, "{neighbour}");
        }
    }
}

#[test]
fn the_identity_fails_for_a_regressor_without_the_timing_law() {
    let closed_loop = ClosedLoop::paper();
    let state = state_at(0.9);
    let mut deaf = closed_loop.reference(&state);
    assert!(deaf.gamma_dddot_slope.abs() > 0.1);
    deaf.gamma_dddot_slope = 0.0;
    let evaluation = control_law::evaluate(&closed_loop.parameters, &state.measured, &deaf, &state.estimates);
    let complete = closed_loop.evaluate(&state);
    let actual = &closed_loop.actual;
    let w = parameter_vector(&actual.inertia, actual.eta, &actual.disturbance_world);
    let missing = evaluation.regressor.times(&w) - complete.regressor.times(&w);
    assert!(missing.norm() > 1e-2 * complete.regressor.times(&w).norm());
}
