//! The files of a log that was split: `run.mcap`, `run.1.mcap`, `run.2.mcap` and so on.
//!
//! Each is a complete log of its part of the flight. Metadata before the manifest state its number, and metadata after the
//! last sample state that the log continues in another file. So a missing file is detected.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use mcap::records::{Metadata, Record};

use super::reader::{LogReadError, LogReader};
use super::records::{self, RawRecord, Records};
use super::recovery::{Origin, origin};

const NUMBER_KEY: &str = "number";
const SAMPLES_KEY: &str = "samples_before";

/// Name of the metadata record after the last sample of a file with a successor.
pub(super) const CONTINUES: &str = "gerono_goes_on";

/// Prefix of the channels of a machine's record.
const HOST_CHANNELS: &str = "host/";

/// Position of a file in a split log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Part {
    /// 0 for the first file.
    pub(super) number: u64,
    /// Samples of the log in the previous files.
    pub(super) samples_before: u64,
}

impl Part {
    /// Name of the metadata record.
    pub(super) const RECORD_NAME: &str = "gerono_part";

    pub(super) fn to_metadata(self) -> BTreeMap<String, String> {
        BTreeMap::from([
            (NUMBER_KEY.to_owned(), self.number.to_string()),
            (SAMPLES_KEY.to_owned(), self.samples_before.to_string()),
        ])
    }

    /// Converts from metadata.
    pub(super) fn from_metadata(metadata: &BTreeMap<String, String>) -> Option<Self> {
        let number = |key: &str| metadata.get(key)?.parse().ok();
        Some(Self {
            number: number(NUMBER_KEY)?,
            samples_before: number(SAMPLES_KEY)?,
        })
    }
}

/// Returns the metadata which state that the log continues in the file of a number.
pub(super) fn goes_on_in(number: u64) -> BTreeMap<String, String> {
    BTreeMap::from([(NUMBER_KEY.to_owned(), number.to_string())])
}

/// Returns the path of a file of the log whose first file is `first`.
pub(super) fn part_path(first: &Path, number: u64) -> PathBuf {
    if number == 0 {
        return first.to_owned();
    }
    first.with_extension(format!("{number}.mcap"))
}

/// Returns the path of the file of a number beside another file of the same log.
pub(super) fn part_beside(log: &Path, number: u64) -> PathBuf {
    let common = Name::of(log).map_or_else(String::new, |name| name.common);
    part_path(&log.with_file_name(format!("{common}.mcap")), number)
}

/// State of a file, in the order of preference among files of the same part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Make {
    Recovered,
    Complete,
    Partial,
}

/// Name of a file of a log: the common part, and the number.
#[derive(Debug, PartialEq, Eq)]
struct Name {
    common: String,
    number: u64,
    make: Make,
}

impl Name {
    fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?;
        let (stem, make) = match name.strip_suffix(".mcap.partial") {
            Some(stem) => (stem, Make::Partial),
            None => match name.strip_suffix(".recovered.mcap") {
                Some(stem) => (stem, Make::Recovered),
                None => (name.strip_suffix(".mcap")?, Make::Complete),
            },
        };
        let numbered = stem.rsplit_once('.').and_then(|(common, digits)| {
            let number: u64 = digits.parse().ok()?;
            // As it is written, and not `01` or `+1`.
            (number > 0 && number.to_string() == digits).then_some((common, number))
        });
        let (common, number) = numbered.unwrap_or((stem, 0));
        Some(Self {
            common: common.to_owned(),
            number,
            make,
        })
    }
}

/// Returns the number of a file in its log, by its name; 0 for the first one.
#[must_use]
pub fn number_of(log: &Path) -> Option<u64> {
    Name::of(log).map(|name| name.number)
}

/// A file of a log, and its number.
pub(super) type Numbered = (u64, PathBuf);

/// Returns the files after `log` in the same log, in order: of each number first the recovered, then the complete, then the
/// partial one.
pub(super) fn files_after(log: &Path) -> Vec<Numbered> {
    Name::of(log).map_or_else(Vec::new, |own| files_of(log, |name| name.number > own.number))
}

/// Returns the wanted files of the log that contains `log`.
fn files_of(log: &Path, is_wanted: impl Fn(&Name) -> bool) -> Vec<Numbered> {
    let Some(own) = Name::of(log) else {
        return Vec::new();
    };
    let folder = log.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let mut found: BTreeMap<u64, (Make, PathBuf)> = BTreeMap::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let Some(name) = Name::of(Path::new(&entry.file_name())) else {
            continue;
        };
        if name.common != own.common || !is_wanted(&name) {
            continue;
        }
        let path = log.with_file_name(entry.file_name());
        let is_better = found.get(&name.number).is_none_or(|(make, _)| name.make < *make);
        if is_better {
            found.insert(name.number, (name.make, path));
        }
    }
    let numbered = found.into_iter().map(|(number, (_, path))| (number, path));
    numbered.collect()
}

