//! Reports of faults whose signs and errors are known.

use shared_types::samples::{
    ControlAdaptation, PathReference, RcFrame, RunEvent, VehicleState, VehicleTruth,
};
use zerocopy::{FromZeros, IntoBytes};

use super::*;
use crate::tracker::Tracker;
use run_log::test_flight::scenario;
use scenario::{FixChange, Fixes, Spoofing};

/// 20 s at 10 ms.
fn schedule() -> Schedule {
    scenario(0.01, 20.0).schedule().unwrap()
}

fn fault(from: u64, until: Option<u64>) -> PlannedFault {
    PlannedFault {
        words: format!("a fault from tick {from} on"),
        from,
        until,
    }
}

/// The samples of a tick; everything is in order at first.
struct Tick {
    error: f64,
    state: VehicleState,
    reference: PathReference,
    adaptation: ControlAdaptation,
    frame: RcFrame,
    without_path: bool,
    /// `true` if the operator asks for a landing.
    asks_to_land: bool,
}

/// The reports on a flight whose ticks are in order but for what `change` makes of them.
fn reports(faults: &[PlannedFault], last_tick: u64, change: impl Fn(u64, &mut Tick)) -> Vec<FaultReport> {
    reports_beside(faults, &[], last_tick, |_| None, change)
}

/// The same of a flight that something else changes at some ticks, beside an undisturbed one with these distances (m).
fn reports_beside(
    faults: &[PlannedFault],
    changes: &[u64],
    last_tick: u64,
    undisturbed: impl Fn(u64) -> Option<f64>,
    change: impl Fn(u64, &mut Tick),
) -> Vec<FaultReport> {
    reports_of_lost(faults, changes, last_tick, None, undisturbed, change)
}

/// The same of a vehicle that was lost at a time, s.
fn reports_of_lost(
    faults: &[PlannedFault],
    changes: &[u64],
    last_tick: u64,
    lost_at: Option<f64>,
    undisturbed: impl Fn(u64) -> Option<f64>,
    change: impl Fn(u64, &mut Tick),
) -> Vec<FaultReport> {
    let schedule = schedule();
    let mut watch = FaultWatch::new(faults.to_vec(), changes, &schedule);
    let mut tracker = Tracker::new(&schedule, false);
    let observe = |watch: &mut FaultWatch, tracker: &mut Tracker, topic: Topic, bytes: &[u8]| {
        if let Some(moment) = tracker.observe(topic, bytes) {
            watch.observe_moment(&moment, undisturbed(moment.vehicle.tick));
        }
        watch.observe(topic, bytes);
    };
    for tick in 0..=last_tick {
        let mut all = Tick {
            error: 0.01,
            state: VehicleState {
                tracked: true.into(),
                ..VehicleState::new_zeroed()
            },
            reference: PathReference {
                vehicle_known: true.into(),
                ..PathReference::new_zeroed()
            },
            adaptation: ControlAdaptation::new_zeroed(),
            frame: RcFrame::new_zeroed(),
            without_path: false,
            asks_to_land: false,
        };
        change(tick, &mut all);
        let header = |topic| schedule.header(topic, tick);
        let mut truth = VehicleTruth::new_zeroed();
        truth.header = header(Topic::VehicleTruth);
        truth.position_world = [1.0, 2.0 + all.error, 3.0];
        observe(&mut watch, &mut tracker, Topic::VehicleTruth, truth.as_bytes());
        all.state.header = header(Topic::VehicleState);
        observe(
            &mut watch,
            &mut tracker,
            Topic::VehicleState,
            all.state.as_bytes(),
        );
        if !all.without_path {
            all.reference.header = header(Topic::PathReference);
            all.reference.reference_time_ns = all.reference.header.stamp_ns;
            all.reference.position_world = [1.0, 2.0, 3.0];
            observe(
                &mut watch,
                &mut tracker,
                Topic::PathReference,
                all.reference.as_bytes(),
            );
        }
        all.adaptation.header = header(Topic::ControlAdaptation);
        observe(
            &mut watch,
            &mut tracker,
            Topic::ControlAdaptation,
            all.adaptation.as_bytes(),
        );
        all.frame.header = header(Topic::RcFrame);
        observe(&mut watch, &mut tracker, Topic::RcFrame, all.frame.as_bytes());
        if all.asks_to_land {
            let mut event = RunEvent::new_zeroed();
            event.header.tick = tick;
            event.kind = RunEvent::KIND_OPERATOR_LANDS;
            observe(&mut watch, &mut tracker, Topic::RunEvent, event.as_bytes());
        }
    }
    if let Some(moment) = tracker.last() {
        watch.observe_moment(&moment, undisturbed(moment.vehicle.tick));
    }
    let lost = lost_at.map(|time| Loss::not_finite(time, crate::tracker::StateSource::Truth));
    watch.finish(&schedule, lost.as_ref())
}

