//! The shards of a sweep: each is the [`journal`] of its rows, in the order of samples and entries.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use ::flight::journal::{self, Header as _, Journal, JournalError, JournalReader};
use serde::{Deserialize, Serialize};

use crate::error::SweepError;
use crate::prepared::Prepared;
use crate::row::Row;

/// Part of a sweep: number `index` of `count`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Shard {
    /// Index, from 0.
    pub index: u64,
    /// Number of shards.
    pub count: u64,
}

impl Shard {
    /// The whole sweep.
    pub const WHOLE: Self = Self { index: 0, count: 1 };

    /// Returns the shard's part of `total` samples.
    #[must_use]
    pub fn samples(self, total: u64) -> Range<u64> {
        let begin = |index: u64| {
            let sample = u128::from(total) * u128::from(index) / u128::from(self.count);
            u64::try_from(sample).expect("at most `total`")
        };
        begin(self.index)..begin(self.index + 1)
    }

    /// Returns the path of the complete file in a folder.
    #[must_use]
    pub fn path(self, folder: &Path) -> PathBuf {
        folder.join(format!("shard-{:05}-of-{:05}.rows", self.index, self.count))
    }

    fn partial_path(self, folder: &Path) -> PathBuf {
        run_log::partial_path(&self.path(folder))
    }

    /// Parses a file name; returns the shard and whether the file is complete.
    #[must_use]
    pub fn from_file_name(name: &str) -> Option<(Self, bool)> {
        let rest = name.strip_prefix("shard-")?;
        let (rest, is_complete) = match rest.strip_suffix(".rows") {
            Some(rest) => (rest, true),
            None => (rest.strip_suffix(".rows.partial")?, false),
        };
        let (index, count) = rest.split_once("-of-")?;
        let shard = Self {
            index: index.parse().ok()?,
            count: count.parse().ok()?,
        };
        Some((shard, is_complete))
    }
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(index, count)| {
            Some(Self {
                index: index.parse().ok()?,
                count: count.parse().ok()?,
            })
        });
        numbers
            .filter(|shard| shard.index < shard.count)
            .ok_or_else(|| "write I/N with I from 0 to N − 1, such as 0/20".to_owned())
    }
}

/// First line of a shard's file: everything that its rows depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the file format.
    pub form: u32,
    /// The shard.
    pub shard: Shard,
    /// SHA-256 of sweep and scenario.
    pub sweep: String,
    /// SHA-256 of the program.
    pub program: String,
    /// SHA-256 of each file that flights read, such as a plug-in, by its purpose.
    pub files: BTreeMap<String, String>,
    /// Text of the sweep.
    pub sweep_text: String,
    /// Path of the scenario.
    pub scenario_path: PathBuf,
    /// Text of the scenario.
    pub scenario_text: String,
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Number of rows of the complete shard; 0 in files of earlier versions.
    #[serde(default)]
    pub rows: u64,
}

/// Version of the file format that this program writes.
const FORM: u32 = 3;

impl Header {
    /// Makes the header of a shard.
    #[must_use]
    pub(crate) fn new(shard: Shard, prepared: &Prepared) -> Self {
        let (source, columns) = (&prepared.plan.source, &prepared.layout.columns);
        let samples = shard.samples(prepared.plan.samples);
        Self {
            form: FORM,
            shard,
            sweep: source.identity(),
            program: prepared.program.clone(),
            files: prepared.plan.files().clone(),
            sweep_text: source.text.clone(),
            scenario_path: source.scenario_path.clone(),
            scenario_text: source.scenario_text.clone(),
            columns: columns.iter().map(|column| column.name.clone()).collect(),
            rows: (samples.end - samples.start) * prepared.plan.entries.len() as u64,
        }
    }
}

impl journal::Header for Header {
    fn flights(&self) -> u64 {
        self.rows
    }

    fn difference(&self, other: &Self) -> Option<String> {
        let fixed = if self.form != other.form {
            Some("it has the form of another version of gerono")
        } else if self.scenario_text != other.scenario_text {
            Some("it is of another scenario")
        } else if self.sweep != other.sweep {
            Some("it is of another sweep")
        } else if self.shard != other.shard {
            Some("its name does not match the shard that it holds")
        } else if self.program != other.program {
            Some("it was flown by another build of gerono, whose flights may differ in their bits")
        } else if self.columns != other.columns {
            Some("it has other columns")
        } else {
            None
        };
        fixed.map(str::to_owned).or_else(|| {
            let names = self.files.keys().chain(other.files.keys());
            let mut names = names.filter(|name| self.files.get(*name) != other.files.get(*name));
            names
                .next()
                .map(|name| format!("{name} is another file than it was flown with"))
        })
    }
}

