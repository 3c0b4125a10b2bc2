//! Conversion of planned faults from seconds to ticks.

use super::SERVICES;
use crate::{EdgeName, Fault, FaultKind, FaultState, Scenario, Target};
use shared_types::schedule::{
    Corruption, Draws, EdgeFault, EdgeFaultKind, Loss, MAX_PORTS, Outage, OutageKind,
};
use shared_types::wiring::{ServiceId, Topic};

impl Scenario {
    /// Returns the outages of each service in chronological order, without invalid ones, which the checks report.
    pub(super) fn outages(&self) -> [Vec<Outage>; SERVICES] {
        ServiceId::ALL.map(|service| {
            let mut outages: Vec<_> = self
                .faults_of(Target::Service(service))
                .filter_map(|fault| self.outage(fault))
                .collect();
            outages.sort_by_key(|outage| outage.from);
            outages
        })
    }

    /// Returns the faults of each service's inputs in chronological order, without invalid ones, which the checks report.
    pub(super) fn edge_faults(&self) -> [[Vec<EdgeFault>; MAX_PORTS]; SERVICES] {
        let mut all: [[Vec<EdgeFault>; MAX_PORTS]; SERVICES] = Default::default();
        for (edge, index) in EdgeName::numbered().zip(0..) {
            let draws = Draws {
                seed: self.seed,
                edge: index,
            };
            let faults = &mut all[edge.service.index()][edge.input];
            faults.extend(
                self.faults_of(Target::Edge(edge))
                    .filter_map(|fault| self.edge_fault(fault, edge.topic, draws)),
            );
            faults.sort_by_key(|fault| fault.from);
        }
        all
    }

    pub(super) fn faults_of(&self, target: Target) -> impl Iterator<Item = &Fault> {
        self.fault
            .iter()
            .filter(move |fault| fault.target() == Some(target))
    }

    /// Returns the first tick of a fault, and the first tick after it.
    fn ticks_of(&self, fault: &Fault) -> [u64; 2] {
        let until = fault.lasts.map(|lasts| self.tick_of(fault.at + lasts));
        [self.tick_of(fault.at), until.unwrap_or(u64::MAX)]
    }

    fn outage(&self, fault: &Fault) -> Option<Outage> {
        let [from, until] = self.ticks_of(fault);
        let fate = match (fault.kind, fault.state) {
            (FaultKind::Freeze, _) => OutageKind::Frozen,
            (FaultKind::Off, FaultState::Warm) => OutageKind::Dies,
            (FaultKind::Off, FaultState::Cold) => OutageKind::DiesAndForgets,
            _ => return None,
        };
        Some(Outage { from, until, fate })
    }

    fn edge_fault(&self, fault: &Fault, topic: Topic, draws: Draws) -> Option<EdgeFault> {
        let [from, until] = self.ticks_of(fault);
        let kind = match fault.kind {
            FaultKind::Off | FaultKind::Freeze => return None,
            FaultKind::Delay => EdgeFaultKind::Late(self.tick_of(fault.by?)),
            FaultKind::Intermittent => EdgeFaultKind::Lost(Loss {
                fraction: fault.fraction?,
                draws,
            }),
            FaultKind::Stuck => EdgeFaultKind::Altered(Corruption::Repeated),
            FaultKind::Wrong => EdgeFaultKind::Altered(Corruption::Scaled {
                numbers: topic.find_numbers(fault.field.as_deref()?)?,
                scale: fault.scale.unwrap_or(1.0),
                bias: fault.bias.unwrap_or(0.0),
            }),
            FaultKind::Garbage => EdgeFaultKind::Altered(match fault.range {
                None => Corruption::Noise(draws),
                Some(range) => Corruption::Random {
                    numbers: topic
                        .members()
                        .iter()
                        .filter_map(|member| member.numbers(None))
                        .collect(),
                    range,
                    draws,
                },
            }),
        };
        Some(EdgeFault { from, until, kind })
    }
}
