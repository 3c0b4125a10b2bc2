//! The wind acts by the velocity through the air alone.

use nalgebra::{Rotation3, Vector3};
use plant::air::{Air, Wind};
use proptest::prelude::*;
use scenario::{Curve, Hover, Path, Scenario, Turbulence, Vehicle};
use vehicle_model::rigid_body::Motion;

const MASS: f64 = 0.2;

fn wind(velocity_world: Option<Vector3<f64>>) -> Wind {
    Wind {
        drag: Vector3::new(0.06, 0.06, 0.02),
        parasitic_drag: 0.004,
        velocity_world,
        turbulence_world: Vector3::zeros(),
        jet: None,
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
        let through_air = wind(None).acceleration(&moving(velocity - air, turn), MASS);
        let in_wind = wind(Some(air)).acceleration(&moving(velocity, turn), MASS);
        prop_assert!((through_air - in_wind).norm() < 1e-12);
        let with_the_wind = wind(Some(air)).acceleration(&moving(air, turn), MASS);
        prop_assert!(with_the_wind.norm() < 1e-12);
    }

    #[test]
    fn drag_takes_energy_and_never_gives_any(velocity in vectors(), turn in vectors()) {
        let power = wind(None).acceleration(&moving(velocity, turn), MASS).dot(&velocity);
        prop_assert!(power <= -(0.02 / MASS + 0.004 / MASS * velocity.norm()) * velocity.norm_squared() + 1e-12);
    }
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
    });
    let position = Hover { position: [0.0; 3] };
    let scenario = Scenario::new(1.0, vehicle, Path::new(Curve::Hover(position)));
    let mut air = Air::new(&scenario).unwrap();
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
