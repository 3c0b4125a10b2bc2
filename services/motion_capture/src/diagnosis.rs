//! Diagnosis: why a capture system's packets give no pose of the vehicle, as a message.
//!
//! `gerono mocap probe`, the refusal to arm, live views, the log and the summary show the same message. It allocates
//! nothing: its state has a fixed size.

use std::fmt::{Display, Formatter, Result};

use scenario::{CaptureSystem, MotionCapture, Problem};

use crate::feed::{PosePart, Selector};
use crate::refusals::Tally;
use crate::transport::CaptureSource;
use crate::wire::{Frame, Name, PoseError};

/// Distance from the origin beyond which the unit is probably wrong, m.
pub const FAR: f64 = 30.0;

/// Frames of the vehicle with the same stamp after which the server's clock counts as stopped.
const REPEATED_STAMPS: u32 = 20;

/// Statistics of the frames so far.
#[derive(Clone, Debug)]
pub struct Diagnosis {
    selector: Selector,
    name: Name,
    /// Refused poses of the vehicle.
    vehicle: Tally<PoseError>,
    /// Refused poses of other bodies.
    others: Tally<PoseError>,
    is_present: bool,
    /// Name of a body that is similar to the vehicle's.
    similar: Option<Name>,
    /// Distance of the vehicle's last pose from the origin, m.
    distance: f64,
    last_stamp_ns: Option<i64>,
    /// Frames of the vehicle with the same stamp as the previous one, and with another.
    repeated_stamps: u32,
    new_stamps: u32,
}

impl Diagnosis {
    /// Makes a diagnosis of a checked scenario before the first frame.
    ///
    /// # Errors
    /// If the scenario was not checked.
    pub fn new(system: CaptureSystem, config: &MotionCapture) -> std::result::Result<Self, Problem> {
        let name = config.name_and_number().map_or("", |(name, _)| name);
        Ok(Self {
            selector: Selector::new(system, config)?,
            name: Name::truncated(name.as_bytes()),
            vehicle: Tally::default(),
            others: Tally::default(),
            is_present: false,
            similar: None,
            distance: 0.0,
            last_stamp_ns: None,
            repeated_stamps: 0,
            new_stamps: 0,
        })
    }

    /// Adds the next frame.
    pub fn add(&mut self, frame: &Frame) {
        for (body, reason) in frame.refused() {
            if self.selector.matches(body) {
                self.vehicle.add(reason);
            } else {
                self.others.add(reason);
            }
        }
        if let Some(body) = frame.bodies().iter().find(|body| self.selector.matches(body)) {
            self.is_present = true;
            if let Some(pose) = &body.pose {
                self.distance = pose.position.norm();
            }
            self.add_stamp(frame);
        } else if !self.is_present && self.similar.is_none() {
            let mut names = frame.bodies().iter().map(|body| &body.name);
            self.similar = names.find(|name| is_similar(name, &self.name)).copied();
        }
    }

    fn add_stamp(&mut self, frame: &Frame) {
        let Some(stamp) = frame.stamp else {
            return;
        };
        if self.last_stamp_ns.replace(stamp.sent_ns) == Some(stamp.sent_ns) {
            self.repeated_stamps = self.repeated_stamps.saturating_add(1);
        } else {
            self.new_stamps = self.new_stamps.saturating_add(1);
        }
    }

    /// Returns the refused poses of the vehicle, by reason.
    #[must_use]
    pub fn vehicle(&self) -> &Tally<PoseError> {
        &self.vehicle
    }

    /// Returns the refused poses of all other bodies, by reason.
    #[must_use]
    pub fn others(&self) -> &Tally<PoseError> {
        &self.others
    }

    /// Returns the constant stamp of a server whose clock is stopped, ns.
    #[must_use]
    pub fn stopped_stamp(&self) -> Option<i64> {
        let is_stopped = self.repeated_stamps >= REPEATED_STAMPS
            && self.repeated_stamps / REPEATED_STAMPS >= self.new_stamps;
        self.last_stamp_ns.filter(|_| is_stopped)
    }

    /// Returns the findings for display, including those of the source; empty if there are none. `frozen` is the frozen
    /// part of the vehicle's pose.
    #[must_use]
    pub fn with<'a>(&'a self, source: &'a dyn CaptureSource, frozen: Option<PosePart>) -> Findings<'a> {
        Findings {
            diagnosis: self,
            source,
            frozen,
        }
    }
}

/// Returns whether two different names are equal up to case, blanks, punctuation and non-ASCII letters.
fn is_similar(name: &Name, expected: &Name) -> bool {
    fn letters(name: &Name) -> impl Iterator<Item = u8> {
        let bytes = name.as_bytes().iter();
        bytes
            .filter(|byte| byte.is_ascii_alphanumeric())
            .map(u8::to_ascii_lowercase)
    }
    name != expected && letters(expected).next().is_some() && letters(name).eq(letters(expected))
}

/// Findings, separated by semicolons, the most severe first.
#[derive(Clone, Copy, Debug)]
pub struct Findings<'a> {
    diagnosis: &'a Diagnosis,
    source: &'a dyn CaptureSource,
    frozen: Option<PosePart>,
}

