//! The file of a shard: a header, a line of JSON a row, a footer. A shard that was killed goes on after its last whole row.
//!
//! Rows stand in the order of samples and entries. The footer has the SHA-256 over all before it; a file without one is a
//! shard that is not complete.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, BufWriter, Seek, SeekFrom, Write};
use std::ops::Range;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::definition::hexadecimal;
use crate::prepared::Prepared;
use crate::row::Row;

/// Part of a sweep: number `index` of `count`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Shard {
    /// Its number, from 0.
    pub index: u64,
    /// Number of shards.
    pub count: u64,
}

impl Shard {
    /// All of a sweep.
    pub const WHOLE: Self = Self { index: 0, count: 1 };

    /// Returns its samples of so many.
    #[must_use]
    pub fn samples(self, of: u64) -> Range<u64> {
        let begin = |index: u64| {
            let place = u128::from(of) * u128::from(index) / u128::from(self.count);
            u64::try_from(place).expect("no more than all samples")
        };
        begin(self.index)..begin(self.index + 1)
    }

    /// Returns the path of its complete file in a folder.
    #[must_use]
    pub fn path(self, folder: &Path) -> PathBuf {
        folder.join(format!("shard-{:05}-of-{:05}.rows", self.index, self.count))
    }

    fn partial_path(self, folder: &Path) -> PathBuf {
        self.path(folder).with_extension("rows.partial")
    }

    /// Returns the shard of a file's name, and whether the file is complete.
    #[must_use]
    pub fn of_file_name(name: &str) -> Option<(Self, bool)> {
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

/// First line of a shard's file: all that its rows depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the file's form.
    pub form: u32,
    /// The shard.
    pub shard: Shard,
    /// SHA-256 of sweep and scenario.
    pub sweep: String,
    /// SHA-256 of the program.
    pub program: String,
    /// SHA-256 of each file that flights read, such as a plug-in, by what it is.
    pub files: BTreeMap<String, String>,
    /// Text of the sweep.
    pub sweep_text: String,
    /// File of the scenario.
    pub scenario_path: PathBuf,
    /// Text of the scenario.
    pub scenario_text: String,
    /// Names of the columns.
    pub columns: Vec<String>,
}

/// Form of the files that this program writes.
const FORM: u32 = 2;

impl Header {
    /// Makes the header of a shard.
    #[must_use]
    pub(crate) fn new(shard: Shard, prepared: &Prepared) -> Self {
        let (source, columns) = (&prepared.plan.source, &prepared.layout.columns);
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
        }
    }

