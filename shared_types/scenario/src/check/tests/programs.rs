//! External services in place of services.

use super::assert_only;
use crate::tests_support::fig1;
use crate::{Fault, FaultKind, FaultState, Problem, Programs, Scenario};

fn flown_by(words: &[&str]) -> Scenario {
    Scenario {
        programs: Some(Programs {
            controller: Some(words.iter().map(ToString::to_string).collect()),
            ..Programs::default()
        }),
        ..fig1()
    }
}

fn problems(words: &[&str]) -> Vec<Problem> {
    flown_by(words).problems()
}

#[test]
fn a_command_that_can_be_started_is_accepted() {
    assert_eq!(problems(&["python3", "controller.py", ""]), []);
    assert_eq!(problems(&["./controller"]), []);
}

#[test]
fn a_command_without_a_program_is_refused() {
    for words in [&[][..], &[""], &["  ", "controller.py"]] {
        assert_only(
            &problems(words),
            "programs.controller",
            "it names no program",
            "give the program and its arguments",
        );
    }
    assert_only(
        &problems(&["python3", "a\0b"]),
        "programs.controller.1",
        "an argument with a zero byte",
        "leave the `\\u0000` out",
    );
}

#[test]
fn a_program_flies_where_no_faults_are_planned() {
    let fault = Fault {
        at: 1.0,
        service: Some("estimator".to_owned()),
        edge: None,
        kind: FaultKind::Off,
        lasts: Some(0.1),
        state: FaultState::Warm,
        by: None,
        fraction: None,
        field: None,
        scale: None,
        bias: None,
        range: None,
    };
    let scenario = Scenario {
        fault: vec![fault],
        ..flown_by(&["./controller"])
    };
    assert_only(
        &scenario.problems(),
        "programs.controller",
        "a program in place of `controller` does not receive",
        "leave the faults out",
    );
}
