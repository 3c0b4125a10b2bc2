//! `gerono run`: flies a scenario, records it, and says how it went.

use std::time::Duration;

use runtime::deployment::Scheduler;
use shared_types::ServiceId;
use shared_types::scenario::{PoseSource, RadioProtocol, Scenario};

use super::conclusion::Flown;
use super::{Failure, load, scenario_name, schedule_of};
use crate::cli::{DeploymentArguments, Host, Run};
use crate::exit::Exit;
use crate::flight::crew::restart::{PerService, RestartPolicy};
use crate::flight::deployment::{Deployment, Placement};
use crate::flight::tape::Tape;
use crate::flight::{Ending, FlightFailure, Outcome, in_process, lock_step, real_time};
use crate::host_record::HostRecord;
use crate::interrupt::Interrupt;
use crate::log::{Manifest, RunLogWriter};
use crate::progress::Progress;
use crate::run_folder::RunFolder;

/// `gerono run`.
///
/// # Errors
/// [`Failure`] if nothing was flown; a flight that ends badly is an [`Exit`].
pub fn run(arguments: &Run) -> Result<Exit, Failure> {
    let scenario = load(&arguments.scenario)?;
    if let Some(problem) = scenario.unasked()
        && arguments.host != Host::Realtime
    {
        return Err(Failure::new(Exit::BadInput, problem));
    }
    refuse_network_poses(&scenario)?;
    if arguments.host == Host::Realtime {
        refuse_transmitter(&scenario)?;
    }
    let schedule = schedule_of(&scenario)?;
    if arguments.host == Host::Inprocess && !arguments.deployment.crash.is_empty() {
        let reason =
            "--crash kills the process of a service, and with --host inprocess there is but one process";
        return Err(Failure::new(Exit::BadInput, reason));
    }
    let interrupt = Interrupt::install().map_err(|error| Failure::new(Exit::Trouble, error))?;
    let name = scenario_name(&arguments.scenario.scenario);
    let folder = RunFolder::create(arguments.out.as_deref(), &name)
        .map_err(|error| Failure::new(Exit::NotWritten, error))?;
    let manifest = Manifest::new(&scenario);
    let mut log = RunLogWriter::create(&folder.run_log(), &manifest, arguments.compression)
        .map_err(|error| Failure::new(Exit::NotWritten, error))?;
    if arguments.host == Host::Realtime {
        log = log.in_real_time(&manifest);
    }

    let mut progress = Progress::new(&schedule, &name, arguments.quiet);
    let mut tape = Tape::new(&scenario, &schedule, Some(log), &mut progress);
    let ending = fly(arguments, &scenario, &folder, &mut tape, &interrupt);
    let flown = Flown {
        name: &name,
        host: arguments.host,
        folder: &folder,
        quiet: arguments.quiet,
    };
    flown.conclude(tape, ending)
}

/// Never silently with simulated poses in the place of those that the scenario names.
fn refuse_network_poses(scenario: &Scenario) -> Result<(), Failure> {
    let source = scenario.estimator.as_ref().map(|estimator| estimator.source);
    let Some(system) = source.and_then(PoseSource::system) else {
        return Ok(());
    };
    let reason = format!(
        "poses are to come from `{}`, to which no host connects the estimator; fly with --set \
         estimator.source=simulated, or look at what comes with `gerono mocap probe`",
        system.name()
    );
    Err(Failure::new(Exit::BadInput, reason))
}

/// Never silently without the transmitter that the scenario names; in simulated time the link is simulated anyway.
fn refuse_transmitter(scenario: &Scenario) -> Result<(), Failure> {
    let link = scenario.rc_output.as_ref().map(|output| output.link);
    let Some(link) = link.filter(|link| *link != RadioProtocol::Simulated) else {
        return Ok(());
    };
    let reason = format!(
        "frames are to leave on `{}`, to which no host connects rc_output; fly with --set rc_output.link=simulated, \
         or try the link with `gerono rc probe`",
        link.name()
    );
    Err(Failure::new(Exit::BadInput, reason))
}

fn fly(
    arguments: &Run,
    scenario: &Scenario,
    folder: &RunFolder,
    tape: &mut Tape<'_>,
    interrupt: &Interrupt,
) -> Ending {
    let result = match arguments.host {
        Host::Inprocess => in_process::fly(scenario, tape, interrupt),
        Host::Lockstep | Host::Realtime => fly_processes(arguments, scenario, folder, tape, interrupt),
    };
    result.unwrap_or_else(|failure| Ending {
        outcome: Outcome::Failed(failure),
        ticks: 0,
        wall_time: Duration::ZERO,
        warnings: Vec::new(),
        rebirths: Vec::new(),
        timing: None,
    })
}

fn fly_processes(
    arguments: &Run,
    scenario: &Scenario,
    folder: &RunFolder,
    tape: &mut Tape<'_>,
    interrupt: &Interrupt,
) -> Result<Ending, FlightFailure> {
    let mut record = HostRecord::create(&folder.host_log(), arguments.compression)?;
    let deployment = deployment(&arguments.deployment);
    let ending = if arguments.host == Host::Realtime {
        real_time::fly(scenario, &deployment, tape, interrupt, &mut record)?
    } else {
        lock_step::fly(scenario, &deployment, tape, interrupt, &mut record)?
    };
    record.finish()?;
    Ok(ending)
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
        restarts: ServiceId::ALL.map(|service| {
            let default = RestartPolicy::default();
            let pause = PerService::of(&arguments.restart_pause, service);
            RestartPolicy {
                limit: PerService::of(&arguments.restarts, service).unwrap_or(default.limit),
                longest_pause: pause.map_or(default.longest_pause, Duration::from_secs_f64),
            }
        }),
    }
}
