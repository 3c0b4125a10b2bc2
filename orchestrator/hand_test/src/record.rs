//! Result of a hand test: the file that `gerono lab check` writes and that arming reads.

use std::path::Path;

use scenario::{MotionCapture, Scenario};
use serde::{Deserialize, Serialize};

use crate::cause::causes;
use crate::steps::Step;
use crate::test::{HandTest, Verdict};

/// Largest file that is read, bytes.
const LARGEST: u64 = 1 << 20;

/// Result of a hand test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HandTestRecord {
    /// `true` if every step was as expected and nothing else is wrong.
    pub hand_test_passed: bool,
    /// Date and time at its end, UTC.
    pub date: String,
    /// Name of the scenario.
    pub scenario: String,
    /// The body and the cameras.
    pub motion_capture: MotionCapture,
    /// The vehicle at rest.
    pub rest: RestRecord,
    /// The movements.
    pub steps: Vec<StepRecord>,
    /// Likely causes of what is wrong.
    pub causes: Vec<String>,
}

/// The vehicle at rest: SI units.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RestRecord {
    /// Position in {I}, m.
    pub position: [f64; 3],
    /// Angle between thrust axis and vertical, rad.
    pub tilt: f64,
    /// Yaw, rad.
    pub yaw: f64,
    /// Standard deviation of the position, the largest axis, m.
    pub position_deviation: f64,
    /// Standard deviation of the attitude, rad.
    pub attitude_deviation: f64,
    /// Poses per second.
    pub rate: f64,
    /// Age of poses on arrival, s; `None` without time stamps.
    pub latency: Option<f64>,
}

/// A movement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepRecord {
    /// Name of the step.
    pub step: String,
    /// What had to be seen.
    pub expected: String,
    /// What was seen.
    pub seen: String,
    /// `true` if it was as expected.
    pub passed: bool,
    /// The movement along x, y and z of {I} (m), or about those of {B} (rad).
    pub movement: [f64; 3],
}

impl HandTestRecord {
    /// Makes the record of a test; `None` if it is not over.
    #[must_use]
    pub fn new(
        test: &HandTest,
        scenario: &Scenario,
        name: &str,
        date: String,
        latency: Option<f64>,
    ) -> Option<Self> {
        let rest = test.rest().filter(|_| test.step().is_none())?;
        let (_, motion_capture) = scenario.capture_system()?;
        let ground = scenario
            .flight
            .as_ref()
            .map_or([0.0, 0.1], scenario::Flight::ground_or_floor);
        let causes: Vec<String> = causes(Some(rest), test.results(), ground)
            .iter()
            .map(ToString::to_string)
            .collect();
        let movements = test.results().iter().filter(|result| result.step != Step::Rest);
        let steps: Vec<StepRecord> = movements
            .map(|result| {
                let moved = result.movement.judged(result.step);
                StepRecord {
                    step: result.step.name().to_owned(),
                    expected: result.step.expected().to_owned(),
                    seen: result.step.in_words(&moved),
                    passed: result.verdict == Verdict::Passed,
                    movement: moved.into(),
                }
            })
            .collect();
        Some(Self {
            hand_test_passed: causes.is_empty() && steps.iter().all(|step| step.passed),
            date,
            scenario: name.to_owned(),
            motion_capture: motion_capture.clone(),
            rest: RestRecord {
                position: rest.position_world.into(),
                tilt: rest.tilt,
                yaw: rest.yaw,
                position_deviation: rest.position_deviation,
                attitude_deviation: rest.attitude_deviation,
                rate: rest.rate,
                latency,
            },
            steps,
            causes,
        })
    }

    /// Reads a record.
    ///
    /// # Errors
    /// Why there is none.
    pub fn read(path: &Path) -> Result<Self, String> {
        let described = |reason: &dyn std::fmt::Display| format!("{}: {reason}", path.display());
        let found = std::fs::metadata(path).map_err(|error| described(&error))?;
        if !found.is_file() || found.len() > LARGEST {
            return Err(described(&"it is no result of a hand test"));
        }
        let text = std::fs::read(path).map_err(|error| described(&error))?;
        serde_json::from_slice(&text).map_err(|error| described(&error))
    }

    /// Returns why the test does not permit to fly a vehicle with these cameras, if so.
    #[must_use]
    pub fn refusal(&self, cameras: &MotionCapture) -> Option<String> {
        let done = &self.motion_capture;
        if done.object != cameras.object {
            return Some(format!(
                "the hand test of {} was done with the body `{}`, not with `{}`",
                self.date, done.object, cameras.object
            ));
        }
        let address = |section: &MotionCapture| (section.source, section.server.clone(), section.port);
        let frames = |section: &MotionCapture| {
            (
                section.world_from_capture.clone(),
                section.body_from_markers.clone(),
            )
        };
        if address(done) != address(cameras) {
            return Some(format!(
                "the hand test of {} was done with other cameras",
                self.date
            ));
        }
        if frames(done) != frames(cameras) {
            return Some(format!(
                "`motion_capture.world_from_capture` or `body_from_markers` was changed since the hand test of {}",
                self.date
            ));
        }
        if self.hand_test_passed {
            return None;
        }
        let found = if self.causes.is_empty() {
            "a step was wrong"
        } else {
            self.causes[0].as_str()
        };
        Some(format!("the hand test of {} found: {found}", self.date))
    }
}

/// Formats a time since 1970 (s) as a date and time, UTC.
#[must_use]
pub fn date_in_words(since_1970: u64) -> String {
    let (days, second) = (since_1970 / 86_400, since_1970 % 86_400);
    // Days since 1 March of the year 0, in eras of 400 years.
    let days = days + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 {
        from_march + 3
    } else {
        from_march - 9
    };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (since_1970, words) in [
            (0, "1970-01-01 00:00:00 UTC"),
            (951_782_399, "2000-02-28 23:59:59 UTC"),
            (951_782_400, "2000-02-29 00:00:00 UTC"),
            (4_107_542_400, "2100-03-01 00:00:00 UTC"),
        ] {
            assert_eq!(date_in_words(since_1970), words);
        }
    }
}
