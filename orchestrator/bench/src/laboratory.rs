//! `gerono-bench laboratory`: from a capture's packet on a socket to the serial frame that rests on it, beside the bare hops.
//!
//! A flight with all services at 1 kHz is connected to a VRPN server and to a receiver on a pseudo-terminal, both of which are
//! here. The vehicle seems to take off and to stay at its point; there it seems to tilt by a little, to and fro. The first frame
//! that answers a tilt is the first that rests on the capture in which it was seen.

use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::Path;
use std::process::Stdio;

use comfy_table::{Table, presets};
use nalgebra::Vector3;
use radio_link::crsf;
use radio_link::port::{Port, Target};
use radio_link::receiver::Receiver;
use runtime::deployment;
use runtime::flight_clock::{monotonic_ns, nap_until};
use runtime::shared_page::Request;
use scenario::{RcLink, Scenario, Timing};
use serde::Serialize;
use shared_types::noise::{Noise, Stream};
use shared_types::rotation::{exp, to_row_major};
use shared_types::samples::MocapPose;
use zerocopy::FromZeros;

use super::chain;
use super::latency::microseconds;
use super::measure::{FlightCommand, Result, Scratch, gerono, progress_of};
use super::ring::Members;
use crate::arguments::BenchLaboratory;
use command_line::failure::Failure;
use command_line::output::{print, write_json};
use hil_simulator::cameras::CameraSender;
use hil_simulator::receiver_input::ReceiverInput;
use metrics::summary::timing::{Quantiles, histogram};
use run_client::{LiveRun, PATIENCE, Question};
use supervisor::RunFailure;

/// The laboratory whose cameras and receiver are here.
const SCENARIO: &str = include_str!("../../../scenarios/laboratory_simulated.toml");

/// Time between two captures, ns: no whole number of ticks, so that they come at every time of a tick alike.
const PERIOD_NS: u64 = 10_370_000;
/// Captures from one tilt to the next.
const BETWEEN_TILTS: u32 = 12;
/// Captures from one request to arm to the next.
const BETWEEN_REQUESTS: u32 = 50;
/// To either side, rad.
const TILT: f64 = 0.02;
/// A change of the rate about the x axis that answers a tilt, of which other changes are a small part, rad/s.
const ANSWER: f64 = 0.1;
/// Frames a second; a CRSF line carries some more.
const FRAME_RATE: f64 = 1000.0;

/// The capture and the frame of the bare hops: a VRPN pose with its header, and a CRSF frame. Bytes.
const POSE_LENGTH: usize = 96;
/// Rounds of a bare hop, one a millisecond.
const ROUNDS: u64 = 3000;

/// The apparent speed of the climb, m/s, and its height, m.
const RISE: f64 = 0.4;
const HEIGHT: f64 = 1.2;
/// From the first frame with which motors turn until the vehicle seems to rise, and until it seems to tilt, ns.
const LIFT_AFTER_NS: u64 = 300_000_000;
const TILT_AFTER_NS: u64 = 6_000_000_000;
/// Longest time until that frame, ns.
const PATIENCE_NS: u64 = 30_000_000_000;

/// All that was measured, s.
#[derive(Clone, Debug, Serialize)]
struct Measured {
    /// From the sending of a packet until the frame that rests on it has come.
    packet_to_frame: Quantiles,
    /// Tilts that no frame has answered before the next.
    unanswered: u64,
    /// Bytes of a pose, from one process's end of a TCP connection to the other.
    socket_hop: Quantiles,
    /// Four bare hops from process to process.
    four_hops: Quantiles,
    /// Bytes of a frame, through a pseudo-terminal.
    serial_hop: Quantiles,
}

/// `gerono-bench laboratory`.
///
/// # Errors
/// [`Failure`].
pub(super) fn laboratory(arguments: &BenchLaboratory) -> std::result::Result<(), Failure> {
    let measured = measure(arguments.seconds).map_err(Failure::trouble)?;
    print(format!("{}\n{}", table(&measured), explanation(&measured)));
    match &arguments.json {
        Some(path) => write_json(path, &measured),
        None => Ok(()),
    }
}

