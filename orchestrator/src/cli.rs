//! The command line of `gerono`.

use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use motion_capture::natnet::Version;
use runtime::crash::{Crash, CrashPlace};
use shared_types::scenario::suggest::known_names;
use shared_types::scenario::{CaptureSystem, EdgeName};
use shared_types::{ServiceId, Topic};

use crate::exit::Exit;
use crate::flight::crew::restart::PerService;
use crate::identify;
use crate::log::Compression;
use crate::matrix::{self, plan, trouble::Troubles};
use crate::reproduce::figures::Figure;

/// Flies an adaptive path-following quadcopter as independent processes, and logs every sample.
#[derive(Debug, Parser)]
#[command(name = "gerono", version, propagate_version = true, after_help = Exit::HELP)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What `gerono` can do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Fly a scenario and record it.
    ///
    /// Starts one process a service, flies the scenario in simulated time and writes run.mcap (the experiment:
    /// the same bytes for the same scenario and seed), host.mcap (the machine) and summary.json.
    Run(Run),
    /// Check a scenario and show its schedule and wiring, without flying it.
    Check(Check),
    /// Draw ‖z1‖ over time of one or several logs as an SVG figure.
    ///
    /// Planned faults are shaded; while a controller is out, the true distance from the path is drawn dotted.
    Plot(Plot),
    /// Show flights as one page that opens in any browser, without a network, and draw the paper's figures that they have.
    ///
    /// DIR/report.html holds everything: the way through space, which turns with the mouse and shows the vehicle at the moment
    /// under the pointer; errors, commands, estimates, attitude and timing law over time, on axes that zoom together; what
    /// happened when; the summary; the scenario; and of flights in real time how the services kept time.
    /// Several logs are laid over each other, a colour each. Of many samples in a column of pixels the smallest and the
    /// largest are kept: no peak is lost. Of a log that was never completed, what is whole is shown.
    ///
    /// A flight of one of the paper's figures is drawn as that figure too, as SVG beside the page.
    #[command(after_help = Report::EXAMPLES)]
    Report(Report),
    /// Write the samples of a log as JSON lines, or those of one topic as a table (CSV), for other programs; or a copy for viewers.
    ///
    /// Numbers are read back to the bit; those that are not finite are the words NaN, inf and -inf.
    ///
    /// With --view, an MCAP file with every message of the log as it is, and beside them what Foxglove, Lichtblick and Rerun need
    /// to show the flight in space: frames, the vehicle, its way and that of the reference (docs/viewers.md).
    #[command(after_help = Export::EXAMPLES)]
    Export(Export),
    /// Say what is in a log: scenario, seed, topics with their rates and gaps, planned faults, and how the run went.
    ///
    /// Reads all of it, so that what is damaged or was never closed is seen. What only summary.json and host.mcap beside it know
    /// (verdicts, deaths) is shown if they are there.
    Info(Info),
    /// Make a proper log of one that was never closed, was cut, or is damaged, and say what was kept and lost.
    ///
    /// Keeps every chunk whose checksum holds, before and behind the damage. The new log says in itself that it was recovered
    /// and what it lacks; the old one is left as it is. Given the folder of a run, does so for run.mcap and host.mcap.
    #[command(after_help = Recover::EXAMPLES)]
    Recover(Recover),
    /// Do the steps of a log again on what it has recorded, and compare what comes of them byte for byte.
    ///
    /// Every service is fed the recorded samples, so that a difference names the service that made it. Works on logs of
    /// simulated and of real time (whose host.mcap must lie beside run.mcap), with planned faults, and cut short. What the
    /// services knew is compared with the checkpoints in host.mcap; behind a gap in the log they go on from there.
    #[command(after_help = Replay::EXAMPLES)]
    Replay(Replay),
    /// Compare two logs: per topic identical, or how many samples differ, the first of them, and by how much.
    Diff(Diff),
    /// Print the SHA-256 of a log's messages (topic, time, payload): equal logs of equal experiments.
    Digest(Digest),
    /// Measure this machine: simulated seconds per wall second of every host, beside bare rings as floors.
    ///
    /// `gerono bench latency` measures flights in real time instead, `gerono bench recorder` what recording costs.
    Bench(Bench),
    /// Fly the paper's figures again, over many seeds in three laboratories, judge and draw them.
    ///
    /// Writes reproduce.json, figures.md, a drawing a figure, a page of the first flight of each, and index.html, which shows and links them. Fails only if a number has regressed: neither
    /// reaches its bar nor is a known gap. The seeds are 101 and following; gains were tuned on 1 to 6.
    Reproduce(Reproduce),
    /// Let every service and every edge of the wiring fail in every way, and see what becomes of the vehicle.
    ///
    /// Flies the scenario once without a fault and once for each of them, at several moments: every service but the plant
    /// off (warm and cold) and frozen, every edge with samples late by 0.05 s, half of them lost, stuck, wrong (a
    /// position by 0.1 m, a thrust by a fifth), garbage within ±10, and garbage of any bits.
    ///
    /// The vehicle has survived if it strayed no further than 1.5 times the bound, which is its largest distance from the
    /// path in the 5 s before or 0.02 m; it is degraded if it did and came back inside the bound, and lost if it did not,
    /// came 5 m away, tipped over, a number was not finite, or a service died of it. To lose it is a result, not an error.
    ///
    /// Writes faults.json and faults.md.
    #[command(after_help = Faults::EXAMPLES)]
    Faults(Faults),
    /// Check this machine before a flight: what is good (green), poor (yellow) or would not work (red), and how to mend it.
    ///
    /// Looks at shared memory, limits, cores, clock, governor, other runs and what dead ones have left, and measures for some
    /// seconds how fast the disk is and how late a sleeper wakes. With a scenario, all of it is judged by what that asks for:
    /// its `[deployment]`, the size of its log, its `real_time.grace`. Only flights in real time need sharp wake-ups. Changes nothing;
    /// docs/deployment.md explains every number.
    #[command(after_help = Doctor::EXAMPLES)]
    Doctor(Doctor),
    /// Listen to a motion-capture system, or seem to be one.
    Mocap(Mocap),
    /// Let the motors of a flight in real time turn: it takes off as soon as all is ready.
    ///
    /// Only a scenario with `[flight]` has something to arm. Refused while a service does not fly, the vehicle is not
    /// seen, its state is old, or the estimator has not converged.
    Arm(Operate),
    /// Let the motors of a flight in real time rest at once, in the air too; `gerono arm` takes it back.
    Disarm(Operate),
    /// Let the motors of a flight in real time rest at once and until the end of the run, whatever anybody asks for then.
    Kill(Operate),
    /// End a flight in real time: it lands and disarms first; asked again, it disarms in the air.
    Stop(Operate),
    /// Take over a flight in real time whose orchestrator has died: record and supervise it to its end.
    ///
    /// The services of such a flight go on alone: they land, or fly on to the end, as the scenario's
    /// `real_time.orchestrator_loss` says. Whoever takes over records from then on, starts services again that die, and
    /// answers `gerono arm`, `stop`, `top` and the like. What was not recorded meanwhile is not recovered.
    Attach(Attach),
    /// Look at a flight in real time while it goes on, from any terminal.
    ///
    /// Shows how every service keeps time, how long it is from a capture to the frame, the vehicle's error and estimates over
    /// the last minute, and what has happened. It only looks, and the flight never waits for it. With --allow-faults
    /// the selected service can be killed or frozen, each after a confirmation. The key `?` explains the keys and what is shown.
    #[command(after_help = Top::EXAMPLES)]
    Top(Top),
    /// Try a radio link on the ground, or find out what its channels mean.
    #[command(subcommand)]
    Rc(RcCommand),
    /// Be the laboratory for a flight that is to be in one: simulate vehicle, cameras and receiver behind its sockets and links.
    ///
    /// A hardware-in-the-loop simulator. It simulates the scenario's vehicle by the system's clock, sends what the scenario's
    /// cameras see of it as `estimator.source` (VRPN, NatNet, Vicon) to where the flight listens, and flies by the frames of
    /// `rc_output.link` that arrive where the flight sends them: at a pseudo-terminal, which gets the name that
    /// `rc_output.transmitter.device` states, or at a socket. The flight, `gerono run --host realtime` with the same settings,
    /// shares nothing else with it, and cannot tell.
    ///
    /// Its time begins with it: times in `[vehicle]` and `[cameras]` count from there. Writes run.mcap, which holds the truth,
    /// and host.mcap, which says when it began: `gerono truth FLIGHT --world WORLD` compares them with the flight.
    #[command(after_help = World::EXAMPLES)]
    World(World),
    /// Say how far the vehicle truly was from its path, while it flew along it.
    ///
    /// The error is the distance of the true position from the path at the γ of that time, at every tick: not the
    /// controller's z1, which rests on an estimate. The truth is that of the flight's own log, or of the log of `gerono world`.
    /// Parts: 5 s before the scenario's first event (a fan, a change), from there to the last part, the last part, all.
    #[command(after_help = Truth::EXAMPLES)]
    Truth(Truth),
    /// Remove what dead runs have left in memory and in the folder for temporary files.
    ///
    /// Only a run whose orchestrator was killed leaves anything; the next run removes it as well. Live runs are not
    /// touched.
    Clean,
    /// Print the JSON Schema of scenario files; editors complete and check them with it.
    Schema,
    /// Print the completion script of a shell: `gerono completions bash > /etc/bash_completion.d/gerono`.
    Completions {
        /// The shell.
        shell: Shell,
    },
    /// Run one service; only `gerono run` can start it.
    #[command(hide = true)]
    Service {
        /// Name of the service, or of a process that waits for one to die.
        #[arg(value_parser = service_process)]
        name: String,
    },
    /// Take part in a bare ring; only `gerono bench` can start it.
    #[command(hide = true)]
    RingMember(RingMember),
    /// Take part in a bare chain; only `gerono bench latency` can start it.
    #[command(hide = true)]
    ChainMember(ChainMember),
    /// Keep a core busy; only `gerono bench` can start it.
    #[command(hide = true)]
    Load {
        /// The core.
        core: usize,
    },
}

