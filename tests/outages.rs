//! Outages that a scenario plans: exact in simulated time, the same in every host, and what they do to the flight.

use crate::common;

use std::convert::Infallible;

use common::{Place, complaint, fly_to_the_end, output, scenario, succeed};
use flight::interrupt::Interrupt;
use flight::{Outcome, in_process};
use host::in_process::TickSink;
use scenario::EdgeName;
use shared_types::samples::{ControlAdaptation, ControlCommand, VehicleTruth};
use shared_types::service::header_of;
use shared_types::{ServiceId, Topic};
use zerocopy::FromBytes;

fn log(place: &Place, out: &str) -> Vec<u8> {
    std::fs::read(place.path(out).join("run.mcap")).unwrap()
}

fn fault(service: ServiceId, at: f64, lasts: f64, more: &str) -> String {
    format!("{{at = {at:?}, service = \"{service}\", for = {lasts:?}, {more}}}")
}

const OFF_WARM: &str = "kind = \"off\"";
const OFF_COLD: &str = "kind = \"off\", state = \"cold\"";
const FREEZE: &str = "kind = \"freeze\"";

/// Services that can fail.
const SERVICES: [ServiceId; 4] = [
    ServiceId::Estimator,
    ServiceId::PathGenerator,
    ServiceId::Controller,
    ServiceId::RcOutput,
];

