//! Rig of the laboratory, with the default filter.

use estimator::Estimate;
use nalgebra::Vector3;
use scenario::{GRAVITY, Kalman, Model};

use super::rig::{Rig, TICK_NS, World, pilot_on_the_eight, restless_pilot};

/// Root mean square of the errors of the states told from a tick on: position (m), velocity (m/s), attitude (rad).
fn root_mean_squares(rig: &mut Rig, from: u64, to: u64) -> [f64; 3] {
    let mut told: Vec<Estimate> = Vec::new();
    while rig.tick < to + 10 {
        told.extend(rig.step(pilot_on_the_eight).told);
    }
    let window = from * TICK_NS..to * TICK_NS;
    told.retain(|state| window.contains(&state.state_time_ns));
    let mut sums = [0.0; 3];
    for state in &told {
        let errors = rig.truth_at(state.state_time_ns).distances_to(state);
        for (sum, error) in sums.iter_mut().zip(errors) {
            *sum += error * error / told.len() as f64;
        }
    }
    sums.map(f64::sqrt)
}

#[track_caller]
fn assert_below(errors: [f64; 3], bounds: [f64; 3]) {
    let within = errors.iter().zip(bounds).all(|(error, bound)| *error < bound);
    assert!(within, "{errors:?} against {bounds:?}");
}

#[test]
fn on_the_eight_the_predicted_state_is_right_to_half_a_millimetre_and_a_centimetre_a_second() {
    for seed in 20..24 {
        let mut rig = Rig::new(World::laboratory(seed), &Kalman::default(), &Model::default());
        let errors = root_mean_squares(&mut rig, 1000, 6000);
        assert_below(errors, [0.5e-3, 12e-3, 2.3e-3]);
        assert_eq!(rig.filter.captures_refused(), 0);
    }
}

#[test]
fn a_mass_a_fifth_off_and_a_steady_wind_are_taken_up_by_the_disturbance() {
    let wind = Vector3::new(0.5, -0.9, 0.3);
    let world = World {
        mass: 0.24,
        ..World::laboratory(30)
    };
    let mut rig = Rig::new(world, &Kalman::default(), &Model::default())
        .starting(|truth| truth.disturbance_world = wind);
    let errors = root_mean_squares(&mut rig, 2000, 6000);
    assert_below(errors, [0.6e-3, 15e-3, 2.3e-3]);
    // The same acceleration, as the model explains it: d = v̇ − g e3 + (T/m̂) R e3.
    let state = rig.filter.state().unwrap();
    let truth = rig.truth_at(state.time_ns);
    let difference = truth.world_from_body.column(2) * (truth.thrust * (1.0 / 0.2 - 1.0 / 0.24));
    let missed = (state.nominal.disturbance_world - (wind + difference)).norm();
    assert!(
        missed < 0.5 && difference.norm() > 0.15 * GRAVITY,
        "{missed} of {}",
        difference.norm()
    );
}

#[test]
fn coins_that_drop_on_the_vehicle_cost_no_capture() {
    let world = World {
        mass_step: Some((2000, 0.245)),
        ..World::laboratory(31)
    };
    let mut rig = Rig::new(world, &Kalman::default(), &Model::default());
    root_mean_squares(&mut rig, 1000, 3000);
    assert_eq!(rig.filter.captures_refused(), 0);
}

#[test]
fn a_model_that_is_wrong_in_everything_costs_no_capture_and_little_accuracy() {
    for seed in 40..42 {
        let world = World {
            thrust_lag: 0.045,
            rate_lag: 0.03,
            radio_latency: 9,
            thrust_factor: 1.05,
            rate_factor: 0.92,
            ..World::laboratory(seed)
        };
        let mut rig = Rig::new(world, &Kalman::default(), &Model::default())
            .starting(|truth| truth.rate_bias_body = Vector3::new(0.1, -0.2, 0.1));
        let errors = root_mean_squares(&mut rig, 1000, 4000);
        assert_below(errors, [0.6e-3, 15e-3, 2.5e-3]);
        assert_eq!(rig.filter.captures_refused(), 0);
    }
}

/// Mean error of the velocity (m/s) in a flight with many turns, and the offset found at its end, m.
fn turning_flight(seed: u64, offset: Vector3<f64>, kalman: &Kalman) -> (f64, Vector3<f64>) {
    let world = World::laboratory(seed);
    let mut rig =
        Rig::new(world, kalman, &Model::default()).starting(|truth| truth.marker_offset_body = offset);
    let mut velocity_errors = Vec::new();
    while rig.tick < 20_000 {
        let told = rig.step(restless_pilot(seed)).told;
        if let Some(told) = told.filter(|_| rig.tick > 10_000) {
            velocity_errors.push(rig.truths[rig.truths.len() - 1].distances_to(&told)[1]);
        }
    }
    let mean = velocity_errors.iter().sum::<f64>() / velocity_errors.len() as f64;
    (mean, rig.filter.state().unwrap().nominal.marker_offset_body)
}

#[test]
fn an_offset_of_the_markers_is_found_in_a_turning_flight_and_leaves_the_velocity_alone() {
    let estimated = Kalman {
        marker_offset_deviation: 0.02,
        ..Kalman::default()
    };
    let offsets = [
        [0.03, 0.0, 0.0],
        [0.0, -0.03, 0.0],
        [0.0, 0.0, 0.03],
        [0.01, 0.02, -0.03],
    ];
    for (seed, offset) in (0..).zip(offsets.map(Vector3::from)) {
        let (without, _) = turning_flight(seed, Vector3::zeros(), &Kalman::default());
        let (mistaken, _) = turning_flight(seed, offset, &Kalman::default());
        let (mean, found) = turning_flight(seed, offset, &estimated);
        assert!((found - offset).norm() < 0.003, "{found} is not {offset}");
        assert!(
            mean < 1.1 * without,
            "{offset}: {mean} m/s, {without} without an offset"
        );
        assert!(
            mistaken > 1.5 * without,
            "{offset}: {mistaken} m/s would do as well"
        );
    }
}
