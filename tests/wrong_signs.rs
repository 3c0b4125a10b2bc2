//! Signs and axes that are stated wrongly, one at a time and in pairs, in a simulated laboratory: what is said of them, and how
//! high the vehicle comes.
//!
//! `GERONO_SIGNS=all` flies all of them and prints what docs/simulated_flights.md sums up; otherwise some of each kind are flown.

use crate::common;

use std::f64::consts::{FRAC_PI_2, PI};

use std::time::{Duration, Instant};

use common::pilot::ask;
use common::ports::free_port;
use common::world::{World, arguments, kept_time, samples};
use common::{Place, begin, complaint, finish, succeed, until};
use shared_types::samples::VehicleTruth;

/// Height that no vehicle reaches with a wrong sign or axis, m.
const LOW: f64 = 0.1;

/// Time after arming for which a flight is watched, s.
const WATCHED: f64 = 4.0;

/// Time for which arming is asked for.
const PATIENCE: Duration = Duration::from_secs(4);

/// Something that the scenario of the flight states wrongly.
#[derive(Clone, Copy, PartialEq)]
enum Wrong {
    /// Reversed sticks, by their letters.
    Reversed(char),
    /// Channels of roll and pitch are exchanged.
    Exchanged,
    /// The body was created turned about the vertical, rad.
    Body(f64),
    /// Another axis of the cameras points up.
    UpAxis,
}

const ALL: [Wrong; 9] = [
    Wrong::Reversed('A'),
    Wrong::Reversed('E'),
    Wrong::Reversed('R'),
    Wrong::Reversed('T'),
    Wrong::Exchanged,
    Wrong::Body(FRAC_PI_2),
    Wrong::Body(-FRAC_PI_2),
    Wrong::Body(PI),
    Wrong::UpAxis,
];

/// Settings of a flight in which all this is wrong; `None` if two of them state the same.
fn settings_of(wrong: &[Wrong]) -> Option<Vec<String>> {
    let is_twice = |of: fn(&Wrong) -> bool| wrong.iter().filter(|wrong| of(wrong)).count() > 1;
    if is_twice(|wrong| matches!(wrong, Wrong::Body(_))) {
        return None;
    }
    let letters: String = wrong
        .iter()
        .filter_map(|wrong| match wrong {
            Wrong::Reversed(letter) => Some(*letter),
            _ => None,
        })
        .collect();
    let mut settings = vec![format!("rc_output.transmitter.reversed='{letters}'")];
    settings.extend(wrong.iter().filter_map(|wrong| match wrong {
        Wrong::Reversed(_) => None,
        Wrong::Exchanged => Some("rc_output.transmitter.order='EATR'".to_owned()),
        Wrong::Body(yaw) => Some(format!(
            "motion_capture.body_from_markers={{roll_pitch_yaw = [{PI:?}, 0.0, {yaw:?}]}}"
        )),
        Wrong::UpAxis => Some(format!(
            "motion_capture.world_from_capture={{roll_pitch_yaw = [{FRAC_PI_2:?}, 0.0, 0.0]}}"
        )),
    }));
    Some(settings)
}

fn name_of(wrong: Wrong) -> String {
    match wrong {
        Wrong::Reversed('A') => "roll reversed".to_owned(),
        Wrong::Reversed('E') => "pitch reversed".to_owned(),
        Wrong::Reversed('R') => "yaw reversed".to_owned(),
        Wrong::Reversed(_) => "thrust reversed".to_owned(),
        Wrong::Exchanged => "roll and pitch exchanged".to_owned(),
        Wrong::Body(yaw) => format!("body turned by {:.0}°", yaw.to_degrees()),
        Wrong::UpAxis => "another up axis".to_owned(),
    }
}

/// Result of a flight.
struct Flown {
    /// First sentence about it: why it was not armed, or what is wrong.
    says: String,
    /// Greatest height of the vehicle above the ground, m.
    height: f64,
    /// What killed the motors, if they were killed.
    killed_by: String,
    /// Time from the take-off to the stop of the motors, s.
    stopped_after: Option<f64>,
}

/// Asks for arming for some seconds: at first the cameras have not been seen for long. Returns the last refusal, if none was
/// granted.
fn arm(place: &Place) -> Option<String> {
    let began = Instant::now();
    loop {
        let asked = place.gerono(&["arm"]).output().unwrap();
        if asked.status.success() {
            return None;
        }
        if began.elapsed() > PATIENCE {
            return Some(complaint(&asked));
        }
    }
}