fn service_process(name: &str) -> Result<String, String> {
    if name != runtime::process::SPARE {
        service(name)?;
    }
    Ok(name.to_owned())
}

fn service(name: &str) -> Result<ServiceId, String> {
    ServiceId::from_name(name).ok_or_else(|| {
        let names: Vec<_> = ServiceId::ALL.iter().map(|service| service.name()).collect();
        format!("there is no such service; there are {}", names.join(", "))
    })
}

/// What a scenario is made of: a file and what is changed of it.
#[derive(Debug, Args)]
pub struct ScenarioArguments {
    /// The scenario file.
    pub scenario: PathBuf,
    /// Seed of every random draw, in place of the scenario's.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Change a value of the scenario, for example `--set controller.k1=5`; may be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
}

/// Arguments of `gerono run`.
#[derive(Debug, Args)]
pub struct Run {
    /// What to fly.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Where the services run and what makes them step; in simulated time the log is the same.
    #[arg(long, value_enum, default_value_t)]
    pub host: Host,
    /// Folder for the results; must be empty if it exists [default: the next free runs/SCENARIO-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Compression of the logs' chunks.
    #[arg(long, value_enum, default_value_t)]
    pub compression: Compression,
    /// Say nothing unless something is wrong.
    #[arg(long, short)]
    pub quiet: bool,
    /// How the services use the machine.
    #[command(flatten)]
    pub deployment: DeploymentArguments,
}

