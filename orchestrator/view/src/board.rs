//! The newest message of each kind, shared with any number of readers.
//!
//! A slow reader skips messages and gets the newest: nothing is queued for it, and no writer waits for it.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::foxglove::Moment;

/// Maximum number of frames kept for later readers. When there are more, every second one is dropped.
const MAX_PAST: usize = 600;

/// Kind of message, in the order in which a reader gets them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The flight that the other messages belong to.
    Flight,
    /// Events of the flight.
    Marks,
    /// State of services, cameras and radio link.
    Status,
    /// State of the vehicle, and its signals.
    Frame,
    /// Connection to the run: whether it answers, and whether it has ended.
    Contact,
}

impl Kind {
    const ALL: [Self; 5] = [
        Self::Flight,
        Self::Marks,
        Self::Status,
        Self::Frame,
        Self::Contact,
    ];

    /// Returns the event name in the stream.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Flight => "flight",
            Self::Marks => "marks",
            Self::Status => "status",
            Self::Frame => "frame",
            Self::Contact => "contact",
        }
    }
}

/// Name and text of each message that a reader has not received yet, in the order of their kinds.
pub type Unread = Vec<(&'static str, Arc<str>)>;

/// Newest message of each kind.
#[derive(Debug, Default)]
pub struct Board {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// Number of the last message.
    last: u64,
    messages: [Message; Kind::ALL.len()],
    past: Past,
    /// The newest samples, and the message number.
    moment: Option<(u64, Arc<Moment>)>,
    readers: usize,
    is_over: bool,
}

#[derive(Debug, Default)]
struct Message {
    /// 0 before the first message.
    number: u64,
    text: Arc<str>,
}

/// Frames of the flight so far, decimated evenly.
#[derive(Debug)]
struct Past {
    frames: Vec<Arc<str>>,
    /// Every `stride`-th frame is kept.
    stride: u64,
    seen: u64,
}

impl Default for Past {
    fn default() -> Self {
        Self {
            frames: Vec::new(),
            stride: 1,
            seen: 0,
        }
    }
}

impl Past {
    fn keep(&mut self, frame: &Arc<str>) {
        if self.seen.is_multiple_of(self.stride) {
            self.frames.push(Arc::clone(frame));
        }
        self.seen += 1;
        if self.frames.len() > MAX_PAST {
            let mut place = 0;
            self.frames.retain(|_| {
                place += 1;
                place % 2 == 1
            });
            self.stride *= 2;
        }
    }
}

/// Registered reader of the board; dropping it unregisters it.
#[derive(Debug)]
pub struct Reader<'a> {
    board: &'a Board,
    seen: [u64; Kind::ALL.len()],
    seen_moment: u64,
}

impl Board {
    fn state(&self) -> MutexGuard<'_, State> {
        // The mutex may be poisoned, but the state is consistent: no panic is possible in the middle of a change.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Posts a message. A new flight removes all earlier messages.
    pub fn post(&self, kind: Kind, text: String) {
        let text: Arc<str> = text.into();
        let mut state = self.state();
        match kind {
            Kind::Flight => {
                state.past = Past::default();
                state.messages = Default::default();
            }
            Kind::Frame => state.past.keep(&text),
            Kind::Marks | Kind::Status | Kind::Contact => {}
        }
        state.last += 1;
        let number = state.last;
        state.messages[kind as usize] = Message { number, text };
        drop(state);
        self.changed.notify_all();
    }

    /// Posts the newest samples for clients of the Foxglove protocol.
    pub fn post_moment(&self, moment: Moment) {
        let mut state = self.state();
        state.last += 1;
        state.moment = Some((state.last, Arc::new(moment)));
        drop(state);
        self.changed.notify_all();
    }

    /// Ends the board: no more messages will follow.
    pub fn end(&self) {
        self.state().is_over = true;
        self.changed.notify_all();
    }

    /// Registers a reader; `None` if there are `maximum` already.
    #[must_use]
    pub fn read(&self, maximum: usize) -> Option<Reader<'_>> {
        let mut state = self.state();
        if state.readers >= maximum {
            return None;
        }
        state.readers += 1;
        drop(state);
        self.changed.notify_all();
        Some(Reader {
            board: self,
            seen: [0; Kind::ALL.len()],
            seen_moment: 0,
        })
    }

    /// Returns the number of readers.
    #[must_use]
    pub fn readers(&self) -> usize {
        self.state().readers
    }

    /// Waits up to `limit` until no reader is left.
    pub fn await_no_reader(&self, limit: Duration) {
        let waited = self
            .changed
            .wait_timeout_while(self.state(), limit, |state| state.readers > 0);
        drop(waited);
    }
}

