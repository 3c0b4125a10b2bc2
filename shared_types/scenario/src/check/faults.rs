//! Checks of planned faults: existing targets, the values of their kind, and no overlap.

use super::Findings;
use super::events::ROUNDING;
use crate::suggest::known_names;
use crate::timing::names::unknown_edge;
use crate::{EdgeName, Fault, FaultKind, Key, Scenario, Target};
use shared_types::sample::Member;
use shared_types::wiring::ServiceId;

impl Scenario {
    /// Checks the planned faults.
    pub(super) fn check_faults(&self, found: &mut Findings) {
        let at = Key::root().then("fault");
        for (index, fault) in self.fault.iter().enumerate() {
            fault.check(self.duration, &at.then(index), found);
            if let Some(Target::Edge(edge)) = fault.target() {
                self.check_published(edge.topic, at.then(index).then("edge"), found);
            }
        }
        for (later, fault) in self.fault.iter().enumerate() {
            let earlier = &self.fault[..later];
            let same = earlier.iter().find(|other| overlap(other, fault));
            if let (Some(other), Some(target)) = (same, fault.target()) {
                let state = match target {
                    Target::Service(_) => "out",
                    Target::Edge(_) => "faulty",
                };
                found.add(
                    at.then(later).then("at"),
                    format!(
                        "`{target}` is {state} already from {:?} s on, {}",
                        other.at,
                        other
                            .lasts
                            .map_or_else(|| "for good".to_owned(), |lasts| format!("for {lasts:?} s"))
                    ),
                    "merge them into one fault, or start one after the other has ended",
                );
            }
        }
    }
}

impl Fault {
    fn check(&self, duration: f64, at: &Key, found: &mut Findings) {
        for (value, is_stated, belongs) in self.values_of_kinds() {
            if is_stated && !belongs {
                let reason = format!("a fault of the kind `{}` has no `{value}`", self.kind);
                found.add(at.then(value), reason, self.kind.needs());
            }
        }
        if self.kind.is_outage() {
            self.check_service(&at.then("service"), found);
        } else {
            self.check_edge(&at.then("edge"), found);
        }
        found.in_flight(&at.then("at"), "the fault", self.at, duration);
        match self.kind {
            FaultKind::Delay if self.by.is_none() => self.report_missing(&at.then("by"), found),
            FaultKind::Intermittent if self.fraction.is_none() => {
                self.report_missing(&at.then("fraction"), found);
            }
            FaultKind::Wrong => self.check_field(at, found),
            _ => {}
        }
    }

    /// Reports a missing value that the kind needs.
    fn report_missing(&self, key: &Key, found: &mut Findings) {
        let reason = format!(
            "it is not stated, and a fault of the kind `{}` needs it",
            self.kind
        );
        found.add(key.clone(), reason, self.kind.needs());
    }

    fn check_service(&self, key: &Key, found: &mut Findings) {
        let Some(service) = &self.service else {
            return self.report_missing(key, found);
        };
        match ServiceId::from_name(service) {
            None => {
                let names = ServiceId::ALL.map(ServiceId::name);
                let reason = format!("there is no service `{service}`");
                found.add(key.clone(), reason, known_names(service, &names));
            }
            Some(ServiceId::Plant) => found.add(
                key.clone(),
                "the plant is the vehicle itself, which cannot fail",
                "state another service, or change the vehicle by `vehicle.change`",
            ),
            Some(_) => {}
        }
    }

    fn check_edge(&self, key: &Key, found: &mut Findings) {
        match &self.edge {
            None => self.report_missing(key, found),
            Some(edge) if EdgeName::find(edge).is_none() => {
                found.problems.push(unknown_edge(key.clone(), edge));
            }
            Some(_) => {}
        }
    }

    /// Requires an existing number of the edge's samples, and an error of it.
    fn check_field(&self, at: &Key, found: &mut Findings) {
        let Some(field) = &self.field else {
            return self.report_missing(&at.then("field"), found);
        };
        if let Some(Target::Edge(edge)) = self.target()
            && edge.topic.find_numbers(field).is_none()
        {
            let members = edge.topic.members();
            let names: Vec<_> = members
                .iter()
                .filter(|member| member.is_number())
                .map(Member::to_string)
                .collect();
            found.add(
                at.then("field"),
                format!("the samples of `{}` have no number `{field}`", edge.topic),
                format!("the numbers are {}", names.join(", ")),
            );
        }
        if self.scale.unwrap_or(1.0) == 1.0 && self.bias.unwrap_or(0.0) == 0.0 {
            found.add(
                at.clone(),
                "without a `scale` other than 1 or a `bias` other than 0 the fault has no effect",
                "state `scale`, `bias` or both",
            );
        }
    }
}

impl FaultKind {
    /// Returns advice on the values that a fault of this kind needs.
    fn needs(self) -> &'static str {
        match self {
            Self::Off => "state `service`, and `state = \"cold\"` for a cold start",
            Self::Freeze => "state `service`; a frozen service keeps its state",
            Self::Delay => "state `edge` and `by`, the delay of samples in s",
            Self::Intermittent => "state `edge` and `fraction`, the share of the samples that are lost",
            Self::Stuck => "state `edge` alone",
            Self::Wrong => "state `edge`, `field`, and `scale` or `bias`",
            Self::Garbage => "state `edge`, and `range` to limit the magnitude of the numbers",
        }
    }
}

fn overlap(one: &Fault, other: &Fault) -> bool {
    let same = one.target().is_some() && one.target() == other.target();
    same && one.at < other.until() - ROUNDING && other.at < one.until() - ROUNDING
}