fn measure(seconds: u32) -> Result<Measured> {
    let folder = Scratch::create()?;
    let device = folder.path().join("radio");
    let core = deployment::idlest(&deployment::allowed_cores()).unwrap_or(0);
    let scenario = connected(free_address()?.port(), &device, seconds)?;
    let socket_hop = bare_hop(Target::Tcp(free_address()?), POSE_LENGTH)?;
    let serial_hop = bare_hop(receivers_end(&scenario)?, crsf::LENGTH)?;
    let four_hops = chain::four_hops(core, false, ROUNDS).map_err(RunFailure::setup)?;

    let mut here = Here::open(&scenario)?;
    let mut flight = FlightUnderWay::begin(&folder, &scenario)?;
    let tilts = here.fly(&mut flight, u64::from(seconds) * 1_000_000_000)?;
    flight.end()?;
    let no_answer = || RunFailure::setup("no frame has answered any tilt of the vehicle");
    Ok(Measured {
        packet_to_frame: Quantiles::of(&tilts.answered).ok_or_else(no_answer)?,
        unanswered: tilts.unanswered,
        socket_hop,
        four_hops,
        serial_hop,
    })
}

/// A free port of the loopback.
fn free_address() -> Result<SocketAddr> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0));
    listener
        .and_then(|listener| listener.local_addr())
        .map_err(RunFailure::setup)
}

fn missing() -> RunFailure {
    RunFailure::setup("the laboratory has no cameras or no radio link")
}

/// Returns where the receiver of a scenario's radio link listens.
fn receivers_end(scenario: &Scenario) -> Result<Target> {
    let link = scenario.rc_output.as_ref().ok_or_else(missing)?;
    let transmitter = link.transmitter.as_ref().ok_or_else(missing)?;
    Target::new(link.link, transmitter).ok_or_else(missing)
}

/// Time from the writing of so many bytes at one end until they have been read at the other, by another thread that waits
/// for them.
fn bare_hop(target: Target, length: usize) -> Result<Quantiles> {
    let mut line = ReceiverInput::open(&target).map_err(RunFailure::setup)?;
    let mut port = Port::open(target).map_err(RunFailure::setup)?;
    let mut times = histogram();
    let begins_ns = monotonic_ns() + 10_000_000;
    let ends_ns = begins_ns + (ROUNDS + 100) * 1_000_000;
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut bytes = vec![0; length];
            for round in 0..ROUNDS {
                nap_until(begins_ns + round * 1_000_000);
                let now_ns = monotonic_ns();
                bytes[..8].copy_from_slice(&now_ns.to_le_bytes());
                port.send(&bytes, now_ns);
            }
        });
        let mut waiting = Vec::new();
        let mut rounds = 0;
        while rounds < ROUNDS && monotonic_ns() < ends_ns {
            line.listen_until((monotonic_ns() + 1_000_000).min(ends_ns), &mut |bytes, _| {
                waiting.extend_from_slice(bytes);
                while waiting.len() >= length {
                    let sent_ns = u64::from_le_bytes(waiting[..8].try_into().expect("eight bytes"));
                    times.saturating_record(monotonic_ns().saturating_sub(sent_ns));
                    waiting.drain(..length);
                    rounds += 1;
                }
            });
        }
    });
    Quantiles::of(&times).ok_or_else(|| RunFailure::setup("nothing came through a bare hop"))
}

/// The laboratory's flight with its cameras and receiver here, as fast as it goes.
fn connected(cameras: u16, device: &Path, seconds: u32) -> Result<Scenario> {
    let mut flight: Scenario = toml::from_str(SCENARIO).map_err(RunFailure::setup)?;
    flight.duration = f64::from(seconds) + 60.0;
    flight.schedule = Timing::default();
    if let Some(stated) = &mut flight.motion_capture {
        stated.port = Some(cameras.into());
        stated.rate = [50.0, 500.0];
    }
    if let Some(estimator) = &mut flight.estimator {
        // No tilt is an outlier.
        estimator.kalman.gate = 1e9;
    }
    if let Some(transmitter) = flight
        .rc_output
        .as_mut()
        .and_then(|link| link.transmitter.as_mut())
    {
        transmitter.device = Some(device.display().to_string());
        transmitter.frame_rate = Some(FRAME_RATE);
    }
    if let Some(phases) = &mut flight.flight {
        phases.spool_up = 0.2;
    }
    Ok(flight)
}

