//! Arguments of `gerono gnss`: satellite receivers and autopilots that measure, without a flight.

use clap::{Args, Subcommand};
use scenario_file::values::between;
use shared_types::receiver_source::ReceiverSource;

/// The commands of `gerono gnss`.
#[derive(Debug, Subcommand)]
pub enum GnssCommand {
    /// Receive from a satellite receiver or an autopilot and print what arrives.
    ///
    /// Reads UBX (NAV-PVT, NAV-RELPOSNED) and MAVLink (GPS_RAW_INT, HIGHRES_IMU, ODOMETRY). Each second it prints rates, kind of
    /// fix, satellites, accuracies, and the age on arrival if this machine's clock is right; at the end gaps, refused packets with
    /// their reasons, and what is wrong with the next step.
    #[command(after_help = GnssProbe::EXAMPLES)]
    Probe(GnssProbe),
}

/// Arguments of `gerono gnss probe`.
#[derive(Debug, Args)]
pub struct GnssProbe {
    /// A serial device, tcp:ADDRESS:PORT of a server, udp:ADDRESS:PORT of this machine, or a file of recorded bytes.
    #[arg(value_name = "SOURCE")]
    pub source: ReceiverSource,
    /// Speed of a serial device, baud; on USB it does not matter.
    #[arg(long, default_value_t = 38400, value_name = "BAUD", value_parser = clap::value_parser!(u32).range(1..))]
    pub baud: u32,
    /// Duration, s.
    #[arg(long, default_value_t = 10.0, value_parser = between(0.1, 3600.0, "s"))]
    pub seconds: f64,
}

impl GnssProbe {
    const EXAMPLES: &str = "Examples:\n  \
        gerono gnss probe /dev/serial/by-id/usb-u-blox_AG_-_www.u-blox.com_u-blox_GNSS_receiver-if00\n  \
        gerono gnss probe /dev/ttyUSB0 --baud 115200 --seconds 60\n  \
        gerono gnss probe udp:0.0.0.0:14550\n\n\
        Exit codes: 0 positions, or samples or estimates of an autopilot, were received; 1 otherwise.";
}
