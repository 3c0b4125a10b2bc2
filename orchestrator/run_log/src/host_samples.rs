//! The machine's record, as samples of `host.mcap`.

use shared_types::ServiceId;
use shared_types::battery::BatteryReading;
pub use shared_types::capture_figures::CaptureFigures;
use shared_types::checkpoint::{CAPACITY, Checkpoint};
use shared_types::sample::Record;
use shared_types::schedule::MAX_PORTS;
use zerocopy::FromZeros;

/// Sample of `host.mcap`; it begins with its time.
pub trait HostSample: Record {
    /// Name of its channel.
    const CHANNEL: &'static str;

    /// Wall time since the start of the run, ns.
    fn time_ns(&self) -> u64 {
        let time = self.as_bytes().first_chunk().expect("it begins with its time");
        u64::from_le_bytes(*time)
    }
}

shared_types::sample! {
    /// Something that happened to a run's processes.
    pub struct HostEvent {
        /// Wall time since the start of the run, ns.
        pub time_ns: u64,
        #[values(SERVICE_NONE = 255)]
        /// Position of the service in the wiring table.
        pub service: u32,
        #[values(
            KIND_NOTE = 0, KIND_SPAWNED = 1, KIND_READY = 2, KIND_EXITED = 3, KIND_KILLED = 4, KIND_FINISHED = 5,
            KIND_REBORN = 6, KIND_HUNG = 7
        )]
        /// The kind of event.
        pub kind: u32,
        /// Process id of the service, 0 if there is none.
        pub pid: u32,
        /// Length of `text`, bytes.
        pub text_length: u32,
        /// The event, in words, UTF-8, filled up with zeros.
        pub text: [u8; 200],
    }

    /// The health of a service's process; all counts since its start.
    pub struct ServiceHealth {
        /// Wall time since the start of the run, ns.
        pub time_ns: u64,
        /// Position of the service in the wiring table.
        pub service: u32,
        /// Process id.
        pub pid: u32,
        /// Last base tick that the service has stepped.
        pub tick: u64,
        /// Steps.
        pub steps: u64,
        /// Waits that ended while yielding the core.
        pub waits_by_yield: u64,
        /// Waits that ended after sleeping.
        pub waits_by_blocking: u64,
        /// CPU time of the process, user and system, ns.
        pub cpu_time_ns: u64,
    }

    /// One step of a service in real time: what it consumed and when.
    pub struct ServiceStep {
        /// Wall time since the start of the run, ns.
        pub time_ns: u64,
        /// When it began, ns since the start of the flight: its time had come, and what it waited for was here or given up.
        pub began_ns: u64,
        /// When all that it had to publish was published, ns since the start of the flight; 0 if the process died before.
        pub published_ns: u64,
        /// Tick of the step.
        pub tick: u64,
        /// 1 + the tick of the step before it that the service remembers; 0 if there is none.
        pub previous: u64,
        /// Of each input, 1 + the sequence number of the sample that it saw; 0 if it saw none. The upper halves are those of
        /// inputs 4 to 7.
        pub consumed: [u64; 4],
        /// Position of the service in the wiring table.
        pub service: u32,
        /// Steps before it that were left out because their time had passed.
        pub missed: u32,
        /// Inputs of its own tick that had not come when it was given up waiting for them: bit i for input i.
        pub late_inputs: u32,
        /// Inputs of which it saw another sample than the step before: bit i for input i.
        pub fresh_inputs: u32,
        /// The operator's requests: bit 0 armed, bit 1 land, bit 2 killed; from bit 3 on the number of requests to arm,
        /// modulo 32; from bit 8 on the number of the last change of gains that held.
        pub operator: u32,
        /// Explicit padding.
        pub pad0: u32,
    }

    /// A piece of a checkpoint: of what a service knew before a step. The pieces of one follow each other.
    pub struct ServiceCheckpoint {
        /// Wall time since the start of the run, ns.
        pub time_ns: u64,
        /// Tick of the first step that the state does not know of.
        pub next_tick: u64,
        /// The number that tells the layout of the state from any other.
        pub layout: u64,
        /// Position of the service in the wiring table.
        pub service: u32,
        /// Bytes of the whole state.
        pub length: u32,
        /// Bytes of it in the pieces before.
        pub offset: u32,
        /// Explicit padding.
        pub pad0: u32,
        /// The bytes from there on, after the last of them zeros.
        pub state: [u8; 1024],
    }

    /// The performance of a laboratory's radio link; all counts since the start of the process that drives it.
    pub struct LinkFigures {
        /// Wall time since the start of the run, ns.
        pub time_ns: u64,
        #[values(STATE_UNKNOWN = 0, STATE_OPEN = 1, STATE_LOST = 2)]
        /// Nobody has driven it yet; there is something that takes frames, or it is gone.
        pub state: u32,
        /// Explicit padding.
        pub pad0: u32,
        /// Frames on their way.
        pub sent: u64,
        /// Frames dropped, because others waited or nothing took them.
        pub dropped: u64,
        /// Frames that were not sent, so that the receiver's failsafe acts.
        pub silent: u64,
        /// Frames left out because the sender woke up too late.
        pub left_out: u64,
        /// Number of times that the device or connection was lost.
        pub losses: u64,
        /// Number of times that it was found again.
        pub recoveries: u64,
        /// The lateness below which half of the frames left, s; known at the end only, as the next two.
        pub late_p50: f64,
        /// The lateness below which 99 of 100 left, s.
        pub late_p99: f64,
        /// The largest lateness, s.
        pub late_max: f64,
    }
}

