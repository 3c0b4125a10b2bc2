//! An operator's acts by the command line: looks, and arms.

use std::process::Command;
use std::time::Duration;

use super::{Begun, Place, begin, until};

/// Pause between two questions to a flight.
const BETWEEN_QUESTIONS: Duration = Duration::from_millis(200);

/// Asks now and then until the answer is good. Who asks is a process, and the flight needs the cores as well.
pub(crate) fn ask<T>(what: &str, mut question: impl FnMut() -> Option<T>) -> T {
    until(what, || {
        std::thread::sleep(BETWEEN_QUESTIONS);
        question()
    })
}

/// Asks for arming; whether it is granted.
pub(crate) fn may_arm(place: &Place) -> bool {
    let output = place.gerono(&["arm"]).output().unwrap();
    assert!(matches!(output.status.code(), Some(0 | 1 | 7)), "{output:?}");
    output.status.success()
}

/// Arms until the vehicle comes to the path; whether it does. One that loses sight of itself on the ground disarms, as it
/// should, and its operator arms again.
pub(crate) fn comes_to_the_path(place: &Place) -> bool {
    let mut was_in_the_air = false;
    ask("the path", || {
        let phase = place.look()?.phase?;
        match phase.as_str() {
            "fly" => Some(true),
            "land" => Some(false),
            "disarmed" if was_in_the_air => Some(false),
            "disarmed" => {
                // Refused while there is nothing to see: asked again.
                may_arm(place);
                None
            }
            "take-off" => {
                was_in_the_air = true;
                None
            }
            _ => None,
        }
    })
}

/// A flight in real time from the ground to the ground, which only the operator arms and lands, to the folder `out`: of
/// the laboratory's vehicle, which nobody's absence turns over on a machine in use.
pub(crate) fn wait_on_the_ground(place: &Place) -> Begun {
    begin(&mut flight_on_the_ground(place))
}

/// The command of such a flight.
pub(crate) fn flight_on_the_ground(place: &Place) -> Command {
    let settings = [
        "duration=100.0",
        "flight={spool_up = 0.1, takeoff_height = 0.3, takeoff_speed = 0.5, transition_time = 0.5, landing_speed = 0.5}",
        // Nobody but the operator ends it.
        "envelope={}",
    ];
    place.live_flight("takeoff_and_land", "out", &settings)
}

/// Arms, and waits until the vehicle is on its path.
pub(crate) fn take_off_from_the_ground(place: &Place) {
    assert!(comes_to_the_path(place), "it is down again");
}

/// Waits for a phase of the only live run.
pub(crate) fn await_phase(place: &Place, phase: &str) {
    let mut seen = None;
    until(phase, || {
        let snapshot = place.look()?;
        if snapshot.phase != seen {
            // For the message of a test whose wait failed.
            eprintln!("{} s: {:?}", snapshot.time, snapshot.phase);
            seen.clone_from(&snapshot.phase);
        }
        (snapshot.phase.as_deref() == Some(phase)).then_some(())
    });
}