/// The flight, by a command of its own.
struct FlightUnderWay {
    process: Members,
    name: String,
}

impl FlightUnderWay {
    fn begin(folder: &Scratch, scenario: &Scenario) -> Result<Self> {
        let flight = FlightCommand::write(folder, scenario)?;
        let child = gerono()?
            .args(["run", "--quiet", "--host", "realtime", "--out"])
            .arg(folder.path().join("flight"))
            .arg(flight.scenario())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .map_err(RunFailure::setup)?;
        Ok(Self {
            name: format!("{}-0", child.id()),
            process: Members(vec![child]),
        })
    }

    /// Sends a request, if a peer is connected.
    fn ask(&self, question: &Question) {
        // It says no more than what is seen of it.
        let run = LiveRun::find(Some(&self.name), "bench laboratory");
        let _answer = run.and_then(|run| run.ask(question, PATIENCE));
    }

    /// Asks for arming, which is granted once all is well.
    fn arm(&mut self) -> Result<()> {
        self.process.check().map_err(RunFailure::setup)?;
        self.ask(&Question::Operate(Request::Arm));
        Ok(())
    }

    /// However it ends: all is measured.
    fn end(mut self) -> Result<()> {
        for question in [Question::Operate(Request::Disarm), Question::Stop, Question::Stop] {
            self.ask(&question);
        }
        for child in &mut self.process.0 {
            child.wait().map_err(RunFailure::setup)?;
        }
        Ok(())
    }
}

/// A tilt that no frame has answered yet.
#[derive(Clone, Copy)]
struct Tilt {
    /// Time at which the capture was sent that shows it, ns.
    sent_ns: u64,
    /// The rates of the frame before, rad/s.
    rate_before: f64,
}

/// The outcome of the tilts.
struct Tilts {
    /// Times until the answer, ns.
    answered: hdrhistogram::Histogram<u64>,
    unanswered: u64,
}

/// The cameras and the receiver.
struct Here {
    cameras: CameraSender,
    noise: Noise,
    line: ReceiverInput,
    receiver: Receiver,
    link: RcLink,
    /// The last frame's rate about the x axis, rad/s, and whether motors may turn.
    asked: (f64, bool),
}

impl Here {
    fn open(scenario: &Scenario) -> Result<Self> {
        let (system, stated) = scenario.capture_system().ok_or_else(missing)?;
        let link = scenario.rc_output.clone().ok_or_else(missing)?;
        let transmitter = link.transmitter.as_ref().ok_or_else(missing)?;
        Ok(Self {
            cameras: CameraSender::open(system, stated, 1, 0).map_err(RunFailure::setup)?,
            noise: Noise::new(1, Stream::CameraNoise),
            line: ReceiverInput::open(&receivers_end(scenario)?).map_err(RunFailure::setup)?,
            receiver: Receiver::new(&link, transmitter).ok_or_else(missing)?,
            link,
            asked: (0.0, false),
        })
    }

