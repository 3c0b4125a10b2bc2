//! The choice of a law, and its extensions.

use super::*;
use crate::{ControllerChange, Harmonics, LawKind, Lissajous};

fn harmonics(scenario: &mut Scenario) -> &mut Harmonics {
    scenario.controller.harmonics.get_or_insert_default()
}

#[test]
fn harmonics_need_a_path_that_repeats_and_the_adaptive_law() {
    accepted(|scenario| *harmonics(scenario) = Harmonics::default());
    refused(
        |scenario| {
            harmonics(scenario);
            scenario.path.curve = Curve::Hover(Hover { position: [0.0; 3] });
        },
        "controller.harmonics",
        "the path is not periodic",
        "leave them out",
    );
    let problems = problems(|scenario| {
        harmonics(scenario);
        scenario.controller.law = LawKind::Indi;
    });
    let of_harmonics = problems
        .iter()
        .find(|problem| problem.key.to_string() == "controller.harmonics");
    assert_eq!(of_harmonics.unwrap().reason, "a baseline has no harmonics");
}

#[test]
fn the_observer_needs_commands_of_body_rates() {
    refused(
        |scenario| scenario.controller.disturbance_observer = true,
        "controller.disturbance_observer",
        "only the adaptive law with commands of body rates",
        "leave it out",
    );
}

#[test]
fn a_figure_repeats_with_the_lowest_of_its_frequencies_if_the_others_are_multiples() {
    let figure = |frequency| {
        Curve::Lissajous(Lissajous {
            center: [0.0; 3],
            amplitude: [1.0; 3],
            frequency,
            phase: [0.0; 3],
        })
        .frequency()
    };
    assert_eq!(figure([0.6, -1.2, 0.0]), Some(0.6));
    assert_eq!(figure([0.6, 0.9, 0.0]), None);
    assert_eq!(figure([0.0; 3]), None);
    let course = waypoints(
        &[[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
        true,
    );
    assert_eq!(course.frequency(), Some(std::f64::consts::FRAC_PI_2));
}

#[test]
fn gains_that_change_in_flight_are_those_of_the_adaptive_law_and_fit_it() {
    let change = |k1| {
        vec![ControllerChange {
            at: 0.5,
            k1: Some(k1),
            ..ControllerChange::default()
        }]
    };
    accepted(|scenario| scenario.controller.change = change(3.0));
    refused(
        |scenario| scenario.controller.change = change(1e-3),
        "controller.change.0.k1",
        "the theorem bounds no position error",
        "raise `sigma_max`",
    );
    refused(
        |scenario| {
            scenario.controller.change = change(3.0);
            scenario.controller.change[0].at = 1e4;
        },
        "controller.change.0.at",
        "comes after the end of the flight",
        "raise `duration`",
    );
    let problems = problems(|scenario| {
        scenario.controller.change = change(3.0);
        scenario.controller.law = LawKind::Indi;
    });
    let of_change = problems
        .iter()
        .find(|problem| problem.key.to_string() == "controller.change");
    assert!(of_change.is_some(), "{problems:?}");
}
