//! Limits of loss, and whom the theorem speaks of.

use super::{accepted, fig1, refused};
use crate::{Flight, Judge, Programs, Scenario};

fn judged(change: impl FnOnce(&mut Judge)) -> impl FnOnce(&mut Scenario) {
    move |scenario| {
        let mut judge = Judge::default();
        change(&mut judge);
        scenario.judge = Some(judge);
    }
}

#[test]
fn limits_that_can_be_exceeded_and_kept_are_accepted() {
    accepted(judged(|_| {}));
    accepted(|scenario| {
        scenario.flight = Some(Flight::default());
        scenario.vehicle.initial.velocity_body = [0.0; 3];
        judged(|judge| judge.impact_speed_max = Some(2.0))(scenario);
    });
}

#[test]
fn only_a_flight_with_phases_touches_the_ground() {
    refused(
        judged(|judge| judge.impact_speed_max = Some(1.0)),
        "judge.impact_speed_max",
        "no ground",
        "add `[flight]`",
    );
}

#[test]
fn the_theorem_speaks_of_the_adaptive_law_alone() {
    let bound = |change: fn(&mut Scenario)| {
        let mut scenario = fig1();
        change(&mut scenario);
        scenario.theorem_bound()
    };
    let stated = fig1().controller.ultimate_bound();
    assert_eq!(bound(|_| {}), Some(stated));
    assert_eq!(
        bound(|scenario| scenario.controller.lambda_inertia = Some(0.0)),
        Some(stated)
    );
    assert_eq!(bound(|scenario| scenario.controller.lambda_mass = 0.0), None);
    assert_eq!(
        bound(|scenario| scenario.controller.lambda_disturbance[1] = 0.0),
        None
    );
    assert_eq!(bound(|scenario| scenario.controller.remove_offset = true), None);
    let of_another = |scenario: &mut Scenario| {
        scenario.programs = Some(Programs {
            controller: Some(vec!["mine".to_owned()]),
            ..Programs::default()
        });
    };
    assert_eq!(bound(of_another), None);
}