/// How the processes of a run use the machine. Nothing of it changes run.mcap.
#[derive(Debug, Args)]
#[command(next_help_heading = "Use of the machine (lock-step)")]
pub struct DeploymentArguments {
    /// Put the services under SCHED_FIFO, above all ordinary work; flies without if it is not permitted.
    #[arg(long)]
    pub fifo: bool,
    /// Keep the services together on this core instead of the idlest one.
    #[arg(long, value_name = "N", conflicts_with = "no_pin")]
    pub core: Option<usize>,
    /// Let the system place the services instead of keeping them together on the idlest core.
    #[arg(long)]
    pub no_pin: bool,
    /// Let a waiting service always sleep instead of yielding once first.
    #[arg(long)]
    pub no_yield: bool,
    /// How often in a row a service is started again without having flown a tick more [default: 8].
    ///
    /// For one service as SERVICE=N, else for all; may be given several times. With 0 its first death ends the run.
    #[arg(long, value_name = "[SERVICE=]N", value_parser = str::parse::<PerService<u32>>)]
    pub restarts: Vec<PerService<u32>>,
    /// Longest pause, in s, before a service that dies again and again is started once more [default: 0.1].
    #[arg(long, value_name = "[SERVICE=]S", value_parser = seconds_per_service)]
    pub restart_pause: Vec<PerService<f64>>,
    /// Let a service kill itself, as SERVICE@TICK:PLACE; may be given several times, for one process after the other.
    ///
    /// The log must show nothing of it. Places: before-ports, after-ports, recovering, before-step, after-step,
    /// between-publishes, after-publishing, checkpointing, before-waking.
    #[arg(long, value_name = "WHERE")]
    pub crash: Vec<ServiceCrash>,
}

fn seconds_per_service(text: &str) -> Result<PerService<f64>, String> {
    let parsed: PerService<f64> = text.parse()?;
    if (0.0..=60.0).contains(&parsed.value) {
        Ok(parsed)
    } else {
        Err("give a time from 0 to 60 s".to_owned())
    }
}

/// Where the process of a service shall kill itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServiceCrash {
    /// The service.
    pub service: ServiceId,
    /// Tick and place.
    pub crash: Crash,
}

impl FromStr for ServiceCrash {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('@').and_then(|(service, rest)| {
            let (tick, place) = rest.split_once(':')?;
            Some((service, tick, place))
        });
        let (service, tick, place) =
            parts.ok_or_else(|| "write it as controller@1500:before-step".to_owned())?;
        let services = ServiceId::ALL.map(ServiceId::name);
        let places = CrashPlace::ALL.map(CrashPlace::name);
        let position = |names: &[&str], name: &str| {
            let found = names.iter().position(|known| *known == name);
            found.ok_or_else(|| known_names(name, names))
        };
        Ok(Self {
            service: ServiceId::ALL[position(&services, service)?],
            crash: Crash {
                tick: tick.parse().map_err(|_| format!("`{tick}` is no tick"))?,
                place: CrashPlace::ALL[position(&places, place)?],
            },
        })
    }
}

/// Where the services of a flight run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Host {
    /// One process a service, simulated time, no sample ever lost.
    #[default]
    Lockstep,
    /// All services in one thread of this process.
    Inprocess,
    /// One process a service, the system's clock, the newest sample wins.
    Realtime,
}

impl Host {
    /// Name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lockstep => "lockstep",
            Self::Inprocess => "inprocess",
            Self::Realtime => "realtime",
        }
    }
}

/// Arguments of `gerono diff`.
#[derive(Debug, Args)]
pub struct Diff {
    /// The first log, or the folder of its run.
    pub first: PathBuf,
    /// The second log, or the folder of its run.
    pub second: PathBuf,
}

/// Arguments of `gerono replay`.
#[derive(Debug, Args)]
pub struct Replay {
    /// The log, or the folder of a run.
    pub log: PathBuf,
    /// Which services [default: all].
    #[arg(long = "service", value_delimiter = ',', value_name = "NAME,…", value_parser = service)]
    pub services: Vec<ServiceId>,
    /// Change a value of the scenario, for example `--set controller.k1=5`: what would have been published on these
    /// inputs? May be given several times; a difference is then no failure.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
    /// Compare from this time of the flight on, s. Each service begins with the newest that it is recorded to have known by
    /// then [default: the beginning].
    #[arg(long, value_name = "S", value_parser = flight_time)]
    pub from: Option<f64>,
    /// Compare up to this time of the flight, s, and stop [default: the end of the log].
    #[arg(long, value_name = "S", value_parser = flight_time)]
    pub to: Option<f64>,
    /// Replay each service in a process of its own, with the samples in shared memory, as it was flown.
    #[arg(long)]
    pub processes: bool,
    /// Show no progress.
    #[arg(long, short)]
    pub quiet: bool,
}

impl Replay {
    const EXAMPLES: &str = "Examples:\n  \
        gerono replay runs/fig1-1\n  \
        gerono replay runs/fig1-1 --from 12.0 --to 14.5\n  \
        gerono replay runs/fig1-1 --service controller --set controller.k1=5.0";
}

fn flight_time(text: &str) -> Result<f64, String> {
    number_between(text, 0.0, 1e9, "s")
}

