//! Every control law flies, is restarted and is replayed as the paper's: nothing of it depends on the process.

use std::ops::ControlFlow;

use ::scenario::Scenario;
use flight::in_process;
use flight::interrupt::Interrupt;
use host::in_process::TickSink;
use run_log::LogError;
use serde_json::Value;
use shared_types::Topic;

use crate::common::{Place, scenario, succeed};
use crate::documentation::{assert_same, read, section};

/// The baselines that command body rates.
const BASELINES: [&str; 7] = [
    "geometric_pid",
    "l1",
    "indi",
    "nf_constant",
    "px4",
    "immersion_mass",
    "nmpc",
];

/// Extensions of the paper's law.
const EXTENSIONS: [&str; 3] = [
    "controller.prediction_gain=1.9",
    "controller.harmonics={}",
    "controller.disturbance_observer=true",
];

/// Flies a law from a scenario; its vehicle becomes heavier in the flight.
fn fly(place: &Place, (base, law): (&str, &str), out: &str, more: &[&str]) -> Vec<u8> {
    let path = scenario(base);
    let mut command = place.gerono(&["run", path.to_str().unwrap(), "--quiet", "--out", out]);
    let sets = ["duration=5.0", "vehicle.change.0.at=2.0", law];
    command
        .args(sets.iter().flat_map(|set| ["--set", set]))
        .args(more);
    succeed(&mut command);
    std::fs::read(place.path(out).join("run.mcap")).unwrap()
}

#[test]
fn every_law_gives_the_same_bytes_in_one_process_and_in_processes_that_die_and_can_be_replayed() {
    let baselines = BASELINES.map(|law| format!("controller.law={law}"));
    let in_the_laboratory = EXTENSIONS.into_iter().chain(baselines.iter().map(String::as_str));
    // Gains that change before each death: a process that replaces the dead one has them too.
    let planned = "controller.change=[{at = 2.1, k1 = 3.0}, {at = 3.2, k2 = 5.0, lambda_disturbance = [9.0, 9.0, 12.0]}]";
    let with_torque = [
        "controller.harmonics={}",
        "controller.law=immersion_inertia",
        planned,
    ];
    let flights = in_the_laboratory
        .chain([planned])
        .map(|law| ("fig3_6", law))
        .chain(with_torque.map(|law| ("fig1", law)));
    for law in flights {
        let place = Place::new();
        let alone = fly(&place, law, "alone", &["--host", "inprocess"]);
        // The controller dies twice while it learns of the heavier vehicle.
        let deaths = [
            "--crash",
            "controller@2200:after-step",
            "--crash",
            "controller@3300:checkpointing",
        ];
        let died = fly(&place, law, "died", &deaths);
        assert!(alone == died, "{law:?}: the logs differ");
        succeed(&mut place.gerono(&["replay", "died", "--quiet"]));
    }
}

/// Gains of the paper's law beside those of the scenario: Λb and κ.
const GAINS: [(&str, &str); 4] = [("1", "0"), ("18", "0"), ("8", "1.9"), ("40", "0.3")];

/// Rows of the page about laws: `fig3_6` as it is committed, with the law and the paper's law's gains.
fn table() -> String {
    let place = Place::new();
    let path = scenario("fig3_6");
    let baselines = BASELINES.into_iter().map(|law| (law, ("", "")));
    let flights = GAINS
        .map(|gains| ("adaptive", gains))
        .into_iter()
        .chain(baselines);
    let mut table =
        "| law | largest of the last 5 s before the coins | RMS after | largest after | body rate, rms |\n"
            .to_owned();
    table += "| --- | --- | --- | --- | --- |\n";
    for (number, (law, (learning, prediction))) in flights.enumerate() {
        let out = format!("flight{number}");
        let mut command = place.gerono(&["run", path.to_str().unwrap(), "--host", "inprocess", "--quiet"]);
        command.args(["--out", &out, "--set", &format!("controller.law={law}")]);
        if law == "adaptive" {
            let rates = format!("controller.lambda_disturbance=[{learning}.0, {learning}.0, {learning}.0]");
            let prediction = format!("controller.prediction_gain={prediction}");
            command.args(["--set", &rates, "--set", &prediction]);
        }
        succeed(&mut command);
        let summary = std::fs::read(place.path(&out).join("summary.json")).unwrap();
        let summary: Value = serde_json::from_slice(&summary).unwrap();
        let number = |pointer: &str| summary.pointer(pointer).and_then(Value::as_f64).unwrap();
        let cm = |pointer: &str| format!("{:.2}", 100.0 * number(pointer));
        let name = match (law, prediction) {
            ("adaptive", "0") => format!("`{law}`, Λb = {learning}"),
            ("adaptive", _) => format!("`{law}`, Λb = {learning}, κ = {prediction} s"),
            _ => format!("`{law}`"),
        };
        table += &format!(
            "| {name} | {} | {} | {} | {:.2} |\n",
            cm("/phases/0/ultimate"),
            cm("/phases/1/metrics/rmse"),
            cm("/phases/1/metrics/max"),
            number("/metrics/body_rate_rms")
        );
    }
    table
}

