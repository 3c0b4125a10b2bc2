//! `gerono-bench laboratory`: latency from a capture's packet on a socket to the serial frame that responds to it, compared with
//! bare hops.
//!
//! A flight with all services at 1 kHz is connected to a VRPN server and to a receiver on a pseudo-terminal in this process. The
//! sent poses take off, stay at a point and tilt slightly to and fro there. The first frame that responds to a tilt is the
//! response to its capture.

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

/// The laboratory whose cameras and receiver this process simulates.
const SCENARIO: &str = include_str!("../../../scenarios/laboratory_simulated.toml");

/// Period of the captures, ns: not a whole number of ticks, so that captures are spread evenly over the tick.
const PERIOD_NS: u64 = 10_370_000;
/// Captures between two tilts.
const BETWEEN_TILTS: u32 = 12;
/// Captures between two requests to arm.
const BETWEEN_REQUESTS: u32 = 50;
/// Tilt to either side, rad.
const TILT: f64 = 0.02;
/// Minimum change of the rate about the x axis that counts as a response to a tilt, rad/s; other changes are much smaller.
const ANSWER: f64 = 0.1;
/// Frame rate, Hz; a CRSF line carries some more.
const FRAME_RATE: f64 = 1000.0;

/// Size of the bare hops' pose: a VRPN pose with its header, bytes.
const POSE_LENGTH: usize = 96;
/// Rounds of a bare hop, at 1 kHz.
const ROUNDS: u64 = 3000;

/// Simulated climb rate, m/s, and height, m.
const RISE: f64 = 0.4;
const HEIGHT: f64 = 1.2;
/// Time from the first armed frame to the simulated take-off, and to the first tilt, ns.
const LIFT_AFTER_NS: u64 = 300_000_000;
const TILT_AFTER_NS: u64 = 6_000_000_000;
/// Timeout until the first armed frame, ns.
const ARMING_TIMEOUT_NS: u64 = 30_000_000_000;

/// Results of the measurement, s.
#[derive(Clone, Debug, Serialize)]
struct Measured {
    /// Latency from sending a packet to the arrival of the responding frame.
    packet_to_frame: Quantiles,
    /// Tilts without a response before the next one.
    unanswered: u64,
    /// Latency of a pose's bytes through a TCP connection.
    socket_hop: Quantiles,
    /// Four bare hops from process to process.
    four_hops: Quantiles,
    /// Latency of a frame's bytes through a pseudo-terminal.
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
    let serial_hop = bare_hop(receiver_target(&scenario)?, crsf::LENGTH)?;
    let four_hops = chain::four_hops(core, false, ROUNDS).map_err(RunFailure::setup)?;

    let mut peers = LaboratoryPeers::open(&scenario)?;
    let mut flight = RunningFlight::begin(&folder, &scenario)?;
    let tilts = peers.fly(&mut flight, u64::from(seconds) * 1_000_000_000)?;
    flight.end()?;
    let no_answer = || RunFailure::setup("no frame has responded to a tilt of the vehicle");
    Ok(Measured {
        packet_to_frame: Quantiles::of(&tilts.answered).ok_or_else(no_answer)?,
        unanswered: tilts.unanswered,
        socket_hop,
        four_hops,
        serial_hop,
    })
}

/// Returns a free port of the loopback.
fn free_address() -> Result<SocketAddr> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0));
    listener
        .and_then(|listener| listener.local_addr())
        .map_err(RunFailure::setup)
}

fn missing() -> RunFailure {
    RunFailure::setup("the laboratory has no cameras or no radio link")
}

/// Returns the address of the receiver of a scenario's radio link.
fn receiver_target(scenario: &Scenario) -> Result<Target> {
    let link = scenario.rc_output.as_ref().ok_or_else(missing)?;
    let transmitter = link.transmitter.as_ref().ok_or_else(missing)?;
    Target::new(link.link, transmitter).ok_or_else(missing)
}

/// Measures the latency from writing `length` bytes at one end of a link to reading them at the other, in another thread.
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
    Quantiles::of(&times).ok_or_else(|| RunFailure::setup("nothing was received through a bare hop"))
}

/// Returns the laboratory's scenario, connected to this process, at the maximum rates.
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

/// The flight in a separate process.
struct RunningFlight {
    process: Members,
    name: String,
}

impl RunningFlight {
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

    /// Sends a request to the flight, if it is reachable.
    fn request(&self, question: &Question) {
        // The answer is not needed: the effect of the request is observed.
        let run = LiveRun::find(Some(&self.name), "bench laboratory");
        let _answer = run.and_then(|run| run.ask(question, PATIENCE));
    }

    /// Requests arming, which is granted once all checks pass.
    fn arm(&mut self) -> Result<()> {
        self.process.check().map_err(RunFailure::setup)?;
        self.request(&Question::Operate(Request::Arm));
        Ok(())
    }