/// Arguments of the commands that ask something of a live run.
#[derive(Debug, Args)]
pub struct Operate {
    /// The run, if several are under way: the name of its place, as `gerono doctor` shows it.
    #[arg(long, value_name = "ID")]
    pub run: Option<String>,
}

/// Arguments of `gerono attach`.
#[derive(Debug, Args)]
pub struct Attach {
    /// Which run.
    #[command(flatten)]
    pub run: Operate,
    /// Folder for the results; must be empty if it exists [default: the next free runs/attached-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Compression of the logs' chunks.
    #[arg(long, value_enum, default_value_t)]
    pub compression: Compression,
    /// Say nothing unless something is wrong.
    #[arg(long, short)]
    pub quiet: bool,
}

/// Arguments of `gerono top`.
#[derive(Debug, Args)]
pub struct Top {
    /// Which run.
    #[command(flatten)]
    pub run: Operate,
    /// Permit the keys that kill (`k`) and freeze (`f`) the selected service; without it they do nothing.
    #[arg(long, conflicts_with = "once")]
    pub allow_faults: bool,
    /// Print how the run is now, and no more; needs no terminal.
    #[arg(long)]
    pub once: bool,
    /// Print it as JSON, for other programs.
    #[arg(long, requires = "once")]
    pub json: bool,
}

impl Top {
    /// What `gerono top --help` shows.
    const EXAMPLES: &str = "Examples:\n  \
        gerono top\n  \
        gerono top --allow-faults\n  \
        gerono top --once --json | jq '.services[] | {name, rate, wake: .wake.p99}'\n\n\
        Exit codes: 0 left by a key, or the run has ended; 1 there is no such run, or no terminal.";
}

/// Arguments of `gerono mocap`.
#[derive(Debug, Args)]
pub struct Mocap {
    /// Which of both.
    #[command(subcommand)]
    pub command: MocapCommand,
}

/// What `gerono mocap` can do.
#[derive(Debug, Subcommand)]
pub enum MocapCommand {
    /// Listen to a motion-capture system for some seconds and print what arrives.
    ///
    /// Shows every body with its rate, the share of frames in which it is seen, its place and, if it rests, its noise; what
    /// the network makes of the frames; and, with --object, what the feed makes of them. With --calibrate it writes the
    /// sections of a scenario, such that the body as it lies is the vehicle at the origin of {I}, level, with yaw 0.
    #[command(after_help = MocapProbe::EXAMPLES)]
    Probe(MocapProbe),
    /// Send poses as a motion-capture system would: of a recorded flight, or of an eight. For tests and try-outs.
    #[command(after_help = MocapSend::EXAMPLES)]
    Send(MocapSend),
}

/// A motion-capture system on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Capture {
    /// Vicon Tracker's UDP object stream.
    #[value(alias = "vicon_udp")]
    Vicon,
    /// VRPN over TCP.
    Vrpn,
    /// Motive's NatNet.
    Natnet,
}

impl From<Capture> for CaptureSystem {
    fn from(capture: Capture) -> Self {
        match capture {
            Capture::Vicon => Self::ViconUdp,
            Capture::Vrpn => Self::Vrpn,
            Capture::Natnet => Self::Natnet,
        }
    }
}

/// Arguments of `gerono mocap probe`.
#[derive(Debug, Args)]
pub struct MocapProbe {
    /// What the system speaks.
    #[arg(long, value_enum)]
    pub source: Capture,
    /// IPv4 address of the machine that sends.
    #[arg(long, default_value_t = Ipv4Addr::LOCALHOST)]
    pub server: Ipv4Addr,
    /// Its port, with Vicon the port here [default: the system's].
    #[arg(long)]
    pub port: Option<u16>,
    /// IPv4 address of the interface here.
    #[arg(long, default_value_t = Ipv4Addr::LOCALHOST)]
    pub interface: Ipv4Addr,
    /// The vehicle: a body's name, `#NUMBER`, or `NAME#NUMBER`.
    #[arg(long)]
    pub object: Option<String>,
    /// For how long to listen, s.
    #[arg(long, default_value_t = 5.0, value_parser = listening_time)]
    pub seconds: f64,
    /// Write the sections of a scenario to this file; the vehicle must lie level at the origin of {I}, nose along its x.
    #[arg(long, value_name = "FILE", requires = "object")]
    pub calibrate: Option<PathBuf>,
}

impl MocapProbe {
    const EXAMPLES: &str = "Examples:\n  \
        gerono mocap probe --source vrpn --server 192.168.10.1 --interface 192.168.10.7\n  \
        gerono mocap probe --source natnet --server 192.168.10.1 --interface 192.168.10.7 --object quad --calibrate calibration.toml\n\n\
        Exit codes: 0 something came, and if --object is given it was believed; 1 nothing, or it was not.";
}

/// Arguments of `gerono mocap send`.
#[derive(Debug, Args)]
pub struct MocapSend {
    /// Which system to seem to be.
    #[arg(long = "as", value_enum)]
    pub system: Capture,
    /// IPv4 address to serve at and send from.
    #[arg(long, default_value_t = Ipv4Addr::LOCALHOST)]
    pub at: Ipv4Addr,
    /// Port to serve at [default: the system's].
    #[arg(long)]
    pub port: Option<u16>,
    /// Where frames go, with Vicon and NatNet [default: the system's port at --at].
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub to: Option<SocketAddrV4>,
    /// Version of NatNet's bit stream.
    #[arg(long, default_value = "4.1", value_parser = natnet_version)]
    pub natnet: Version,
    /// Name of the body.
    #[arg(long, default_value = "quad")]
    pub object: String,
    /// Frames a second.
    #[arg(long, default_value_t = 100.0, value_parser = frame_rate)]
    pub rate: f64,
    /// Standard deviation of the noise of each coordinate, m.
    #[arg(long, default_value_t = 1e-4)]
    pub noise: f64,
    /// For how long, s [default: until Ctrl-C, or the log's end].
    #[arg(long)]
    pub seconds: Option<f64>,
    /// The true flight of this log, or of the folder of a run, in place of an eight.
    #[arg(long)]
    pub log: Option<PathBuf>,
    /// Stand still where the flight begins.
    #[arg(long)]
    pub rest: bool,
}