impl Display for Findings<'_> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        let diagnosis = self.diagnosis;
        let mut list = List {
            formatter,
            is_first: true,
        };
        let malformed = self.source.counts().malformed;
        if malformed.total() > 0 {
            list.add(format_args!("packets refused: {malformed}"))?;
        }
        if diagnosis.vehicle.total() > 0 {
            list.add(format_args!(
                "poses of the vehicle refused: {}",
                diagnosis.vehicle
            ))?;
        }
        match self.frozen {
            Some(PosePart::Attitude) => list.add(format_args!(
                "the attitude of `{}` does not change: is it tracked by a single marker?",
                diagnosis.name
            ))?,
            Some(PosePart::Pose) => list.add(format_args!(
                "the pose of `{}` does not change: the server repeats it, or simulated cameras have no noise",
                diagnosis.name
            ))?,
            None => {}
            Some(part @ PosePart::Coordinate(_)) => list.add(format_args!(
                "the {part} of `{}` in the cameras' frame does not change",
                diagnosis.name
            ))?,
            Some(part) => list.add(format_args!("the {part} of `{}` does not change", diagnosis.name))?,
        }
        if !diagnosis.is_present {
            self.names(&mut list)?;
        }
        if let Some(stamp_ns) = diagnosis.stopped_stamp() {
            #[expect(clippy::cast_precision_loss, reason = "shown to a millisecond")]
            let stamp = stamp_ns as f64 * 1e-9;
            list.add(format_args!(
                "the server's clock does not run: its stamp is always {stamp:.3} s"
            ))?;
        }
        if diagnosis.distance > FAR {
            list.add(format_args!(
                "the vehicle is {:.0} m from the origin: centimetres or millimetres?",
                diagnosis.distance
            ))?;
        }
        self.source.findings(&mut |finding| list.add(finding))?;
        if diagnosis.others.total() > 0 {
            list.add(format_args!(
                "poses of other bodies refused: {}",
                diagnosis.others
            ))?;
        }
        Ok(())
    }
}

impl Findings<'_> {
    /// Adds the reason why no frame contains the vehicle's name.
    fn names(&self, list: &mut List<'_, '_>) -> Result {
        let expected = self.diagnosis.name;
        let (mut ambiguous, mut similar) = (None, None);
        self.source.announced(&mut |body| {
            let reason = body.ambiguity.filter(|_| *body.name == expected);
            ambiguous = ambiguous.or(reason.zip(body.number));
            if similar.is_none() && is_similar(body.name, &expected) {
                similar = Some((*body.name, body.number));
            }
        });
        if let Some((reason, number)) = ambiguous {
            return list.add(format_args!("{reason}: select it by `#{number}`, or rename it"));
        }
        match similar.or(self.diagnosis.similar.map(|name| (name, None))) {
            Some((name, number)) => {
                let number = number.map_or_else(String::new, |number| format!(", which is `#{number}`"));
                list.add(format_args!(
                    "announced: `{name}`{number}, nearly `{expected}`: state the name as the server has it"
                ))
            }
            None => Ok(()),
        }
    }
}

/// Writer of a list that is separated by semicolons.
struct List<'a, 'b> {
    formatter: &'a mut Formatter<'b>,
    is_first: bool,
}

impl List<'_, '_> {
    fn add(&mut self, part: std::fmt::Arguments<'_>) -> Result {
        if !std::mem::replace(&mut self.is_first, false) {
            self.formatter.write_str("; ")?;
        }
        self.formatter.write_fmt(part)
    }
}

