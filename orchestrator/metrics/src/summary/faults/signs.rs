//! Signs of detection and reaction in the samples of the services.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use shared_types::samples::{ControlAdaptation, PathReference, RcFrame, VehicleState};
use shared_types::service::header_of;
use shared_types::{Schedule, ServiceId, Topic};

use crate::read;

/// A service's condition while something is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Condition {
    Untracked,
    Coasting,
    Standing,
    Holding,
    Level,
    Descending,
    CommandsNothing,
    Resting,
    LinkHolding,
    Failsafe,
}

impl Condition {
    const ALL: [Self; 10] = [
        Self::Untracked,
        Self::Coasting,
        Self::Standing,
        Self::Holding,
        Self::Level,
        Self::Descending,
        Self::CommandsNothing,
        Self::Resting,
        Self::LinkHolding,
        Self::Failsafe,
    ];

    /// As the first sign of a fault, in words; resting alone is none, for estimators rest for good reasons too.
    fn sign(self) -> Option<&'static str> {
        match self {
            Self::Untracked => Some("not tracked"),
            Self::Coasting => Some("coasts"),
            Self::Standing => Some("path stands"),
            Self::Holding | Self::LinkHolding => Some("holds"),
            Self::Level => Some("levels out"),
            Self::Descending => Some("descends"),
            Self::CommandsNothing | Self::Failsafe => Some("failsafe"),
            Self::Resting => None,
        }
    }
}

/// Set of conditions, one bit each.
type Conditions = u16;

fn conditions<const N: usize>(all: [(bool, Condition); N]) -> Conditions {
    let set = all.into_iter().filter(|(is_so, _)| *is_so);
    set.fold(0, |bits, (_, condition)| bits | 1 << condition as u16)
}

/// Observed topics.
const WATCHED: [Topic; 4] = [
    Topic::VehicleState,
    Topic::PathReference,
    Topic::ControlAdaptation,
    Topic::RcFrame,
];

/// The condition of the service that published a sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    /// Index in [`WATCHED`].
    place: usize,
    conditions: Conditions,
    /// Inputs refused since the previous sample.
    refused: u32,
    /// The sign that begins with this sample, if any.
    pub(super) sign: Option<(ServiceId, &'static str)>,
}

/// Changes from sample to sample.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Observers([Before; WATCHED.len()]);

/// The last sample of a service.
#[derive(Clone, Copy, Debug, Default)]
struct Before {
    conditions: Conditions,
    refused: u32,
}

impl Observers {
    /// Returns the condition in a sample; `None` for a topic without one.
    ///
    /// Only the beginning of a condition is a sign: a permanent one is not evidence of a fault.
    #[inline]
    pub(super) fn look(&mut self, topic: Topic, bytes: &[u8]) -> Option<Look> {
        let place = WATCHED.iter().position(|&watched| watched == topic)?;
        let (conditions, refused) = state_of(topic, bytes);
        let before = std::mem::replace(&mut self.0[place], Before { conditions, refused });
        let begun = conditions & !before.conditions;
        let grown = refused.saturating_sub(before.refused);
        let begun = Condition::ALL
            .into_iter()
            .filter(|&condition| begun & 1 << condition as u16 != 0);
        let sign = begun.filter_map(Condition::sign).next();
        let sign = sign.or((grown > 0).then_some("refuses"));
        Some(Look {
            place,
            conditions,
            refused: grown,
            sign: sign.zip(topic.publisher()).map(|(sign, service)| (service, sign)),
        })
    }
}

/// Signs of a flight without a fault: the same sign at the same tick is none of a fault.
///
/// The noise of a sensor is a function of the tick: what a gate refuses by chance, it refuses beside a fault too.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OrdinarySigns(BTreeSet<(u64, ServiceId, &'static str)>);

impl OrdinarySigns {
    fn has(&self, tick: u64, (service, sign): (ServiceId, &'static str)) -> bool {
        self.0.contains(&(tick, service, sign))
    }

    /// Removes the sign of a sample at a tick if it is an ordinary one.
    #[inline]
    pub(super) fn without(&self, tick: u64, look: Look) -> Look {
        Look {
            sign: look.sign.filter(|&sign| !self.has(tick, sign)),
            ..look
        }
    }
}

/// Collector of the [`OrdinarySigns`] of a flight without a fault.
#[derive(Clone, Debug, Default)]
pub struct OrdinaryWatch {
    observers: Observers,
    signs: OrdinarySigns,
}

impl OrdinaryWatch {
    /// Adds a sample; call in the order of the log.
    #[inline]
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) {
        if let Some((service, sign)) = self.observers.look(topic, bytes).and_then(|look| look.sign) {
            self.signs.0.insert((header_of(bytes).tick, service, sign));
        }
    }

    /// Returns the signs.
    #[must_use]
    pub fn finish(self) -> OrdinarySigns {
        self.signs
    }
}

