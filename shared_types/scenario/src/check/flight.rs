//! Checks of a flight with phases: the order of its requests, and a vehicle at rest on the ground.

use super::{Findings, six_digits};
use crate::{Flight, Key, Problem, Scenario};

impl Scenario {
    /// Returns the problem of a flight in simulated time that is never armed: `gerono arm` works in real time only.
    #[must_use]
    pub fn missing_arm_request(&self) -> Option<Problem> {
        let flight = self.flight.as_ref().filter(|flight| flight.arm_at.is_none())?;
        let requests = flight.requests().into_iter();
        let latest = requests
            .filter_map(|(_, time)| time)
            .fold(self.duration, f64::min);
        let fitting = match &self.navigation {
            Some(navigation) => navigation.ready_at(),
            None if latest > 1.0 => 1.0,
            None => 0.0,
        };
        Some(Problem::new(
            Key::root().then("flight").then("arm_at"),
            "the vehicle is never armed: `gerono arm` works only in real time, and this flight is in simulated time",
            format!("state the time of arming, such as `arm_at = {fitting:?}`, or leave `[flight]` out"),
        ))
    }

    /// Returns the problem of a flight in a laboratory whose motors turn without the operator, who must first check cameras
    /// and radio link.
    #[must_use]
    pub fn unattended_arming(&self) -> Option<Problem> {
        if !self.measures_a_vehicle() && self.radio_link().is_none() {
            return None;
        }
        let at = Key::root().then("flight");
        match &self.flight {
            None => Some(Problem::new(
                at,
                "in a laboratory the operator arms the vehicle once cameras and radio link work, but here the motors turn \
                 from the start",
                "add `[flight]`: the vehicle then stands on the ground until `gerono arm`",
            )),
            Some(flight) if flight.arm_at.is_some() => Some(Problem::new(
                at.then("arm_at"),
                "in a laboratory the operator arms the vehicle once cameras and radio link work, but here it arms itself",
                "leave `arm_at` out, and arm with `gerono arm`",
            )),
            Some(_) => None,
        }
    }

    /// Checks the section, and that the vehicle starts at rest on the ground.
    pub(super) fn check_flight(&self, found: &mut Findings) {
        let Some(flight) = &self.flight else {
            return;
        };
        let at = Key::root().then("flight");
        flight.check(self.duration, &at, found);
        let initial = &self.vehicle.initial;
        let ground = initial.position[2];
        let (key, depth) = self.path.curve.stated_depth();
        if depth > ground {
            found.add(
                key,
                format!("the path lies {} m below the ground, which is where the vehicle starts", six_digits(depth - ground)),
                "z points down: points above the ground have a smaller z, a negative one if the vehicle starts at z = 0",
            );
        }
        let motions = [
            ("velocity_body", initial.velocity_body),
            ("angular_velocity_body", initial.angular_velocity_body),
        ];
        for (name, motion) in motions {
            if motion != [0.0; 3] {
                found.add(
                    Key::root().then("vehicle").then("initial").then(name),
                    "with `[flight]` the vehicle stands on the ground at the start, but here it moves",
                    format!("leave `{name}` out, or leave `[flight]` out"),
                );
            }
        }
    }
}

impl Flight {
    fn check(&self, duration: f64, at: &Key, found: &mut Findings) {
        for (name, time) in self.requests() {
            if let Some(time) = time {
                found.in_flight(&at.then(name), "the request", time, duration);
            }
        }
        if let (Some(arm), Some(land)) = (self.arm_at, self.land_at)
            && land <= arm
        {
            found.add(
                at.then("land_at"),
                format!(
                    "the vehicle is to land at {land:?} s, but is not armed before {arm:?} s, and so never flies"
                ),
                format!("give a time after {arm:?} s"),
            );
        }
    }
}
