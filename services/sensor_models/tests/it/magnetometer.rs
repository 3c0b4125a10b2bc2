//! The magnetometer.

use nalgebra::{Matrix3, Vector3};
use sensor_models::{Magnetometer, MagnetometerParameters};
use shared_types::rotation::exp;

#[test]
fn a_perfect_magnetometer_measures_the_field_in_the_body() {
    let parameters = MagnetometerParameters {
        white: 0.0,
        hard_iron_deviation: 0.0,
        soft_iron_deviation: 0.0,
        resolution: 0.0,
        ..MagnetometerParameters::default()
    };
    let mut magnetometer = Magnetometer::new(&parameters, 1);
    let world_from_body = exp(&Vector3::new(0.1, -0.4, 2.0));
    let field = world_from_body.transpose() * parameters.field_world;
    assert!((magnetometer.sample(0, &world_from_body, 0.0) - field).norm() < 1e-15);
    let loaded = magnetometer.sample(0, &world_from_body, 0.5);
    assert!((loaded - field - parameters.current_body * 0.5).norm() < 1e-15);
}

#[test]
fn iron_and_noise_have_the_stated_deviations() {
    const SEEDS: u64 = 3_000;
    let parameters = MagnetometerParameters {
        resolution: 0.0,
        ..MagnetometerParameters::default()
    };
    let level = Matrix3::identity();
    let (mut hard, mut soft, mut white) = (0.0, 0.0, 0.0);
    for seed in 0..SEEDS {
        let mut magnetometer = Magnetometer::new(&parameters, seed);
        let [first, second] = [0, 1].map(|tick| magnetometer.sample(tick, &level, 0.0));
        hard += magnetometer.hard_iron().norm_squared() / (3.0 * SEEDS as f64);
        white += (first - second).norm_squared() / (6.0 * SEEDS as f64);
        // Hard iron, averaged with its opposite by turning the vehicle, leaves the soft iron.
        let turned = exp(&Vector3::new(0.0, 0.0, std::f64::consts::PI));
        let north = 0.5 * (first - magnetometer.sample(0, &turned, 0.0)).x - parameters.field_world.x;
        soft += north * north / SEEDS as f64;
    }
    let north = 0.02 * parameters.field_world.x;
    for (square, stated) in [(hard, 0.01), (white, 0.003), (soft, north)] {
        assert!(
            (square.sqrt() / stated - 1.0).abs() < 0.05,
            "{} instead of {stated}",
            square.sqrt()
        );
    }
}
