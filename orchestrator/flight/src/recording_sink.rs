//! The samples of a flight, into its log and its summary.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use host::in_process::TickSink;
use scenario::{Fault, Flight, Scenario, Target, VehicleChange};
use shared_types::samples::RunEvent;
use shared_types::{Header, Schedule, Topic};
use zerocopy::{FromZeros, IntoBytes};

use metrics::summary::FlightSummary;
use metrics::summary::faults::ReceiverFault;
use run_log::{LogError, RunLogWriter, Written};

/// Takes a second copy of every sample.
pub type Copier<'a> = &'a mut (dyn FnMut(Topic, &[u8]) + Send);

/// Takes a flight's samples in the order of the log.
pub struct RecordingSink<'a> {
    log: Option<RunLogWriter>,
    summary: FlightSummary,
    schedule: Schedule,
    /// The events that are still to happen, or have happened and are not written yet, in the order of time.
    events: VecDeque<Event>,
    /// Number of the next event in the log.
    next_event: u64,
    /// The last tick that was flown, for a display.
    progress: Arc<AtomicU64>,
    /// Takes a copy of every sample that is kept.
    copy: Option<Copier<'a>>,
    /// Returns whether the flight is to end early.
    is_over: Option<Box<dyn Fn() -> bool + Send + 'a>>,
    /// `true` if the flight is to end once the vehicle is lost. Flights in real time end by their clock all the same.
    ends_when_lost: bool,
}

/// Something that no service publishes.
struct Event {
    tick: u64,
    kind: u32,
    text: String,
}

impl<'a> RecordingSink<'a> {
    /// A sink for a flight of `scenario`, recorded to `log` if there is one; `progress` gets the
    /// last tick that was flown.
    #[must_use]
    pub fn new(
        scenario: &Scenario,
        schedule: &Schedule,
        log: Option<RunLogWriter>,
        progress: Arc<AtomicU64>,
    ) -> Self {
        Self {
            log,
            summary: FlightSummary::new(scenario, schedule),
            schedule: schedule.clone(),
            events: scheduled_events(scenario, schedule).into(),
            next_event: 0,
            progress,
            copy: None,
            is_over: None,
            ends_when_lost: scenario.limits_of_loss().end_when_lost,
        }
    }

    /// Hands every sample of the log to `copy` as well.
    #[must_use]
    pub fn with_copy(mut self, copy: Copier<'a>) -> Self {
        self.copy = Some(copy);
        self
    }

    /// Ends the flight after the tick in which `is_over` is true.
    #[must_use]
    pub fn until(mut self, is_over: impl Fn() -> bool + Send + 'a) -> Self {
        self.is_over = Some(Box::new(is_over));
        self
    }

    /// Leaves out what is scheduled before a tick: of a flight that is taken over, the rest is recorded.
    #[must_use]
    pub fn from_tick(mut self, tick: u64) -> Self {
        while self.next_event_if(|event| event.tick < tick).is_some() {}
        self.summary.begin_at(tick);
        self
    }

    /// Closes the log and hands the summary over.
    ///
    /// # Errors
    /// [`LogError`] if the log cannot be closed: it then keeps the name of an incomplete one.
    pub fn finish(self) -> (FlightSummary, Result<Option<Written>, LogError>) {
        let written = self.log.map(RunLogWriter::finish).transpose();
        (self.summary, written)
    }

    /// Leaves the log as it is, with the name of an incomplete one.
    #[must_use]
    pub fn abandon(self) -> FlightSummary {
        self.summary
    }

    #[inline]
    fn keep(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), LogError> {
        self.summary.observe(topic, bytes);
        if let Some(copy) = &mut self.copy {
            copy(topic, bytes);
        }
        match &mut self.log {
            Some(log) => {
                let written = log.write(topic, bytes);
                self.give_up_log_on_failure(written)
            }
            None => Ok(()),
        }
    }

    /// A log that has failed once is left as it is, with the name of an incomplete one: what came later would hide a gap.
    /// The summary goes on without it.
    #[inline]
    fn give_up_log_on_failure(&mut self, written: Result<(), LogError>) -> Result<(), LogError> {
        if written.is_err() {
            self.log = None;
        }
        written
    }

    fn next_event_if(&mut self, wanted: impl Fn(&Event) -> bool) -> Option<RunEvent> {
        let event = self.events.pop_front_if(|event| wanted(event))?;
        let header = Header {
            tick: event.tick,
            stamp_ns: self.schedule.time_ns(event.tick),
            seq: self.next_event,
        };
        self.next_event += 1;
        Some(run_event(header, event.kind, &event.text))
    }
}

