//! State machine of the hand test: poses in, verdicts out. It has no clock: each pose comes with its time.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::{log, roll_pitch_yaw, tilt, to_row_major};

use crate::steps::{Quantity, Step};

/// Cosine of the largest angle between a movement and its expected axis, 30°.
const DOMINANT: f64 = 0.866;

/// Time for which a right movement must last, s.
const RIGHT_FOR: f64 = 0.15;

/// Time for which a wrong movement must last until it counts, s: a hand needs some of it to correct itself.
const WRONG_FOR: f64 = 1.0;

/// Time for which the vehicle must be held still before a movement, s.
const STILL_FOR: f64 = 0.4;

/// Time for which it must lie still, s.
const REST_FOR: f64 = 2.0;

/// Largest deviations of a vehicle that is held still, m and rad.
const STILL: [f64; 2] = [0.02, 0.06];

/// Largest deviations of a vehicle that lies still, m and rad: noise of cameras.
const AT_REST: [f64; 2] = [0.005, 0.03];

/// Largest rotation from the attitude at rest before a tilt or a turn, rad.
const LEVEL: f64 = 0.2;

/// Largest distance from the start of a movement before it is repeated, m.
const BACK: f64 = 0.15;

/// Wrong movements of a step after which it has failed.
const ATTEMPTS: u32 = 2;

/// Longest time between two poses for which the vehicle counts as seen, s.
const GAP: f64 = 0.5;

/// Pose of the vehicle, as the cameras and the scenario's transforms have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Origin of {B} in {I}, m.
    pub position_world: Vector3<f64>,
    /// R, {B} to {I}.
    pub world_from_body: Matrix3<f64>,
}

/// Movement as the cameras saw it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Movement {
    /// Displacement (m) or rotation vector (rad) in {I}.
    pub world: Vector3<f64>,
    /// The same in the axes of {B} at its start.
    pub body: Vector3<f64>,
}

impl Movement {
    /// Returns the movement of a step's quantity between two poses.
    #[must_use]
    pub fn between(step: Step, from: &Pose, to: &Pose) -> Self {
        match step.quantity() {
            Quantity::None => Self {
                world: Vector3::zeros(),
                body: Vector3::zeros(),
            },
            Quantity::Position => {
                let world = to.position_world - from.position_world;
                let body = from.world_from_body.transpose() * world;
                Self { world, body }
            }
            Quantity::Attitude => {
                let body = log(&(from.world_from_body.transpose() * to.world_from_body));
                let world = from.world_from_body * body;
                Self { world, body }
            }
        }
    }

    /// Returns the movement in the axes in which its step expects it.
    #[must_use]
    pub fn judged(&self, step: Step) -> Vector3<f64> {
        match step.quantity() {
            Quantity::Attitude => self.body,
            _ => self.world,
        }
    }
}

/// The vehicle at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Mean position in {I}, m.
    pub position_world: Vector3<f64>,
    /// Standard deviation of the position, the largest axis, m.
    pub position_deviation: f64,
    /// Standard deviation of the attitude about each axis, rms, rad.
    pub attitude_deviation: f64,
    /// Poses per second.
    pub rate: f64,
    /// Angle between thrust axis and vertical, rad.
    pub tilt: f64,
    /// Yaw, rad.
    pub yaw: f64,
}

/// Verdict on a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// As expected.
    Passed,
    /// Another axis or sign, twice.
    Wrong,
}

/// Result of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepResult {
    /// The step.
    pub step: Step,
    /// The verdict.
    pub verdict: Verdict,
    /// The movement that decided it; zero at rest.
    pub movement: Movement,
}

/// What the test waits for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Awaits {
    /// That the vehicle is held still.
    Stillness,
    /// That it is level and still, as at rest.
    Level,
    /// That it is back where the movement began, after a wrong one.
    Return,
    /// The movement, with the part along the expected axis so far and the largest other one, m or rad.
    Movement {
        /// Part along the expected axis and sign.
        along: f64,
        /// Size of the rest.
        across: f64,
    },
    /// Nothing: the test is over.
    Nothing,
}

/// Hand test in progress.
#[derive(Clone, Debug, Default)]
pub struct HandTest {
    /// Last poses with their times, oldest first, for at most [`REST_FOR`].
    window: VecDeque<(f64, Pose)>,
    rest: Option<(Rest, Pose)>,
    results: Vec<StepResult>,
    /// Pose from which the movement of this step counts.
    start: Option<Pose>,
    /// Start of the wrong movement that must be undone first.
    to_undo: Option<Pose>,
    wrong: u32,
    /// Time since which the movement is right or wrong.
    since: Option<(Verdict, f64)>,
}

impl HandTest {
    /// Returns the present step; `None` once all are done.
    #[must_use]
    pub fn step(&self) -> Option<Step> {
        Step::ALL.get(self.results.len()).copied()
    }

    /// Returns the results so far.
    #[must_use]
    pub fn results(&self) -> &[StepResult] {
        &self.results
    }

    /// Returns the vehicle at rest, once the first step is done.
    #[must_use]
    pub fn rest(&self) -> Option<&Rest> {
        self.rest.as_ref().map(|(rest, _)| rest)
    }

    /// Adds a pose with its time (s, increasing). Returns the step's result if the pose ends it.
    pub fn add(&mut self, time: f64, pose: &Pose) -> Option<StepResult> {
        let step = self.step()?;
        let newest = self.window.back().map(|(time, _)| *time);
        if newest.is_some_and(|newest| time - newest > GAP) {
            self.window.clear();
            self.since = None;
        }
        if newest.is_some_and(|newest| time <= newest) {
            return None;
        }
        self.window.push_back((time, *pose));
        while self
            .window
            .front()
            .is_some_and(|(first, _)| time - first > REST_FOR)
        {
            self.window.pop_front();
        }
        let result = if step == Step::Rest {
            self.rest_over(time)
        } else {
            self.movement_over(step, time, pose)
        };
        if let Some(result) = result {
            self.results.push(result);
            (self.start, self.to_undo, self.wrong, self.since) = (None, None, 0, None);
        }
        result
    }

