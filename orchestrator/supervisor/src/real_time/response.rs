//! Watch over the response to the first commands, on the way of the samples to the log.

use std::ops::ControlFlow;

use host::in_process::TickSink;
use metrics::response::ResponseWatch;
use shared_types::Topic;

/// Sink that shows the samples to a watch before it passes them on.
pub(super) struct WatchedSink<'a, S> {
    sink: &'a mut S,
    response: &'a mut ResponseWatch,
    /// Verdict that one of the samples led to.
    found: Option<String>,
}

impl<'a, S> WatchedSink<'a, S> {
    pub(super) fn new(sink: &'a mut S, response: &'a mut ResponseWatch) -> Self {
        Self {
            sink,
            response,
            found: None,
        }
    }

    /// Returns the verdict that the samples led to, if any.
    pub(super) fn found(self) -> Option<String> {
        self.found
    }
}

impl<S: TickSink> TickSink for WatchedSink<'_, S> {
    type Error = S::Error;

    fn wants(&self, topic: Topic) -> bool {
        self.sink.wants(topic)
    }

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), S::Error> {
        if let Some(found) = self.response.observe(topic, bytes) {
            self.found = Some(found.to_owned());
        }
        self.sink.sample(topic, bytes)
    }

    fn end_tick(&mut self, tick: u64) -> Result<ControlFlow<()>, S::Error> {
        self.sink.end_tick(tick)
    }

    fn event(&mut self, tick: u64, kind: u32, text: &str) {
        self.sink.event(tick, kind, text);
    }
}
