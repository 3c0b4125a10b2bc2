//! Figures of logs whose content is known.

use super::*;
use run_log::test_flight::{away, record_samples, scenario};
use run_log::{Compression, Manifest, RunLogWriter};
use scenario::{Fault, FaultKind};
use shared_types::samples::{PathReference, RcFrame};
use shared_types::service::seconds;
use shared_types::{FlightPhase, Topic};
use zerocopy::{FromBytes, FromZeros, IntoBytes};

/// A log of 20 s whose error decays from `start` (m), with one peak of a single sample.
fn decaying(path: &Path, start: f64) {
    let scenario = scenario(0.001, 20.0);
    let schedule = scenario.schedule().unwrap();
    let samples = (0..=schedule.last_tick()).flat_map(|tick| {
        let peak = if tick == 12_345 { 3.0 } else { 0.0 };
        let distance = 0.016 + start * libm::exp(-seconds(schedule.time_ns(tick))) + peak;
        away(&schedule, tick, distance)
    });
    record_samples(path, &scenario, Compression::None, samples);
}

#[test]
fn a_peak_of_one_sample_among_thousands_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    decaying(&log, 1.0);
    let curve = Curve::read(&log, Span::default()).unwrap();
    let [stretch] = &curve.stretches[..] else {
        panic!("nothing interrupts the curve");
    };
    assert!(stretch.len() <= 2 * COLUMNS + 1);
    assert!(stretch.iter().any(|&(time, value)| time == 12.345 && value > 3.0));
}

#[test]
fn a_figure_names_axes_bound_change_and_flights() {
    let folder = tempfile::tempdir().unwrap();
    let logs = ["near-1", "far-1"].map(|name| {
        let run = folder.path().join(name);
        std::fs::create_dir(&run).unwrap();
        run.join("run.mcap")
    });
    decaying(&logs[0], 1.0);
    decaying(&logs[1], 50.0);
    let out = folder.path().join("figure.svg");
    distance(&logs, Span::default(), &out).unwrap();
    let figure = std::fs::read_to_string(&out).unwrap();
    for text in [
        "time, s",
        "distance from the path, m",
        "0.0167 m",
        "mass becomes 0.3 kg",
        "near-1",
        "far-1",
        "a test",
    ] {
        assert!(figure.contains(text), "{text} is not in the figure");
    }
}

#[test]
fn a_log_that_tells_nothing_of_the_distance_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    let manifest = Manifest::new(&scenario(0.01, 1.0));
    RunLogWriter::create(&log, &manifest, Compression::None)
        .unwrap()
        .finish()
        .unwrap();
    let error = distance(
        std::slice::from_ref(&log),
        Span::default(),
        &folder.path().join("figure.svg"),
    )
    .unwrap_err();
    assert!(error.to_string().contains("run.mcap"), "{error}");
}

/// A log of 20 s whose controller is out from 5 s to 5.5 s; the vehicle stays 0.2 m from its path.
fn interrupted(path: &Path) {
    let mut scenario = scenario(0.01, 20.0);
    let mut off = Fault::new(FaultKind::Off, 5.0);
    off.service = Some("controller".to_owned());
    off.lasts = Some(0.5);
    scenario.fault.push(off);
    let schedule = scenario.schedule().unwrap();
    let samples = (0..=schedule.last_tick()).flat_map(|tick| away(&schedule, tick, 0.2));
    record_samples(path, &scenario, Compression::None, samples);
}

#[test]
fn the_true_distance_is_drawn_also_while_the_controller_is_out() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    interrupted(&log);
    let curve = Curve::read(&log, Span::default()).unwrap();
    let [stretch] = &curve.stretches[..] else {
        panic!("nothing interrupts the curve");
    };
    assert!(
        stretch
            .iter()
            .all(|&(_, distance)| (distance - 0.2).abs() < 1e-12)
    );
    let column = 20.0 / COLUMNS as f64;
    assert!(
        stretch
            .windows(2)
            .all(|pair| pair[1].0 - pair[0].0 < 2.0 * column)
    );
}

