//! Valid scenarios for tests, which change them.

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

/// A flight in the laboratory: the paper's first figure with all parts between the vehicle and the control law.
pub(super) fn rig() -> Scenario {
    let ideal = fig1();
    let times = |stated: &[(&str, f64)]| {
        let named = stated.iter().map(|&(name, time)| (name.to_owned(), time));
        named.collect::<BTreeMap<_, _>>()
    };
    Scenario {
        schedule: Timing {
            period: times(&[
                ("mocap/pose", 0.01),
                ("vehicle/state", 0.022),
                ("path_generator", 0.022),
                ("controller", 0.022),
                ("rc_output", 0.022),
            ]),
            latency: times(&[("mocap/pose -> estimator", 0.005), ("rc/frame -> plant", 0.005)]),
            ..Timing::default()
        },
        vehicle: Vehicle {
            actuators: Some(Actuators::default()),
            turbulence: Some(Turbulence {
                deviation: 0.05,
                correlation_time: 1.0,
            }),
            fan: Some(Fan {
                on_at: 20.0,
                off_at: Some(50.0),
                run_up: 0.5,
                position: [0.0, -1.5, -1.2],
                direction: [0.0, 1.0, 0.0],
                force: 0.18,
                reference_distance: 1.5,
                half_angle: 0.2,
                turbulence: 0.05,
                correlation_time: 0.3,
                moves: [25.0, 30.0]
                    .map(|at| FanMove {
                        at,
                        position: [-1.5, 0.0, -1.2],
                        direction: [1.0, 0.0, 0.0],
                    })
                    .to_vec(),
            }),
            ..ideal.vehicle
        },
        path: Path {
            yaw_step: vec![YawStep { at: 20.0, yaw: 0.8 }, YawStep { at: 40.0, yaw: 0.0 }],
            ..ideal.path
        },
        controller: Controller {
            rates: Some(RateCommand::default()),
            observer_gain: Some(0.3),
            ..ideal.controller
        },
        cameras: Some(Cameras {
            occlusion: [10.0, 15.0].map(|at| Occlusion { at, lasts: 0.4 }).to_vec(),
            marker_swap: [12.0, 17.0]
                .map(|at| MarkerSwap {
                    at,
                    lasts: 0.2,
                    position: [0.1, 0.0, 0.0],
                    rotation: [0.0, 0.0, 0.3],
                })
                .to_vec(),
            ..Cameras::default()
        }),
        estimator: Some(Estimator {
            kalman: Kalman::default(),
        }),
        rc_output: Some(RcLink::default()),
        model: Some(Model::default()),
        ..ideal
    }
}
