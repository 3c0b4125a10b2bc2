//! Response of the vehicle to its first commands: whether it turns about the axes and in the senses that were commanded.
//!
//! From the lift-off on, the rotation between two captures is compared with that of the commanded body rates, which act after
//! the modelled latency and lag. With c and m the commanded and measured rotations about x and y as complex numbers, a right
//! vehicle has m = c; a body that was created turned by β has m = exp(iβ) c; a reversed axis or exchanged axes m = q c*.
//!
//! A right vehicle whose commands act later than modelled, on a busy machine or over a link with an unknown delay, can look like each
//! of the others in the few blocks of a take-off. So it is wrong only if it explains the rotations better than a right one does at
//! any lateness.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};
use scenario::Scenario;
use shared_types::Topic;
use shared_types::flight_phase::FlightPhase;
use shared_types::rotation::{from_row_major, roll_pitch_yaw};
use shared_types::samples::{MocapPose, PathReference, RcFrame};
use shared_types::service::nanoseconds;

use crate::view;

/// Rise from which the vehicle is off the ground, m.
const RISE: f64 = 0.01;

/// Rotation from the attitude on the ground from which it is off it with a leg, rad.
const TIPPED: f64 = 0.1;

/// Time between two compared attitudes, ns: the noise of cameras is then small.
const BLOCK_NS: u64 = 50_000_000;

/// Blocks after which a verdict is possible, and after which the response counts as right.
const BLOCKS: [u32; 2] = [3, 20];

/// Sum of squared commanded rotations about an axis from which it was moved, rad².
const MOVED: f64 = 1.5e-3;

/// Least share of the measured rotations that a wrong response must explain.
const EXPLAINS: f64 = 0.6;

/// By how much this share must exceed that of a right vehicle that answers late.
const BETTER: f64 = 0.03;

/// Least ratio of measured and commanded rotation.
const RESPONDS: f64 = 0.3;

/// Largest ratio of measured and commanded rotation in a block, beside this rotation (rad): more is an error of the cameras.
const MOST_RESPONDS: f64 = 3.0;
const JUMP: f64 = 0.1;

/// Share by which one explanation of the rotations about x and y must exceed the other to be the only one.
const TELLS: f64 = 0.1;

/// Angle between commanded and measured axis from which the response is wrong, rad: 50°.
const TURNED: f64 = 0.87;

/// Angle from which it is reversed, rad: 135°.
const REVERSED: f64 = 2.36;

/// Largest difference of the yaw on the ground from what an explanation expects, rad.
const SAME_YAW: f64 = 0.4;

/// Times by which commands may act later than modelled, ns.
const LATENESS_NS: [u64; 6] = [0, 20_000_000, 40_000_000, 60_000_000, 80_000_000, 100_000_000];

/// Time for which the rotations by the commands are stored, ns: more than two blocks and the largest lateness.
const COMMANDED_NS: u64 = 250_000_000;

/// Stored frames.
const FRAMES: usize = 64;

/// Step of the modelled lag, ns.
const STEP_NS: u64 = 1_000_000;

/// Comparison of commanded and measured rotations at a take-off.
#[derive(Clone, Debug)]
pub struct ResponseWatch {
    latency_ns: u64,
    lag: f64,
    /// Frames that may act later: time from which, and rates.
    frames: VecDeque<(u64, Vector3<f64>)>,
    /// Rates that act, with the modelled lag.
    rates: Vector3<f64>,
    modelled_until_ns: u64,
    phase: FlightPhase,
    /// Pose on the ground.
    ground: Option<(f64, Matrix3<f64>)>,
    is_off: bool,
    /// Start of the block: time, attitude.
    block: Option<(u64, Matrix3<f64>)>,
    /// Rotation by the commands until the times of the last captures, rad.
    commanded: VecDeque<(u64, Vector3<f64>)>,
    blocks: u32,
    /// By the lateness of the commands.
    sums: [Sums; LATENESS_NS.len()],
    verdict: Option<String>,
}

/// Sums over blocks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sums {
    /// Products of measured (rows) and commanded (columns) rotations.
    products: Matrix3<f64>,
    /// Squares of the commanded ones.
    commanded: Vector3<f64>,
    /// Squares of the measured ones.
    measured: Vector3<f64>,
}

