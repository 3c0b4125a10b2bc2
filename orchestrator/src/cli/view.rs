//! Arguments of `gerono view`.

use std::net::IpAddr;
use std::path::PathBuf;

use clap::Args;

/// Default port; not assigned to a well-known service.
const PORT: u16 = 8421;

/// Arguments of `gerono view`.
#[derive(Debug, Args)]
pub struct View {
    /// A finished flight to show instead: a run.mcap, or the folder of a run.
    #[arg(value_name = "LOG", conflicts_with_all = ["run", "follow"])]
    pub log: Option<PathBuf>,
    /// The run, if several are live: its name, as `gerono doctor` shows it, or the PID of one of its services.
    #[arg(long, value_name = "ID")]
    pub run: Option<String>,
    /// Wait for a flight if none is live, and for the next one after its end, for a permanent display.
    #[arg(long, conflicts_with = "run")]
    pub follow: bool,
    /// The port to listen at; 0 selects a free one.
    #[arg(long, value_name = "PORT", default_value_t = PORT)]
    pub port: u16,
    /// Listen at this address of the machine, so that other machines can connect; pages then need the token in the printed URL,
    /// which is also shown as a QR code.
    #[arg(long, value_name = "ADDRESS")]
    pub bind: Option<IpAddr>,
    /// Also accept this host name, for example that of a proxy; pages then need the token as well.
    #[arg(long, value_name = "NAME")]
    pub allow_host: Vec<String>,
}

impl View {
    /// The end of `gerono view --help`.
    pub const EXAMPLES: &str = "Examples:\n  \
        gerono view\n  \
        gerono view --follow\n  \
        gerono view --bind 192.168.1.5\n  \
        gerono view runs/fig1-1\n\n\
        Exit codes: 0 the run has ended; 1 there is no such run, or the address is not available; 10 the log is incomplete or damaged; 128 + n ended by signal n (Ctrl-C: 130).";
}
