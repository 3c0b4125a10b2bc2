use proptest::prelude::*;
use zerocopy::{FromBytes, FromZeros, IntoBytes};

use super::*;
use crate::samples::VehicleState;
use crate::service::InputView;

const PERIOD_NS: u64 = 10_000_000;

fn now(number: u64) -> Now {
    Now {
        tick: number * 10,
        time_ns: number * PERIOD_NS,
        elapsed_ns: PERIOD_NS,
        operator: crate::service::Operator::FLYING,
    }
}

fn validator(jump: Option<f64>) -> StateValidator {
    StateValidator::new(Some(Policy {
        max_age_ns: 30_000_000,
        jump,
    }))
}

/// Returns the state of a vehicle that flies along x at 1 m/s from `start`.
fn state(number: u64, start: f64) -> VehicleState {
    let mut state = VehicleState::new_zeroed();
    state.header.seq = number;
    state.header.stamp_ns = now(number).time_ns;
    state.state_time_ns = state.header.stamp_ns;
    state.position_world = [start + 0.01 * number as f64, 0.0, -1.0];
    state.velocity_body = [1.0, 0.0, 0.0];
    state.world_from_body = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    state.tracked = true.into();
    state
}

fn look(validator: &mut StateValidator, number: u64, state: &VehicleState) -> bool {
    let input = Input::from_view(InputView {
        bytes: Some(state.as_bytes()),
        fresh: true,
    });
    validator.look(&now(number), &input)
}

fn held(validator: &StateValidator) -> VehicleState {
    validator.save().held
}

#[test]
fn an_impossible_number_is_refused_with_and_without_a_policy_and_the_last_good_sample_stays() {
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 2e9] {
        for mut validator in [StateValidator::new(None), validator(None)] {
            assert!(look(&mut validator, 1, &state(1, 0.0)));
            let mut garbage = state(2, 0.0);
            garbage.acceleration_world[1] = value;
            assert!(!look(&mut validator, 2, &garbage));
            assert_eq!((validator.refused(), held(&validator)), (1, state(1, 0.0)));
            assert!(look(&mut validator, 3, &state(3, 0.0)));
        }
    }
}

#[test]
fn without_a_policy_every_finite_state_is_good() {
    let mut validator = StateValidator::new(None);
    let mut odd = state(1, 5e8);
    odd.tracked = false.into();
    odd.world_from_body = [7.0; 9];
    assert!(look(&mut validator, 1, &odd) && look(&mut validator, 1, &odd));
    assert!(!validator.is_too_old(&now(1_000_000)));
}

#[test]
fn with_a_policy_impossible_states_are_refused_and_counted() {
    let spoil: [fn(&mut VehicleState); 6] = [
        |state| state.position_world[2] = 1.1e4,
        |state| state.velocity_body[0] = -1.1e3,
        |state| state.angular_velocity_body[1] = 1.1e3,
        |state| state.world_from_body[4] = 1.1,
        |state| state.world_from_body[8] = -1.0,
        |state| state.header.stamp_ns += 10 * PERIOD_NS,
    ];
    for (number, spoil) in (2..).zip(spoil) {
        let mut validator = validator(None);
        assert!(look(&mut validator, 1, &state(1, 0.0)));
        let mut spoilt = state(2, 0.0);
        spoil(&mut spoilt);
        assert!(!look(&mut validator, 2, &spoilt), "{number}");
        assert_eq!(validator.refused(), 1, "{number}");
    }
}

#[test]
fn an_untracked_or_repeated_state_is_not_counted_and_does_not_reset_the_age() {
    let mut validator = validator(None);
    assert!(look(&mut validator, 1, &state(1, 0.0)));
    let untracked = VehicleState {
        tracked: false.into(),
        ..state(2, 0.0)
    };
    let repeated = VehicleState {
        state_time_ns: state(1, 0.0).state_time_ns,
        ..state(3, 0.0)
    };
    assert!(!look(&mut validator, 2, &untracked) && !look(&mut validator, 3, &repeated));
    assert_eq!(
        (validator.refused(), validator.age_ns(&now(3))),
        (0, Some(2 * PERIOD_NS))
    );
    assert!(!validator.is_too_old(&now(4)) && validator.is_too_old(&now(5)));
}

/// Returns the state of a vehicle that turns at a rate, and is turned by an angle besides.
fn turning(number: u64, rates: [f64; 3], turn: nalgebra::Vector3<f64>) -> VehicleState {
    let mut state = state(number, 0.0);
    let rates_body = nalgebra::Vector3::from(rates);
    let seconds = 1e-9 * state.header.stamp_ns as f64;
    let attitude = crate::rotation::exp(&(rates_body * seconds)) * crate::rotation::exp(&turn);
    state.angular_velocity_body = rates;
    state.world_from_body = crate::rotation::to_row_major(&attitude);
    let velocity = attitude.tr_mul(&nalgebra::Vector3::x());
    state.velocity_body = velocity.into();
    state
}

