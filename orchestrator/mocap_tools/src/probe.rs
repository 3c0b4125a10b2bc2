//! `gerono mocap probe`.

use std::collections::BTreeMap;
use std::fmt::Write;

use comfy_table::{Table, presets};
use motion_capture::conventions::axes;
use motion_capture::diagnosis::{Diagnosis, FAR};
use motion_capture::feed::Feed;
use motion_capture::figures::Moments;
use motion_capture::transport::{Address, CaptureSource};
use motion_capture::wire::{CapturePose, Frame, Name, PoseError, WireBody};
use nalgebra::{Matrix3, Vector3};
use runtime::flight_clock::monotonic_ns;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use scenario::{CaptureSystem, MotionCapture, Problem};
use shared_types::rotation::{orthonormalized, roll_pitch_yaw};

use crate::arguments::MocapProbe;
use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt::Interrupt;
use command_line::output::{print, write};

/// Longest sleep, ns.
const SLEEP_NS: u64 = 50_000_000;

/// Deviation of the position above which a body is taken to move, m.
const AT_REST: f64 = 2e-3;

/// Deviation of the position of a body at rest below which no cameras can have measured it, m.
const NO_NOISE: f64 = 1e-6;

/// Most bodies and delays that are kept.
const BODIES: usize = 1000;
const DELAYS: usize = 1 << 20;

pub(super) fn probe(arguments: &MocapProbe) -> Result<Exit, Failure> {
    let system = CaptureSystem::from(arguments.source);
    let stated = stated(system, arguments);
    let bad = |problem: Problem| Failure::bad_input(problem.to_string());
    if let Some(problem) = stated.problems().into_iter().next() {
        return Err(bad(problem));
    }
    let address = Address::new(system, &stated).map_err(bad)?;
    let mut feed = match &arguments.object {
        Some(_) => Some(Feed::new(system, &stated).map_err(bad)?),
        None => None,
    };
    let mut diagnosis = Diagnosis::new(system, &stated).map_err(bad)?;
    let mut source = CaptureSource::open(&address).map_err(Failure::trouble)?;
    let interrupt = Interrupt::install().map_err(Failure::trouble)?;
    let mut heard = ReceivedPackets {
        is_motive: system == CaptureSystem::Natnet,
        ..ReceivedPackets::default()
    };
    let signal = listen(
        arguments.seconds,
        &mut source,
        &interrupt,
        &mut |frame, now_ns| {
            heard.take(frame, now_ns);
            diagnosis.take(frame);
            if let Some(feed) = &mut feed {
                feed.take(frame, now_ns);
            }
        },
    );
    if let Some(signal) = signal {
        return Ok(Exit::Signal(signal));
    }
    print(heard.describe(&source));
    // Without `--object` every body counts as another one.
    let findings = diagnosis.with(&source).to_string();
    if heard.frames == 0 {
        return Err(Failure::trouble(nothing_came(
            &address,
            &source,
            &findings,
            arguments.seconds,
        )));
    }
    let Some(feed) = feed else {
        print(paragraph(&findings));
        return Ok(Exit::Success);
    };
    print(describe_feed(&feed));
    if feed.counts().believed == 0 {
        let because = if findings.is_empty() {
            "the bodies that came stand above".to_owned()
        } else {
            findings
        };
        let reason = format!("no pose of `{}` could be believed; {because}", stated.object);
        return Err(Failure::trouble(reason));
    }
    print(paragraph(&findings));
    if let Some(path) = &arguments.calibrate {
        let name = stated.name_and_number().map_or("", |(name, _)| name);
        let body = heard.bodies.values().find(|body| {
            (name.is_empty() || body.name.as_bytes() == name.as_bytes())
                && stated
                    .name_and_number()
                    .is_none_or(|(_, wanted)| wanted.is_none_or(|wanted| wanted == body.number))
        });
        let body = body.filter(|body| body.deviation() <= AT_REST);
        let body = body.ok_or_else(|| {
            let reason = "the body moves: put the vehicle level at the origin of {I}, its nose along x, and let it rest";
            Failure::trouble(reason)
        })?;
        write(path, &calibration(system, &stated, body, heard.rate()))?;
        print(format!("calibration written to {}\n", path.display()));
    }
    Ok(Exit::Success)
}

