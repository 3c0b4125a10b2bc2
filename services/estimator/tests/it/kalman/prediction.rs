//! Filter without noise: it finds the truth, and its prediction is the future.

use estimator::kalman::Outcome;
use nalgebra::Vector3;
use scenario::{Kalman, Model};
use shared_types::rotation::exp;
use std::f64::consts::PI;

use super::rig::{Asked, CAPTURE_PERIOD, Rig, TICK_NS, World, restless_pilot};

/// Largest errors of the states told between two ticks.
fn largest_errors(
    rig: &mut Rig,
    from: u64,
    to: u64,
    pilot: impl Fn(f64, Option<&estimator::Estimate>) -> Asked,
) -> [f64; 3] {
    let mut told = Vec::new();
    while rig.tick < to + 10 {
        told.extend(rig.step(&pilot).told);
    }
    let window = from * TICK_NS..to * TICK_NS;
    let errors = told
        .iter()
        .filter(|state| window.contains(&state.state_time_ns))
        .map(|state| rig.truth_at(state.state_time_ns).distances_to(state));
    errors.fold([0.0; 3], |largest, error| {
        std::array::from_fn(|part| f64::max(largest[part], error[part]))
    })
}

#[track_caller]
fn assert_below(errors: [f64; 3], bounds: [f64; 3]) {
    let within = errors.iter().zip(bounds).all(|(error, bound)| *error < bound);
    assert!(within, "{errors:?} against {bounds:?}");
}

#[test]
fn the_predicted_state_is_the_one_that_comes() {
    let mut rig = Rig::new(World::perfect(), &Kalman::default(), &Model::default())
        .starting(|truth| truth.velocity_world = Vector3::new(0.5, -1.0, 0.3));
    let errors = largest_errors(&mut rig, 2000, 3000, restless_pilot(1));
    assert_below(errors, [1e-6, 1e-4, 1e-5]);
}

#[test]
fn the_prediction_is_for_the_time_at_which_the_next_frame_acts() {
    let mut rig = Rig::new(World::perfect(), &Kalman::default(), &Model::default());
    for _ in 0..100 {
        let now_ns = rig.now_ns();
        let told = rig.step(restless_pilot(1)).told;
        assert!(told.is_none_or(|state| state.state_time_ns == now_ns + 5 * TICK_NS));
    }
}

#[test]
fn without_prediction_the_state_is_that_of_the_last_capture() {
    let kalman = Kalman {
        prediction: false,
        ..Kalman::default()
    };
    let mut rig = Rig::new(World::perfect(), &kalman, &Model::default());
    for _ in 0..100 {
        let tick = rig.tick;
        if let Some(state) = rig.step(restless_pilot(1)).told {
            let exposed = (tick - 5) / CAPTURE_PERIOD * CAPTURE_PERIOD;
            assert_eq!(state.state_time_ns, exposed * TICK_NS);
        }
    }
}

#[test]
fn upside_down_and_tumbling_at_ten_radians_a_second_the_prediction_holds() {
    for attitude in [
        Vector3::new(PI, 0.0, 0.0),
        Vector3::new(0.0, PI, 0.0),
        Vector3::new(0.0, 0.0, PI),
    ] {
        let mut rig = Rig::new(World::perfect(), &Kalman::default(), &Model::default())
            .starting(|truth| truth.world_from_body = exp(&attitude));
        let errors = largest_errors(&mut rig, 1500, 2500, |time, _| Asked {
            thrust: 2.0,
            rates_body: Vector3::new(8.0 * libm::cos(time), 8.0 * libm::sin(time), 6.0),
        });
        assert_below(errors, [2e-6, 2e-4, 2e-5]);
    }
}

#[test]
fn frames_of_every_tick_are_all_used_through_a_drop_out_longer_than_the_history() {
    let world = World {
        frame_period: 1,
        hidden: 2000..2150,
        ..World::perfect()
    };
    let mut rig = Rig::new(world, &Kalman::default(), &Model::default());
    let errors = largest_errors(&mut rig, 2010, 2160, restless_pilot(3));
    assert_below(errors, [1e-5, 1e-4, 1e-5]);
}

#[test]
fn a_stated_capture_latency_replaces_the_stamps() {
    let model = Model {
        capture_latency: Some(0.005),
        ..Model::default()
    };
    let mut stamped = Rig::new(World::laboratory(1), &Kalman::default(), &Model::default());
    let mut timed = Rig::new(World::laboratory(1), &Kalman::default(), &model);
    for _ in 0..300 {
        stamped.step(restless_pilot(1));
        timed.step_with_wrong_stamps(restless_pilot(1));
    }
    assert_eq!(stamped.filter.state(), timed.filter.state());
}

#[test]
fn a_first_capture_long_after_the_first_frames_starts_from_the_thrust_that_acts() {
    let world = World {
        hidden: 0..1000,
        ..World::perfect()
    };
    let mut rig = Rig::new(world, &Kalman::default(), &Model::default());
    let steady = Asked {
        thrust: 1.5,
        rates_body: Vector3::new(0.1, 0.2, 0.3),
    };
    let started = loop {
        if let Some(Outcome::Started) = rig.step(|_, _| steady).outcome {
            break rig.filter.state().unwrap();
        }
    };
    assert_eq!(started.nominal.actuation.thrust, steady.thrust);
    assert_eq!(started.nominal.actuation.rates_body, steady.rates_body);
}
