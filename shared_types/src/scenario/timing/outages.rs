//! Planned outages, from seconds to ticks.

use super::SERVICES;
use crate::scenario::{Fault, FaultKind, FaultState, Scenario};
use crate::schedule::{Fate, Outage};
use crate::wiring::ServiceId;

impl Scenario {
    /// The outages of each service in the order of time; those that cannot be are left to the checks.
    pub(super) fn outages(&self) -> [Vec<Outage>; SERVICES] {
        ServiceId::ALL.map(|service| {
            let own = self.fault.iter().filter(|fault| fault.service == service.name());
            let mut outages: Vec<_> = own.map(|fault| self.outage(fault)).collect();
            outages.sort_by_key(|outage| outage.from);
            outages
        })
    }

    fn outage(&self, fault: &Fault) -> Outage {
        let until = fault.lasts.map(|lasts| self.tick_of(fault.at + lasts));
        Outage {
            from: self.tick_of(fault.at),
            until: until.unwrap_or(u64::MAX),
            fate: match (fault.kind, fault.state) {
                (FaultKind::Freeze, _) => Fate::Frozen,
                (FaultKind::Off, FaultState::Warm) => Fate::Dies,
                (FaultKind::Off, FaultState::Cold) => Fate::DiesAndForgets,
            },
        }
    }
}
