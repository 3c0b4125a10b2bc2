//! A good scenario for tests to spoil.

use super::*;

/// The paper's first figure.
pub(super) fn fig1() -> Scenario {
    Scenario {
        description: String::new(),
        seed: 1,
        duration: 60.0,
        schedule: Timing::default(),
        vehicle: Vehicle {
            mass: 0.2,
            inertia: [6.5e-4, 6.5e-4, 13.0e-4],
            disturbance: [0.3, 0.2, 0.1],
            initial: InitialState::default(),
            change: vec![VehicleChange {
                at: 30.0,
                mass: Some(0.245),
                inertia: Some([7.96e-4, 7.96e-4, 15.92e-4]),
                disturbance: None,
            }],
        },
        path: Path {
            mode: PathMode::Following,
            speed: 1.0,
            k4: 1.0,
            alpha1: 0.5,
            alpha2: 1.5,
            initial_gamma: 0.0,
            initial_gamma_dot: 0.0,
            yaw: 0.0,
            curve: Curve::TiltedEight(TiltedEight::default()),
        },
        controller: Controller::default(),
    }
}
