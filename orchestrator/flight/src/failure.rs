//! Why a flight in this process could not go on.

use std::error::Error;
use std::fmt::{Display, Formatter};

use host::step::NonFinite;
use run_log::LogError;
use scenario::Unflyable;
use shared_types::ServiceId;

/// Reason why a flight in this process could not go on.
#[derive(Debug, thiserror::Error)]
pub enum FlightFailure {
    /// A service computed a number that is not finite.
    #[error("{0}{1}")]
    NonFinite(NonFinite, Suspects),
    /// A plug-in failed in its step.
    #[error("{0}; the log ends with the last whole tick")]
    Plugin(String),
    /// The log cannot be written.
    #[error(transparent)]
    Log(#[from] LogError),
    /// No services are made of the scenario: it names a plug-in that cannot fly, for example.
    #[error("{0}")]
    Refused(#[source] Box<dyn Error + Send + Sync>),
    /// The flight cannot begin.
    #[error("cannot set the run up: {0}")]
    Setup(#[source] Box<dyn Error + Send + Sync>),
}

impl FlightFailure {
    /// Returns the failure of a flight that cannot begin, from the error or the sentence that says why.
    pub fn setup(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Setup(error.into())
    }

    /// Returns whether nothing was flown: the scenario or the machine is at fault, and not the flight.
    #[must_use]
    pub fn is_of_setup(&self) -> bool {
        matches!(self, Self::Refused(_) | Self::Setup(_))
    }

    /// Returns the tick at which a service computed a number that is not finite, if that is the failure.
    #[must_use]
    pub fn not_finite_at(&self) -> Option<u64> {
        match self {
            Self::NonFinite(found, _) => Some(found.tick),
            _ => None,
        }
    }
}

impl From<Unflyable> for FlightFailure {
    fn from(scenario: Unflyable) -> Self {
        Self::setup(scenario)
    }
}

impl From<std::convert::Infallible> for FlightFailure {
    fn from(never: std::convert::Infallible) -> Self {
        match never {}
    }
}

/// Services in whose place other code than Gerono's flies: what they publish reaches every service, and an absurd number
/// ends in one that is not finite.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Suspects(String);

impl Suspects {
    /// Makes the suspects of a failure whose message is `told`: none if it names one of them.
    #[must_use]
    pub fn of(foreign: impl IntoIterator<Item = ServiceId>, told: &impl Display) -> Self {
        let names: Vec<_> = foreign
            .into_iter()
            .map(|service| format!("`{service}`"))
            .collect();
        let told = told.to_string();
        if names.iter().any(|name| told.contains(name)) {
            return Self::default();
        }
        Self(names.join(", "))
    }

    /// Returns whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl Display for Suspects {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        if self.is_empty() {
            return Ok(());
        }
        write!(
            formatter,
            "; other code than Gerono's flies in place of {}: look first at what it published",
            self.0
        )
    }
}