    /// Returns why rows under another header cannot stand beside those under this one.
    #[must_use]
    pub fn difference(&self, other: &Self) -> Option<String> {
        let fixed = if self.form != other.form {
            Some("it has the form of another version of gerono")
        } else if self.scenario_text != other.scenario_text {
            Some("it is of another scenario")
        } else if self.sweep != other.sweep {
            Some("it is of another sweep")
        } else if self.shard != other.shard {
            Some("its name is that of another shard than it holds")
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

/// Last line of a complete shard's file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Footer {
    rows: u64,
    sha256: String,
}

/// Reason why a shard cannot be flown or read.
#[derive(Debug, thiserror::Error)]
pub enum ShardError {
    /// The file cannot be read or written.
    #[error("{}: {error}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The reason.
        error: io::Error,
    },
    /// The folder holds something else.
    #[error("{} is not empty and holds no sweep; name another folder", path.display())]
    NoSweep {
        /// The folder.
        path: PathBuf,
    },
    /// Another process has it.
    #[error("{} is being flown by another process; wait for it, or fly another shard", path.display())]
    Locked {
        /// The file.
        path: PathBuf,
    },
    /// It belongs elsewhere.
    #[error("{}: {reason}; move it away, or write to another folder (--out)", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// Its content is not what was written.
    #[error("{}: {reason}; remove it and fly the shard again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
}

/// Writes the rows of a shard.
#[derive(Debug)]
pub struct ShardWriter {
    shard: Shard,
    folder: PathBuf,
    file: BufWriter<File>,
    hash: Sha256,
    /// Rows in the file.
    pub rows: u64,
    flushed: Instant,
}

/// Time after which rows are on the disk.
const FLUSH_PERIOD: Duration = Duration::from_secs(3);

impl ShardWriter {
    /// Opens the file of a shard and goes on after its last whole row.
    ///
    /// # Errors
    /// [`ShardError`] if the file is another's, or cannot be written.
    #[expect(
        clippy::disallowed_methods,
        reason = "rows are appended to a shard of the same header, which is locked and never emptied"
    )]
    pub fn open(folder: &Path, header: &Header) -> Result<Self, ShardError> {
        let path = header.shard.partial_path(folder);
        let failed = |error| ShardError::File {
            path: path.clone(),
            error,
        };
        let mut options = OpenOptions::new();
        let file = options
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path);
        let mut file = file.map_err(failed)?;
        // Between the opening and the lock another process may have completed the shard, which has its final name then.
        let is_locked = file.try_lock().is_ok();
        let number = file.metadata().map_err(failed)?.ino();
        if !is_locked || std::fs::metadata(&path).map_or(true, |found| found.ino() != number) {
            return Err(ShardError::Locked { path });
        }
        let mut hash = Sha256::new();
        let (mut rows, mut whole) = (0, 0);
        let mut reader = BufReader::new(&mut file);
        let mut line = Vec::new();
        while reader.read_until(b'\n', &mut line).map_err(failed)? > 0 && line.ends_with(b"\n") {
            if whole == 0 {
                check_header(&path, &line, header)?;
            } else if serde_json::from_slice::<Row>(&line).is_ok_and(|row| row.len() == header.columns.len())
            {
                rows += 1;
            } else {
                break;
            }
            whole += line.len() as u64;
            hash.update(&line);
            line.clear();
        }
        file.set_len(whole)
            .and_then(|()| file.seek(SeekFrom::End(0)))
            .map_err(failed)?;
        let mut writer = Self {
            shard: header.shard,
            folder: folder.to_owned(),
            file: BufWriter::new(file),
            hash,
            rows,
            flushed: Instant::now(),
        };
        if whole == 0 {
            writer.line(header).map_err(failed)?;
        }
        Ok(writer)
    }

    fn line(&mut self, value: &impl Serialize) -> io::Result<()> {
        let mut line = serde_json::to_vec(value)?;
        line.push(b'\n');
        self.hash.update(&line);
        self.file.write_all(&line)
    }

    /// Appends a row.
    ///
    /// # Errors
    /// [`ShardError`] if it cannot be written.
    pub fn write(&mut self, row: &Row) -> Result<(), ShardError> {
        self.rows += 1;
        let written = self.line(row).and_then(|()| {
            if self.flushed.elapsed() >= FLUSH_PERIOD {
                self.flush()
            } else {
                Ok(())
            }
        });
        written.map_err(|error| self.failed(error))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.flushed = Instant::now();
        self.file.flush()?;
        self.file.get_ref().sync_data()
    }

    fn failed(&self, error: io::Error) -> ShardError {
        ShardError::File {
            path: self.shard.partial_path(&self.folder),
            error,
        }
    }

    /// Keeps all rows so far.
    ///
    /// # Errors
    /// [`ShardError`] if they cannot be written.
    pub fn pause(mut self) -> Result<(), ShardError> {
        self.flush().map_err(|error| self.failed(error))
    }

    /// Completes the shard: the file gets its final name.
    ///
    /// # Errors
    /// [`ShardError`] if it cannot be written.
    pub fn complete(mut self) -> Result<PathBuf, ShardError> {
        let footer = Footer {
            rows: self.rows,
            sha256: hexadecimal(&self.hash.clone().finalize()),
        };
        let (from, to) = (
            self.shard.partial_path(&self.folder),
            self.shard.path(&self.folder),
        );
        let completed = self
            .line(&footer)
            .and_then(|()| self.flush())
            .and_then(|()| std::fs::rename(from, &to));
        completed.map_err(|error| self.failed(error))?;
        Ok(to)
    }
}

fn check_header(path: &Path, line: &[u8], expected: &Header) -> Result<(), ShardError> {
    let header: Header = serde_json::from_slice(line).map_err(|error| ShardError::Damaged {
        path: path.to_owned(),
        reason: format!("its header cannot be read: {error}"),
    })?;
    match expected.difference(&header) {
        None => Ok(()),
        Some(reason) => Err(ShardError::Foreign {
            path: path.to_owned(),
            reason,
        }),
    }
}

/// Returns whether a shard is complete in a folder already.
///
/// # Errors
/// [`ShardError`] if it is damaged, or if the folder holds something else.
pub fn is_complete(folder: &Path, expected: &Header) -> Result<bool, ShardError> {
    check_folder(folder, expected)?;
    let is_there = expected.shard.path(folder).exists();
    if is_there {
        check_complete(folder, expected)?;
    }
    Ok(is_there)
}