#[test]
fn outages_have_the_same_bytes_in_one_process_and_in_processes_that_really_die() {
    let place = Place::new();
    let mut faults = Vec::new();
    for (number, service) in (0..).zip(SERVICES) {
        let at = 0.2 + 0.15 * f64::from(number);
        for (kind, shift) in [(OFF_WARM, 0.0), (OFF_COLD, 0.05), (FREEZE, 0.1)] {
            faults.push(fault(service, ((at + shift) * 1e3_f64).round() / 1e3, 0.02, kind));
        }
    }
    // Two at once, and one for good.
    faults.push(fault(ServiceId::Estimator, 0.85, 0.03, OFF_COLD));
    faults.push(fault(ServiceId::Controller, 0.86, 0.05, OFF_WARM));
    faults.push("{at = 0.95, service = \"path_generator\", kind = \"off\"}".to_owned());
    let setting = format!("fault=[{}]", faults.join(", "));
    let crashes = [
        "--crash",
        "controller@860:recovering",
        "--crash",
        "estimator@852:before-ports",
    ];
    for (flight, more) in [
        ("processes", &[][..]),
        ("killed", &crashes),
        ("one", &["--host", "inprocess"]),
    ] {
        let more = [&["--set", &setting], more].concat();
        fly_to_the_end(&mut place.short_flight(flight, 1.0, &more));
        assert!(log(&place, flight) == log(&place, "processes"), "{flight}");
        let out = format!("rig-{flight}");
        fly_to_the_end(&mut place.rig_flight(&out, 1.0, &more));
        assert!(log(&place, &out) == log(&place, "rig-processes"), "{out}");
    }
    succeed(&mut place.short_flight("undisturbed", 1.0, &["--host", "inprocess"]));
    assert!(log(&place, "undisturbed") != log(&place, "one"));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// Every fault of every edge for some milliseconds, one after the other, the edges' each a little later than those of
/// the one before; samples are late by half as much.
fn faults_of_all_edges(milliseconds: u32) -> String {
    let (lasts, by) = (f64::from(milliseconds) / 1e3, f64::from(milliseconds / 2) / 1e3);
    let mut faults = Vec::new();
    let flown = scenario_file::load(&scenario("fig1"), &[], None).unwrap();
    let edges = EdgeName::all().filter(|edge| flown.has_samples(*edge));
    for (edge, number) in edges.zip(0..) {
        let numbers = edge
            .topic
            .members()
            .into_iter()
            .find(shared_types::sample::Member::is_number);
        let field = numbers.expect("every topic of an edge has numbers").name;
        let kinds = [
            format!("kind = \"delay\", by = {by:?}"),
            "kind = \"intermittent\", fraction = 0.5".to_owned(),
            "kind = \"stuck\"".to_owned(),
            format!("kind = \"wrong\", field = \"{field}\", scale = 0.9, bias = 0.01"),
            "kind = \"garbage\", range = 0.01".to_owned(),
            "kind = \"intermittent\", fraction = 1.0".to_owned(),
        ];
        for (kind, place) in kinds.iter().zip(0..) {
            let at = f64::from(100 + 120 * place + 10 * number) / 1e3;
            faults.push(format!(
                "{{at = {at:?}, edge = \"{edge}\", for = {lasts:?}, {kind}}}"
            ));
        }
    }
    faults.join(", ")
}

#[test]
fn faults_of_edges_have_the_same_bytes_in_one_process_and_in_processes_also_when_they_are_killed() {
    let place = Place::new();
    let outages = [
        fault(ServiceId::Estimator, 0.25, 0.02, OFF_WARM),
        fault(ServiceId::Controller, 0.38, 0.04, OFF_WARM),
        fault(ServiceId::RcOutput, 0.4, 0.03, FREEZE),
    ];
    // The ideal flight commands torque, without which nothing holds the attitude: it takes less.
    let [ideal, rig] = [12, 60].map(|milliseconds| {
        let edges = faults_of_all_edges(milliseconds);
        format!("fault=[{edges}, {}]", outages.join(", "))
    });
    let mut crashes = Vec::new();
    for (service, number) in ServiceId::ALL.into_iter().zip(0..) {
        for tick in (140 + 7 * number..1000).step_by(120) {
            crashes.extend(["--crash".to_owned(), format!("{service}@{tick}:after-step")]);
        }
    }
    let crashes: Vec<_> = crashes.iter().map(String::as_str).collect();
    for (flight, more) in [
        ("processes", &[][..]),
        ("one", &["--host", "inprocess"]),
        ("killed", &crashes),
    ] {
        let of_ideal = [&["--set", &ideal], more].concat();
        fly_to_the_end(&mut place.short_flight(flight, 1.0, &of_ideal));
        assert!(log(&place, flight) == log(&place, "processes"), "{flight}");
        let out = format!("rig-{flight}");
        let of_rig = [&["--set", &rig], more].concat();
        fly_to_the_end(&mut place.rig_flight(&out, 1.0, &of_rig));
        assert!(log(&place, &out) == log(&place, "rig-processes"), "{out}");
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// The port of an input must not fill although no sample of it is ever due.
#[test]
fn an_input_that_loses_every_sample_from_the_start_on_blocks_no_process() {
    let place = Place::new();
    let flown = scenario_file::load(&scenario("fig1"), &[], None).unwrap();
    let edges = EdgeName::all().filter(|edge| flown.has_samples(*edge));
    for (edge, number) in edges.zip(0..) {
        let setting = format!("fault=[{{at=0.0, edge=\"{edge}\", kind=\"intermittent\", fraction=1.0}}]");
        let outs = ["processes", "one"].map(|host| format!("{host}-{number}"));
        for (out, host) in outs.iter().zip(["lockstep", "inprocess"]) {
            let more = ["--set", &setting, "--host", host];
            fly_to_the_end(&mut place.rig_flight(out, 1.0, &more));
        }
        assert!(log(&place, &outs[0]) == log(&place, &outs[1]), "{edge}");
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// Looks at a flight tick by tick.
#[derive(Default)]
struct Flight {
    /// Ticks at which commands were published.
    commands: Vec<u64>,
    /// Largest distance from the path's plane-free place in hover, m.
    farthest: f64,
    /// m̂ at every tick at which it was published.
    masses: Vec<(u64, f64)>,
}

impl TickSink for Flight {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        let tick = header_of(bytes).tick;
        match topic {
            Topic::ControlCommand => {
                assert!(ControlCommand::read_from_bytes(bytes).is_ok());
                self.commands.push(tick);
            }
            Topic::ControlAdaptation => {
                let adaptation = ControlAdaptation::read_from_bytes(bytes).unwrap();
                self.masses.push((tick, adaptation.mass_estimate));
            }
            Topic::VehicleTruth => {
                let [x, y, z] = VehicleTruth::read_from_bytes(bytes).unwrap().position_world;
                self.farthest = self.farthest.max(libm::hypot(libm::hypot(x, y), z + 1.2));
            }
            _ => {}
        }
        Ok(())
    }
}

/// Fig. 1's vehicle in hover, begun where it hovers, with an outage.
fn hover(outage: &str) -> Flight {
    let settings = [
        "duration=3.0",
        "vehicle.change=[]",
        "path.curve={hover={position=[0.0, 0.0, -1.2]}}",
        "vehicle.initial.position=[0.0, 0.0, -1.2]",
        "controller.initial.mass=0.25",
        &format!("fault=[{outage}]"),
    ];
    let settings = settings.map(str::to_owned);
    let scenario = scenario_file::load(&scenario("fig1"), &settings, None).unwrap();
    let mut flight = Flight::default();
    let ending = in_process::fly(&scenario, &mut flight, &Interrupt::never()).unwrap();
    assert!(matches!(ending.outcome, Outcome::Completed));
    flight
}

#[test]
fn nothing_is_published_in_an_outage_and_a_cold_service_begins_anew() {
    for (kind, forgets) in [(OFF_WARM, false), (OFF_COLD, true), (FREEZE, false)] {
        let flight = hover(&fault(ServiceId::Controller, 1.0, 0.05, kind));
        let expected: Vec<u64> = (0..1000).chain(1050..=3000).collect();
        assert_eq!(flight.commands, expected, "{kind}");
        let mass_at = |tick: u64| flight.masses.iter().find(|(at, _)| *at == tick).unwrap().1;
        assert!((mass_at(999) - 0.25).abs() > 1e-3, "it has learned");
        assert_eq!(mass_at(1050) == mass_at(0), forgets, "{kind}");
        assert!(flight.farthest < 0.5, "{}", flight.farthest);
    }
}

#[test]
fn an_outage_for_good_is_one() {
    let flight = hover("{at = 2.9, service = \"controller\", kind = \"off\"}");
    assert_eq!(flight.commands.last(), Some(&2899));
}

#[test]
fn outages_that_cannot_be_are_refused_with_the_place() {
    let place = Place::new();
    for (faults, pieces) in [
        (
            fault(ServiceId::Plant, 0.5, 0.1, OFF_WARM),
            ["fault.0.service", "cannot fail"],
        ),
        (
            "{at = 0.5, edge = \"vehicle/state -> controler\", kind = \"stuck\"}".to_owned(),
            ["fault.0.edge", "did you mean `vehicle/state -> controller`"],
        ),
        (
            "{at = 0.5, edge = \"vehicle/state -> controller\", kind = \"off\"}".to_owned(),
            ["fault.0.edge", "has no `edge`"],
        ),
        (
            "{at = 0.5, edge = \"vehicle/state -> controller\", kind = \"delay\"}".to_owned(),
            ["fault.0.by", "needs it"],
        ),
        (
            "{at = 0.5, edge = \"rc/frame -> plant\", kind = \"intermittent\", fraction = 1.5}".to_owned(),
            ["fault.0.fraction", "above 0 and at most 1"],
        ),
        (
            "{at = 0.5, edge = \"rc/frame -> plant\", kind = \"wrong\", field = \"mode\", bias = 1.0}"
                .to_owned(),
            ["fault.0.field", "have no number `mode`"],
        ),
        (
            "{at = 0.5, edge = \"rc/frame -> plant\", kind = \"wrong\", field = \"thrust\"}".to_owned(),
            ["fault.0", "the fault has no effect"],
        ),
        (
            "{at = 0.5, edge = \"rc/frame -> plant\", kind = \"garbage\", range = -1.0}".to_owned(),
            ["fault.0.range", "not above 0"],
        ),
        (
            "{at = 0.5, service = \"controler\", kind = \"off\"}".to_owned(),
            ["fault.0.service", "did you mean `controller`"],
        ),
        (
            fault(ServiceId::Controller, 5.0, 0.1, OFF_WARM),
            ["fault.0.at", "after the end"],
        ),
        (
            fault(ServiceId::Controller, 0.5, -0.1, OFF_WARM),
            ["fault.0.for", "above 0"],
        ),
        (
            fault(ServiceId::Controller, 0.5, 0.0123, OFF_WARM),
            ["fault.0.for", "whole number"],
        ),
        (
            fault(
                ServiceId::Controller,
                0.5,
                0.1,
                "kind = \"freeze\", state = \"cold\"",
            ),
            ["fault.0.state", "keeps its state"],
        ),
        (
            [
                fault(ServiceId::Controller, 0.5, 0.1, OFF_WARM),
                fault(ServiceId::Controller, 0.55, 0.1, FREEZE),
            ]
            .join(", "),
            ["fault.1.at", "out already"],
        ),
    ] {
        let setting = format!("fault=[{faults}]");
        let refused = output(&mut place.short_flight("refused", 1.0, &["--set", &setting]));
        let errors = complaint(&refused);
        assert_eq!(refused.status.code(), Some(2), "{errors}");
        for piece in pieces {
            assert!(errors.contains(piece), "{piece} is not in {errors}");
        }
    }
}

/// Estimates of a law: the tick, b̂ (m/s²) and m̂ (kg).
#[derive(Default)]
struct Estimates(Vec<(u64, [f64; 3], f64)>);

impl TickSink for Estimates {
    type Error = Infallible;

    fn wants(&self, topic: Topic) -> bool {
        topic == Topic::ControlAdaptation
    }

    fn sample(&mut self, _topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        let adaptation = ControlAdaptation::read_from_bytes(bytes).unwrap();
        let estimates = (adaptation.disturbance_hat_world, adaptation.mass_estimate);
        self.0.push((adaptation.header.tick, estimates.0, estimates.1));
        Ok(())
    }
}

impl Estimates {
    /// Largest change of b̂ (m/s²) or m̂ (g) within the seven holds after the first of some steps.
    fn change(steps: &[(u64, [f64; 3], f64)]) -> f64 {
        let (begin, disturbance, mass) = steps[0];
        let steps = steps.iter().take_while(|(tick, ..)| *tick <= begin + 7 * 22);
        let changes = steps.map(|(_, other, other_mass)| {
            let squares = disturbance
                .iter()
                .zip(other)
                .map(|(one, other)| (one - other) * (one - other));
            squares.sum::<f64>().sqrt().max(1e3 * (mass - other_mass).abs())
        });
        changes.fold(0.0, f64::max)
    }
}

#[test]
fn laws_that_take_differences_do_not_learn_from_those_over_steps_that_were_left_out() {
    for law in ["l1", "immersion_mass"] {
        let settings = [
            "duration=20.4",
            "vehicle.change=[]",
            &format!("controller.law={law}"),
            &format!("fault=[{}]", fault(ServiceId::Controller, 20.02, 0.11, FREEZE)),
        ];
        let settings = settings.map(str::to_owned);
        let scenario = scenario_file::load(&scenario("fig3_6"), &settings, None).unwrap();
        let mut estimates = Estimates::default();
        in_process::fly(&scenario, &mut estimates, &Interrupt::never()).unwrap();
        let steps = estimates.0;
        let last = steps.iter().rposition(|(tick, ..)| *tick < 20_020).unwrap();
        assert_eq!(steps[last + 1].0 - steps[last].0, 132, "five steps are left out");
        // In the two seconds before, without a gap: noise, and what the air does.
        let usual = (last - 96..last - 7).map(|first| Estimates::change(&steps[first..]));
        let usual = usual.fold(0.0, f64::max);
        let found = Estimates::change(&steps[last..]);
        assert!(found <= usual, "{law}: {found}, and {usual} without a gap");
    }
}
