//! Hand test of a laboratory before the first flight: feeds the poses of the cameras to [`hand_test`], and shows each step.

use std::fmt::Write as _;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::SystemTime;

use chrono::{DateTime, Utc};
use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt;
use command_line::output::{print, write_json};
use command_line::progress::waiting;
use hand_test::cause::NOT_LEVEL;
use hand_test::record::HandTestRecord;
use hand_test::steps::{Quantity, Step};
use hand_test::test::{Awaits, HandTest, Pose, StepResult, Verdict};
use indicatif::ProgressBar;
use motion_capture::diagnosis::Diagnosis;
use motion_capture::feed::{Feed, PoseParts};
use motion_capture::transport::{Address, CaptureSource};
use motion_capture::wire::Frame;
use rustix::fs::Access;
use scenario::{CaptureSystem, MotionCapture, Scenario};

use crate::mocap_probe::{listen, no_frame_reason};

/// Time after which it is said why there is no pose, s.
const POSES_WITHIN: f64 = 5.0;

/// Time between two updates of the live line, ns.
const SHOWN_EVERY_NS: u64 = 100_000_000;

/// Performs the test with the cameras of a scenario named `name`, for at most `seconds`, and writes its result to `file`.
///
/// # Errors
/// [`Failure`] if the scenario has no cameras on a network, the test does not end in time, or the file cannot be written.
pub fn check(scenario: &Scenario, name: &str, seconds: f64, file: &Path) -> Result<Exit, Failure> {
    let Some((system, stated)) = scenario.capture_system() else {
        return Err(Failure::bad_input(
            "the scenario's cameras are simulated; state `motion_capture.source`: see docs/motion_capture.md",
        ));
    };
    // Before the movements: their result must not be lost.
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    rustix::fs::access(folder.unwrap_or(Path::new(".")), Access::WRITE_OK).map_err(|error| {
        Failure::bad_input(format!(
            "cannot write the result to {}: {error}; give --out FILE",
            file.display()
        ))
    })?;
    let address = Address::new(system, stated).map_err(Failure::bad_input)?;
    let mut check = HandCheck::new(system, stated)?;
    let mut source = address.open().map_err(Failure::trouble)?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    print(introduction(&stated.object) + &instruction(&check.test));
    let patience = seconds.min(POSES_WITHIN);
    let mut watch = |check: &mut HandCheck, seconds, since_start| {
        let mut look = |frame: &Frame, now_ns| check.look(frame, now_ns);
        let signal = listen(seconds, &mut *source, &interrupt, &mut look);
        (signal, check.findings(&address, &*source, since_start))
    };
    let (mut signal, mut findings) = watch(&mut check, patience, patience);
    if signal.is_none() && check.test.step().is_some() && seconds > patience {
        if check.poses == 0 {
            let waiting = format!("  no pose so far: {findings}; waiting up to {seconds} s\n");
            check.live.suspend(|| print(waiting));
        }
        (signal, findings) = watch(&mut check, seconds - patience, seconds);
    }
    check.live.finish_and_clear();
    if let Some(signal) = signal {
        return Ok(Exit::Signal(signal));
    }
    let HandCheck { test, latency, .. } = check;
    // Vicon's stream has no time stamps: what the feed computes is the stated latency.
    let latency = latency.filter(|_| system != CaptureSystem::ViconUdp);
    let date = in_words(SystemTime::now().into());
    let Some(record) = HandTestRecord::new(&test, scenario, name, date, latency) else {
        let reason = if test.rest().is_none() {
            format!("the vehicle did not lie still in sight of the cameras within {seconds} s; {findings}")
        } else {
            let step = test.step().map_or("", Step::name);
            format!("the test did not end within {seconds} s: the step `{step}` was not done")
        };
        return Err(Failure::trouble(reason));
    };
    print(conclusion(&record, file));
    write_json(file, &record)?;
    print(format!("written to {}\n", file.display()));
    Ok(if record.hand_test_passed {
        Exit::Success
    } else {
        Exit::Unfit
    })
}

/// Test under way.
struct HandCheck {
    feed: Feed,
    diagnosis: Diagnosis,
    test: HandTest,
    /// Frames of the cameras.
    frames: u64,
    /// Poses of the vehicle.
    poses: u64,
    /// Age of the poses while it lay still, s.
    latency: Option<f64>,
    live: ProgressBar,
    shown_ns: u64,
}

impl HandCheck {
    fn new(system: CaptureSystem, stated: &MotionCapture) -> Result<Self, Failure> {
        Ok(Self {
            feed: Feed::new(system, stated).map_err(Failure::bad_input)?,
            diagnosis: Diagnosis::new(system, stated).map_err(Failure::bad_input)?,
            test: HandTest::default(),
            frames: 0,
            poses: 0,
            latency: None,
            live: waiting("no pose yet"),
            shown_ns: 0,
        })
    }