/// Returns why no frame came.
fn nothing_came(address: &Address, source: &CaptureSource, findings: &str, seconds: f64) -> String {
    let server = address.server;
    if source.counts().malformed.total() > 0 {
        return format!("packets came from {server}, and no frame of them could be read; {findings}");
    }
    let advice = "see docs/motion_capture.md for what to check first";
    format!("nothing came from {server} in {seconds} s; {advice}")
}

/// Returns a text as a line of its own; an empty one stays empty.
fn paragraph(text: &str) -> String {
    if text.is_empty() {
        String::new()
    } else {
        format!("{text}\n")
    }
}

fn stated(system: CaptureSystem, arguments: &MocapProbe) -> MotionCapture {
    MotionCapture {
        port: arguments.port.map(u32::from),
        interface: arguments.interface.to_string(),
        ..MotionCapture::new(
            system,
            arguments.server,
            arguments.object.as_deref().unwrap_or_default(),
        )
    }
}

/// Listens for some seconds; returns the signal that ended it before.
fn listen(
    seconds: f64,
    source: &mut CaptureSource,
    interrupt: &Interrupt,
    take: &mut dyn FnMut(&Frame, u64),
) -> Option<i32> {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "an hour at most"
    )]
    let end_ns = monotonic_ns() + (seconds * 1e9) as u64;
    loop {
        let now_ns = monotonic_ns();
        if now_ns >= end_ns {
            return None;
        }
        if let Some(signal) = interrupt.take() {
            return Some(signal);
        }
        source.poll(now_ns, &mut |frame| take(frame, now_ns));
        sleep(source, end_ns);
    }
}

/// Until something has arrived or is due.
fn sleep(source: &CaptureSource, end_ns: u64) {
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
    // Interrupted by a signal it is looked at sooner.
    let _ = poll(&mut waits, Some(&timeout));
}

/// The poses of a body.
struct Body {
    /// Its last name; a Motive names its bodies after the first frames.
    name: Name,
    number: i32,
    refused: u64,
    reason: Option<PoseError>,
    frames: u64,
    seen: u64,
    position: [Moments; 3],
    rotation: Matrix3<f64>,
    turned: Moments,
    first: Option<CapturePose>,
}

impl Body {
    fn new(number: i32) -> Self {
        Self {
            name: Name::EMPTY,
            number,
            refused: 0,
            reason: None,
            frames: 0,
            seen: 0,
            position: [Moments::default(); 3],
            rotation: Matrix3::zeros(),
            turned: Moments::default(),
            first: None,
        }
    }

    /// Returns the reason to doubt the body's poses, if there is one.
    fn doubt(&self) -> Option<String> {
        if let Some(reason) = self.reason {
            return Some(format!("{} times {reason}", self.refused));
        }
        if self.seen > 1 && self.place().norm() > FAR {
            let distance = self.place().norm();
            return Some(format!(
                "{distance:.0} m from the origin: centimetres or millimetres?"
            ));
        }
        (self.seen > 1 && self.deviation() < NO_NOISE).then(|| {
            "noise below 1 µm, which no cameras have: metres for millimetres, or a pose that stands still?".to_owned()
        })
    }

    fn take(&mut self, body: &WireBody) {
        self.frames += 1;
        if body.name != Name::EMPTY {
            self.name = body.name;
        }
        let Some(pose) = &body.pose else {
            return;
        };
        self.seen += 1;
        for (moments, coordinate) in self.position.iter_mut().zip(pose.position.iter()) {
            moments.push(*coordinate);
        }
        self.rotation += pose.capture_from_markers;
        let first = self.first.get_or_insert(*pose);
        // For small angles |R1 − R2|F = √2 times the angle.
        let turned = (pose.capture_from_markers - first.capture_from_markers).norm() / 2.0_f64.sqrt();
        self.turned.push(turned);
    }

    fn place(&self) -> Vector3<f64> {
        Vector3::from(self.position.map(|moments| moments.mean()))
    }

    /// Largest standard deviation of a coordinate, m.
    fn deviation(&self) -> f64 {
        self.position.iter().map(Moments::deviation).fold(0.0, f64::max)
    }

