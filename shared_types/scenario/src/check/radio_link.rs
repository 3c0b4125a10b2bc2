//! A transmitter whose frames a link can carry. Whether the device is there is asked when it is opened.

use std::net::SocketAddr;
use std::ops::RangeInclusive;

use super::Findings;
use crate::{Key, Mavlink, MultiModule, RadioProtocol, RcLink, Transmitter};

/// Channels that no stick takes, counted from 1.
const FREE_CHANNELS: RangeInclusive<u32> = 5..=16;

/// Frames a second that a link can be asked for, 1/s.
const FRAME_RATES: RangeInclusive<f64> = 1.0..=1000.0;

/// Speeds that a serial device can be asked for, baud.
pub(super) const BAUDS: RangeInclusive<u32> = 1200..=4_000_000;

/// Shortest time after which a command counts as lost, s: several periods of any transmitter.
const SHORTEST_SILENCE: f64 = 0.1;

/// Letters of the sticks: thrust, roll, pitch, yaw.
const STICKS: [char; 4] = ['T', 'A', 'E', 'R'];

impl RcLink {
    /// Checks the radio link of a laboratory.
    pub(super) fn check_transmitter(&self, at: &Key, found: &mut Findings) {
        let section = at.then("transmitter");
        match (&self.transmitter, self.link) {
            (None, RadioProtocol::Simulated) => {}
            (None, link) => found.add(
                at.then("link"),
                format!("nothing says where frames of `{}` go", link.name()),
                "add `[rc_output.transmitter]` with `device`, `tcp` or `udp`, or leave `link` out",
            ),
            (Some(_), RadioProtocol::Simulated) => {
                let [others @ .., last] = RadioProtocol::ALL.map(RadioProtocol::name);
                let fix = format!("say which `link` it is: {} or {last}", others.join(", "));
                found.add(section, "the simulated link has no transmitter", fix);
            }
            (Some(transmitter), link) => {
                let mut good = Findings::has_none(|found| self.check(at, found));
                good &= transmitter.check(link, &section, found);
                if good {
                    self.check_motors_stop(transmitter, &section, found);
                }
            }
        }
    }
}

impl Transmitter {
    /// Checks a transmitter. Returns whether what stops its motors can be computed.
    fn check(&self, link: RadioProtocol, at: &Key, found: &mut Findings) -> bool {
        self.check_place(link, at, found);
        self.check_rate(link, at, found);
        self.check_silence(&at.then("silence_after"), found);
        self.check_own_tables(link, at, found);
        let before = found.problems.len();
        self.check_sticks(link, at, found);
        self.check_switches(link, at, found);
        let failsafe = self.failsafe.iter().flatten();
        check_travels(link, failsafe, &at.then("failsafe"), found);
        found.problems.len() == before
    }

    /// A command that is a little late is not lost.
    fn check_silence(&self, key: &Key, found: &mut Findings) {
        if found.number(key, self.silence_after) && self.silence_after < SHORTEST_SILENCE {
            let reason = format!("after {:?} s a command is only late", self.silence_after);
            let fix = format!("give a time of at least {SHORTEST_SILENCE:?} s, such as 0.5");
            found.add(key.clone(), reason, fix);
        }
    }

    /// Frames go to one place, of a kind that the link knows.
    fn check_place(&self, link: RadioProtocol, at: &Key, found: &mut Findings) {
        let socket = link.properties().socket;
        let places = [("device", &self.device), ("tcp", &self.tcp), ("udp", &self.udp)];
        let fix = socket.map_or_else(
            || "state `device`, and nothing else".to_owned(),
            |socket| format!("state one of `device` and `{socket}`"),
        );
        let stated = places.iter().filter(|(_, place)| place.is_some());
        if stated.count() != 1 {
            found.add(at.clone(), "frames go to one place, no fewer and no more", fix);
            return;
        }
        for (name, place) in places {
            let Some(place) = place else { continue };
            if name == "device" {
                if place.is_empty() {
                    found.add(
                        at.then(name),
                        "the device has no name",
                        "give its path, such as /dev/ttyUSB0",
                    );
                }
            } else if socket != Some(name) {
                let reason = format!("`{}` does not go by `{name}`", link.name());
                found.add(at.then(name), reason, fix.clone());
            } else if place.parse::<SocketAddr>().is_err() {
                let reason = format!("`{place}` is no address with a port");
                found.add(
                    at.then(name),
                    reason,
                    "give numbers, such as 127.0.0.1:5761; names are not looked up",
                );
            }
        }
    }

