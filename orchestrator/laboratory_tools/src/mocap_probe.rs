//! Diagnosis of a motion-capture system: its packets, and the result of the feed.

mod received;

use std::fmt::Write as _;
use std::io::Write as _;
use std::ops::ControlFlow;
use std::path::Path;

use motion_capture::conventions::axes;
use motion_capture::diagnosis::Diagnosis;
use motion_capture::feed::Feed;
use motion_capture::transport::{Address, CaptureSource};
use motion_capture::wire::Frame;
use runtime::flight_clock::monotonic_ns;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use scenario::{CaptureSystem, MotionCapture, Problem};
use shared_types::rotation::roll_pitch_yaw;

use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt;
use command_line::output::{not_written, print};
use flight::interrupt::Interrupt;
use received::{Body, ReceivedPackets};
use result_file::ResultFile;

/// Maximum sleep, ns.
const SLEEP_NS: u64 = 50_000_000;

/// Standard deviation of the position above which a body counts as moving, m.
const AT_REST: f64 = 2e-3;

/// Receives for some seconds and prints the packets; with a stated object, also the result of the feed. Writes the sections of a
/// scenario to the new file `calibration`, which define the body's pose as that of the vehicle at the origin.
///
/// # Errors
/// [`Failure`] if a socket cannot be opened, nothing was received, or no pose of the object was accepted.
pub fn probe(
    system: CaptureSystem,
    stated: &MotionCapture,
    has_object: bool,
    seconds: f64,
    calibration: Option<&Path>,
) -> Result<Exit, Failure> {
    let bad = |Problem { key, reason, fix }: Problem| {
        let option = key.segments().last().map_or("", String::as_str);
        Failure::bad_input(format!("--{option}: {reason}; {fix}"))
    };
    if let Some(problem) = stated.problems().into_iter().next() {
        return Err(bad(problem));
    }
    let address = Address::new(system, stated).map_err(bad)?;
    let mut vehicle = if has_object {
        let feed = Feed::new(system, stated).map_err(bad)?;
        Some((feed, Diagnosis::new(system, stated).map_err(bad)?))
    } else {
        None
    };
    let calibration = match calibration {
        Some(path) => {
            let file = ResultFile::create_new(path).map_err(|error| not_written(path, &error))?;
            Some((path, file))
        }
        None => None,
    };
    let mut source = address.open().map_err(Failure::trouble)?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let mut received = ReceivedPackets::new(system);
    let signal = listen(seconds, &mut *source, &interrupt, &mut |frame, now_ns| {
        received.add(frame, now_ns);
        if let Some((feed, diagnosis)) = &mut vehicle {
            diagnosis.add(frame);
            feed.accept(frame, now_ns);
        }
        ControlFlow::Continue(())
    });
    if let Some(signal) = signal {
        return Ok(Exit::Signal(signal));
    }
    let has_time = vehicle
        .as_ref()
        .is_none_or(|(_, diagnosis)| diagnosis.stopped_stamp().is_none());
    print(received.describe(&*source, has_time));
    if received.frames == 0 {
        return Err(Failure::trouble(no_frame_reason(&address, &*source, seconds)));
    }
    let Some((feed, diagnosis)) = vehicle else {
        return Ok(Exit::Success);
    };
    let findings = diagnosis.with(&*source, feed.frozen_part()).to_string();
    print(describe_feed(&feed));
    if feed.counts().believed == 0 {
        let because = if findings.is_empty() {
            "the received bodies are listed above".to_owned()
        } else {
            findings
        };
        let reason = format!("no pose of `{}` was accepted; {because}", stated.object);
        return Err(Failure::trouble(reason));
    }
    print(paragraph(&findings));
    if let Some((path, mut file)) = calibration {
        let name = stated.name_and_number().map_or("", |(name, _)| name);
        let body = received.bodies.values().find(|body| {
            (name.is_empty() || body.name.as_bytes() == name.as_bytes())
                && stated
                    .name_and_number()
                    .is_none_or(|(_, wanted)| wanted.is_none_or(|wanted| wanted == body.number))
        });
        let body = body.filter(|body| body.deviation() <= AT_REST);
        let body = body.ok_or_else(|| {
            let reason = "the body moves: put the vehicle level at the origin of {I}, its nose along x, and do not touch it";
            Failure::trouble(reason)
        })?;
        let text = sections(system, stated, body, received.rate());
        let written = file.write_all(text.as_bytes()).and_then(|()| file.finish());
        written.map_err(|error| not_written(path, &error))?;
        print(format!(
            "calibration written to {}\nPut its keys in place of the same ones in your scenario, and keep all others, such as \
             `marker_offset_deviation` and `latency`.\n",
            path.display()
        ));
    }
    Ok(Exit::Success)
}

