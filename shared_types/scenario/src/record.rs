//! What is recorded of a flight, and in which files.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The recording of the flight. It changes the files of the log, not the flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// When the log goes on in another file; never unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub split: Option<Split>,
}

/// Limits of one file of a log: the first that is reached counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Split {
    /// Size from which on the log goes on in another file, bytes; at least 65536.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after_bytes: Option<u64>,
    /// Time of the flight from which on the log goes on in another file, s; at least 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after_seconds: Option<f64>,
}

impl Split {
    /// Smallest limit of a file's size, bytes: manifest and schemas, which each file repeats, take about half of it.
    pub const LEAST_BYTES: u64 = 1 << 16;

    /// Shortest time of a file, s.
    pub const LEAST_SECONDS: f64 = 1.0;
}
