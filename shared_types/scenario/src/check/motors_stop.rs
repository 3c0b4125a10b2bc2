//! Checks that the motors stop: with the frames that stop them, and in the receiver's failsafe.

use super::{Findings, six_digits};
use crate::{Key, RadioProtocol, RcLink, ThrustChannel, Transmitter};

/// Share of the largest thrust up to which motors count as stopped, because fitted calibrations are not exact.
const STOPPED: f64 = 0.01;

/// Travel of a lost or missing channel at a receiver: −100 %.
const ABSENT: f64 = -1.0;

impl RcLink {
    /// Checks that the motors of an otherwise valid link stop.
    pub(super) fn check_motors_stop(&self, transmitter: &Transmitter, at: &Key, found: &mut Findings) {
        if transmitter.has_channels(self.link) {
            self.check_channel(transmitter, at, found);
        } else {
            self.check_normalised_thrust(transmitter, at, found);
        }
    }

    /// Returns whether a thrust, N, turns the motors.
    fn turns_motors(&self, thrust: f64) -> bool {
        thrust > STOPPED * (self.thrust_offset + self.thrust_slope.abs())
    }

    fn check_channel(&self, transmitter: &Transmitter, at: &Key, found: &mut Findings) {
        let channel = ThrustChannel::new(self, transmitter);
        let least = channel.thrust(channel.motors_off());
        let stated = transmitter.failsafe.map(|[travel, ..]| travel);
        let stopped = stated.map_or(least, |travel| channel.thrust(travel));
        // With an arming switch a link may have no travel without thrust.
        if let Some(travel) = stated
            && self.turns_motors(stopped - least.max(0.0))
        {
            let newtons = six_digits(stopped);
            let reason = format!("a travel of {travel:?} of the thrust channel commands {newtons} N");
            let fix = format!(
                "leave `failsafe` out, or give {:?} as its first travel, which commands the least thrust",
                channel.motors_off()
            );
            found.add(at.then("failsafe"), reason, fix);
            return;
        }
        if transmitter.arming_channel.is_some() {
            return;
        }
        let absent = channel.thrust(ABSENT);
        if self.turns_motors(stopped) {
            let reason = format!(
                "no switch stops the motors, and the least thrust of the channel is {} N",
                six_digits(stopped)
            );
            let fix = "state `arming_channel`, or check `thrust_offset` and `thrust_slope`";
            found.add(at.then("arming_channel"), reason, fix);
        } else if self.turns_motors(absent) {
            let reason = format!(
                "no switch stops the motors, and a receiver that has lost the link sets the thrust channel to -100 %, \
                 which commands {} N",
                six_digits(absent)
            );
            let fix = "state `arming_channel`, or reverse the thrust channel at the receiver, so that -100 % is no thrust";
            found.add(at.then("arming_channel"), reason, fix);
        }
    }

    /// Checks a message without channels but with a normalised thrust, of which 0 stops the motors: `SET_ATTITUDE_TARGET`
    /// and the packets of a Crazyflie.
    fn check_normalised_thrust(&self, transmitter: &Transmitter, at: &Key, found: &mut Findings) {
        let least = self.thrust_offset - self.thrust_slope.abs();
        let is_mavlink = self.link == RadioProtocol::Mavlink;
        if self.turns_motors(least) {
            let reason = format!(
                "a thrust of 0 stops the motors, but would command {} N",
                six_digits(least)
            );
            let fix = "check `thrust_offset` and `thrust_slope`: a thrust of 0 is a travel of -1, or of 1 if the slope is negative";
            let key = if is_mavlink {
                at.then("mavlink").then("message")
            } else {
                at.then("uri")
            };
            found.add(key, reason, fix);
        }
        for (name, is_stated) in [
            ("arming_channel", transmitter.arming_channel.is_some()),
            ("switch", !transmitter.switch.is_empty()),
            ("others", transmitter.others.is_some()),
            ("failsafe", transmitter.failsafe.is_some()),
        ] {
            if is_stated {
                let (reason, fix) = if is_mavlink {
                    (
                        "the message `attitude_target` has no channels",
                        format!("leave `{name}` out, or state `mavlink.message = \"rc_override\"`"),
                    )
                } else {
                    (
                        "the packets of `crazyflie` have no channels",
                        format!("leave `{name}` out"),
                    )
                };
                found.add(at.then(name), reason, fix);
            }
        }
    }
}
