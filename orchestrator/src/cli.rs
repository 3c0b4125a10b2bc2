//! The command line of `gerono`.

mod campaigns;
mod doctor;
mod flight;
mod live;
mod logs;
mod rc;
mod values;
mod world;

use std::path::PathBuf;

use clap::builder::PossibleValuesParser;
use clap::{Args, Parser, Subcommand};

pub use self::campaigns::*;
pub use self::doctor::*;
pub use self::flight::*;
pub use self::live::*;
pub use self::logs::*;
pub use self::rc::*;
use self::values::service_process;
pub use self::world::*;
pub use bench::arguments::*;
use command_line::exit::Exit;
pub use mocap_tools::arguments::*;

/// Flies an adaptive path-following quadcopter as independent processes, and logs every sample.
#[derive(Debug, Parser)]
#[command(name = "gerono", version, propagate_version = true, after_help = Exit::help())]
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
    /// Draw the distance from the path over time of one or several logs as an SVG figure.
    ///
    /// It is the true distance, whatever the controller says of itself; of a flight in a laboratory, where nobody knows the
    /// truth, the estimated one. The theorem's bound is drawn where it applies. Planned faults are shaded.
    Plot(Plot),
    /// Show flights as one page that opens in any browser, without a network, and draw the paper's figures that they have.
    ///
    /// DIR/report.html holds everything: the 3D view, which turns with the mouse and shows the vehicle at the moment
    /// under the pointer; errors, commands, estimates, attitude and timing law over time, on axes that zoom together; what
    /// happened when; the summary; the scenario; and of flights in real time how the services kept time.
    /// Several logs are laid over each other, a colour each. Of many samples in a column of pixels the smallest and the
    /// largest are kept: no peak is lost. Of a log that was never completed, what is whole is shown.
    ///
    /// A flight of one of the paper's figures is drawn as that figure too, as SVG beside the page.
    #[command(after_help = ReportArguments::EXAMPLES)]
    Report(ReportArguments),
    /// Write the samples of a log as JSON lines, or those of one topic as a table (CSV), for other programs; or a copy for viewers.
    ///
    /// Numbers are read back to the bit; those that are not finite are the words NaN, inf and -inf.
    ///
    /// With --view, an MCAP file with every message of the log as it is, and beside them what Foxglove, Lichtblick and Rerun need
    /// to show the flight in space: frames, the vehicle, its way and that of the reference (docs/viewing.md).
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
    /// Measure this machine: simulated seconds per wall second of every host, beside what iceoryx2 alone needs.
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
    /// Check this machine before a flight: what is good (green), poor (yellow) or would not work (red), and how to fix it.
    ///
    /// Looks at shared memory, limits, cores, clock, governor, other runs and what dead ones have left, and measures for some
    /// seconds how fast the disk is and how late a sleeper wakes. With a scenario, all of it is judged by what that asks for:
    /// its `[deployment]`, the size of its log, its `real_time.grace`. Only flights in real time need sharp wake-ups. Changes nothing;
    /// docs/deployment.md explains every number.
    #[command(after_help = Doctor::EXAMPLES)]
    Doctor(Doctor),
    /// Listen to a motion-capture system, or emulate one.
    Mocap(Mocap),
    /// Arm a flight in real time: its motors turn, and it takes off as soon as all services are ready.
    ///
    /// Only a scenario with `[flight]` has something to arm. Refused while a service does not fly, the vehicle is not
    /// seen, its state is old, or the estimator has not converged.
    Arm(Operate),
    /// Disarm a flight in real time: its motors stop at once, in the air too. `gerono arm` arms it again.
    Disarm(Operate),
    /// Stop the motors of a flight in real time at once, until the end of the run: no command starts them again.
    Kill(Operate),
    /// End a flight in real time: the vehicle lands first. Ctrl-C at the run's terminal does the same.
    ///
    /// Asked again it changes nothing: `gerono kill` stops motors in the air.
    Stop(Operate),
    /// Take over a flight in real time whose orchestrator has died: record and supervise it to its end.
    ///
    /// The services of such a flight go on alone: they land, or fly on to the end, as the scenario's
    /// `real_time.orchestrator_loss` says. The new orchestrator records from then on, restarts services that die, and
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
    /// cameras see of it as `motion_capture.source` (VRPN, NatNet, Vicon) to where the flight listens, and flies by the frames of
    /// `rc_output.link` that arrive where the flight sends them: at a pseudo-terminal, which gets the name that
    /// `rc_output.transmitter.device` states, or at a socket. The flight, `gerono run --host realtime` with the same settings,
    /// shares nothing else with it, and cannot tell.
    ///
    /// Its time begins with it: times in `[vehicle]` and `[cameras]` count from there. Writes run.mcap, which holds the truth,
    /// host.mcap, which says when it began, and summary.json: `gerono truth FLIGHT --world WORLD` compares them with the flight.
    #[command(after_help = HilSimulator::EXAMPLES)]
    World(HilSimulator),
    /// Print the distance of the true position from the path while the vehicle followed it.
    ///
    /// The error is the distance of the true position from the point at which the path was at that time, at every tick: not
    /// the controller's z1, which rests on an estimate. The truth is that of the flight's own log, or of the log of `gerono world`.
    /// Parts: 5 s before the scenario's first event (a fan, a change), from there to the last part, the last part, all.
    #[command(after_help = TruthArguments::EXAMPLES)]
    Truth(TruthArguments),
    /// Remove what dead runs have left in memory and in the folder for temporary files.
    ///
    /// Only a run whose orchestrator was killed leaves anything; the next run removes it as well. Live runs are not
    /// touched.
    Clean,
    /// Print the JSON Schema of scenario files; editors complete and check them with it.
    Schema,
    /// Print the completion script of a shell, for example for `source <(gerono completions bash)` in ~/.bashrc.
    ///
    /// It completes commands and options, scenario files, the keys of `--set`, topics and services.
    Completions {
        /// The shell.
        #[arg(value_parser = PossibleValuesParser::new(manual::completion::shells()))]
        shell: String,
    },
    /// Print the man page, or write one for each command.
    ///
    /// `gerono man | man -l -` shows it without installing it.
    Man(ManArguments),
    /// Run one service; only `gerono run` can start it.
    #[command(hide = true)]
    Service {
        /// Name of the service, or of a process that waits for one to die.
        #[arg(value_parser = service_process)]
        name: String,
        /// Folder of the run, by which `gerono kill` and the like find it (`live::runs`).
        #[arg(long)]
        run: Option<PathBuf>,
        /// What its steps follow, for the same.
        #[arg(long)]
        host: Option<String>,
    },
    /// End a flight whose orchestrator cannot go on; only that one can become it.
    #[command(hide = true)]
    Postmortem(Postmortem),
    /// Measure processes that exchange samples and nothing else; only `gerono bench` can start it.
    #[command(hide = true)]
    Ring(Ring),
    /// Take part in such a ring; only `gerono ring` can start it.
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

/// Arguments of `gerono man`.
#[derive(Debug, Args)]
pub struct ManArguments {
    /// Write gerono.1, gerono-run.1 and so on into this folder, such as ~/.local/share/man/man1.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}
