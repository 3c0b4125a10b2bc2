//! Watch over the response to the first commands, on the way of the samples to the log, and what follows from it.

use std::ops::ControlFlow;
use std::sync::atomic::Ordering;

use host::in_process::TickSink;
use metrics::response::ResponseWatch;
use run_client::newest::Newest;
use runtime::shared_page::Request;
use scenario::Action;
use shared_types::Topic;
use shared_types::flight_phase::FlightPhase;
use shared_types::samples::{MocapPose, RunEvent};

use super::Flight;

/// Height above the ground up to which a vehicle that answers wrongly is dropped, m.
const DROP: f64 = 0.3;

const KILLED: &str = "killed: the motors rest until the end of the run, as `flight.wrong_response` states";

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

impl Flight<'_> {
    /// Says that the vehicle answers its first commands wrongly, and acts as `flight.wrong_response` states.
    pub(super) fn react_to_wrong_response(&mut self, found: &str) {
        self.announce(format!("WRONG: {found}"));
        let block = self.supervisor.page().control_block();
        if block.stopping.load(Ordering::SeqCst) != 0 {
            return;
        }
        let flight = self.scenario.flight.as_ref();
        let stated = flight.and_then(|flight| flight.wrong_response);
        let event = "the first commands were answered wrongly, `flight.wrong_response`";
        match stated.unwrap_or(Action::Kill) {
            Action::Warn => {}
            Action::Kill if self.is_low() => {
                self.ask(Request::Kill, RunEvent::KIND_OPERATOR_KILLS, event);
                self.announce(KILLED.to_owned());
            }
            // Higher than that, a fall costs more than a landing.
            Action::Kill | Action::Land => {
                let text = self.request_end(event);
                self.announce(text);
            }
        }
    }

    /// Returns whether the vehicle is in its take-off and low enough to be dropped.
    pub(super) fn is_low(&self) -> bool {
        let pose = self.recorder.newest::<MocapPose>();
        let rise = pose.and_then(|pose| self.response.rise(&pose));
        self.phase() == Some(FlightPhase::TakeOff) && rise.is_some_and(|rise| rise < DROP)
    }
}
