//! Histories of faults, and what must hold in them.

use std::sync::atomic::AtomicBool;

use fault_simulator::campaign;
use fault_simulator::flights::Flights;
use fault_simulator::{FOR_EVER, Fault, FaultKind, History, Host, Setting, Target, course_of};

/// All properties hold in the histories of these seeds: about 80 000 faults.
#[test]
fn no_property_is_violated_by_the_faults_of_some_seeds() {
    let results = campaign::fly(1..20_001, 2, &AtomicBool::new(false), &|_, _| {});
    assert!(
        results.histories == 20_000 && results.faults > 75_000,
        "{results:?}"
    );
    if let Some((history, violation)) = results.first.values().next() {
        panic!("{violation}\n{history}{}", history.as_rust());
    }
}

/// **The contract of determinism**: the same history leads to the same actions at the same times, to the nanosecond.
#[test]
fn the_same_seed_leads_to_the_same_actions() {
    let mut flights = Flights::default();
    let mut actions = |seed| course_of(&History::of_seed(seed), &mut flights, false).actions;
    let first: Vec<_> = (1..200).map(&mut actions).collect();
    let again: Vec<_> = (1..200).map(actions).collect();
    assert_eq!(first, again);
    let mut different = first.clone();
    different.sort_unstable();
    different.dedup();
    assert!(different.len() > 190, "{}", different.len());
}

const LONG: Setting = Setting {
    host: Host::RealTime,
    length_ms: 600_000,
    has_phases: true,
    is_slow: false,
    external: None,
    restarts: 8,
    loop_delay_ns: 50_000,
};

/// Flies histories that once violated a property.
fn assert_holds(histories: impl IntoIterator<Item = History>) {
    for history in histories {
        let course = course_of(&history, &mut Flights::default(), true);
        let violation = course.violation.map(|violation| violation.to_string());
        assert_eq!(violation, None, "{history}{}", course.trace.join("\n"));
        assert!(course.effective.contains(&true), "{history}");
    }
}

/// A service that has reported a failure was retried before its process had ended, and the end was not recorded; and one
/// that did not end was recorded at every turn of the loop while the run stopped.
#[test]
fn the_end_of_a_service_that_gave_up_is_recorded_once() {
    let of_controller = Target::Service(3);
    let gave_up = vec![
        fault(28_702_553, FaultKind::Arms, Target::Machine, 0),
        fault(787_167_656, FaultKind::Fails, Target::Service(4), 0),
    ];
    let does_not_end = vec![
        fault(500_000_000, FaultKind::KillsTakeLong, Target::Machine, FOR_EVER),
        fault(500_000_001, FaultKind::Stopped, of_controller, FOR_EVER),
        fault(500_000_002, FaultKind::Stopped, Target::Service(4), FOR_EVER),
        fault(550_000_000, FaultKind::RequestsEnd, Target::Machine, 0),
    ];
    assert_holds([gave_up, does_not_end].map(|faults| History {
        seed: 730,
        setting: LONG,
        faults,
    }));
}

/// A program that had just died was told to connect to a service that had restarted.
#[test]
fn a_program_that_has_ended_is_told_nothing() {
    let setting = Setting {
        host: Host::LockStep,
        external: Some(1),
        ..LONG
    };
    // At some of these times its death is handled in the turn of the loop in which the service is announced.
    assert_holds((0..400).map(|time| History {
        seed: 89_229,
        setting,
        faults: vec![
            Fault {
                at_ns: 400_000_000,
                kind: FaultKind::Death,
                target: Target::Service(3),
                for_ns: 0,
            },
            Fault {
                at_ns: 400_000_000 + 20_000 * time,
                kind: FaultKind::Panic,
                target: Target::Service(1),
                for_ns: 0,
            },
        ],
    }));
}

/// After nine failed starts in a row, within 0.4 s, a run had no standby process any more.
#[test]
fn there_is_a_standby_process_again_after_the_system_had_no_room_for_one() {
    assert_holds([Host::RealTime, Host::LockStep].map(|host| History {
        seed: 25_387,
        setting: Setting { host, ..LONG },
        faults: vec![Fault {
            at_ns: 20_000_000,
            kind: FaultKind::NoForks,
            target: Target::Machine,
            for_ns: 1_000_000_000,
        }],
    }));
}

fn fault(at_ns: u64, kind: FaultKind, target: Target, for_ns: u64) -> Fault {
    Fault {
        at_ns,
        kind,
        target,
        for_ns,
    }
}

/// A service whose process does not end when it is killed cannot be restarted: the vehicle flew on without it, and a run in
/// lock step waited without a limit.
#[test]
fn a_flight_fails_if_a_killed_process_does_not_end() {
    let hosts = [
        (Host::RealTime, FaultKind::Stopped),
        (Host::LockStep, FaultKind::ClosesChannel),
    ];
    assert_holds(hosts.map(|(host, kind)| History {
        seed: 17_397,
        setting: Setting { host, ..LONG },
        faults: vec![
            fault(568_390_122, FaultKind::KillsTakeLong, Target::Machine, FOR_EVER),
            fault(585_039_897, kind, Target::Service(1), FOR_EVER),
        ],
    }));
}

/// In lock step such a service was not restarted after its death, and the run waited for it without a limit.
#[test]
fn a_service_that_says_too_early_that_it_has_finished_is_replaced_in_lock_step() {
    assert_holds([History {
        seed: 25_491,
        setting: Setting {
            host: Host::LockStep,
            ..LONG
        },
        faults: vec![
            fault(539_583_742, FaultKind::SaysFinished, Target::Service(3), 0),
            fault(539_676_452, FaultKind::Death, Target::Service(3), 0),
        ],
    }]);
}

