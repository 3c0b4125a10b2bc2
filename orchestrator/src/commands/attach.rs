//! `gerono attach`: takes over a flight in real time whose orchestrator has died.

use shared_types::ExternalServices;
use shared_types::service::seconds;

use super::conclusion::FlightResult;
use super::{Failure, host_record, run_log};
use crate::cli::{Attach, Host};
use ::postmortem::Postmortem;
use command_line::exit::Exit;
use command_line::interrupt;
use command_line::output::note;
use command_line::progress::Progress;
use flight::recording_sink::RecordingSink;
use run_log::Manifest;
use run_log::run_folder::RunFolder;
use supervisor::real_time::{self, Clients, TakeOver};

/// Name of the results: that of the scenario's file is known only to the dead orchestrator.
const NAME: &str = "attached";

/// `gerono attach`: records and supervises the flight from now to its end.
///
/// # Errors
/// [`Failure`] if there is no such flight.
pub fn attach(arguments: &Attach) -> Result<Exit, Failure> {
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let abandoned = run_client::abandoned(arguments.run.run.as_deref()).map_err(Failure::trouble)?;
    // Before the take-over: without a folder for the results the services continue alone.
    let folder = RunFolder::create(arguments.out.as_deref(), NAME).map_err(Failure::not_written)?;
    let _postmortem = Postmortem::prepare(Host::Realtime.name(), folder.path(), ExternalServices::default())
        .map_err(Failure::trouble)?;
    let flight = TakeOver::prepare(&abandoned).map_err(Failure::trouble)?;
    let scenario = flight.scenario().clone();
    let kept = super::copy_plugins(&mut scenario.clone(), &folder)?;
    let mut record = host_record(&folder, &scenario, arguments.recording).map_err(Failure::not_written)?;
    let manifest = Manifest::new(&scenario);
    let log = run_log(&folder, &manifest, arguments.recording)
        .map_err(Failure::not_written)?
        .in_real_time(&manifest);
    let mut progress = Progress::new(flight.schedule(), NAME, arguments.quiet);
    if !arguments.quiet {
        note(format_args!(
            "took over the flight at {:.1} s; its log from there on is in {}",
            seconds(flight.schedule().time_ns(flight.first_tick())),
            folder.path().display()
        ));
    }
    let clients = Clients {
        interrupt: &interrupt,
        messages: progress.messages(),
    };
    let mut sink = RecordingSink::new(&scenario, flight.schedule(), Some(log), progress.shared_tick())
        .from_tick(flight.first_tick());
    let ending = real_time::take_over(flight, &mut sink, &clients, &mut record).map_err(Failure::trouble)?;
    let ending = ending.with_record(record.finish());
    let flown = FlightResult {
        name: NAME,
        host: Host::Realtime,
        folder: &folder,
        kept,
        quiet: arguments.quiet,
    };
    flown.conclude(sink, &mut progress, ending)
}
