//! A simulated flight, written as a recording and imported: nothing of it is lost, and the estimator errs as it did.
#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use std::fmt::Write as _;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use clap::Parser;
use flight::interrupt::Interrupt;
use host::in_process::TickSink;
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use run_log::{LogError, LogReader};
use scenario::Scenario;
use shared_types::geodesy::Geodetic;
use shared_types::rotation::from_row_major;
use shared_types::samples::{BaroAltitude, GnssFix, ImuSample, MagField, RcFrame, VehicleState};
use shared_types::{ServiceId, Topic};
use zerocopy::FromBytes;

use crate::command::{Import, Imported, run, shown};
use crate::recording::{Recording, WrongLine};

/// Latency of fixes in the scenario, µs.
const FIX_LATENCY_US: u64 = 100_000;

/// `gerono import`, alone.
#[derive(Parser)]
struct Alone {
    #[command(flatten)]
    import: Import,
}

/// Samples of a flight, and what its estimator made of them.
#[derive(Default)]
struct Flown {
    imu: Vec<ImuSample>,
    fixes: Vec<GnssFix>,
    altitudes: Vec<BaroAltitude>,
    fields: Vec<MagField>,
    frames: Vec<RcFrame>,
    states: Vec<VehicleState>,
}

fn read<T: FromBytes>(bytes: &[u8]) -> T {
    T::read_from_bytes(bytes).unwrap()
}

impl TickSink for Flown {
    type Error = LogError;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), LogError> {
        match topic {
            Topic::ImuSample => self.imu.push(read(bytes)),
            Topic::GnssFix => self.fixes.push(read(bytes)),
            Topic::BaroAltitude => self.altitudes.push(read(bytes)),
            Topic::MagField => self.fields.push(read(bytes)),
            Topic::RcFrame => self.frames.push(read(bytes)),
            Topic::VehicleState => self.states.push(read(bytes)),
            _ => {}
        }
        Ok(())
    }

    fn end_tick(&mut self, _: u64) -> Result<ControlFlow<()>, LogError> {
        Ok(ControlFlow::Continue(()))
    }
}

fn scenario_path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/outdoor_rtk.toml")
}

fn flown() -> (Scenario, Flown) {
    let sets = ["duration=25.0", "flight.arm_at=13.0"].map(str::to_owned);
    let (scenario, _) = scenario_file::load_shortened(&scenario_path(), &sets, None).unwrap();
    let mut flown = Flown::default();
    flight::in_process::fly(&scenario, &mut flown, &Interrupt::never()).unwrap();
    (scenario, flown)
}

/// Start of the recorder's clock, µs.
const START_US: u64 = 7_000_000;

/// Returns a flight as a table of samples, in the order of time.
fn table(flown: &Flown) -> String {
    let mut lines: Vec<(u64, String)> = Vec::new();
    let us = |time_ns: u64| time_ns / 1000 + START_US;
    let words = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    for sample in flown.imu.iter().filter(|sample| sample.measured.is_set()) {
        let numbers = [sample.specific_force_body, sample.angular_velocity_body].concat();
        lines.push((us(sample.measured_ns), format!("imu,{}", words(&numbers))));
    }
    for fix in flown.fixes.iter().filter(|fix| fix.measured.is_set()) {
        let [north, east, down] = fix.velocity_ned;
        let place = [
            fix.height * 1e3,
            fix.longitude * 1e7,
            fix.latitude * 1e7,
            north,
            east,
            down,
        ];
        let kind = [
            f64::from(fix.kind),
            fix.horizontal_accuracy,
            fix.vertical_accuracy,
            fix.speed_accuracy,
        ];
        let line = format!("gps,{},{}", words(&place), words(&kind));
        lines.push((us(fix.valid_ns) + FIX_LATENCY_US, line));
    }
    for sample in flown.altitudes.iter().filter(|sample| sample.measured.is_set()) {
        lines.push((
            us(sample.measured_ns),
            format!("baro,{}", sample.altitude + 565.0),
        ));
    }
    for sample in flown.fields.iter().filter(|sample| sample.measured.is_set()) {
        lines.push((
            us(sample.measured_ns),
            format!("mag,{}", words(&sample.field_body)),
        ));
    }
    for frame in &flown.frames {
        let time = us(frame.header.stamp_ns);
        lines.push((time, format!("armed,{}", u8::from(!frame.failsafe.is_set()))));
        lines.push((time, format!("landed,{}", u8::from(frame.thrust < 2.0))));
        lines.push((time, "airspeed,3.5,3.5".to_owned()));
    }
    lines.sort_by_key(|(time, _)| *time);
    lines
        .iter()
        .map(|(time, line)| format!("{time},{line}\n"))
        .collect()
}