impl ResponseWatch {
    /// Makes the watch over a flight of a scenario.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let model = scenario.model.clone().unwrap_or_default();
        Self::with(nanoseconds(model.radio_latency), model.rate_lag)
    }

    /// Makes the watch with a latency of frames (ns) and a lag of the body rates (s).
    fn with(latency_ns: u64, lag: f64) -> Self {
        Self {
            latency_ns,
            lag,
            frames: VecDeque::new(),
            rates: Vector3::zeros(),
            modelled_until_ns: 0,
            phase: FlightPhase::Disarmed,
            ground: None,
            is_off: false,
            block: None,
            commanded: VecDeque::new(),
            blocks: 0,
            sums: Default::default(),
            verdict: None,
        }
    }

    /// Returns what is wrong with the response, if so.
    #[must_use]
    pub fn verdict(&self) -> Option<&str> {
        self.verdict.as_deref()
    }

    /// Adds a sample of the log; those of other topics have no effect. Returns the verdict if the sample leads to one.
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) -> Option<&str> {
        match topic {
            Topic::PathReference => view(bytes, |reference| self.observe_reference(reference)),
            Topic::RcFrame => view(bytes, |frame| self.observe_frame(frame)),
            Topic::MocapPose => return view(bytes, |pose| self.observe_pose(pose)),
            _ => {}
        }
        None
    }

    /// Adds a reference: each take-off from the ground restarts the watch. One that was not seen to begin there may be in the
    /// air already.
    fn observe_reference(&mut self, reference: &PathReference) {
        let before = std::mem::replace(&mut self.phase, FlightPhase::from_code(reference.phase));
        if self.phase == FlightPhase::TakeOff && before != FlightPhase::TakeOff {
            (self.ground, self.is_off, self.block) = (None, false, None);
            let is_from_the_ground = before == FlightPhase::Armed;
            self.blocks = if is_from_the_ground { 0 } else { BLOCKS[1] };
            self.sums = Default::default();
        }
    }

    /// Returns how far a pose is above that on the ground, m, if that was seen.
    #[must_use]
    pub fn rise(&self, pose: &MocapPose) -> Option<f64> {
        self.ground.map(|(height, _)| -pose.position_world[2] - height)
    }

    /// Adds a frame; one that was added before has no effect.
    fn observe_frame(&mut self, frame: &RcFrame) {
        if frame.mode != RcFrame::MODE_RATES {
            return;
        }
        let acts_ns = frame.header.stamp_ns + self.latency_ns;
        if self.frames.back().is_some_and(|(newest, _)| acts_ns <= *newest) {
            return;
        }
        if self.frames.len() == FRAMES {
            self.frames.pop_front();
        }
        self.frames.push_back((acts_ns, frame.rates_body.into()));
    }

    /// Adds a pose; one that was added before has no effect. Returns the verdict if the pose leads to one.
    fn observe_pose(&mut self, pose: &MocapPose) -> Option<&str> {
        let at_ns = pose.capture_time_ns;
        if !pose.tracked.is_set() || at_ns <= self.modelled_until_ns {
            return None;
        }
        if !pose.has_attitude() {
            self.block = None;
            return None;
        }
        self.turn_until(at_ns);
        let is_watched =
            self.phase == FlightPhase::TakeOff && self.verdict.is_none() && self.blocks < BLOCKS[1];
        if !is_watched {
            self.block = None;
            return None;
        }
        let attitude = from_row_major(&pose.world_from_body);
        let height = -pose.position_world[2];
        let (ground, level) = *self.ground.get_or_insert((height, attitude));
        self.is_off = self.is_off || height - ground > RISE || turn(&level, &attitude).norm() > TIPPED;
        if !self.is_off {
            return None;
        }
        let Some((began_ns, began)) = self.block else {
            self.block = Some((at_ns, attitude));
            return None;
        };
        if at_ns - began_ns < BLOCK_NS {
            return None;
        }
        let turned = turn(&began, &attitude);
        // After a gap, or a turn that no vehicle makes, nothing can be said.
        let commanded = LATENESS_NS.map(|late_ns| {
            self.commanded_until(at_ns.saturating_sub(late_ns))
                - self.commanded_until(began_ns.saturating_sub(late_ns))
        });
        let is_possible = turned.norm() < MOST_RESPONDS * commanded[0].norm() + JUMP;
        if at_ns - began_ns < 2 * BLOCK_NS && is_possible {
            for (sums, commanded) in self.sums.iter_mut().zip(&commanded) {
                sums.add(&turned, commanded);
            }
            self.blocks += 1;
        }
        self.block = Some((at_ns, attitude));
        if self.blocks < BLOCKS[0] {
            return None;
        }
        let [_, _, yaw] = roll_pitch_yaw(&level);
        self.verdict = verdict(&self.sums, yaw);
        self.verdict.as_deref()
    }

    /// Returns the rotation by the commands until a time, rad, between those of captures.
    fn commanded_until(&self, at_ns: u64) -> Vector3<f64> {
        let after = self.commanded.partition_point(|(time_ns, _)| *time_ns < at_ns);
        let at = |index: usize| self.commanded.get(index).copied();
        match (after.checked_sub(1).and_then(at), at(after)) {
            (Some((from_ns, from)), Some((to_ns, to))) => {
                from + (to - from) * ((at_ns - from_ns) as f64 / (to_ns - from_ns) as f64)
            }
            (before, after) => before.or(after).map_or_else(Vector3::zeros, |(_, turned)| turned),
        }
    }

    /// Turns the model of the vehicle by the commands from the last pose to a time.
    fn turn_until(&mut self, at_ns: u64) {
        let mut turned = self
            .commanded
            .back()
            .map_or_else(Vector3::zeros, |(_, turned)| *turned);
        if self.modelled_until_ns + 1_000_000_000 < at_ns {
            self.modelled_until_ns = at_ns - 1_000_000_000;
        }
        while self.modelled_until_ns < at_ns {
            let step_ns = STEP_NS.min(at_ns - self.modelled_until_ns);
            let acting = self
                .frames
                .iter()
                .rev()
                .find(|(from, _)| *from <= self.modelled_until_ns);
            let target = acting.map_or_else(Vector3::zeros, |(_, rates)| *rates);
            let step = 1e-9 * step_ns as f64;
            self.rates += (target - self.rates) * (step / (step + self.lag));
            turned += self.rates * step;
            self.modelled_until_ns += step_ns;
        }
        while self
            .commanded
            .front()
            .is_some_and(|(time_ns, _)| time_ns + COMMANDED_NS < at_ns)
        {
            self.commanded.pop_front();
        }
        self.commanded.push_back((at_ns, turned));
    }
}