    /// Shows the vehicle at rest until it is armed, as it takes off, and as it tilts for so long.
    fn fly(&mut self, flight: &mut FlightUnderWay, lasts_ns: u64) -> Result<Tilts> {
        let bar = progress_of("tilt", lasts_ns / (PERIOD_NS * u64::from(BETWEEN_TILTS)));
        let mut tilts = Tilts {
            answered: histogram(),
            unanswered: 0,
        };
        let began_ns = monotonic_ns();
        let (mut armed_ns, mut open) = (None, None);
        for number in 0.. {
            let due_ns = began_ns + u64::from(number) * PERIOD_NS;
            if let (Some(answered_ns), Some(Tilt { sent_ns, .. })) = (self.listen_until(due_ns, open), open) {
                tilts.answered.saturating_record(answered_ns - sent_ns);
                open = None;
            }
            let now_ns = monotonic_ns();
            if armed_ns.is_none() && self.asked.1 {
                armed_ns = Some(now_ns);
            }
            let flown_ns = armed_ns.map_or(0, |armed_ns| now_ns - armed_ns);
            if flown_ns > TILT_AFTER_NS + lasts_ns {
                break;
            }
            if armed_ns.is_none() && now_ns - began_ns > PATIENCE_NS {
                return Err(RunFailure::setup("the flight could not be armed"));
            }
            if armed_ns.is_none() && number % BETWEEN_REQUESTS == 0 {
                flight.arm()?;
            }
            let is_tilted = flown_ns > TILT_AFTER_NS;
            let side = if (number / BETWEEN_TILTS).is_multiple_of(2) {
                -1.0
            } else {
                1.0
            };
            let roll = if is_tilted { side * TILT } else { 0.0 };
            let rate_before = self.asked.0;
            let sent_ns = self.show(number, height(flown_ns), roll);
            if is_tilted && number % BETWEEN_TILTS == 0 {
                tilts.unanswered += u64::from(open.is_some());
                open = Some(Tilt { sent_ns, rate_before });
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        Ok(tilts)
    }

    /// Sends what the cameras see; when, ns.
    fn show(&mut self, number: u32, height: f64, roll: f64) -> u64 {
        let mut draws = self.noise.at(u64::from(number));
        // Cameras that report the same pose twice count as frozen.
        let position = Vector3::new(0.0, 0.0, -height) + draws.normal3() * 1e-5;
        let attitude = exp(&(Vector3::new(roll, 0.0, 0.0) + draws.normal3() * 1e-5));
        let seen = MocapPose {
            position_world: position.into(),
            world_from_body: to_row_major(&attitude),
            tracked: true.into(),
            ..MocapPose::new_zeroed()
        };
        let now_ns = monotonic_ns();
        self.cameras.schedule(&seen, now_ns);
        self.cameras.send(now_ns);
        now_ns
    }

    /// Hears frames until a time; when the first has come that answers a tilt.
    fn listen_until(&mut self, until_ns: u64, open: Option<Tilt>) -> Option<u64> {
        let Self {
            line,
            receiver,
            link,
            asked,
            ..
        } = self;
        let mut answered_ns = None;
        line.listen_until(until_ns, &mut |bytes, now_ns| {
            receiver.push(bytes, &mut |command| {
                *asked = (command.rates_body(link)[0], command.is_armed);
                let answers = open.is_some_and(|tilt| (asked.0 - tilt.rate_before).abs() > ANSWER);
                if answers && answered_ns.is_none() {
                    answered_ns = Some(now_ns);
                }
            });
        });
        answered_ns
    }
}

/// The apparent height of the vehicle so long after its motors began to turn, m.
fn height(flown_ns: u64) -> f64 {
    let rising_ns = flown_ns.saturating_sub(LIFT_AFTER_NS);
    (RISE * shared_types::service::seconds(rising_ns)).min(HEIGHT)
}

fn table(measured: &Measured) -> Table {
    let mut table = Table::new();
    table
        .load_style(presets::UTF8_HORIZONTAL_ONLY)
        .set_header(["", "µs\np50 / p99 / p99.9 / max"]);
    for (what, quantiles) in [
        (
            "capture's packet on a socket → serial frame that rests on it",
            &measured.packet_to_frame,
        ),
        ("bare: a pose through TCP", &measured.socket_hop),
        ("bare: four hops from process to process", &measured.four_hops),
        ("bare: a frame through a pseudo-terminal", &measured.serial_hop),
    ] {
        table.add_row([what.to_owned(), microseconds(Some(quantiles))]);
    }
    table
}

fn explanation(measured: &Measured) -> String {
    format!(
        "{} tilts of the vehicle were answered, {} were not. A packet waits for the next tick, and a frame for the time at which \
         it is due: 1 ms each at most, the second about the same for a whole flight.\n",
        measured.packet_to_frame.count, measured.unanswered,
    )
}