    /// The line carries the frames of a second in less than a second.
    fn check_rate(&self, link: RadioProtocol, at: &Key, found: &mut Findings) {
        if let Some(baud) = self.baud {
            let key = at.then("baud");
            if self.device.is_none() {
                found.add(
                    key,
                    "only a serial device has a speed",
                    "leave `baud` out, or state `device`",
                );
                return;
            }
            if !BAUDS.contains(&baud) {
                let fix = "leave `baud` out for the link's own; 420000 is CRSF's, 115200 usual for MSP";
                found.add(key, format!("{baud} baud is no speed of a serial device"), fix);
                return;
            }
        }
        let rate = self.frame_rate_on(link);
        let key = at.then("frame_rate");
        if !FRAME_RATES.contains(&rate) {
            let reason = format!("{rate:?} frames a second are none that a link could send");
            found.add(
                key,
                reason,
                "give a rate from 1.0 to 1000.0 1/s; leave it out for the link's own",
            );
            return;
        }
        let most = f64::from(self.baud_on(link)) / f64::from(link.bits_per_frame().max(1));
        if self.device.is_some() && rate > most {
            let reason = format!(
                "at {} baud the line carries {most:.0} frames a second",
                self.baud_on(link)
            );
            found.add(
                key,
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
                    format!("`{letter}` is no stick, or stands twice"),
                    "give some of the letters A, E, T and R, such as \"ER\"",
                );
                break;
            }
            seen.push(letter);
        }
        for (name, ends) in [("thrust_ends", &self.thrust_ends), ("rate_ends", &self.rate_ends)] {
            let good = check_travels(link, ends, &at.then(name), found);
            if good && ends[0] >= ends[1] {
                found.add(
                    at.then(name),
                    format!("the travels {ends:?} are not from a lower to a higher end"),
                    "give the lower end first; `reversed` turns a stick around",
                );
            }
        }
    }

    /// Requires a separate channel for every switch.
    fn check_switches(&self, link: RadioProtocol, at: &Key, found: &mut Findings) {
        check_travels(link, &self.others, &at.then("others"), found);
        if check_travels(link, &self.arming, &at.then("arming"), found) && self.arming[0] == self.arming[1] {
            let reason = "armed and disarmed are sent alike";
            found.add(at.then("arming"), reason, "give two travels, such as [-1.0, 1.0]");
        }
        let mut taken = Vec::new();
        let arming = self
            .arming_channel
            .map(|channel| (at.then("arming_channel"), channel));
        let switches = self
            .switch
            .iter()
            .enumerate()
            .map(|(index, switch)| (at.then("switch").then(index).then("channel"), switch.channel));
        for (key, channel) in arming.into_iter().chain(switches) {
            if !FREE_CHANNELS.contains(&channel) {
                let reason = format!("{channel} is no channel beside the sticks");
                found.add(key, reason, "give a channel from 5 to 16");
            } else if taken.contains(&channel) {
                let reason = format!("channel {channel} is taken already");
                found.add(key, reason, "give every switch a separate channel");
            }
            taken.push(channel);
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

    /// Refuses the settings of one link beside another link.
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
        if let Some(multi) = &self.multi {
            multi.check(&at.then("multi"), found);
        }
        if let Some(mavlink) = &self.mavlink {
            mavlink.check(&at.then("mavlink"), found);
        }
    }
}

impl MultiModule {
    fn check(&self, at: &Key, found: &mut Findings) {
        if self.model > 15 {
            let reason = format!("a MULTI module knows no model {}", self.model);
            found.add(
                at.then("model"),
                reason,
                "give the number from 0 to 15 that the vehicle was bound as",
            );
        }
        if !(4..=12).contains(&self.channels) {
            let reason = format!("DSM does not send {} channels", self.channels);
            found.add(
                at.then("channels"),
                reason,
                "give a number from 4 to 12; 7 go out with every frame",
            );
        }
    }
}

impl Mavlink {
    fn check(&self, at: &Key, found: &mut Findings) {
        for (name, id) in [
            ("system", self.system),
            ("component", self.component),
            ("target_system", self.target_system),
            ("target_component", self.target_component),
        ] {
            if !(1..=255).contains(&id) {
                let reason = format!("{id} is no number of a system or component");
                found.add(at.then(name), reason, "give a whole number from 1 to 255");
            }
        }
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
        let reason = format!("{travel:?} is no travel of a channel of `{}`", link.name());
        let fix = format!("give travels from {:?} to {most:?}; 1 is 100 %", -most);
        found.add(key.clone(), reason, fix);
    }
    wrong.is_none()
}
