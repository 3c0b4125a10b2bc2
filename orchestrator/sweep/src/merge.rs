//! `gerono sweep merge`: one table, a summary and a page of all shards.

use std::path::Path;

use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::output::{note, print, write, write_json};
use evaluation::text_table::latex_file;
use parquet::errors::ParquetError;

use crate::arguments::Merge;
use crate::definition::Source;
use crate::page;
use crate::prepared::Prepared;
use crate::report::{Report, Results};
use crate::row::Row;
use crate::shard::{Shard, ShardReader, shards_in};
use crate::table::TableWriter;

/// `gerono sweep merge`.
///
/// # Errors
/// [`Failure`] if shards lack, differ or are damaged, or nothing can be written.
pub(crate) fn merge(arguments: &Merge) -> Result<Exit, Failure> {
    merge_and_tell(&arguments.results, arguments.mixed_builds, arguments.latex)
}

/// Merges the shards of a folder and prints the report.
pub(crate) fn merge_and_tell(folder: &Path, mixed_builds: bool, latex: bool) -> Result<Exit, Failure> {
    let (report, refused) = merge_folder(folder, mixed_builds)?;
    if latex {
        write(&folder.join("sweep.tex"), &latex_file(&report.tables()))?;
    }
    print(format!("{report}results: {}\n", folder.display()));
    if refused > 0 {
        note(format_args!(
            "{refused} flights were refused: their samples cannot be flown; see `reason` in the table"
        ));
    }
    match report.laws.iter().find(|law| law.flown() == 0) {
        Some(law) => Err(Failure::bad_input(format!(
            "not one sample was flown with `{}`: all {} were refused, see `reason` in the table",
            law.name, law.refused
        ))),
        None => Ok(Exit::Success),
    }
}

/// Merges the shards of a folder; returns the report and the number of flights that were refused.
pub(crate) fn merge_folder(folder: &Path, mixed_builds: bool) -> Result<(Report, u64), Failure> {
    let shards = complete_shards(folder)?;
    let first = ShardReader::open(&shards[0].path(folder))?.header;
    let source = Source::new(
        &folder.join("(the sweep of its shards)"),
        first.sweep_text.clone(),
        first.scenario_path.clone(),
        first.scenario_text.clone(),
    )?;
    let prepared = Prepared::new(source)?;
    let names = prepared.layout.columns.iter().map(|column| column.name.as_str());
    if !names.eq(first.columns.iter().map(String::as_str)) {
        return Err(Failure::bad_input(format!(
            "{}: its rows have other columns than this version of gerono writes; merge it with the one that flew it",
            folder.display()
        )));
    }
    let path = folder.join("results.parquet");
    let not_written =
        |error: ParquetError| Failure::not_written(format!("cannot write {}: {error}", path.display()));
    let about = [
        ("gerono.sweep", first.sweep_text.as_str()),
        ("gerono.scenario", first.scenario_text.as_str()),
    ];
    let mut table = TableWriter::create(&path, &prepared.layout.columns, &about).map_err(not_written)?;
    let mut results = Results::new(&prepared.plan, &prepared.layout);
    for shard in &shards {
        let mut reader = ShardReader::open(&shard.path(folder))?;
        let mut expected = first.clone();
        expected.shard = *shard;
        if mixed_builds {
            expected.program.clone_from(&reader.header.program);
        }
        if let Some(reason) = expected.difference(&reader.header) {
            let fix = if reason.contains("build of gerono") {
                "; --mixed-builds takes them together all the same"
            } else {
                ""
            };
            return Err(Failure::bad_input(format!(
                "{}: {reason}{fix}",
                shard.path(folder).display()
            )));
        }
        while let Some(row) = reader.next_row()? {
            let row = typed(&prepared, row, &shard.path(folder))?;
            results.take(&row);
            table.write(row).map_err(not_written)?;
        }
    }
    table.finish().map_err(not_written)?;
    let report = Report::new(&prepared.plan, &prepared.layout, &results);
    write_json(&folder.join("sweep.json"), &report)?;
    write(&folder.join("sweep.md"), &report.markdown())?;
    write(
        &folder.join("index.html"),
        &page::page(&report, &prepared, &results),
    )?;
    for (name, drawing) in page::maps(&prepared, &results) {
        write(&folder.join(name), &drawing)?;
    }
    Ok((report, results.refused))
}

/// Cells as their columns have them.
fn typed(prepared: &Prepared, row: Row, path: &Path) -> Result<Row, Failure> {
    let cells = row
        .into_iter()
        .zip(&prepared.layout.columns)
        .map(|(cell, column)| {
            cell.of_kind(column.kind).ok_or_else(|| {
                Failure::bad_input(format!(
                    "{}: a row has no such value in `{}`",
                    path.display(),
                    column.name
                ))
            })
        });
    cells.collect()
}

/// The shards of a folder, if they are all there.
fn complete_shards(folder: &Path) -> Result<Vec<Shard>, Failure> {
    let shards = shards_in(folder)?;
    let Some((first, _)) = shards.first() else {
        return Err(Failure::bad_input(format!(
            "there are no shards in {}; `gerono sweep run SWEEP --out {}` flies them",
            folder.display(),
            folder.display()
        )));
    };
    if let Some((other, _)) = shards.iter().find(|(shard, _)| shard.count != first.count) {
        return Err(Failure::bad_input(format!(
            "{} holds shards of {} and of {}: move those of one away",
            folder.display(),
            first.count,
            other.count
        )));
    }
    let complete = |index: u64| {
        let shard = Shard {
            index,
            count: first.count,
        };
        shards.contains(&(shard, true))
    };
    let missing: Vec<_> = (0..first.count)
        .filter(|&index| !complete(index))
        .map(|index| index.to_string())
        .collect();
    if !missing.is_empty() {
        return Err(Failure::bad_input(format!(
            "{} of {} shards in {} are not complete, by number {}; `gerono sweep run SWEEP --shard {}/{} --out {}` flies one",
            missing.len(),
            first.count,
            folder.display(),
            missing.join(", "),
            missing[0],
            first.count,
            folder.display()
        )));
    }
    Ok((0..first.count)
        .map(|index| Shard {
            index,
            count: first.count,
        })
        .collect())
}
