//! The host of a flight on the command line.
use clap::ValueEnum;

/// Host of the services of a flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Host {
    /// One process per service, simulated time, no sample lost.
    #[default]
    Lockstep,
    /// All services in one thread of this process.
    Inprocess,
    /// One process per service, the system's clock, the newest sample counts.
    Realtime,
}

impl Host {
    /// Returns the name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lockstep => "lockstep",
            Self::Inprocess => "inprocess",
            Self::Realtime => "realtime",
        }
    }
}