/// Returns the conditions in a sample, and the number of inputs that its service has refused so far.
#[inline]
fn state_of(topic: Topic, bytes: &[u8]) -> (Conditions, u32) {
    match topic {
        Topic::VehicleState => {
            let state = read::<VehicleState>(bytes);
            let set = conditions([
                (!state.tracked.is_set(), Condition::Untracked),
                (state.coasting.is_set(), Condition::Coasting),
            ]);
            (set, state.captures_refused)
        }
        Topic::PathReference => {
            let reference = read::<PathReference>(bytes);
            let set = conditions([(!reference.vehicle_known.is_set(), Condition::Standing)]);
            (set, reference.states_refused)
        }
        Topic::ControlAdaptation => {
            let adaptation = read::<ControlAdaptation>(bytes);
            let is = |stage| adaptation.stage == stage;
            let set = conditions([
                (is(ControlAdaptation::STAGE_HOLD), Condition::Holding),
                (is(ControlAdaptation::STAGE_LEVEL), Condition::Level),
                (is(ControlAdaptation::STAGE_DESCEND), Condition::Descending),
                (is(ControlAdaptation::STAGE_FAILSAFE), Condition::CommandsNothing),
                (adaptation.resting.is_set(), Condition::Resting),
            ]);
            (set, adaptation.inputs_refused)
        }
        Topic::RcFrame => {
            let frame = read::<RcFrame>(bytes);
            let is_failsafe = frame.failsafe.is_set() || frame.stage == RcFrame::STAGE_FAILSAFE;
            let set = conditions([
                (
                    !is_failsafe && frame.stage != RcFrame::STAGE_COMMAND,
                    Condition::LinkHolding,
                ),
                (is_failsafe, Condition::Failsafe),
            ]);
            (set, frame.commands_refused)
        }
        _ => (0, 0),
    }
}

/// Durations of the reactions, in samples.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tally {
    samples: [u64; Condition::ALL.len()],
    refused: [u64; WATCHED.len()],
}

impl Tally {
    #[inline]
    pub(super) fn add(&mut self, look: &Look) {
        self.refused[look.place] += u64::from(look.refused);
        if look.conditions != 0 {
            for condition in Condition::ALL {
                self.samples[condition as usize] += u64::from(look.conditions >> condition as u16 & 1);
            }
        }
    }

    /// Converts to seconds: every sample counts for one period of its topic.
    pub(super) fn finish(&self, schedule: &Schedule) -> Reactions {
        let time = |condition: Condition, topic: Topic| {
            let ticks = self.samples[condition as usize] * schedule.topic_rate(topic).period;
            shared_types::service::seconds(ticks * schedule.tick_ns())
        };
        let law = |condition| time(condition, Topic::ControlAdaptation);
        let [captures_refused, states_refused, inputs_refused, commands_refused] = self.refused;
        Reactions {
            untracked: time(Condition::Untracked, Topic::VehicleState),
            coasted: time(Condition::Coasting, Topic::VehicleState),
            captures_refused,
            path_stood: time(Condition::Standing, Topic::PathReference),
            states_refused,
            held: law(Condition::Holding),
            level: law(Condition::Level),
            descended: law(Condition::Descending),
            commanded_nothing: law(Condition::CommandsNothing),
            inputs_refused,
            estimates_rested: law(Condition::Resting),
            link_held: time(Condition::LinkHolding, Topic::RcFrame),
            failsafe_frames: self.samples[Condition::Failsafe as usize],
            commands_refused,
        }
    }
}

/// The reactions of the services while a fault was watched. Times in s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Reactions {
    /// Time for which the estimator did not track the body.
    pub untracked: f64,
    /// Time for which it coasted.
    pub coasted: f64,
    /// The number of captures that it refused.
    pub captures_refused: u64,
    /// Time for which the path stood still because the position was unknown.
    pub path_stood: f64,
    /// The number of states that its generator refused.
    pub states_refused: u64,
    /// Time for which the controller held its command.
    pub held: f64,
    /// Time for which it commanded to be level.
    pub level: f64,
    /// Time for which it commanded to descend.
    pub descended: f64,
    /// Time for which it commanded nothing, in failsafe.
    pub commanded_nothing: f64,
    /// The number of inputs that it refused.
    pub inputs_refused: u64,
    /// Time for which its estimators rested.
    pub estimates_rested: f64,
    /// Time for which the radio held a command.
    pub link_held: f64,
    /// The number of failsafe frames that it sent.
    pub failsafe_frames: u64,
    /// The number of commands that it refused.
    pub commands_refused: u64,
}

impl std::fmt::Display for Reactions {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let services = [
            (
                "estimator",
                vec![
                    lasted("lost the body", self.untracked),
                    lasted("coasted", self.coasted),
                    counted("refused", self.captures_refused, "captures"),
                ],
            ),
            (
                "path",
                vec![
                    lasted("stood", self.path_stood),
                    counted("refused", self.states_refused, "states"),
                ],
            ),
            (
                "controller",
                vec![
                    lasted("held", self.held),
                    lasted("level", self.level),
                    lasted("descended", self.descended),
                    lasted("failsafe", self.commanded_nothing),
                    counted("refused", self.inputs_refused, "inputs"),
                ],
            ),
            (
                "radio",
                vec![
                    lasted("held", self.link_held),
                    counted("failsafe", self.failsafe_frames, "frames"),
                    counted("refused", self.commands_refused, "commands"),
                ],
            ),
            ("estimates", vec![lasted("rested", self.estimates_rested)]),
        ];
        let parts: Vec<String> = services
            .into_iter()
            .filter_map(|(who, did)| {
                let did: Vec<String> = did.into_iter().flatten().collect();
                (!did.is_empty()).then(|| format!("{who} {}", did.join(", ")))
            })
            .collect();
        if parts.is_empty() {
            formatter.pad("went on as ever")
        } else {
            formatter.pad(&parts.join("; "))
        }
    }
}

fn lasted(what: &str, time: f64) -> Option<String> {
    (time > 0.0).then(|| format!("{what} {time} s"))
}

fn counted(what: &str, count: u64, of: &str) -> Option<String> {
    (count > 0).then(|| format!("{what} {count} {of}"))
}
