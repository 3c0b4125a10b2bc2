//! Results of a campaign on disk as they come: a header, a line of JSON a result, a footer. A killed campaign resumes after
//! the last whole line.
//!
//! Results stand in the order of the flights, each behind a checksum of itself and of all before it: one that was altered,
//! moved or removed is found, and it and all after it are repeated. The footer has the SHA-256 of all before it. The file
//! has another extension until it is complete, and is locked by the process that writes it.

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
    /// Returns the number of results of a complete journal.
    fn flights(&self) -> u64;

    /// Returns why results under another header cannot stand beside those under this one.
    fn difference(&self, other: &Self) -> Option<String>;

    /// Checks that the results of the file at `path`, whose header is `found`, can stand beside those under this one.
    ///
    /// # Errors
    /// [`JournalError::Foreign`] with the difference.
    fn check(&self, path: &Path, found: &Self) -> Result<(), JournalError> {
        self.difference(found)
            .map_or(Ok(()), |reason| Err(foreign(path, &reason)))
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
    /// The file cannot be read.
    #[error("cannot read {}: {error}; check the path and your permissions", path.display())]
    Unreadable {
        /// The file or its folder.
        path: PathBuf,
        /// The reason.
        error: io::Error,
    },
    /// The file cannot be written.
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
    #[error("{}: {reason}; move it away and fly again", path.display())]
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
    flights: u64,
    /// Number of results in the file.
    pub results: u64,
    flushed: Instant,
}

/// Length of a result's checksum, which has two letters for each byte.
const CHECKSUM_BYTES: usize = 8;

/// Time after which results are on the disk.
const FLUSH_PERIOD: Duration = Duration::from_secs(3);