/// Returns the estimate as a table of EKF2's states, ten a second.
fn states(scenario: &Scenario, flown: &Flown) -> String {
    let frame = scenario.datum_or_default().frame();
    let first = &flown.fixes[0];
    let origin = frame.to_world(Geodetic {
        latitude: first.latitude,
        longitude: first.longitude,
        height: first.height,
    });
    let ned_from_world = frame.world_from_ned().transpose();
    let mut text = "Timestamp,states\n".to_owned();
    let tracked = flown.states.iter().filter(|state| state.tracked.is_set());
    for state in tracked.step_by(25) {
        let r = from_row_major(&state.world_from_body);
        let attitude =
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(ned_from_world * r));
        let velocity = ned_from_world * r * Vector3::from(state.velocity_body);
        let position = ned_from_world * (Vector3::from(state.position_world) - origin);
        let time = state.state_time_ns / 1000 + START_US;
        let [w, x, y, z] = [attitude.w, attitude.i, attitude.j, attitude.k];
        write!(text, "{time},{w},{x},{y},{z}").unwrap();
        for number in velocity.iter().chain(&position) {
            write!(text, ",{number}").unwrap();
        }
        text += ",0,0\n";
    }
    text
}

fn import(folder: &Path, samples: &str, more: &[&str]) -> Result<Imported, String> {
    let file = folder.join("flight.csv");
    std::fs::write(&file, samples).unwrap();
    let (file, out, scenario) = (file.to_str().unwrap(), folder.join("out"), scenario_path());
    let stated = [
        "import",
        file,
        "--scenario",
        scenario.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ];
    let arguments = Alone::parse_from(stated.iter().chain(more)).import;
    // In one line, whatever the width of the terminal.
    run(&arguments).map_err(|failure| format!("{:?}", failure.report).replace("\n  │ ", " "))
}

/// Returns the samples of a topic in a log that measure something.
fn logged<T: FromBytes>(log: &Path, topic: Topic, is_measured: impl Fn(&T) -> bool) -> Vec<T> {
    let mut reader = LogReader::open(log).unwrap();
    let mut found = Vec::new();
    while let Some(sample) = reader.next_sample().unwrap() {
        if sample.topic == topic {
            found.extend(Some(read::<T>(sample.bytes)).filter(&is_measured));
        }
    }
    found
}

#[test]
fn a_recorded_flight_is_imported_without_a_loss_and_estimated_as_it_was_flown() {
    let (scenario, flown) = flown();
    let folder = tempfile::tempdir().unwrap();
    let reference = folder.path().join("states.csv");
    std::fs::write(&reference, states(&scenario, &flown)).unwrap();
    let samples = table(&flown);
    let more = ["--reference", reference.to_str().unwrap(), "--from", "13"];
    let imported = import(folder.path(), &samples, &more).unwrap();

    let imu = logged(&imported.log, Topic::ImuSample, |sample: &ImuSample| {
        sample.measured.is_set()
    });
    let expected = flown.imu.iter().filter(|sample| sample.measured.is_set());
    assert!(
        imu.iter()
            .map(|s| (s.measured_ns, s.specific_force_body, s.angular_velocity_body))
            .eq(expected.map(|s| (s.measured_ns, s.specific_force_body, s.angular_velocity_body)))
    );
    let fields = logged(&imported.log, Topic::MagField, |sample: &MagField| {
        sample.measured.is_set()
    });
    let expected = flown.fields.iter().filter(|sample| sample.measured.is_set());
    assert!(
        fields
            .iter()
            .map(|s| (s.measured_ns, s.field_body))
            .eq(expected.map(|s| (s.measured_ns, s.field_body)))
    );
    let fixes = logged(&imported.log, Topic::GnssFix, |fix: &GnssFix| {
        fix.measured.is_set()
    });
    assert!(fixes.len() > 240);
    for (fix, expected) in fixes
        .iter()
        .zip(flown.fixes.iter().filter(|fix| fix.measured.is_set()))
    {
        assert_eq!(
            (fix.valid_ns, fix.kind, fix.velocity_ned, fix.speed_accuracy),
            (
                expected.valid_ns,
                expected.kind,
                expected.velocity_ned,
                expected.speed_accuracy
            )
        );
        assert!(
            (fix.latitude - expected.latitude).abs() < 1e-12 && (fix.height - expected.height).abs() < 1e-9
        );
    }
    let altitudes = logged(&imported.log, Topic::BaroAltitude, |sample: &BaroAltitude| {
        sample.measured.is_set()
    });
    let first = altitudes[0].altitude - flown.altitudes[0].altitude;
    for (altitude, expected) in altitudes.iter().zip(&flown.altitudes) {
        assert!((altitude.altitude - expected.altitude - first).abs() < 1e-9);
    }
    let frames = logged(&imported.log, Topic::RcFrame, |_: &RcFrame| true);
    for (frame, expected) in frames.iter().zip(&flown.frames) {
        assert_eq!(frame.failsafe, expected.failsafe, "{}", expected.header.tick);
    }
    assert!(imported.unused["airspeed"] == flown.frames.len() as u64);

    // The thrust was not recorded: between two samples it counts.
    let found = imported.differences.unwrap();
    assert!(found.rows > 100 && found.velocity.largest < 0.03, "{found:?}");
    assert!(
        found.position.largest < 0.01 && found.attitude.largest < 0.01,
        "{found:?}"
    );

    let beside = folder.path().join("out/reference/run.mcap");
    let states = logged(&beside, Topic::VehicleState, |state: &VehicleState| {
        state.tracked.is_set()
    });
    let state = &flown.states[5000];
    let recorded = states
        .iter()
        .find(|recorded| recorded.state_time_ns >= state.state_time_ns);
    let offset = Vector3::from(recorded.unwrap().position_world) - Vector3::from(state.position_world);
    assert!(offset.norm() < 0.02, "{offset}");
}