fn report(fault: PlannedFault, change: impl Fn(u64, &mut Tick)) -> FaultReport {
    let mut reports = reports(&[fault], 2000, change);
    assert_eq!(reports.len(), 1);
    reports.remove(0)
}

fn assert_close(value: Option<f64>, expected: f64) {
    let value = value.unwrap_or_else(|| panic!("nothing in place of {expected}"));
    assert!((value - expected).abs() < 1e-12, "{value} is not {expected}");
}

#[test]
fn a_fault_that_nobody_notices_is_reported_with_its_times() {
    let report = report(fault(1000, Some(1010)), |_, _| {});
    assert_eq!(
        (report.begins, report.ends, report.outage),
        (10.0, Some(10.1), 0.1)
    );
    assert_eq!(report.watched_until, 20.0);
    assert_eq!(report.detection, None);
    assert_close(report.peak_error, 0.01);
    assert_close(report.back_after, 0.0);
    assert_eq!(report.reactions, Reactions::default());
    assert_eq!(report.others, "went on as ever");
}

#[test]
fn an_outage_for_good_lasts_to_the_end_of_what_was_flown_and_has_no_way_back() {
    let [report] = &reports(&[fault(1000, None)], 1500, |_, _| {})[..] else {
        panic!("one fault, one report");
    };
    assert_eq!((report.ends, report.outage, report.back_after), (None, 5.0, None));
    assert!(!report.is_over());
}

#[test]
fn every_sign_of_every_service_is_a_detection_with_its_time_and_its_service() {
    type Change = fn(&mut Tick);
    let signs: [(Change, &str, &str); 12] = [
        (
            |tick| tick.state.tracked = false.into(),
            "estimator",
            "not tracked",
        ),
        (|tick| tick.state.coasting = true.into(), "estimator", "coasts"),
        (|tick| tick.state.captures_refused = 7, "estimator", "refuses"),
        (
            |tick| tick.reference.vehicle_known = false.into(),
            "path_generator",
            "path stands",
        ),
        (
            |tick| tick.reference.states_refused = 7,
            "path_generator",
            "refuses",
        ),
        (
            |tick| tick.adaptation.stage = ControlAdaptation::STAGE_HOLD,
            "controller",
            "holds",
        ),
        (
            |tick| tick.adaptation.stage = ControlAdaptation::STAGE_LEVEL,
            "controller",
            "levels out",
        ),
        (
            |tick| tick.adaptation.stage = ControlAdaptation::STAGE_FAILSAFE,
            "controller",
            "failsafe",
        ),
        (|tick| tick.adaptation.inputs_refused = 7, "controller", "refuses"),
        (
            |tick| tick.frame.stage = RcFrame::STAGE_HOLD,
            "rc_output",
            "holds",
        ),
        (|tick| tick.frame.failsafe = true.into(), "rc_output", "failsafe"),
        (|tick| tick.frame.commands_refused = 7, "rc_output", "refuses"),
    ];
    for (sign, by, words) in signs {
        let report = report(fault(1000, Some(1010)), |tick, all| {
            if tick >= 1003 {
                sign(all);
            }
        });
        let detection = report.detection.unwrap();
        assert_eq!((&*detection.by, &*detection.sign), (by, words));
        assert_close(Some(detection.after), 0.03);
    }
}

