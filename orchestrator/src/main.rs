//! `gerono`: flies scenarios as processes, supervises them and records their samples.

use std::process::ExitCode;

use clap::CommandFactory;
use command_line::exit::Exit;
use command_line::interrupt::ignore_file_size_signal;
use command_line::output::{self, print_error};
use laboratory_tools::gnss_probe::{self, GnssCommand};
use orchestrator::cli::{
    Cli, Command, Get, LabCommand, Operate, OperatorCommand, Postmortem, RcCommand, ServiceProcess, Set,
    groups,
};
use orchestrator::commands::{
    self, Failure, attach, check, clean, doctor, faults, generated, grid, identify, lab, logs, mocap,
    operate, operator, rc, replay, report, reproduce, run, service, sweep, top, truth, view, world,
};
use run_client::Question;
use runtime::shared_page::Request;

fn main() -> ExitCode {
    orchestrator::manual::completion::answer(Cli::command);
    if let Err(error) = ignore_file_size_signal() {
        print_error(error);
        return Exit::Trouble.into();
    }
    if let Some(done) = bench::member::run() {
        return output::conclude(done.map(|()| Exit::Success));
    }
    if let Some(arguments) = Postmortem::from_command_line() {
        return output::conclude(commands::postmortem::postmortem(&arguments));
    }
    if let Some(process) = ServiceProcess::from_command_line() {
        return output::conclude(service::service(&process.name).map(|()| Exit::Success));
    }
    let result = match groups::parse().command {
        Command::New(arguments) => new_scenario::new(&arguments).map(|()| Exit::Success),
        Command::Run(arguments) => run::run(&arguments),
        Command::Check(arguments) => check::check(&arguments).map(|()| Exit::Success),
        Command::Plot(arguments) => logs::plot(&arguments).map(|()| Exit::Success),
        Command::Report(arguments) => report::report(&arguments),
        Command::Export(arguments) => logs::export(&arguments).map(|()| Exit::Success),
        Command::Info(arguments) => logs::info(&arguments),
        Command::Recover(arguments) => logs::recover(&arguments).map(|()| Exit::Success),
        Command::Diff(arguments) => replay::diff(&arguments),
        Command::Import(arguments) => recorded_flight::import(&arguments),
        Command::Replay(arguments) => replay::replay(&arguments),
        Command::Digest(arguments) => logs::digest(&arguments).map(|()| Exit::Success),
        Command::Bench(arguments) => commands::bench::bench(&arguments).map(|()| Exit::Success),
        Command::Reproduce(arguments) => reproduce::reproduce(&arguments),
        Command::Faults(arguments) => faults::faults(&arguments),
        Command::Grid(arguments) => grid::grid(&arguments),
        Command::Sweep(arguments) => sweep::sweep(&arguments),
        Command::Identify(arguments) => identify::identify(&arguments).map(|()| Exit::Success),
        Command::Doctor(arguments) => doctor::doctor(&arguments),
        Command::Mocap(arguments) => mocap::mocap(&arguments),
        Command::Gnss(GnssCommand::Probe(arguments)) => gnss_probe::probe(&arguments),
        Command::Lab(LabCommand::Check(arguments)) => lab::check(&arguments),
        Command::Arm(arguments) => operate::arm(&arguments).map(|()| Exit::Success),
        Command::Disarm(arguments) => operate(&arguments, "disarm", &Question::Operate(Request::Disarm)),
        Command::Kill(arguments) => operate::kill(&arguments).map(|()| Exit::Success),
        Command::Stop(arguments) => operate(&arguments, "stop", &Question::Stop),
        Command::Set(Set { run, settings }) => operate(&run, "set", &Question::Set(settings)),
        Command::Get(Get { run, keys }) => operate::get(&run, keys).map(|()| Exit::Success),
        Command::Operator(OperatorCommand::Probe(arguments)) => operator::probe(&arguments),
        Command::Rc(RcCommand::Probe(arguments)) => rc::probe(&arguments),
        Command::Rc(RcCommand::Motors(arguments)) => rc::motors(&arguments),
        Command::Rc(RcCommand::Identify(arguments)) => rc::identify(&arguments).map(|()| Exit::Success),
        Command::Attach(arguments) => attach::attach(&arguments),
        Command::Top(arguments) => top::top(&arguments),
        Command::View(arguments) => view::view(&arguments),
        Command::World(arguments) => world::world(&arguments),
        Command::Truth(arguments) => truth::truth(&arguments).map(|()| Exit::Success),
        Command::Clean => clean::clean().map(|()| Exit::Success),
        Command::Schema => {
            generated::schema();
            Ok(Exit::Success)
        }
        Command::Header => {
            generated::header();
            Ok(Exit::Success)
        }
        Command::Completions { shell } => generated::completions(&shell).map(|()| Exit::Success),
        Command::Man(arguments) => generated::man(&arguments).map(|()| Exit::Success),
        Command::Service(process) => service::service(&process.name).map(|()| Exit::Success),
    };
    output::conclude(result)
}

fn operate(arguments: &Operate, command: &'static str, question: &Question) -> Result<Exit, Failure> {
    operate::operate(arguments, command, question).map(|()| Exit::Success)
}
