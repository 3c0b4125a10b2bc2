//! Answers to the questions of clients.

use std::borrow::Cow;

use runtime::shared_page::Request;
use shared_types::flight_phase::FlightPhase;
use shared_types::samples::{RcFrame, RunEvent, VehicleState};
use shared_types::service::{Operator, seconds};

use super::Flight;
use run_client::newest::Newest;
use run_client::snapshot::ServiceSnapshot;
use run_client::{Answer, Description, Question, Snapshot};
use runtime::control::Host;

/// Ratio of the measured position deviation on the ground to the configured one above which arming warns. The filter
/// uses a quarter of the measured variance, so the cameras then scatter three times as much as configured.
const NOISIER: f64 = 1.5;

impl Flight<'_> {
    pub(super) fn answer(&mut self, question: Question) -> Answer {
        match question {
            Question::Look => Answer::Snapshot(Box::new(self.snapshot())),
            Question::Describe => Answer::Description(Box::new(Description::new(
                self.scenario,
                Host::RealTime,
                Some(self.clock.start_ns),
                self.schedule.published_topics(),
            ))),
            Question::Watch => Answer::Newest(self.recorder.newest_samples()),
            Question::Operate(request) => self.operate(request),
            Question::Stop => {
                self.record_event("`gerono stop` requested the end of the flight");
                let answer = self.request_end("gerono stop");
                Answer::Done(format!("{}\n{answer}", self.identity()))
            }
            Question::Set(settings) => self.tune(&settings),
            Question::Get(names) => self.tuned(&names),
            Question::KillService(name) => self.break_service(&name, Break::Kill),
            Question::FreezeService(name) => self.break_service(&name, Break::Freeze),
        }
    }

    fn operate(&mut self, request: Request) -> Answer {
        if request == Request::Arm
            && let Some(reason) = self.refusal_to_arm()
        {
            return Answer::Refused(format!("not armed: {reason} ({})", self.identity()));
        }
        let (kind, event, text) = match request {
            Request::Arm => (RunEvent::KIND_OPERATOR_ARMS, "gerono arm", "armed"),
            Request::Disarm => (RunEvent::KIND_OPERATOR_DISARMS, "gerono disarm", "disarmed"),
            Request::Land => (RunEvent::KIND_OPERATOR_LANDS, "gerono land", "landing"),
            Request::Kill => (
                RunEvent::KIND_OPERATOR_KILLS,
                "gerono kill",
                self.killed_in_words(),
            ),
        };
        let warning = match request {
            Request::Arm => self.warning_at_arming(),
            Request::Disarm | Request::Land | Request::Kill => self.without_link(),
        };
        let warning = after_the_answer(warning);
        self.ask(request, kind, event);
        match request {
            // It may come from another room.
            Request::Kill => self.announce_kill(event),
            Request::Arm | Request::Disarm | Request::Land => self.record_event(&format!("{text}{warning}")),
        }
        // The run's identity goes between the action and its detail: "armed run 7-0, …", "killed run 7-0, …: the motors
        // …".
        let (done, detail) = text.split_at(text.find(':').unwrap_or(text.len()));
        Answer::Done(format!("{done} {}{detail}{warning}", self.identity()))
    }

    /// Returns run, scenario and radio link in a line.
    pub(super) fn identity(&self) -> String {
        run_client::identity(&self.run, self.scenario)
    }

    /// Returns likely errors of the laboratory's configuration, if there are any: they do not prevent arming, but may lose the
    /// vehicle.
    fn warning_at_arming(&self) -> Option<String> {
        let warnings = [self.scatter(), self.unknown_markers(), self.untested()];
        let warnings: Vec<_> = warnings.into_iter().flatten().collect();
        (!warnings.is_empty()).then(|| warnings.join("; "))
    }

    /// Announces what a kill does, and that it does not reach the vehicle if the radio link is lost.
    pub(super) fn announce_kill(&mut self, event: &str) {
        let warning = after_the_answer(self.without_link());
        self.announce(format!("{} ({event}){warning}", self.killed_in_words()));
    }

    /// Returns what a kill does.
    fn killed_in_words(&self) -> &'static str {
        match self.without_link() {
            None => "killed: the motors rest until the end of the run",
            Some(_) => "killed: no frame that turns the motors is sent again",
        }
    }

    /// Returns that no request reaches the vehicle, if its radio link is lost.
    pub(super) fn without_link(&self) -> Option<String> {
        let block = self.supervisor.page().control_block();
        self.laboratory.is_link_lost(block).then(|| {
            "the radio link is LOST, and nothing reaches the vehicle: use its own transmitter or its failsafe, and keep away until its \
             battery is off"
                .to_owned()
        })
    }

    /// Returns the warning of cameras that scatter more than stated.
    fn scatter(&self) -> Option<String> {
        let stated = self.scenario.estimator.as_ref()?.kalman.position_deviation;
        let state = self.recorder.newest::<VehicleState>()?;
        let stands = self.phase() == Some(FlightPhase::Disarmed);
        // On the ground the filter starts from each capture, with the measured noise.
        (stands && state.position_sigma > NOISIER * stated).then(|| {
            format!(
                "the cameras scatter by some {:.1} mm, and `estimator.kalman.position_deviation` says {:.1} mm",
                2e3 * state.position_sigma,
                1e3 * stated
            )
        })
    }

    /// Returns the warning of markers whose position in the body of a real vehicle is unknown.
    fn unknown_markers(&self) -> Option<String> {
        let kalman = &self.scenario.estimator.as_ref()?.kalman;
        let model = self.scenario.model.clone().unwrap_or_default();
        let is_offset_known = model.marker_offset != [0.0; 3] || kalman.marker_offset_deviation > 0.0;
        let is_real = !self.schedule.simulates_the_world();
        (is_real && !is_offset_known).then(|| {
            "the position of the markers is unknown: a vehicle with markers 15 mm off its centre of mass may be lost; fly \
             with `estimator.kalman.marker_offset_deviation = 0.02`, and `gerono identify` measures the offset"
                .to_owned()
        })
    }

    /// Returns the warning of a flight with real cameras that states neither a hand test nor the ground.
    fn untested(&self) -> Option<String> {
        let flight = self.scenario.flight.as_ref()?;
        let is_untested = flight.hand_test.is_none() && flight.ground.is_none();
        (self.scenario.capture_system().is_some() && is_untested).then(|| {
            "neither `flight.hand_test` nor `flight.ground` is stated: a vehicle in a hand, or with wrong axes, is armed like \
             any other; `gerono lab check` prints both"
                .to_owned()
        })
    }

    /// Sends a request to all services, and records it as an event of the log.
    pub(super) fn ask(&mut self, request: Request, kind: u32, event: impl Into<Cow<'static, str>>) {
        self.ask_at(self.clock.tick(), request, kind, event);
    }

    /// As [`Self::ask`], for a request at this tick.
    pub(super) fn ask_at(
        &mut self,
        tick: u64,
        request: Request,
        kind: u32,
        event: impl Into<Cow<'static, str>>,
    ) {
        // The tick is determined before the request is sent: its effects have no earlier tick.
        let tick = tick.min(self.schedule.last_tick());
        self.supervisor.page().control_block().ask(request);
        let event = event.into();
        if request == Request::Kill {
            self.killed_for.get_or_insert_with(|| match &*event {
                "gerono kill" => "the operator killed, `gerono kill`".to_owned(),
                event => event.to_owned(),
            });
        }
        self.pending_events.push((tick, kind, event));
    }

    /// Returns what a request killed the motors for, if it is known. The kill switch stops the motors before this process handles
    /// its press, and `gerono kill` may do so without this process.
    fn kill_cause(&self) -> Option<&str> {
        let is_planned = self.schedule.operator().at(self.clock.tick()).killed;
        let planned = is_planned.then_some("planned, `flight.kill_at`");
        self.killed_for.as_deref().or(planned)
    }

    fn break_service(&mut self, name: &str, how: Break) -> Answer {
        let Some(service) = scenario::role_of_process(name).filter(|&service| self.supervisor.flies(service))
        else {
            return Answer::Refused(format!("no service `{name}` flies"));
        };
        let name = self.supervisor.name_of(service);
        let text = match how {
            Break::Kill => {
                self.supervisor.kill(service);
                format!("`{name}` was killed by hand")
            }
            Break::Freeze => {
                self.supervisor.freeze(service);
                format!("`{name}` was stopped by hand")
            }
        };
        self.record_event(&text);
        Answer::Done(text)
    }

    /// Returns the phase of the flight, if it has phases.
    pub(super) fn phase(&self) -> Option<FlightPhase> {
        self.recorder.phase(self.scenario)
    }

    fn snapshot(&self) -> Snapshot {
        let block = self.supervisor.page().control_block();
        let Operator { land, killed, .. } = self.operator();
        let elapsed_ns = self.clock.elapsed_ns();
        let Snapshot {
            cameras,
            receivers,
            radio_link,
            ..
        } = self.laboratory.snapshot(block, elapsed_ns);
        Snapshot {
            time: seconds(elapsed_ns),
            armed: self.is_armed(),
            landing: land,
            killed: killed || self.recorder.has_killed(),
            killed_by: self.recorder.killed_by(killed, self.kill_cause()),
            refusal_to_arm: (self.phase() == Some(FlightPhase::Disarmed))
                .then(|| self.refusal_to_arm())
                .flatten(),
            response: self.response.verdict().map(str::to_owned),
            services: self.services(),
            capture_to_frame: self.monitor.capture_to_frame(),
            cameras,
            receivers,
            radio_link,
            battery: self
                .laboratory
                .battery(block, self.recorder.newest::<RcFrame>().as_ref()),
            recorded: self.recorder.received_in_all(),
            events: self.events.all(),
            ..self.recorder.snapshot(self.scenario, self.schedule)
        }
    }

    fn services(&self) -> Vec<ServiceSnapshot> {
        let restarts = self.supervisor.restarts();
        let services = self
            .monitor
            .services()
            .into_iter()
            .zip(self.supervisor.processes());
        services
            .map(|(snapshot, (service, pid))| ServiceSnapshot {
                pid,
                flies: self.supervisor.flies(service),
                restarts: restarts.iter().filter(|one| one.service == service).count() as u64,
                ..snapshot
            })
            .collect()
    }
}

/// Way to break a service by request.
#[derive(Clone, Copy)]
enum Break {
    Kill,
    Freeze,
}

/// Returns a warning as the end of an answer.
fn after_the_answer(warning: Option<String>) -> String {
    warning.map_or_else(String::new, |warning| format!("; warning: {warning}"))
}