/// If it had ended before it was replaced, its restarts were not counted.
#[test]
fn the_restarts_of_a_service_that_finishes_too_early_and_ends_are_bounded() {
    assert_holds([History {
        seed: 317_599,
        setting: Setting {
            has_phases: false,
            is_slow: true,
            restarts: 0,
            loop_delay_ns: 8_000_000,
            ..LONG
        },
        faults: vec![
            fault(
                500_000_000,
                FaultKind::SupervisorStalls,
                Target::Machine,
                50_000_000,
            ),
            fault(510_000_000, FaultKind::SaysFinished, Target::Service(4), 0),
            fault(520_000_000, FaultKind::Death, Target::Service(4), 0),
        ],
    }]);
}

/// A process that the machine had kept from starting for 0.3 s was killed once the machine went on, because the supervisor,
/// which did not look meanwhile either, took that time for the process's own.
#[test]
fn a_start_that_the_machine_delays_is_not_too_late() {
    let panics = |at_ns, service| fault(at_ns, FaultKind::Panic, Target::Service(service), 0);
    let delayed = vec![
        panics(237_523_583, 0),
        fault(
            237_758_016,
            FaultKind::MachineStalls,
            Target::Machine,
            300_000_000,
        ),
        fault(349_405_261, FaultKind::Starves, Target::Service(0), 400_000_000),
    ];
    assert_holds([History {
        seed: 186_303,
        setting: Setting {
            loop_delay_ns: 8_000_000,
            ..LONG
        },
        faults: delayed,
    }]);
    // Here the system took long to start others before it.
    let started_late = vec![
        fault(0, FaultKind::SlowForks, Target::Machine, 514_000_000),
        fault(401_373_254, FaultKind::Spins, Target::Service(0), 0),
        fault(410_418_944, FaultKind::Panic, Target::Standby, 0),
        fault(413_547_968, FaultKind::Death, Target::Service(3), 0),
        panics(413_947_402, 2),
        fault(418_965_339, FaultKind::Death, Target::Service(4), 0),
        fault(
            589_194_644,
            FaultKind::MachineStalls,
            Target::Machine,
            800_000_000,
        ),
    ];
    assert_holds([History {
        seed: 985_543,
        setting: Setting {
            has_phases: false,
            is_slow: true,
            loop_delay_ns: 8_000_000,
            ..LONG
        },
        faults: started_late,
    }]);
}

/// With a vehicle in the air, which takes long to land: a service that gave up was tried again, died, and was started at
/// once, although it had done no step for three processes.
#[test]
fn a_service_that_gave_up_is_not_restarted_at_once_when_it_dies_again() {
    let of_path_generator = Target::Service(2);
    assert_holds([History {
        seed: 210_380,
        setting: Setting { restarts: 1, ..LONG },
        faults: vec![
            fault(124_522_425, FaultKind::Spins, of_path_generator, FOR_EVER),
            fault(243_906_498, FaultKind::Fails, of_path_generator, 0),
            fault(345_219_472, FaultKind::Death, of_path_generator, 0),
        ],
    }]);
    // The end of the process that gave up did not count.
    let of_estimator = Target::Service(1);
    assert_holds([History {
        seed: 52_391_340,
        setting: Setting {
            restarts: 1,
            loop_delay_ns: 8_000_000,
            ..LONG
        },
        faults: vec![
            fault(176_589_833, FaultKind::Fails, of_estimator, 0),
            fault(
                200_000_000,
                FaultKind::MachineStalls,
                Target::Machine,
                156_000_000,
            ),
            fault(325_247_485, FaultKind::Death, Target::Service(0), 0),
            fault(352_841_785, FaultKind::SlowForks, Target::Machine, 200_000_000),
            fault(412_908_353, FaultKind::Death, of_estimator, 0),
            fault(467_236_774, FaultKind::Panic, of_estimator, 0),
        ],
    }]);
}

/// Services that had done the last step of a flight counted as absent, and the vehicle flew on without them.
#[test]
fn a_vehicle_is_judged_until_the_last_step() {
    assert_holds([History {
        seed: 1_007_340,
        setting: Setting {
            length_ms: 1166,
            ..LONG
        },
        faults: vec![
            fault(14_446_919, FaultKind::NoForks, Target::Machine, 1_000_000_000),
            fault(974_000_658, FaultKind::SendsGarbage, Target::Service(3), 0),
            fault(1_162_537_351, FaultKind::Spins, Target::Service(3), FOR_EVER),
        ],
    }]);
}

/// The limit of a standby process with a role counted from the decision, which the clean-up for another service can precede.
#[test]
fn a_standby_process_has_its_whole_limit_from_when_it_is_told_its_role() {
    assert_holds([History {
        seed: 10_292_450,
        setting: Setting {
            external: Some(0),
            length_ms: 600_000,
            loop_delay_ns: 50_000,
            ..LONG
        },
        faults: vec![
            fault(
                602_586_992,
                FaultKind::MachineStalls,
                Target::Machine,
                300_000_000,
            ),
            fault(777_382_141, FaultKind::Death, Target::Service(4), 0),
            fault(777_432_424, FaultKind::Starves, Target::Standby, 1_400_000_000),
            fault(777_712_825, FaultKind::Death, Target::Service(0), 0),
        ],
    }]);
}