/// Refuses a folder that holds something else than this sweep, or its shards in another number.
///
/// # Errors
/// [`ShardError`] with the difference.
fn check_folder(folder: &Path, expected: &Header) -> Result<(), ShardError> {
    let shards = shards_in(folder)?;
    let failed = |error| ShardError::File {
        path: folder.to_owned(),
        error,
    };
    if shards.is_empty() && std::fs::read_dir(folder).map_err(failed)?.next().is_some() {
        return Err(ShardError::NoSweep {
            path: folder.to_owned(),
        });
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
            return Err(ShardError::Foreign { path, reason });
        }
        // One that another process has only begun has no header yet.
        let Ok(reader) = ShardReader::open(&path) else {
            continue;
        };
        let expected = Header {
            shard,
            // `merge` is asked whether builds may be taken together.
            program: reader.header.program.clone(),
            ..expected.clone()
        };
        if let Some(reason) = expected.difference(&reader.header) {
            return Err(ShardError::Foreign { path, reason });
        }
    }
    Ok(())
}

/// Checks a complete shard against what would be flown: its header and its rows.
///
/// # Errors
/// [`ShardError`] if it is of something else, or is not what was written.
fn check_complete(folder: &Path, expected: &Header) -> Result<(), ShardError> {
    let path = expected.shard.path(folder);
    let mut reader = ShardReader::open(&path)?;
    if let Some(reason) = expected.difference(&reader.header) {
        return Err(ShardError::Foreign { path, reason });
    }
    while reader.next_row()?.is_some() {}
    Ok(())
}

/// Reads the rows of a complete shard.
#[derive(Debug)]
pub struct ShardReader {
    path: PathBuf,
    reader: BufReader<File>,
    hash: Sha256,
    line: Vec<u8>,
    rows: u64,
    /// Its header.
    pub header: Header,
}

impl ShardReader {
    /// Opens a shard.
    ///
    /// # Errors
    /// [`ShardError`] if it cannot be read.
    pub fn open(path: &Path) -> Result<Self, ShardError> {
        let failed = |error| ShardError::File {
            path: path.to_owned(),
            error,
        };
        let file = File::open(path).map_err(failed)?;
        if !file.metadata().map_err(failed)?.is_file() {
            return Err(failed(io::Error::other("this is no file of rows")));
        }
        let mut reader = BufReader::new(file);
        let mut line = Vec::new();
        reader.read_until(b'\n', &mut line).map_err(failed)?;
        let header = serde_json::from_slice(&line).map_err(|error| ShardError::Damaged {
            path: path.to_owned(),
            reason: format!("its header cannot be read: {error}"),
        })?;
        let mut hash = Sha256::new();
        hash.update(&line);
        Ok(Self {
            path: path.to_owned(),
            reader,
            hash,
            line,
            rows: 0,
            header,
        })
    }

    /// Returns the next row as it was written; none after the last, which the footer confirms.
    ///
    /// # Errors
    /// [`ShardError`] if the file is not what was written.
    pub fn next_row(&mut self) -> Result<Option<Row>, ShardError> {
        self.line.clear();
        let read = self.reader.read_until(b'\n', &mut self.line);
        if read.map_err(|error| self.file_error(error))? == 0 {
            return Err(self.damaged("it ends before its footer"));
        }
        if self.line.starts_with(b"{") {
            let footer: Footer = serde_json::from_slice(&self.line)
                .map_err(|error| self.damaged(&format!("its footer: {error}")))?;
            let sha256 = hexadecimal(&self.hash.clone().finalize());
            let is_whole = footer
                == (Footer {
                    rows: self.rows,
                    sha256,
                });
            if !is_whole {
                return Err(self.damaged("its rows are not those that were written"));
            }
            let ends = self.reader.fill_buf().map(<[u8]>::is_empty);
            return match ends.map_err(|error| self.file_error(error))? {
                true => Ok(None),
                false => Err(self.damaged("something stands behind its footer")),
            };
        }
        self.hash.update(&self.line);
        self.rows += 1;
        let row: Row = serde_json::from_slice(&self.line)
            .map_err(|error| self.damaged(&format!("row {}: {error}", self.rows)))?;
        if row.len() == self.header.columns.len() {
            Ok(Some(row))
        } else {
            Err(self.damaged(&format!("row {} has {} cells", self.rows, row.len())))
        }
    }

    fn file_error(&self, error: io::Error) -> ShardError {
        ShardError::File {
            path: self.path.clone(),
            error,
        }
    }

    fn damaged(&self, reason: &str) -> ShardError {
        ShardError::Damaged {
            path: self.path.clone(),
            reason: reason.to_owned(),
        }
    }
}

/// Returns the shards in a folder, and whether each is complete, in their order.
///
/// # Errors
/// [`ShardError`] if the folder cannot be read.
pub fn shards_in(folder: &Path) -> Result<Vec<(Shard, bool)>, ShardError> {
    let failed = |error| ShardError::File {
        path: folder.to_owned(),
        error,
    };
    let mut shards = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        shards.extend(name.to_str().and_then(Shard::of_file_name));
    }
    shards.sort_unstable();
    Ok(shards)
}

#[cfg(test)]
mod tests;