/// Rows of the page about what repeats with the path: laws on the eight at twice the speed, in drag.
fn harmonics_table() -> String {
    let laws = [
        ("`adaptive`, Λb = 18", "controller.k1=4.0"),
        ("`adaptive`, Λb = 18, N = 8, λa = 1", "controller.harmonics={}"),
        (
            "`adaptive`, Λb = 18, N = 3, λa = 1",
            "controller.harmonics={count=3}",
        ),
        ("`indi`", "controller.law=indi"),
        ("`nmpc`", "controller.law=nmpc"),
    ];
    let mut table = "| law | largest, cm | body rate, rms, rad/s |\n| --- | --- | --- |\n".to_owned();
    let place = Place::new();
    let path = scenario("fig3_6");
    for (number, (name, law)) in laws.into_iter().enumerate() {
        let out = format!("repeating{number}");
        let mut command = place.gerono(&["run", path.to_str().unwrap(), "--host", "inprocess", "--quiet"]);
        let sets = [
            law,
            "path.speed=2.0",
            "vehicle.drag=[0.06, 0.06, 0.02]",
            "vehicle.parasitic_drag=0.004",
            "vehicle.change=[]",
            "duration=240.0",
        ];
        command
            .args(["--out", &out])
            .args(sets.iter().flat_map(|set| ["--set", set]));
        succeed(&mut command);
        let summary = std::fs::read(place.path(&out).join("summary.json")).unwrap();
        let summary: Value = serde_json::from_slice(&summary).unwrap();
        let number = |pointer: &str| summary.pointer(pointer).and_then(Value::as_f64).unwrap();
        let largest = 100.0 * number("/phases/0/ultimate");
        table += &format!(
            "| {name} | {largest:.2} | {:.2} |\n",
            number("/metrics/body_rate_rms")
        );
    }
    table
}

#[test]
fn the_page_about_laws_shows_what_is_learned_of_a_path_that_repeats() {
    let document = read("docs/laws.md");
    assert_same(
        "docs/laws.md",
        section(&document, "harmonics"),
        &harmonics_table(),
    );
}

#[test]
fn the_page_about_laws_shows_what_they_reach() {
    let document = read("docs/laws.md");
    assert_same("docs/laws.md", section(&document, "laws"), &table());
}

/// Near its path a vehicle that follows flies as one that tracks with the same start of the clock: docs/following.md.
#[test]
fn following_is_tracking_as_long_as_the_path_does_not_wait() {
    let place = Place::new();
    let path = scenario("trajectory_tracking");
    let truth = |out: &str, sets: &[&str]| {
        let mut command = place.gerono(&["run", path.to_str().unwrap(), "--host", "inprocess", "--quiet"]);
        command.args(["--out", out, "--set", "duration=5.0"]);
        command.args(sets.iter().flat_map(|set| ["--set", set]));
        succeed(&mut command);
        succeed(&mut place.gerono(&["export", out, "--csv", "--topic", "vehicle/truth"])).stdout
    };
    let following = "path.mode=following";
    let never_waits = ["path.alpha1=20.0", "path.alpha2=30.0"];
    let ramped = truth("ramped", &[following]);
    assert!(ramped == truth("never_waits", &[following, never_waits[0], never_waits[1]]));
    let jump = truth("jump", &[following, "path.initial_gamma_dot=1.0"]);
    assert!(jump == truth("tracking", &[]));
    assert!(ramped != jump);
}

/// The samples of a flight, one after another.
#[derive(Default)]
struct Samples(Vec<u8>);

impl TickSink for Samples {
    type Error = LogError;

    fn sample(&mut self, _: Topic, bytes: &[u8]) -> Result<(), LogError> {
        self.0.extend_from_slice(bytes);
        Ok(())
    }

