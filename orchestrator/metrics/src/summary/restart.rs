//! Restarts in the summary and in the record of the machine.

use serde::Serialize;
use shared_types::ServiceId;

/// A death in flight with its restart.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Restart {
    /// The restarted service.
    #[serde(skip)]
    pub service: ServiceId,
    /// Name of the process.
    #[serde(rename = "service")]
    pub name: &'static str,
    /// Id of the new process.
    pub pid: u32,
    /// Last tick of the dead process; `None` before its first step.
    pub tick: Option<u64>,
    /// Time from the detection of the death, or from the last step of a hung process, until the new process flew, s.
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
