//! Checks of `[motion_capture]`: its addresses, and the limits of its poses.

use std::net::Ipv4Addr;

use super::Findings;
use crate::motion_capture::LONGEST_NAME;
use crate::{BodyNumbers, CaptureSystem, Key, MotionCapture, PoseSource, Problem, Scenario};

impl Scenario {
    pub(super) fn check_motion_capture(&self, found: &mut Findings) {
        let Some(stated) = &self.motion_capture else {
            return;
        };
        let at = Key::root().then("motion_capture");
        stated.check(&at, found);
        if !stated.source.is_simulated() && self.estimator.is_none() {
            found.add(
                at.then("source"),
                "such cameras measure no velocities, and nothing estimates them",
                "add `[estimator.kalman]`, or leave `source` out",
            );
        }
    }
}

impl MotionCapture {
    /// Returns the problems of the section, whatever else is in the scenario. A server or an object that is not stated
    /// is none.
    #[must_use]
    pub fn problems(&self) -> Vec<Problem> {
        let mut found = Findings::of_section(self, "motion_capture");
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
            let reason = format!("{least:?} Hz to {most:?} Hz is no band of rates");
            found.add(at.then("rate"), reason, "give two numbers, the smaller one first");
        }
    }

    fn check_source(&self, key: &Key, found: &mut Findings) {
        if let Some(system) = self.source.system()
            && (self.server.is_empty() || self.object.is_empty())
        {
            let reason = format!(
                "nothing says where `{}` sends from and which body is the vehicle",
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
                "nothing says which flight's captures are to be replayed",
                "add `recording` with its run's folder or its log, or leave `source` out",
            );
        }
    }

    fn check_object(&self, key: &Key, found: &mut Findings) {
        let system = self.source.system().map(CaptureSystem::properties);
        let longest = system.map_or(LONGEST_NAME, |system| system.longest_name);
        let Some((name, number)) = self.name_and_number() else {
            let reason = format!("no number stands behind the # of `{}`", self.object);
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
        Err(_) => format!("`{text}` is no IPv4 address"),
        Ok(address) if address.is_unspecified() => {
            "all interfaces at once would be open to anybody".to_owned()
        }
        Ok(address) if address.is_multicast() || address.is_broadcast() => {
            format!("{address} is not the address of one machine")
        }
        Ok(_) => return,
    };
    let fix = "give the address of one interface, such as \"192.168.10.1\"; names are not looked up";
    found.add(key.clone(), reason, fix);
}
