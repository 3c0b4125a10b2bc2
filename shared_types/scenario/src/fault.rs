//! Planned faults: a service with an outage, or an input of a service whose samples are late, wrong or missing.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::EdgeName;
use crate::check::six_digits;
use crate::range::{length, moment, positive, positive_up_to};
use crate::timing::LONGEST_DELAY;
use shared_types::wiring::ServiceId;

/// Planned fault of a service or of an input, exact in simulated time.
///
/// The other values belong to certain [`kinds`](Fault::kind) only, and are refused with others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// Start, s.
    #[schemars(transform = moment)]
    pub at: f64,
    /// Name of the service that fails; with `off` and `freeze`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub service: Option<String>,
    /// Faulty input, as `"topic -> service"`; with all other kinds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edge: Option<String>,
    /// Kind of the fault.
    pub kind: FaultKind,
    /// Duration, s; permanent unless stated.
    #[serde(default, rename = "for", skip_serializing_if = "Option::is_none")]
    #[schemars(transform = length)]
    pub lasts: Option<f64>,
    /// State of the service at its restart; with `off`.
    #[serde(default)]
    pub state: FaultState,
    /// Additional delay of samples, s; with `delay`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = positive, extend("x-ticks" = LONGEST_DELAY))]
    pub by: Option<f64>,
    /// Share of the samples that are lost; with `intermittent`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = positive_up_to(1.0), extend("x-hint" = "0.1 is one in ten"))]
    pub fraction: Option<f64>,
    /// Wrong number of the sample, such as `thrust`, or `position_world.2` for one of several; with `wrong`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub field: Option<String>,
    /// Factor on the number, 1 unless stated; with `wrong`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Value added after `scale`, in the unit of the number, 0 unless stated; with `wrong`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bias: Option<f64>,
    /// Maximum magnitude of the random numbers; arbitrary bits unless stated; with `garbage`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = positive)]
    pub range: Option<f64>,
}

/// Kind of a fault of a service or of an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// The service's process dies and is restarted.
    Off,
    /// The service stops stepping and keeps its state.
    Freeze,
    /// Samples arrive late.
    Delay,
    /// Some samples are lost.
    Intermittent,
    /// Samples repeat the last one before the fault.
    Stuck,
    /// A number of the samples is wrong.
    Wrong,
    /// Samples contain random numbers.
    Garbage,
}

/// State of a service at its restart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FaultState {
    /// The state of its last step.
    #[default]
    Warm,
    /// The state at the start of the flight.
    Cold,
}

/// Target of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// A service.
    Service(ServiceId),
    /// An input of a service.
    Edge(EdgeName),
}

impl FaultKind {
    /// All kinds.
    pub const ALL: [Self; 7] = [
        Self::Off,
        Self::Freeze,
        Self::Delay,
        Self::Intermittent,
        Self::Stuck,
        Self::Wrong,
        Self::Garbage,
    ];

    /// Returns the name in scenarios.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Freeze => "freeze",
            Self::Delay => "delay",
            Self::Intermittent => "intermittent",
            Self::Stuck => "stuck",
            Self::Wrong => "wrong",
            Self::Garbage => "garbage",
        }
    }

    /// Returns whether the fault is one of a service; all others are faults of an input.
    #[must_use]
    pub fn is_outage(self) -> bool {
        matches!(self, Self::Off | Self::Freeze)
    }
}

impl Fault {
    /// Makes a permanent fault of this kind from `at` (s) on, without a target.
    #[must_use]
    pub fn new(kind: FaultKind, at: f64) -> Self {
        Self {
            at,
            service: None,
            edge: None,
            kind,
            lasts: None,
            state: FaultState::default(),
            by: None,
            fraction: None,
            field: None,
            scale: None,
            bias: None,
            range: None,
        }
    }

    /// Returns the target, if it exists.
    #[must_use]
    pub fn target(&self) -> Option<Target> {
        if self.kind.is_outage() {
            ServiceId::from_name(self.service.as_deref()?).map(Target::Service)
        } else {
            EdgeName::find(self.edge.as_deref()?).map(Target::Edge)
        }
    }

    /// Returns the end, s; infinity for a permanent fault.
    #[must_use]
    pub fn until(&self) -> f64 {
        self.lasts.map_or(f64::INFINITY, |lasts| self.at + lasts)
    }

    /// Returns the values that belong to certain kinds only: name, whether it is stated, and whether this kind has it.
    pub(super) fn values_of_kinds(&self) -> [(&'static str, bool, bool); 9] {
        let kind = self.kind;
        [
            ("service", self.service.is_some(), kind.is_outage()),
            ("edge", self.edge.is_some(), !kind.is_outage()),
            ("state", self.state != FaultState::Warm, kind == FaultKind::Off),
            ("by", self.by.is_some(), kind == FaultKind::Delay),
            (
                "fraction",
                self.fraction.is_some(),
                kind == FaultKind::Intermittent,
            ),
            ("field", self.field.is_some(), kind == FaultKind::Wrong),
            ("scale", self.scale.is_some(), kind == FaultKind::Wrong),
            ("bias", self.bias.is_some(), kind == FaultKind::Wrong),
            ("range", self.range.is_some(), kind == FaultKind::Garbage),
        ]
    }
}

impl std::fmt::Display for Target {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Service(service) => service.fmt(formatter),
            Self::Edge(edge) => edge.fmt(formatter),
        }
    }
}

impl std::fmt::Display for FaultKind {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(self.name())
    }
}

impl std::fmt::Display for Fault {
    /// Describes the fault without its times.
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let stated = self.service.as_ref().or(self.edge.as_ref());
        let target = stated.map_or("", String::as_str);
        let number = |value: Option<f64>| value.unwrap_or_default();
        match self.kind {
            FaultKind::Off if self.state == FaultState::Cold => {
                write!(formatter, "`{target}` is off and forgets what it knows")
            }
            FaultKind::Off => write!(formatter, "`{target}` is off"),
            FaultKind::Freeze => write!(formatter, "`{target}` stands still"),
            FaultKind::Delay => write!(formatter, "`{target}` is late by {} s", number(self.by)),
            FaultKind::Intermittent => {
                let percent = six_digits(100.0 * number(self.fraction));
                write!(formatter, "`{target}` loses {percent} % of its samples")
            }
            FaultKind::Stuck => write!(formatter, "`{target}` repeats its last sample"),
            FaultKind::Wrong => {
                let field = self.field.as_deref().unwrap_or_default();
                let (scale, bias) = (self.scale.unwrap_or(1.0), number(self.bias));
                write!(formatter, "`{target}` has a wrong `{field}`: × {scale} + {bias}")
            }
            FaultKind::Garbage => match self.range {
                Some(range) => write!(formatter, "`{target}` carries garbage within ±{range}"),
                None => write!(formatter, "`{target}` carries garbage"),
            },
        }
    }
}
