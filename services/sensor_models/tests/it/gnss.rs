//! The satellite receiver.

use nalgebra::Vector3;
use proptest::prelude::*;
use sensor_models::{Fix, Gnss, GnssParameters, TrueMotion};
use shared_types::gnss::{FixErrors, FixKind};
use shared_types::rotation::exp;

/// Time between fixes, s.
const PERIOD: f64 = 0.1;

/// Returns the mean of `squares` over all three axes, and over as many seeds.
fn mean(squares: impl Iterator<Item = Vector3<f64>>) -> Vector3<f64> {
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for square in squares {
        sum += square;
        count += 1.0;
    }
    sum / count
}

fn fixes(parameters: &GnssParameters, seed: u64, kind: FixKind, count: u64) -> Vec<Fix> {
    let mut gnss = Gnss::new(parameters, seed, PERIOD);
    (0..count)
        .map(|tick| gnss.sample(tick, &TrueMotion::AT_REST, kind))
        .collect()
}

#[test]
fn errors_have_the_stated_deviations_at_any_age_of_the_flight() {
    const SEEDS: u64 = 3_000;
    let parameters = GnssParameters::default();
    for kind in FixKind::ALL {
        let [horizontal, vertical, speed] = parameters.errors[kind as usize].deviations();
        let flights: Vec<_> = (0..SEEDS)
            .map(|seed| fixes(&parameters, seed, kind, 31))
            .collect();
        for age in [0, 30] {
            let position = mean(
                flights
                    .iter()
                    .map(|fixes| fixes[age].position_world.map(|x| x * x)),
            );
            let velocity = mean(
                flights
                    .iter()
                    .map(|fixes| fixes[age].velocity_world.map(|x| x * x)),
            );
            let stated = [horizontal, horizontal, vertical, speed, speed, speed];
            for (square, stated) in position.iter().chain(&velocity).zip(stated) {
                let deviation = square.sqrt();
                // Four times the error of a deviation out of as many.
                assert!(
                    (deviation / stated - 1.0).abs() < 4.0 / (2.0 * SEEDS as f64).sqrt(),
                    "{kind:?} {age}"
                );
            }
            let fix = flights[0][age];
            assert!((fix.horizontal_accuracy / std::f64::consts::SQRT_2 - horizontal).abs() < 1e-15);
            assert_eq!([fix.vertical_accuracy, fix.speed_accuracy], [vertical, speed]);
        }
    }
}

#[test]
fn the_slow_error_is_correlated_as_its_time_states() {
    const SEEDS: u64 = 3_000;
    let mut parameters = GnssParameters::default();
    for errors in &mut parameters.errors {
        (errors.position_white, errors.velocity_white) = (0.0, 0.0);
    }
    let kind = FixKind::RtkFixed;
    let FixErrors {
        position_slow,
        position_time,
        velocity_slow,
        velocity_time,
        vertical_factor,
        ..
    } = parameters.errors[kind as usize];
    let vertical = Vector3::new(1.0, 1.0, vertical_factor * vertical_factor);
    let flights: Vec<_> = (0..SEEDS)
        .map(|seed| fixes(&parameters, seed, kind, 101))
        .collect();
    for age in [1, 10, 100] {
        let product = |values: fn(&Fix) -> Vector3<f64>| {
            mean(
                flights
                    .iter()
                    .map(|fixes| values(&fixes[0]).component_mul(&values(&fixes[age]))),
            )
        };
        let apart = age as f64 * PERIOD;
        let position =
            product(|fix| fix.position_world).component_div(&vertical) / (position_slow * position_slow);
        let velocity = product(|fix| fix.velocity_world) / (velocity_slow * velocity_slow);
        for (correlation, time) in [(position.mean(), position_time), (velocity.mean(), velocity_time)] {
            let stated = libm::exp(-apart / time);
            // Four times the error of a mean of products.
            let tolerance = 4.0 * (2.0 / (3.0 * SEEDS as f64)).sqrt();
            assert!(
                (correlation - stated).abs() < tolerance,
                "{apart} s: {correlation} instead of {stated}"
            );
        }
    }
}

#[test]
fn a_change_of_the_solution_scales_the_slow_error() {
    let mut parameters = GnssParameters::default();
    for errors in &mut parameters.errors {
        errors.position_white = 0.0;
    }
    let [mut steady, mut degraded] = [(); 2].map(|()| Gnss::new(&parameters, 5, PERIOD));
    for tick in 0..10 {
        steady.sample(tick, &TrueMotion::AT_REST, FixKind::RtkFixed);
        degraded.sample(tick, &TrueMotion::AT_REST, FixKind::RtkFixed);
    }
    let fixed = steady.sample(10, &TrueMotion::AT_REST, FixKind::RtkFixed);
    let float = degraded.sample(10, &TrueMotion::AT_REST, FixKind::RtkFloat);
    let ratio = float.position_world.x / fixed.position_world.x;
    assert!((ratio - 0.2 / 0.006).abs() < 0.2 * ratio, "{ratio}");
    assert!(float.horizontal_accuracy > fixed.horizontal_accuracy);
}

proptest! {
    #[test]
    fn a_fix_is_that_of_the_antenna(
        theta in [-3.0..3.0f64, -3.0..3.0f64, -3.0..3.0f64], omega in [-5.0..5.0f64, -5.0..5.0f64, -5.0..5.0f64],
        antenna in [-0.2..0.2f64, -0.2..0.2f64, -0.2..0.2f64], seed in 0..1000u64,
    ) {
        let (theta, omega, antenna) = (Vector3::from(theta), Vector3::from(omega), Vector3::from(antenna));
        let motion = TrueMotion {
            position_world: Vector3::new(1.0, 2.0, 3.0),
            velocity_world: Vector3::new(4.0, 5.0, 6.0),
            world_from_body: exp(&theta),
            angular_velocity_body: omega,
            ..TrueMotion::AT_REST
        };
        let centred = Gnss::new(&GnssParameters::default(), seed, PERIOD).sample(0, &motion, FixKind::RtkFixed);
        let parameters = GnssParameters { antenna_body: antenna, ..GnssParameters::default() };
        let fix = Gnss::new(&parameters, seed, PERIOD).sample(0, &motion, FixKind::RtkFixed);
        let place = |t: f64| exp(&theta) * exp(&(omega * t)) * antenna;
        let h = 1e-5;
        let velocity = (place(h) - place(-h)) / (2.0 * h);
        prop_assert!((fix.position_world - centred.position_world - place(0.0)).norm() < 1e-12);
        prop_assert!((fix.velocity_world - centred.velocity_world - velocity).norm() < 1e-8);
        prop_assert!((0.06..0.11).contains(&fix.latency));
    }
}

#[test]
fn a_restored_receiver_continues_bit_by_bit() {
    let mut gnss = Gnss::new(&GnssParameters::default(), 7, PERIOD);
    for tick in 0..50 {
        gnss.sample(tick, &TrueMotion::AT_REST, FixKind::RtkFloat);
    }
    let mut restored = Gnss::new(&GnssParameters::default(), 7, PERIOD);
    restored.restore(&gnss.save());
    for tick in 50..60 {
        let [a, b] =
            [&mut gnss, &mut restored].map(|gnss| gnss.sample(tick, &TrueMotion::AT_REST, FixKind::RtkFixed));
        assert_eq!(a, b);
    }
}
