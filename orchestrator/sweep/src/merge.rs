//! Merges all shards into a table, a summary and a page.

use std::path::Path;

use ::flight::journal::Header as _;
use parquet::errors::ParquetError;
use serde::Serialize;

use crate::definition::Source;
use crate::error::SweepError;
use crate::page;
use crate::prepared::Prepared;
use crate::report::{Report, Results};
use crate::row::Row;
use crate::shard::{Shard, ShardReader, shards_in};
use crate::slurm::quoted;
use crate::table::TableWriter;

/// Merges the shards of a folder; returns the report and the number of refused flights.
///
/// # Errors
/// [`SweepError`] if shards are missing, differ or are damaged, or results cannot be written.
pub fn merge_folder(folder: &Path, mixed_builds: bool) -> Result<(Report, u64), SweepError> {
    let shards = complete_shards(folder)?;
    let first = ShardReader::open(&shards[0].path(folder))?.header().clone();
    let source = Source::new(
        &folder.join("(the sweep of its shards)"),
        first.sweep_text.clone(),
        first.scenario_path.clone(),
        first.scenario_text.clone(),
    )?;
    let prepared = Prepared::new(source)?;
    let names = prepared.layout.columns.iter().map(|column| column.name.as_str());
    if !names.eq(first.columns.iter().map(String::as_str)) {
        return Err(SweepError::bad_input(format!(
            "{}: its rows have other columns than this version of gerono writes; merge it with the version that flew it",
            folder.display()
        )));
    }
    let path = folder.join("results.parquet");
    let not_written =
        |error: ParquetError| SweepError::not_written(format!("cannot write {}: {error}", path.display()));
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
            expected.program.clone_from(&reader.header().program);
        }
        if let Some(reason) = expected.difference(reader.header()) {
            let fix = if reason.contains("build of gerono") {
                "; --mixed-builds merges them anyway"
            } else {
                ""
            };
            return Err(SweepError::bad_input(format!(
                "{}: {reason}{fix}",
                shard.path(folder).display()
            )));
        }
        while let Some(row) = reader.next_row()? {
            let row = typed(&prepared, row, &shard.path(folder))?;
            results.add(&row);
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

fn write_json(path: &Path, value: &impl Serialize) -> Result<(), SweepError> {
    let text = serde_json::to_string_pretty(value).map_err(SweepError::trouble)?;
    write(path, &(text + "\n"))
}

fn write(path: &Path, text: &str) -> Result<(), SweepError> {
    result_file::write(path, text, &[])
        .map_err(|error| SweepError::not_written(format!("cannot write {}: {error}", path.display())))
}

/// Converts the cells of a row to the kinds of their columns.
fn typed(prepared: &Prepared, row: Row, path: &Path) -> Result<Row, SweepError> {
    let cells = row
        .into_iter()
        .zip(&prepared.layout.columns)
        .map(|(cell, column)| {
            cell.into_kind(column.kind).ok_or_else(|| {
                SweepError::bad_input(format!(
                    "{}: a row has a value of the wrong kind in `{}`",
                    path.display(),
                    column.name
                ))
            })
        });
    cells.collect()
}

/// Returns the shards of a folder, if all are complete.
fn complete_shards(folder: &Path) -> Result<Vec<Shard>, SweepError> {
    let shards = shards_in(folder)?;
    let Some((first, _)) = shards.first() else {
        return Err(SweepError::bad_input(format!(
            "there are no shards in {}; `gerono sweep run SWEEP --out {}` flies them",
            folder.display(),
            quoted(&folder.display().to_string())
        )));
    };
    if let Some((other, _)) = shards.iter().find(|(shard, _)| shard.count != first.count) {
        return Err(SweepError::bad_input(format!(
            "{} holds shards of {} and of {}: move those of one division to another folder",
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
        return Err(SweepError::bad_input(format!(
            "{} of {} shards in {} are not complete, by number {}; `gerono sweep run SWEEP --shard {}/{} --out {}` flies one",
            missing.len(),
            first.count,
            folder.display(),
            missing.join(", "),
            missing[0],
            first.count,
            quoted(&folder.display().to_string())
        )));
    }
    Ok((0..first.count)
        .map(|index| Shard {
            index,
            count: first.count,
        })
        .collect())
}
