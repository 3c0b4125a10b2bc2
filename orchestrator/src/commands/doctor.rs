//! `gerono doctor`: checks this machine before a flight.

use std::io::IsTerminal;
use std::time::Duration;

use super::{Failure, print, print_as_it_is, schedule_of};
use crate::cli::Doctor;
use command_line::exit::Exit;
use command_line::interrupt;
use command_line::progress;
use doctor::report::MachineReport;
use doctor::{CheckOutcome, HostFacts, Needs, disk, dongle, examine, runs, wake_up};
use flight::interrupt::Interrupt;
use run_client::run_root;

/// `gerono doctor`.
///
/// # Errors
/// [`Failure`] if the scenario cannot be flown; an unfit machine is an [`Exit`].
pub fn doctor(arguments: &Doctor) -> Result<Exit, Failure> {
    let needs = needs(arguments)?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let bar = progress::waiting("measuring the disk and the wake-ups");
    let report = report(arguments, &needs, &interrupt);
    bar.finish_and_clear();
    let Some(report) = report else {
        return Ok(Exit::Signal(interrupt.signal().unwrap_or_default()));
    };
    if arguments.json {
        let text = serde_json::to_string_pretty(&report).map_err(Failure::trouble)?;
        print(text + "\n");
    } else {
        let is_coloured = std::io::stdout().is_terminal() && std::env::var_os("NO_COLOR").is_none();
        print_as_it_is(report.text(is_coloured));
    }
    Ok(match report.verdict {
        CheckOutcome::Green | CheckOutcome::Yellow => Exit::Success,
        CheckOutcome::Red => Exit::Unfit,
    })
}

fn needs(arguments: &Doctor) -> Result<Needs, Failure> {
    let Some(path) = &arguments.scenario else {
        return Ok(Needs::ordinary());
    };
    let scenario = scenario_file::load_shortened(path, &arguments.sets, None)
        .map_err(Failure::from)?
        .0;
    let schedule = schedule_of(&scenario)?;
    Ok(Needs::of(&scenario, &schedule))
}

/// Makes all checks and measurements; `None` if the user interrupted them.
fn report(arguments: &Doctor, needs: &Needs, interrupt: &Interrupt) -> Option<MachineReport> {
    let host = HostFacts::this();
    let stopped = || interrupt.signal().is_some();
    let mut checks = examine(&host, needs);
    checks.extend(dongle::check(&host, needs, cfg!(feature = "crazyradio")));
    checks.extend([
        runs::live(&run_client::runs::all()),
        runs::dead(&run_root::find()),
    ]);

    let folder = disk::nearest_folder(&arguments.runs);
    checks.push(disk::space(&host, &folder, needs));
    let free = host.space(&folder).map_or(0, |space| space.free);
    let speed = disk::measure(&folder, free, stopped);
    if matches!(speed, Ok(None)) {
        return None;
    }
    checks.push(disk::speed(&speed.map(Option::unwrap_or_default), needs));

    let lateness = wake_up::measure(
        needs.highest_priority,
        Duration::from_secs_f64(arguments.seconds),
        stopped,
    )?;
    checks.push(wake_up::judge(&lateness, &host, needs));
    Some(MachineReport::new(checks, lateness))
}