#[cfg(test)]
mod tests {
    use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};

    use nalgebra::Matrix3;

    use super::*;
    use crate::natnet::{ServerInfo, Version, message, sender};
    use crate::transport::Address;
    use crate::wire::{CapturePose, Stamp, WireBody};

    fn stated(system: CaptureSystem, object: &str) -> MotionCapture {
        MotionCapture::new(system, Ipv4Addr::LOCALHOST, object)
    }

    /// A source to which nothing has been sent.
    fn silent(system: CaptureSystem, port: u16) -> Box<dyn CaptureSource> {
        let address = Address {
            system,
            server: SocketAddrV4::new(Ipv4Addr::LOCALHOST, port),
            interface: Ipv4Addr::LOCALHOST,
        };
        address.open().unwrap()
    }

    fn frame(name: &str, position: [f64; 3], stamp_ns: i64) -> Frame {
        let mut frame = Frame::new();
        frame.stamp = Some(Stamp {
            exposed_ns: stamp_ns,
            sent_ns: stamp_ns,
        });
        let name = Name::new(name.as_bytes()).unwrap();
        let pose = CapturePose::new(position, Matrix3::identity()).map(Some);
        frame.push_pose(name, 0, pose).unwrap();
        frame
    }

    /// Returns the text after these frames.
    fn said(object: &str, frames: &[Frame]) -> String {
        let source = silent(CaptureSystem::Vrpn, 9);
        let mut diagnosis =
            Diagnosis::new(CaptureSystem::Vrpn, &stated(CaptureSystem::Vrpn, object)).unwrap();
        for frame in frames {
            diagnosis.add(frame);
        }
        diagnosis.with(&*source, None).to_string()
    }

    #[test]
    fn a_good_stream_has_no_findings() {
        let frames: Vec<Frame> = (0..100)
            .map(|k| frame("quad", [1.0, 2.0, 3.0], k * 10_000_000))
            .collect();
        assert_eq!(said("quad", &frames), "");
    }

    #[test]
    fn units_names_and_stamps_that_cannot_work_are_named() {
        let similar = frame("Quad ", [0.0; 3], 0);
        assert_eq!(
            said("quad", &[similar]),
            "announced: `Quad `, nearly `quad`: state the name as the server has it"
        );
        let millimetres = frame("quad", [0.0, 1234.0, 0.0], 0);
        assert_eq!(
            said("quad", &[millimetres]),
            "poses of the vehicle refused: 1 times 1234 m from the origin: millimetres?"
        );
        let centimetres = frame("quad", [0.0, 118.0, 0.0], 0);
        assert_eq!(
            said("quad", &[centimetres]),
            "the vehicle is 118 m from the origin: centimetres or millimetres?"
        );
        let untimed = vec![frame("quad", [0.0; 3], 0); 50];
        assert_eq!(
            said("quad", &untimed),
            "the server's clock does not run: its stamp is always 0.000 s"
        );
        let stranger = frame("wand", [2000.0, 0.0, 0.0], 0);
        assert_eq!(
            said("quad", &[stranger, frame("quad", [0.0; 3], 1)]),
            "poses of other bodies refused: 1 times 2000 m from the origin: millimetres?"
        );
    }

    #[test]
    fn bodies_of_one_stamp_are_not_a_time_that_stands_still() {
        let mut frames = Vec::new();
        for k in 0..100 {
            frames.extend((0..40).map(|body| frame(&format!("body{body}"), [0.0; 3], k)));
            frames.push(frame("quad", [0.0; 3], k));
        }
        assert_eq!(said("quad", &frames), "");
    }

    /// Returns the text after a server of a version has answered, and described these bodies.
    fn said_by_motive(version: Version, described: &[(i32, &str)], object: &str) -> String {
        let server = UdpSocket::bind("127.0.0.1:0").unwrap();
        server
            .set_read_timeout(Some(std::time::Duration::from_secs(60)))
            .unwrap();
        let mut source = silent(CaptureSystem::Natnet, server.local_addr().unwrap().port());
        let info = ServerInfo {
            version,
            clock_frequency: 1_000_000,
            data_port: UdpSocket::bind("127.0.0.1:0")
                .unwrap()
                .local_addr()
                .unwrap()
                .port(),
            multicast: None,
        };
        let mut question = [0; 64];
        let mut now_ns = 0;
        let mut packets = 0;
        let wanted = if described.is_empty() { 1 } else { 2 };
        while packets < wanted {
            source.poll(now_ns, &mut |_| ());
            let (_, client) = server.recv_from(&mut question).unwrap();
            let answer = match u16::from_le_bytes([question[0], question[1]]) {
                message::CONNECT => sender::server_info(&info),
                _ => sender::names(version, described),
            };
            server.send_to(&answer, client).unwrap();
            while source.counts().packets == packets {
                source.poll(now_ns, &mut |_| ());
            }
            packets = source.counts().packets;
            now_ns += 1_000_000_000;
        }
        let system = CaptureSystem::Natnet;
        let diagnosis = Diagnosis::new(system, &stated(system, object)).unwrap();
        diagnosis.with(&*source, None).to_string()
    }

    #[test]
    fn a_version_that_is_not_understood_is_named() {
        for (major, minor) in [(2, 8), (5, 0)] {
            let said = said_by_motive(Version { major, minor }, &[], "quad");
            let words = format!(
                "packets refused: 1 times Motive sends NatNet {major}.{minor}; 3.x and 4.x are supported"
            );
            assert_eq!(said, words);
        }
        let newer = said_by_motive(Version { major: 4, minor: 9 }, &[], "quad");
        assert_eq!(newer, "NatNet 4.9 is newer than 4.2, the newest tested version");
    }

    #[test]
    fn a_name_that_cannot_be_chosen_is_offered_by_its_number() {
        let version = Version { major: 4, minor: 1 };
        let shared = said_by_motive(version, &[(7, "quad"), (8, "quad")], "quad");
        assert_eq!(
            shared,
            "another body has the same name or id: select it by `#7`, or rename it"
        );
        let blank = said_by_motive(version, &[(7, "Quad ")], "quad");
        assert_eq!(
            blank,
            "announced: `Quad `, which is `#7`, nearly `quad`: state the name as the server has it"
        );
    }

    #[test]
    fn a_body_that_is_not_the_vehicle_gives_no_distance() {
        let mut frame = frame("wand", [100.0, 0.0, 0.0], 0);
        frame
            .push(WireBody {
                name: Name::new(b"quad").unwrap(),
                number: 0,
                pose: None,
            })
            .unwrap();
        assert_eq!(said("quad", &[frame]), "");
    }
}
