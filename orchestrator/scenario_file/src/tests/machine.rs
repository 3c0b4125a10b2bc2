//! The sections that say how the machine is used.

use scenario::OrchestratorLoss;
use shared_types::ServiceId;

use super::*;

const MACHINE: &str = r#"
[deployment]
core = 1
lock_memory = true
timer_slack = 1e-6

[deployment.rc_output]
priority = 30

[real_time]
hang_limit = 0.1
orchestrator_loss = "continue"
"#;

#[test]
fn what_is_said_for_all_and_for_one_is_read() {
    let scenario = load_text(&(fig1() + MACHINE), &[]).unwrap();
    let [plant, rc_output] =
        [ServiceId::Plant, ServiceId::RcOutput].map(|service| scenario.deployment_of(service));
    assert_eq!(
        (plant.core, plant.priority, plant.timer_slack),
        (Some(1), None, Some(1e-6))
    );
    assert_eq!((rc_output.core, rc_output.priority), (Some(1), Some(30)));
    assert!(!scenario.deployment.unwrap().strict);
    let real_time = scenario.real_time.unwrap();
    assert_eq!((real_time.hang_limit, real_time.grace), (Some(0.1), 0.002));
    assert_eq!(real_time.orchestrator_loss, OrchestratorLoss::Continue);
}

#[test]
fn an_argument_deploys_a_service() {
    let sets = ["deployment.controller.priority=40", "deployment.strict=true"];
    let scenario = load_text(&fig1(), &sets).unwrap();
    assert_eq!(scenario.deployment_of(ServiceId::Controller).priority, Some(40));
    assert!(scenario.deployment.unwrap().strict);
}

#[test]
fn a_misspelt_service_or_key_is_refused_with_the_nearest() {
    for (part, replacement, key, nearest) in [
        (
            "[deployment.rc_output]",
            "[deployment.rc_ouput]",
            "deployment.rc_ouput",
            "rc_output",
        ),
        (
            "priority = 30",
            "prioritty = 30",
            "deployment.rc_output.prioritty",
            "priority",
        ),
        (
            "hang_limit = 0.1",
            "hang_limits = 0.1",
            "real_time.hang_limits",
            "hang_limit",
        ),
    ] {
        let shown = refusal(&with(&(fig1() + MACHINE), part, replacement), &[]);
        for piece in [
            format!("`{key}` is unknown"),
            format!("did you mean `{nearest}`?"),
        ] {
            assert!(shown.contains(&piece), "no `{piece}` in:\n{shown}");
        }
    }
}

#[test]
fn what_no_machine_could_do_is_refused_at_its_line() {
    for (part, replacement, pieces) in [
        (
            "core = 1",
            "core = 4096",
            ["core = 4096 is above 1023", "cores count from 0"],
        ),
        (
            "priority = 30",
            "priority = -1",
            ["a whole number of 0 or more is expected here", "help: "],
        ),
        (
            "hang_limit = 0.1",
            "hang_limit = 0.001",
            [
                "a healthy one would be replaced after 0.001 s",
                "help: give a time above 0.002 s",
            ],
        ),
        (
            "orchestrator_loss = \"continue\"",
            "orchestrator_loss = \"hover\"",
            ["`hover` is not known here", "help: known are: `land`, `continue`"],
        ),
    ] {
        let text = with(&(fig1() + MACHINE), part, replacement);
        refused_on_line(&text, line_of(&text, replacement), &pieces);
    }
}
