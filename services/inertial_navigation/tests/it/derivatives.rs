//! Derivatives against differences of what they are derivatives of.

use inertial_navigation::error_state::{
    ACCELEROMETER_BIAS, ALTITUDE_BIAS, ATTITUDE, Covariance, ERRORS, ErrorVector, FIELD_BIAS, FIX_POSITION,
    FIX_VELOCITY, GYROSCOPE_BIAS, POSITION, Transition, VELOCITY, decay,
};
use inertial_navigation::horizon::Horizon;
use inertial_navigation::measurement::{self, Linearized};
use inertial_navigation::nominal::{Biases, Kinematics};
use inertial_navigation::{Altitude, Baseline, Field, Fix, Parameters};
use nalgebra::{SMatrix, Vector3};
use proptest::prelude::*;
use shared_types::gnss::{FixErrors, FixKind};
use shared_types::rotation::{exp, log};

/// Size of the differences.
const STEP: f64 = 1e-6;

fn vector(bound: f64) -> impl Strategy<Value = Vector3<f64>> {
    [-bound..bound, -bound..bound, -bound..bound].prop_map(Vector3::from)
}

prop_compose! {
    fn horizon()(
        place in vector(5.0), velocity in vector(5.0), theta in vector(3.0), gyroscope in vector(0.02),
        accelerometer in vector(0.3), field in vector(0.02), slow in vector(1.0), altitude in -5.0..5.0f64,
    ) -> Horizon {
        Horizon {
            time_ns: 0,
            kinematics: Kinematics { position_world: place, velocity_world: velocity, world_from_body: exp(&theta) },
            biases: Biases {
                gyroscope_body: gyroscope,
                accelerometer_body: accelerometer,
                field_body: field,
                fix_position_world: slow,
                fix_velocity_world: slow * 0.1,
                altitude,
            },
            covariance: Covariance::zeros(),
            transition: Transition::NONE,
        }
    }
}

/// Returns true minus mean, for a true state that differs little from the mean.
fn difference(truth: &Horizon, mean: &Horizon) -> ErrorVector {
    let mut error = ErrorVector::zeros();
    let (k, l, b, c) = (&truth.kinematics, &mean.kinematics, &truth.biases, &mean.biases);
    for (row, part) in [
        (POSITION, k.position_world - l.position_world),
        (VELOCITY, k.velocity_world - l.velocity_world),
        (
            ATTITUDE,
            log(&(l.world_from_body.transpose() * k.world_from_body)),
        ),
        (GYROSCOPE_BIAS, b.gyroscope_body - c.gyroscope_body),
        (ACCELEROMETER_BIAS, b.accelerometer_body - c.accelerometer_body),
        (FIELD_BIAS, b.field_body - c.field_body),
        (FIX_POSITION, b.fix_position_world - c.fix_position_world),
        (FIX_VELOCITY, b.fix_velocity_world - c.fix_velocity_world),
    ] {
        error.fixed_rows_mut::<3>(row).copy_from(&part);
    }
    error[ALTITUDE_BIAS] = b.altitude - c.altitude;
    error
}

/// Returns the derivative of `value` by the error state, by central differences.
fn differences<const M: usize>(
    mean: &Horizon,
    value: impl Fn(&Horizon) -> SMatrix<f64, M, 1>,
) -> SMatrix<f64, M, ERRORS> {
    let moved = |column: usize, by: f64| {
        let mut error = ErrorVector::zeros();
        error[column] = by;
        let mut horizon = *mean;
        horizon.inject(&error);
        value(&horizon)
    };
    let mut derivative = SMatrix::<f64, M, ERRORS>::zeros();
    for column in 0..ERRORS {
        let slope = (moved(column, STEP) - moved(column, -STEP)) / (2.0 * STEP);
        derivative.set_column(column, &slope);
    }
    derivative
}

fn parameters() -> Parameters {
    Parameters {
        antenna_body: Vector3::new(0.1, -0.2, -0.15),
        ..Parameters::default()
    }
}

/// Asserts that a measurement's derivative is that of its prediction, which is minus that of its residual.
fn assert_derivative<const M: usize>(mean: &Horizon, measured: impl Fn(&Horizon) -> Linearized<M>) {
    let by_differences = -differences(mean, |horizon| measured(horizon).residual);
    let stated = measured(mean).derivative;
    assert!(
        (stated - by_differences).norm() < 1e-7,
        "{stated}{by_differences}"
    );
}