impl TickSink for RecordingSink<'_> {
    type Error = LogError;

    #[inline]
    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), LogError> {
        self.keep(topic, bytes)
    }

    #[inline]
    fn end_tick(&mut self, tick: u64) -> Result<ControlFlow<()>, LogError> {
        // Events are the last topic of a tick.
        while let Some(mut event) = self.next_event_if(|event| event.tick <= tick) {
            (event.header.tick, event.header.stamp_ns) = (tick, self.schedule.time_ns(tick));
            self.keep(Topic::RunEvent, event.as_bytes())?;
        }
        if let Some(log) = &mut self.log {
            let written = log.end_tick(tick);
            self.give_up_log_on_failure(written)?;
        }
        self.progress.store(tick, Ordering::Relaxed);
        let is_lost = self.ends_when_lost && self.summary.loss().is_some();
        let is_over = is_lost || self.is_over.as_ref().is_some_and(|is_over| is_over());
        Ok(if is_over {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        })
    }

    fn event(&mut self, tick: u64, kind: u32, text: &str) {
        let place = self.events.partition_point(|event| event.tick <= tick);
        let text = text.to_owned();
        self.events.insert(place, Event { tick, kind, text });
    }
}

/// The events that a scenario schedules, in the order of time: a function of the scenario alone.
fn scheduled_events(scenario: &Scenario, schedule: &Schedule) -> Vec<Event> {
    let mut events = vec![(0, RunEvent::KIND_FLIGHT_STARTS, scenario.description.clone())];
    for change in &scenario.vehicle.change {
        events.push((
            scenario.tick_of(change.at),
            RunEvent::KIND_VEHICLE_CHANGES,
            describe(change),
        ));
    }
    for change in &scenario.controller.change {
        let tick = scenario.tick_of(change.at);
        events.push((tick, RunEvent::KIND_GAINS_CHANGE, change.to_string()));
    }
    events.extend(operator_requests(scenario));
    for fault in &scenario.fault {
        let (begins, ends) = if fault.kind.is_outage() {
            (RunEvent::KIND_OUTAGE_BEGINS, RunEvent::KIND_OUTAGE_ENDS)
        } else {
            (RunEvent::KIND_EDGE_FAULT_BEGINS, RunEvent::KIND_EDGE_FAULT_ENDS)
        };
        events.push((scenario.tick_of(fault.at), begins, fault.to_string()));
        if let Some(lasts) = fault.lasts {
            let text = describe_end(fault);
            events.push((scenario.tick_of(fault.at + lasts), ends, text));
        }
    }
    let faults = ReceiverFault::all(scenario);
    for fault in &faults {
        events.push((
            scenario.tick_of(fault.at),
            RunEvent::KIND_RECEIVER_FAULT_BEGINS,
            fault.words.clone(),
        ));
        // Of two of a kind that follow each other without a break the second begin says enough.
        let mut alike = faults.iter().filter(|next| next.is_spoofing == fault.is_spoofing);
        let until = fault.until.filter(|until| alike.all(|next| next.at != *until));
        if let Some(until) = until {
            let text = fault.end_in_words.clone();
            events.push((scenario.tick_of(until), RunEvent::KIND_RECEIVER_FAULT_ENDS, text));
        }
    }
    events.push((schedule.last_tick(), RunEvent::KIND_FLIGHT_ENDS, String::new()));
    events.retain(|(tick, ..)| *tick <= schedule.last_tick());
    events.sort_by_key(|(tick, ..)| *tick);
    let event = |(tick, kind, text)| Event { tick, kind, text };
    events.into_iter().map(event).collect()
}

/// Returns the events that a scenario schedules, as a log has them if nothing else happens, in the order of time.
#[must_use]
pub fn planned_events(scenario: &Scenario, schedule: &Schedule) -> Vec<RunEvent> {
    let events = scheduled_events(scenario, schedule).into_iter().zip(0..);
    let event = |(event, seq): (Event, u64)| {
        let header = Header {
            tick: event.tick,
            stamp_ns: schedule.time_ns(event.tick),
            seq,
        };
        run_event(header, event.kind, &event.text)
    };
    events.map(event).collect()
}

/// Returns the planned requests of the operator.
fn operator_requests(scenario: &Scenario) -> Vec<(u64, u32, String)> {
    let kinds = [
        (RunEvent::KIND_OPERATOR_ARMS, "the operator arms"),
        (RunEvent::KIND_OPERATOR_LANDS, "the operator lets it land"),
        (RunEvent::KIND_OPERATOR_KILLS, "the operator kills"),
    ];
    let requests = scenario.flight.iter().flat_map(Flight::requests).zip(kinds);
    requests
        .filter_map(|((_, at), (kind, words))| Some((scenario.tick_of(at?), kind, words.to_owned())))
        .collect()
}

