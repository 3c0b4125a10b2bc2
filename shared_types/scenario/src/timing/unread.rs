//! Inputs that no step of a scenario reads. Their samples need not be delivered.

use super::SERVICES;
use crate::{EdgeName, Scenario, Target};
use shared_types::schedule::MAX_PORTS;
use shared_types::wiring::{ServiceId, Topic};

impl Scenario {
    /// Returns, for each service and input, whether its steps never read it.
    pub(super) fn unread_inputs(&self) -> [[bool; MAX_PORTS]; SERVICES] {
        let mut unread = [[false; MAX_PORTS]; SERVICES];
        for edge in EdgeName::all() {
            unread[edge.service.index()][edge.input] = !self.reads(edge);
        }
        unread
    }

    fn reads(&self, edge: EdgeName) -> bool {
        // A plug-in or an external service may read all inputs of its service, and a fault must have an effect that can be
        // seen.
        self.is_foreign(edge.service)
            || self.faults_of(Target::Edge(edge)).next().is_some()
            || self.section_for(edge).is_none_or(|(_, is_stated)| is_stated)
    }

    /// The section without which a service's own step logic does not look at an input, and whether it is stated; `None`
    /// where it looks in any case.
    pub(crate) fn section_for(&self, edge: EdgeName) -> Option<(&'static str, bool)> {
        match (edge.service, edge.topic) {
            // A filter predicts by the frames already sent; ideal cameras need none.
            (ServiceId::Estimator, Topic::RcFrame) => Some(("estimator", self.estimator.is_some())),
            // Phases are made of them: armed, taken off, landed.
            (ServiceId::PathGenerator, Topic::RcFrame) => Some(("flight", self.flight.is_some())),
            // Some limits are limits on the state.
            (ServiceId::RcOutput, Topic::VehicleState) => Some(("envelope", self.envelope.is_some())),
            _ => None,
        }
    }
}