#[test]
fn a_planned_fault_is_shaded_and_named_where_it_is_in_view() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    interrupted(&log);
    let out = folder.path().join("figure.svg");
    for (from, is_in_view) in [(None, true), (Some(4.0), true), (Some(6.0), false)] {
        let span = Span { from, to: Some(12.0) };
        distance(std::slice::from_ref(&log), span, &out).unwrap();
        let figure = std::fs::read_to_string(&out).unwrap();
        assert_eq!(
            figure.contains("controller off for 0.5 s"),
            is_in_view,
            "{from:?}"
        );
        assert!(figure.contains("mass becomes"), "{from:?}");
    }
}

/// A log of 20 s whose take-off is given up on the ground at 10 s, or is killed at 2.5 s.
fn given_up(path: &Path, is_killed: bool) {
    let mut scenario = scenario(0.01, 20.0);
    scenario.flight = Some(scenario::Flight::default());
    let schedule = scenario.schedule().unwrap();
    let samples = (0..=schedule.last_tick()).flat_map(|tick| {
        let [truth, (topic, reference)] = away(&schedule, tick, 0.8);
        let mut reference = PathReference::read_from_bytes(&reference).unwrap();
        let (phase, cause) = match tick {
            ..200 => (FlightPhase::Armed, PathReference::CAUSE_NONE),
            200..250 => (FlightPhase::TakeOff, PathReference::CAUSE_NONE),
            _ if is_killed => (FlightPhase::Disarmed, PathReference::CAUSE_OPERATOR_KILLS),
            250..1000 => (FlightPhase::TakeOff, PathReference::CAUSE_NONE),
            _ => (FlightPhase::Disarmed, PathReference::CAUSE_OVERDUE),
        };
        (reference.phase, reference.cause) = (phase.code(), cause);
        let mut frame = RcFrame::new_zeroed();
        frame.header = schedule.header(Topic::RcFrame, tick);
        if is_killed && tick >= 250 {
            (frame.failsafe, frame.action) = (true.into(), RcFrame::ACTION_KILL);
        }
        [
            truth,
            (topic, reference.as_bytes().to_vec()),
            (Topic::RcFrame, frame.as_bytes().to_vec()),
        ]
    });
    record_samples(path, &scenario, Compression::None, samples);
}

#[test]
fn a_flight_that_was_killed_or_never_left_the_ground_says_so_in_its_figure_and_to_the_caller() {
    let folder = tempfile::tempdir().unwrap();
    let log = |name: &str| {
        let run = folder.path().join(name);
        std::fs::create_dir(&run).unwrap();
        run.join("run.mcap")
    };
    let [killed, grounded, good] = ["killed", "grounded", "good"].map(log);
    given_up(&killed, true);
    given_up(&grounded, false);
    decaying(&good, 1.0);
    let out = folder.path().join("figure.svg");
    let drawn = |logs: &[PathBuf]| {
        let told = distance(logs, Span::default(), &out).unwrap();
        (told, std::fs::read_to_string(&out).unwrap())
    };
    let (told, figure) = drawn(std::slice::from_ref(&killed));
    assert_eq!(told, ["KILLED at 2.5 s: the operator killed"]);
    assert!(figure.contains("KILLED at 2.5 s"), "{figure}");
    let (told, figure) = drawn(&[good.clone(), grounded.clone()]);
    let words = "grounded: the vehicle did not take off: the take-off took too long";
    assert!(told.len() == 1 && told[0].starts_with(words), "{told:?}");
    assert!(figure.contains(words), "{figure}");
    assert_eq!(drawn(&[good]).0, Vec::<String>::new());
    // A part of the flight in which nothing was flown is not drawn, and the reason is not the span.
    let span = Span {
        from: Some(12.0),
        to: None,
    };
    let refused = distance(&[grounded], span, &out).unwrap_err().to_string();
    assert!(refused.contains("the vehicle did not take off"), "{refused}");
    // A run that failed says so in its summary alone.
    let summary = killed.with_file_name("summary.json");
    let text = "{\"outcome\": \"failed\", \"reason\": \"the controller gave up\"}";
    result_file::write(&summary, text, &[]).unwrap();
    let (told, figure) = drawn(&[killed]);
    let words = "the run: failed: the controller gave up; KILLED at 2.5 s";
    assert!(told[0].starts_with(words) && figure.contains(words), "{told:?}");
}