#[test]
fn the_estimator_is_replayed_identically_and_another_one_differs() {
    let (_, flown) = flown();
    let folder = tempfile::tempdir().unwrap();
    let log = import(folder.path(), &table(&flown), &[]).unwrap().log;
    let replayed = replay::replay(&log, &replay::Options::default(), None).unwrap();
    assert!(replayed.is_identical(), "{:?}", replayed.first_difference());
    assert_eq!(
        replayed.external_services,
        [ServiceId::Plant, ServiceId::RcOutput]
    );
    let recorded = LogReader::open(&log).unwrap().manifest().scenario.clone();
    let text = scenario_file::to_toml(&recorded).unwrap();
    let sets = ["navigation.field_white=0.05".to_owned()];
    let options = replay::Options {
        services: vec![ServiceId::Estimator],
        changed: Some(scenario_file::load_text(&log, &text, &sets, None).unwrap()),
        ..replay::Options::default()
    };
    let replayed = replay::replay(&log, &options, None).unwrap();
    let difference = replayed.first_difference().unwrap();
    assert!(
        matches!(
            difference.topic,
            Topic::VehicleState | Topic::NavigationInnovations
        ),
        "{difference:?}"
    );
}

#[test]
fn a_sensor_that_is_quicker_than_its_topic_is_refused_or_thinned() {
    let (_, flown) = flown();
    let samples = table(&flown);
    let folder = tempfile::tempdir().unwrap();
    let slow = ["--set", "schedule.period.\"mag/field\"=0.04"];
    let error = import(folder.path(), &samples, &slow).unwrap_err();
    assert!(
        error.contains("flight.csv, line ") && error.contains("mag/field"),
        "{error}"
    );
    assert!(!folder.path().join("out/run.mcap").exists());
    let imported = import(folder.path(), &samples, &[slow[0], slow[1], "--thin"]).unwrap();
    let fields = imported
        .sources
        .iter()
        .find(|source| source.topic == "mag/field")
        .unwrap();
    let measured = flown
        .fields
        .iter()
        .filter(|sample| sample.measured.is_set())
        .count() as u64;
    assert_eq!(fields.samples + fields.left_out, measured);
    assert!(fields.left_out.abs_diff(measured / 2) < 3, "{fields:?}");
}

#[test]
fn a_recording_of_another_place_is_refused_with_the_place() {
    let (_, flown) = flown();
    let folder = tempfile::tempdir().unwrap();
    let error = import(folder.path(), &table(&flown), &["--set", "datum.latitude=47.0"]).unwrap_err();
    assert!(error.contains("48.13715"), "{error}");
}