impl MocapSend {
    const EXAMPLES: &str = "Examples:\n  \
        gerono mocap send --as vrpn\n  \
        gerono mocap send --as natnet --natnet 3.1 --log runs/fig1-1 --rate 120\n  \
        gerono mocap send --as vicon --to 127.0.0.1:51001 --rest --seconds 10";
}

fn listening_time(text: &str) -> Result<f64, String> {
    number_between(text, 0.1, 3600.0, "s")
}

fn frame_rate(text: &str) -> Result<f64, String> {
    number_between(text, 1.0, 1000.0, "Hz")
}

fn number_between(text: &str, least: f64, most: f64, unit: &str) -> Result<f64, String> {
    let value = text.parse().map_err(|_| "this is no number".to_owned())?;
    if (least..=most).contains(&value) {
        Ok(value)
    } else {
        Err(format!("give {least} to {most} {unit}"))
    }
}

fn natnet_version(text: &str) -> Result<Version, String> {
    let parts = text
        .split_once('.')
        .and_then(|(major, minor)| Some((major.parse().ok()?, minor.parse().ok()?)));
    match parts {
        Some((major @ (3 | 4), minor)) => Ok(Version { major, minor }),
        _ => Err("give 3.0, 3.1, 4.0 or 4.1".to_owned()),
    }
}

/// Arguments of `gerono world`.
#[derive(Debug, Args)]
pub struct World {
    /// The vehicle, and what the flight will look for.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Poses a second [default: the middle of `motion_capture.rate`].
    #[arg(long, value_name = "HZ", value_parser = frame_rate)]
    pub capture_rate: Option<f64>,
    /// Time from an exposure until its pose is sent, s [default: `motion_capture.latency`].
    #[arg(long, value_name = "S", value_parser = latency)]
    pub capture_latency: Option<f64>,
    /// Time from the arrival of a frame until it acts, s [default: `model.radio_latency` without half the time between two
    /// frames, for which a command waits on average].
    #[arg(long, value_name = "S", value_parser = latency)]
    pub radio_latency: Option<f64>,
    /// For how long, s [default: until Ctrl-C].
    #[arg(long, value_name = "S", value_parser = flight_time)]
    pub seconds: Option<f64>,
    /// Folder for the results; must be empty if it exists [default: the next free runs/SCENARIO-world-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Say nothing unless something is wrong.
    #[arg(long, short)]
    pub quiet: bool,
}

impl World {
    const EXAMPLES: &str = "Example, in three terminals:\n  \
        HERE='--set motion_capture.server=127.0.0.1 --set motion_capture.interface=127.0.0.1 --set rc_output.transmitter.device=/tmp/radio'\n  \
        gerono world scenarios/laboratory.toml $HERE --out runs/world\n  \
        gerono run scenarios/laboratory.toml $HERE --host realtime --out runs/flight\n  \
        gerono arm\n\n\
        and at last `gerono stop`, Ctrl-C in the first, and\n  \
        gerono truth runs/flight --world runs/world";
}

fn latency(text: &str) -> Result<f64, String> {
    number_between(text, 0.0, 1.0, "s")
}

/// Arguments of `gerono truth`.
#[derive(Debug, Args)]
pub struct Truth {
    /// The log of the flight (run.mcap), or the folder that holds it.
    pub flight: PathBuf,
    /// The log of the world that it was flown in, or the folder that holds it [default: the flight's own truth].
    #[arg(long, value_name = "LOG")]
    pub world: Option<PathBuf>,
    /// How much of the end of the flight along the path counts as its last part, s.
    #[arg(long, value_name = "S", default_value_t = 20.0, value_parser = flight_time)]
    pub last: f64,
    /// Print it as JSON, for other programs; SI units.
    #[arg(long)]
    pub json: bool,
}

impl Truth {
    const EXAMPLES: &str = "Examples:\n  \
        gerono truth runs/fig7-1\n  \
        gerono truth runs/flight --world runs/world --last 10";
}

/// Arguments of `gerono check`.
#[derive(Debug, Args)]
pub struct Check {
    /// What to check.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Print the wiring as a Mermaid diagram instead.
    #[arg(long)]
    pub mermaid: bool,
}

/// Arguments of `gerono plot`.
#[derive(Debug, Args)]
pub struct Plot {
    /// The logs (run.mcap), or the folders that hold them.
    #[arg(required = true)]
    pub logs: Vec<PathBuf>,
    /// The SVG file to write.
    #[arg(long, short)]
    pub output: PathBuf,
    /// Draw from this time on, s [default: the start].
    #[arg(long, value_name = "T")]
    pub from: Option<f64>,
    /// Draw until this time, s [default: the end].
    #[arg(long, value_name = "T")]
    pub to: Option<f64>,
}

/// Arguments of `gerono report`.
#[derive(Debug, Args)]
pub struct Report {
    /// The logs (run.mcap), or the folders that hold them.
    #[arg(required = true, value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// The folder to write into; made if there is none, and what an earlier report wrote there is replaced.
    #[arg(long, short, value_name = "DIR")]
    pub output: PathBuf,
}

