//! Arming, and the messages on decisions of transmitter and path generator.

use std::cell::RefCell;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::SystemTime;

use metrics::summary::{cause_in_words, limit_in_words, not_ready_in_words};
use shared_types::ServiceId;
use shared_types::flight_phase::{FlightPhase, NotReady};
use shared_types::rotation::tilt;
use shared_types::samples::{PathReference, RcFrame, RunEvent, VehicleState};
use shared_types::service::Operator;

use super::Flight;
use super::kill_switch::KillSwitch;
use decisions::arming::{self, Situation};
use hand_test::record::HandTestRecord;
use run_client::newest::Newest;
use run_client::snapshot::NOT_READY;
use scenario::{RadioProtocol, Scenario};

/// The hand test that a scenario names. It may be done during the run, and its result is asked for at every look at the flight:
/// the file is read when it is another one than before.
pub(super) struct HandTestFile {
    path: PathBuf,
    newest: RefCell<Option<(Option<FileState>, Rc<ReadRecord>)>>,
}

type ReadRecord = Result<HandTestRecord, String>;

/// Time of the last change, and length; `None` without a file.
type FileState = (SystemTime, u64);

impl HandTestFile {
    /// Makes the file of a scenario; `None` if it names none.
    pub(super) fn new(scenario: &Scenario) -> Option<Self> {
        let path = scenario.flight.as_ref()?.hand_test.as_ref()?.into();
        Some(Self {
            path,
            newest: RefCell::default(),
        })
    }

    fn read(&self) -> Rc<ReadRecord> {
        let state = std::fs::metadata(&self.path)
            .ok()
            .and_then(|file| Some((file.modified().ok()?, file.len())));
        let mut newest = self.newest.borrow_mut();
        match &*newest {
            Some((of, record)) if *of == state => Rc::clone(record),
            _ => {
                let record = Rc::new(HandTestRecord::read(&self.path));
                *newest = Some((state, Rc::clone(&record)));
                record
            }
        }
    }
}

