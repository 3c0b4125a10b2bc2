//! Planned faults: a service with an outage, or an input of a service whose samples are late, wrong or missing.

use std::ops::Bound::Included;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::EdgeName;
use crate::range::{length, moment, positive, positive_up_to};
use crate::timing::LONGEST_DELAY;
use shared_types::wiring::ServiceId;

/// Planned fault of a service or of an input, exact in simulated time.
///
/// Each of the other values names the [`kinds`](Fault::kind) that it belongs to; with other kinds it is refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// Begin, s.
    #[schemars(transform = moment)]
    pub at: f64,
    /// Name of the service that fails; with `off` and `freeze`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub service: Option<String>,
    /// The input that fails, as `"topic -> service"`; with all other kinds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edge: Option<String>,
    /// Kind of the fault.
    pub kind: FaultKind,
    /// Duration, s; for ever unless stated.
    #[serde(default, rename = "for", skip_serializing_if = "Option::is_none")]
    #[schemars(transform = length)]
    pub lasts: Option<f64>,
    /// State of the service when it comes back; with `off`.
    #[serde(default)]
    pub state: FaultState,
    /// Additional delay of samples, s; with `delay`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = positive, extend("x-ticks" = LONGEST_DELAY))]
    pub by: Option<f64>,
    /// Share of the samples that are lost; with `intermittent`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = positive_up_to(Included(1.0)), extend("x-hint" = "0.1 is one in ten"))]
    pub fraction: Option<f64>,
    /// Number of the sample that is wrong, such as `thrust`, or `position_world.2` for one of several; with `wrong`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub field: Option<String>,
    /// Factor on the number, 1 unless stated; with `wrong`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Value added to it then, in its unit, 0 unless stated; with `wrong`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bias: Option<f64>,
    /// Largest magnitude of the random numbers; any bits at all unless stated; with `garbage`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = positive)]
    pub range: Option<f64>,
}

/// Kind of a fault of a service or of an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// The service's process dies, and another replaces it.
    Off,
    /// The service stands still and keeps its state.
    Freeze,
    /// Samples arrive later.
    Delay,
    /// Some samples are lost.
    Intermittent,
    /// Samples repeat the last one before.
    Stuck,
    /// A number of the samples is wrong.
    Wrong,
    /// Samples hold random numbers.
    Garbage,
}

/// State of a service when it comes back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FaultState {
    /// With the state of its last step before.
    #[default]
    Warm,
    /// As at the start of the flight.
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

    /// Returns its name in scenarios.
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

    /// Returns whether it concerns a service; all others concern an input of one.
    #[must_use]
    pub fn is_outage(self) -> bool {
        matches!(self, Self::Off | Self::Freeze)
    }
}

impl Fault {
    /// Makes a fault of this kind from `at` (s) on, for ever, without a target.
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

    /// Returns its target, if that exists.
    #[must_use]
    pub fn target(&self) -> Option<Target> {
        if self.kind.is_outage() {
            ServiceId::from_name(self.service.as_deref()?).map(Target::Service)
        } else {
            EdgeName::find(self.edge.as_deref()?).map(Target::Edge)
        }
    }

    /// Returns its end, s; infinity if it does not end.
    #[must_use]
    pub fn until(&self) -> f64 {
        self.lasts.map_or(f64::INFINITY, |lasts| self.at + lasts)
    }

    /// Returns the values that only some kinds have: name, whether it is stated, and whether this kind has it.
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
    /// Describes the fault in words, without the times.
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
                write!(
                    formatter,
                    "`{target}` loses {} of its samples",
                    number(self.fraction)
                )
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