/// Returns the reason why there is no frame.
pub(crate) fn no_frame_reason(address: &Address, source: &dyn CaptureSource, seconds: f64) -> String {
    let server = address.server;
    let malformed = source.counts().malformed;
    if malformed.total() > 0 {
        return format!("packets were received from {server}, but no frame could be decoded: {malformed}");
    }
    let advice = "see the first checks in docs/motion_capture.md";
    format!("nothing was received from {server} in {seconds} s; {advice}")
}

/// Ends a text with a line feed unless it is empty.
fn paragraph(text: &str) -> String {
    if text.is_empty() {
        String::new()
    } else {
        format!("{text}\n")
    }
}

/// Receives frames for some seconds, or until the sink breaks off. Returns the signal if one ended it early.
pub(crate) fn listen(
    seconds: f64,
    source: &mut dyn CaptureSource,
    interrupt: &Interrupt,
    sink: &mut dyn FnMut(&Frame, u64) -> ControlFlow<()>,
) -> Option<i32> {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "an hour at most"
    )]
    let end_ns = monotonic_ns() + (seconds * 1e9) as u64;
    let mut next = ControlFlow::Continue(());
    loop {
        let now_ns = monotonic_ns();
        if now_ns >= end_ns || next.is_break() {
            return None;
        }
        if let Some(signal) = interrupt.take() {
            return Some(signal);
        }
        source.poll(now_ns, &mut |frame| {
            if next.is_continue() {
                next = sink(frame, now_ns);
            }
        });
        sleep(source, end_ns);
    }
}

/// Sleeps until a packet has arrived or the source is due.
fn sleep(source: &dyn CaptureSource, end_ns: u64) {
    let now_ns = monotonic_ns();
    let due_ns = source.due_ns().unwrap_or(end_ns).min(end_ns);
    let sleep_ns = due_ns.saturating_sub(now_ns).min(SLEEP_NS);
    let timeout = Timespec {
        tv_sec: 0,
        tv_nsec: i64::try_from(sleep_ns).unwrap_or(0),
    };
    let descriptors = source.descriptors();
    let mut waits: Vec<PollFd<'_>> = descriptors
        .iter()
        .flatten()
        .map(|descriptor| PollFd::from_borrowed_fd(*descriptor, PollFlags::IN))
        .collect();
    // A signal only ends the sleep early.
    let _ = poll(&mut waits, Some(&timeout));
}

fn describe_feed(feed: &Feed) -> String {
    let counts: Vec<String> = feed
        .counts()
        .named()
        .iter()
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| format!("{name} {count}"))
        .collect();
    if counts.is_empty() {
        return "the vehicle's feed: no frame of it has come\n".to_owned();
    }
    let mut text = format!("the vehicle's feed: {}\n", counts.join(", "));
    if let Some(second) = feed.figures().last() {
        writeln!(
            text,
            "the last second: {:.1} Hz, age on arrival {:.3} ms (at most {:.3} ms), jitter {:.3} ms; clock drift {:.1} ppm",
            second.rate,
            1e3 * second.latency,
            1e3 * second.latency_max,
            1e3 * second.jitter,
            1e6 * feed.drift()
        )
        .expect("a String takes all");
    }
    text
}

/// Returns the sections of a scenario that define the body's present pose as the vehicle at the origin, level, with yaw 0.
fn sections(system: CaptureSystem, stated: &MotionCapture, body: &Body, rate: f64) -> String {
    let axes = axes(system);
    let world_position = -(axes * body.position());
    let markers = roll_pitch_yaw(&(axes * body.mean_rotation()));
    let vector = |values: [f64; 3], digits: usize| {
        let values: Vec<String> = values
            .iter()
            .map(|value| format!("{value:.digits$}"))
            // Removes the sign of a rounded zero.
            .map(|text| {
                text.strip_prefix('-')
                    .filter(|rest| rest.parse() == Ok(0.0))
                    .map_or(text.clone(), str::to_owned)
            })
            .collect();
        format!("[{}]", values.join(", "))
    };
    let port = stated
        .port
        .map_or_else(String::new, |port| format!("port = {port}\n"));
    format!(
        "[estimator.kalman]\nposition_deviation = {:.2e}                  # m\n\n\
         [motion_capture]\nsource = \"{}\"\nserver = \"{}\"\n{port}interface = \"{}\"\nobject = {:?}\nrate = [{:.1}, {:.1}]                        # Hz\n\n\
         [motion_capture.world_from_capture]          # the body was at the origin of {{I}}\n\
         position = {}\nroll_pitch_yaw = {}\n\n\
         [motion_capture.body_from_markers]           # it was level, its nose along x\n\
         roll_pitch_yaw = {}\n",
        body.deviation().max(1e-5),
        system.name(),
        stated.server,
        stated.interface,
        stated.object,
        0.9 * rate,
        1.1 * rate,
        vector(world_position.into(), 5),
        vector(roll_pitch_yaw(&axes), 9),
        vector(markers, 5),
    )
}
