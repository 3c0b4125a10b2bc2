//! Sections that say how the machine is used.

use shared_types::ServiceId;

use super::assert_only;
use crate::tests_support::{fig1, rig};
use crate::{
    Deployment, KillSwitchLoss, OperatorDevices, OrchestratorLoss, Problem, RealTime, Scenario,
    ServiceDeployment,
};

fn deployed(deployment: Deployment) -> Vec<Problem> {
    Scenario {
        deployment: Some(deployment),
        ..fig1()
    }
    .problems()
}

fn in_real_time(scenario: Scenario, real_time: RealTime) -> Vec<Problem> {
    Scenario {
        real_time: Some(real_time),
        ..scenario
    }
    .problems()
}

#[test]
fn values_for_some_machine_are_accepted() {
    for (priority, timer_slack) in [(1, 1e-9), (99, 1.0)] {
        let own = ServiceDeployment {
            core: Some(1023),
            priority: Some(priority),
            lock_memory: Some(true),
            timer_slack: Some(timer_slack),
        };
        let deployment = Deployment {
            strict: true,
            core: Some(0),
            rc_output: Some(own),
            ..Deployment::default()
        };
        assert_eq!(deployed(deployment), []);
    }
    assert_eq!(in_real_time(fig1(), RealTime::default()), []);
    assert_eq!(in_real_time(rig(), RealTime::default()), []);
}

#[test]
fn values_for_no_machine_are_refused() {
    let common = Deployment {
        core: Some(1024),
        ..Deployment::default()
    };
    let of_cameras = Deployment {
        motion_capture: Some(common.common()),
        ..Deployment::default()
    };
    assert_eq!(deployed(of_cameras).len(), 2, "no process, no core");
    assert_only(
        &deployed(common),
        "deployment.core",
        "no system has a core 1024",
        "cores count from 0",
    );
    for priority in [0, 100] {
        let deployment = Deployment {
            controller: Some(ServiceDeployment {
                priority: Some(priority),
                ..ServiceDeployment::default()
            }),
            ..Deployment::default()
        };
        assert_only(
            &deployed(deployment),
            "deployment.controller.priority",
            "is no priority of SCHED_FIFO",
            "from 1 to 99",
        );
    }
    for timer_slack in [0.0, -1.0, 1.5, f64::NAN] {
        let deployment = Deployment {
            timer_slack: Some(timer_slack),
            ..Deployment::default()
        };
        assert_only(
            &deployed(deployment),
            "deployment.timer_slack",
            "is not a slack",
            "give 1e-6",
        );
    }
}

#[test]
fn a_healthy_service_does_not_hang() {
    let refused = |hang_limit, grace| {
        let real_time = RealTime {
            hang_limit: Some(hang_limit),
            grace,
            ..RealTime::default()
        };
        in_real_time(rig(), real_time)
    };
    assert_eq!(refused(0.012, 0.002), []);
    assert_only(
        &refused(0.011, 0.002),
        "real_time.hang_limit",
        "waits up to 0.011 s for its inputs",
        "give a time above 0.011 s",
    );
    assert_only(
        &refused(0.05, 0.1),
        "real_time.hang_limit",
        "waits up to 0.1 s for its inputs",
        "give a time above 0.1 s",
    );
    assert_only(
        &refused(0.25, -0.001),
        "real_time.grace",
        "grace = -0.001 is below 0",
        "give 0 or a number above it",
    );
    assert_only(
        &refused(f64::INFINITY, 0.002),
        "real_time.hang_limit",
        "inf is not a finite number",
        "give a finite number",
    );
}

#[test]
fn a_hang_limit_that_is_not_stated_suits_every_schedule() {
    let mut slow = rig();
    for (period, limit) in [(0.01, 0.1), (0.15, 0.15), (0.5, 0.5)] {
        slow.schedule.period.insert("rc_output".to_owned(), period);
        let schedule = slow.schedule().unwrap();
        let of = |service| RealTime::default().hang_limit(&schedule, service);
        assert_eq!((of(ServiceId::RcOutput), of(ServiceId::Controller)), (limit, 0.1));
        assert_eq!(in_real_time(slow.clone(), RealTime::default()), []);
    }
}

#[test]
fn a_kill_switch_is_some_device_and_some_key() {
    let with = |spoil: &dyn Fn(&mut OperatorDevices)| {
        let mut devices = OperatorDevices::new("/dev/input/event3");
        spoil(&mut devices);
        Scenario {
            operator: Some(devices),
            ..rig()
        }
    };
    let refused = |spoil: &dyn Fn(&mut OperatorDevices)| with(spoil).problems();
    assert_eq!(refused(&|devices| devices.kill_key = Some(0x2ff)), []);
    assert_only(
        &refused(&|devices| devices.kill_device.clear()),
        "operator.kill_device",
        "has no name",
        "gerono operator probe",
    );
    assert_only(
        &refused(&|devices| devices.kill_key = Some(0x300)),
        "operator.kill_key",
        "no key has the code 768",
        "leave it out for any key",
    );
    assert_only(
        &refused(&|devices| devices.kill_baud = 0),
        "operator.kill_baud",
        "0 baud is no speed",
        "such as 9600",
    );
}

#[test]
fn a_flight_that_needs_its_kill_switch_does_not_go_on_without_the_orchestrator_that_hears_it() {
    let with = |on_loss| {
        let scenario = Scenario {
            operator: Some(OperatorDevices {
                on_loss,
                ..OperatorDevices::new("/dev/input/event3")
            }),
            ..rig()
        };
        let real_time = RealTime {
            orchestrator_loss: OrchestratorLoss::Continue,
            ..RealTime::default()
        };
        in_real_time(scenario, real_time)
    };
    assert_eq!(with(KillSwitchLoss::Ignore), []);
    for on_loss in [KillSwitchLoss::Land, KillSwitchLoss::Kill] {
        assert_only(
            &with(on_loss),
            "operator.on_loss",
            "the orchestrator hears the kill switch",
            "on_loss = \"ignore\"",
        );
    }
}
