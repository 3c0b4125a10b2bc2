//! Results of a campaign on disk as they come: a header, a line of JSON a result, a footer. A killed campaign resumes after
//! the last whole line.
//!
//! Results stand in the order of the flights. The footer has the SHA-256 of all before it. The file has another extension
//! until it is complete, and is locked by the process that writes it.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, BufRead, BufReader, BufWriter, Seek, SeekFrom, Write};
use std::marker::PhantomData;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use run_log::partial_path;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use shared_types::sample::hex;

use crate::many;

/// Header of a journal: everything that its results depend on.
pub trait Header: Serialize + DeserializeOwned {
    /// Returns why results under another header cannot stand beside those under this one.
    fn difference(&self, other: &Self) -> Option<String>;

    /// Checks that the results of the file at `path`, whose header is `found`, can stand beside those under this one.
    ///
    /// # Errors
    /// [`JournalError::Foreign`] with the difference.
    fn check(&self, path: &Path, found: &Self) -> Result<(), JournalError> {
        self.difference(found).map_or(Ok(()), |reason| {
            Err(JournalError::Foreign {
                path: path.to_owned(),
                reason,
            })
        })
    }
}

/// Last line of a complete journal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Footer {
    rows: u64,
    sha256: String,
}

/// Reason why a journal cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// The file cannot be read or written.
    #[error("{}: {error}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The reason.
        error: io::Error,
    },
    /// Another process writes it.
    #[error("{} is being flown by another process; wait for it, or fly into another folder", path.display())]
    Locked {
        /// The file.
        path: PathBuf,
    },
    /// Its results are of something else.
    #[error("{}: {reason}; move it away, or write to another folder (--out)", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// The program that flies cannot be read, whose hash results depend on.
    #[error("cannot read this program: {0}")]
    Program(#[source] io::Error),
    /// Its content is not what was written.
    #[error("{}: {reason}; remove it and fly again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
}

/// Writes the results of a campaign.
#[derive(Debug)]
pub struct Journal {
    complete: PathBuf,
    partial: PathBuf,
    file: BufWriter<File>,
    hash: Sha256,
    /// Number of results in the file.
    pub results: u64,
    flushed: Instant,
}

/// Time after which results are on the disk.
const FLUSH_PERIOD: Duration = Duration::from_secs(3);

