//! Checks of the transmitter of a laboratory. Opening the device checks whether it exists.

use std::net::SocketAddr;

use super::Findings;
use crate::{CrazyflieUri, CrazyflieUriError, Key, RadioProtocol, RcLink, Transmitter};

/// Letters of the sticks: thrust, roll, pitch, yaw.
const STICKS: [char; 4] = ['T', 'A', 'E', 'R'];

impl RcLink {
    /// Checks the radio link of a laboratory, and that its motors stop if the calibration is valid.
    pub(super) fn check_transmitter(&self, is_calibrated: bool, at: &Key, found: &mut Findings) {
        let section = at.then("transmitter");
        match (&self.transmitter, self.link) {
            (None, RadioProtocol::Simulated) => {}
            (None, link) => found.add(
                at.then("link"),
                format!("the destination of the frames of `{}` is not stated", link.name()),
                "add `[rc_output.transmitter]` with `device`, `tcp`, `udp` or `uri`, or leave `link` out",
            ),
            (Some(_), RadioProtocol::Simulated) => {
                let [others @ .., last] = RadioProtocol::ALL.map(RadioProtocol::name);
                let fix = format!("state the `link`: {} or {last}", others.join(", "));
                found.add(section, "the simulated link has no transmitter", fix);
            }
            (Some(transmitter), link) => {
                if transmitter.check(link, &section, found) && is_calibrated {
                    self.check_motors_stop(transmitter, &section, found);
                }
            }
        }
    }
}

impl Transmitter {
    /// Checks a transmitter. Returns whether the frames that stop its motors can be computed.
    fn check(&self, link: RadioProtocol, at: &Key, found: &mut Findings) -> bool {
        self.check_destination(link, at, found);
        self.check_rate(link, at, found);
        self.check_own_tables(link, at, found);
        let before = found.problems.len();
        self.check_sticks(link, at, found);
        self.check_switches(link, at, found);
        let failsafe = self.failsafe.iter().flatten();
        check_travels(link, failsafe, &at.then("failsafe"), found);
        found.problems.len() == before
    }

    /// Requires one destination of a kind that the link supports.
    fn check_destination(&self, link: RadioProtocol, at: &Key, found: &mut Findings) {
        let properties = link.properties();
        let destinations = [
            ("device", &self.device),
            ("tcp", &self.tcp),
            ("udp", &self.udp),
            ("uri", &self.uri),
        ];
        let fix = match (properties.serial, properties.socket) {
            (true, Some(socket)) => format!("state one of `device` and `{socket}`"),
            (false, Some(socket)) => format!("state `{socket}`, and nothing else"),
            (_, None) => "state `device`, and nothing else".to_owned(),
        };
        let stated = destinations
            .iter()
            .filter(|(_, destination)| destination.is_some());
        if stated.count() != 1 {
            found.add(at.clone(), "frames need exactly one destination", fix);
            return;
        }
        for (name, destination) in destinations {
            let Some(destination) = destination else { continue };
            let is_supported = if name == "device" {
                properties.serial
            } else {
                properties.socket == Some(name)
            };
            if !is_supported {
                let reason = format!("`{}` is not sent by `{name}`", link.name());
                found.add(at.then(name), reason, fix.clone());
            } else if name == "device" {
                if destination.is_empty() {
                    found.add(
                        at.then(name),
                        "the device has no name",
                        "give its path, such as /dev/ttyUSB0",
                    );
                }
            } else if name == "uri" {
                check_uri(destination, &at.then(name), found);
            } else if destination.parse::<SocketAddr>().is_err() {
                let reason = format!("`{destination}` is not an address with a port");
                found.add(
                    at.then(name),
                    reason,
                    "give numbers, such as 127.0.0.1:5761; names are not resolved",
                );
            }
        }
    }

    /// Requires a baud rate that is sufficient for the frame rate.
    fn check_rate(&self, link: RadioProtocol, at: &Key, found: &mut Findings) {
        if self.baud.is_some() && self.device.is_none() {
            found.add(
                at.then("baud"),
                "only a serial device has a baud rate",
                "leave `baud` out, or state `device`",
            );
        }
        if !found.are_in_range(at, &["baud", "frame_rate"]) {
            return;
        }
        let rate = self.frame_rate_on(link);
        let most = f64::from(self.baud_on(link)) / f64::from(link.bits_per_frame().max(1));
        if self.device.is_some() && rate > most {
            let reason = format!(
                "at {} baud the line carries {most:.0} frames per second",
                self.baud_on(link)
            );
            found.add(
                at.then("frame_rate"),
                reason,
                format!("give a rate of at most {most:.0} 1/s, or raise `baud`"),
            );
        }
    }

