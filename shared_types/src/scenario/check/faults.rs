use super::Findings;
use super::events::ROUNDING;
use crate::scenario::suggest::known_names;
use crate::scenario::{Fault, FaultKind, FaultState, Key, Scenario};
use crate::wiring::ServiceId;

impl Scenario {
    /// Outages of services that there are, in the flight, and one after the other.
    pub(super) fn check_faults(&self, found: &mut Findings) {
        let at = Key::root().then("fault");
        for (index, fault) in self.fault.iter().enumerate() {
            fault.check(self.duration, &at.then(index), found);
        }
        for (later, fault) in self.fault.iter().enumerate() {
            let earlier = &self.fault[..later];
            let same = earlier.iter().find(|other| overlap(other, fault));
            if let Some(other) = same {
                found.add(
                    at.then(later).then("at"),
                    format!(
                        "`{}` is out already from {:?} s on, {}",
                        fault.service,
                        other.at,
                        other
                            .lasts
                            .map_or_else(|| "for good".to_owned(), |lasts| format!("for {lasts:?} s"))
                    ),
                    "make one outage of the two, or let one begin after the other has ended",
                );
            }
        }
    }
}

impl Fault {
    fn check(&self, duration: f64, at: &Key, found: &mut Findings) {
        match ServiceId::from_name(&self.service) {
            None => {
                let names = ServiceId::ALL.map(ServiceId::name);
                let reason = format!("there is no service `{}`", self.service);
                found.add(at.then("service"), reason, known_names(&self.service, &names));
            }
            Some(ServiceId::Plant) => found.add(
                at.then("service"),
                "the plant is the vehicle itself, which flies on whatever happens",
                "let another service fail, or change the vehicle by `vehicle.change`",
            ),
            Some(_) => {}
        }
        found.in_flight(&at.then("at"), "the outage", self.at, duration);
        if let Some(lasts) = self.lasts {
            found.positive(&at.then("for"), "the time", lasts);
        }
        if (self.kind, self.state) == (FaultKind::Freeze, FaultState::Cold) {
            found.add(
                at.then("state"),
                "a service that is frozen keeps its state",
                "use `kind = \"off\"`, or leave `state` out",
            );
        }
    }

    fn until(&self) -> f64 {
        self.lasts.map_or(f64::INFINITY, |lasts| self.at + lasts)
    }
}

fn overlap(one: &Fault, other: &Fault) -> bool {
    one.service == other.service && one.at < other.until() - ROUNDING && other.at < one.until() - ROUNDING
}