    fn mean_rotation(&self) -> Matrix3<f64> {
        #[expect(clippy::cast_precision_loss, reason = "an hour of frames is exact")]
        let mean = self.rotation / self.seen.max(1) as f64;
        (0..8).fold(mean, |rotation, _| orthonormalized(&rotation))
    }
}

/// The packets received.
#[derive(Default)]
struct ReceivedPackets {
    frames: u64,
    first_ns: u64,
    last_ns: u64,
    between: Moments,
    /// Time from stamp to arrival beyond the soonest, s.
    delays: Vec<f64>,
    soonest: Option<i64>,
    /// The bodies by what tells them apart: Motive's by their ids, others by names and sensors.
    bodies: BTreeMap<(Vec<u8>, i32), Body>,
    is_motive: bool,
}

impl ReceivedPackets {
    fn take(&mut self, frame: &Frame, now_ns: u64) {
        if self.frames == 0 {
            self.first_ns = now_ns;
        } else {
            self.between.push(seconds(now_ns - self.last_ns));
        }
        self.frames += 1;
        self.last_ns = now_ns;
        if let Some(stamp) = frame.stamp {
            let delay = now_ns.cast_signed().saturating_sub(stamp.sent_ns);
            let soonest = *self.soonest.get_or_insert(delay);
            self.soonest = Some(soonest.min(delay));
            #[expect(clippy::cast_precision_loss, reason = "ms in ns are exact")]
            let delay = delay.saturating_sub(soonest) as f64 * 1e-9;
            // A server may send as much as it likes, and call it what it likes.
            if self.delays.len() < DELAYS {
                self.delays.push(delay);
            }
        }
        for body in frame.bodies() {
            let key = self.key(body);
            if self.bodies.len() < BODIES || self.bodies.contains_key(&key) {
                let known = self.bodies.entry(key).or_insert_with(|| Body::new(body.number));
                known.take(body);
            }
        }
        for (body, reason) in frame.refused() {
            if let Some(known) = self.bodies.get_mut(&self.key(body)) {
                known.refused += 1;
                known.reason = Some(reason);
            }
        }
    }

    fn key(&self, body: &WireBody) -> (Vec<u8>, i32) {
        let name = if self.is_motive { &[] } else { body.name.as_bytes() };
        (name.to_vec(), body.number)
    }

