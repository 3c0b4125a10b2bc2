//! Files that a flight reads besides its scenario.

use std::path::PathBuf;

use scenario::{Curve, Scenario};
use shared_types::ServiceId;

/// File that a flight reads besides its scenario.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadFile<'a> {
    /// Purpose of the file.
    pub what: String,
    /// Path.
    pub path: PathBuf,
    /// SHA-256 when the scenario was read, in hexadecimal.
    pub sha256: &'a String,
}

/// Returns the files that a flight of a scenario reads: its plug-ins, and the points of its path.
pub fn files_of(scenario: &Scenario) -> impl Iterator<Item = ReadFile<'_>> {
    let plugins = scenario.plugins.iter().flat_map(|plugins| {
        let plugin = |role: ServiceId| {
            Some(ReadFile {
                what: format!("the plug-in in place of `{role}`"),
                path: plugins.path_of(role)?,
                sha256: plugins.sha256.get(role.name())?,
            })
        };
        ServiceId::ALL.into_iter().filter_map(plugin)
    });
    let path_file = match &scenario.path.curve {
        Curve::Waypoints(way) => way.file.clone().zip(way.sha256.as_ref()),
        _ => None,
    };
    let path_file = path_file.map(|(path, sha256)| ReadFile {
        what: "the file of the path".to_owned(),
        path,
        sha256,
    });
    plugins.chain(path_file)
}