proptest! {
    #[test]
    fn the_transition_of_several_steps_is_the_derivative_of_the_propagation(
        mean in horizon(), rate in vector(6.0), force in vector(20.0), other in vector(20.0), h in 1e-4..0.005f64,
    ) {
        let steps = [(rate, force), (rate * -0.5, other), (other * 0.2, force)];
        let propagated = |horizon: &Horizon| {
            let mut end = *horizon;
            for (rate, force) in steps {
                end.kinematics = end.kinematics.advanced(&horizon.biases.removed_from(&rate, &force), h);
            }
            end
        };
        let mut transition = Transition::NONE;
        let mut kinematics = mean.kinematics;
        for (rate, force) in steps {
            let unbiased = mean.biases.removed_from(&rate, &force);
            transition.append(&kinematics, &unbiased, h);
            kinematics = kinematics.advanced(&unbiased, h);
        }
        let end = propagated(&mean);
        let by_differences = differences(&mean, |horizon| difference(&propagated(horizon), &end));
        // Φ P Φᵀ of P = 1: slow errors of fixes decay elsewhere. Φ is of the first order in the turn of a step, of 0.05 at most.
        let carried = transition.carried(&Covariance::identity(), [1.0; 2]);
        let expected = by_differences * by_differences.transpose();
        prop_assert!((carried - expected).norm() < 3e-5, "{}", carried - expected);
        prop_assert!((transition.h - 3.0 * h).abs() < 1e-15);
    }

    #[test]
    fn derivatives_of_measurements_are_those_of_their_predictions(
        mean in horizon(), rate in vector(6.0), measured in vector(3.0),
    ) {
        let parameters = parameters();
        let fix = Fix {
            time_ns: 0,
            kind: FixKind::RtkFloat,
            position_world: measured,
            velocity_world: measured,
            accuracies: [0.0; 3],
        };
        assert_derivative(&mean, |h| measurement::position(&fix, &h.kinematics, &h.biases, &parameters));
        assert_derivative(&mean, |h| {
            let rate = rate - h.biases.gyroscope_body;
            measurement::velocity(&fix, &h.kinematics, &h.biases, &rate, &parameters)
        });
        let field = Field { time_ns: 0, field_body: measured };
        assert_derivative(&mean, |h| measurement::field(&field, &h.kinematics, &h.biases, &parameters));
        let altitude = Altitude { time_ns: 0, altitude: 3.0 };
        assert_derivative(&mean, |h| measurement::altitude(&altitude, &h.kinematics, &h.biases, &parameters));
        let baseline = Baseline { time_ns: 0, baseline_world: measured, accuracies: [0.0; 2] };
        let body = Vector3::new(0.8, -0.3, 0.1);
        assert_derivative(&mean, |h| measurement::baseline(&baseline, &body, &h.kinematics, &parameters));
        assert_derivative(&mean, |h| measurement::pose_position(&measured, &h.kinematics, &parameters));
        // Of the first order in the innovation.
        let near = mean.kinematics.world_from_body * exp(&(measured * 1e-9));
        let attitude = |h: &Horizon| measurement::pose_attitude(&near, &h.kinematics, &parameters);
        assert_derivative(&mean, attitude);
        assert_derivative(&mean, |h| measurement::zero_velocity(&h.kinematics, 0.01));
        assert_derivative(&mean, |h| measurement::resting_rate(&rate, 0.1, &h.biases, &parameters));
    }

    #[test]
    fn a_report_of_larger_errors_raises_the_noise_of_a_fix(worse in 1.0..100.0f64) {
        let parameters = parameters();
        let errors = FixErrors::TYPICAL[FixKind::RtkFixed as usize];
        let [horizontal, vertical, speed] = errors.deviations();
        let noise = |factor: f64| {
            let fix = Fix {
                time_ns: 0,
                kind: FixKind::RtkFixed,
                position_world: Vector3::zeros(),
                velocity_world: Vector3::zeros(),
                accuracies: [std::f64::consts::SQRT_2 * horizontal, vertical, speed].map(|accuracy| accuracy * factor),
            };
            let (kinematics, biases) = (Kinematics::AT_REST, Biases::NONE);
            let position = measurement::position(&fix, &kinematics, &biases, &parameters).noise;
            let velocity = measurement::velocity(&fix, &kinematics, &biases, &Vector3::zeros(), &parameters).noise;
            [position.x, position.z, velocity.x]
        };
        let (usual, better, raised) = (noise(1.0), noise(0.1), noise(worse));
        for at in 0..3 {
            prop_assert!((raised[at] / usual[at] / (worse * worse) - 1.0).abs() < 1e-9);
            prop_assert!((better[at] / usual[at] - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn slow_errors_of_fixes_decay_with_their_times() {
    let errors = FixErrors::TYPICAL[FixKind::RtkFixed as usize];
    let [position, velocity] = decay(&errors, 2.0);
    assert!((position - libm::exp(-2.0 / 30.0)).abs() < 1e-15 && (velocity - libm::exp(-1.0)).abs() < 1e-15);
}