/// Returns the rotation vector from one attitude to another in {B}, for rotations well below a half turn, rad.
fn turn(from: &Matrix3<f64>, to: &Matrix3<f64>) -> Vector3<f64> {
    let r = from.transpose() * to;
    0.5 * Vector3::new(
        r[(2, 1)] - r[(1, 2)],
        r[(0, 2)] - r[(2, 0)],
        r[(1, 0)] - r[(0, 1)],
    )
}

/// Returns what is wrong, if so, from the sums by lateness. `yaw` is that on the ground, rad.
fn verdict(sums: &[Sums; LATENESS_NS.len()], yaw: f64) -> Option<String> {
    let [in_time, ..] = sums;
    // The share from which a wrong response is no late right one.
    let needed = |axes: &[usize]| {
        let late = sums.iter().map(|late| late.right(axes));
        late.fold(EXPLAINS, |share, late| share.max(late + BETTER))
    };
    let pitch = sums.iter().map(|late| late.products[(1, 1)]).fold(0.0, f64::max);
    let horizontal = in_time.horizontal(needed(&[0, 1]), yaw);
    let yaw_by_yaw = sums.iter().map(Sums::yaw_by_yaw).fold(0.0, f64::max);
    let by_pitch = || in_time.pitch_turns_yaw(pitch, yaw_by_yaw);
    horizontal
        .or_else(by_pitch)
        .or_else(|| in_time.vertical(needed(&[2])))
}

impl Sums {
    fn add(&mut self, measured: &Vector3<f64>, commanded: &Vector3<f64>) {
        self.products += measured * commanded.transpose();
        self.commanded += commanded.component_mul(commanded);
        self.measured += measured.component_mul(measured);
    }

