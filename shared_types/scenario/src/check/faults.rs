//! Planned faults: of things that there are, with the values that their kind has, and one after the other.

use super::Findings;
use super::events::ROUNDING;
use crate::suggest::known_names;
use crate::timing::names::unknown_edge;
use crate::{EdgeName, Fault, FaultKind, Key, Scenario, Target};
use shared_types::sample::Member;
use shared_types::wiring::ServiceId;

impl Scenario {
    /// Faults of services and inputs that there are, in the flight, and one after the other.
    pub(super) fn check_faults(&self, found: &mut Findings) {
        let at = Key::root().then("fault");
        for (index, fault) in self.fault.iter().enumerate() {
            fault.check(self.duration, &at.then(index), found);
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
                    "make one fault of the two, or let one begin after the other has ended",
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
            FaultKind::Delay if self.by.is_none() => self.found_nothing(&at.then("by"), found),
            FaultKind::Intermittent if self.fraction.is_none() => {
                self.found_nothing(&at.then("fraction"), found);
            }
            FaultKind::Wrong => self.check_field(at, found),
            _ => {}
        }
    }

    /// A value that the kind needs is not there.
    fn found_nothing(&self, key: &Key, found: &mut Findings) {
        let reason = format!(
            "it is not stated, and a fault of the kind `{}` needs it",
            self.kind
        );
        found.add(key.clone(), reason, self.kind.needs());
    }

    fn check_service(&self, key: &Key, found: &mut Findings) {
        let Some(service) = &self.service else {
            return self.found_nothing(key, found);
        };
        match ServiceId::from_name(service) {
            None => {
                let names = ServiceId::ALL.map(ServiceId::name);
                let reason = format!("there is no service `{service}`");
                found.add(key.clone(), reason, known_names(service, &names));
            }
            Some(ServiceId::Plant) => found.add(
                key.clone(),
                "the plant is the vehicle itself, which flies on whatever happens",
                "let another service fail, or change the vehicle by `vehicle.change`",
            ),
            Some(_) => {}
        }
    }

    fn check_edge(&self, key: &Key, found: &mut Findings) {
        match &self.edge {
            None => self.found_nothing(key, found),
            Some(edge) if EdgeName::find(edge).is_none() => {
                found.problems.push(unknown_edge(key.clone(), edge));
            }
            Some(_) => {}
        }
    }

    /// A number that the edge's samples have, and what becomes of it.
    fn check_field(&self, at: &Key, found: &mut Findings) {
        let Some(field) = &self.field else {
            return self.found_nothing(&at.then("field"), found);
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
                format!("there are {}", names.join(", ")),
            );
        }
        if self.scale.unwrap_or(1.0) == 1.0 && self.bias.unwrap_or(0.0) == 0.0 {
            found.add(
                at.clone(),
                "without a `scale` other than 1 or a `bias` other than 0 nothing is wrong",
                "state `scale`, `bias` or both",
            );
        }
    }
}

impl FaultKind {
    /// Returns the values of a fault of this kind, as advice.
    fn needs(self) -> &'static str {
        match self {
            Self::Off => "state `service`, and `state` if it is to come back \"cold\"",
            Self::Freeze => "state `service`; one that is frozen keeps its state",
            Self::Delay => "state `edge` and `by`, the time in s by which samples are late",
            Self::Intermittent => "state `edge` and `fraction`, the share of the samples that are lost",
            Self::Stuck => "state `edge` alone",
            Self::Wrong => "state `edge`, `field`, and `scale` or `bias`",
            Self::Garbage => "state `edge`, and `range` if the numbers shall have a largest magnitude",
        }
    }
}

fn overlap(one: &Fault, other: &Fault) -> bool {
    let same = one.target().is_some() && one.target() == other.target();
    same && one.at < other.until() - ROUNDING && other.at < one.until() - ROUNDING
}
