//! Which inputs no step of a scenario looks at. Their samples need not be brought.

use super::SERVICES;
use crate::scenario::{EdgeName, Scenario, Target};
use crate::schedule::MAX_PORTS;
use crate::wiring::{ServiceId, Topic};

impl Scenario {
    /// Of each service and input, whether its steps never look at it.
    pub(super) fn unread_inputs(&self) -> [[bool; MAX_PORTS]; SERVICES] {
        let mut unread = [[false; MAX_PORTS]; SERVICES];
        for edge in EdgeName::all() {
            unread[edge.service.index()][edge.input] = !self.reads(edge);
        }
        unread
    }

    fn reads(&self, edge: EdgeName) -> bool {
        // A program of one's own may look at all that its service is given, and a fault is to be seen to happen.
        let is_theirs = self.guests()[edge.service.index()];
        is_theirs || self.faults_of(Target::Edge(edge)).next().is_some() || self.step_reads(edge)
    }

    /// Whether the service's own step logic looks at an input.
    fn step_reads(&self, edge: EdgeName) -> bool {
        match (edge.service, edge.topic) {
            // Its filter predicts by the frames already sent; ideal cameras need no filter.
            (ServiceId::Estimator, Topic::RcFrame) => self.estimator.is_some(),
            // The phases of a flight do: armed, taken off, landed.
            (ServiceId::PathGenerator, Topic::RcFrame) => self.flight.is_some(),
            // The envelope's limits on the state do.
            (ServiceId::RcOutput, Topic::VehicleState) => self
                .envelope
                .as_ref()
                .is_some_and(|envelope| envelope.estimate.is_some()),
            _ => true,
        }
    }
}