    /// Returns the share of the measured rotations about the axes that a right vehicle explains, 0 if it hardly answers.
    fn right(&self, axes: &[usize]) -> f64 {
        let sum = |of: &dyn Fn(usize) -> f64| axes.iter().map(|&axis| of(axis)).sum::<f64>();
        let product = sum(&|axis| self.products[(axis, axis)]);
        let [commanded, measured] =
            [&self.commanded, &self.measured].map(|squares| sum(&|axis| squares[axis]));
        if product > RESPONDS * commanded {
            explained(product, commanded, measured)
        } else {
            0.0
        }
    }

    fn horizontal(&self, needed: f64, yaw: f64) -> Option<String> {
        let moved = self.commanded.xy().map(|squares| squares > MOVED);
        if !moved.x && !moved.y {
            return None;
        }
        let p = &self.products;
        // Of single axes only the moved ones count: the other one has noise.
        let commanded = self.commanded.x + self.commanded.y;
        let measured = self.measured.x + self.measured.y;
        // m c* and m c.
        let turned = [p[(0, 0)] + p[(1, 1)], p[(1, 0)] - p[(0, 1)]];
        let reflected = [p[(0, 0)] - p[(1, 1)], p[(1, 0)] + p[(0, 1)]];
        let size = |[real, imaginary]: [f64; 2]| libm::hypot(real, imaginary);
        let explained = |pair| explained(size(pair), commanded, measured);
        let responds = |pair| size(pair) > RESPONDS * commanded;
        let as_reflected = || {
            let is_found = explained(reflected) > needed && responds(reflected);
            is_found.then(|| reflected_axes(libm::atan2(reflected[1], reflected[0])))
        };
        let as_turned = || {
            let angle = libm::atan2(turned[1], turned[0]);
            let is_found = explained(turned) > needed && responds(turned) && angle.abs() >= TURNED;
            is_found.then(|| match (moved.x, moved.y) {
                _ if angle.abs() <= REVERSED => turned_axes(angle, yaw),
                (true, false) => wrong_sign("roll"),
                (false, true) => wrong_sign("pitch"),
                _ => HALF_A_TURN.to_owned(),
            })
        };
        let better = explained(reflected) - explained(turned);
        if !moved.x || !moved.y || better < -TELLS {
            return as_turned();
        }
        if better > TELLS {
            return as_reflected();
        }
        // Rotations about one direction do not tell them apart, nor one of them from a right vehicle.
        match (as_turned(), as_reflected()) {
            (Some(turned), Some(reflected)) => Some(format!("{turned}; or {reflected}")),
            (turned, None) if explained(reflected) <= needed => turned,
            (None, reflected) if explained(turned) <= needed => reflected,
            _ => None,
        }
    }

    /// Returns that commands about y turn the vehicle about z, as with another up axis.
    /// `pitch` is the largest product with the rotation about y itself, and `yaw_by_yaw` the largest share of the rotation about z that
    /// its own commands explain, at any lateness.
    fn pitch_turns_yaw(&self, pitch: f64, yaw_by_yaw: f64) -> Option<String> {
        let is_moved = self.commanded.y > MOVED;
        let response = self.products[(2, 1)].abs();
        let explained = explained(response, self.commanded.y, self.measured.z);
        let is_other = self.products[(1, 1)].abs().max(pitch) < 0.5 * response;
        let needed = EXPLAINS.max(yaw_by_yaw + BETTER);
        (is_moved && is_other && explained > needed && response > RESPONDS * self.commanded.y).then(|| {
            "commands of pitch turn the measured yaw: the up axis of the camera system is another one than \
             `motion_capture.world_from_capture` says"
                .to_owned()
        })
    }

    /// Returns the share of the measured rotation about z that the commands about z explain, in either sense.
    fn yaw_by_yaw(&self) -> f64 {
        explained(self.products[(2, 2)], self.commanded.z, self.measured.z)
    }

    fn vertical(&self, needed: f64) -> Option<String> {
        let response = self.products[(2, 2)];
        let is_reversed = -response > RESPONDS * self.commanded.z && self.yaw_by_yaw() > needed;
        (self.commanded.z > MOVED && is_reversed).then(|| wrong_sign("yaw"))
    }
}

