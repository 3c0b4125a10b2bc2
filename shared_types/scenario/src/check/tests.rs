mod flight;
mod judge;
mod law;
mod link_battery;
mod machine;
mod motors_stop;
mod navigation;
mod programs;
mod radio_link;
mod ranges;
mod record;
mod rig;
mod safety;

use proptest::prelude::*;

use crate::tests_support::fig1;
use crate::{Curve, Hover, Line, Problem, Scenario, Vector, VehicleChange, Waypoints};

/// The problems of the paper's first figure after it has been spoilt.
fn problems(spoil: impl FnOnce(&mut Scenario)) -> Vec<Problem> {
    let mut scenario = fig1();
    spoil(&mut scenario);
    scenario.problems()
}

/// Vectors that give no direction: the square of the second is 0.
const NOWHERE: [Vector; 3] = [[0.0, -0.0, 0.0], [1e-170, 0.0, 0.0], [0.0, 5e-10, -5e-10]];

/// The only problem is at this key, gives this reason and this fix (each in part).
#[track_caller]
fn refused(spoil: impl FnOnce(&mut Scenario), key: &str, reason: &str, fix: &str) {
    assert_only(&problems(spoil), key, reason, fix);
}

/// The only one of some problems is at this key, gives this reason and this fix (each in part).
#[track_caller]
pub(super) fn assert_only(problems: &[Problem], key: &str, reason: &str, fix: &str) {
    let [problem] = problems else {
        panic!("not one problem: {problems:?}")
    };
    assert_eq!(problem.key.to_string(), key);
    assert!(problem.reason.contains(reason), "{}", problem.reason);
    assert!(problem.fix.contains(fix), "{}", problem.fix);
}

#[track_caller]
fn accepted(spoil: impl FnOnce(&mut Scenario)) {
    assert_eq!(problems(spoil), []);
}

fn waypoints(points: &[[f64; 3]], closed: bool) -> Curve {
    Curve::Waypoints(Waypoints {
        points: points.to_vec(),
        closed,
        ..Waypoints::default()
    })
}

fn change(at: f64) -> VehicleChange {
    VehicleChange {
        at,
        mass: Some(0.25),
        inertia: None,
        disturbance: None,
        center_of_mass: None,
    }
}

#[test]
fn the_papers_first_figure_has_no_problem() {
    accepted(|_| ());
}

#[test]
fn saturation_at_or_below_the_theorems_condition_is_refused_with_its_numbers() {
    for level in [0.025, 0.02] {
        refused(
            |scenario| scenario.controller.sigma_max = level,
            "controller.sigma_max",
            &format!("σmax = {level:?} is not above |δ|/k1 = 0.1/4.0 = 0.025"),
            "raise `sigma_max` above 0.025",
        );
    }
    refused(
        |scenario| scenario.controller.delta = -6.0,
        "controller.sigma_max",
        "|δ|/k1 = 6.0/4.0 = 1.5",
        "above 1.5",
    );
    accepted(|scenario| scenario.controller.sigma_max = 0.0251);
}

#[test]
fn epsilon_that_lets_eta_reach_zero_is_refused() {
    for epsilon in [5.0 / 3.0, 2.0] {
        refused(
            |scenario| scenario.controller.bounds.epsilon_eta = epsilon,
            "controller.bounds.epsilon_eta",
            "1/mmax = 1/0.6 = 1.66667",
            "lower `epsilon_eta` below 1.66667",
        );
    }
    accepted(|scenario| scenario.controller.bounds.epsilon_eta = 1.66);
}

#[test]
fn mass_bounds_that_hold_no_mass_are_refused_once() {
    for most in [0.1, 0.05] {
        refused(
            |scenario| scenario.controller.bounds.mass_max = most,
            "controller.bounds.mass_min",
            &format!("mmin = 0.1 kg is not below mmax = {most:?} kg"),
            "lower `mass_min`",
        );
    }
}

#[test]
fn an_inertia_that_no_body_has_is_refused() {
    refused(
        |scenario| scenario.vehicle.inertia[2] = 13.1e-4,
        "vehicle.inertia.2",
        "J3 = 0.00131 kg m² is larger than the other two moments together, 0.0013 kg m²",
        "at most the sum",
    );
    refused(
        |scenario| scenario.vehicle.change[0].inertia = Some([1.0, 2.0, 4.0]),
        "vehicle.change.0.inertia.2",
        "no body is like that",
        "at most the sum",
    );
}

#[test]
fn a_mass_in_grams_is_refused_with_its_kilograms() {
    refused(
        |scenario| scenario.vehicle.mass = 200.0,
        "vehicle.mass",
        "200.0 kg lies outside",
        "masses are in kg: give 0.2 if 200.0 g are meant",
    );
}

#[test]
fn a_mass_outside_of_assumption_1_is_refused() {
    refused(
        |scenario| scenario.vehicle.mass = 0.7,
        "vehicle.mass",
        "0.7 kg lies outside the controller's bounds from 0.1 kg to 0.6 kg",
        "raise `controller.bounds.mass_max` to 0.7 or more",
    );
    refused(
        |scenario| scenario.vehicle.change[0].mass = Some(0.05),
        "vehicle.change.0.mass",
        "new mass of 0.05 kg",
        "lower `controller.bounds.mass_min` to 0.05 or less",
    );
    refused(
        |scenario| scenario.controller.initial.mass = 0.7,
        "controller.initial.mass",
        "the initial estimate of the mass of 0.7 kg",
        "raise `controller.bounds.mass_max` to 0.7 or more",
    );
    accepted(|scenario| scenario.vehicle.mass = 0.6);
}

