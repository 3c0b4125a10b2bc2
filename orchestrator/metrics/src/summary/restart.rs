//! Restarts, as the summary and the record of the machine show them.

use serde::Serialize;
use shared_types::ServiceId;

/// A death in flight with its restart.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Restart {
    /// Which service.
    #[serde(skip)]
    pub service: ServiceId,
    /// The name of its process.
    #[serde(rename = "service")]
    pub name: &'static str,
    /// Id of the new process.
    pub pid: u32,
    /// The last tick that had been flown; `None` if it was the first.
    pub tick: Option<u64>,
    /// From the moment when the death was noticed, or from the last step of a process that hung, until the new process flew, s.
    pub lost_seconds: f64,
}

impl std::fmt::Display for Restart {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = self.name;
        match self.tick {
            Some(tick) => write!(formatter, "`{name}` died after tick {tick}")?,
            None => write!(formatter, "`{name}` died before its first step")?,
        }
        let lost = 1e3 * self.lost_seconds;
        write!(formatter, " and was restarted within {lost:.1} ms")
    }
}
