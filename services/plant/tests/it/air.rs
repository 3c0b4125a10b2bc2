//! The wind acts by the velocity through the air alone.

use nalgebra::{Rotation3, Vector3};
use plant::actuators::Drive;
use plant::air::{Air, GroundEffect, Wind};
use plant::dynamics::Dynamics;
use proptest::prelude::*;
use scenario::{Curve, Hover, Path, Scenario, Turbulence, Vehicle};
use vehicle_model::rigid_body::{Body, Motion, Wrench};

const MASS: f64 = 0.2;

fn wind(velocity_world: Option<Vector3<f64>>) -> Wind {
    Wind {
        drag: Vector3::new(0.06, 0.06, 0.02),
        parasitic_drag: 0.004,
        velocity_world,
        turbulence_world: Vector3::zeros(),
        jet: None,
        ground_effect: None,
    }
}

fn vectors() -> impl Strategy<Value = Vector3<f64>> {
    [-8.0..8.0f64, -8.0..8.0, -8.0..8.0].prop_map(Vector3::from)
}

fn moving(velocity_world: Vector3<f64>, turn: Vector3<f64>) -> Motion {
    Motion {
        position_world: Vector3::zeros(),
        world_from_body: *Rotation3::new(turn * 0.3).matrix(),
        velocity_world,
        angular_velocity_body: Vector3::zeros(),
    }
}

proptest! {
    #[test]
    fn only_the_velocity_through_the_air_counts(velocity in vectors(), air in vectors(), turn in vectors()) {
        let through_air = wind(None).acceleration(&moving(velocity - air, turn), 0.0, MASS);
        let in_wind = wind(Some(air)).acceleration(&moving(velocity, turn), 0.0, MASS);
        prop_assert!((through_air - in_wind).norm() < 1e-12);
        let with_the_wind = wind(Some(air)).acceleration(&moving(air, turn), 0.0, MASS);
        prop_assert!(with_the_wind.norm() < 1e-12);
    }

    #[test]
    fn drag_takes_energy_and_never_gives_any(velocity in vectors(), turn in vectors()) {
        let power = wind(None).acceleration(&moving(velocity, turn), 0.0, MASS).dot(&velocity);
        prop_assert!(power <= -(0.02 / MASS + 0.004 / MASS * velocity.norm()) * velocity.norm_squared() + 1e-12);
    }
}

fn hovering(vehicle: Vehicle) -> Scenario {
    let position = Hover { position: [0.0; 3] };
    Scenario::new(1.0, vehicle, Path::new(Curve::Hover(position)))
}

#[test]
fn the_wind_has_its_mean_its_gusts_and_its_sine() {
    let mut vehicle = Vehicle::new(MASS, [6.5e-4, 6.5e-4, 13.0e-4]);
    vehicle.drag = [0.06, 0.06, 0.02];
    vehicle.wind = Some(scenario::Wind {
        mean: [3.0, 0.0, 0.0],
        gusts: Some(Turbulence {
            deviation: 1.2,
            correlation_time: 0.5,
        }),
        sine: [0.0, 2.0, 0.0],
        sine_frequency: 1.5,
        dryden: None,
    });
    let mut air = Air::new(&hovering(vehicle)).unwrap();
    let gusts: Vec<_> = (0..400_000u32)
        .map(|tick| {
            air.advance(u64::from(tick) + 1);
            let time = 1e-3 * f64::from(tick + 1);
            let known = Vector3::new(3.0, 2.0 * libm::sin(1.5 * time), 0.0);
            air.wind(time).velocity_world.unwrap() - known
        })
        .collect();
    // 400 s are 400 independent gusts: the mean is known to 1.2/√400, the deviation to a few per cent.
    let count = gusts.len() as f64;
    let mean = gusts.iter().sum::<Vector3<f64>>() / count;
    assert!(mean.norm() < 4.0 * 1.2 / 400.0_f64.sqrt(), "{mean}");
    for axis in 0..3 {
        let deviation = (gusts.iter().map(|gust| gust[axis] * gust[axis]).sum::<f64>() / count).sqrt();
        assert!((deviation / 1.2 - 1.0).abs() < 0.12, "{axis}: {deviation}");
    }
}

