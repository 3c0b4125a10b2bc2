//! File of a plug-in: its path, and its hash compared with the scenario's.

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};

use scenario::Scenario;
use sha2::{Digest, Sha256};
use shared_types::ServiceId;
use shared_types::sample::hex;

/// Error of a plug-in's file.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// It cannot be read.
    #[error(
        "`plugins.{role}`: the plug-in `{}` cannot be read; build it, or name its folder with `plugins.folder`",
        path.display()
    )]
    NotRead {
        /// The role.
        role: ServiceId,
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The copy beside the log cannot be written.
    #[error("the plug-in cannot be copied to {}; name a writable folder with `--out`", path.display())]
    NotKept {
        /// The copy.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The file differs from the one in the scenario.
    #[error(
        "`plugins.{role}`: the plug-in `{}` has the SHA-256 {found}, and the scenario means {stated}: it was built again since. Name the \
         folder of the other one with `plugins.folder`, or leave `plugins.sha256` out",
        path.display()
    )]
    Other {
        /// The role.
        role: ServiceId,
        /// The file.
        path: PathBuf,
        /// SHA-256 of the file.
        found: String,
        /// SHA-256 in the scenario.
        stated: String,
    },
}

/// Returns the SHA-256 of a file, in hexadecimal.
fn sha256_of(role: ServiceId, path: &Path) -> Result<String, FileError> {
    let bytes = std::fs::read(path).map_err(|source| FileError::NotRead {
        role,
        path: path.to_owned(),
        source,
    })?;
    Ok(hex(&Sha256::digest(bytes)))
}

/// Verified file of a plug-in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LibraryFile {
    /// Path.
    pub path: PathBuf,
    /// SHA-256.
    pub sha256: String,
}

/// Returns the file of the plug-in in a role; `None` without a plug-in.
///
/// # Errors
/// [`FileError`].
pub fn find(scenario: &Scenario, role: ServiceId) -> Result<Option<LibraryFile>, FileError> {
    let Some((plugins, path)) = scenario
        .plugins
        .as_ref()
        .and_then(|plugins| Some((plugins, plugins.path_of(role)?)))
    else {
        return Ok(None);
    };
    let found = sha256_of(role, &path)?;
    match plugins.sha256.get(role.name()) {
        Some(stated) if *stated != found => Err(FileError::Other {
            role,
            path,
            found,
            stated: stated.clone(),
        }),
        _ => Ok(Some(LibraryFile { path, sha256: found })),
    }
}

/// Adds the missing SHA-256 of plug-ins to a scenario.
///
/// # Errors
/// [`FileError`] of the first plug-in that cannot be read or differs from the stated one.
pub fn pin(scenario: &mut Scenario) -> Result<(), FileError> {
    for role in ServiceId::ALL {
        if let Some(LibraryFile { sha256, .. }) = find(scenario, role)? {
            let plugins = scenario.plugins.as_mut().expect("it names the plug-in");
            plugins.sha256.insert(role.name().to_owned(), sha256);
        }
    }
    Ok(())
}

/// Returns the name of a library's copy: the file name, with the role as a prefix if another library has the same name.
fn copy_name(scenario: &Scenario, role: ServiceId, path: &Path) -> OsString {
    let name = path.file_name().unwrap_or_default();
    let plugins = scenario.plugins.iter();
    let mut others =
        plugins.flat_map(|plugins| ServiceId::ALL.map(|other| (other, plugins.library_of(other))));
    let is_shared = others.any(|(other, library)| {
        other != role && library.is_some_and(|library| library.file_name() == Some(name))
    });
    if !is_shared {
        return name.to_owned();
    }
    let mut own = OsString::from(format!("{role}-"));
    own.push(name);
    own
}

/// Copies the plug-ins of a scenario into a folder, by `write`, and changes the scenario to the copies: the log then keeps
/// the flown plug-ins, and a build during the flight has no effect.
///
/// # Errors
/// [`FileError`] if a file cannot be read or written.
pub fn copy_to(
    scenario: &mut Scenario,
    folder: &Path,
    write: impl Fn(&Path, &[u8]) -> io::Result<()>,
) -> Result<(), FileError> {
    let mut has_any = false;
    for role in ServiceId::ALL {
        if let Some(LibraryFile { path, .. }) = find(scenario, role)? {
            let name = copy_name(scenario, role, &path);
            let copy = folder.join(&name);
            let bytes = std::fs::read(&path).map_err(|source| FileError::NotRead {
                role,
                path: path.clone(),
                source,
            })?;
            write(&copy, &bytes).map_err(|source| FileError::NotKept { path: copy, source })?;
            let plugins = scenario.plugins.as_mut().expect("it names the plug-in");
            plugins.rename(role, &name);
            has_any = true;
        }
    }
    if let Some(plugins) = scenario.plugins.as_mut().filter(|_| has_any) {
        plugins.folder = Some(folder.to_owned());
    }
    Ok(())
}