/// Opens the file of a shard to continue after its last complete row.
///
/// # Errors
/// [`JournalError`] if the file belongs to something else or cannot be written.
pub fn open(folder: &Path, header: &Header) -> Result<Journal, JournalError> {
    let is_whole = |row: Row| row.len() == header.columns.len();
    Journal::open(&header.shard.path(folder), header, is_whole)
}

/// Returns whether a folder holds a complete shard.
///
/// # Errors
/// [`SweepError`] if the shard is damaged, or the folder holds something else.
pub fn is_complete(folder: &Path, expected: &Header) -> Result<bool, SweepError> {
    check_folder(folder, expected)?;
    let is_there = expected.shard.path(folder).exists();
    if is_there {
        check_complete(folder, expected)?;
    }
    Ok(is_there)
}

/// Refuses a folder that holds something other than this sweep, or a different division of it into shards.
///
/// # Errors
/// [`SweepError`] with the difference.
fn check_folder(folder: &Path, expected: &Header) -> Result<(), SweepError> {
    let shards = shards_in(folder)?;
    let failed = |error| JournalError::Unreadable {
        path: folder.to_owned(),
        error,
    };
    if shards.is_empty() && std::fs::read_dir(folder).map_err(failed)?.next().is_some() {
        return Err(SweepError::bad_input(format!(
            "{} is not empty and holds no sweep; name another folder",
            folder.display()
        )));
    }
    for (shard, is_complete) in shards.into_iter().filter(|(shard, _)| *shard != expected.shard) {
        let path = if is_complete {
            shard.path(folder)
        } else {
            shard.partial_path(folder)
        };
        if shard.count != expected.shard.count {
            let reason = format!(
                "it is one of {} shards, and not of {}",
                shard.count, expected.shard.count
            );
            return Err(JournalError::Foreign { path, reason }.into());
        }
        // A shard that another process has just created has no header yet.
        let Ok(reader) = ShardReader::open(&path) else {
            continue;
        };
        let expected = Header {
            shard,
            // Mixed builds are checked by `merge`.
            program: reader.header().program.clone(),
            ..expected.clone()
        };
        expected.check(&path, reader.header())?;
    }
    Ok(())
}

/// Checks header and rows of a complete shard.
///
/// # Errors
/// [`JournalError`] if the header differs or the file is damaged.
fn check_complete(folder: &Path, expected: &Header) -> Result<(), JournalError> {
    let path = expected.shard.path(folder);
    let mut reader = ShardReader::open(&path)?;
    expected.check(&path, reader.header())?;
    while reader.next_row()?.is_some() {}
    Ok(())
}

/// Reads the rows of a complete shard.
#[derive(Debug)]
pub struct ShardReader(JournalReader<Header, Row>);

impl ShardReader {
    /// Opens a shard.
    ///
    /// # Errors
    /// [`JournalError`] if the shard cannot be read.
    pub fn open(path: &Path) -> Result<Self, JournalError> {
        Ok(Self(JournalReader::open(path)?))
    }

    /// Returns the header of the shard.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.0.header
    }

    /// Returns the next row; `None` after the last one, which the footer confirms.
    ///
    /// # Errors
    /// [`JournalError`] if the file is damaged.
    pub fn next_row(&mut self) -> Result<Option<Row>, JournalError> {
        let row = self.0.next_result()?;
        match row
            .as_ref()
            .filter(|row| row.len() != self.header().columns.len())
        {
            Some(row) => Err(self
                .0
                .damaged(&format!("row {} has {} cells", self.0.results(), row.len()))),
            None => Ok(row),
        }
    }
}

/// Returns the shards in a folder, sorted, each with whether it is complete.
///
/// # Errors
/// [`JournalError`] if the folder cannot be read.
pub fn shards_in(folder: &Path) -> Result<Vec<(Shard, bool)>, JournalError> {
    let failed = |error| JournalError::Unreadable {
        path: folder.to_owned(),
        error,
    };
    let mut shards = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        shards.extend(name.to_str().and_then(Shard::from_file_name));
    }
    shards.sort_unstable();
    Ok(shards)
}

#[cfg(test)]
mod tests;
