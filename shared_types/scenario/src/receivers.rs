//! Receivers: satellite receivers, and autopilots that measure, of a real vehicle outdoors.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shared_types::Topic;
use shared_types::receiver_source::{ReceiverSource, ReceiverSourceError};

use super::Scenario;
use super::radio_link::BAUDS;
use crate::range::{from_0_to_below, within};

/// Sources of what a real vehicle measures: UBX of satellite receivers, MAVLink of autopilots. In real time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Receivers {
    /// Sources, as of `gerono gnss probe`: a serial device, `tcp:ADDRESS:PORT` of a server, or `udp:ADDRESS:PORT` of this machine. Without any
    /// the plant's sensors measure.
    pub sources: Vec<String>,
    /// Speed of serial devices, baud; on USB it does not matter.
    #[schemars(transform = within(BAUDS), extend("x-hint" = "38400 is that of a u-blox receiver, 57600 and 921600 are usual of autopilots"))]
    pub baud: u32,
    /// Minimum time from a measurement of the other sensors to its arrival, s.
    #[schemars(transform = from_0_to_below(1.0))]
    pub latency: f64,
    /// Minimum time from the validity of a fix to its arrival, s.
    #[schemars(transform = from_0_to_below(1.0), extend("x-hint" = "`gerono gnss probe` prints it, if this machine's clock is synchronised"))]
    pub fix_latency: f64,
}

impl Default for Receivers {
    fn default() -> Self {
        Self {
            sources: Vec::new(),
            baud: 38_400,
            latency: 0.002,
            fix_latency: 0.1,
        }
    }
}

impl Scenario {
    /// Returns the receivers of a real vehicle; `None` if the plant's sensors measure.
    #[must_use]
    pub fn real_receivers(&self) -> Option<&Receivers> {
        let stated = self.receivers.as_ref();
        stated.filter(|receivers| !receivers.sources.is_empty())
    }
}

impl Receivers {
    /// Returns the sources.
    ///
    /// # Errors
    /// If one is not an address.
    pub fn addresses(&self) -> Result<Vec<ReceiverSource>, ReceiverSourceError> {
        self.sources.iter().map(|source| source.parse()).collect()
    }

    /// Returns the minimum time from a measurement to its arrival, s.
    #[must_use]
    pub fn latency_of(&self, topic: Topic) -> f64 {
        match topic {
            Topic::GnssFix | Topic::GnssBaseline => self.fix_latency,
            _ => self.latency,
        }
    }
}
