//! The news of a flight: the newest of each kind, for any number of readers.
//!
//! A reader that is slow misses what came meanwhile and gets the newest: nothing is kept for it, and nobody waits for it.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::foxglove::Moment;

/// Frames that are kept for readers that come later. When there are more, every second one is forgotten.
const PAST: usize = 600;

/// A kind of news, in the order in which a reader gets them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The flight that the others are about.
    Flight,
    /// What has happened in it.
    Marks,
    /// The state of services, cameras and link.
    Status,
    /// The vehicle and its signals.
    Frame,
    /// Whether the run answers, and whether it has ended.
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

    /// Returns the name on the wire.
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

/// The news that a reader has not had yet: the name of each and its text, in their order.
pub type Unread = Vec<(&'static str, Arc<str>)>;

/// The newest news of each kind.
#[derive(Debug, Default)]
pub struct Board {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// Number of the last news.
    last: u64,
    news: [News; Kind::ALL.len()],
    past: Past,
    /// The newest samples themselves, and their number.
    moment: Option<(u64, Arc<Moment>)>,
    readers: usize,
    is_over: bool,
}

#[derive(Debug, Default)]
struct News {
    /// 0 if there is none.
    number: u64,
    text: Arc<str>,
}

/// Frames of the flight so far, evenly thinned.
#[derive(Debug)]
struct Past {
    frames: Vec<Arc<str>>,
    /// Of so many frames one is kept.
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
        if self.frames.len() > PAST {
            let mut place = 0;
            self.frames.retain(|_| {
                place += 1;
                place % 2 == 1
            });
            self.stride *= 2;
        }
    }
}

/// Someone who reads the board, for as long as this lives.
#[derive(Debug)]
pub struct Reader<'a> {
    board: &'a Board,
    seen: [u64; Kind::ALL.len()],
    seen_moment: u64,
}

impl Board {
    fn state(&self) -> MutexGuard<'_, State> {
        // A thread that panicked left whole news behind.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts up news. A flight makes all earlier news past.
    pub fn put(&self, kind: Kind, text: String) {
        let text: Arc<str> = text.into();
        let mut state = self.state();
        match kind {
            Kind::Flight => {
                state.past = Past::default();
                state.news = Default::default();
            }
            Kind::Frame => state.past.keep(&text),
            Kind::Marks | Kind::Status | Kind::Contact => {}
        }
        state.last += 1;
        let number = state.last;
        state.news[kind as usize] = News { number, text };
        drop(state);
        self.changed.notify_all();
    }

    /// Puts up the newest samples, for those who want them as they are.
    pub fn put_moment(&self, moment: Moment) {
        let mut state = self.state();
        state.last += 1;
        state.moment = Some((state.last, Arc::new(moment)));
        drop(state);
        self.changed.notify_all();
    }

    /// Says that no more news will come.
    pub fn end(&self) {
        self.state().is_over = true;
        self.changed.notify_all();
    }

    /// Adds a reader, unless there are `most` already.
    #[must_use]
    pub fn read(&self, most: usize) -> Option<Reader<'_>> {
        let mut state = self.state();
        if state.readers >= most {
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

    /// Returns how many readers there are.
    #[must_use]
    pub fn readers(&self) -> usize {
        self.state().readers
    }

    /// Waits until no reader is left, but no longer than `limit`.
    pub fn await_no_reader(&self, limit: Duration) {
        let waited = self
            .changed
            .wait_timeout_while(self.state(), limit, |state| state.readers > 0);
        drop(waited);
    }
}

impl Reader<'_> {
    /// Waits for news, but no longer than `limit`. None when no more will come; empty after the limit.
    #[must_use]
    pub fn wait(&mut self, limit: Duration) -> Option<Unread> {
        let seen = self.seen;
        let is_unread = |state: &State| state.news.iter().zip(seen).any(|(news, seen)| news.number > seen);
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

    /// Waits for samples, but no longer than `limit`. None when no more will come; `Some(None)` after the limit.
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
            let (news, seen) = (&state.news[kind as usize], &mut self.seen[kind as usize]);
            if news.number <= *seen {
                continue;
            }
            *seen = news.number;
            unread.push((kind.name(), Arc::clone(&news.text)));
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
        board.put(Kind::Frame, "1".to_owned());
        board.put(Kind::Frame, "2".to_owned());
        board.put(Kind::Status, "s".to_owned());
        let unread = reader.wait(AT_ONCE).unwrap();
        assert_eq!(names(&unread), [("status", "s"), ("frame", "2")]);
        assert_eq!(reader.wait(AT_ONCE).unwrap(), []);

        board.put(Kind::Flight, "f".to_owned());
        board.put(Kind::Frame, "3".to_owned());
        board.put(Kind::Frame, "4".to_owned());
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
        board.put(Kind::Contact, "ended".to_owned());
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
            board.put(Kind::Frame, "1".to_owned());
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
            prop_assert!(kept.len() <= PAST && (frames < 2 || kept.len() as u64 >= frames.min(PAST as u64 / 2)));
            prop_assert!(kept.iter().enumerate().all(|(place, &frame)| frame == place as u64 * past.stride));
            prop_assert!(frames - kept.last().unwrap() <= past.stride);
        }
    }
}