/// Flies from the ground with this stated wrongly in the flight; the laboratory itself is right. `None` if the machine stood still.
fn fly(wrong: &[Wrong], more: &[String]) -> Option<Flown> {
    let place = Place::in_real_time();
    let laboratory = vec![
        format!("motion_capture.port={}", free_port()),
        format!("rc_output.transmitter.device='{}'", place.path("radio").display()),
        "flight.spool_up=0.2".to_owned(),
        "flight.yaw_test=0.2".to_owned(),
    ];
    let settings = [&laboratory, &settings_of(wrong)?, more].concat();
    let simulated = World::begin(&place, &laboratory, &["--out", "world"]);
    until("the device", || place.path("radio").exists().then_some(()));
    let mut run = begin(&mut place.gerono(&arguments(
        "run",
        &settings,
        &["--host", "realtime", "--out", "flight"],
    )));
    let refused = arm(&place);
    if refused.is_none() {
        let armed_at = place.look().map_or(0.0, |snapshot| snapshot.time);
        ask("the end of the take-off", || {
            if run.try_wait().unwrap().is_some() {
                return Some(());
            }
            let snapshot = place.look()?;
            (snapshot.killed || snapshot.time > armed_at + WATCHED).then_some(())
        });
    }
    // One that has landed has ended.
    if run.try_wait().unwrap().is_none() {
        for request in ["kill", "stop"] {
            succeed(&mut place.gerono(&[request]));
        }
    }
    finish(run);
    simulated.end();
    let summary = place.summary("flight");
    let phases = summary["flight"].as_array().cloned().unwrap_or_default();
    let begins = |name: &str| {
        let phase = phases.iter().rev().find(|phase| phase["phase"] == name)?;
        phase["begins"].as_f64()
    };
    let truths: Vec<VehicleTruth> = samples(&place.log("world"));
    let ground = truths[0].position_world[2];
    let heights = truths.iter().map(|truth| ground - truth.position_world[2]);
    let says = refused.or_else(|| summary["response"].as_str().map(str::to_owned));
    let flown = Flown {
        says: says.unwrap_or_else(|| "nothing".to_owned()),
        killed_by: summary["killed"]["by"].as_str().unwrap_or_default().to_owned(),
        height: heights.fold(0.0, f64::max),
        stopped_after: begins("take-off").and_then(|from| Some(begins("disarmed")? - from)),
    };
    kept_time(&place, "world").then_some(flown)
}

/// Flies until the machine keeps its time.
fn flown(wrong: &[Wrong], more: &[String]) -> Flown {
    let mut attempts = std::iter::repeat_with(|| fly(wrong, more)).take(5);
    attempts
        .find_map(|flown| flown)
        .expect("the machine stands still in every flight")
}

/// Flies until something is said: a leg on the ground may hide the response in a flight, and a limit may be faster.
fn flown_until_said(wrong: &[Wrong], more: &[String]) -> Flown {
    let mut flights = std::iter::repeat_with(|| flown(wrong, more)).take(5);
    let flown = flights.find(|flown| flown.says != "nothing");
    flown.expect("something is said in one of the flights")
}

/// Says of a flight what the table says, and whether it is what is wrong.
fn row(wrong: &[Wrong]) -> String {
    let names: Vec<_> = wrong.iter().copied().map(name_of).collect();
    let flown = match wrong {
        [Wrong::Body(_)] => flown_until_said(wrong, &[]),
        _ => flown(wrong, &[]),
    };
    let says = |words: &str| flown.says.contains(words);
    let is_right = match wrong {
        [Wrong::Reversed('R')] => says("yaw answers with the wrong sign"),
        // Half a turn reverses roll and pitch, of which one may be found first.
        [Wrong::Body(PI)] => says("was created turned by") || says("with the wrong sign"),
        [Wrong::Body(yaw)] => {
            says("was created turned by") && says(if *yaw > 0.0 { "right" } else { "left" })
        }
        _ => true,
    };
    assert!(is_right, "{names:?}: {}", flown.says);
    assert!(
        flown.height < LOW,
        "{names:?}: {} m above the ground, and said was: {}",
        flown.height,
        flown.says
    );
    let stopped = flown
        .stopped_after
        .map_or("–".to_owned(), |after| format!("{after:.1}"));
    let says = flown
        .says
        .lines()
        .next()
        .unwrap_or_default()
        .trim_start_matches("  × ")
        .to_owned();
    format!(
        "| {} | {says} | {stopped} | {:.2} |",
        names.join(", "),
        flown.height
    )
}

#[test]
fn no_vehicle_comes_high_with_wrong_signs_or_axes() {
    let is_full = std::env::var("GERONO_SIGNS").is_ok_and(|which| which == "all");
    let pairs = ALL
        .iter()
        .enumerate()
        .flat_map(|(at, &one)| ALL[at + 1..].iter().map(move |&other| vec![one, other]));
    let singles = ALL.iter().map(|&one| vec![one]);
    let flown: Vec<Vec<Wrong>> = match is_full {
        true => singles
            .chain(pairs)
            .filter(|wrong| settings_of(wrong).is_some())
            .collect(),
        false => [
            Wrong::Reversed('A'),
            Wrong::Reversed('R'),
            Wrong::Reversed('T'),
            Wrong::Exchanged,
            Wrong::Body(FRAC_PI_2),
            Wrong::Body(PI),
        ]
        .map(|wrong| vec![wrong])
        .into(),
    };
    println!(
        "| wrong | said | motors stopped after the take-off began, s | height, m |\n| --- | --- | --- | --- |"
    );
    for wrong in flown {
        println!("{}", row(&wrong));
    }
}

#[test]
fn a_wrong_response_kills_lands_or_is_only_said_as_stated() {
    for action in ["kill", "land", "warn"] {
        let stated = format!("flight.wrong_response='{action}'");
        // Without the envelope, whose tilt limit may be faster.
        let settings = [stated, "envelope={}".to_owned()];
        let flown = flown_until_said(&[Wrong::Body(PI)], &settings);
        let is_killed = flown.killed_by.contains("flight.wrong_response");
        assert_eq!(is_killed, action == "kill", "{action}: {}", flown.killed_by);
    }
}

/// It stands on its legs until the controller has made up for the mass, and turns only then.
#[test]
fn a_vehicle_heavier_than_believed_is_accused_of_what_is_wrong_alone() {
    let heavier = ["model.mass=0.17", "controller.initial.mass=0.17"].map(str::to_owned);
    let right = flown(&[], &heavier);
    assert_eq!(right.says, "nothing");
    assert!(right.height > 0.3, "{} m", right.height);
    let reversed = flown(&[Wrong::Reversed('R')], &heavier);
    assert!(
        reversed.says.contains("yaw answers with the wrong sign") && reversed.height < LOW,
        "{} m: {}",
        reversed.height,
        reversed.says
    );
}