    /// Ends the flight. Its outcome is irrelevant: the measurement is complete.
    fn end(mut self) -> Result<()> {
        for question in [Question::Operate(Request::Disarm), Question::Stop, Question::Stop] {
            self.request(&question);
        }
        for child in &mut self.process.0 {
            child.wait().map_err(RunFailure::setup)?;
        }
        Ok(())
    }
}

/// A tilt without a response yet.
#[derive(Clone, Copy)]
struct Tilt {
    /// Time at which its capture was sent, ns.
    sent_ns: u64,
    /// Rate of the previous frame, rad/s.
    rate_before: f64,
}

/// Results of the tilts.
struct Tilts {
    /// Times until the response, ns.
    answered: hdrhistogram::Histogram<u64>,
    unanswered: u64,
}

/// The cameras and the receiver.
struct LaboratoryPeers {
    cameras: CameraSender,
    noise: Noise,
    line: ReceiverInput,
    receiver: Receiver,
    link: RcLink,
    /// Rate about the x axis, rad/s, and arming state of the last frame.
    last_frame: (f64, bool),
}

impl LaboratoryPeers {
    fn open(scenario: &Scenario) -> Result<Self> {
        let (system, stated) = scenario.capture_system().ok_or_else(missing)?;
        let link = scenario.rc_output.clone().ok_or_else(missing)?;
        let transmitter = link.transmitter.as_ref().ok_or_else(missing)?;
        Ok(Self {
            cameras: CameraSender::open(system, stated, 1, 0).map_err(RunFailure::setup)?,
            noise: Noise::new(1, Stream::CameraNoise),
            line: ReceiverInput::open(&receiver_target(scenario)?).map_err(RunFailure::setup)?,
            receiver: Receiver::new(&link, transmitter).ok_or_else(missing)?,
            link,
            last_frame: (0.0, false),
        })
    }

    /// Sends poses of the vehicle on the ground until it is armed, in take-off, and tilting for `lasts_ns`.
    fn fly(&mut self, flight: &mut RunningFlight, lasts_ns: u64) -> Result<Tilts> {
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
            if armed_ns.is_none() && self.last_frame.1 {
                armed_ns = Some(now_ns);
            }
            let flown_ns = armed_ns.map_or(0, |armed_ns| now_ns - armed_ns);
            if flown_ns > TILT_AFTER_NS + lasts_ns {
                break;
            }
            if armed_ns.is_none() && now_ns - began_ns > ARMING_TIMEOUT_NS {
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
            let rate_before = self.last_frame.0;
            let sent_ns = self.send_pose(number, height(flown_ns), roll);
            if is_tilted && number % BETWEEN_TILTS == 0 {
                tilts.unanswered += u64::from(open.is_some());
                open = Some(Tilt { sent_ns, rate_before });
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        Ok(tilts)
    }

    /// Sends a pose. Returns the time of sending, ns.
    fn send_pose(&mut self, number: u32, height: f64, roll: f64) -> u64 {
        let mut draws = self.noise.at(u64::from(number));
        // Identical poses in a row count as frozen cameras.
        let position = Vector3::new(0.0, 0.0, -height) + draws.normal3() * 1e-5;
        let attitude = exp(&(Vector3::new(roll, 0.0, 0.0) + draws.normal3() * 1e-5));
        let pose = MocapPose {
            position_world: position.into(),
            world_from_body: to_row_major(&attitude),
            tracked: true.into(),
            ..MocapPose::new_zeroed()
        };
        let now_ns = monotonic_ns();
        self.cameras.schedule(&pose, now_ns);
        self.cameras.send(now_ns);
        now_ns
    }

    /// Receives frames until a time. Returns the arrival of the first that responds to the open tilt.
    fn listen_until(&mut self, until_ns: u64, open: Option<Tilt>) -> Option<u64> {
        let Self {
            line,
            receiver,
            link,
            last_frame,
            ..
        } = self;
        let mut answered_ns = None;
        line.listen_until(until_ns, &mut |bytes, now_ns| {
            receiver.push(bytes, &mut |command| {
                *last_frame = (command.rates_body(link)[0], command.is_armed);
                let answers = open.is_some_and(|tilt| (last_frame.0 - tilt.rate_before).abs() > ANSWER);
                if answers && answered_ns.is_none() {
                    answered_ns = Some(now_ns);
                }
            });
        });
        answered_ns
    }
}

/// Returns the simulated height at a time after arming, m.
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
            "capture's packet on a socket → serial frame that responds",
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
        "{} tilts of the vehicle were answered, {} were not. A packet waits for the next tick, and a frame for its due time: \
         at most 1 ms each; the second wait is nearly constant within a flight.\n",
        measured.packet_to_frame.count, measured.unanswered,
    )
}
