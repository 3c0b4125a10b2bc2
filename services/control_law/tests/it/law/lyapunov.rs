//! Rate dVn/dt = −k2 z2ᵀσ(z2) − k3 z3ᵀσ(z3) − κ‖ε‖² along the closed loop, and its consequences.

use control_law::adaptive::lyapunov;
use control_law::adaptive::parameter_vector::parameter_vector;
use control_law::{Estimates, Measured};
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;

use super::closed_loop::{ClosedLoop, State, closed_loop, no_harmonics, state};
use super::path::tilted_eight;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12_000))]

    #[test]
    fn every_term_of_the_rate_but_the_dissipation_cancels(closed_loop in closed_loop(), state in state()) {
        let state = state.with_gain(closed_loop.lambda_harmonics);
        let ClosedLoop { parameters, actual, .. } = &closed_loop;
        let evaluation = closed_loop.evaluate(&state);
        let rates = closed_loop.rates(&state, &evaluation);
        let z2 = closed_loop.z2(&state, &rates);
        let z3_rate = rates.angular_velocity_body - closed_loop.omega_desired(&state, &rates).rate;
        let w = parameter_vector(&actual.inertia, actual.eta, &actual.disturbance_world);
        let Estimates { eta, disturbance_world, w: w_hat } = state.estimates;

        // The rate of V(s, s̃) is (π(ŝ) − s) times that of ŝ.
        let eta_error = parameters.projections.eta.value(eta) - actual.eta;
        let disturbance_error =
            disturbance_world.map(|b| parameters.projections.disturbance.value(b)) - actual.disturbance_world;
        let terms = [
            z2.value.dot(&z2.rate),
            parameters.beta * evaluation.z3.dot(&actual.inertia.component_mul(&z3_rate)),
            (w_hat - w).dot(&rates.estimates.w) / parameters.lambda_inertia,
            eta_error * rates.estimates.eta / parameters.lambda_mass,
            disturbance_error
                .dot(&rates.estimates.disturbance_world.component_div(&parameters.lambda_disturbance)),
            closed_loop.of_harmonics(&state, &rates),
        ];
        let error = closed_loop.prediction_error(&state, evaluation.thrust);
        let wanted = lyapunov::rate(parameters, &evaluation) - parameters.prediction_gain * error.norm_squared();
        let difference = terms.iter().sum::<f64>() - wanted;
        // Rounding, relative to the terms that cancel.
        let rounding = 1e-13 * terms.iter().map(|term| term.abs()).sum::<f64>();
        prop_assert!(difference.abs() < 1e-9 * wanted.abs() + rounding, "{} of {}", difference, wanted);
        prop_assert!(wanted <= 0.0);
    }
}

/// State at rest, level and at `z1` from the beginning of the path, with the paper's initial estimates.
fn at_rest(z1: Vector3<f64>) -> State {
    State {
        measured: Measured {
            position_world: tilted_eight(0.0)[0] + z1,
            world_from_body: Matrix3::identity(),
            velocity_body: Vector3::zeros(),
            angular_velocity_body: Vector3::zeros(),
        },
        gamma: 0.0,
        gamma_dot: 0.0,
        estimates: Estimates::from(&scenario::InitialEstimates::default()),
        harmonics: no_harmonics(),
    }
}

/// Largest relative difference between the decrease of Vn since the start and the integral of its rate.
fn defect_along_the_flow(closed_loop: &ClosedLoop, start: State, time_step: f64, steps: u32) -> f64 {
    let parameters = &closed_loop.parameters;
    let vn = |state: &State| {
        lyapunov::value(
            parameters,
            &closed_loop.actual,
            &state.estimates,
            &closed_loop.evaluate(state),
        )
    };
    let beginning = vn(&start);
    let (mut state, mut integral, mut worst) = (start, 0.0, 0.0f64);
    for _ in 0..steps {
        let (next, part) = closed_loop.step(&state, time_step, |evaluation| {
            lyapunov::rate(parameters, evaluation)
        });
        state = next;
        integral += part;
        worst = worst.max((vn(&state) - beginning - integral).abs() / beginning);
    }
    assert!(
        integral < -0.05 * beginning,
        "the flow is to dissipate: {integral} of {beginning}"
    );
    worst
}

#[test]
fn the_function_decreases_by_the_integral_of_its_rate() {
    let start = at_rest(Vector3::new(0.7, -0.4, 0.3));
    let defect = defect_along_the_flow(&ClosedLoop::paper(), start, 5e-5, 10_000);
    assert!(defect < 1e-9, "{defect}");
}

#[test]
fn the_function_decreases_by_the_integral_of_its_rate_with_estimates_out_of_bounds() {
    let mut start = at_rest(Vector3::new(0.7, -0.4, 0.3));
    start.estimates.eta = 10.05;
    start.estimates.disturbance_world = Vector3::new(3.3, -3.2, 3.4);
    let defect = defect_along_the_flow(&ClosedLoop::paper(), start, 2e-5, 5_000);
    assert!(defect < 1e-9, "{defect}");
}

/// Largest ‖z1‖ of the last five of `seconds` seconds from rest at a position, in steps of 2 ms.
fn ultimate_distance(position_world: [f64; 3], seconds: u32) -> f64 {
    let closed_loop = ClosedLoop::paper();
    let mut state = at_rest(Vector3::zeros());
    state.measured.position_world = Vector3::from(position_world);
    let mut largest = 0.0f64;
    for step in 0..500 * seconds {
        state = closed_loop.step(&state, 2e-3, |_| 0.0).0;
        if step >= 500 * (seconds - 5) {
            largest = largest.max(closed_loop.evaluate(&state).z1.norm());
        }
    }
    largest
}

#[test]
fn the_position_error_ends_within_the_bound_of_the_theorem() {
    let bound = scenario::Controller::default().ultimate_bound();
    let distance = ultimate_distance([0.0; 3], 30);
    assert!(distance < 1.01 * bound, "{distance} above {bound}");
}

/// From far away the estimates take longer to settle, and the bound is reached only in the limit.
#[test]
fn the_position_error_from_far_away_ends_as_in_figure_2() {
    for position in [[5.0, 5.0, -5.0], [15.0, -15.0, 15.0], [-30.0, 30.0, -30.0]] {
        let distance = ultimate_distance(position, 60);
        assert!(distance < 0.0185, "from {position:?}: {distance}");
    }
}