impl Report {
    /// What `gerono report --help` shows.
    const EXAMPLES: &str = "Examples:\n  \
        gerono report runs/fig1-1 -o report\n  \
        gerono report runs/fig1-1 runs/fig1-2 -o compared\n  \
        gerono report crashed/run.mcap.partial -o report";
}

/// Arguments of `gerono export`.
#[derive(Debug, Args)]
pub struct Export {
    /// The log (run.mcap), or the folder that holds it.
    pub log: PathBuf,
    /// The file to write, or `-` [default: standard output; with --view run.view.mcap beside the log].
    #[arg(long, short, visible_alias = "out", value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Write a copy of the log for viewers.
    #[arg(long, conflicts_with_all = ["every", "topic", "csv"])]
    pub view: bool,
    /// Write only every n-th tick.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub every: u64,
    /// Write only this topic.
    #[arg(long, value_name = "TOPIC", value_parser = topic)]
    pub topic: Option<Topic>,
    /// Write a table with a column for every member, and for every element of an array: `position_world[0]`.
    #[arg(long, requires = "topic")]
    pub csv: bool,
}

impl Export {
    /// What `gerono export --help` shows.
    const EXAMPLES: &str = "Examples:\n  \
        gerono export runs/fig1-1 --every 100 --output fig1.jsonl\n  \
        gerono export runs/fig1-1 --csv --topic control/errors --out errors.csv\n  \
        gerono export runs/fig1-1 --csv --topic vehicle/truth | head\n  \
        gerono export runs/fig1-1 --view --out fig1.mcap";
}

fn topic(name: &str) -> Result<Topic, String> {
    let names = Topic::ALL.map(Topic::name);
    Topic::from_name(name).ok_or_else(|| format!("there is no such topic; {}", known_names(name, &names)))
}

/// Arguments of `gerono info`.
#[derive(Debug, Args)]
pub struct Info {
    /// The log (run.mcap), or the folder that holds it.
    pub log: PathBuf,
    /// Print it as JSON, for other programs.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `gerono recover`.
#[derive(Debug, Args)]
pub struct Recover {
    /// The log, or the folder of a run.
    pub log: PathBuf,
    /// The file to write, or for the folder of a run the folder to write into; nothing is overwritten [default:
    /// run.recovered.mcap beside run.mcap].
    #[arg(long, value_name = "PATH")]
    pub out: Option<PathBuf>,
    /// The scenario that was flown, for a log that does not know it any more; otherwise it is not needed.
    #[arg(long, value_name = "FILE")]
    pub scenario: Option<PathBuf>,
    /// The seed that was flown with, in place of the scenario's.
    #[arg(long, requires = "scenario")]
    pub seed: Option<u64>,
    /// What was changed of the scenario when it was flown; may be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE", requires = "scenario")]
    pub sets: Vec<String>,
}

impl Recover {
    /// What `gerono recover --help` shows.
    const EXAMPLES: &str = "Examples:\n  \
        gerono recover runs/fig1-1\n  \
        gerono recover runs/fig1-1/run.mcap.partial --out saved.mcap\n  \
        gerono recover damaged.mcap --scenario scenarios/fig1.toml --seed 3\n\n\
        Exit codes: 0 all that is whole is in the new log, or nothing had to be done; 1 there is nothing to recover, or the scenario \
        must be stated; 2 the scenario is wrong; 4 it cannot be written, or the file exists already.";
}

/// What `gerono rc` can do.
#[derive(Debug, Subcommand)]
pub enum RcCommand {
    /// Move one stick after another, slowly and disarmed, and say what the receiver should show.
    ///
    /// Uses the link of a scenario's `[rc_output]` (docs/radio_links.md). Take the propellers off all the same. Where no
    /// arming switch is stated the thrust stick is left alone, because it might let the motors turn.
    Probe(RcProbe),
    /// Fit the calibration of the link that a log was flown with: thrust and body rates against the travel of the sticks.
    ///
    /// Least squares, with standard errors and residuals. A stick that hardly moved, or that moved against gusts only,
    /// explains little of what was measured; the part of a scenario that is printed then keeps what was stated.
    Identify(RcIdentify),
}

/// Arguments of `gerono rc probe`.
#[derive(Debug, Args)]
pub struct RcProbe {
    /// Whose link.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// How long a stick takes from the middle to both ends and back, s.
    #[arg(long, default_value_t = 8.0, value_name = "S", value_parser = sweep_seconds)]
    pub seconds: f64,
    /// Move the thrust stick too although nothing keeps the vehicle disarmed: its propellers are off.
    #[arg(long)]
    pub propellers_off: bool,
}

fn sweep_seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().map_err(|_| "give a time in s".to_owned())?;
    if (0.1..=600.0).contains(&seconds) {
        Ok(seconds)
    } else {
        Err("give a time from 0.1 to 600 s".to_owned())
    }
}

/// Arguments of `gerono rc identify`.
#[derive(Debug, Args)]
pub struct RcIdentify {
    /// The log (run.mcap), or the folder that holds it.
    pub log: PathBuf,
    /// What thrust and rates are measured by.
    #[arg(long, value_enum, default_value_t)]
    pub from: identify::Source,
    /// Mass of the vehicle, kg [default: the scenario's].
    #[arg(long, value_name = "KG", value_parser = mass)]
    pub mass: Option<f64>,
    /// Print JSON, for other programs.
    #[arg(long)]
    pub json: bool,
}

fn mass(text: &str) -> Result<f64, String> {
    let mass: f64 = text.parse().map_err(|_| "give a mass in kg".to_owned())?;
    if mass > 0.0 && mass.is_finite() {
        Ok(mass)
    } else {
        Err("give a mass above 0 kg".to_owned())
    }
}

