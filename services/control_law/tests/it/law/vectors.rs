//! Agreement with 64 evaluations of the law by another implementation, at the default parameters but for Λw.

use control_law::adaptive::parameter_vector::ParameterVector;
use control_law::{Estimates, Measured};
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

use super::closed_loop::{ClosedLoop, State};

/// Λw of these evaluations; dŵ/dt is proportional to it, and nothing else depends on it.
const LAMBDA_INERTIA: f64 = 1e-8;

#[derive(Deserialize)]
struct File {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    p: [f64; 3],
    #[serde(rename = "R")]
    r: [f64; 9],
    v: [f64; 3],
    omega: [f64; 3],
    gamma: f64,
    gamma_dot: f64,
    eta_hat: f64,
    b_hat: [f64; 3],
    w_hat: [f64; 15],
    z1: [f64; 3],
    z2: [f64; 3],
    z3: [f64; 3],
    z4: f64,
    omega_d: [f64; 3],
    #[serde(rename = "T")]
    thrust: f64,
    tau: [f64; 3],
    gamma_ddot: f64,
    eta_hat_dot: f64,
    b_hat_dot: [f64; 3],
    w_hat_dot: [f64; 15],
    #[serde(rename = "W")]
    regressor: Vec<f64>,
}

impl Case {
    fn state(&self) -> State {
        State {
            harmonics: super::closed_loop::no_harmonics(),
            measured: Measured {
                position_world: Vector3::from(self.p),
                world_from_body: Matrix3::from_row_slice(&self.r),
                velocity_body: Vector3::from(self.v),
                angular_velocity_body: Vector3::from(self.omega),
            },
            gamma: self.gamma,
            gamma_dot: self.gamma_dot,
            estimates: Estimates {
                eta: self.eta_hat,
                disturbance_world: Vector3::from(self.b_hat),
                w: ParameterVector::from(self.w_hat),
            },
        }
    }
}

/// Asserts each element to 1e−9 of its size; elements that rounding decides, to 1e−12 of the largest of their quantity.
fn assert_agrees(what: &str, got: &[f64], wanted: &[f64]) {
    assert_eq!(got.len(), wanted.len(), "{what}");
    let largest = wanted
        .iter()
        .fold(0.0f64, |largest, element| largest.max(element.abs()));
    for (got, wanted) in got.iter().zip(wanted) {
        let tolerance = 1e-9 * wanted.abs() + 1e-12 * largest;
        assert!((got - wanted).abs() <= tolerance, "{what}: {got} for {wanted}");
    }
}

#[test]
fn the_law_agrees_with_another_implementation() {
    let file: File = serde_json::from_str(include_str!("../../data/control.json")).unwrap();
    assert_eq!(file.cases.len(), 64);
    let mut closed_loop = ClosedLoop::paper();
    closed_loop.parameters.lambda_inertia = LAMBDA_INERTIA;
    for (index, case) in file.cases.iter().enumerate() {
        let state = case.state();
        let evaluation = closed_loop.evaluate(&state);
        let rates = &evaluation.rates;
        let dense = evaluation.regressor.to_matrix().transpose(); // column-major of Wᵀ is row-major of W
        let agrees = |what: &str, got: &[f64], wanted: &[f64]| {
            assert_agrees(&format!("case {index}, {what}"), got, wanted);
        };
        agrees("z1", evaluation.z1.as_slice(), &case.z1);
        agrees("z2", evaluation.z2.as_slice(), &case.z2);
        agrees("z3", evaluation.z3.as_slice(), &case.z3);
        agrees("z4", &[evaluation.z4], &[case.z4]);
        agrees("omega_d", evaluation.omega_desired.as_slice(), &case.omega_d);
        agrees("T", &[evaluation.thrust], &[case.thrust]);
        agrees("tau", evaluation.torque.as_slice(), &case.tau);
        agrees(
            "gamma_ddot",
            &[closed_loop.reference(&state).gamma_ddot],
            &[case.gamma_ddot],
        );
        agrees("eta_hat_dot", &[rates.eta], &[case.eta_hat_dot]);
        agrees("b_hat_dot", rates.disturbance_world.as_slice(), &case.b_hat_dot);
        agrees("w_hat_dot", rates.w.as_slice(), &case.w_hat_dot);
        agrees("W", dense.as_slice(), &case.regressor);
    }
}
