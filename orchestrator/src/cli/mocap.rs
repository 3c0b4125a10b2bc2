//! Arguments of `gerono mocap`: motion capture without a flight.

use std::net::Ipv4Addr;
use std::net::SocketAddrV4;
use std::path::PathBuf;

use clap::{Args, Subcommand};
use motion_capture::natnet::Version;
use new_scenario::arguments::capture_system;
use scenario::CaptureSystem;

use super::values::duration;
use scenario_file::values::{ValueError, between};

/// Arguments of `gerono mocap`.
#[derive(Debug, Args)]
pub struct Mocap {
    /// The command.
    #[command(subcommand)]
    pub command: MocapCommand,
}

/// The commands of `gerono mocap`.
#[derive(Debug, Subcommand)]
pub enum MocapCommand {
    /// Receive from a motion-capture system for some seconds and print statistics.
    ///
    /// Shows every body with its rate, the share of frames in which it is tracked, its position and, if it is at rest, its noise;
    /// packet losses and jitter; and, with --object, the result of the feed. With --calibrate it writes the sections of a
    /// scenario that define the body's present pose as the vehicle at the origin of {I}, level, with yaw 0.
    #[command(after_help = MocapProbe::EXAMPLES)]
    Probe(MocapProbe),
    /// Emulate a motion-capture system with the poses of a recorded flight or of an eight, for tests.
    #[command(after_help = MocapSend::EXAMPLES)]
    Send(MocapSend),
}

/// Arguments of `gerono mocap probe`.
#[derive(Debug, Args)]
pub struct MocapProbe {
    /// The protocol of the system.
    #[arg(long, value_parser = capture_system())]
    pub source: CaptureSystem,
    /// IPv4 address of the server.
    #[arg(long, default_value_t = Ipv4Addr::LOCALHOST)]
    pub server: Ipv4Addr,
    /// Port of the server; with Vicon the local port [default: the system's].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    pub port: Option<u16>,
    /// IPv4 address of the local interface.
    #[arg(long, default_value_t = Ipv4Addr::LOCALHOST)]
    pub interface: Ipv4Addr,
    /// The vehicle: a body's name, `#NUMBER`, or `NAME#NUMBER`.
    #[arg(long)]
    pub object: Option<String>,
    /// Duration, s.
    #[arg(long, default_value_t = 5.0, value_parser = between(0.1, 3600.0, "s"))]
    pub seconds: f64,
    /// Write the sections of a scenario to this new file; the vehicle must be level at the origin of {I}, with its nose along x.
    #[arg(long, value_name = "FILE", requires = "object")]
    pub calibrate: Option<PathBuf>,
}

impl MocapProbe {
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono mocap probe --source vrpn --server 192.168.10.1 --interface 192.168.10.7\n  \
        gerono mocap probe --source natnet --server 192.168.10.1 --interface 192.168.10.7 --object quad --calibrate calibration.toml\n\n\
        Exit codes: 0 frames were received and, with --object, poses accepted; 1 otherwise; 4 the file of --calibrate cannot be \
        written, or exists already.";
}

/// Arguments of `gerono mocap send`.
#[derive(Debug, Args)]
pub struct MocapSend {
    /// The system to emulate.
    #[arg(long = "as", value_parser = capture_system())]
    pub system: CaptureSystem,
    /// IPv4 address to serve at and send from.
    #[arg(long, default_value_t = Ipv4Addr::LOCALHOST)]
    pub at: Ipv4Addr,
    /// Port to serve at [default: the system's].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    pub port: Option<u16>,
    /// Destination of the frames, with Vicon and NatNet [default: the system's port at --at].
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub to: Option<SocketAddrV4>,
    /// Version of NatNet's bit stream.
    #[arg(long, default_value = "4.1", value_parser = natnet_version)]
    pub natnet: Version,
    /// Name of the body.
    #[arg(long, default_value = "quad")]
    pub object: String,
    /// Frame rate, Hz.
    #[arg(long, default_value_t = 100.0, value_parser = between(1.0, 1000.0, "Hz"))]
    pub rate: f64,
    /// Standard deviation of the noise of each coordinate, m.
    #[arg(long, default_value_t = 1e-4, value_parser = between(0.0, 1.0, "m"))]
    pub noise: f64,
    /// Duration, s [default: until Ctrl-C, or the log's end].
    #[arg(long, value_parser = duration())]
    pub seconds: Option<f64>,
    /// Send the true poses of this log, or of the folder of a run, in place of an eight.
    #[arg(long)]
    pub log: Option<PathBuf>,
    /// Stay at the start of the flight.
    #[arg(long)]
    pub rest: bool,
}

impl MocapSend {
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono mocap send --as vrpn\n  \
        gerono mocap send --as natnet --natnet 3.1 --log runs/fig1-1 --rate 120\n  \
        gerono mocap send --as vicon_udp --to 127.0.0.1:51001 --rest --seconds 10";
}

fn natnet_version(text: &str) -> Result<Version, ValueError> {
    let parts = text
        .split_once('.')
        .and_then(|(major, minor)| Some((major.parse().ok()?, minor.parse().ok()?)));
    match parts {
        Some((major @ (3 | 4), minor)) => Ok(Version { major, minor }),
        _ => Err(ValueError::unfit("give 3.0, 3.1, 4.0, 4.1 or 4.2")),
    }
}
