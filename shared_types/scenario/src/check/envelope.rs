//! Checks of the flight envelope.

use std::f64::consts::PI;

use super::Findings;
use crate::{Action, Envelope, Key, Scenario, Vector};

impl Scenario {
    pub(super) fn check_envelope(&self, found: &mut Findings) {
        let Some(envelope) = &self.envelope else {
            return;
        };
        let at = Key::root().then("envelope");
        envelope.check(&at, found);
        self.check_landings(envelope, &at, found);
        self.check_commands(envelope, &at, found);
        if let Some(fence) = &envelope.r#box
            && fence.distance_outside(&self.vehicle.initial.position) > 0.0
        {
            found.add(
                at.then("box"),
                "the vehicle starts outside of it",
                "extend the box to `vehicle.initial.position`; z points down, so `min` has the upper limit",
            );
        }
    }

    /// Refuses landings in a flight without phases.
    fn check_landings(&self, envelope: &Envelope, at: &Key, found: &mut Findings) {
        let actions = envelope.actions().into_iter();
        let lands = actions.filter(|(_, action)| *action == Action::Land);
        for (name, _) in lands.filter(|_| self.flight.is_none()) {
            found.add(
                at.then(name).then("action"),
                "the vehicle is to land, but a flight without phases has no ground",
                "add `[flight]`, or choose \"warn\" or \"kill\"",
            );
        }
    }

    /// Refuses limits on quantities that the controller does not command.
    fn check_commands(&self, envelope: &Envelope, at: &Key, found: &mut Findings) {
        let commands_rates = self.controller.rates.is_some();
        let (name, is_stated, commanded) = if commands_rates {
            ("torque", envelope.torque.is_some(), "body rates")
        } else {
            ("rates", envelope.rates.is_some(), "torque")
        };
        if is_stated {
            found.add(
                at.then(name),
                format!("the controller of this scenario commands {commanded}, which this does not limit"),
                format!("leave `{}` out", at.then(name)),
            );
        }
    }
}

impl Envelope {
    fn check(&self, at: &Key, found: &mut Findings) {
        if let Some(fence) = &self.r#box {
            check_box([&fence.min, &fence.max], &at.then("box"), found);
        }
        if let Some(limit) = self.tilt.as_ref().filter(|limit| limit.max >= PI) {
            found.add(
                at.then("tilt").then("max"),
                format!("a tilt never exceeds {:?} rad: upside down is π", limit.max),
                "give an angle below π; 0.8 is much for a flight of this kind",
            );
        }
        self.check_estimate(at, found);
    }

    /// Requires an action for a missing state if a limit is checked on the state.
    fn check_estimate(&self, at: &Key, found: &mut Findings) {
        let on_state = [
            ("box", self.r#box.is_some()),
            ("tilt", self.tilt.is_some()),
            ("speed", self.speed.is_some()),
        ];
        let limited = on_state.into_iter().find(|(_, is_stated)| *is_stated);
        if let (Some((name, _)), None) = (limited, &self.estimate) {
            found.add(
                at.then("estimate"),
                format!("`{name}` is checked on the estimated state, but no action is stated for an inaccurate or missing state"),
                "add `envelope.estimate = { position_sigma = 0.05, action = \"warn\" }` with the action that you want",
            );
        }
    }
}

/// Requires a box with a volume between two corners.
pub(super) fn check_box([min, max]: [&Vector; 2], at: &Key, found: &mut Findings) {
    for (axis, (&least, &most)) in min.iter().zip(max).enumerate() {
        if least >= most && found.are_in_range(at, &["min", "max"]) {
            found.add(
                at.then("max").then(axis),
                format!("{most:?} m is not above {least:?} m in `min`: the box is empty"),
                "put the smaller coordinate of each axis into `min`; z points down",
            );
        }
    }
}