impl Flight<'_> {
    /// Returns why the vehicle may not be armed now, if so.
    pub(super) fn refusal_to_arm(&self) -> Option<String> {
        let elapsed_ns = self.clock.elapsed_ns();
        let block = self.supervisor.page().control_block();
        let mut services = ServiceId::ALL.into_iter();
        let (frame, state) = (self.recorder.newest(), self.recorder.newest());
        let hand_test = self.hand_test.as_ref().map(HandTestFile::read);
        let situation = Situation {
            operator: self.operator(),
            shutdown: self.conduct.shutdown(),
            time_left: self.time_to_the_end(),
            elapsed_ns,
            phase: self.phase(),
            frame: frame.as_ref(),
            state: state.as_ref(),
            missing: services.find(|&service| !self.supervisor.flies(service)),
            kill_switch: self.kill_switch.as_ref().and_then(KillSwitch::loss),
            laboratory: self.laboratory.failure(block, elapsed_ns),
            hand_test: hand_test
                .as_deref()
                .map(|read| read.as_ref().map_err(String::as_str)),
        };
        arming::refusal(self.scenario, &situation)
    }

    /// After a take-over, the motors may turn, and a landing continues that was requested from the previous orchestrator:
    /// the request is still in the control block.
    pub(super) fn inherit_landing(&mut self) {
        let asked = self
            .supervisor
            .page()
            .control_block()
            .operator(Operator::default());
        self.conduct.inherit(asked.land);
        if asked.land {
            // The log of this flight lacks the event of that request.
            let by = "requested before another orchestrator took over".into();
            self.pending_events
                .push((self.recorder.ticks(), RunEvent::KIND_OPERATOR_LANDS, by));
        }
    }

    /// Returns the operator's requests, both planned and sent.
    pub(super) fn operator(&self) -> Operator {
        let planned = self.schedule.operator().at(self.clock.tick());
        self.supervisor.page().control_block().operator(planned)
    }

    /// Returns whether the motors may turn: the operator has armed, and the vehicle was not disarmed since.
    pub(super) fn is_armed(&self) -> bool {
        self.operator().armed && self.phase() != Some(FlightPhase::Disarmed)
    }

    /// Announces each decision of the transmitter and of the path generator that ends a flight or an arming, with its
    /// cause.
    pub(super) fn announce_decisions(&mut self) {
        if let Some(frame) = self.recorder.newest::<RcFrame>()
            && std::mem::replace(&mut self.last_action, frame.action) != frame.action
        {
            let limit = (frame.limit != RcFrame::LIMIT_NONE).then(|| limit_in_words(frame.limit));
            match (frame.action, limit) {
                (RcFrame::ACTION_LAND, Some(limit)) => self.announce(format!("{limit}: the vehicle lands")),
                (RcFrame::ACTION_KILL, Some(limit)) => {
                    self.announce(format!("{limit}: the motors are stopped for good"));
                }
                (RcFrame::ACTION_WARN, Some(limit)) if frame.limit == RcFrame::LIMIT_BATTERY => {
                    self.announce(limit);
                }
                // Requests were announced before.
                _ => {}
            }
            let locks = self.scenario.radio_link() == Some(RadioProtocol::Crazyflie);
            if frame.action == RcFrame::ACTION_KILL && locks {
                let text = "the Crazyflie is locked: end the run, then switch the vehicle off and on";
                self.announce(text.to_owned());
            }
        }
        let Some(reference) = self.recorder.newest::<PathReference>() else {
            return;
        };
        let is_lost = reference.airborne.is_set() && !reference.vehicle_known.is_set();
        if std::mem::replace(&mut self.was_lost, is_lost) != is_lost {
            if is_lost {
                let text =
                    "the position of the vehicle is unknown: it levels, then descends, as `[safety]` states";
                self.announce(text.to_owned());
            } else if reference.vehicle_known.is_set() {
                self.announce("the position of the vehicle is known again".to_owned());
            }
        }
        let decision = (reference.phase, reference.cause);
        if self.scenario.flight.is_none() || std::mem::replace(&mut self.last_decision, decision) == decision
        {
            return;
        }
        if let Some(found) = NotReady::from_cause(reference.cause) {
            let state = self.recorder.newest::<VehicleState>();
            let why = match state.zip(self.scenario.flight.as_ref()) {
                Some((state, flight)) => {
                    let is_inertial = self.scenario.navigation.is_some();
                    not_ready_in_words(found, tilt(&state.world_from_body), flight.tilt_max, is_inertial)
                }
                None => found.words().to_owned(),
            };
            self.record_event(&format!("{NOT_READY}, {why}"));
            let run = &self.run;
            let text = format!(
                "The vehicle was not ready and is disarmed: {why}. Arm again: gerono arm --run {run}"
            );
            self.clients.messages.show(text);
        }
        match reference.cause {
            PathReference::CAUSE_OVERDUE | PathReference::CAUSE_TOUCHED_DOWN => {
                let phase = FlightPhase::from_code(reference.phase).name();
                if let Some(cause) = cause_in_words(reference.cause) {
                    self.announce(format!("{phase}: {cause}"));
                }
            }
            // Requests and the envelope's demands were announced before.
            _ => {}
        }
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use super::*;

    #[test]
    fn a_hand_test_that_was_done_after_the_first_look_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let file = HandTestFile {
            path: folder.path().join("hand_test.json"),
            newest: RefCell::default(),
        };
        let [first, second] = [file.read(), file.read()];
        assert!(first.is_err() && Rc::ptr_eq(&first, &second), "read once");
        std::fs::write(&file.path, "{}").unwrap();
        let done = file.read();
        assert!(!Rc::ptr_eq(&first, &done));
        assert_ne!(first.as_ref().as_ref().err(), done.as_ref().as_ref().err());
        assert!(Rc::ptr_eq(&done, &file.read()));
    }
}