    fn check_sticks(&self, link: RadioProtocol, at: &Key, found: &mut Findings) {
        let mut letters: Vec<char> = self.order.chars().collect();
        letters.sort_unstable();
        let mut sticks = STICKS;
        sticks.sort_unstable();
        if letters != sticks {
            found.add(
                at.then("order"),
                format!("{:?} does not name every stick once", self.order),
                "give an order of A, E, T and R, such as \"AETR\" or \"TAER\"",
            );
        }
        let mut seen = Vec::new();
        for letter in self.reversed.chars() {
            if !STICKS.contains(&letter) || seen.contains(&letter) {
                found.add(
                    at.then("reversed"),
                    format!("`{letter}` is not a stick, or is listed twice"),
                    "give some of the letters A, E, T and R, such as \"ER\"",
                );
                break;
            }
            seen.push(letter);
        }
        for (name, ends) in [("thrust_ends", &self.thrust_ends), ("rate_ends", &self.rate_ends)] {
            let is_valid = check_travels(link, ends, &at.then(name), found);
            if is_valid && ends[0] >= ends[1] {
                found.add(
                    at.then(name),
                    format!("the travels {ends:?} are not from a lower to a higher end"),
                    "give the lower end first; `reversed` reverses a stick",
                );
            }
        }
    }

    /// Requires a separate channel for every switch.
    fn check_switches(&self, link: RadioProtocol, at: &Key, found: &mut Findings) {
        check_travels(link, &self.others, &at.then("others"), found);
        if check_travels(link, &self.arming, &at.then("arming"), found) && self.arming[0] == self.arming[1] {
            let reason = "armed and disarmed have the same travel";
            found.add(at.then("arming"), reason, "give two travels, such as [-1.0, 1.0]");
        }
        let mut used = Vec::new();
        let arming = self
            .arming_channel
            .map(|channel| (at.then("arming_channel"), channel));
        let switches = self
            .switch
            .iter()
            .enumerate()
            .map(|(index, switch)| (at.then("switch").then(index).then("channel"), switch.channel));
        for (key, channel) in arming.into_iter().chain(switches) {
            if used.contains(&channel) {
                let reason = format!("channel {channel} is already in use");
                found.add(key, reason, "give every switch a separate channel");
            }
            used.push(channel);
        }
        for (index, switch) in self.switch.iter().enumerate() {
            check_travels(
                link,
                &[switch.travel],
                &at.then("switch").then(index).then("travel"),
                found,
            );
        }
    }

    /// Refuses the settings of another link.
    fn check_own_tables(&self, link: RadioProtocol, at: &Key, found: &mut Findings) {
        for (owner, is_stated) in [
            (RadioProtocol::Multi, self.multi.is_some()),
            (RadioProtocol::Mavlink, self.mavlink.is_some()),
        ] {
            if is_stated && owner != link {
                let reason = format!("the link is `{}`", link.name());
                let fix = format!("leave `{}` out, or change `rc_output.link`", owner.name());
                found.add(at.then(owner.name()), reason, fix);
            }
        }
    }
}

/// Requires the address of a Crazyflie.
fn check_uri(uri: &str, key: &Key, found: &mut Findings) {
    if let Err(reason) = uri.parse::<CrazyflieUri>() {
        let fix = match reason {
            CrazyflieUriError::Address(_) => {
                "give numbers, such as udp://127.0.0.1:19850; names are not resolved"
            }
            _ => {
                "give an address such as radio://0/80/2M/E7E7E7E7E7, or udp://127.0.0.1:19850 of a simulator"
            }
        };
        found.add(key.clone(), format!("`{uri}`: {reason}"), fix);
    }
}

fn check_travels<'a>(
    link: RadioProtocol,
    travels: impl IntoIterator<Item = &'a f64>,
    key: &Key,
    found: &mut Findings,
) -> bool {
    let most = link.properties().largest_travel;
    let mut travels = travels.into_iter();
    let wrong = travels.find(|travel| !(-most..=most).contains(*travel));
    if let Some(travel) = wrong {
        let reason = format!("{travel:?} is not a travel of a channel of `{}`", link.name());
        let fix = format!("give travels from {:?} to {most:?}; 1 is 100 %", -most);
        found.add(key.clone(), reason, fix);
    }
    wrong.is_none()
}
