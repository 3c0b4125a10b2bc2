//! Checks of `[receivers]`. Opening the sources checks whether they exist.

use super::Findings;
use crate::{Key, Scenario};
use shared_types::receiver_source::ReceiverSource;

impl Scenario {
    pub(super) fn check_receivers(&self, found: &mut Findings) {
        let Some(receivers) = &self.receivers else { return };
        let at = Key::root().then("receivers");
        if self.navigation.is_none() {
            found.add(
                at.clone(),
                "only inertial navigation uses what receivers measure, and there is none",
                "add `[navigation]`, which may be empty, or leave `[receivers]` out",
            );
        }
        if self.real_receivers().is_some()
            && self.fuses_poses() == Some(true)
            && self.capture_system().is_none()
        {
            found.add(
                Key::root().then("navigation").then("poses"),
                "the receivers are real, and no real cameras send poses",
                "state `motion_capture.source`, or leave it out, or `receivers.sources` for a simulated vehicle",
            );
        }
        let key = at.then("sources");
        for (index, source) in receivers.sources.iter().enumerate() {
            if source.parse::<ReceiverSource>().is_err() {
                found.add(
                    key.then(index),
                    format!("`{source}` is not the address of a receiver"),
                    "give tcp:ADDRESS:PORT, udp:ADDRESS:PORT, or the path of a device, with ./ or / before a colon; names are not resolved",
                );
            } else if receivers.sources[..index].contains(source) {
                found.add(
                    key.then(index),
                    format!("`{source}` is stated twice"),
                    "leave one out",
                );
            }
        }
    }
}