/// Returns the share of measured rotations that commanded ones explain, from their product and the squares of both.
fn explained(product: f64, commanded: f64, measured: f64) -> f64 {
    product * product / (commanded * measured).max(f64::MIN_POSITIVE)
}

/// Names axes that are exchanged or reversed by the angle of q in m = q c*, rad.
fn reflected_axes(angle: f64) -> String {
    if angle.abs() > REVERSED {
        wrong_sign("roll")
    } else if angle.abs() < std::f64::consts::PI - REVERSED {
        wrong_sign("pitch")
    } else {
        "roll and pitch are exchanged: commands about one axis turn the vehicle about the other".to_owned()
    }
}

const HALF_A_TURN: &str = "roll and pitch answer with the wrong sign: the body was created turned by 180°, or both channels are reversed";

fn wrong_sign(axis: &str) -> String {
    format!(
        "{axis} answers with the wrong sign: its channel is reversed (`rc_output`), or the axes of the body are wrong \
         (`gerono lab check`)"
    )
}

/// Tells a turned body from turned axes of the cameras by the yaw on the ground, where the nose points along x.
fn turned_axes(angle: f64, yaw: f64) -> String {
    let degrees = (angle.abs().to_degrees() / 5.0).round() * 5.0;
    let side = if angle > 0.0 { "right" } else { "left" };
    let body = format!("the body was created turned by {degrees:.0}° to the {side}");
    let cameras = format!("the axes of the camera system are turned by {degrees:.0}°");
    let difference = |expected: f64| {
        let difference = yaw - expected;
        libm::atan2(libm::sin(difference), libm::cos(difference)).abs()
    };
    let why = "commands of roll and pitch turn the vehicle about axes that are turned";
    if difference(-angle) < SAME_YAW {
        format!("{body}: {why} (`gerono lab check`)")
    } else if difference(0.0) < SAME_YAW {
        format!("{cameras}, and the body was created with them: {why} (`gerono lab check`)")
    } else {
        format!("{body}, or {cameras}: {why} (`gerono lab check`)")
    }
}

#[cfg(test)]
mod tests {
    use proptest::array::uniform2;
    use proptest::prelude::*;
    use shared_types::rotation::{exp, to_row_major};
    use zerocopy::FromZeros;

    use super::*;

    /// Takes off with commands of roll and pitch that swing, and a vehicle that turns by `response` of what is commanded.
    fn fly(response: Matrix3<f64>, yaw: f64, amplitude: Vector3<f64>) -> Option<(f64, String)> {
        let command = |time: f64| {
            let swing = [
                libm::sin(9.0 * time),
                libm::cos(7.0 * time),
                libm::sin(5.0 * time),
            ];
            amplitude.component_mul(&Vector3::from(swing))
        };
        fly_commands(response, yaw, 5, command)
    }

    /// As [`fly`], for commands by time that act after a latency, ms.
    fn fly_commands(
        response: Matrix3<f64>,
        yaw: f64,
        latency: usize,
        command: impl Fn(f64) -> Vector3<f64>,
    ) -> Option<(f64, String)> {
        let mut watch = ResponseWatch::with(5_000_000, 0.02);
        let mut reference = PathReference::new_zeroed();
        for phase in [FlightPhase::Armed, FlightPhase::TakeOff] {
            reference.phase = phase.code();
            watch.observe_reference(&reference);
        }
        let mut attitude = exp(&Vector3::new(0.0, 0.0, yaw));
        let (mut rates, mut target) = (Vector3::zeros(), Vector3::zeros());
        let mut targets = VecDeque::from(vec![Vector3::zeros(); latency]);
        for tick in 1..1500_u64 {
            let time = 1e-3 * tick as f64;
            if tick % 22 == 0 {
                let mut frame = RcFrame::new_zeroed();
                frame.header.stamp_ns = tick * 1_000_000;
                frame.mode = RcFrame::MODE_RATES;
                target = command(time);
                frame.rates_body = target.into();
                watch.observe_frame(&frame);
            }
            targets.push_back(target);
            let acting = targets.pop_front().unwrap();
            rates += (acting - rates) * (1e-3 / 0.021);
            attitude *= exp(&(response * rates * 1e-3));
            if tick % 10 == 0 {
                let mut pose = MocapPose::new_zeroed();
                pose.capture_time_ns = tick * 1_000_000;
                pose.tracked = true.into();
                // Off the ground after half a second.
                pose.position_world[2] = -(time - 0.5).max(0.0) * 0.4;
                let noise = Vector3::repeat(2e-3 * libm::sin(1e3 * time));
                pose.world_from_body = to_row_major(&(attitude * exp(&noise)));
                if let Some(words) = watch.observe_pose(&pose) {
                    return Some((time, words.to_owned()));
                }
            }
        }
        None
    }

