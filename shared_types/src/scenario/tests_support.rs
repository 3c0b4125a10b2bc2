//! A good scenario for tests to spoil.

use super::*;

/// The paper's first figure.
pub(super) fn fig1() -> Scenario {
    let vehicle = Vehicle {
        disturbance: [0.3, 0.2, 0.1],
        change: vec![VehicleChange {
            at: 30.0,
            mass: Some(0.245),
            inertia: Some([7.96e-4, 7.96e-4, 15.92e-4]),
            disturbance: None,
            center_of_mass: None,
        }],
        ..Vehicle::new(0.2, [6.5e-4, 6.5e-4, 13.0e-4])
    };
    Scenario::new(
        60.0,
        vehicle,
        Path::new(Curve::TiltedEight(TiltedEight::default())),
    )
}
