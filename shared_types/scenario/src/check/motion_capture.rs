//! Checks of `[motion_capture]`.

use std::net::Ipv4Addr;

use super::Findings;
use crate::motion_capture::LONGEST_NAME;
use crate::{BodyNumbers, CaptureSystem, Key, MotionCapture, PoseSource, Problem, Scenario};

impl Scenario {
    pub(super) fn check_motion_capture(&self, found: &mut Findings) {
        let Some(section) = &self.motion_capture else {
            return;
        };
        let at = Key::root().then("motion_capture");
        section.check(&at, found);
        let (reason, fix) = match self.navigation {
            _ if section.source.is_simulated() => return,
            None if self.estimator.is_none() => (
                "these cameras do not measure velocities, and there is no estimator",
                "add `[estimator.kalman]`, or leave `source` out",
            ),
            Some(_) if self.real_receivers().is_none() => (
                "these cameras see a real vehicle, and the other sensors are simulated",
                "state `receivers.sources`, or leave `source` out",
            ),
            _ => return,
        };
        found.add(at.then("source"), reason, fix);
    }
}

impl MotionCapture {
    /// Returns the problems of the section alone. A missing server or object is not a problem.
    #[must_use]
    pub fn problems(&self) -> Vec<Problem> {
        let mut found = Findings::from_section(self, "motion_capture");
        self.check_values(&Key::root().then("motion_capture"), &mut found);
        found.problems
    }

    fn check(&self, at: &Key, found: &mut Findings) {
        self.check_source(&at.then("source"), found);
        self.check_values(at, found);
    }

    fn check_values(&self, at: &Key, found: &mut Findings) {
        if !self.server.is_empty() {
            check_address(&at.then("server"), &self.server, found);
        }
        check_address(&at.then("interface"), &self.interface, found);
        if !self.object.is_empty() {
            self.check_object(&at.then("object"), found);
        }
        let [least, most] = self.rate;
        if least >= most {
            let reason = format!("{least:?} Hz to {most:?} Hz is not a range of rates");
            found.add(at.then("rate"), reason, "give two numbers, the smaller one first");
        }
    }

    fn check_source(&self, key: &Key, found: &mut Findings) {
        if let Some(system) = self.source.system()
            && (self.server.is_empty() || self.object.is_empty())
        {
            let reason = format!(
                "the server of `{}` and the vehicle's body are not both stated",
                system.name()
            );
            found.add(
                key.clone(),
                reason,
                "add `server` and `object`, or leave `source` out",
            );
        }
        if self.source == PoseSource::Replay && self.recording.is_none() {
            found.add(
                key.clone(),
                "the flight whose captures are replayed is not stated",
                "add `recording` with its run's folder or its log, or leave `source` out",
            );
        }
    }

    fn check_object(&self, key: &Key, found: &mut Findings) {
        let system = self.source.system().map(CaptureSystem::properties);
        let longest = system.map_or(LONGEST_NAME, |system| system.longest_name);
        let Some((name, number)) = self.name_and_number() else {
            let reason = format!("there is no number after the # of `{}`", self.object);
            found.add(key.clone(), reason, "write it as `quad`, `#7` or `quad#1`");
            return;
        };
        if name.is_empty()
            && (number.is_none() || system.is_some_and(|system| system.numbers != BodyNumbers::Body))
        {
            let fix = "give the body's name as the motion-capture program shows it";
            found.add(key.clone(), "the vehicle's body has no name", fix);
        } else if name.len() > longest {
            let reason = format!("a name of {} bytes, more than {longest}", name.len());
            found.add(key.clone(), reason, "give the body a shorter name");
        }
    }
}

fn check_address(key: &Key, text: &str, found: &mut Findings) {
    let reason = match text.parse::<Ipv4Addr>() {
        Err(_) => format!("`{text}` is not an IPv4 address"),
        Ok(address) if address.is_unspecified() => "packets would be accepted on all interfaces".to_owned(),
        Ok(address) if address.is_multicast() || address.is_broadcast() => {
            format!("{address} is not the address of one machine")
        }
        Ok(_) => return,
    };
    let fix = "give the address of one interface, such as \"192.168.10.1\"; names are not resolved";
    found.add(key.clone(), reason, fix);
}