/// Arguments of `gerono digest`.
#[derive(Debug, Args)]
pub struct Digest {
    /// The log (run.mcap), or the folder that holds it.
    pub log: PathBuf,
}

/// Arguments of `gerono bench`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Bench {
    /// What to measure instead.
    #[command(subcommand)]
    pub instead: Option<BenchInstead>,
    /// Repetitions of each measurement; medians are shown.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Simulated seconds of each lock-step flight.
    #[arg(long, default_value_t = 20.0)]
    pub duration: f64,
    /// Write the figures as JSON to this file as well.
    #[arg(long)]
    pub json: Option<PathBuf>,
}

/// What `gerono bench` can measure instead of simulated seconds per wall second.
#[derive(Debug, Subcommand)]
pub enum BenchInstead {
    /// Measure how long it is from a capture to the radio frame that comes of it, in real time.
    ///
    /// Flies Fig. 1's ideal profile at 1 kHz with all services on one core: estimator, path generator, controller and rc
    /// output, four hops from process to process, each with a step and its samples. The floor beside it is a bare chain: five
    /// processes on that core hand on a bare iceoryx2 event four times, once a millisecond, and do nothing else. Both are measured
    /// in turn: on idle cores, with a busy process on another core, and with one on each of both; as ordinary processes, and
    /// under SCHED_FIFO if that is permitted.
    ///
    /// Times depend on the machine and on what else it does; the ratios to the floor much less. Shown are medians of
    /// the repetitions, and of their ratios, pair by pair. p50 is what half of the frames do not exceed, p99 what 99 of 100
    /// do not. On a quiet machine expect some ten microseconds a hop. With a load on their own core ordinary processes wait
    /// for their turn, which is milliseconds: SCHED_FIFO is against that (docs/deployment.md).
    ///
    /// Takes 12 × REPETITIONS × SECONDS, or half of it without SCHED_FIFO.
    #[command(after_help = BenchLatency::EXAMPLES)]
    Latency(BenchLatency),
    /// Measure what it costs to record a sample, beside the MCAP library alone, and whether memory grows.
    ///
    /// The writer of run.mcap and the library itself write the same messages of Fig. 1 to memory, in turn, uncompressed. Shown are
    /// medians of the repetitions, and the median of the ratios of CPU time, pair by pair. Then as many minutes of flight as
    /// asked for are recorded to nowhere, and the process's memory after a tenth of them stands beside that at their end.
    #[command(after_help = BenchRecorder::EXAMPLES)]
    Recorder(BenchRecorder),
    /// Measure what the deaths of services cost a flight in real time, and the others in it.
    ///
    /// Flies the paper's laboratory in hover twice: undisturbed, and with each service in its turn killing itself in the
    /// middle of a step (SIGKILL), 0.3 s apart. Says how soon another process flew in the dead one's place, how far the vehicle was
    /// from its point, and whether the other services kept their periods: those within 0.1 s of another's death beside all
    /// others of the same flight.
    ///
    /// Takes 2 × (4 + 0.3 × DEATHS) s.
    Deaths(BenchDeaths),
}

/// Arguments of `gerono bench recorder`.
#[derive(Debug, Args)]
pub struct BenchRecorder {
    /// Repetitions of each measurement of time; medians are shown.
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Length of the flight over which memory is watched, min at 1 kHz.
    #[arg(long, value_name = "MIN", default_value = "10", value_parser = minutes)]
    pub minutes: f64,
    /// Write the figures as JSON to this file as well: times in s, memory in bytes.
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}

impl BenchRecorder {
    /// What `gerono bench recorder --help` shows.
    const EXAMPLES: &str = "Examples:\n  \
        gerono bench recorder\n  \
        gerono bench recorder --repetitions 31 --minutes 60 --json recorder.json";
}

fn minutes(text: &str) -> Result<f64, String> {
    let minutes = text.parse().map_err(|_| "give a time in min".to_owned())?;
    if (0.1..=1440.0).contains(&minutes) {
        Ok(minutes)
    } else {
        Err("give a time from 0.1 to 1440 min".to_owned())
    }
}

/// Arguments of `gerono bench deaths`.
#[derive(Debug, Args)]
pub struct BenchDeaths {
    /// How many processes die.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub deaths: u32,
    /// Fly under SCHED_FIFO (docs/deployment.md).
    #[arg(long)]
    pub fifo: bool,
    /// Write the figures as JSON to this file as well: times in s.
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}

/// Arguments of `gerono bench latency`.
#[derive(Debug, Args)]
pub struct BenchLatency {
    /// Length of each measurement, s: a thousand frames a second.
    #[arg(long, value_name = "S", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub seconds: u32,
    /// Repetitions of each measurement; medians are shown.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Write the figures as JSON to this file as well: times in s, and of every service how late it woke and how long it stepped.
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}

impl BenchLatency {
    /// What `gerono bench latency --help` shows.
    const EXAMPLES: &str = "Examples:\n  \
        gerono bench latency\n  \
        gerono bench latency --seconds 60 --repetitions 3 --json latency.json";
}

/// Arguments of `gerono doctor`.
#[derive(Debug, Args)]
pub struct Doctor {
    /// The scenario that is to be flown [default: a minute at 1 kHz that asks for nothing].
    pub scenario: Option<PathBuf>,
    /// Change a value of the scenario, for example `--set deployment.core=1`; may be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE", requires = "scenario")]
    pub sets: Vec<String>,
    /// How long to measure wake-ups, s; the longer, the more of what is rare is seen.
    #[arg(long, value_name = "T", default_value = "3", value_parser = measuring_time)]
    pub seconds: f64,
    /// The folder into which runs write.
    #[arg(long, value_name = "DIR", default_value = "runs")]
    pub runs: PathBuf,
    /// Print what was found as JSON, for other programs.
    #[arg(long)]
    pub json: bool,
}