#[test]
fn what_has_shown_since_before_the_fault_is_no_sign_of_it() {
    let report = report(fault(1000, Some(1010)), |tick, all| {
        all.state.captures_refused = 7;
        all.reference.vehicle_known = (tick >= 1500).into();
        all.adaptation.resting = (tick >= 1000).into();
    });
    assert_eq!(report.detection, None);
    assert_close(Some(report.reactions.path_stood), 5.0);
}

#[test]
fn what_a_service_refuses_at_the_same_tick_without_the_fault_is_no_sign_of_it() {
    let refusal = |tick: u64| {
        let mut state = VehicleState::new_zeroed();
        state.header = schedule().header(Topic::VehicleState, tick);
        state.tracked = true.into();
        // By chance at 10.5 s; with the fault at 10.6 s, too.
        state.captures_refused = u32::from(tick >= 1050);
        state
    };
    let mut ordinary = OrdinaryWatch::default();
    for tick in 0..2000 {
        ordinary.observe(Topic::VehicleState, refusal(tick).as_bytes());
    }
    let ordinary = std::sync::Arc::new(ordinary.finish());
    for (is_refused_at, after) in [(None, None), (Some(1060), Some(0.6))] {
        let mut watch =
            FaultWatch::new(vec![fault(1000, Some(1010))], &[], &schedule()).beside(ordinary.clone());
        for tick in 0..2000 {
            let mut state = refusal(tick);
            state.captures_refused += u32::from(is_refused_at.is_some_and(|from| tick >= from));
            watch.observe(Topic::VehicleState, state.as_bytes());
        }
        let report = watch.finish(&schedule(), None).remove(0);
        let found = report.detection.map(|detection| detection.after);
        assert_eq!(found, after, "{is_refused_at:?}");
    }
}

#[test]
fn the_first_of_two_signs_counts_also_within_a_tick() {
    let report = report(fault(1000, Some(1010)), |tick, all| {
        all.frame.failsafe = (tick >= 1004).into();
        all.state.coasting = (tick >= 1004).into();
        all.adaptation.inputs_refused = u32::from(tick >= 1005);
    });
    assert_eq!(report.detection.unwrap().by, "estimator");
}

#[test]
fn the_way_back_counts_from_the_end_until_the_error_stays_within_what_it_was_before() {
    // 5 cm just outside of the five seconds before, 3 cm within them.
    let report = report(fault(1000, Some(1010)), |tick, all| {
        all.error = match tick {
            499 => 0.05,
            500 => 0.03,
            1005 => 0.4,
            1010..=1050 => 0.3,
            // A relapse.
            1100 => 0.031,
            1101..=1200 => 0.03,
            _ => 0.01,
        };
    });
    assert_close(Some(report.bound), 0.03);
    assert_close(report.peak_error, 0.4);
    assert_close(report.back_after, 0.91);
}

#[test]
fn within_two_centimetres_is_inside_however_small_the_error_was_before() {
    let report = report(fault(1000, Some(1010)), |tick, all| {
        all.error = if tick < 1000 { 0.001 } else { 0.019 };
    });
    assert_close(Some(report.bound), 0.02);
    assert_close(report.back_after, 0.0);
}

#[test]
fn a_vehicle_that_stays_away_is_not_back() {
    let report = report(fault(1000, Some(1010)), |tick, all| {
        all.error = if tick < 1990 { 0.01 } else { 0.5 };
    });
    assert_eq!((report.back_after, report.is_over()), (None, true));
    assert_close(report.peak_error, 0.5);
}