    /// Frames a second.
    fn rate(&self) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "an hour of frames is exact")]
        let frames = self.frames.saturating_sub(1) as f64;
        frames / seconds(self.last_ns - self.first_ns).max(1e-9)
    }

    fn describe(&self, source: &CaptureSource) -> String {
        let counts = source.counts();
        let mut text = format!(
            "packets {}, frames {}, malformed {}, from strangers {}, connections {}, failures {}\n",
            counts.packets,
            counts.frames,
            counts.malformed.total(),
            counts.foreign,
            counts.connections,
            counts.failures
        );
        if let Some(server) = source.natnet_server() {
            let to = match server.multicast {
                Some([a, b, c, d]) => format!("multicast to {a}.{b}.{c}.{d}:{}", server.data_port),
                None => format!("unicast to port {}", server.data_port),
            };
            writeln!(text, "Motive speaks NatNet {}, {to}", server.version).expect("a String takes all");
        }
        if counts.continued > 0 {
            writeln!(
                text,
                "{} datagrams continued the frame before: choose a larger block in Tracker",
                counts.continued
            )
            .expect("a String takes all");
        }
        let announced: Vec<String> = source.announced().map(|name| format!("`{name}`")).collect();
        if !announced.is_empty() {
            writeln!(text, "announced: {}", announced.join(", ")).expect("a String takes all");
        }
        if self.frames > 1 {
            writeln!(
                text,
                "{:.2} packets of poses a second, jitter of the arrival {:.3} ms (one standard deviation)",
                self.rate(),
                1e3 * self.between.deviation()
            )
            .expect("a String takes all");
        }
        if let [p50, p99, most] = self.delay_percentiles()[..] {
            writeln!(
                text,
                "later than the soonest by its stamp: p50 {:.3} ms, p99 {:.3} ms, at most {:.3} ms",
                1e3 * p50,
                1e3 * p99,
                1e3 * most
            )
            .expect("a String takes all");
        }
        if !self.bodies.is_empty() {
            writeln!(text, "{}", self.table()).expect("a String takes all");
            for body in self.bodies.values() {
                text.push_str(&self.doubts(body));
            }
        }
        text
    }

    fn delay_percentiles(&self) -> Vec<f64> {
        let Some(soonest) = self.delays.iter().copied().reduce(f64::min) else {
            return Vec::new();
        };
        let mut delays: Vec<f64> = self.delays.iter().map(|delay| delay - soonest).collect();
        delays.sort_by(f64::total_cmp);
        let last = delays.len() - 1;
        [last / 2, last - last / 100, last]
            .map(|index| delays[index])
            .to_vec()
    }

    /// Lines about what cannot work with a body.
    fn doubts(&self, body: &Body) -> String {
        let label = if body.name == Name::EMPTY {
            format!("#{}", body.number)
        } else {
            body.name.to_string()
        };
        let mut text = String::new();
        if let Some(doubt) = body.doubt() {
            writeln!(text, "`{label}`: {doubt}").expect("a String takes all");
        }
        if std::str::from_utf8(body.name.as_bytes()).is_err() {
            let way = if self.is_motive {
                format!("choose it by `#{}`", body.number)
            } else {
                "rename it".to_owned()
            };
            writeln!(
                text,
                "`{label}` is not UTF-8, so that its name cannot be written: {way}"
            )
            .expect("a String takes all");
        }
        text
    }

    fn table(&self) -> Table {
        let mut table = Table::new();
        table.load_style(presets::UTF8_HORIZONTAL_ONLY);
        table.set_header([
            "body",
            "number",
            "rate [Hz]",
            "seen [%]",
            "place, capture frame [m]",
            "position σ [mm]",
            "attitude [mrad]",
        ]);
        for body in self.bodies.values() {
            #[expect(clippy::cast_precision_loss, reason = "an hour of frames is exact")]
            let (frames, seen) = (body.frames as f64, body.seen as f64);
            let place = body.place();
            let rests = body.deviation() <= AT_REST;
            let noise = if rests {
                format!("{:.3}", 1e3 * body.deviation())
            } else {
                "moves".to_owned()
            };
            let turned = if rests {
                format!("{:.2}", 1e3 * body.turned.mean())
            } else {
                String::new()
            };
            table.add_row([
                if body.name == Name::EMPTY {
                    "no name".to_owned()
                } else {
                    format!("`{}`", body.name)
                },
                body.number.to_string(),
                format!("{:.1}", frames / seconds(self.last_ns - self.first_ns).max(1e-9)),
                format!("{:.1}", 100.0 * seen / frames),
                format!("{:.3} {:.3} {:.3}", place.x, place.y, place.z),
                noise,
                turned,
            ]);
        }
        table
    }
}

fn describe_feed(feed: &Feed) -> String {
    let counts: Vec<String> = feed
        .counts()
        .named()
        .iter()
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| format!("{name} {count}"))
        .collect();
    let mut text = format!("the vehicle's feed: {}\n", counts.join(", "));
    if let Some(second) = feed.figures().last() {
        writeln!(
            text,
            "the last second: {:.1} Hz, age on arrival {:.3} ms (at most {:.3} ms), jitter {:.3} ms; drift of its clock {:.1} ppm",
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

/// The sections of a scenario with which the body, as it lies, is the vehicle at the origin, level, with yaw 0.
fn calibration(system: CaptureSystem, stated: &MotionCapture, body: &Body, rate: f64) -> String {
    let axes = axes(system);
    let world_position = -(axes * body.place());
    let markers = roll_pitch_yaw(&(axes * body.mean_rotation()));
    let vector = |values: [f64; 3], digits: usize| {
        let values: Vec<String> = values
            .iter()
            .map(|value| format!("{value:.digits$}"))
            // A zero has no sign here.
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
         [motion_capture.world_from_capture]          # the body lay at the origin of {{I}}\n\
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

#[expect(clippy::cast_precision_loss, reason = "an hour in ns is exact")]
fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}
