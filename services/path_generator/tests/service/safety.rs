//! Path on states that are too old or impossible.

use path_generator::PathGeneratorService;
use proptest::prelude::*;
use scenario::{InputSafety, Scenario};
use shared_types::path_stop::Coasted;
use shared_types::sample::Field;
use shared_types::samples::VehicleState;
use zerocopy::{FromBytes, IntoBytes};

use crate::flight::{TICK_NS, paper_path, scenario, step, step_at, vehicle};
use crate::restart;

const MAX_AGE_TICKS: u64 = 30;

fn with_policy(jump: Option<f64>) -> Scenario {
    let mut scenario = scenario(paper_path());
    let safety = InputSafety {
        jump,
        ..InputSafety::new(1e-3 * MAX_AGE_TICKS as f64)
    };
    scenario
        .safety
        .insert("vehicle/state -> path_generator".to_owned(), safety);
    scenario
}

fn generator(scenario: &Scenario) -> PathGeneratorService {
    PathGeneratorService::new(scenario).unwrap()
}

/// The state of a vehicle at the path's start, published at a tick.
fn state(tick: u64) -> VehicleState {
    let mut state = vehicle([0.0, -0.18, -1.18], [0.0; 3]);
    (state.header.seq, state.header.stamp_ns) = (tick, tick * TICK_NS);
    state.state_time_ns = state.header.stamp_ns;
    state
}

fn restarted(service: &PathGeneratorService, scenario: &Scenario) -> PathGeneratorService {
    restart::restarted(service, generator(scenario))
}

#[test]
fn the_path_goes_on_until_the_state_is_older_than_the_stated_age_and_then_stands_still() {
    let scenario = with_policy(None);
    let mut path = generator(&scenario);
    for tick in 0..100 {
        step_at(&mut path, tick, Some(&state(tick)));
    }
    for age in 1..100 {
        path = restarted(&path, &scenario);
        let reference = step_at(&mut path, 99 + age, Some(&state(99)));
        let known = age <= MAX_AGE_TICKS;
        assert_eq!(reference.vehicle_known.is_set(), known, "{age} ms");
        assert_eq!(reference.gamma_dot > 0.0, known, "{age} ms");
    }
    let back = step_at(&mut path, 199, Some(&state(199)));
    assert!(back.vehicle_known.is_set());
    let next = step_at(&mut path, 200, Some(&state(200)));
    assert!(
        next.gamma_dot > 0.0,
        "the path moves on when the vehicle is known again"
    );
}

/// The controller goes on along the path for a time, and then brings it to rest.
#[test]
fn after_a_longer_gap_the_path_goes_on_from_where_the_controller_has_brought_it() {
    let mut scenario = scenario(paper_path());
    let policy = InputSafety::new(0.5);
    scenario
        .safety
        .insert("path/reference -> controller".to_owned(), policy);
    let goes_on_for = scenario.path_continues_for().unwrap();
    assert!((goes_on_for - 0.15).abs() < 2e-3, "{goes_on_for}");
    for gap in [20, 100, 101, 140, 300, 500, 800, 900, 3000] {
        let mut path = generator(&scenario);
        let references = (0..100).map(|tick| step_at(&mut path, tick, Some(&state(tick))));
        let before = references.last().unwrap();
        assert!(before.gamma_dot > 1e-3);
        let after = step(&mut path, 99 + gap, gap, Some(&state(99 + gap)));
        let elapsed = 1e-3 * gap as f64;
        let rates = [before.gamma_dot, before.gamma_ddot];
        let Coasted { way, rates, .. } = Coasted::after(elapsed, rates, goes_on_for);
        // A step is one of explicit Euler as long as steps come.
        let expected = if gap > 100 {
            way
        } else {
            before.gamma_dot * elapsed
        };
        assert!((after.gamma - before.gamma - expected).abs() < 1e-12, "{gap} ms");
        if gap > 150 {
            // The timing law takes γ̇ from there.
            assert!(
                (after.gamma_dot - rates[0]).abs() < 1e-12,
                "{gap} ms: {}",
                after.gamma_dot
            );
        }
        assert_eq!(after.gamma_dot == 0.0, gap > 850, "{gap} ms: {}", after.gamma_dot);
    }
}