    /// Takes the pose of a frame, and shows what follows.
    fn look(&mut self, frame: &Frame, now_ns: u64) -> ControlFlow<()> {
        self.frames += 1;
        self.diagnosis.add(frame);
        let pose = self.feed.accept(frame, now_ns);
        let Some(pose) = pose.filter(|pose| pose.parts == PoseParts::Both) else {
            return ControlFlow::Continue(());
        };
        self.poses += 1;
        let seen = Pose {
            position_world: pose.pose.position_world,
            world_from_body: pose.pose.world_from_body,
        };
        let test = &mut self.test;
        let asked_before = test.awaits() == Awaits::Return;
        if let Some(result) = test.add(1e-9 * pose.captured_ns as f64, &seen) {
            if result.step == Step::Rest {
                self.latency = self.feed.figures().last().map(|second| second.latency);
            }
            self.live
                .suspend(|| print(described(test, &result) + &instruction(test)));
        } else if test.awaits() == Awaits::Return && !asked_before {
            self.live
                .suspend(|| print("  another movement was seen: bring it back, and repeat\n"));
        }
        if now_ns.saturating_sub(self.shown_ns) > SHOWN_EVERY_NS {
            self.shown_ns = now_ns;
            self.live.set_message(view(test));
        }
        match test.step() {
            Some(_) => ControlFlow::Continue(()),
            None => ControlFlow::Break(()),
        }
    }

    /// Returns what is wrong with the frames, after `seconds`.
    fn findings(&self, address: &Address, source: &dyn CaptureSource, seconds: f64) -> String {
        if self.frames == 0 {
            return no_frame_reason(address, source, seconds);
        }
        let findings = self.diagnosis.with(source, self.feed.frozen_part()).to_string();
        if !findings.is_empty() {
            findings
        } else if self.poses == 0 {
            "frames come, without a whole pose of the vehicle: do the cameras see it?".to_owned()
        } else {
            "its poses come".to_owned()
        }
    }
}

fn in_words(date: DateTime<Utc>) -> String {
    date.format("%Y-%m-%d %H:%M:%S UTC").to_string()
}

fn introduction(object: &str) -> String {
    format!(
        "Hand test of `{object}`. Take the PROPELLERS OFF. Put it on the ground, its nose along the room's +x axis.\n\
         Each step passes by itself; hold it for a second at the end of a movement. Ctrl-C ends the test without a result.\n\n"
    )
}

/// Returns the line of the next step; empty at the end.
fn instruction(test: &HandTest) -> String {
    test.step().map_or_else(String::new, |step| {
        let number = test.results().len() + 1;
        let count = Step::ALL.len();
        format!("{number}/{count} {} ({})\n", step.instruction(), step.expected())
    })
}

/// Returns a size in the unit of a step.
fn size(step: Step, value: f64) -> String {
    match step.quantity() {
        Quantity::Attitude => format!("{:.0}°", value.to_degrees()),
        _ => format!("{value:.2} m"),
    }
}

fn described(test: &HandTest, result: &StepResult) -> String {
    if let Some(rest) = test.rest().filter(|_| result.step == Step::Rest) {
        let verdict = if rest.tilt > NOT_LEVEL {
            "WRONG: tilted"
        } else {
            "ok"
        };
        return format!(
            "  {verdict}: {:.1} poses per second; noise {:.2} mm, {:.2} mrad; z {:.3} m, tilt {:.1}°, yaw {:.0}°\n",
            rest.rate,
            1e3 * rest.position_deviation,
            1e3 * rest.attitude_deviation,
            rest.position_world.z,
            rest.tilt.to_degrees(),
            rest.yaw.to_degrees()
        );
    }
    let moved = result.movement.judged(result.step);
    let seen = format!(
        "{} by {}",
        result.step.in_words(&moved),
        size(result.step, moved.amax())
    );
    match result.verdict {
        Verdict::Passed => format!("  ok: {seen}\n"),
        Verdict::Wrong => format!("  WRONG: {seen}, expected: {}\n", result.step.expected()),
    }
}

/// Returns the live line.
fn view(test: &HandTest) -> String {
    let step = test.step().unwrap_or(Step::Rest);
    match test.awaits() {
        Awaits::Stillness => "hold it still".to_owned(),
        Awaits::Level => "hold it level and still, as it lay".to_owned(),
        Awaits::Return => "bring it back".to_owned(),
        Awaits::Movement { along, across } => format!(
            "{}: {} of {}; across {}",
            step.expected(),
            size(step, along),
            size(step, step.least()),
            size(step, across)
        ),
        Awaits::Nothing => String::new(),
    }
}

fn conclusion(record: &HandTestRecord, path: &Path) -> String {
    let mut text = String::from("\n");
    for cause in &record.causes {
        writeln!(text, "WRONG: {cause}").expect("a String takes all");
    }
    if let Some(latency) = record.rest.latency {
        writeln!(text, "age of poses on arrival: {:.1} ms", 1e3 * latency).expect("a String takes all");
    }
    if !record.hand_test_passed {
        return text + "Do not fly: correct what is wrong, and repeat the test.\n";
    }
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let (path, [.., z]) = (path.display(), record.rest.position);
    text + &format!(
        "Axes and signs of the cameras are right: the vehicle may fly with these sections `[motion_capture]` and this body.\n\
         Not tested: the radio link (`gerono rc probe`), the kill switch (`gerono operator probe`), the motors.\n\
         State it in `[flight]`, so that nothing else is armed: hand_test = \"{path}\", ground = {z:.3}, ground_tolerance = 0.05\n"
    )
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
            assert_eq!(in_words(DateTime::from_timestamp(since_1970, 0).unwrap()), words);
        }
    }
}
