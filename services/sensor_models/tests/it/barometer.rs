//! The barometer.

use sensor_models::barometer::Surroundings;
use sensor_models::{Barometer, BarometerParameters};

/// Time between samples, s.
const PERIOD: f64 = 0.04;

const HIGH: Surroundings = Surroundings {
    altitude: 10.0,
    above_ground: 10.0,
    airspeed: 0.0,
    rotors_turn: true,
};

/// Parameters without any error.
fn perfect() -> BarometerParameters {
    BarometerParameters {
        white: 0.0,
        slow: 0.0,
        airspeed_factor: 0.0,
        ground_effect: 0.0,
        resolution: 0.0,
        ..BarometerParameters::default()
    }
}

#[test]
fn the_error_is_stationary_with_the_stated_variance_and_correlation() {
    const SEEDS: u64 = 5_000;
    let parameters = BarometerParameters {
        resolution: 0.0,
        ..BarometerParameters::default()
    };
    let (mut at_first, mut at_last, mut product) = (0.0, 0.0, 0.0);
    for seed in 0..SEEDS {
        let mut barometer = Barometer::new(&parameters, seed, PERIOD);
        let errors: Vec<_> = (0..1_251)
            .map(|tick| barometer.sample(tick, &HIGH) - 10.0)
            .collect();
        at_first += errors[0] * errors[0] / SEEDS as f64;
        at_last += errors[1_250] * errors[1_250] / SEEDS as f64;
        product += errors[0] * errors[1_250] / SEEDS as f64;
    }
    let variance = 0.1 * 0.1 + 0.3 * 0.3;
    // 50 s apart: half the correlation time.
    for (measured, stated) in [
        (at_first, variance),
        (at_last, variance),
        (product, 0.3 * 0.3 * libm::exp(-0.5)),
    ] {
        assert!(
            (measured - stated).abs() < 4.0 * variance * (2.0 / SEEDS as f64).sqrt(),
            "{measured} {stated}"
        );
    }
}

#[test]
fn turning_rotors_near_the_ground_lower_the_altitude() {
    let parameters = BarometerParameters {
        ground_effect: 1.0,
        ..perfect()
    };
    let near = Surroundings {
        above_ground: 0.25,
        ..HIGH
    };
    let stopped = Surroundings {
        rotors_turn: false,
        ..near
    };
    let mut barometer = Barometer::new(&parameters, 1, PERIOD);
    assert_eq!(
        [near, stopped, HIGH].map(|around| barometer.sample(0, &around)),
        [9.5, 10.0, 10.0]
    );
}

#[test]
fn the_flow_around_the_sensor_acts_with_the_square_of_the_airspeed() {
    let parameters = BarometerParameters {
        airspeed_factor: 0.05,
        ..perfect()
    };
    let windy = Surroundings {
        airspeed: 4.0,
        ..HIGH
    };
    assert!((Barometer::new(&parameters, 1, PERIOD).sample(0, &windy) - 10.8).abs() < 1e-12);
}

#[test]
fn a_restored_barometer_continues_bit_by_bit() {
    let mut barometer = Barometer::new(&BarometerParameters::default(), 7, PERIOD);
    for tick in 0..50 {
        barometer.sample(tick, &HIGH);
    }
    let mut restored = Barometer::new(&BarometerParameters::default(), 7, PERIOD);
    restored.restore(&barometer.save());
    for tick in 50..60 {
        assert_eq!(restored.sample(tick, &HIGH), barometer.sample(tick, &HIGH));
    }
}