impl LinkFigures {
    /// Returns the battery that the link has measured, if there has been a voltage. It stands in the padding, and not in the
    /// message definition, which would change the layout of every log.
    #[must_use]
    pub fn battery(&self) -> Option<BatteryReading> {
        BatteryReading::from_word(self.pad0)
    }
}

const _: () = assert!(
    shared_types::schedule::MAX_PORTS <= 8,
    "a step tells of each input"
);

impl ServiceStep {
    /// Packs what each input saw, as [`consumed`](Self::consumed) has it. A flight has fewer samples than 2³².
    #[must_use]
    pub fn packed(seen: [u64; MAX_PORTS]) -> [u64; 4] {
        let mut consumed = [0; 4];
        for (input, number) in seen.into_iter().enumerate() {
            consumed[input % 4] |= (number & u64::from(u32::MAX)) << (32 * (input / 4));
        }
        consumed
    }

    /// Returns what an input saw: 1 + the sequence number of the sample; 0 if it saw none.
    #[must_use]
    pub fn seen(&self, input: usize) -> u64 {
        self.consumed[input % 4] >> (32 * (input / 4)) & u64::from(u32::MAX)
    }
}

impl HostEvent {
    /// Makes an event of a service or, without one, of the run; truncates a text that is too long.
    #[must_use]
    pub fn new(time_ns: u64, service: Option<ServiceId>, kind: u32, pid: u32, text: &str) -> Self {
        let mut event = Self {
            time_ns,
            service: service.map_or(Self::SERVICE_NONE, |service| service.index() as u32),
            kind,
            pid,
            ..Self::new_zeroed()
        };
        let length = text.floor_char_boundary(event.text.len());
        event.text[..length].copy_from_slice(&text.as_bytes()[..length]);
        event.text_length = length as u32;
        event
    }
}

impl HostSample for HostEvent {
    const CHANNEL: &'static str = "host/events";
}

impl HostSample for ServiceStep {
    const CHANNEL: &'static str = "host/steps";
}

impl HostSample for ServiceHealth {
    const CHANNEL: &'static str = "host/health";
}

impl HostSample for ServiceCheckpoint {
    const CHANNEL: &'static str = "host/checkpoints";
}

impl HostSample for CaptureFigures {
    const CHANNEL: &'static str = "host/motion_capture";
}

impl HostSample for LinkFigures {
    const CHANNEL: &'static str = "host/radio_link";
}

/// Bytes of a state in a piece of its checkpoint.
const PIECE: usize = 1024;

/// A checkpoint as it was logged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoggedCheckpoint {
    /// The service.
    pub service: ServiceId,
    /// Identifier of the state's layout.
    pub layout: u64,
    /// The checkpoint.
    pub checkpoint: Checkpoint,
}

