//! What a figure shows of logs whose content is known.

use super::*;
use crate::log::test_flight::{errors, record_samples, scenario};
use crate::log::{Compression, Manifest, RunLogWriter};
use shared_types::Topic;

/// A log of 20 s whose error decays from `start` (m), with one peak of a single sample.
fn decaying(path: &Path, start: f64) {
    let scenario = scenario(0.001, 20.0);
    let schedule = scenario.schedule().unwrap();
    let samples = (0..=schedule.last_tick()).map(|tick| {
        let header = schedule.header(Topic::ControlErrors, tick);
        let peak = if tick == 12_345 { 3.0 } else { 0.0 };
        let norm = 0.016 + start * libm::exp(-seconds(header.stamp_ns)) + peak;
        (Topic::ControlErrors, errors(header, [0.0, norm, 0.0]))
    });
    record_samples(path, &scenario, Compression::None, samples);
}

#[test]
fn a_peak_of_one_sample_among_thousands_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    decaying(&log, 1.0);
    let curve = read_curve(&log).unwrap();
    assert!(curve.points.len() <= 2 * COLUMNS + 1);
    assert!(
        curve
            .points
            .iter()
            .any(|&(time, value)| time == 12.345 && value > 3.0)
    );
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
    z1(&logs, &out).unwrap();
    let figure = std::fs::read_to_string(&out).unwrap();
    for text in [
        "time, s",
        "‖z1‖, distance from the path, m",
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
fn a_log_without_errors_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    let manifest = Manifest::new(&scenario(0.01, 1.0));
    RunLogWriter::create(&log, &manifest, Compression::None)
        .unwrap()
        .finish()
        .unwrap();
    let error = z1(std::slice::from_ref(&log), &folder.path().join("figure.svg")).unwrap_err();
    assert!(error.to_string().contains("run.mcap"), "{error}");
}