#[test]
fn a_fault_is_watched_until_the_next_begins() {
    let faults = [
        fault(500, Some(510)),
        fault(1000, Some(1010)),
        fault(1000, None),
        fault(1900, Some(1910)),
    ];
    let reports = reports(&faults, 1500, |tick, all| {
        all.error = if tick < 1000 { 0.01 } else { 0.3 };
        all.state.coasting = (tick >= 1002).into();
    });
    // The last was not reached.
    assert_eq!(reports.len(), 3);
    assert_eq!(reports[0].detection, None);
    assert_close(reports[0].peak_error, 0.01);
    assert_eq!(reports[0].watched_until, 10.0);
    for report in &reports[1..] {
        let detection = report.detection.as_ref();
        assert_close(detection.map(|detection| detection.after), 0.02);
        assert_close(report.peak_error, 0.3);
        assert_eq!(report.watched_until, 15.0);
    }
}

#[test]
fn what_comes_after_a_change_of_the_vehicle_is_not_the_fault_s_doing() {
    let error = |tick: u64, all: &mut Tick| all.error = if tick < 1500 { 0.01 } else { 0.4 };
    let watched = reports_beside(&[fault(1000, Some(1010))], &[500, 1500], 2000, |_| None, error);
    assert_eq!(watched[0].watched_until, 15.0);
    assert_close(watched[0].peak_error, 0.01);
    assert_close(watched[0].back_after, 0.0);
}

#[test]
fn a_fault_is_judged_beside_the_undisturbed_flight_where_that_is_known() {
    let report = |undisturbed: Option<f64>| {
        let error = |tick: u64, all: &mut Tick| {
            all.error = if (1200..1300).contains(&tick) { 0.3 } else { 0.01 };
        };
        let near = |tick: u64| {
            if (1150..1350).contains(&tick) {
                undisturbed
            } else {
                None
            }
        };
        reports_beside(&[fault(1000, Some(1010))], &[], 2000, near, error).remove(0)
    };
    let alone = report(None);
    assert_close(alone.largest_share, 15.0);
    assert_close(alone.back_after, 2.9);
    let beside = report(Some(0.4));
    assert_close(beside.largest_share, 0.75);
    assert_close(beside.back_after, 0.0);
    assert_close(beside.peak_error, 0.3);
}

#[test]
fn what_the_services_did_is_told_in_seconds_and_counts() {
    let report = report(fault(1000, Some(1010)), |tick, all| {
        all.state.coasting = (1000..1012).contains(&tick).into();
        all.reference.vehicle_known = (!(1000..1030).contains(&tick)).into();
        all.adaptation.stage = match tick {
            1000..1005 => ControlAdaptation::STAGE_HOLD,
            1005..1015 => ControlAdaptation::STAGE_LEVEL,
            _ => ControlAdaptation::STAGE_LAW,
        };
        all.adaptation.resting = (1000..1020).contains(&tick).into();
        all.frame.failsafe = (1000..1003).contains(&tick).into();
        all.frame.commands_refused = if tick < 1000 { 0 } else { 3 };
    });
    assert_eq!(
        report.others,
        "estimator coasted 0.12 s; path stood 0.3 s; controller held 0.05 s, level 0.1 s; \
         radio failsafe 3 frames, refused 3 commands; estimates rested 0.2 s"
    );
}

#[test]
fn the_error_is_known_while_the_path_generator_is_out_and_its_point_moves_on_for_a_while() {
    // At 0.5 m/s along x, from where the vehicle stays.
    let report = report(fault(1000, Some(1300)), |tick, all| {
        all.reference.gamma_dot = 0.5;
        all.reference.derivative1_world = [1.0, 0.0, 0.0];
        all.without_path = tick >= 1000;
        all.error = 0.0;
    });
    // The last reference is of 9.99 s, and after 0.2 s its point stands.
    assert_close(report.peak_error, 0.1);
}

