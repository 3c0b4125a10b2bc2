//! `gerono run`: flies a scenario, records it and prints the results.

use std::path::Path;
use std::time::Duration;

use runtime::deployment::Scheduler;
use scenario::Scenario;
use shared_types::ServiceId;
use shared_types::schedule::Schedule;

use super::conclusion::FlightResult;
use super::{Failure, host_record, load, refused, run_log, scenario_name, schedule_of};
use crate::cli::{DeploymentArguments, Host, Run, ServiceCrash};
use ::postmortem::Postmortem;
use command_line::exit::Exit;
use command_line::interrupt;
use command_line::output::note;
use command_line::progress::Progress;
use decisions::restart_policy::{PerService, RestartPolicy};
use doctor::{HostFacts, Needs, disk};
use flight::in_process;
use flight::recording_sink::RecordingSink;
use run_log::run_folder::RunFolder;
use run_log::{Compression, Manifest};
use supervisor::deployment::{Deployment, Placement};
use supervisor::real_time::Clients;
use supervisor::{Ending, Outcome, RunFailure, lock_step, real_time};

/// Returns the first given option that concerns processes of services.
fn process_option(deployment: &DeploymentArguments) -> Option<&'static str> {
    let options = [
        ("--crash", !deployment.crash.is_empty()),
        ("--restarts", !deployment.restarts.is_empty()),
        ("--restart-pause", !deployment.restart_pause.is_empty()),
        ("--fifo", deployment.fifo),
        ("--core", deployment.core.is_some()),
        ("--no-pin", deployment.no_pin),
        ("--no-yield", deployment.no_yield),
    ];
    options
        .into_iter()
        .find_map(|(option, is_given)| is_given.then_some(option))
}

/// `gerono run`.
///
/// # Errors
/// [`Failure`] if the flight did not begin; other outcomes of a flight are an [`Exit`].
pub fn run(arguments: &Run) -> Result<Exit, Failure> {
    let mut scenario = load(&arguments.scenario)?;
    refuse_host(&scenario, arguments)?;
    if let Some(problem) = scenario.missing_arm_request()
        && arguments.host != Host::Realtime
    {
        return Err(refused(&arguments.scenario, &problem));
    }
    if arguments.host == Host::Realtime {
        scenario = scenario.with_real_time_policies();
    }
    let schedule = schedule_of(&scenario)?;
    let warnings = super::check::warnings(&scenario).len();
    if warnings > 0 && !arguments.quiet {
        note(format_args!(
            "`gerono check` has {warnings} warning{} about this flight, with the fix",
            if warnings == 1 { "" } else { "s" }
        ));
    }
    if arguments.host == Host::Inprocess
        && let Some(option) = process_option(&arguments.deployment)
    {
        return Err(Failure::bad_input(format!(
            "{option} applies to processes of services, and --host inprocess has a single process"
        )));
    }
    refuse_crashes(&scenario, &schedule, &arguments.deployment.crash)?;
    refuse_full_disk(arguments, &scenario, &schedule)?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let name = scenario_name(&arguments.scenario.scenario);
    let folder = RunFolder::create(arguments.out.as_deref(), &name).map_err(Failure::not_written)?;
    let kept = super::copy_plugins(&mut scenario, &folder)?;
    let manifest = Manifest::new(&scenario);
    let mut log = run_log(&folder, &manifest, arguments.recording).map_err(Failure::not_written)?;
    if arguments.host == Host::Realtime {
        log = log.in_real_time(&manifest);
    }

    let mut progress = Progress::new(&schedule, &name, arguments.quiet);
    let clients = Clients {
        interrupt: &interrupt,
        messages: progress.messages(),
    };
    let mut sink = RecordingSink::new(&scenario, &schedule, Some(log), progress.shared_tick());
    let ending = fly(arguments, &scenario, &folder, &mut sink, &clients);
    let flown = FlightResult {
        name: &name,
        host: arguments.host,
        folder: &folder,
        kept,
        quiet: arguments.quiet,
    };
    flown.conclude(sink, &mut progress, ending)
}

/// Refuses a flight whose log would not fit on the disk. The size of a compressed log is unknown, files of a split log may be
/// moved in flight, and a flight in real time is ended by its operator.
fn refuse_full_disk(arguments: &Run, scenario: &Scenario, schedule: &Schedule) -> Result<(), Failure> {
    let is_split = scenario
        .record
        .as_ref()
        .is_some_and(|record| record.split.is_some());
    let ends_early = arguments.host == Host::Realtime;
    if is_split || ends_early || arguments.recording.compression != Compression::None {
        return Ok(());
    }
    let folder = disk::nearest_folder(arguments.out.as_deref().unwrap_or(Path::new("runs")));
    let shortage = disk::shortage(&HostFacts::this(), &folder, &Needs::of(scenario, schedule));
    shortage.map_or(Ok(()), |shortage| Err(Failure::trouble(shortage)))
}