/// Returns the files that are read as one log if `log` is opened: the file and its successors.
#[must_use]
pub fn files_of_log(log: &Path) -> Vec<PathBuf> {
    let mut files = vec![log.to_owned()];
    if part_of(log).is_some() {
        files.extend(files_after(log).into_iter().map(|(_, path)| path));
    }
    files
}

/// Returns the files that a run has written for the log with the first file `first`, complete or not, in order, without
/// recovered ones.
#[must_use]
pub fn written_files(first: &Path) -> Vec<PathBuf> {
    let files = files_of(first, |name| name.make != Make::Recovered);
    files.into_iter().map(|(_, path)| path).collect()
}

/// Returns whether any file of the log was recovered.
pub(super) fn has_recovered(log: &Path) -> bool {
    !files_of(log, |name| name.make == Make::Recovered).is_empty()
}

/// Returns the position of a file in its log; `None` if the log was not split or the file does not state it.
fn part_of(path: &Path) -> Option<Part> {
    let file = File::open(path).ok()?;
    let bytes = file.metadata().ok()?.len();
    let mut records = Records::new(BufReader::new(file), bytes);
    let mut record = RawRecord::default();
    while records.next(&mut record).ok()? {
        match records::parse(record.opcode, &record.body).ok()? {
            Record::Header(_) => {}
            Record::Metadata(Metadata { name, metadata }) if name == Part::RECORD_NAME => {
                return Part::from_metadata(&metadata);
            }
            Record::Metadata(_) => {}
            _ => return None,
        }
    }
    None
}

/// The end of a file of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The file has no end record, or is damaged.
    Broken,
    /// The file is complete, and the last one of its log.
    Last,
    /// The file is complete, and the log continues in the file with this number.
    GoesOn(u64),
}

/// Verifies all checksums of a file, and returns its end. A log of a flight is read by [`LogReader`], so
/// that all commands agree on completeness, and the record of a machine by its checksums.
///
/// # Errors
/// [`LogReadError`] if the file cannot be read, or is neither.
pub fn ending(path: &Path) -> Result<Ending, LogReadError> {
    let mut reader = match LogReader::open_alone(path) {
        Ok(reader) => reader,
        Err(LogReadError::Unclosed { .. } | LogReadError::Damaged { .. }) => return Ok(Ending::Broken),
        Err(error @ LogReadError::Foreign { .. }) => match origin(path) {
            Ok(Origin::Machine) => return Ok(ending_of_host_log(path)),
            _ => return Err(error),
        },
        Err(error) => return Err(error),
    };
    loop {
        match reader.next_sample() {
            Ok(Some(_)) => {}
            Ok(None) => return Ok(Ending::Last),
            Err(LogReadError::MissingPart { missing, .. }) => {
                return Ok(number_of(&missing).map_or(Ending::Broken, Ending::GoesOn));
            }
            Err(error @ (LogReadError::Io { .. } | LogReadError::Foreign { .. })) => return Err(error),
            Err(_) => return Ok(Ending::Broken),
        }
    }
}

/// Returns the end of a record of a machine, which must have only the channels of one.
fn ending_of_host_log(path: &Path) -> Ending {
    let opened = File::open(path).and_then(|file| Ok((file.metadata()?.len(), file)));
    let Ok((bytes, file)) = opened else {
        return Ending::Broken;
    };
    let mut records = Records::new(BufReader::with_capacity(1 << 16, file), bytes);
    let mut record = RawRecord::default();
    loop {
        match records.next(&mut record) {
            Ok(true) => match records::parse(record.opcode, &record.body) {
                Ok(Record::Channel(channel)) if !channel.topic.starts_with(HOST_CHANNELS) => {
                    return Ending::Broken;
                }
                _ => {}
            },
            Ok(false) => return Ending::Last,
            Err(_) => return Ending::Broken,
        }
    }
}

/// Returns the number of the file in which the log continues, if a metadata record states it.
pub(super) fn next_number(record: &RawRecord) -> Option<u64> {
    match records::parse(record.opcode, &record.body) {
        Ok(Record::Metadata(metadata)) if metadata.name == CONTINUES => {
            metadata.metadata.get(NUMBER_KEY)?.parse().ok()
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests;