#[test]
fn a_reference_without_a_row_to_compare_is_refused_or_named() {
    let (scenario, flown) = flown();
    let (samples, folder) = (table(&flown), tempfile::tempdir().unwrap());
    let reference = folder.path().join("states.csv");
    let path = reference.to_str().unwrap();
    std::fs::write(&reference, states(&scenario, &flown)).unwrap();
    for span in [["--from", "100"], ["--to", "0.5"]] {
        let error = import(folder.path(), &samples, &["--reference", path, span[0], span[1]]).unwrap_err();
        assert!(
            error.contains("states.csv: no row is between") && error.contains("its rows are from 11"),
            "{error}"
        );
    }
    // States of another clock, and such that are 9 s too early, when the vehicle was not tracked yet.
    let shifted = |by_us: i64| -> String {
        let text = states(&scenario, &flown);
        let line = |line: &str| match line.split_once(',') {
            Some((time, rest)) if time != "Timestamp" => {
                format!("{},{rest}\n", time.parse::<i64>().unwrap() + by_us)
            }
            _ => format!("{line}\n"),
        };
        text.lines().map(line).collect()
    };
    std::fs::write(&reference, shifted(900_000_000)).unwrap();
    let error = import(folder.path(), &samples, &["--reference", path]).unwrap_err();
    assert!(error.contains("both tables need the same clock"), "{error}");
    assert!(!folder.path().join("out/run.mcap").exists());
    std::fs::write(&reference, shifted(-9_000_000)).unwrap();
    let imported = import(folder.path(), &samples, &["--reference", path, "--to", "9"]).unwrap();
    let rows = imported.untracked_rows.unwrap();
    assert!(imported.differences.is_none() && rows > 50, "{imported:?}");
    let text = shown(&imported);
    let words = format!(
        "nothing of the reference was compared: at {rows} of its rows the estimator did not track the vehicle"
    );
    assert!(text.contains(&words), "{text}");
}

/// A table of two samples of each sensor.
const GOOD: &str = "1000,imu,0,0,-9.81,0,0,0\n1000,mag,0.2,0,0.4\n1000,baro,488.1\n\
                    1000,gps,488103.0,85456073.0,473977508.0,0,0,0\n1000,landed,1.0\n\
                    5000,imu,0,0,-9.81,0,0,0\n";

#[test]
fn each_wrong_line_is_refused_with_its_number() {
    assert!(Recording::read(GOOD).is_ok());
    for (line, reason) in [
        ("6000,imu,0,0,-9.81,0,0\n", "`imu` has 6 numbers, and here are 5"),
        ("6000,imu,0,0,-9.81,0,0,NaN\n", "`NaN` is no finite number"),
        ("6000,imu,0,0,-9.81,0,0,inf\n", "`inf` is no finite number"),
        ("6000,baro,\n", "`` is no finite number"),
        ("-6000,baro,488\n", "`-6000` is no time in whole µs"),
        ("6000.5,baro,488\n", "no time in whole µs"),
        ("6000\n", "there is no kind of sample behind the time"),
        ("6000,Imu,0,0,-9.81,0,0,0\n", "`Imu` is no kind of sample"),
        (
            "5000,imu,0,0,-9.81,0,0,0\n",
            "the time of `imu` goes from 5000 µs (line 6) to 5000 µs",
        ),
        (
            "4000,imu,0,0,-9.81,0,0,0\n",
            "goes from 5000 µs (line 6) to 4000 µs",
        ),
        (
            "6000,gps,488103.0,473977508.0,985456073.0,0,0,0\n",
            "is no place; the order is height (mm), longitude, latitude",
        ),
        ("6000,gps,1,2,3,0,0,0,5,1,1,1\n", "5 is no kind of fix"),
        (
            "6000,gps,1,2,3,0,0,0,1,-1,1,1\n",
            "an accuracy of `gps` is below 0",
        ),
        (
            "6000,gps,1,2,3,0,0,0,1\n",
            "`gps` has 6 or 10 numbers, and here are 7",
        ),
        ("6000,landed,0.5\n", "`landed` is 0 or 1, and not 0.5"),
        ("6000,baro,488", "the file ends within this line"),
    ] {
        let error = Recording::read(&format!("{GOOD}{line}")).unwrap_err();
        assert_eq!(error.line, 7, "{line}");
        assert!(error.reason.contains(reason), "{line}: {error}");
    }
    // Of a clock that steps forward a single line is enough, of any kind.
    for line in [
        "imu,0,0,-9.81,0,0,0",
        "gps,488103,85456073,473977508,0,0,0",
        "baro,488",
        "mag,0.2,0,0.4",
        "landed,1",
        "armed,0",
    ] {
        assert!(Recording::read(&format!("{GOOD}60004000,{line}\n")).is_ok());
        let error = Recording::read(&format!("{GOOD}60006000,{line}\n")).unwrap_err();
        assert_eq!(error.line, 7);
        assert!(
            error
                .reason
                .contains("between 5000 µs (line 6) and 60006000 µs there is no line for 60 s"),
            "{error}"
        );
    }
    for kind in ["imu", "gps", "baro", "mag", "landed"] {
        let others: String = GOOD
            .split_inclusive('\n')
            .filter(|line| !line.contains(kind))
            .collect();
        let WrongLine { line, reason } = Recording::read(&others).unwrap_err();
        assert!(line == 0 && reason.contains(kind), "{reason}");
    }
}

