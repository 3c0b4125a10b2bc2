//! The command line of `gerono operator`: the operator's devices, without a flight.

use std::path::PathBuf;

use clap::{Args, Subcommand};

/// The commands of `gerono operator`.
#[derive(Debug, Subcommand)]
pub enum OperatorCommand {
    /// Print the signals of a kill switch until Ctrl-C: each key, or each byte of a serial line.
    ///
    /// The device is an input device such as one of /dev/input/by-id, or a serial device such as one of /dev/serial/by-id.
    /// Each line has the signal and, for a press, the `kill_key` of a scenario's `[operator]` (docs/kill_switch.md).
    /// Other programs receive the keys as well.
    #[command(after_help = OperatorProbe::EXAMPLES)]
    Probe(OperatorProbe),
}

/// Arguments of `gerono operator probe`.
#[derive(Debug, Args)]
pub struct OperatorProbe {
    /// The device.
    #[arg(value_name = "DEVICE")]
    pub device: PathBuf,
    /// Speed of a serial device, baud.
    #[arg(long, default_value_t = 9600, value_name = "BAUD")]
    pub baud: u32,
}

impl OperatorProbe {
    const EXAMPLES: &str = "Examples:\n  \
        gerono operator probe /dev/input/by-id/usb-Acme_Button-event-kbd\n  \
        gerono operator probe /dev/serial/by-id/usb-Acme_Switch-if00 --baud 115200";
}
