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
use motion_capture::diagnosis::Diagnosis;
use motion_capture::feed::{Feed, PoseParts};
use motion_capture::transport::Address;
use scenario::{CaptureSystem, Scenario};

use crate::mocap_probe::{listen, no_frame_reason};

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
    let address = Address::new(system, stated).map_err(Failure::bad_input)?;
    let mut feed = Feed::new(system, stated).map_err(Failure::bad_input)?;
    let mut diagnosis = Diagnosis::new(system, stated).map_err(Failure::bad_input)?;
    let mut source = address.open().map_err(Failure::trouble)?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    print(introduction(&stated.object));
    let live = waiting("no pose yet");
    let mut test = HandTest::default();
    let (mut frames, mut latency, mut shown_ns) = (0_u64, None, 0_u64);
    live.suspend(|| print(instruction(&test)));
    let signal = listen(seconds, &mut *source, &interrupt, &mut |frame, now_ns| {
        frames += 1;
        diagnosis.add(frame);
        let Some(pose) = feed
            .accept(frame, now_ns)
            .filter(|pose| pose.parts == PoseParts::Both)
        else {
            return ControlFlow::Continue(());
        };
        let seen = Pose {
            position_world: pose.pose.position_world,
            world_from_body: pose.pose.world_from_body,
        };
        let asked_before = test.awaits() == Awaits::Return;
        let result = test.add(1e-9 * pose.captured_ns as f64, &seen);
        if let Some(result) = result {
            if result.step == Step::Rest {
                latency = feed.figures().last().map(|second| second.latency);
            }
            live.suspend(|| print(described(&test, &result) + &instruction(&test)));
        } else if test.awaits() == Awaits::Return && !asked_before {
            live.suspend(|| print("  another movement was seen: bring it back, and repeat\n"));
        }
        if now_ns.saturating_sub(shown_ns) > SHOWN_EVERY_NS {
            shown_ns = now_ns;
            live.set_message(view(&test));
        }
        if test.step().is_none() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    live.finish_and_clear();
    if let Some(signal) = signal {
        return Ok(Exit::Signal(signal));
    }
    // Vicon's stream has no time stamps: what the feed computes is the stated latency.
    let latency = latency.filter(|_| system != CaptureSystem::ViconUdp);
    let date = in_words(SystemTime::now().into());
    let Some(record) = HandTestRecord::new(&test, scenario, name, date, latency) else {
        let reason = if frames == 0 {
            no_frame_reason(&address, &*source, seconds)
        } else if test.rest().is_none() {
            let findings = diagnosis.with(&*source, feed.frozen_part()).to_string();
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