proptest! {
    /// A table that was cut off anywhere is refused, except between two lines.
    #[test]
    fn a_cut_table_is_never_taken_for_a_whole_one(length in 0..GOOD.len()) {
        let cut = &GOOD[..length];
        match Recording::read(cut) {
            Ok(recording) => {
                prop_assert!(cut.ends_with('\n'));
                prop_assert_eq!(recording.imu.len(), 1);
            }
            Err(error) => {
                prop_assert!(error.line == 0 || error.line == cut.lines().count());
            }
        }
    }

    #[test]
    fn no_table_is_too_strange(text in "[0-9,a-z.\n-]{0,200}") {
        let _ = Recording::read(&text);
    }
}

/// Returns the table with the numbers of one kind changed.
fn with(samples: &str, kind: &str, change: impl Fn(usize, f64) -> f64) -> String {
    let changed = samples.lines().map(|line| {
        let mut words = line.split(',').map(str::to_owned).collect::<Vec<_>>();
        if words[1] == kind {
            for (index, word) in words[2..].iter_mut().enumerate() {
                *word = change(index, word.parse().unwrap()).to_string();
            }
        }
        words.join(",") + "\n"
    });
    changed.collect()
}

#[test]
fn other_units_and_exchanged_columns_are_refused_with_the_unit_they_look_like() {
    let samples = table(&flown().1);
    let folder = tempfile::tempdir().unwrap();
    let refusal = |kind: &str, change: &dyn Fn(usize, f64) -> f64| {
        import(folder.path(), &with(&samples, kind, change), &[]).unwrap_err()
    };
    let in_g = |index: usize, value: f64| if index < 3 { value / 9.80665 } else { value };
    let in_degrees = |index: usize, value: f64| {
        if index < 3 {
            value
        } else {
            1e3 * value.to_degrees()
        }
    };
    let in_metres = |index: usize, value: f64| if index == 0 { 1e-3 * value } else { value };
    for (kind, change, said) in [
        (
            "imu",
            &in_g as &dyn Fn(usize, f64) -> f64,
            "look like g: multiply by 9.8",
        ),
        ("imu", &in_degrees, "if it is in °/s, divide by 57.2958"),
        ("mag", &|_, value| 100.0 * value, "look like µT: multiply by 0.01"),
        (
            "mag",
            &|_, value| 1e5 * value,
            "look like nT: multiply by 0.00001",
        ),
        (
            "gps",
            &|index, value| if index > 6 { 1e3 * value } else { value },
            "look like mm: multiply by 0.001",
        ),
        ("mag", &|_, value| 7.0 * value, "give them in G"),
    ] {
        let refusal = refusal(kind, change);
        assert!(
            refusal.contains("line") && refusal.contains(said),
            "{said}: {refusal}"
        );
    }
    let in_degrees = |index: usize, value: f64| {
        if index == 1 || index == 2 {
            1e-7 * value
        } else {
            value
        }
    };
    assert!(refusal("gps", &in_degrees).contains("look like degrees: multiply by 1e7"));
    for (factor, said) in [
        (1e-3, "look like ms: multiply by 1000"),
        (1e3, "look like ns: multiply by 0.001"),
    ] {
        let lines = samples.lines().map(|line| {
            let (time, rest) = line.split_once(',').unwrap();
            let time = time.parse::<f64>().unwrap() * factor;
            format!("{time:.0},{rest}\n")
        });
        let refused = import(folder.path(), &lines.collect::<String>(), &[]).unwrap_err();
        assert!(refused.contains(said), "{refused}");
    }
    let refused = refusal("gps", &in_metres);
    assert!(
        refused.contains("heights of `gps` are in mm: multiply"),
        "{refused}"
    );
    // With a datum that was copied from such a table it is the barometer that tells.
    let climb = "6000,baro,495.1\n6000,gps,488110,85456073.0,473977508.0,0,0,0\n";
    let refused = Recording::read(&format!("{GOOD}{climb}")).unwrap_err();
    assert!(
        refused.reason.contains("if they are in m, multiply by 1000"),
        "{refused}"
    );

    let lines = samples.lines().map(|line| {
        let mut words: Vec<_> = line.split(',').collect();
        if words[1] == "gps" {
            words.swap(3, 4);
        }
        words.join(",") + "\n"
    });
    let refusal = import(folder.path(), &lines.collect::<String>(), &[]).unwrap_err();
    assert!(
        refusal.contains("longitude and latitude of `gps` are exchanged"),
        "{refusal}"
    );
}
