//! What an operator does by the command line: looks, and arms.

use std::time::Duration;

use super::{Place, until};

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
