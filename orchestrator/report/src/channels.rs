//! Plotted channels of each topic: their names, and the values of a sample in the same order.
//!
//! A value that a sample does not have is NaN.

use control_law::yaw::shorter_way;
use metrics::summary::innovations::{BASELINE, BASELINE_SOURCES, FREEDOM, POSE_SOURCES, SOURCES};
use nalgebra::Vector3;
use shared_types::rotation::{from_row_major, roll_pitch_yaw};
use shared_types::samples::{
    BaselineInnovations, ControlAdaptation, ControlCommand, ControlErrors, NavigationInnovations,
    PathReference, PoseInnovations, VehicleTruth,
};

/// Channels of `vehicle/truth`.
pub const TRUTH: [&str; 13] = [
    "error",
    "thrust",
    "rate_x",
    "rate_y",
    "rate_z",
    "mass",
    "disturbance_x",
    "disturbance_y",
    "disturbance_z",
    "roll",
    "pitch",
    "yaw",
    "yaw_error",
];

/// Values of [`TRUTH`], with the true distance from the reference point (m) and the desired yaw (rad), where known.
pub fn truth(truth: &VehicleTruth, error: Option<f64>, yaw_desired: Option<f64>) -> [f64; TRUTH.len()] {
    let [roll, pitch, yaw] = roll_pitch_yaw(&from_row_major(&truth.world_from_body));
    let [rate_x, rate_y, rate_z] = truth.angular_velocity_body;
    let [b_x, b_y, b_z] = truth.disturbance_world;
    let yaw_error = yaw_desired.map(|desired| shorter_way(yaw - desired));
    [
        error.unwrap_or(f64::NAN),
        truth.thrust,
        rate_x,
        rate_y,
        rate_z,
        truth.mass,
        b_x,
        b_y,
        b_z,
        roll,
        pitch,
        yaw,
        yaw_error.unwrap_or(f64::NAN),
    ]
}

/// Channels of `vehicle/state`, for a flight without recorded truth.
pub const STATE: [&str; 1] = ["error"];

/// Values of [`STATE`]: the estimated distance from the reference point (m), where known.
pub fn state(error: Option<f64>) -> [f64; STATE.len()] {
    [error.unwrap_or(f64::NAN)]
}

/// Channels of `control/errors`.
pub const ERRORS: [&str; 4] = ["z1", "z2", "z3", "z4"];

/// ‖z1‖, ‖z2‖, ‖z3‖ and z4 as published by the controller; NaN while the control law is inactive.
pub fn errors(errors: &ControlErrors, is_law_active: bool) -> [f64; ERRORS.len()] {
    if is_law_active {
        [norm(errors.z1), norm(errors.z2), norm(errors.z3), errors.z4]
    } else {
        [f64::NAN; ERRORS.len()]
    }
}

/// Channels of `control/command`.
pub const COMMAND: [&str; 7] = [
    "thrust", "torque_x", "torque_y", "torque_z", "rate_x", "rate_y", "rate_z",
];

/// The commanded thrust and torques or rates; NaN in failsafe.
pub fn command(command: &ControlCommand) -> [f64; COMMAND.len()] {
    let only_with = |mode: u32, values: [f64; 3]| {
        if command.mode == mode {
            values
        } else {
            [f64::NAN; 3]
        }
    };
    let thrust = if command.mode == ControlCommand::MODE_FAILSAFE {
        f64::NAN
    } else {
        command.thrust
    };
    let [torque_x, torque_y, torque_z] = only_with(ControlCommand::MODE_TORQUE, command.torque_body);
    let [rate_x, rate_y, rate_z] = only_with(ControlCommand::MODE_RATES, command.rates_body);
    [thrust, torque_x, torque_y, torque_z, rate_x, rate_y, rate_z]
}

/// Channels of `control/adaptation`.
pub const ADAPTATION: [&str; 5] = [
    "mass",
    "observer_mass",
    "disturbance_x",
    "disturbance_y",
    "disturbance_z",
];

/// m̂, the observer's m̂ if one runs in parallel, and π(b̂).
pub fn adaptation(adaptation: &ControlAdaptation, has_observer: bool) -> [f64; ADAPTATION.len()] {
    let [x, y, z] = adaptation.disturbance_projected_world;
    [
        adaptation.mass_estimate,
        if has_observer {
            adaptation.observer_mass_estimate
        } else {
            f64::NAN
        },
        x,
        y,
        z,
    ]
}

/// Channels of `path/reference`.
pub const REFERENCE: [&str; 3] = ["gamma_dot", "gamma_dot_desired", "yaw"];

/// γ̇, γ̇d and ψd.
pub fn reference(reference: &PathReference) -> [f64; REFERENCE.len()] {
    [reference.gamma_dot, reference.gamma_dot_desired, reference.yaw]
}

/// Channels of `navigation/innovations`.
pub const INNOVATIONS: [&str; SOURCES.len()] = SOURCES;

/// The last innovation of each source, over its predicted deviation: the root of the normalised square per degree of freedom; NaN
/// before the first.
pub fn innovations(sample: &NavigationInnovations) -> [f64; INNOVATIONS.len()] {
    std::array::from_fn(|index| match sample.valid_ns[index] {
        0 => f64::NAN,
        _ => (sample.normalised_squares[index] / FREEDOM[index]).sqrt(),
    })
}

/// Channels of `navigation/poses`.
pub const POSES: [&str; POSE_SOURCES.len()] = POSE_SOURCES;

/// The same of poses.
pub fn poses(sample: &PoseInnovations) -> [f64; POSES.len()] {
    std::array::from_fn(|index| match sample.valid_ns[index] {
        0 => f64::NAN,
        _ => (sample.normalised_squares[index] / FREEDOM[SOURCES.len() + index]).sqrt(),
    })
}

/// Channels of `navigation/baseline`.
pub const BASELINES: [&str; BASELINE_SOURCES.len()] = BASELINE_SOURCES;

/// The same of baselines.
pub fn baselines(sample: &BaselineInnovations) -> [f64; BASELINES.len()] {
    match sample.valid_ns {
        [0] => [f64::NAN],
        _ => [(sample.normalised_squares[0] / FREEDOM[BASELINE]).sqrt()],
    }
}

fn norm(vector: [f64; 3]) -> f64 {
    Vector3::from(vector).norm()
}
