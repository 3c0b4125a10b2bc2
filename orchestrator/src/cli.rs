//! The command line of `gerono`.

mod bench;
mod campaigns;
mod doctor;
mod flight;
mod grid;
pub mod groups;
mod host;
mod identify;
mod lab;
mod live;
mod logs;
mod mocap;
mod operator;
mod rc;
mod sweep;
mod top;
mod values;
mod view;
mod world;

use std::ffi::OsString;
use std::path::PathBuf;

use clap::builder::PossibleValuesParser;
use clap::{Args, Parser, Subcommand};
use laboratory_tools::gnss_probe::GnssCommand;

pub use self::bench::*;
pub use self::campaigns::*;
pub use self::doctor::*;
pub use self::flight::*;
pub use self::grid::*;
pub use self::host::*;
pub use self::identify::*;
pub use self::lab::*;
pub use self::live::*;
pub use self::logs::*;
pub use self::mocap::*;
pub use self::operator::*;
pub use self::rc::*;
pub use self::sweep::*;
pub use self::top::*;
use self::values::service_process;
pub use self::view::*;
pub use self::world::*;
use command_line::exit::Exit;
use new_scenario::arguments::New;
use recorded_flight::Import;

/// Flies an adaptive path-following quadcopter as independent processes, and logs every sample.
#[derive(Debug, Parser)]
#[command(name = "gerono", version, propagate_version = true, after_help = Exit::help())]
pub struct Cli {
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands of `gerono`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write a scenario for a vehicle from its mass, size and battery.
    ///
    /// Asks for what no option states. The file can be flown as it is, in a simulation or, with --radio and --cameras, against
    /// the simulated laboratory. It states gains for a vehicle that was weighed but not measured; each estimated value has a
    /// comment with its origin and with a way to measure it (docs/another_vehicle.md).
    #[command(after_help = New::EXAMPLES)]
    New(New),
    /// Fly a scenario and record it.
    ///
    /// Starts one process for each service, flies the scenario in simulated time and writes run.mcap (the experiment:
    /// the same bytes for the same scenario and seed), host.mcap (the machine) and summary.json.
    Run(Run),
    /// Check a scenario without flying it: schedule, wiring, gains.
    ///
    /// Warns if the gains do not suit the vehicle, by the rules of docs/tuning.md.
    Check(Check),
    /// Show the content of a log: scenario, topics, faults, outcome.
    ///
    /// Topics are shown with their rates and gaps.
    /// Reads the whole log, so that damage is found. Adds verdicts and restarts from summary.json and host.mcap beside it.
    Info(Info),
    /// Show a flight in a browser, while it is flown or afterwards.
    ///
    /// Serves one page at a port of this machine: the vehicle in space, all signals over time, the state of the services and
    /// events. For a running flight, in real or simulated time, it shows the newest samples some thirty times per second to at
    /// most eight browsers; for a finished one the page of `gerono report`. Read-only: nothing that a browser sends can reach
    /// the flight.
    #[command(after_help = View::EXAMPLES)]
    View(View),
    /// Write a page about flights that opens in any browser.
    ///
    /// DIR/report.html is self-contained and needs no network: a 3D view that turns with the mouse and shows the vehicle at
    /// the time under the pointer; errors, commands, estimates, attitude and timing law on axes that zoom together; the
    /// events, the summary and the scenario; and for real time the timing of the services.
    /// Several logs are overlaid, one colour each. No peak is lost: each column of pixels shows its smallest and largest sample.
    /// Of an incomplete log the intact part is shown.
    ///
    /// A flight of one of the paper's figures is also drawn as that figure, as SVG beside the page.
    #[command(after_help = ReportArguments::EXAMPLES)]
    Report(ReportArguments),
    /// Draw the distance from the path over time as an SVG figure.
    ///
    /// Several logs are drawn into one figure.
    /// Draws the true distance; for a laboratory flight, which has no truth, the estimated one. The theorem's bound is drawn
    /// where it applies, and planned faults are shaded.
    Plot(Plot),
    /// Print the true distance from the path, part by part.
    ///
    /// Also for flights in the HIL simulator.
    /// The distance is that of the true position from the reference point at the same time, at every tick, not the
    /// controller's z1, which is based on an estimate. The truth is in the flight's log, or in that of `gerono world`.
    /// Parts: 5 s before the scenario's first event (a fan, a change), from there to the last part, the last part, all.
    #[command(after_help = TruthArguments::EXAMPLES)]
    Truth(TruthArguments),
    /// Write samples of a log as JSON lines or CSV, or for viewers.
    ///
    /// Numbers are written exactly; those that are not finite are the words NaN, inf and -inf.
    ///
    /// With --view, writes an MCAP file with every message of the log and the data that Foxglove, Lichtblick and Rerun need
    /// to show the flight in space: frames, the vehicle, its trajectory and the reference (docs/viewing.md).
    #[command(after_help = Export::EXAMPLES)]
    Export(Export),
    /// Print the SHA-256 of a log's messages.
    ///
    /// The digest covers topic, time and payload: equal experiments have equal digests.
    Digest(Digest),
    /// Recover an incomplete or damaged log.
    ///
    /// Reports the kept and the lost samples.
    /// Keeps every chunk with a valid checksum, before and after the damage. The new log states that it was recovered and
    /// which samples it lacks; the old one is unchanged. With the folder of a run, recovers run.mcap and host.mcap.
    #[command(after_help = Recover::EXAMPLES)]
    Recover(Recover),
    /// Make a log of a flight that another program has recorded.
    ///
    /// The estimator of the scenario flies over the recorded samples, so that `gerono replay` can repeat it with other parameters.
    /// docs/recorded_flights.md describes the table of samples, and how to make one of a ULog file.
    #[command(after_help = Import::EXAMPLES)]
    Import(Import),
    /// Repeat the steps of a log and compare the results byte for byte.
    ///
    /// The steps are repeated on their recorded inputs.
    /// Every service receives the recorded samples, so a difference identifies the service that made it. Works on logs of
    /// simulated and of real time (with host.mcap beside run.mcap), with planned faults, and on incomplete ones. The states
    /// of the services are compared with the checkpoints in host.mcap, from which they resume after a gap in the log.
    #[command(after_help = Replay::EXAMPLES)]
    Replay(Replay),
    /// Compare two logs by topic.
    ///
    /// For a topic that is not identical, shows the number of differing samples, the first of them, and the largest difference.
    Diff(Diff),
    /// Fly the paper's figures over many seeds, judge and draw them.
    ///
    /// Each figure is flown in three laboratories.
    /// Writes reproduce.json, figures.md, a drawing of each figure, a page about the first flight of each, and index.html,
    /// which links them. Fails only if a number has regressed: it misses its limit and is no known gap.
    /// The seeds are 101 and following; gains were tuned on 1 to 6.
    Reproduce(Reproduce),
    /// Inject every fault into every service and every edge.
    ///
    /// Reports the outcome for the vehicle.
    /// Flies the scenario once without a fault and once for each fault, at several times: every service but the plant
    /// off (warm and cold) and frozen; every edge with samples late by 0.05 s, half of them lost, stuck, wrong (a
    /// position by 0.1 m, a thrust by a fifth), random within ±10, and of random bits.
    ///
    /// The vehicle survives if it stays within 1.5 times the bound, which is its largest distance from the path in the 5 s
    /// before, but at least 0.02 m. It is degraded if it leaves this range and returns inside the bound. It is lost if it does
    /// not return, is 5 m away, tips over, a number is not finite, or the fault crashes a service. A loss is a result, not an
    /// error.
    ///
    /// Writes faults.json and faults.md.
    #[command(after_help = Faults::EXAMPLES)]
    Faults(Faults),
    /// Compare control laws: errors and margins.
    ///
    /// Errors are compared in many conditions; the margin is the largest disturbance that a law survives.
    /// Every law flies the same conditions with the same seeds; conditions do not change the controller's parameters.
    /// Writes grid.json, grid.md and a page with a heat map.
    #[command(after_help = Grid::EXAMPLES)]
    Grid(Grid),
    /// Fly thousands of varied scenarios, and evaluate the results.
    ///
    /// Flies on all cores or on a cluster.
    /// A sweep.toml states the varied values, the compared laws and the criteria; docs/sweeps.md explains it. Sample i is a
    /// function of the sweep and of i alone: shards are independent, and every row can be repeated.
    #[command(after_help = Sweep::EXAMPLES)]
    Sweep(Sweep),
    /// Simulate a laboratory: vehicle, cameras, receiver.
    ///
    /// A hardware-in-the-loop simulator, connected by real sockets and serial lines.
    /// Simulates the scenario's vehicle by the system's clock, sends the poses of the scenario's cameras to the flight in the
    /// protocol of `motion_capture.source` (VRPN, NatNet, Vicon), or packets of sensors outdoors to `receivers.sources` (UBX,
    /// MAVLink), and flies by the frames of `rc_output.link` from the flight, received at a pseudo-terminal named
    /// `rc_output.transmitter.device` or at a socket. The flight, `gerono run --host realtime` with the same settings, shares
    /// nothing else with it.
    ///
    /// Times in `[vehicle]` and `[cameras]` count from its start. Writes run.mcap with the truth, host.mcap with the start
    /// time, and summary.json: `gerono truth FLIGHT --world WORLD` compares them with the flight.
    #[command(after_help = HilSimulator::EXAMPLES, visible_alias = "hil")]
    World(HilSimulator),
    /// Diagnose a motion-capture system, or emulate one.
    Mocap(Mocap),
    /// Diagnose a satellite receiver, or an autopilot that measures.
    #[command(subcommand)]
    Gnss(GnssCommand),
    /// Test axes and signs with the vehicle in the hand.
    #[command(subcommand)]
    Lab(LabCommand),
    /// Test a radio link on the ground, or identify its channels.
    #[command(subcommand)]
    Rc(RcCommand),
    /// Test the kill switch of a scenario's `[operator]`.
    #[command(subcommand)]
    Operator(OperatorCommand),
    /// Identify markers, delay, lags and noise from a log.
    ///
    /// Markers away from the centre of mass, frames that act later than modelled, and cameras noisier than stated make a
    /// laboratory unstable, and are not visible in the vehicle's state. Hover, or fly a figure such as the eight, for at least
    /// twenty seconds; the table compares the scenario with the identified values, and the lines for the scenario are printed.
    /// A second table has the whole delay from a command to the capture that shows its effect.
    #[command(after_help = Identify::EXAMPLES)]
    Identify(Identify),
    /// Arm a flight in real time: motors idle, then it takes off.
    ///
    /// Only a scenario with `[flight]` can be armed. Refused while a service does not run, the vehicle is not tracked, its
    /// state is old, the estimator has not converged, the vehicle is not level or the transmitter lacks an input, and unless the
    /// vehicle is disarmed. A vehicle that is not ready within 0.5 s, or no longer ready before take-off, is disarmed and must be
    /// armed again; the run reports the check that failed.
    Arm(Operate),
    /// Stop the motors immediately, even in the air.
    ///
    /// `gerono arm` re-enables them.
    Disarm(Operate),
    /// Stop the motors until the end of the run, even in the air.
    ///
    /// They stop immediately, and nothing re-enables them.
    Kill(Operate),
    /// Land the vehicle and end a flight in real time.
    ///
    /// Ctrl-C in the run's terminal does the same.
    /// Repeating the command has no effect: `gerono kill` stops motors in the air.
    Stop(Operate),
    /// Change gains of a flight in real time while it flies.
    ///
    /// For example `gerono set controller.k1=3`.
    /// docs/scenarios.md marks the tunable keys. All of them change at one tick, or none. The change is checked like a scenario,
    /// and in the air also by the rules of docs/tuning.md. It is recorded as an event, and `gerono replay` repeats it.
    #[command(after_help = Set::EXAMPLES)]
    Set(Set),
    /// Print the current values of keys of a flight in real time.
    ///
    /// The format is that of `gerono set` and `--set`.
    #[command(after_help = Get::EXAMPLES)]
    Get(Get),
    /// Show a flight in real time while it flies, from any terminal.
    ///
    /// Shows the timing of every service, the latency from a capture to its frame, the vehicle's error and estimates over the
    /// last minute, and events. The flight never waits for it. The key `s` sets a gain, as `gerono set` does. With --allow-faults
    /// the selected service can be killed or frozen, each after a confirmation. The key `?` explains keys and columns.
    #[command(after_help = Top::EXAMPLES)]
    Top(Top),
    /// Take over a flight in real time whose orchestrator has died.
    ///
    /// Records and supervises it to its end.
    /// Without an orchestrator the services land, or continue to the end, as `real_time.orchestrator_loss` of the scenario
    /// states. The new orchestrator records from then on, restarts crashed services, and answers `gerono arm`, `stop`, `top` and
    /// the like. Samples that were not recorded meanwhile are lost.
    Attach(Attach),
    /// Check this machine before a flight.
    ///
    /// Each check is good (green), poor (yellow) or unusable (red), with its fix.
    /// Checks shared memory, limits, cores, clock, governor, other runs and leftovers of dead ones, and measures for some
    /// seconds the speed of the disk and the latency of wake-ups. With a scenario, judges the results by the scenario's
    /// `[deployment]`, the size of its log and its `real_time.grace`. Only flights in real time need low wake-up latency. Changes
    /// nothing; docs/deployment.md explains every number.
    #[command(after_help = Doctor::EXAMPLES)]
    Doctor(Doctor),
    /// Measure the speed of this machine.
    ///
    /// Measures simulated seconds per wall second of every host, compared with iceoryx2 alone.
    /// `gerono bench latency` measures flights in real time.
    Bench(Bench),
    /// Remove leftovers of dead runs in memory and temporary files.
    ///
    /// Only a run whose orchestrator was killed has leftovers; the next run removes them as well. Live runs are not touched.
    /// Stopped processes (SIGSTOP) of an otherwise dead run are killed.
    Clean,
    /// Print the completion script of a shell.
    ///
    /// For example for `source <(gerono completions bash)` in ~/.bashrc.
    /// It completes commands and options, scenario files, the keys of `--set`, topics and services.
    Completions {
        /// The shell.
        #[arg(value_parser = PossibleValuesParser::new(crate::manual::completion::shells()))]
        shell: String,
    },
    /// Print the man page, or write one for each command.
    ///
    /// `gerono man | man -l -` shows it without installing it.
    Man(ManArguments),
    /// Print the JSON Schema of scenario files, for editors.
    Schema,
    /// Print gerono.h, the interface of libraries in C and C++.
    ///
    /// Libraries that implement it fly in place of services.
    Header,
    /// Run one service; only `gerono run` can start it.
    #[command(hide = true)]
    Service(ServiceProcess),
}

/// Arguments of the process of a service.
#[derive(Debug, Parser)]
pub struct ServiceProcess {
    /// Name of the service, or of a standby process.
    #[arg(value_parser = service_process)]
    pub name: String,
    /// Folder of the run, by which `gerono kill` and the like find it (`run_client::runs`).
    #[arg(long)]
    pub run: Option<PathBuf>,
    /// Host of the run, for the same purpose.
    #[arg(long)]
    pub host: Option<String>,
}

impl ServiceProcess {
    /// Parses the arguments of this process if it is a service: a restart in flight does not wait for the arguments of all
    /// commands.
    #[must_use]
    pub fn from_command_line() -> Option<Self> {
        let mut arguments = std::env::args_os().skip(1).peekable();
        arguments.next_if(|command| command == "service")?;
        let program = std::iter::once(OsString::from("service"));
        // What is wrong with them is said by the parser of all commands.
        Self::try_parse_from(program.chain(arguments)).ok()
    }
}

/// Arguments of `gerono man`.
#[derive(Debug, Args)]
pub struct ManArguments {
    /// Write gerono.1, gerono-run.1 and so on into this folder, such as ~/.local/share/man/man1.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}