    /// Returns what the test waits for, with a view at the newest pose.
    #[must_use]
    pub fn awaits(&self) -> Awaits {
        let Some((step, (_, pose))) = self.step().zip(self.window.back()) else {
            return if self.step().is_none() {
                Awaits::Nothing
            } else {
                Awaits::Stillness
            };
        };
        match (&self.start, &self.to_undo) {
            (Some(start), _) => {
                let moved = Movement::between(step, start, pose).judged(step);
                let along = moved.dot(&step.direction());
                let across = (moved - step.direction() * along).norm();
                Awaits::Movement { along, across }
            }
            (None, Some(_)) => Awaits::Return,
            (None, None) if step.quantity() == Quantity::Attitude => Awaits::Level,
            (None, None) => Awaits::Stillness,
        }
    }

    fn rest_over(&mut self, time: f64) -> Option<StepResult> {
        // The window spans the whole time within a frame period of 10 Hz.
        if !self.is_still(time, REST_FOR - 0.1, AT_REST) {
            return None;
        }
        let (rest, pose) = self.at_rest()?;
        self.rest = Some((rest, pose));
        Some(StepResult {
            step: Step::Rest,
            verdict: Verdict::Passed,
            movement: Movement::between(Step::Rest, &pose, &pose),
        })
    }

    fn movement_over(&mut self, step: Step, time: f64, pose: &Pose) -> Option<StepResult> {
        let Some(start) = self.start else {
            self.begin(step, time, pose);
            return None;
        };
        let movement = Movement::between(step, &start, pose);
        let moved = movement.judged(step);
        let size = moved.norm();
        let along = moved.dot(&step.direction());
        let seen = if along >= step.least() && along >= DOMINANT * size {
            Some((Verdict::Passed, RIGHT_FOR))
        } else if size >= step.least() && along < DOMINANT * size {
            Some((Verdict::Wrong, WRONG_FOR))
        } else {
            None
        };
        let Some((verdict, needed)) = seen else {
            self.since = None;
            return None;
        };
        let since = match self.since {
            Some((before, since)) if before == verdict => since,
            _ => time,
        };
        self.since = Some((verdict, since));
        if time - since < needed {
            return None;
        }
        if verdict == Verdict::Wrong {
            self.wrong += 1;
            if self.wrong < ATTEMPTS {
                (self.start, self.to_undo, self.since) = (None, Some(start), None);
                return None;
            }
        }
        Some(StepResult {
            step,
            verdict,
            movement,
        })
    }

    /// Begins the movement once the vehicle is held where it must begin.
    fn begin(&mut self, step: Step, time: f64, pose: &Pose) {
        let is_ready = match (step.quantity(), &self.to_undo, &self.rest) {
            (Quantity::Attitude, _, Some((_, rest))) => angle(rest, pose) < LEVEL,
            (_, Some(before), _) => (pose.position_world - before.position_world).norm() < BACK,
            _ => true,
        };
        if is_ready && self.is_still(time, STILL_FOR, STILL) {
            self.start = Some(*pose);
        }
    }

    /// Returns whether the poses of the last `duration` s stay within deviations from the newest one (m, rad).
    fn is_still(&self, time: f64, duration: f64, [metres, radians]: [f64; 2]) -> bool {
        let Some(((oldest, _), (_, newest))) = self.window.front().zip(self.window.back()) else {
            return false;
        };
        let mut recent = self
            .window
            .iter()
            .rev()
            .take_while(|(at, _)| time - at <= duration);
        time - oldest >= duration
            && recent.all(|(_, pose)| {
                (pose.position_world - newest.position_world).norm() < metres && angle(pose, newest) < radians
            })
    }

    /// Returns means and deviations of the window.
    #[expect(clippy::cast_precision_loss, reason = "some hundred poses")]
    fn at_rest(&self) -> Option<(Rest, Pose)> {
        let ((first, reference), (last, _)) = self.window.front().zip(self.window.back())?;
        let count = self.window.len() as f64;
        let poses = || self.window.iter().map(|(_, pose)| pose);
        let mean = |values: &dyn Fn(&Pose) -> Vector3<f64>| poses().map(values).sum::<Vector3<f64>>() / count;
        let position = mean(&|pose| pose.position_world);
        let turned = |pose: &Pose| log(&(reference.world_from_body.transpose() * pose.world_from_body));
        let mean_turn = mean(&turned);
        let squares = mean(&|pose| (pose.position_world - position).map(|value| value * value));
        let turn_squares = mean(&|pose| (turned(pose) - mean_turn).map(|value| value * value));
        let world_from_body = reference.world_from_body * shared_types::rotation::exp(&mean_turn);
        let rest = Rest {
            position_world: position,
            position_deviation: squares.max().sqrt(),
            attitude_deviation: (turn_squares.sum() / 3.0).sqrt(),
            rate: (count - 1.0) / (last - first).max(1e-3),
            tilt: tilt(&to_row_major(&world_from_body)),
            yaw: roll_pitch_yaw(&world_from_body)[2],
        };
        let pose = Pose {
            position_world: position,
            world_from_body,
        };
        Some((rest, pose))
    }
}

/// Returns the angle between two attitudes, rad.
fn angle(from: &Pose, to: &Pose) -> f64 {
    log(&(from.world_from_body.transpose() * to.world_from_body)).norm()
}
