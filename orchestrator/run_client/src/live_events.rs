//! The last events of a flight, for people at other terminals.

use std::collections::VecDeque;

use crate::snapshot::LiveEvent;

/// Events that are kept.
const EVENTS: usize = 50;

/// The last events, the newest last.
#[derive(Debug, Default)]
pub struct LiveEvents(VecDeque<LiveEvent>);

impl LiveEvents {
    /// Keeps an event of a time of the flight, s; as one line, whatever the text is.
    pub fn keep(&mut self, time: f64, text: &str) {
        if self.0.len() == EVENTS {
            self.0.pop_front();
        }
        let text = text.lines().collect::<Vec<_>>().join("; ");
        self.0.push_back(LiveEvent { time, text });
    }

    /// Returns all of them.
    #[must_use]
    pub fn all(&self) -> Vec<LiveEvent> {
        self.0.iter().cloned().collect()
    }
}
