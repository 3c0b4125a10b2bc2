//! Receiver of Vicon's stream, which is sent without a request.
//!
//! A full datagram may be followed by another with the same number and other objects. The datagrams of such a frame are
//! all incomplete: a body that is absent in one of them is not necessarily occluded.

use std::net::SocketAddrV4;
use std::os::fd::BorrowedFd;

use super::decode;
use crate::transport::udp::Udp;
use crate::transport::{Address, CaptureSource, TransportError, WireCounts};
use crate::wire::{Frame, MAX_BODIES, Name};

/// Datagrams without a continuation after which frames count as complete again.
const COMPLETE_AFTER: u32 = 1000;

/// Receiver of the stream.
#[derive(Debug)]
pub(crate) struct Source {
    socket: Udp,
    frame: Frame,
    split_frames: SplitFrames,
    counts: WireCounts,
}

/// Detector of frames that are split into several datagrams.
#[derive(Debug)]
struct SplitFrames {
    number: Option<u32>,
    /// Objects of the datagrams with this number.
    names: Vec<Name>,
    since_continued: u32,
}

impl SplitFrames {
    fn new() -> Self {
        Self {
            number: None,
            names: Vec::with_capacity(MAX_BODIES),
            since_continued: COMPLETE_AFTER,
        }
    }

    /// Adds the frame of the next datagram, and marks it if it may be incomplete. Returns whether it continues the previous
    /// one.
    fn add(&mut self, frame: &mut Frame) -> bool {
        let is_known = |name: &Name| self.names.contains(name);
        let continues = self.number == frame.number
            && !frame.bodies().is_empty()
            && !frame.bodies().iter().any(|body| is_known(&body.name));
        if continues {
            self.since_continued = 0;
        } else {
            self.names.clear();
            self.since_continued = self.since_continued.saturating_add(1);
        }
        self.number = frame.number;
        let room = MAX_BODIES - self.names.len();
        self.names
            .extend(frame.bodies().iter().take(room).map(|body| body.name));
        frame.is_complete = self.since_continued >= COMPLETE_AFTER;
        continues
    }
}

impl Source {
    pub(crate) fn open(address: &Address) -> Result<Self, TransportError> {
        let at = SocketAddrV4::new(address.interface, address.server.port());
        Ok(Self {
            socket: Udp::open(at, *address.server.ip())?,
            frame: Frame::new(),
            split_frames: SplitFrames::new(),
            counts: WireCounts::default(),
        })
    }

    #[cfg(test)]
    pub(crate) fn port(&self) -> u16 {
        self.socket.port()
    }
}

impl CaptureSource for Source {
    fn poll(&mut self, _now_ns: u64, sink: &mut dyn FnMut(&Frame)) {
        let (frame, split_frames) = (&mut self.frame, &mut self.split_frames);
        self.socket.receive(&mut self.counts, |datagram, counts| {
            match decode(datagram, frame) {
                Ok(()) => {
                    counts.frames += 1;
                    counts.continued += u64::from(split_frames.add(frame));
                    sink(frame);
                }
                Err(error) => counts.malformed.add(error),
            }
        });
    }

    fn descriptors(&self) -> [Option<BorrowedFd<'_>>; 2] {
        [Some(self.socket.descriptor()), None]
    }

    fn due_ns(&self) -> Option<u64> {
        None
    }

    fn counts(&self) -> WireCounts {
        self.counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::WireBody;

    fn datagram(number: u32, names: &[&str]) -> Frame {
        let mut frame = Frame::new();
        frame.number = Some(number);
        for name in names {
            let body = WireBody {
                name: Name::new(name.as_bytes()).unwrap(),
                number: 0,
                pose: None,
            };
            frame.push(body).unwrap();
        }
        frame
    }

    /// Returns whether each datagram continues the one before, and whether its frame is complete.
    fn taken(split_frames: &mut SplitFrames, datagrams: &[(u32, &[&str])]) -> Vec<(bool, bool)> {
        let taken = datagrams.iter().map(|(number, names)| {
            let mut frame = datagram(*number, names);
            (split_frames.add(&mut frame), frame.is_complete)
        });
        taken.collect()
    }

    #[test]
    fn a_frame_in_two_datagrams_is_complete_in_neither() {
        let mut split_frames = SplitFrames::new();
        let (first, second): (&[&str], &[&str]) = (&["a", "b"], &["quad"]);
        let frames = [
            (1, first),
            (1, second),
            (2, first),
            (2, second),
            (3, second),
            (3, first),
        ];
        assert_eq!(
            taken(&mut split_frames, &frames),
            [
                (false, true),
                (true, false),
                (false, false),
                (true, false),
                (false, false),
                (true, false)
            ]
        );
        // Until the block was made larger.
        let whole: &[&str] = &["a", "b", "quad"];
        let frames: Vec<(u32, &[&str])> = (4..2000).map(|number| (number, whole)).collect();
        assert_eq!(taken(&mut split_frames, &frames).last(), Some(&(false, true)));
    }

    #[test]
    fn a_datagram_that_the_network_repeats_is_no_continuation() {
        let mut split_frames = SplitFrames::new();
        let both: &[&str] = &["quad", "wand"];
        let frames = [(1, both), (1, both), (2, both), (2, &[][..])];
        assert_eq!(taken(&mut split_frames, &frames), [(false, true); 4]);
    }
}