#[test]
fn a_summary_tells_of_faults_only_where_some_were_planned() {
    use crate::summary::FlightSummary;
    use crate::summary::tests::facts;
    for is_planned in [false, true] {
        let mut scenario = scenario(0.01, 20.0);
        if is_planned {
            let mut off = scenario::Fault::new(scenario::FaultKind::Off, 5.0);
            off.service = Some("controller".to_owned());
            off.lasts = Some(0.1);
            scenario.fault.push(off);
        }
        let schedule = scenario.schedule().unwrap();
        let mut summary = FlightSummary::new(&scenario, &schedule);
        for tick in 0..=2000 {
            let mut truth = VehicleTruth::new_zeroed();
            truth.header = schedule.header(Topic::VehicleTruth, tick);
            summary.observe(Topic::VehicleTruth, truth.as_bytes());
            let mut reference = PathReference::new_zeroed();
            reference.header = schedule.header(Topic::PathReference, tick);
            summary.observe(Topic::PathReference, reference.as_bytes());
        }
        let summary = summary.finish(facts());
        let text = summary.to_string();
        let json = serde_json::to_value(&summary).unwrap();
        assert_eq!(text.contains("what the services did"), is_planned, "{text}");
        assert_eq!(text.contains("controller is off"), is_planned, "{text}");
        assert_eq!(json.get("faults").is_some(), is_planned);
        if is_planned {
            assert_eq!(json["faults"][0]["outage"], 0.1);
            assert_eq!(json["faults"][0]["detection"], serde_json::Value::Null);
        }
    }
}

#[test]
fn a_vehicle_that_was_lost_is_not_back() {
    let faults = [fault(500, Some(510)), fault(1000, Some(1010))];
    for (lost_at, back) in [
        (None, [true, true]),
        (Some(12.0), [true, false]),
        (Some(7.0), [false, false]),
    ] {
        let reports = reports_of_lost(&faults, &[], 2000, lost_at, |_| None, |_, _| {});
        let are_back: Vec<_> = reports.iter().map(|report| report.back_after.is_some()).collect();
        assert_eq!(are_back, back, "lost at {lost_at:?}");
    }
}

/// A record of a fault in ticks 100 to 200, of a vehicle that is 0.5 m off in it and is then led in these phases with these
/// distances (m), 100 ticks each.
fn recovery(led: &[(FlightPhase, f64)]) -> FaultReport {
    let schedule = schedule();
    let mut record = FaultRecord::new(fault(100, Some(200)), u64::MAX, &schedule);
    let before = [(FlightPhase::Fly, 0.01), (FlightPhase::Fly, 0.5)];
    for (tick, &(phase, error)) in (0..).zip(before.iter().chain(led).flat_map(|one| [one; 100])) {
        if phase == FlightPhase::Land {
            record.observe_landing(tick, true);
        }
        record.observe_error(tick, phase, error, None);
    }
    record.finish(199 + 100 * led.len() as u64, &schedule)
}

#[test]
fn a_landing_does_not_undo_that_the_vehicle_came_back() {
    use FlightPhase::{Fly, Land, TakeOff};
    let landed = recovery(&[(Fly, 0.01), (Land, 0.3)]);
    assert_eq!((landed.back_after, landed.watched_until), (Some(0.0), 3.0));
    // It lands before the fault is over: nothing says whether it would have come back.
    let early = FaultReport {
        ends: Some(2.5),
        ..recovery(&[(Land, 0.3)])
    };
    assert!(early.back_after.is_none() && !early.is_over());
    let astray = recovery(&[(Fly, 0.4), (Land, 0.01)]);
    assert!(astray.back_after.is_none() && astray.is_over());
    let led_back = recovery(&[(Fly, 0.01), (TakeOff, 0.01), (Fly, 0.01)]);
    assert_eq!(led_back.back_after, Some(2.0));
}

