//! Observers of a flight in simulated time. They are read-only: such a flight cannot be operated.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::control::Host;
use scenario::Scenario;
use shared_types::samples::RcFrame;
use shared_types::service::{Operator, seconds};
use shared_types::{Schedule, ServiceId};

use crate::battery;
use crate::control_server::ControlServer;
use crate::recorder::Recorder;
use crate::supervision::Supervisor;
use run_client::live_events::LiveEvents;
use run_client::newest::Newest;
use run_client::run_root::RunRoot;
use run_client::snapshot::ServiceSnapshot;
use run_client::{Answer, Description, Question, Snapshot};

/// Period of the control server.
const PERIOD: Duration = Duration::from_millis(10);

/// Averaging time of step rates.
const WINDOW: Duration = Duration::from_secs(1);

/// Control server for observers.
pub(super) struct Watchers<'a> {
    scenario: &'a Scenario,
    schedule: &'a Schedule,
    /// `None` if the socket could not be created: the flight continues without observers.
    server: Option<ControlServer>,
    next: Instant,
    window: Window,
    /// Events of the services.
    pub(super) events: LiveEvents,
}

/// Step rates: counters at the start of the window, and the rates of the window before.
struct Window {
    began: Instant,
    steps: [u64; ServiceId::ALL.len()],
    rates: [u64; ServiceId::ALL.len()],
}

impl<'a> Watchers<'a> {
    /// Opens the control server of a flight.
    pub(super) fn open(root: &RunRoot, scenario: &'a Scenario, schedule: &'a Schedule) -> Self {
        let now = Instant::now();
        Self {
            scenario,
            schedule,
            server: ControlServer::open(root, Host::LockStep).ok(),
            next: now,
            window: Window {
                began: now,
                steps: Default::default(),
                rates: Default::default(),
            },
            events: LiveEvents::default(),
        }
    }

    /// Returns the time of the flight, s.
    pub(super) fn time(&self, recorder: &Recorder) -> f64 {
        seconds(self.schedule.time_ns(recorder.ticks().saturating_sub(1)))
    }

    /// Answers pending questions, once a period.
    pub(super) fn serve(&mut self, supervisor: &Supervisor<'_>, recorder: &Recorder) {
        let now = Instant::now();
        if now < self.next {
            return;
        }
        self.next = now + PERIOD;
        self.window.count(now, self.schedule, supervisor);
        let Some(mut server) = self.server.take() else {
            return;
        };
        server.serve(|question| self.answer(&question, supervisor, recorder));
        self.server = Some(server);
    }

    fn answer(&self, question: &Question, supervisor: &Supervisor<'_>, recorder: &Recorder) -> Answer {
        match question {
            Question::Look => Answer::Snapshot(Box::new(self.snapshot(supervisor, recorder))),
            Question::Describe => Answer::Description(Box::new(Description::new(
                self.scenario,
                Host::LockStep,
                None,
                self.schedule.published_topics(),
            ))),
            Question::Watch => Answer::Newest(recorder.newest_samples()),
            Question::Set(_) | Question::Get(_) => Answer::Refused(
                "the gains of a flight in simulated time are those of its scenario; plan changes with \
                 `[[controller.change]]`"
                    .to_owned(),
            ),
            Question::Operate(_) | Question::Stop | Question::KillService(_) | Question::FreezeService(_) => {
                Answer::Refused(
                    "a flight in simulated time is read-only; Ctrl-C in its terminal ends it".to_owned(),
                )
            }
        }
    }

    fn snapshot(&self, supervisor: &Supervisor<'_>, recorder: &Recorder) -> Snapshot {
        let Operator {
            armed, land, killed, ..
        } = self.schedule.operator().at(recorder.ticks());
        let planned = killed.then_some("planned, `flight.kill_at`");
        Snapshot {
            time: self.time(recorder),
            armed,
            landing: land,
            killed: killed || recorder.has_killed(),
            killed_by: recorder.killed_by(killed, planned),
            services: self.services(supervisor),
            battery: battery::modelled(recorder.newest::<RcFrame>().as_ref()),
            recorded: recorder.received_in_all(),
            events: self.events.all(),
            ..recorder.snapshot(self.scenario, self.schedule)
        }
    }

    fn services(&self, supervisor: &Supervisor<'_>) -> Vec<ServiceSnapshot> {
        let restarts = supervisor.restarts();
        let service = |(service, pid): (ServiceId, u32)| ServiceSnapshot {
            name: supervisor.name_of(service).to_owned(),
            pid,
            flies: supervisor.flies(service),
            rate: self.window.rates[service.index()],
            restarts: restarts.iter().filter(|one| one.service == service).count() as u64,
            ..ServiceSnapshot::default()
        };
        supervisor.processes().map(service).collect()
    }
}

impl Window {
    fn count(&mut self, now: Instant, schedule: &Schedule, supervisor: &Supervisor<'_>) {
        let elapsed = now.duration_since(self.began);
        if elapsed < WINDOW {
            return;
        }
        let cells = &supervisor.page().control_block().cells;
        for service in ServiceId::ALL {
            let place = service.index();
            // Relaxed: an old count only delays the display.
            let until = cells[place].steps_until.load(Ordering::Relaxed);
            let steps = schedule.service_rate(service).count_before(until);
            let new = steps.saturating_sub(self.steps[place]);
            self.rates[place] = (new as f64 / elapsed.as_secs_f64()).round() as u64;
            self.steps[place] = steps;
        }
        self.began = now;
    }
}
