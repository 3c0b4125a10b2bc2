//! Where the services of a flight run, as users name it.

use clap::ValueEnum;

/// Place where the services of a flight run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Host {
    /// One process a service, simulated time, no sample ever lost.
    #[default]
    Lockstep,
    /// All services in one thread of this process.
    Inprocess,
    /// One process a service, the system's clock, the newest sample wins.
    Realtime,
}

impl Host {
    /// Name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lockstep => "lockstep",
            Self::Inprocess => "inprocess",
            Self::Realtime => "realtime",
        }
    }
}