#[test]
fn the_figures_of_a_fault_end_where_a_requested_landing_begins() {
    let landing = |cause: u8, asked_at: u64| {
        report(fault(1000, Some(1010)), move |tick, all| {
            let (phase, error) = match tick {
                0..1500 => (FlightPhase::Fly, 0.01),
                1500..1900 => (FlightPhase::Land, 0.4),
                _ => (FlightPhase::Disarmed, 0.3),
            };
            (all.reference.phase, all.reference.cause) = (phase.code(), cause);
            all.error = error;
            all.state.coasting = (tick > 1500).into();
            all.asks_to_land = tick == asked_at;
        })
    };
    // The request of a tick is recorded after its samples, and in real time up to some ticks later.
    for asked_at in [1495, 1500, 1510] {
        let requested = landing(PathReference::CAUSE_OPERATOR_LANDS, asked_at);
        assert_eq!((requested.watched_until, requested.lands), (15.0, false));
        assert_close(requested.peak_error, 0.01);
        assert_eq!((requested.detection, requested.back_after), (None, Some(0.0)));
        assert_eq!(requested.reactions, Reactions::default());
    }
    // A limit of the envelope may be the fault's doing, and so may be that no orchestrator was there.
    let limit = PathReference::CAUSE_ENVELOPE_LANDS + RcFrame::LIMIT_ESTIMATE;
    let never = u64::MAX;
    for (cause, asked_at) in [
        (limit, never),
        (PathReference::CAUSE_OPERATOR_LANDS, never),
        (PathReference::CAUSE_OPERATOR_LANDS, 1511),
    ] {
        let demanded = landing(cause, asked_at);
        assert_eq!((demanded.watched_until, demanded.lands), (15.0, true));
        assert_close(demanded.peak_error, 0.01);
        assert_eq!(demanded.detection.unwrap().sign, "coasts");
        assert_close(Some(demanded.reactions.coasted), 5.0);
    }
}

#[test]
fn the_request_of_an_earlier_landing_is_not_that_of_a_later_one() {
    use FlightPhase::{Disarmed, Fly, Land};
    let report = report(fault(1000, None), |tick, all| {
        let phase = match tick {
            0..100 | 500..1500 => Fly,
            100..300 | 1500..1900 => Land,
            _ => Disarmed,
        };
        all.reference.phase = phase.code();
        if phase == Land {
            all.reference.cause = PathReference::CAUSE_OPERATOR_LANDS;
        }
        all.asks_to_land = tick == 100;
    });
    assert!(report.lands);
}

#[test]
fn a_fault_that_begins_in_a_landing_is_watched() {
    let report = report(fault(1000, None), |tick, all| {
        all.reference.phase = if tick < 900 {
            FlightPhase::Fly
        } else {
            FlightPhase::Land
        }
        .code();
        all.reference.cause = PathReference::CAUSE_OPERATOR_LANDS;
        all.state.coasting = (tick >= 1100).into();
    });
    assert_eq!((report.watched_until, report.back_after), (20.0, None));
    assert!(report.detection.is_some() && report.peak_error.is_some());
}

#[test]
fn a_fault_of_which_nothing_was_watched_after_its_end_is_not_said_to_be_not_back() {
    let faults = [fault(500, Some(1000)), fault(1000, Some(1010))];
    let reports = reports(&faults, 1500, |_, _| {});
    assert!(!reports[0].is_over() && reports[1].is_over());
}

#[test]
fn the_changes_of_a_receiver_and_its_spoofing_are_planned_faults() {
    let mut scenario = scenario(0.01, 40.0);
    let gnss = &mut scenario.sensors.get_or_insert_default().gnss;
    let change = |at: f64, kind: Fixes| FixChange { at, kind };
    gnss.change = vec![
        change(5.0, Fixes::RtkFloat),
        change(7.0, Fixes::SinglePoint),
        change(9.0, Fixes::RtkFixed),
        change(30.0, Fixes::RtkFloat),
    ];
    gnss.spoofing = vec![Spoofing {
        at: 20.0,
        lasts: 6.0,
        velocity: [0.5, 0.0, 0.0],
    }];
    let faults = PlannedFault::all(&scenario);
    let planned: Vec<_> = faults
        .iter()
        .map(|fault| (&*fault.words, fault.from, fault.until))
        .collect();
    assert_eq!(
        planned,
        [
            ("receiver has rtk_float fixes, not rtk_fixed", 500, Some(700)),
            ("receiver has single_point fixes, not rtk_fixed", 700, Some(900)),
            ("fixes drift away by [0.5, 0, 0] m/s", 2000, Some(2600)),
            ("receiver has rtk_float fixes, not rtk_fixed", 3000, None),
        ]
    );
}