impl Journal {
    /// Opens the journal that is to be complete at a path, and continues after its last whole result. Passes each result
    /// that it holds to `keep`, which refuses one that is torn or malformed: that one and all after it are missing. A file
    /// that does not begin with the header, and is not torn within it, stays as it is.
    ///
    /// # Errors
    /// [`JournalError`] if the file holds something else or more results than flights, is in use, or cannot be written.
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
        let mut file = open_file(&partial, options, false)?;
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
            } else if result_in(&hash, &line)
                .is_some_and(|result| serde_json::from_slice(result).is_ok_and(&mut keep))
            {
                results += 1;
            } else {
                break;
            }
            whole += line.len() as u64;
            hash.update(&line);
            line.clear();
        }
        let flights = header.flights();
        if whole == 0 && !json_line(header).map_err(failed)?.starts_with(&line) {
            return Err(foreign(&partial, "it holds no results"));
        }
        if results > flights {
            return Err(damaged(
                &partial,
                &format!("it has {results} results of {flights} flights"),
            ));
        }
        file.set_len(whole)
            .and_then(|()| file.seek(SeekFrom::End(0)))
            .map_err(failed)?;
        let mut journal = Self {
            complete: complete.to_owned(),
            file: BufWriter::new(file),
            hash,
            flights,
            results,
            flushed: Instant::now(),
            partial,
        };
        if whole == 0 {
            let header = json_line(header);
            let written = header.and_then(|header| journal.append(&header));
            written.map_err(|error| journal.failed(error))?;
        }
        Ok(journal)
    }

    fn append(&mut self, line: &[u8]) -> io::Result<()> {
        self.hash.update(line);
        self.file.write_all(line)
    }

    /// Flies the flights behind the results that are there on some threads, and appends their results.
    /// `fly` returns the result of the flight of a number, and what is not written of it; or nothing if it was interrupted,
    /// which ends the journal before its completion. Calls `taken` with each in the order of the flights, and the number of
    /// results. Returns the number of all results.
    ///
    /// # Errors
    /// That of a flight, or [`JournalError`] if a result cannot be written; the results before it are kept.
    pub fn fill<R, T, E>(
        mut self,
        threads: usize,
        fly: impl Fn(u64) -> Option<Result<(R, T), E>> + Sync,
        mut taken: impl FnMut(u64, R, T),
    ) -> Result<u64, E>
    where
        R: Serialize + Send,
        T: Send,
        E: From<JournalError> + Send,
    {
        let filled = many::for_each(self.results..self.flights, threads, fly, |flown| {
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
        if results == self.flights {
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
        let written = serde_json::to_vec(result).map_err(Into::into).and_then(|result| {
            self.append(&line_of(&self.hash, &result))?;
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
        let completed = json_line(&footer)
            .and_then(|footer| self.append(&footer))
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

fn open_file(path: &Path, options: &mut OpenOptions, follows: bool) -> Result<File, JournalError> {
    result_file::open_regular(path, options, follows).map_err(|error| match error.kind() {
        io::ErrorKind::InvalidInput => foreign(path, &error.to_string()),
        _ => JournalError::File {
            path: path.to_owned(),
            error,
        },
    })
}

fn foreign(path: &Path, reason: &str) -> JournalError {
    JournalError::Foreign {
        path: path.to_owned(),
        reason: reason.to_owned(),
    }
}

fn damaged(path: &Path, reason: &str) -> JournalError {
    JournalError::Damaged {
        path: path.to_owned(),
        reason: reason.to_owned(),
    }
}

fn json_line(value: &impl Serialize) -> io::Result<Vec<u8>> {
    let mut line = serde_json::to_vec(value)?;
    line.push(b'\n');
    Ok(line)
}

/// Returns the line of a result behind lines with this hash: a JSON array of a checksum and the result.
fn line_of(before: &Sha256, result: &[u8]) -> Vec<u8> {
    let checksum = before.clone().chain_update(result).finalize();
    let checksum = hex(&checksum[..CHECKSUM_BYTES]);
    [b"[\"", checksum.as_bytes(), b"\",", result, b"]\n"].concat()
}

/// Returns the result in a line behind lines with this hash; `None` if the line is not the one that was written there.
fn result_in<'a>(before: &Sha256, line: &'a [u8]) -> Option<&'a [u8]> {
    let result = line.get(2 * CHECKSUM_BYTES + 4..)?.strip_suffix(b"]\n")?;
    (line_of(before, result) == line).then_some(result)
}

fn read_header<H: Header>(path: &Path, line: &[u8]) -> Result<H, JournalError> {
    serde_json::from_slice(line)
        .map_err(|error| damaged(path, &format!("its header cannot be read: {error}")))
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
        let failed = |error| JournalError::Unreadable {
            path: path.to_owned(),
            error,
        };
        let file = open_file(path, OpenOptions::new().read(true), true)?;
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
            let (rows, flights) = (self.results, self.header.flights());
            if footer != (Footer { rows, sha256 }) {
                return Err(self.damaged("its rows are not those that were written"));
            }
            if rows != flights {
                return Err(self.damaged(&format!("it has {rows} results of {flights} flights")));
            }
            let ends = self.reader.fill_buf().map(<[u8]>::is_empty);
            return match ends.map_err(|error| self.file_error(error))? {
                true => Ok(None),
                false => Err(self.damaged("something stands behind its footer")),
            };
        }
        self.results += 1;
        let Some(result) = result_in(&self.hash, &self.line) else {
            return Err(self.damaged(&format!("row {} is not the one that was written", self.results)));
        };
        self.hash.update(&self.line);
        serde_json::from_slice(result)
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
        damaged(&self.path, reason)
    }

    fn file_error(&self, error: io::Error) -> JournalError {
        JournalError::Unreadable {
            path: self.path.clone(),
            error,
        }
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use std::fs;
    use std::os::unix::fs::symlink;

    use rustix::fs::{CWD, FileType, Mode, mknodat};

    use super::*;

    #[derive(Serialize, Deserialize)]
    struct Rows {
        rows: u64,
    }

    impl Header for Rows {
        fn flights(&self) -> u64 {
            self.rows
        }

        fn difference(&self, other: &Self) -> Option<String> {
            (self.rows != other.rows).then(|| "it has other rows".to_owned())
        }
    }

    fn open(path: &Path, rows: u64) -> Result<Journal, JournalError> {
        Journal::open(path, &Rows { rows }, |_: u64| true)
    }

    /// Completes a journal, whose results are their own numbers.
    fn complete(path: &Path, rows: u64) -> Result<u64, JournalError> {
        open(path, rows)?.fill(2, |row| Some(Ok((row, ()))), |_, _, ()| ())
    }

    #[test]
    fn a_file_that_is_no_journal_of_these_flights_stays_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let [victim, path] = ["victim", "flights.rows"].map(|name| folder.path().join(name));
        let partial = partial_path(&path);
        let refused = |what: &str| {
            let refused = open(&path, 3).unwrap_err().to_string();
            assert!(refused.contains("move it away"), "{what}: {refused}");
            fs::remove_file(&partial).unwrap();
        };
        for text in ["notes", "notes\n", "{\"rows\":", "{\"rows\":4", "{\"rows\":4}\n"] {
            fs::write(&victim, text).unwrap();
            let is_torn = "{\"rows\":3}\n".starts_with(text);
            if !is_torn {
                fs::hard_link(&victim, &partial).unwrap();
                refused(text);
            }
            symlink("victim", &partial).unwrap();
            refused(text);
            assert_eq!(fs::read_to_string(&victim).unwrap(), text);
        }
        symlink("nowhere", &partial).unwrap();
        refused("a link to nothing");
        assert!(!folder.path().join("nowhere").exists());
        mknodat(CWD, &partial, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        refused("a FIFO");
        mknodat(CWD, &path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        assert!(JournalReader::<Rows, u64>::open(&path).is_err());
        fs::remove_file(&path).unwrap();

        // Killed within its header.
        for torn in ["", "{\"row", "{\"rows\":3}"] {
            fs::write(&partial, torn).unwrap();
            assert_eq!(complete(&path, 3).unwrap(), 3);
        }
    }

    #[test]
    fn results_that_were_not_written_in_their_place_are_flown_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flights.rows");
        let partial = partial_path(&path);
        complete(&path, 4).unwrap();
        let whole = fs::read_to_string(&path).unwrap();
        let lines: Vec<_> = whole.split_inclusive('\n').collect();
        let altered = lines[2].replace(",1]", ",7]");
        let [header, zero, one, two, three, footer] = lines[..] else {
            panic!("{whole}")
        };
        for (kept, partly) in [
            (0, vec![header, one, zero, two, three]),
            (1, vec![header, zero, &altered, two]),
            (1, vec![header, zero, two, three]),
            (2, vec![header, zero, one, one, two]),
            (1, vec![header, zero, "1\n"]),
            (4, vec![header, zero, one, two, three, three]),
            (4, vec![header, zero, one, two, three, footer]),
        ] {
            fs::write(&partial, partly.concat()).unwrap();
            assert_eq!(open(&path, 4).unwrap().results, kept, "{partly:?}");
            complete(&path, 4).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), whole, "{partly:?}");
        }
        fs::write(&path, [header, one, zero, two, three, footer].concat()).unwrap();
        let mut reader = JournalReader::<Rows, u64>::open(&path).unwrap();
        assert!(matches!(reader.next_result(), Err(JournalError::Damaged { .. })));
    }

    #[test]
    fn a_journal_with_another_number_of_results_than_flights_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flights.rows");
        for written in [2, 4] {
            let mut journal = open(&path, 3).unwrap();
            for row in 0..written {
                journal.write(&row).unwrap();
            }
            journal.complete().unwrap();
            let mut reader = JournalReader::<Rows, u64>::open(&path).unwrap();
            let end = (0..=written).find_map(|_| reader.next_result().err());
            assert!(matches!(end, Some(JournalError::Damaged { .. })), "{end:?}");
        }
        let bytes = fs::read(&path).unwrap();
        fs::rename(&path, partial_path(&path)).unwrap();
        let refused = open(&path, 3).unwrap_err().to_string();
        assert!(refused.contains("it has 4 results of 3 flights"), "{refused}");
        assert_eq!(fs::read(partial_path(&path)).unwrap(), bytes);
    }
}