impl Journal {
    /// Opens the journal that is to be complete at a path, and continues after its last whole result. Passes each result
    /// that it holds to `keep`, which refuses one that is torn or malformed: that one and all after it are missing.
    ///
    /// # Errors
    /// [`JournalError`] if the file holds something else, is in use, or cannot be written.
    #[expect(
        clippy::disallowed_methods,
        reason = "results are appended to a journal of the same header, which is locked and never emptied"
    )]
    pub fn open<H: Header, R: DeserializeOwned>(
        complete: &Path,
        header: &H,
        mut keep: impl FnMut(R) -> bool,
    ) -> Result<Self, JournalError> {
        let partial = partial_path(complete);
        let failed = |error| JournalError::File {
            path: partial.clone(),
            error,
        };
        let mut options = OpenOptions::new();
        let options = options.read(true).write(true).create(true).truncate(false);
        let mut file = options.open(&partial).map_err(failed)?;
        // Between the opening and the lock another process may have completed the journal, which has its final name then.
        match file.try_lock() {
            Ok(()) if is_at(&file, &partial).map_err(failed)? => {}
            Err(TryLockError::Error(error)) => return Err(failed(error)),
            _ => return Err(JournalError::Locked { path: partial }),
        }
        let mut hash = Sha256::new();
        let (mut results, mut whole) = (0, 0);
        let mut reader = BufReader::new(&mut file);
        let mut line = Vec::new();
        while reader.read_until(b'\n', &mut line).map_err(failed)? > 0 && line.ends_with(b"\n") {
            if whole == 0 {
                header.check(&partial, &read_header(&partial, &line)?)?;
            } else if serde_json::from_slice(&line).is_ok_and(&mut keep) {
                results += 1;
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
        let mut journal = Self {
            complete: complete.to_owned(),
            file: BufWriter::new(file),
            hash,
            results,
            flushed: Instant::now(),
            partial,
        };
        if whole == 0 {
            journal.line(header).map_err(|error| journal.failed(error))?;
        }
        Ok(journal)
    }

    fn line(&mut self, value: &impl Serialize) -> io::Result<()> {
        let mut line = serde_json::to_vec(value)?;
        line.push(b'\n');
        self.hash.update(&line);
        self.file.write_all(&line)
    }

    /// Flies the flights behind the results that are there, up to `flights`, on some threads, and appends their results.
    /// `fly` returns the result of the flight of a number, and what is not written of it; or nothing if it was interrupted,
    /// which ends the journal before its completion. Calls `taken` with each in the order of the flights, and the number of
    /// results. Returns the number of all results.
    ///
    /// # Errors
    /// That of a flight, or [`JournalError`] if a result cannot be written; the results before it are kept.
    pub fn fill<R, T, E>(
        mut self,
        flights: u64,
        threads: usize,
        fly: impl Fn(u64) -> Option<Result<(R, T), E>> + Sync,
        mut taken: impl FnMut(u64, R, T),
    ) -> Result<u64, E>
    where
        R: Serialize + Send,
        T: Send,
        E: From<JournalError> + Send,
    {
        let filled = many::for_each(self.results..flights, threads, fly, |flown| {
            let (result, rest) = flown?;
            self.write(&result)?;
            taken(self.results, result, rest);
            Ok(())
        });
        if let Err(error) = filled {
            // The error of the flight is the one to report.
            let _ = self.pause();
            return Err(error);
        }
        let results = self.results;
        if results == flights {
            self.complete()?;
        } else {
            self.pause()?;
        }
        Ok(results)
    }

    /// Appends a result.
    ///
    /// # Errors
    /// [`JournalError`] if it cannot be written.
    pub fn write(&mut self, result: &impl Serialize) -> Result<(), JournalError> {
        self.results += 1;
        let written = self.line(result).and_then(|()| {
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

    fn failed(&self, error: io::Error) -> JournalError {
        JournalError::File {
            path: self.partial.clone(),
            error,
        }
    }

    /// Keeps all results so far.
    ///
    /// # Errors
    /// [`JournalError`] if they cannot be written.
    pub fn pause(mut self) -> Result<(), JournalError> {
        self.flush().map_err(|error| self.failed(error))
    }

    /// Completes the journal: the file gets its final name, which is returned.
    ///
    /// # Errors
    /// [`JournalError`] if it cannot be written.
    pub fn complete(mut self) -> Result<PathBuf, JournalError> {
        let footer = Footer {
            rows: self.results,
            sha256: hex(&self.hash.clone().finalize()),
        };
        let completed = self
            .line(&footer)
            .and_then(|()| self.flush())
            .and_then(|()| std::fs::rename(&self.partial, &self.complete));
        completed.map_err(|error| self.failed(error))?;
        Ok(self.complete)
    }
}

/// Returns whether a file is the one at a path.
fn is_at(file: &File, path: &Path) -> io::Result<bool> {
    let number = file.metadata()?.ino();
    Ok(std::fs::metadata(path).is_ok_and(|found| found.ino() == number))
}

fn read_header<H: Header>(path: &Path, line: &[u8]) -> Result<H, JournalError> {
    serde_json::from_slice(line).map_err(|error| JournalError::Damaged {
        path: path.to_owned(),
        reason: format!("its header cannot be read: {error}"),
    })
}

/// Reads the results of a journal.
#[derive(Debug)]
pub struct JournalReader<H, R> {
    path: PathBuf,
    reader: BufReader<File>,
    hash: Sha256,
    line: Vec<u8>,
    results: u64,
    result: PhantomData<R>,
    /// Its header.
    pub header: H,
}

impl<H: Header, R: DeserializeOwned> JournalReader<H, R> {
    /// Opens a journal.
    ///
    /// # Errors
    /// [`JournalError`] if it cannot be read.
    pub fn open(path: &Path) -> Result<Self, JournalError> {
        let failed = |error| JournalError::File {
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
        let header = read_header(path, &line)?;
        let mut hash = Sha256::new();
        hash.update(&line);
        Ok(Self {
            path: path.to_owned(),
            reader,
            hash,
            line,
            results: 0,
            result: PhantomData,
            header,
        })
    }

    /// Returns the next result as it was written; none after the last, which the footer confirms.
    ///
    /// # Errors
    /// [`JournalError`] if the file is not what was written.
    pub fn next_result(&mut self) -> Result<Option<R>, JournalError> {
        self.line.clear();
        let read = self.reader.read_until(b'\n', &mut self.line);
        if read.map_err(|error| self.file_error(error))? == 0 {
            return Err(self.damaged("it ends before its footer"));
        }
        // A sequence would be read as a structure, too.
        let is_object = self.line.starts_with(b"{");
        if let Some(footer) = is_object
            .then(|| serde_json::from_slice::<Footer>(&self.line).ok())
            .flatten()
        {
            let sha256 = hex(&self.hash.clone().finalize());
            let rows = self.results;
            if footer != (Footer { rows, sha256 }) {
                return Err(self.damaged("its rows are not those that were written"));
            }
            let ends = self.reader.fill_buf().map(<[u8]>::is_empty);
            return match ends.map_err(|error| self.file_error(error))? {
                true => Ok(None),
                false => Err(self.damaged("something stands behind its footer")),
            };
        }
        self.hash.update(&self.line);
        self.results += 1;
        let result = serde_json::from_slice(&self.line);
        result
            .map(Some)
            .map_err(|error| self.damaged(&format!("row {}: {error}", self.results)))
    }

    /// Returns the number of results that were read.
    #[must_use]
    pub fn results(&self) -> u64 {
        self.results
    }

    /// Returns the error of a journal whose last result is not one of its header's.
    #[must_use]
    pub fn damaged(&self, reason: &str) -> JournalError {
        JournalError::Damaged {
            path: self.path.clone(),
            reason: reason.to_owned(),
        }
    }

    fn file_error(&self, error: io::Error) -> JournalError {
        JournalError::File {
            path: self.path.clone(),
            error,
        }
    }
}