    fn end_tick(&mut self, _: u64) -> Result<ControlFlow<()>, LogError> {
        Ok(ControlFlow::Continue(()))
    }
}

/// Other values of keys of `[controller]`.
const OTHERS: [(&str, &str); 32] = [
    ("k1", "4.3"),
    ("k2", "4.3"),
    ("k3", "12.0"),
    ("beta", "1.3e-3"),
    ("delta", "0.09"),
    ("sigma_max", "1.2"),
    ("lambda_mass", "0.2"),
    ("lambda_disturbance", "[1.5, 1.5, 1.5]"),
    ("lambda_inertia", "1e-9"),
    ("remove_offset", "false"),
    ("initial.mass", "0.21"),
    ("initial.inertia", "[9e-4, 9e-4, 1.3e-3]"),
    ("rates.yaw_kp", "3.0"),
    ("rates.yaw_ki", "0.4"),
    ("rates.roll_out", "false"),
    ("rates.roll_out_step", "2e-3"),
    ("rates.unexplained", "false"),
    ("rates.lag_inversion", "false"),
    ("baseline.position_gain", "30.0"),
    ("baseline.velocity_gain", "11.0"),
    ("baseline.attitude_gain", "30.0"),
    ("baseline.error_limit", "0.1"),
    ("baseline.disturbance_max", "0.01"),
    ("baseline.integral_gain", "12.0"),
    ("baseline.l1_bandwidth", "10.0"),
    ("baseline.composite_tracking_gain", "5.0"),
    ("baseline.composite_prediction_gain", "10.0"),
    ("baseline.cascade_scale", "3.0"),
    ("baseline.immersion_gain", "0.3"),
    ("baseline.rate_gain", "100.0"),
    ("baseline.inertia_gain", "0.1"),
    ("baseline.nmpc_rate_weight", "0.1"),
];

#[test]
fn a_law_uses_those_gains_alone_that_an_argument_may_state_for_it() {
    let with_torque = [("fig1", "adaptive"), ("fig1", "immersion_inertia")];
    let with_rates = BASELINES
        .into_iter()
        .chain(["adaptive"])
        .map(|law| ("fig3_6", law));
    for (base, law) in with_rates.chain(with_torque) {
        let path = scenario(base);
        let flown = |sets: &[String]| scenario_file::load(&path, sets, None);
        let stated = [
            "duration=4.0".to_owned(),
            "vehicle.change=[{at = 2.0, mass = 0.21}]".to_owned(),
            "vehicle.turbulence={deviation = 0.3, correlation_time = 0.5}".to_owned(),
            format!("controller.law={law}"),
        ];
        let samples = |scenario: &Scenario| {
            let mut samples = Samples::default();
            in_process::fly(scenario, &mut samples, &Interrupt::never()).unwrap();
            samples.0
        };
        let known = flown(&stated).unwrap();
        let kind = known.controller.law;
        let as_stated = samples(&known);
        let text = scenario_file::to_toml(&known).unwrap();
        let has_rates = known.controller.rates.is_some();
        for (key, value) in OTHERS
            .into_iter()
            .filter(|(key, _)| has_rates || !(key.starts_with("rates") || *key == "remove_offset"))
        {
            // In the file, where it is for the laws of the day that use it.
            let mut document: toml::Table = toml::from_str(&text).unwrap();
            let mut place = document.get_mut("controller").unwrap();
            for name in key.split('.') {
                let table = place.as_table_mut().unwrap();
                place = table.entry(name).or_insert_with(|| toml::Table::new().into());
            }
            *place = toml::from_str::<toml::Table>(&format!("v = {value}")).unwrap()["v"].clone();
            let changed = toml::to_string(&document).unwrap();
            let changed = scenario_file::load_text(&path, &changed, &[], None).unwrap();
            let names: Vec<_> = key.split('.').collect();
            let uses = kind.uses(&names);
            assert_eq!(samples(&changed) != as_stated, uses, "{law} in {base}: {key}");
            // As an argument.
            let setting = format!("controller.{key}={value}");
            let stated = flown(&[&stated[..], &[setting]].concat());
            match stated {
                Ok(_) => assert!(uses, "{law} in {base}: {key}"),
                Err(error) => {
                    assert!(
                        !uses && format!("{error:#}").contains("does not use it"),
                        "{error:#}"
                    );
                }
            }
        }
    }
}