    fn swinging() -> Vector3<f64> {
        Vector3::new(1.5, 1.5, 0.0)
    }

    fn about_z(angle: f64) -> Matrix3<f64> {
        exp(&Vector3::new(0.0, 0.0, angle))
    }

    #[test]
    fn a_vehicle_that_answers_as_commanded_is_not_accused() {
        for gain in [0.6, 1.0, 1.5] {
            for turned in [0.0, 0.4, -0.4] {
                assert_eq!(
                    fly(about_z(turned) * gain, 1.0, Vector3::new(1.5, 1.5, 1.0)),
                    None
                );
            }
        }
        assert_eq!(
            fly(-Matrix3::identity(), 0.0, Vector3::repeat(0.02)),
            None,
            "noise"
        );
        assert_eq!(fly(Matrix3::zeros(), 0.0, swinging()), None, "held by the ground");
    }

    #[test]
    fn each_wrong_response_is_told_from_the_others_within_three_tenths_of_a_second() {
        let quarter = std::f64::consts::FRAC_PI_2;
        let diagonal = |x, y, z| Matrix3::from_diagonal(&Vector3::new(x, y, z));
        let exchanged = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let up_axis = exp(&Vector3::new(quarter, 0.0, 0.0));
        for (response, yaw, words) in [
            (diagonal(-1.0, 1.0, 1.0), 0.0, "roll answers with the wrong sign"),
            (diagonal(1.0, -1.0, 1.0), 0.0, "pitch answers with the wrong sign"),
            (
                diagonal(-1.0, -1.0, 1.0),
                0.0,
                "roll and pitch answer with the wrong sign",
            ),
            (exchanged, 0.0, "roll and pitch are exchanged"),
            (
                about_z(quarter),
                -quarter,
                "the body was created turned by 90° to the right:",
            ),
            (
                about_z(-quarter),
                quarter,
                "the body was created turned by 90° to the left:",
            ),
            (
                about_z(quarter),
                0.0,
                "the axes of the camera system are turned by 90°,",
            ),
            (
                about_z(quarter),
                quarter,
                "the body was created turned by 90° to the right, or",
            ),
            (up_axis, 0.0, "commands of pitch turn the measured yaw"),
        ] {
            let found = fly(response, yaw, swinging());
            let (time, found) = found.unwrap_or_else(|| panic!("not found: {words}"));
            assert!(found.starts_with(words), "{found}\nfor {words}");
            assert!(time < 0.85, "{words}: {time}");
        }
        let (_, found) = fly(diagonal(1.0, 1.0, -1.0), 0.0, Vector3::new(0.0, 0.0, 1.5)).unwrap();
        assert!(found.starts_with("yaw answers with the wrong sign"), "{found}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3000))]

        /// A busy machine, or a link with an unknown delay.
        #[test]
        fn a_vehicle_that_answers_late_is_not_accused(
            latency in 0..100_usize,
            frequency in uniform2(2.0..20.0f64),
            phase in uniform2(0.0..6.3f64),
            amplitude in uniform2(0.2..3.0f64),
            gain in 0.5..1.5f64,
        ) {
            let swing = |axis: usize, time: f64| amplitude[axis] * libm::sin(frequency[axis] * time + phase[axis]);
            let command = |time: f64| Vector3::new(swing(0, time), swing(1, time), 0.0);
            prop_assert_eq!(fly_commands(Matrix3::identity() * gain, 0.0, latency, command), None);
        }
    }

    /// Angle to which a vehicle tips before its wrong response is found, whose rates are commanded against its tilt (gain in 1/s) by
    /// poses of an age (ms), over a link with the modelled latency; at most 2 rad.
    fn tips_over(response: Matrix3<f64>, gain: f64, age: u64) -> f64 {
        let mut watch = ResponseWatch::with(5_000_000, 0.02);
        let mut reference = PathReference::new_zeroed();
        for phase in [FlightPhase::Armed, FlightPhase::TakeOff] {
            reference.phase = phase.code();
            watch.observe_reference(&reference);
        }
        // The tilt that the ground and the air begin with, and those before.
        let mut tilt = Vector3::new(0.02, -0.01, 0.0);
        let (mut rates, mut target) = (Vector3::zeros(), Vector3::zeros());
        let mut seen = VecDeque::from(vec![tilt; age as usize + 1]);
        let mut targets = VecDeque::from(vec![Vector3::zeros(); 5]);
        for tick in 1..3000_u64 {
            let measured = seen.pop_front().unwrap();
            seen.push_back(tilt);
            if tick % 20 == 0 {
                let mut frame = RcFrame::new_zeroed();
                frame.header.stamp_ns = tick * 1_000_000;
                frame.mode = RcFrame::MODE_RATES;
                target = (-gain * measured).map(|rate: f64| rate.clamp(-10.0, 10.0));
                frame.rates_body = target.into();
                watch.observe_frame(&frame);
            }
            targets.push_back(target);
            let acting = targets.pop_front().unwrap();
            rates += (acting - rates) * (1e-3 / 0.021);
            tilt += response * rates * 1e-3;
            if tilt.norm() > 2.0 {
                break;
            }
            if tick % 10 == 0 {
                let mut pose = MocapPose::new_zeroed();
                pose.capture_time_ns = tick * 1_000_000;
                pose.tracked = true.into();
                pose.position_world[2] = -1e-3 * tick as f64;
                pose.world_from_body = to_row_major(&exp(&tilt));
                if watch.observe_pose(&pose).is_some() {
                    return tilt.norm();
                }
            }
        }
        tilt.norm()
    }

    #[test]
    fn a_body_that_was_created_turned_is_found_before_it_has_tipped_over() {
        for degrees in [60.0_f64, 90.0, 120.0, 180.0, -60.0, -90.0] {
            for gain in [10.0, 15.0, 20.0, 30.0, 39.0] {
                for age in [5, 10, 25] {
                    let tipped = tips_over(about_z(degrees.to_radians()), gain, age);
                    assert!(
                        tipped < 0.5,
                        "{degrees}°, gain {gain}, poses {age} ms old: {tipped:.2} rad"
                    );
                }
            }
        }
    }

    /// Commands of pitch and yaw together, as in a yaw test.
    #[test]
    fn a_yaw_that_its_own_commands_turn_is_not_that_of_another_up_axis() {
        let half_a_turn = Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0));
        let command = |time: f64| Vector3::new(0.0, 0.8, 0.8) * libm::sin(9.0 * time);
        let (_, found) = fly_commands(half_a_turn, 0.0, 5, command).unwrap();
        assert!(found.starts_with("pitch answers with the wrong sign"), "{found}");
        let held = Matrix3::from_diagonal(&Vector3::new(1.0, 0.0, 1.0));
        assert_eq!(fly_commands(held, 0.0, 5, command), None);
    }

    #[test]
    fn a_wrong_sign_beside_an_axis_that_moves_more_is_named() {
        let reversed = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, 1.0));
        let (_, found) = fly(reversed, 0.0, Vector3::new(0.9, 2.7, 0.0)).unwrap();
        assert!(found.starts_with("roll answers"), "{found}");
    }

    #[test]
    fn one_axis_that_moves_is_enough_for_its_sign() {
        let (_, found) = fly(-Matrix3::identity(), 0.0, Vector3::new(1.5, 0.0, 0.0)).unwrap();
        assert!(found.starts_with("roll answers"), "{found}");
        let (_, found) = fly(-Matrix3::identity(), 0.0, Vector3::new(0.0, 1.5, 0.0)).unwrap();
        assert!(found.starts_with("pitch answers"), "{found}");
    }
}
