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
fn a_table_of_a_process_that_does_not_fly_is_refused() {
    let own = Some(ServiceDeployment::default());
    let of_plant = Deployment {
        plant: own,
        ..Deployment::default()
    };
    assert_eq!(deployed(of_plant), []);
    let of_cameras = Deployment {
        motion_capture: own,
        ..Deployment::default()
    };
    assert_only(
        &deployed(of_cameras),
        "deployment.motion_capture",
        "this flight has no process `motion_capture`",
        "name the table `deployment.plant`",
    );
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
    assert_eq!(refused(0.25, -0.001).len(), 1);
    assert_eq!(refused(f64::INFINITY, 0.002).len(), 1);
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
fn a_kill_switch_is_some_device() {
    let with = |spoil: &dyn Fn(&mut OperatorDevices)| {
        let mut devices = OperatorDevices::new("/dev/input/event3");
        spoil(&mut devices);
        Scenario {
            operator: Some(devices),
            ..rig()
        }
    };
    let refused = |spoil: &dyn Fn(&mut OperatorDevices)| with(spoil).problems();
    assert_only(
        &refused(&|devices| devices.kill_device.clear()),
        "operator.kill_device",
        "has no name",
        "gerono operator probe",
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
            "the orchestrator reads the kill switch",
            "on_loss = \"ignore\"",
        );
    }
}
