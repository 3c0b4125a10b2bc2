//! The last events of a flight, for clients.

use std::collections::VecDeque;

use crate::snapshot::LiveEvent;

/// Number of events kept.
const EVENTS: usize = 50;

/// Last events, the newest last.
#[derive(Debug, Default)]
pub struct LiveEvents(VecDeque<LiveEvent>);

impl LiveEvents {
    /// Appends an event at a time of the flight, s; line breaks are replaced.
    pub fn keep(&mut self, time: f64, text: &str) {
        if self.0.len() == EVENTS {
            self.0.pop_front();
        }
        let text = text.lines().collect::<Vec<_>>().join("; ");
        self.0.push_back(LiveEvent { time, text });
    }

    /// Returns the events.
    #[must_use]
    pub fn all(&self) -> Vec<LiveEvent> {
        self.0.iter().cloned().collect()
    }
}