impl Doctor {
    /// What `gerono doctor --help` shows.
    const EXAMPLES: &str = "Examples:\n  \
        gerono doctor\n  \
        gerono doctor scenarios/fig1.toml --set deployment.core=1 --set deployment.priority=20\n  \
        gerono doctor scenarios/fig1.toml --seconds 60 --runs /data/runs\n  \
        gerono doctor --json | jq '.checks[] | select(.verdict != \"green\")'\n\n\
        Exit codes: 0 nothing is red; 2 the scenario is wrong; 6 something is red: the flight would fail or be worth nothing.";
}

fn measuring_time(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| "give a number of seconds".to_owned())?;
    if (0.01..=3600.0).contains(&seconds) {
        Ok(seconds)
    } else {
        Err("give a time from 0.01 to 3600 s".to_owned())
    }
}

/// Arguments of `gerono reproduce`.
#[derive(Debug, Args)]
pub struct Reproduce {
    /// How many seeds to fly [default: 20; with --quick 2].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: Option<u64>,
    /// Which figures: 1, 2, 3-6, 7, 8, 9, 10, 11, tracking [default: all].
    #[arg(long, value_delimiter = ',', value_name = "FIGURES", value_parser = str::parse::<Figure>)]
    pub figures: Vec<Figure>,
    /// Folder for the results; must be empty if it exists [default: the next free runs/reproduce-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Fly fewer seeds and a shorter list of figures, judged all the same.
    #[arg(long)]
    pub quick: bool,
    /// Fly the eight without parts of the design instead, to see what each is worth.
    #[arg(long, conflicts_with_all = ["figures", "quick"])]
    pub ablation: bool,
}

/// Arguments of `gerono faults`.
#[derive(Debug, Args)]
pub struct Faults {
    /// What to fly.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// When faults begin, s [default: three moments at which nothing else happens; with --quick one].
    #[arg(long, value_delimiter = ',', value_name = "T,T,…")]
    pub moments: Vec<f64>,
    /// How long faults last, s.
    #[arg(long = "for", value_name = "T", default_value_t = matrix::LASTS)]
    pub lasts: f64,
    /// How long to fly after a fault, s.
    #[arg(long, value_name = "T", default_value_t = matrix::AFTER)]
    pub after: f64,
    /// Which faults: off (off-warm, off-cold), freeze, delay, intermittent, stuck, wrong, garbage (garbage-in-range,
    /// garbage-any-bits) [default: all].
    #[arg(long = "fault", value_delimiter = ',', value_name = "KIND,…", value_parser = str::parse::<Troubles>)]
    pub faults: Vec<Troubles>,
    /// Which services, and no edges unless they are named too [default: all but the plant].
    #[arg(long = "service", value_delimiter = ',', value_name = "NAME,…", value_parser = failing_service)]
    pub services: Vec<ServiceId>,
    /// Which edges, such as "mocap/pose -> estimator", and no services unless they are named too [default: all].
    #[arg(long = "edge", value_delimiter = ',', value_name = "EDGE,…", value_parser = edge)]
    pub edges: Vec<EdgeName>,
    /// Folder for the results; must be empty if it exists [default: the next free runs/faults-SCENARIO-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Fly everything once more as processes that really die, and fail unless all bytes are the same.
    #[arg(long)]
    pub processes: bool,
    /// Let everything fail at one moment only.
    #[arg(long, conflicts_with = "moments")]
    pub quick: bool,
}

impl Faults {
    /// What `gerono faults --help` shows.
    const EXAMPLES: &str = "Examples:\n  \
        gerono faults scenarios/fig1.toml\n  \
        gerono faults scenarios/fig3_6.toml --quick --fault off,freeze --for 0.2\n  \
        gerono faults scenarios/fig1.toml --service controller --moments 12,25 --processes\n  \
        gerono faults scenarios/fig1.toml --edge 'vehicle/state -> controller' --fault delay,garbage";
}

/// A service that can fail.
fn failing_service(name: &str) -> Result<ServiceId, String> {
    let service = service(name)?;
    if plan::services().any(|failing| failing == service) {
        Ok(service)
    } else {
        Err("the plant is the vehicle itself, which flies on whatever happens".to_owned())
    }
}

fn edge(name: &str) -> Result<EdgeName, String> {
    EdgeName::find(name).ok_or_else(|| {
        let names: Vec<_> = EdgeName::all().map(|edge| edge.to_string()).collect();
        format!("there is no such edge; {}", known_names(name, &names))
    })
}

/// Arguments of a member of a bare ring.
#[derive(Debug, Args)]
pub struct RingMember {
    /// Place in the ring.
    pub place: usize,
    /// Rounds to go.
    pub rounds: u64,
    /// How to wait for the neighbour.
    #[arg(value_enum)]
    pub wait: RingWait,
    /// Core to run on.
    pub core: usize,
    /// Whether to run under SCHED_FIFO.
    #[arg(long)]
    pub fifo: bool,
}

/// How the members of a bare ring wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RingWait {
    /// Yield the core until the neighbour has been there.
    Yield,
    /// Block on an eventfd.
    Eventfd,
}

/// Arguments of a member of a bare chain.
#[derive(Debug, Args)]
pub struct ChainMember {
    /// Place in the chain.
    pub place: usize,
    /// How often the first sends.
    pub rounds: u64,
    /// Core to run on.
    pub core: u32,
    /// The iceoryx2 configuration of the chain.
    pub configuration: PathBuf,
    /// Whether to run under SCHED_FIFO.
    #[arg(long)]
    pub fifo: bool,
}
