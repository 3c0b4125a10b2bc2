//! Reading of a scenario file.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use scenario::suggest;

use super::ScenarioError;
use super::sources::Sources;
use crate::printable::printable;

/// Maximum length of a scenario file, bytes.
pub(super) const MAX_FILE: u64 = 1 << 20;

/// Reads the text of a scenario file.
pub(super) fn text(path: &Path) -> Result<String, ScenarioError> {
    let bytes = bytes(path).map_err(|error| unreadable(path, &error))?;
    if bytes.len() as u64 > MAX_FILE {
        return Err(ScenarioError::Unreadable {
            path: path.to_owned(),
            reason: format!("it is longer than {MAX_FILE} bytes"),
            fix: "give a scenario file; they are a few thousand bytes long".to_owned(),
        });
    }
    if let Some(offset) = bytes.iter().position(|&byte| byte == 0) {
        return Err(ScenarioError::Unreadable {
            path: path.to_owned(),
            reason: format!("it is not text: byte {offset} is 0"),
            fix: "give a scenario file, which is text in TOML".to_owned(),
        });
    }
    String::from_utf8(bytes).map_err(|error| {
        let start = error.utf8_error().valid_up_to();
        let reason = format!(
            "byte {:#04x} at offset {start} is not UTF-8 text",
            error.as_bytes()[start]
        );
        // Up to the first invalid byte the lossy text equals the file.
        let lossy = String::from_utf8_lossy(error.as_bytes());
        let span = start..start + char::REPLACEMENT_CHARACTER.len_utf8();
        let finding = Sources::new(&path.display().to_string(), &lossy, &[]).finding(
            span,
            "this is not a text file",
            reason,
            "save the file as UTF-8",
        );
        ScenarioError::refused(path, vec![finding])
    })
}

/// Reads a file, at most one byte more than the maximum.
pub(super) fn bytes(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(MAX_FILE + 1).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn unreadable(path: &Path, error: &io::Error) -> ScenarioError {
    let shipped = SHIPPED.map(PathBuf::from);
    let (reason, fix) = match error.kind() {
        io::ErrorKind::NotFound => (
            "there is no such file".to_owned(),
            nearest_scenario(path, &shipped),
        ),
        io::ErrorKind::IsADirectory => (
            "it is a folder".to_owned(),
            nearest_scenario(&path.join("*.toml"), &shipped),
        ),
        _ => (error.to_string(), "check the permissions of the file".to_owned()),
    };
    ScenarioError::Unreadable {
        path: path.to_owned(),
        reason,
        // The names of files may be untrusted.
        fix: printable(&fix).into_owned(),
    }
}

/// Folders of shipped scenarios: that of a clone, and that of the Debian package.
const SHIPPED: [&str; 2] = ["scenarios", "/usr/share/gerono/scenarios"];

/// Returns the file that an argument means: the file itself or, for a name without a folder such as `fig1`, the file with the
/// ending, or the shipped scenario.
#[must_use]
pub fn find(argument: PathBuf) -> PathBuf {
    if !is_bare(&argument) || argument.exists() {
        return argument;
    }
    let file = argument.with_extension("toml");
    let shipped = SHIPPED.iter().map(|folder| Path::new(folder).join(&file));
    let found = std::iter::once(file.clone())
        .chain(shipped)
        .find(|file| file.is_file());
    found.unwrap_or(argument)
}

/// Returns whether a path is a name alone.
fn is_bare(path: &Path) -> bool {
    path.file_name() == Some(path.as_os_str())
}

/// Returns advice for a missing file: the scenario with the closest name in the folder `scenarios` beside it or in its own
/// folder, or all of them.
pub(super) fn nearest_scenario(path: &Path, shipped: &[PathBuf]) -> String {
    let folder = path.parent().unwrap_or(Path::new(""));
    let shipped = shipped.iter().filter(|_| is_bare(path)).cloned();
    // The shipped ones first: the working directory may hold other TOML files.
    let known = std::iter::once(folder.join("scenarios"))
        .chain(shipped)
        .chain([folder.to_owned()])
        .map(|folder| scenarios_in(&folder))
        .find(|scenarios| !scenarios.is_empty())
        .unwrap_or_default();
    let stem = |path: &Path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let stems: Vec<String> = known.iter().filter_map(|path| stem(path)).collect();
    let wanted = stem(path).unwrap_or_default();
    let nearest = suggest::nearest(&wanted, stems.iter().map(String::as_str));
    let nearest =
        nearest.and_then(|nearest| known.iter().find(|path| stem(path).as_deref() == Some(nearest)));
    match (nearest, known.as_slice()) {
        (Some(nearest), _) if is_bare(path) => format!(
            "did you mean {}? There are {}",
            nearest.display(),
            stems.join(", ")
        ),
        (Some(nearest), _) => format!("did you mean {}?", nearest.display()),
        (None, []) => "give the path of a scenario file, such as scenarios/fig1.toml".to_owned(),
        (None, known) => {
            let known: Vec<String> = known.iter().map(|path| path.display().to_string()).collect();
            format!("there are {}", known.join(", "))
        }
    }
}

/// Returns the TOML files of a folder, sorted; none if it cannot be read.
fn scenarios_in(folder: &Path) -> Vec<PathBuf> {
    let here = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    let entries = fs::read_dir(here).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries.map(|entry| folder.join(entry.file_name())).collect();
    files.retain(|file| file.extension() == Some(OsStr::new("toml")));
    files.sort();
    files
}
