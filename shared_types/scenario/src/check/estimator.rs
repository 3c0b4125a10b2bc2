//! A filter that weighs what it sees, and a model to predict with.

use super::Findings;
use super::vehicle::check_center_of_mass;
use crate::{Kalman, Key, Model};

impl Kalman {
    pub(super) fn check(&self, at: &Key, found: &mut Findings) {
        // With a deviation of 0 a capture would outweigh everything: its weight is the inverse square.
        for (name, value) in [
            ("position_deviation", self.position_deviation),
            ("attitude_deviation", self.attitude_deviation),
        ] {
            found.positive(&at.then(name), "the deviation", value);
        }
        for (name, value) in [
            ("disturbance_drift", self.disturbance_drift),
            ("acceleration_noise", self.acceleration_noise),
            ("rate_noise", self.rate_noise),
            ("rate_bias_drift", self.rate_bias_drift),
            ("marker_offset_drift", self.marker_offset_drift),
        ] {
            found.not_negative(&at.then(name), "the spectral density", value);
        }
        let deviation = self.marker_offset_deviation;
        found.not_negative(&at.then("marker_offset_deviation"), "the deviation", deviation);
        found.positive(&at.then("gate"), "the gate", self.gate);
        found.not_negative(&at.then("restart_after"), "the time", self.restart_after);
        found.not_negative(&at.then("coast"), "the time", self.coast);
    }
}

impl Model {
    /// All but the latencies, which the schedule checks.
    pub(super) fn check(&self, at: &Key, found: &mut Findings) {
        found.positive(&at.then("mass"), "M", self.mass);
        for (axis, &edge) in self.size.iter().enumerate() {
            found.positive(&at.then("size").then(axis), &format!("l{}", axis + 1), edge);
        }
        check_center_of_mass(&self.marker_offset, &at.then("marker_offset"), found);
        found.not_negative(&at.then("thrust_lag"), "the time constant", self.thrust_lag);
        found.not_negative(&at.then("rate_lag"), "the time constant", self.rate_lag);
    }
}