fn run_event(header: Header, kind: u32, text: &str) -> RunEvent {
    let mut event = RunEvent {
        header,
        kind,
        ..RunEvent::new_zeroed()
    };
    let length = text.floor_char_boundary(event.text.len());
    event.text[..length].copy_from_slice(&text.as_bytes()[..length]);
    event.text_length = u32::try_from(length).expect("the text is short");
    event
}

fn describe(change: &VehicleChange) -> String {
    let mut parts = Vec::new();
    if let Some(mass) = change.mass {
        parts.push(format!("mass {mass} kg"));
    }
    if let Some([x, y, z]) = change.inertia {
        parts.push(format!("inertia [{x}, {y}, {z}] kg m²"));
    }
    if let Some([x, y, z]) = change.disturbance {
        parts.push(format!("disturbance [{x}, {y}, {z}] m/s²"));
    }
    parts.join(", ")
}

fn describe_end(fault: &Fault) -> String {
    match fault.target() {
        Some(Target::Service(service)) => format!("`{service}` is back"),
        Some(Target::Edge(edge)) => format!("`{edge}` is as it should be"),
        None => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use run_log::test_flight::scenario;
    use scenario::{FixChange, Fixes, Spoofing};

    #[test]
    fn what_the_receiver_is_planned_to_do_is_an_event() {
        let mut flown = scenario(0.001, 20.0);
        let gnss = &mut flown.sensors.get_or_insert_default().gnss;
        let kinds = [
            (1.0, Fixes::RtkFloat),
            (2.0, Fixes::SinglePoint),
            (3.0, Fixes::RtkFixed),
        ];
        gnss.change = kinds.map(|(at, kind)| FixChange { at, kind }).into();
        let velocity = [0.5, 0.0, 0.0];
        gnss.spoofing = vec![Spoofing {
            at: 4.0,
            lasts: 2.0,
            velocity,
        }];
        let events = scheduled_events(&flown, &flown.schedule().unwrap()).into_iter();
        let events: Vec<_> = events
            .filter(|event| event.kind >= RunEvent::KIND_RECEIVER_FAULT_BEGINS)
            .map(|event| {
                (
                    event.tick,
                    event.kind == RunEvent::KIND_RECEIVER_FAULT_BEGINS,
                    event.text,
                )
            })
            .collect();
        let expected = [
            (1000, true, "receiver has rtk_float fixes, not rtk_fixed"),
            (2000, true, "receiver has single_point fixes, not rtk_fixed"),
            (3000, false, "receiver has rtk_fixed fixes"),
            (4000, true, "fixes drift away by [0.5, 0, 0] m/s"),
            (6000, false, "fixes drift no more"),
        ];
        assert_eq!(
            events,
            expected.map(|(tick, begins, text)| (tick, begins, text.to_owned()))
        );
    }

    #[test]
    fn other_fixes_do_not_hide_the_end_of_spoofing() {
        let mut flown = scenario(0.001, 20.0);
        let gnss = &mut flown.sensors.get_or_insert_default().gnss;
        let kind = Fixes::RtkFloat;
        gnss.change = vec![FixChange { at: 6.0, kind }];
        let velocity = [0.5, 0.0, 0.0];
        gnss.spoofing = vec![Spoofing {
            at: 4.0,
            lasts: 2.0,
            velocity,
        }];
        let events = scheduled_events(&flown, &flown.schedule().unwrap());
        let ends = events.iter().filter(|event| event.tick == 6000);
        let mut texts: Vec<_> = ends.map(|event| &*event.text).collect();
        texts.sort_unstable();
        assert_eq!(
            texts,
            [
                "fixes drift no more",
                "receiver has rtk_float fixes, not rtk_fixed"
            ]
        );
    }

    #[test]
    fn what_the_operator_is_planned_to_ask_for_is_an_event_of_its_tick() {
        let mut flown = scenario(0.001, 20.0);
        let kinds = |scenario: &Scenario| -> Vec<_> {
            let events = scheduled_events(scenario, &scenario.schedule().unwrap()).into_iter();
            events
                .filter(|event| event.kind >= RunEvent::KIND_OPERATOR_ARMS)
                .map(|event| (event.tick, event.kind))
                .collect()
        };
        assert_eq!(kinds(&flown), []);
        flown.flight = Some(Flight {
            arm_at: Some(0.5),
            kill_at: Some(3.0),
            ..Flight::default()
        });
        assert_eq!(
            kinds(&flown),
            [
                (500, RunEvent::KIND_OPERATOR_ARMS),
                (3000, RunEvent::KIND_OPERATOR_KILLS)
            ]
        );
    }
}