#[test]
fn an_impossible_state_is_counted_and_the_path_goes_on_by_the_last_good_one() {
    for scenario in [scenario(paper_path()), with_policy(None)] {
        let mut path = generator(&scenario);
        for tick in 0..10 {
            step_at(&mut path, tick, Some(&state(tick)));
        }
        let mut garbage = state(10);
        garbage.position_world[1] = f64::NAN;
        let reference = step_at(&mut path, 10, Some(&garbage));
        assert_eq!(reference.states_refused, 1);
        assert!(reference.vehicle_known.is_set() && reference.gamma_dot > 0.0);
    }
}

proptest! {
    #[test]
    fn any_input_bits_give_a_finite_reference_and_a_restart_changes_nothing(
        states in proptest::collection::vec(
            (proptest::collection::vec(any::<u8>(), size_of::<VehicleState>()), any::<[bool; 5]>()), 1..30),
    ) {
        for scenario in [scenario(paper_path()), with_policy(None), with_policy(Some(0.1))] {
            let (mut steady, mut other) = (generator(&scenario), generator(&scenario));
            for (tick, (bytes, keep)) in (0..).zip(&states) {
                let good = state(tick);
                let mut sample = VehicleState::read_from_bytes(bytes).unwrap();
                sample.header = good.header;
                if bytes[0].is_multiple_of(2) {
                    // Numbers in the range of a flight, but impossible together.
                    let word = |at: usize| f64::from(bytes[at]) - 128.0;
                    sample.position_world = [word(1), 1e3 * word(2), 1e6 * word(3)];
                    sample.velocity_body = [word(4), 1e3 * word(5), 1e6 * word(6)];
                    sample.world_from_body = [1e6 * word(7); 9];
                    sample.tracked = true.into();
                    (sample.acceleration_world, sample.angular_velocity_body) = ([0.0; 3], [0.0; 3]);
                    (sample.thrust, sample.position_sigma) = (0.0, 0.0);
                }
                for (chunk, kept) in keep.iter().enumerate() {
                    // A fifth of the sample after the other is valid.
                    let range = 24 + chunk * 40..24 + (chunk + 1) * 40;
                    if *kept {
                        sample.as_mut_bytes()[range.clone()].copy_from_slice(&good.as_bytes()[range]);
                    }
                }
                let reference = step_at(&mut steady, tick, Some(&sample));
                prop_assert!(reference.is_finite(), "{:?}", reference);
                other = restarted(&other, &scenario);
                let again = step_at(&mut other, tick, Some(&sample));
                prop_assert_eq!(again.as_bytes(), reference.as_bytes());
            }
        }
    }
}

/// Steps are 22 ms apart: a limit below that is not the time for which the path goes on.
#[test]
fn a_limit_below_the_time_between_steps_does_not_slow_the_path() {
    let slow = |max_age: f64| {
        let mut scenario = scenario(paper_path());
        let periods = ["path_generator", "controller"].map(|service| (service.to_owned(), 0.022));
        scenario.schedule.period.extend(periods);
        let policy = InputSafety::new(max_age);
        scenario
            .safety
            .insert("path/reference -> controller".to_owned(), policy);
        assert!(scenario.schedule().is_ok());
        let mut path = generator(&scenario);
        let steps = (0..100).map(|number| {
            let tick = 22 * number;
            step(&mut path, tick, tick.min(22), Some(&state(tick)))
        });
        steps.last().unwrap().gamma
    };
    assert!(slow(0.5) > 1.0);
    assert_eq!(slow(0.01), slow(0.5));
}