/// Of σ and τ = L/V: e^−s/τ along the wind, (1 − s/2τ) e^−s/τ across it.
#[test]
fn dryden_gusts_have_the_correlations_of_the_model() {
    let (mean, deviation, length) = (Vector3::new(0.0, 4.0, 0.0), [1.0, 0.8, 0.5], [2.0, 1.2, 0.8]);
    let mut vehicle = Vehicle::new(MASS, [6.5e-4, 6.5e-4, 13.0e-4]);
    vehicle.drag = [0.06, 0.06, 0.02];
    vehicle.wind = Some(scenario::Wind {
        mean: mean.into(),
        dryden: Some(scenario::Dryden { deviation, length }),
        ..scenario::Wind::default()
    });
    let mut air = Air::new(&hovering(vehicle)).unwrap();
    let gusts: Vec<_> = (0..2_000_000u32)
        .map(|tick| {
            air.advance(u64::from(tick) + 1);
            air.wind(0.0).velocity_world.unwrap() - mean
        })
        .collect();
    // The wind blows along y: aside is −x.
    for (axis, which) in [(1, 0), (0, 1), (2, 2)] {
        let (variance, time) = (deviation[which] * deviation[which], length[which] / mean.norm());
        for lag in [0, 50, 100, 200, 400] {
            let pairs = gusts.iter().zip(&gusts[lag..]);
            let found = pairs.map(|(a, b)| a[axis] * b[axis]).sum::<f64>() / (gusts.len() - lag) as f64;
            let s = 1e-3 * lag as f64 / time;
            let shape = if which == 0 { 1.0 } else { 1.0 - s / 2.0 };
            let expected = variance * shape * libm::exp(-s);
            // 2000 s are some thousand independent gusts.
            assert!(
                (found - expected).abs() < 0.08 * variance,
                "{axis}, {lag} ms: {found} for {expected}"
            );
        }
    }
}

#[test]
fn restored_dryden_gusts_go_on_to_the_bit() {
    let mut vehicle = Vehicle::new(MASS, [6.5e-4, 6.5e-4, 13.0e-4]);
    vehicle.drag = [0.06, 0.06, 0.02];
    vehicle.wind = Some(scenario::Wind {
        mean: [3.0, 1.0, 0.5],
        dryden: Some(scenario::Dryden {
            deviation: [1.0; 3],
            length: [1.0; 3],
        }),
        ..scenario::Wind::default()
    });
    let scenario = hovering(vehicle);
    let mut air = Air::new(&scenario).unwrap();
    (1..=50).for_each(|tick| air.advance(tick));
    let mut restored = Air::new(&scenario).unwrap();
    restored.restore(&air.gusts());
    for tick in 51..60 {
        air.advance(tick);
        restored.advance(tick);
        assert_eq!(air.wind(0.0), restored.wind(0.0));
    }
}

#[test]
fn near_the_ground_rotors_carry_more_by_the_formula_and_never_without_bound() {
    let effect = GroundEffect::new(&scenario::GroundEffect {
        rotor_radius: 0.08,
        factor: 1.0,
        ground: 0.5,
    });
    // One radius above the ground: 1/(1 − 1/16).
    assert!((effect.gain(0.42) - 1.0 / 15.0).abs() < 1e-12);
    assert!(effect.gain(-10.0) < 1e-4);
    for z in [0.49, 0.5, 0.6] {
        assert!((effect.gain(z) - 0.5).abs() < 1e-12);
    }
    let mut air = wind(None);
    air.ground_effect = Some(effect);
    let near = Motion {
        position_world: Vector3::z() * 0.42,
        ..moving(Vector3::zeros(), Vector3::zeros())
    };
    let lift = air.acceleration(&near, 2.0, MASS);
    assert!((lift + Vector3::z() * (2.0 / 15.0 / MASS)).norm() < 1e-12);
}

/// Where a vehicle is that falls towards the ground in wind, after 0.25 s in steps of h.
fn fallen(steps: u32) -> Vector3<f64> {
    let body = Body {
        mass: MASS,
        inertia: Vector3::new(6.5e-4, 6.5e-4, 13.0e-4),
        disturbance_world: Vector3::zeros(),
        center_of_mass: Vector3::zeros(),
    };
    let mut air = wind(Some(Vector3::new(4.0, -2.0, 1.0)));
    air.ground_effect = Some(GroundEffect::new(&scenario::GroundEffect {
        rotor_radius: 0.12,
        factor: 2.0,
        ground: 0.5,
    }));
    let drive = Drive::Held(Wrench {
        thrust: 1.7,
        torque_body: Vector3::new(2e-4, -1e-4, 3e-4),
    });
    let dynamics = Dynamics {
        body: &body,
        drive: &drive,
        wind: Some(&air),
    };
    let start = Motion {
        position_world: Vector3::new(0.0, 0.0, 0.1),
        ..moving(Vector3::new(0.5, 0.2, 0.6), Vector3::new(0.3, 0.2, 0.1))
    };
    let h = 0.25 / f64::from(steps);
    (0..steps)
        .fold(start, |motion, _| dynamics.advanced(&motion, h))
        .position_world
}

#[test]
fn the_motion_in_wind_and_over_the_ground_converges_with_the_fourth_power_of_the_step() {
    let truth = fallen(4096);
    let error = |steps| (fallen(steps) - truth).norm();
    for steps in [8, 16, 32] {
        let order = libm::log2(error(steps) / error(2 * steps));
        assert!((3.5..4.6).contains(&order), "{steps} steps: order {order}");
    }
}
