//! Inputs that no step reads. Their samples need not be delivered.

use super::SERVICES;
use crate::{EdgeName, Scenario, Target};
use shared_types::schedule::MAX_PORTS;
use shared_types::wiring::{ServiceId, Topic};

impl Scenario {
    /// Returns for each service and input whether no step reads it.
    pub(super) fn unread_inputs(&self) -> [[bool; MAX_PORTS]; SERVICES] {
        let mut unread = [[false; MAX_PORTS]; SERVICES];
        for edge in EdgeName::all() {
            unread[edge.service.index()][edge.input] = !self.reads(edge);
        }
        unread
    }

    /// Returns whether the flight has samples of an edge: of a sensor only with sensors, and of cameras not with inertial
    /// navigation that fuses no poses.
    #[must_use]
    pub fn has_samples(&self, edge: EdgeName) -> bool {
        self.has_topic(edge.topic) && (edge.topic != Topic::MocapPose || self.fuses_poses() != Some(false))
    }

    fn reads(&self, edge: EdgeName) -> bool {
        if !self.has_samples(edge) {
            return false;
        }
        // A plug-in or an external service may read all inputs of its service. A faulty input is delivered so that the fault
        // is observable.
        self.is_foreign(edge.service)
            || self.faults_of(Target::Edge(edge)).next().is_some()
            || self.section_for(edge).is_none_or(|(_, is_stated)| is_stated)
    }

    /// Returns the section without which a service's step logic does not read an input, and whether it is stated; `None` if
    /// the input is always read.
    pub(crate) fn section_for(&self, edge: EdgeName) -> Option<(&'static str, bool)> {
        match (edge.service, edge.topic) {
            // The filter predicts by the frames already sent; ideal cameras need no filter.
            (ServiceId::Estimator, Topic::RcFrame) => {
                let has_filter = self.estimator.is_some() || self.navigation.is_some();
                Some(("estimator", has_filter))
            }
            // Sensors may be there for the log alone.
            (ServiceId::Estimator, topic) if topic.is_of_flight_outdoors() => {
                Some(("navigation", self.navigation.is_some()))
            }
            // The phases depend on them: armed, taken off, landed.
            (ServiceId::PathGenerator, Topic::RcFrame) => Some(("flight", self.flight.is_some())),
            // Some limits are limits on the state.
            (ServiceId::RcOutput, Topic::VehicleState) => Some(("envelope", self.envelope.is_some())),
            _ => None,
        }
    }
}
