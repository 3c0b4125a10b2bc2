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
        let ground = scenario.flight.clone().unwrap_or_default().ground_or_floor();
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