impl LoggedCheckpoint {
    /// Splits the checkpoint into pieces, in order, at a time since the start of the run.
    pub fn pieces(&self, time_ns: u64) -> impl Iterator<Item = ServiceCheckpoint> {
        let state = &self.checkpoint.state;
        state.chunks(PIECE).enumerate().map(move |(number, bytes)| {
            let mut piece = ServiceCheckpoint {
                time_ns,
                next_tick: self.checkpoint.next_tick,
                layout: self.layout,
                service: self.service.index() as u32,
                length: state.len() as u32,
                offset: (number * PIECE) as u32,
                ..ServiceCheckpoint::new_zeroed()
            };
            piece.state[..bytes.len()].copy_from_slice(bytes);
            piece
        })
    }
}

/// Assembler of checkpoints. One with a missing piece is never completed.
#[derive(Debug, Default)]
pub(super) struct PieceByPiece {
    begun: Option<LoggedCheckpoint>,
}

impl PieceByPiece {
    /// Adds the next piece of the log. Returns the checkpoint that it completes, if any.
    pub(super) fn take(&mut self, piece: &ServiceCheckpoint) -> Option<LoggedCheckpoint> {
        let service = *ServiceId::ALL.get(piece.service as usize)?;
        let length = Some(piece.length as usize).filter(|&length| length <= CAPACITY)?;
        let mut whole = match self.begun.take() {
            Some(begun) if piece.offset > 0 => begun,
            _ => LoggedCheckpoint {
                service,
                layout: piece.layout,
                checkpoint: Checkpoint {
                    next_tick: piece.next_tick,
                    state: Vec::new(),
                },
            },
        };
        let Checkpoint { next_tick, state } = &mut whole.checkpoint;
        let follows = (whole.service, whole.layout, *next_tick) == (service, piece.layout, piece.next_tick)
            && state.len() == piece.offset as usize;
        if !follows {
            return None;
        }
        let missing = length.saturating_sub(state.len());
        state.extend_from_slice(&piece.state[..missing.min(PIECE)]);
        if state.len() == length {
            return Some(whole);
        }
        self.begun = Some(whole);
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_text_is_cut_only_where_a_character_ends(text in "\\PC{0,150}") {
            let event = HostEvent::new(0, None, HostEvent::KIND_NOTE, 0, &text);
            let kept = std::str::from_utf8(&event.text[..event.text_length as usize]).unwrap();
            prop_assert!(text.starts_with(kept));
            let next = text[kept.len()..].chars().next().map_or(0, char::len_utf8);
            prop_assert!(kept.len() == text.len() || kept.len() + next > event.text.len());
            prop_assert!(event.text[kept.len()..].iter().all(|&byte| byte == 0));
        }

        #[test]
        fn checkpoints_come_back_from_their_pieces_and_none_of_which_one_is_missing(
            lengths in proptest::collection::vec(1..5000usize, 1..6),
            lost in 0..20usize,
        ) {
            let written: Vec<_> = lengths.iter().enumerate().map(|(number, &length)| LoggedCheckpoint {
                service: ServiceId::ALL[number % ServiceId::ALL.len()],
                layout: 7,
                checkpoint: Checkpoint {
                    next_tick: number as u64,
                    state: (0..length).map(|at| (at * 7 + number) as u8).collect(),
                },
            }).collect();
            let pieces: Vec<_> = written.iter().flat_map(|checkpoint| checkpoint.pieces(3)).collect();
            let read = |pieces: &[ServiceCheckpoint]| -> Vec<_> {
                let mut reader = PieceByPiece::default();
                pieces.iter().filter_map(|piece| reader.take(piece)).collect()
            };
            prop_assert_eq!(&read(&pieces), &written);

            let mut rest = pieces;
            let lost = rest.remove(lost % rest.len());
            let mut expected = written;
            expected.retain(|checkpoint| checkpoint.checkpoint.next_tick != lost.next_tick);
            prop_assert_eq!(read(&rest), expected);
        }
    }
}