#[test]
fn a_disturbance_outside_of_assumption_1_is_refused() {
    refused(
        |scenario| scenario.vehicle.disturbance[1] = -3.5,
        "vehicle.disturbance.1",
        "-3.5 m/s² lies outside the controller's bounds of ±3.0 m/s²",
        "raise `controller.bounds.disturbance` to 3.5 or more",
    );
    refused(
        |scenario| scenario.vehicle.change[0].disturbance = Some([0.0, 0.0, 4.0]),
        "vehicle.change.0.disturbance.2",
        "the new disturbance of 4.0 m/s²",
        "to 4.0 or more",
    );
    refused(
        |scenario| scenario.controller.initial.disturbance[0] = 5.0,
        "controller.initial.disturbance.0",
        "the initial estimate of the disturbance of 5.0 m/s²",
        "to 5.0 or more",
    );
}

#[test]
fn changes_out_of_order_are_refused_at_the_later_line() {
    refused(
        |scenario| scenario.vehicle.change.push(change(20.0)),
        "vehicle.change.1.at",
        "the change at 20.0 s is listed after the one at 30.0 s",
        "in the order of their times",
    );
}

#[test]
fn changes_at_one_time_are_refused() {
    refused(
        |scenario| scenario.vehicle.change.push(change(30.0)),
        "vehicle.change.1.at",
        "two changes happen at 30.0 s",
        "merge them into one change",
    );
}

#[test]
fn a_change_after_the_end_is_refused_and_one_at_the_end_is_not() {
    refused(
        |scenario| scenario.duration = 29.0,
        "vehicle.change.0.at",
        "at 30.0 s comes after the end of the flight at 29.0 s",
        "raise `duration`",
    );
    accepted(|scenario| scenario.duration = 30.0);
}

#[test]
fn a_change_of_nothing_is_refused() {
    refused(
        |scenario| {
            scenario.vehicle.change[0] = VehicleChange {
                mass: None,
                ..change(30.0)
            }
        },
        "vehicle.change.0",
        "changes nothing",
        "state a new `mass`",
    );
}

#[test]
fn a_bump_without_width_is_refused() {
    for alpha1 in [1.5, 2.0] {
        refused(
            |scenario| scenario.path.alpha1 = alpha1,
            "path.alpha1",
            &format!("α1 = {alpha1:?} m is not below α2 = 1.5 m"),
            "lower `alpha1`",
        );
    }
}

#[test]
fn a_line_without_direction_is_refused() {
    let line = |direction| {
        Curve::Line(Line {
            start: [1.0, 2.0, 3.0],
            direction,
        })
    };
    for nowhere in NOWHERE {
        refused(
            |scenario| scenario.path.curve = line(nowhere),
            "path.curve.line.direction",
            "no direction",
            "use `hover`",
        );
    }
    accepted(|scenario| scenario.path.curve = line([0.0, 0.0, -0.1]));
}

#[test]
fn too_few_waypoints_are_refused() {
    let points = [[0.0; 3], [1.0, 0.0, 0.0]];
    refused(
        |scenario| scenario.path.curve = waypoints(&points[..1], false),
        "path.curve.waypoints.points",
        "an open curve through 1 points",
        "at least 2",
    );
    refused(
        |scenario| scenario.path.curve = waypoints(&points, true),
        "path.curve.waypoints.points",
        "a closed curve through 2 points",
        "at least 3",
    );
    accepted(|scenario| scenario.path.curve = waypoints(&points, false));
    assert_eq!(
        problems(|scenario| scenario.path.curve = waypoints(&[], false)).len(),
        1
    );
}

#[test]
fn waypoints_that_coincide_are_refused_at_the_second() {
    let points = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 1e-9], [0.0; 3]];
    refused(
        |scenario| scenario.path.curve = waypoints(&points[1..], false),
        "path.curve.waypoints.points.1",
        "points 0 and 1 coincide",
        "leave one of them out",
    );
    let ring = [points[0], points[1], [1.0, 1.0, 0.0], points[3]];
    accepted(|scenario| scenario.path.curve = waypoints(&ring, false));
    refused(
        |scenario| scenario.path.curve = waypoints(&ring, true),
        "path.curve.waypoints.points.3",
        "coincides with the first",
        "leave the last point out",
    );
}

#[test]
fn all_problems_are_reported_at_once() {
    let problems = problems(|scenario| {
        scenario.vehicle.mass = -1.0;
        scenario.path.k4 = 0.0;
        scenario.controller.delta = 0.0;
        scenario.duration = 60.0005;
    });
    let keys: Vec<String> = problems.iter().map(|problem| problem.key.to_string()).collect();
    assert_eq!(keys, ["vehicle.mass", "path.k4", "controller.delta", "duration"]);
}

proptest! {
    /// A flat body's moments fulfil J1 + J2 = J3 exactly, however its decimals are rounded.
    #[test]
    fn the_inertia_of_a_flat_body_is_accepted(j1 in 1e-6..1e2f64, j2 in 1e-6..1e2f64, axis in 0..3usize) {
        let mut inertia = [j1, j2, j1 + j2];
        inertia.rotate_right(axis);
        prop_assert_eq!(problems(|scenario| scenario.vehicle.inertia = inertia), []);
    }

    /// Wherever the saturation is accepted, the theorem's bound is a number.
    #[test]
    fn an_accepted_saturation_has_an_ultimate_bound(
        k1 in 0.01..20.0f64,
        delta in -1.0..1.0f64,
        sigma_max in 0.001..5.0f64,
    ) {
        let mut scenario = fig1();
        scenario.controller.k1 = k1;
        scenario.controller.delta = delta;
        scenario.controller.sigma_max = sigma_max;
        prop_assert_eq!(scenario.problems().is_empty(), scenario.controller.ultimate_bound().is_finite() && delta != 0.0);
    }
}
