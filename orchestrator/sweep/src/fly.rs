//! `gerono sweep fly`: one sample again, with its log, and its row beside the one of the results.

use std::path::Path;

use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt;
use command_line::output::{note, print};
use run_log::run_folder::RunFolder;

use crate::arguments::Fly;
use crate::definition::Source;
use crate::flight;
use crate::prepared::Prepared;
use crate::row::{Cell, Row};
use crate::shard::{ShardReader, shards_in};

/// `gerono sweep fly`.
///
/// # Errors
/// [`Failure`] if there is no such sample, or nothing can be flown or written.
pub(crate) fn fly(arguments: &Fly) -> Result<Exit, Failure> {
    let (prepared, known) = find(arguments)?;
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
                    "nothing is called `{name}`; there is {}",
                    names.join(", ")
                ))
            })?,
    };
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let name = format!("sample-{}", arguments.sample);
    let folder = RunFolder::create(arguments.out.as_deref(), &name).map_err(Failure::not_written)?;
    let sample = plan.sample(arguments.sample);
    let flown = flight::fly_recorded(plan, &sample, entry, &folder.run_log(), &interrupt)?;
    let Some(flown) = flown else {
        return Ok(interrupt.signal().map_or(Exit::Success, Exit::Signal));
    };
    let row = prepared.layout.row(&sample, entry, &flown);
    for (column, cell) in prepared.layout.columns.iter().zip(&row) {
        print(format!("{:<28} {}\n", column.name, text(cell)));
    }
    let mut settings = plan.settings_of(&sample, entry);
    if let Ok(scenario) = plan.scenario(&sample, entry) {
        // A varied gain that this law does not use.
        settings.retain(|setting| scenario_file::concerns(setting, scenario.controller.law));
    }
    let sets: String = settings
        .iter()
        .map(|setting| format!(" --set '{setting}'"))
        .collect();
    let path = &plan.source.scenario_path;
    if std::fs::read_to_string(path).ok().as_ref() != Some(&plan.source.scenario_text) {
        note(format!(
            "{} is another scenario today: the command below flies that one",
            path.display()
        ));
    }
    print(format!(
        "\nthe same flight, to its end: gerono run {} --seed {}{sets}\nlog: {}\n",
        path.display(),
        sample.seed,
        folder.run_log().display()
    ));
    match known.and_then(|rows| rows.into_iter().find(|known| known[..2] == row[..2])) {
        None => {
            note("no row of it is known to compare");
            Ok(Exit::Success)
        }
        Some(known) if is_same(&known, &row) => {
            print("its row is that of the results, to the last bit\n");
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

fn is_same(one: &[Cell], other: &[Cell]) -> bool {
    let bits = |cell: &Cell| match cell {
        Cell::Number(_) | Cell::Integer(_) => Some(cell.number().to_bits()),
        _ => None,
    };
    one.iter()
        .zip(other)
        .all(|(one, other)| match (bits(one), bits(other)) {
            (Some(one), Some(other)) => one == other,
            _ => one == other,
        })
}

fn text(cell: &Cell) -> String {
    match cell {
        Cell::Flag(flag) => flag.to_string(),
        Cell::Integer(number) => number.to_string(),
        Cell::Number(None) => "–".to_owned(),
        Cell::Number(Some(number)) => format!("{number:?}"),
        Cell::Text(text) => text.clone(),
    }
}

/// The sweep that a path means, and the known rows of the sample.
fn find(arguments: &Fly) -> Result<(Prepared, Option<Vec<Row>>), Failure> {
    if !arguments.results.is_dir() {
        return Ok((Prepared::new(Source::read(&arguments.results)?)?, None));
    }
    let folder: &Path = &arguments.results;
    let mut prepared = None;
    for (shard, _) in shards_in(folder)?
        .into_iter()
        .filter(|(_, is_complete)| *is_complete)
    {
        let mut reader = ShardReader::open(&shard.path(folder))?;
        let header = reader.header.clone();
        if prepared.is_none() {
            let source = Source::new(
                folder,
                header.sweep_text,
                header.scenario_path,
                header.scenario_text,
            )?;
            let this = Prepared::new(source)?;
            if this.program != header.program {
                note(
                    "the results were flown by another build of gerono, whose flights may differ in their bits",
                );
            }
            if *this.plan.files() != header.files {
                note("the results were flown with other plug-ins or points of a path, whose flights differ");
            }
            prepared = Some(this);
        }
        let samples = prepared.as_ref().map_or(0, |prepared| prepared.plan.samples);
        if !shard.samples(samples).contains(&arguments.sample) {
            continue;
        }
        let mut rows = Vec::new();
        while let Some(row) = reader.next_row()? {
            if row[0] == Cell::Integer(arguments.sample) {
                rows.push(row);
            }
        }
        return Ok((prepared.expect("it was made above"), Some(rows)));
    }
    match prepared {
        Some(prepared) => Ok((prepared, None)),
        None => Err(Failure::bad_input(format!(
            "there is no complete shard in {}; name the sweep itself, or fly it first",
            folder.display()
        ))),
    }
}