proptest! {
    #[test]
    fn an_attitude_that_turns_faster_than_a_vehicle_is_refused_as_a_position_is(
        axis in prop::array::uniform3(-1.0..1.0f64),
        degrees in 30.0..180.0f64,
        rates in prop::array::uniform3(-10.0..10.0f64),
        missing in 0..2u64,
    ) {
        let axis = nalgebra::Vector3::from(axis);
        prop_assume!(axis.norm() > 0.1);
        // In the time of missing states a vehicle may depart further.
        let degrees = degrees + 6.0 * missing as f64;
        let turn = axis.normalize() * degrees.to_radians().min(std::f64::consts::PI);
        let none = nalgebra::Vector3::zeros();
        let mut with_jump = validator(Some(0.05));
        prop_assert!(look(&mut with_jump, 1, &turning(1, rates, none)));
        prop_assert!(look(&mut with_jump, 2, &turning(2, rates, none)), "a fast turn goes on");
        prop_assert!(!look(&mut with_jump, 3 + missing, &turning(3 + missing, rates, turn)));
        prop_assert!(look(&mut with_jump, 4 + missing, &turning(4 + missing, rates, none)));
        prop_assert_eq!(with_jump.refused(), 1);
        let mut without = validator(None);
        prop_assert!(look(&mut without, 1, &turning(1, rates, none)));
        prop_assert!(look(&mut without, 2, &turning(2, rates, turn)));
    }
}

#[test]
fn a_lasting_turn_is_accepted_when_the_last_good_state_is_too_old() {
    let mut validator = validator(Some(0.05));
    let turn = nalgebra::Vector3::new(0.0, 0.0, 2.0);
    assert!(look(
        &mut validator,
        1,
        &turning(1, [0.0; 3], nalgebra::Vector3::zeros())
    ));
    for number in 2..=4 {
        assert!(!look(&mut validator, number, &turning(number, [0.0; 3], turn)));
    }
    assert!(look(&mut validator, 5, &turning(5, [0.0; 3], turn)));
    assert_eq!(validator.refused(), 3);
}

#[test]
fn a_state_that_jumps_is_refused_and_one_that_goes_on_is_not() {
    let mut validator = validator(Some(0.05));
    assert!(look(&mut validator, 1, &state(1, 0.0)));
    assert!(!look(&mut validator, 2, &state(2, 0.06)));
    assert!(look(&mut validator, 3, &state(3, 0.0)));
    assert!(look(&mut validator, 4, &state(4, 0.04)));
}

#[test]
fn a_lasting_jump_is_accepted_once_the_last_good_state_is_too_old() {
    let mut validator = validator(Some(0.05));
    assert!(look(&mut validator, 1, &state(1, 0.0)));
    let believed: Vec<bool> = (2..8)
        .map(|number| look(&mut validator, number, &state(number, 1.0)))
        .collect();
    assert_eq!(believed, [false, false, false, true, true, true]);
    assert_eq!(validator.refused(), 3);
}

#[test]
fn jumps_that_do_not_agree_with_each_other_are_never_accepted() {
    let mut validator = validator(Some(0.05));
    assert!(look(&mut validator, 1, &state(1, 0.0)));
    for number in 2..50 {
        let to = if number % 2 == 0 { 1.0 } else { -1.0 };
        assert!(!look(&mut validator, number, &state(number, to)), "{number}");
    }
    assert!(
        look(&mut validator, 50, &state(50, 0.0)),
        "the true one is accepted"
    );
}

proptest! {
    /// However it was treated, a validator accepts a true state after some time.
    #[test]
    fn no_validator_refuses_for_ever(
        garbage in proptest::collection::vec(proptest::collection::vec(any::<u8>(), size_of::<VehicleState>()), 0..30),
        jump in proptest::option::of(0.01..1.0f64),
    ) {
        let mut validator = validator(jump);
        let mut number = 0;
        for bytes in &garbage {
            number += 1;
            let mut sample = VehicleState::read_from_bytes(bytes).unwrap();
            sample.header = state(number, 0.0).header;
            look(&mut validator, number, &sample);
        }
        let opened = (number + 1..number + 10).any(|number| look(&mut validator, number, &state(number, 0.0)));
        prop_assert!(opened);
    }

    #[test]
    fn a_restored_validator_goes_on_as_before(starts in proptest::collection::vec(-0.1..0.1f64, 1..20), at in 0..20usize) {
        let (mut steady, mut restarted) = (validator(Some(0.05)), validator(Some(0.05)));
        for (index, (number, &start)) in (1..).zip(&starts).enumerate() {
            let sample = state(number, start);
            prop_assert_eq!(look(&mut steady, number, &sample), look(&mut restarted, number, &sample));
            if index == at {
                let saved = restarted.save();
                restarted = validator(Some(0.05));
                restarted.restore(&saved);
                prop_assert_eq!(restarted.save(), saved);
            }
            prop_assert_eq!(steady.save(), restarted.save());
        }
    }
}
