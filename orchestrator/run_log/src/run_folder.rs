//! Folder of a run's results, which never overwrites those of an earlier run.

use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use crate::{partial_path, recovered_path, written_files};

/// Error of the folder for the results.
#[derive(Debug, thiserror::Error)]
pub enum RunFolderError {
    /// The named folder is not empty.
    #[error("{} is not empty; name another folder with `--out`, or leave it out for a new one in `runs/`", .0.display())]
    NotEmpty(PathBuf),
    /// The folder cannot be made or read.
    #[error("cannot make the folder {} for the results: {source}; name a writable one with `--out`", .path.display())]
    Io {
        /// The folder.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
}

/// The folder of a run's results.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFolder(PathBuf);

impl RunFolder {
    /// Creates the requested folder, which must be empty if it exists, or the next free `runs/<name>-<n>`.
    ///
    /// # Errors
    /// [`RunFolderError`].
    pub fn create(asked: Option<&Path>, name: &str) -> Result<Self, RunFolderError> {
        match asked {
            Some(path) => Self::create_named(path),
            None => Self::create_numbered(Path::new("runs"), name),
        }
    }

    /// As [`create`](Self::create), where the folder that was asked for may hold one of these files, whole or partial: a
    /// campaign resumes there.
    ///
    /// # Errors
    /// [`RunFolderError`].
    pub fn resume(asked: Option<&Path>, name: &str, files: &[&str]) -> Result<Self, RunFolderError> {
        let holds = |path: &&Path| {
            let mut files = files.iter().map(|file| path.join(file));
            files.any(|file| file.exists() || partial_path(&file).exists())
        };
        match asked.filter(holds) {
            Some(path) => Ok(Self(path.to_owned())),
            None => Self::create(asked, name),
        }
    }

    fn create_named(path: &Path) -> Result<Self, RunFolderError> {
        let failed = |source| RunFolderError::Io {
            path: path.to_owned(),
            source,
        };
        fs::create_dir_all(path).map_err(failed)?;
        if fs::read_dir(path).map_err(failed)?.next().is_some() {
            return Err(RunFolderError::NotEmpty(path.to_owned()));
        }
        Ok(Self(path.to_owned()))
    }

    fn create_numbered(parent: &Path, name: &str) -> Result<Self, RunFolderError> {
        let failed = |path: &Path, source| RunFolderError::Io {
            path: path.to_owned(),
            source,
        };
        fs::create_dir_all(parent).map_err(|source| failed(parent, source))?;
        for number in 1.. {
            let path = parent.join(format!("{name}-{number}"));
            match fs::create_dir(&path) {
                Ok(()) => return Ok(Self(path)),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(failed(&path, error)),
            }
        }
        unreachable!("some number is free")
    }

    /// Removes the folder if nothing was written to it.
    pub fn remove_if_empty(&self) {
        // Fails for a folder that is not empty.
        let _ = fs::remove_dir(&self.0);
    }

    /// Removes these files of the folder.
    pub fn remove_files(&self, files: &[PathBuf]) {
        for file in files.iter().filter(|file| file.parent() == Some(self.path())) {
            // Fails for a missing file.
            let _ = fs::remove_file(file);
        }
    }

    /// Removes both logs, complete or not.
    pub fn remove_logs(&self) {
        let host = self.host_log();
        for log in written_files(&self.run_log())
            .into_iter()
            .chain([partial_path(&host), host])
        {
            // Fails for a missing file.
            let _ = fs::remove_file(log);
        }
    }

    /// Returns the path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Returns the path of the log of the experiment.
    #[must_use]
    pub fn run_log(&self) -> PathBuf {
        self.0.join("run.mcap")
    }

    /// Returns the path of the log of the machine.
    #[must_use]
    pub fn host_log(&self) -> PathBuf {
        self.0.join("host.mcap")
    }

    /// Returns the path of `summary.json`.
    #[must_use]
    pub fn summary(&self) -> PathBuf {
        self.0.join("summary.json")
    }
}

/// Returns the path of the summary beside a log.
#[must_use]
pub fn summary_beside(log: &Path) -> PathBuf {
    log.with_file_name("summary.json")
}

/// Reads the summary beside a log; `None` if it is missing, too long or not valid.
#[must_use]
pub fn read_summary_beside<T: DeserializeOwned>(log: &Path) -> Option<T> {
    const LONGEST: u64 = 16 << 20;
    let path = summary_beside(log);
    // Reading a pipe with this name could block without a timeout.
    let found = fs::metadata(&path).ok()?;
    if !found.is_file() || found.len() > LONGEST {
        return None;
    }
    let mut text = String::new();
    fs::File::open(path)
        .ok()?
        .take(LONGEST)
        .read_to_string(&mut text)
        .ok()?;
    serde_json::from_str(&text).ok()
}

/// Resolves a path to a log: the path itself or, for the folder of a run, its best log. A recovered log is preferred, because
/// only an incomplete log is recovered.
#[must_use]
pub fn log_meant_by(path: &Path) -> PathBuf {
    if !path.is_dir() {
        return path.to_owned();
    }
    let complete = RunFolder(path.to_owned()).run_log();
    let candidates = [
        recovered_path(&complete),
        complete.clone(),
        partial_path(&complete),
    ];
    let found = candidates.into_iter().find(|candidate| candidate.exists());
    found.unwrap_or(complete)
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use super::*;

    #[test]
    fn numbered_folders_never_meet() {
        let parent = tempfile::tempdir().unwrap();
        let first = RunFolder::create_numbered(parent.path(), "fig1").unwrap();
        let second = RunFolder::create_numbered(parent.path(), "fig1").unwrap();
        assert_eq!(first.path(), parent.path().join("fig1-1"));
        assert_eq!(second.path(), parent.path().join("fig1-2"));
    }

    #[test]
    fn a_folder_with_something_in_it_is_refused() {
        let parent = tempfile::tempdir().unwrap();
        let out = parent.path().join("deep/out");
        let folder = RunFolder::create(Some(&out), "fig1").unwrap();
        assert!(
            RunFolder::create(Some(&out), "fig1").is_ok(),
            "an empty folder is fine"
        );
        fs::write(folder.summary(), "{}").unwrap();
        let error = RunFolder::create(Some(&out), "fig1").unwrap_err();
        assert!(error.to_string().contains("--out"), "{error}");
    }

    #[test]
    fn a_folder_means_its_recovered_log_before_the_damaged_one() {
        let folder = tempfile::tempdir().unwrap();
        let names = ["run.mcap.partial", "run.mcap", "run.recovered.mcap"];
        for name in names {
            let log = folder.path().join(name);
            fs::write(&log, "").unwrap();
            assert_eq!(log_meant_by(folder.path()), log);
        }
    }

    #[test]
    fn an_impossible_folder_is_an_error_that_names_it() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let error = RunFolder::create(Some(&file.path().join("out")), "fig1").unwrap_err();
        assert!(error.to_string().contains("--out"), "{error}");
    }
}
