//! Devices of the operator in a flight in real time, beside the command line.
//!
//! They do not affect the log of a flight in simulated time, which does not open them.
//! [`Scenario::experiment`](super::Scenario::experiment) removes them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::radio_link::BAUDS;
use crate::range::{between, within};

/// Largest code of a key: KEY_MAX of the kernel's input-event-codes.h.
const LAST_KEY: u32 = 0x2ff;

/// Kill switch of the operator: a key of an input device or a button at a serial line, with the effect of `gerono kill`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OperatorDevices {
    /// Kill switch: an input device such as one of /dev/input/by-id, or a serial device such as one of
    /// /dev/serial/by-id. A press stops the motors until the end of the run.
    pub kill_device: String,
    /// Code of the key that kills, or of the byte on a serial line; any unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(0, LAST_KEY), extend("x-hint" = "`gerono operator probe` prints the code of a key; leave it out for any key"))]
    pub kill_key: Option<u32>,
    /// Speed of a serial kill switch, baud.
    #[serde(default = "default_baud")]
    #[schemars(transform = within(BAUDS), extend("x-hint" = "such as 9600"))]
    pub kill_baud: u32,
    /// Reaction to the loss of the kill switch while the vehicle is armed.
    #[serde(default)]
    pub on_loss: KillSwitchLoss,
}

/// Reaction to the loss of the kill switch while the vehicle is armed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum KillSwitchLoss {
    /// The flight continues without it.
    Ignore,
    /// The vehicle lands and the run ends, as by `gerono stop`.
    #[default]
    Land,
    /// The motors stop until the end of the run, as by `gerono kill`.
    Kill,
}

fn default_baud() -> u32 {
    9600
}

impl OperatorDevices {
    /// Makes a kill switch with defaults: any key kills.
    #[must_use]
    pub fn new(kill_device: impl Into<String>) -> Self {
        Self {
            kill_device: kill_device.into(),
            kill_key: None,
            kill_baud: default_baud(),
            on_loss: KillSwitchLoss::default(),
        }
    }
}
