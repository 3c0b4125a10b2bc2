//! `gerono sweep fly`: repeats one sample with a log and compares its row with the results.

use command_line::exit::Exit;
use command_line::interrupt;
use run_log::run_folder::RunFolder;
use sweep::flight::fly_recorded;
use sweep::fly::{find, is_same, text};
use sweep::slurm::quoted;

use super::failure;
use crate::cli::SweepFly;
use crate::commands::{Failure, ended, note, print};

/// `gerono sweep fly`.
///
/// # Errors
/// [`Failure`] if there is no such sample, or it cannot be flown or written.
pub(super) fn fly(arguments: &SweepFly) -> Result<Exit, Failure> {
    let (prepared, known) =
        find(&arguments.results, arguments.sample, |reason| note(reason)).map_err(failure)?;
    let plan = &prepared.plan;
    if arguments.sample >= plan.samples {
        let reason = format!(
            "there is no sample {}; the last one is {}",
            arguments.sample,
            plan.samples - 1
        );
        return Err(Failure::bad_input(reason));
    }
    let entry = match &arguments.law {
        None => &plan.entries[0],
        Some(name) => plan
            .entries
            .iter()
            .find(|entry| entry.name == *name)
            .ok_or_else(|| {
                let names: Vec<_> = plan.entries.iter().map(|entry| entry.name.as_str()).collect();
                Failure::bad_input(format!(
                    "there is no law `{name}`; there are {}",
                    names.join(", ")
                ))
            })?,
    };
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let name = format!("sample-{}", arguments.sample);
    let folder = RunFolder::create(arguments.out.as_deref(), &name).map_err(Failure::not_written)?;
    let sample = plan.sample(arguments.sample);
    let flown = fly_recorded(plan, &sample, entry, &folder.run_log(), &interrupt).map_err(failure)?;
    let Some(flown) = flown else {
        return Ok(ended(&interrupt));
    };
    let row = prepared.layout.row(&sample, entry, &flown);
    for (column, cell) in prepared.layout.columns.iter().zip(&row) {
        print(format!("{:<28} {}\n", column.name, text(cell)));
    }
    let mut settings = plan.settings_of(&sample, entry);
    if let Ok(scenario) = plan.scenario(&sample, entry) {
        // Drops varied gains that this law does not use.
        settings.retain(|setting| scenario_file::concerns(setting, scenario.controller.law));
    }
    let sets: String = settings
        .iter()
        .map(|setting| format!(" --set {}", quoted(setting)))
        .collect();
    let path = &plan.source.scenario_path;
    if std::fs::read_to_string(path).ok().as_ref() != Some(&plan.source.scenario_text) {
        note(format!(
            "{} has changed since the sweep: the command below flies the changed scenario",
            path.display()
        ));
    }
    print(format!(
        "\nthe same flight, to its end: gerono run {} --seed {}{sets}\nlog: {}\n",
        quoted(&path.display().to_string()),
        sample.seed,
        folder.run_log().display()
    ));
    match known.and_then(|rows| rows.into_iter().find(|known| known[..2] == row[..2])) {
        None => {
            note("there is no recorded row to compare");
            Ok(Exit::Success)
        }
        Some(known) if is_same(&known, &row) => {
            print("the row matches the results bit for bit\n");
            Ok(Exit::Success)
        }
        Some(known) => {
            for ((column, cell), known) in prepared.layout.columns.iter().zip(&row).zip(&known) {
                if !is_same(std::slice::from_ref(cell), std::slice::from_ref(known)) {
                    print(format!(
                        "differs: {} is {}, was {}\n",
                        column.name,
                        text(cell),
                        text(known)
                    ));
                }
            }
            Ok(Exit::Diverged)
        }
    }
}