/// Refuses crashes that would never happen.
fn refuse_crashes(scenario: &Scenario, schedule: &Schedule, crashes: &[ServiceCrash]) -> Result<(), Failure> {
    let last = schedule.last_tick();
    for ServiceCrash { service, crash } in crashes {
        let reason = if scenario.program_of(*service).is_some() {
            format!("--crash works for Gerono's services only, and `{service}` is an external service")
        } else if crash.place.is_in_a_step() && crash.tick > last {
            format!(
                "--crash {service}@{}: the last tick of the flight is {last}",
                crash.tick
            )
        } else {
            continue;
        };
        return Err(Failure::bad_input(reason));
    }
    Ok(())
}

/// Refuses a laboratory except in real time with an operator, and external services except as processes.
fn refuse_host(scenario: &Scenario, arguments: &Run) -> Result<(), Failure> {
    let unsimulated = || flight::unsimulated_poses(scenario).map(Failure::bad_input);
    let failure = match arguments.host {
        Host::Realtime => {
            let problem = scenario.unattended_arming();
            problem.map(|problem| refused(&arguments.scenario, &problem))
        }
        Host::Lockstep => unsimulated(),
        Host::Inprocess => {
            unsimulated().or_else(|| flight::programs_of_its_own(scenario).map(Failure::bad_input))
        }
    };
    failure.map_or(Ok(()), Err)
}

fn fly(
    arguments: &Run,
    scenario: &Scenario,
    folder: &RunFolder,
    sink: &mut RecordingSink<'_>,
    clients: &Clients<'_>,
) -> Ending {
    let result = match arguments.host {
        Host::Inprocess => in_process::record(scenario, sink, clients.interrupt)
            .map(Ending::from)
            .map_err(RunFailure::from),
        Host::Lockstep | Host::Realtime => fly_processes(arguments, scenario, folder, sink, clients),
    };
    result.unwrap_or_else(|failure| Ending {
        outcome: Outcome::Failed(failure),
        ticks: 0,
        wall_time: Duration::ZERO,
        warnings: Vec::new(),
        restarts: Vec::new(),
        timing: None,
        laboratory: None,
    })
}

fn fly_processes(
    arguments: &Run,
    scenario: &Scenario,
    folder: &RunFolder,
    sink: &mut RecordingSink<'_>,
    clients: &Clients<'_>,
) -> Result<Ending, RunFailure> {
    let mut record = host_record(folder, scenario, arguments.recording)?;
    let _postmortem = Postmortem::prepare(arguments.host.name(), folder.path(), scenario.external_services())
        .map_err(RunFailure::setup)?;
    let deployment = deployment(&arguments.deployment);
    let ending = if arguments.host == Host::Realtime {
        real_time::fly(scenario, &deployment, sink, clients, &mut record)?
    } else {
        lock_step::record(
            scenario,
            &deployment,
            sink,
            clients.interrupt,
            &clients.messages,
            &mut record,
        )?
    };
    Ok(ending.with_record(record.finish()))
}

fn deployment(arguments: &DeploymentArguments) -> Deployment {
    Deployment {
        placement: match (arguments.no_pin, arguments.core) {
            (true, _) => Placement::Anywhere,
            (false, Some(core)) => Placement::Core(core),
            (false, None) => Placement::AsStated,
        },
        scheduler: match (arguments.fifo, arguments.no_yield) {
            (true, _) => Scheduler::Fifo,
            (false, true) => Scheduler::Batch,
            (false, false) => Scheduler::Fair,
        },
        yielding: !arguments.no_yield,
        crashes: arguments
            .crash
            .iter()
            .map(|crash| (crash.service, crash.crash))
            .collect(),
        restart_policies: ServiceId::ALL.map(|service| {
            let default = RestartPolicy::default();
            let pause = PerService::of(&arguments.restart_pause, service);
            RestartPolicy {
                limit: PerService::of(&arguments.restarts, service).unwrap_or(default.limit),
                longest_pause: pause.map_or(default.longest_pause, Duration::from_secs_f64),
            }
        }),
    }
}
