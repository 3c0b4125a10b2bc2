//! Everything that the rig knows, at once.

/// The settings that make of the first seconds of `fig3_6.toml` a flight in which everything happens that the rig
/// knows.
pub(crate) const ALL_OF_THE_RIG: [&str; 12] = [
    "vehicle.change=[{at = 0.4, mass = 0.23, center_of_mass = [0.003, 0.0, 0.002]}]",
    "vehicle.drag=[0.05, 0.05, 0.1]",
    "vehicle.actuators.frame_loss=0.1",
    "vehicle.actuators.rate_bias=[0.02, -0.01, 0.03]",
    "vehicle.fan={on_at = 0.2, run_up = 0.1, position = [0.0, -1.5, -1.2], direction = [0.0, 1.0, 0.0], \
     force = 0.18, reference_distance = 1.5, turbulence = 0.1, \
     moves = [{at = 0.3, position = [0.5, -1.5, -1.2], direction = [0.0, 1.0, 0.0]}]}",
    "cameras.jitter=0.004",
    "cameras.frame_loss=0.05",
    "cameras.occlusion=[{at = 0.5, lasts = 0.05}]",
    "cameras.marker_swap=[{at = 0.3, lasts = 0.03, position = [0.1, 0.0, 0.0], rotation = [0.0, 0.0, 0.3]}]",
    "path.yaw_step=[{at = 0.1, yaw = 0.7}]",
    "controller.observer_gain=0.3",
    "estimator.kalman.restart_after=0.02",
];
