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
    let (reason, fix) = match error.kind() {
        io::ErrorKind::NotFound => ("there is no such file".to_owned(), nearest_scenario(path)),
        io::ErrorKind::IsADirectory => (
            "it is a folder".to_owned(),
            nearest_scenario(&path.join("*.toml")),
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

/// Returns advice for a missing file: the scenario with the closest name in the folder `scenarios` beside it or in its own
/// folder, or all of them.
fn nearest_scenario(path: &Path) -> String {
    let folder = path.parent().unwrap_or(Path::new(""));
    let known = [folder.join("scenarios"), folder.to_owned()]
        .iter()
        .map(|folder| scenarios_in(folder))
        .find(|scenarios| !scenarios.is_empty())
        .unwrap_or_default();
    let stem = |path: &Path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let stems: Vec<String> = known.iter().filter_map(|path| stem(path)).collect();
    let wanted = stem(path).unwrap_or_default();
    let nearest = suggest::nearest(&wanted, stems.iter().map(String::as_str));
    let nearest =
        nearest.and_then(|nearest| known.iter().find(|path| stem(path).as_deref() == Some(nearest)));
    match (nearest, known.as_slice()) {
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