impl Reader<'_> {
    /// Waits up to `limit` for messages. `None` once the board has ended and all were read; empty after the timeout.
    #[must_use]
    pub fn wait(&mut self, limit: Duration) -> Option<Unread> {
        let seen = self.seen;
        let is_unread = |state: &State| {
            state
                .messages
                .iter()
                .zip(seen)
                .any(|(message, seen)| message.number > seen)
        };
        let waits = |state: &mut State| !state.is_over && !is_unread(state);
        let waited = self
            .board
            .changed
            .wait_timeout_while(self.board.state(), limit, waits);
        let (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        if state.is_over && !is_unread(&state) {
            return None;
        }
        Some(self.take(&state))
    }

    /// Waits up to `limit` for samples. `None` once the board has ended; `Some(None)` after the timeout.
    #[must_use]
    pub fn wait_for_moment(&mut self, limit: Duration) -> Option<Option<Arc<Moment>>> {
        let seen = self.seen_moment;
        let unread = |state: &State| state.moment.as_ref().is_some_and(|(number, _)| *number > seen);
        let waits = |state: &mut State| !state.is_over && !unread(state);
        let waited = self
            .board
            .changed
            .wait_timeout_while(self.board.state(), limit, waits);
        let (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        match &state.moment {
            Some((number, moment)) if *number > seen => {
                self.seen_moment = *number;
                Some(Some(Arc::clone(moment)))
            }
            _ if state.is_over => None,
            _ => Some(None),
        }
    }

    fn take(&mut self, state: &State) -> Unread {
        let mut unread = Unread::new();
        for kind in Kind::ALL {
            let (message, seen) = (&state.messages[kind as usize], &mut self.seen[kind as usize]);
            if message.number <= *seen {
                continue;
            }
            *seen = message.number;
            unread.push((kind.name(), Arc::clone(&message.text)));
            if kind == Kind::Flight && !state.past.frames.is_empty() {
                let frames = state.past.frames.join(",");
                unread.push(("past", format!("[{frames}]").into()));
            }
        }
        unread
    }
}

impl Drop for Reader<'_> {
    fn drop(&mut self) {
        self.board.state().readers -= 1;
        self.board.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const AT_ONCE: Duration = Duration::ZERO;

    fn names(unread: &Unread) -> Vec<(&str, &str)> {
        unread.iter().map(|(name, text)| (*name, &**text)).collect()
    }

    #[test]
    fn a_reader_gets_the_newest_of_each_kind_once_and_the_flight_first() {
        let board = Board::default();
        let mut reader = board.read(1).unwrap();
        board.post(Kind::Frame, "1".to_owned());
        board.post(Kind::Frame, "2".to_owned());
        board.post(Kind::Status, "s".to_owned());
        let unread = reader.wait(AT_ONCE).unwrap();
        assert_eq!(names(&unread), [("status", "s"), ("frame", "2")]);
        assert_eq!(reader.wait(AT_ONCE).unwrap(), []);

        board.post(Kind::Flight, "f".to_owned());
        board.post(Kind::Frame, "3".to_owned());
        board.post(Kind::Frame, "4".to_owned());
        let unread = reader.wait(AT_ONCE).unwrap();
        assert_eq!(
            names(&unread),
            [("flight", "f"), ("past", "[3,4]"), ("frame", "4")]
        );
    }

    #[test]
    fn a_reader_too_many_is_refused_until_another_leaves() {
        let board = Board::default();
        let first = board.read(2).unwrap();
        let _second = board.read(2).unwrap();
        assert!(board.read(2).is_none());
        drop(first);
        assert!(board.read(2).is_some());
        assert_eq!(board.readers(), 1);
    }

    #[test]
    fn the_last_news_are_read_before_the_end() {
        let board = Board::default();
        let mut reader = board.read(1).unwrap();
        board.post(Kind::Contact, "ended".to_owned());
        board.end();
        assert_eq!(
            names(&reader.wait(Duration::MAX).unwrap()),
            [("contact", "ended")]
        );
        assert!(reader.wait(Duration::MAX).is_none());
        drop(reader);
        board.await_no_reader(Duration::MAX);
    }

    #[test]
    fn news_wake_a_reader_that_waits() {
        let board = Board::default();
        let mut reader = board.read(1).unwrap();
        std::thread::scope(|scope| {
            let waiting = scope.spawn(move || reader.wait(Duration::from_secs(60)));
            board.post(Kind::Frame, "1".to_owned());
            let unread = waiting.join().unwrap().unwrap();
            assert_eq!(names(&unread), [("frame", "1")]);
        });
    }

    proptest! {
        #[test]
        fn the_past_is_bounded_evenly_spaced_and_begins_with_the_first(frames in 1..10_000_u64) {
            let mut past = Past::default();
            for frame in 0..frames {
                past.keep(&frame.to_string().into());
            }
            let kept: Vec<u64> = past.frames.iter().map(|frame| frame.parse().unwrap()).collect();
            prop_assert!(kept.len() <= MAX_PAST && (frames < 2 || kept.len() as u64 >= frames.min(MAX_PAST as u64 / 2)));
            prop_assert!(kept.iter().enumerate().all(|(place, &frame)| frame == place as u64 * past.stride));
            prop_assert!(frames - kept.last().unwrap() <= past.stride);
        }
    }
}
