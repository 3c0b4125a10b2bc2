//! The last events of a flight, for people at other terminals.

use std::collections::VecDeque;

use live::snapshot::LiveEvent;

use crate::supervision::Supervisor;

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

    /// Keeps the last death of a service.
    pub fn keep_death(&mut self, time: f64, supervisor: &Supervisor<'_>) {
        if let Some((Some(service), pid, exit)) = supervisor.exits().last() {
            let name = supervisor.name_of(*service);
            self.keep(
                time,
                &format!("`{name}` (process {pid}) died: {}", exit.description),
            );
        }
    }

    /// Returns all of them.
    #[must_use]
    pub fn all(&self) -> Vec<LiveEvent> {
        self.0.iter().cloned().collect()
    }
}
