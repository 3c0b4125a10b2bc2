//! Consistency of the filter: flights driven by exactly the noise of its model.

use estimator::kalman::Outcome;
use nalgebra::SVector;
use scenario::{Kalman, Model};

use super::rig::{Rig, World, normal3, restless_pilot};

/// Noise of every kind that the filter knows, all of it large enough to matter.
pub fn noisy() -> Kalman {
    Kalman {
        disturbance_drift: 0.5,
        acceleration_noise: 1e-3,
        rate_noise: 1e-3,
        rate_bias_drift: 1e-2,
        marker_offset_deviation: 0.02,
        ..Kalman::default()
    }
}

/// A flight whose start the filter does not know.
pub fn matched_flight(seed: u64) -> Rig {
    let world = World {
        seed,
        process_noise: true,
        capture_noise: true,
        ..World::perfect()
    };
    Rig::new(world, &noisy(), &Model::default()).starting(|truth| {
        truth.velocity_world = normal3(seed, 1);
        truth.rate_bias_body = normal3(seed, 2) * 0.2;
        truth.disturbance_world = normal3(seed, 3);
        truth.marker_offset_body = normal3(seed, 5) * 0.02;
        truth.world_from_body = shared_types::rotation::exp(&normal3(seed, 4));
    })
}

/// Returns the normalised squared error of the estimate: of 18 degrees of freedom if the filter is right.
pub fn squared_error(rig: &Rig) -> f64 {
    let state = rig.filter.state().unwrap();
    let error = rig.truth_at(state.time_ns).error_of(state);
    error.dot(&state.covariance.cholesky().unwrap().solve(&error))
}

/// Asserts that the mean of squared errors lies where that of a χ² variable of `freedom` does in 999 of 1000 cases.
#[track_caller]
pub fn assert_is_chi_square(squares: &[f64], freedom: f64) {
    let count = squares.len() as f64;
    let mean = squares.iter().sum::<f64>() / count;
    let width = 3.3 * (2.0 * freedom / count).sqrt();
    assert!(
        (mean - freedom).abs() < width,
        "{mean} is not {freedom} ± {width}"
    );
}

#[test]
fn the_mean_squared_error_is_that_of_the_covariance() {
    // One moment of each flight: the error of the marker offset stays what it is throughout.
    let squares: Vec<_> = (0..100)
        .map(|seed| {
            let mut rig = matched_flight(seed);
            while rig.tick < 1200 {
                rig.step(restless_pilot(seed));
            }
            squared_error(&rig)
        })
        .collect();
    assert_is_chi_square(&squares, 18.0);
}

#[test]
fn innovations_are_white_and_of_the_filters_covariance() {
    let (mut squares, mut products, mut sum) = (Vec::new(), Vec::new(), SVector::<f64, 6>::zeros());
    for seed in 100..106 {
        let mut rig = matched_flight(seed);
        let mut before: Option<SVector<f64, 6>> = None;
        while rig.tick < 2000 {
            let outcome = rig.step(restless_pilot(seed)).outcome;
            let Some(Outcome::Used(whitened)) = outcome else {
                continue;
            };
            if rig.tick < 500 {
                continue;
            }
            squares.push(whitened.norm_squared());
            sum += whitened;
            products.extend(before.map(|before| before.dot(&whitened)));
            before = Some(whitened);
        }
    }
    assert_is_chi_square(&squares, 6.0);
    let count = products.len() as f64;
    let correlation = products.iter().sum::<f64>() / (6.0 * count);
    assert!(
        correlation.abs() < 3.3 / (6.0 * count).sqrt(),
        "{correlation} over {count}"
    );
    let largest_mean = (sum / count).amax();
    // The largest of six means.
    assert!(largest_mean < 4.0 / count.sqrt(), "{largest_mean} over {count}");
}

#[test]
fn the_covariance_stays_symmetric_and_positive_definite() {
    let world = World {
        hidden: 700..1000,
        swapped: 1300..1800,
        ..World::laboratory(5)
    };
    let kalman = Kalman {
        marker_offset_deviation: 0.02,
        ..Kalman::default()
    };
    let mut rig = Rig::new(world, &kalman, &Model::default());
    while rig.tick < 2500 {
        rig.step(restless_pilot(5));
        if let Some(state) = rig.filter.state() {
            assert_eq!(state.covariance, state.covariance.transpose());
            assert!(state.covariance.cholesky().is_some(), "at tick {}", rig.tick);
        }
    }
}
