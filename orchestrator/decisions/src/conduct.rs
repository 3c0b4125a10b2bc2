//! Conduct of a flight in real time: what hangs, what a failure leads to, and when the flight ends.
//!
//! In the air only a landing ends a flight. After the first failure a landing is requested, services are restarted until
//! the vehicle has landed, and then the flight ends with that failure.

use std::time::Duration;

use scenario::{KillSwitchLoss, Scenario};
use shared_types::samples::RcFrame;
use shared_types::service::nanoseconds;
use shared_types::{Schedule, ServiceId};

use crate::event::Facts;
use crate::heartbeat::Heartbeats;
use crate::moment::Moment;
use crate::restart_policy::STOP_LIMIT;
use crate::shutdown::{Motors, Shutdown};
use crate::supervision::Supervision;

/// Time after the last tick after which a flight with delayed services ends.
const DELAYED_END_LIMIT: Duration = Duration::from_secs(10);

/// Time before the last tick from which on a service that says that it has finished is believed, s.
const AT_THE_END: f64 = 0.1;

/// Decisions on a flight in real time, beside those on its processes.
#[derive(Clone, Debug)]
pub struct Conduct {
    heartbeats: Heartbeats,
    tick_ns: u64,
    /// Tick before which no service has finished.
    last_tick_in_flight: u64,
    has_phases: bool,
    motors: Motors,
    shutdown: Shutdown,
    has_failed: bool,
    kill_switch: KillSwitch,
}

/// Kill switch of the operator.
#[derive(Clone, Copy, Debug)]
struct KillSwitch {
    on_loss: Option<KillSwitchLoss>,
    is_lost: bool,
    /// `true` if the flight has reacted to this loss.
    is_handled: bool,
}

/// What a request for the end leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndRequest {
    /// The vehicle is to be asked to land; the flight ends after that.
    Land,
    /// Nothing is to be asked: the vehicle lands already, or the flight ends now.
    Nothing,
}

/// Service that has not said that it has finished.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unfinished {
    /// It has done its last step: the flight is complete.
    NotEnded(ServiceId),
    /// It has steps to do: the flight has failed.
    NotDone(ServiceId),
}

impl Conduct {
    /// Creates the conduct of a flight of `scenario`.
    #[must_use]
    pub fn new(scenario: &Scenario, schedule: &Schedule) -> Self {
        let real_time = scenario.real_time.unwrap_or_default();
        let hang_limit = |service| nanoseconds(real_time.hang_limit(schedule, service)) / schedule.tick_ns();
        Self {
            heartbeats: Heartbeats::new(schedule, hang_limit),
            tick_ns: schedule.tick_ns(),
            last_tick_in_flight: schedule
                .last_tick()
                .saturating_sub(nanoseconds(AT_THE_END) / schedule.tick_ns()),
            has_phases: scenario.flight.is_some(),
            motors: Motors::AT_REST,
            shutdown: Shutdown::None,
            has_failed: false,
            kill_switch: KillSwitch {
                on_loss: scenario.operator.as_ref().map(|operator| operator.on_loss),
                is_lost: false,
                is_handled: false,
            },
        }
    }

    /// Continues a flight whose orchestrator is gone: its motors may turn, and it may have been asked to land.
    pub fn inherit(&mut self, has_landing_request: bool) {
        self.motors = Motors::UNKNOWN;
        if has_landing_request {
            self.shutdown = Shutdown::requested(self.has_phases);
        }
    }

    /// Does what is due at this time. Returns the services that hang at tick `tick` and are replaced.
    pub fn look(
        &mut self,
        supervision: &mut Supervision,
        now: Moment,
        tick: u64,
        facts: &dyn Facts,
    ) -> Vec<ServiceId> {
        if self.has_failed {
            supervision.retry_given_up(now);
        }
        if tick < self.last_tick_in_flight {
            for service in ServiceId::ALL {
                if supervision.is_finished(service) && !supervision.has_flown_all(service, facts) {
                    supervision.replace_early(service, now, facts);
                }
            }
        }
        let hung_services = self.replace_hung_services(supervision, now, tick, facts);
        supervision.look(now, facts);
        hung_services
    }

    fn replace_hung_services(
        &mut self,
        supervision: &mut Supervision,
        now: Moment,
        tick: u64,
        facts: &dyn Facts,
    ) -> Vec<ServiceId> {
        let tick_ns = self.tick_ns;
        let hung_services = self.heartbeats.hung_services(
            tick,
            |service| facts.steps_until(service),
            |service| supervision.flies(service),
            |service| facts.activity(supervision.process_of(service)),
            |service| supervision.first_step_limit(service).as_nanos() as u64 / tick_ns,
        );
        for &service in &hung_services {
            let ticks = tick.saturating_sub(facts.steps_until(service));
            supervision.replace_hung(service, now, Duration::from_nanos(ticks * tick_ns));
        }
        hung_services
    }

    /// Stores that the flight has failed. Returns what the end that follows leads to; `None` if it had failed before.
    pub fn fail(&mut self) -> Option<EndRequest> {
        if self.has_failed {
            return None;
        }
        self.has_failed = true;
        Some(self.request_end())
    }

    /// Requests the end of the flight, after a landing. Repetitions change nothing.
    pub fn request_end(&mut self) -> EndRequest {
        let before = self.shutdown;
        self.shutdown = Shutdown::requested(self.has_phases);
        if self.shutdown == Shutdown::Land && before == Shutdown::None {
            // Also if the flight ends at once, because the motors rest: services that go on meanwhile must not take off.
            EndRequest::Land
        } else {
            EndRequest::Nothing
        }
    }

    /// Evaluates the newest frame at a time of the flight. A missing frame counts only if frames can be received.
    pub fn observe_motors(&mut self, frame: Option<&RcFrame>, elapsed_ns: u64, can_receive: bool) {
        self.motors.observe(frame, elapsed_ns, can_receive);
    }

    #[must_use]
    pub fn shutdown(&self) -> Shutdown {
        self.shutdown
    }

    /// Returns whether a requested end may happen now.
    #[must_use]
    pub fn permits_end(&self) -> bool {
        self.shutdown.permits_end(&self.motors)
    }

    /// Returns whether all services have finished, or the flight may end earlier. `since_end` is the time since its last
    /// tick.
    #[must_use]
    pub fn is_over(&self, supervision: &Supervision, since_end: Duration, facts: &dyn Facts) -> bool {
        // After its end, a service that cannot be restarted never finishes.
        let is_past_its_end =
            since_end > STOP_LIMIT && (since_end > DELAYED_END_LIMIT || !supervision.is_delayed(facts));
        supervision.unfinished().next().is_none() || is_past_its_end || self.permits_end()
    }

    /// Returns what is missing of a flight that is over by its time: the services that have not said that they have
    /// finished.
    #[must_use]
    pub fn unfinished(&self, supervision: &Supervision, facts: &dyn Facts) -> Vec<Unfinished> {
        if self.has_failed || self.shutdown != Shutdown::None {
            return Vec::new();
        }
        let has_flown_all = |service| supervision.has_flown_all(service, facts);
        let unfinished = supervision
            .unfinished()
            .map(|service| match has_flown_all(service) {
                true => Unfinished::NotEnded(service),
                false => Unfinished::NotDone(service),
            });
        unfinished.collect()
    }

    /// Stores that the kill switch is lost, or back.
    pub fn note_kill_switch(&mut self, is_lost: bool) {
        (self.kill_switch.is_lost, self.kill_switch.is_handled) = (is_lost, false);
    }

    /// Returns the reaction to the loss of the kill switch, once for each loss while the vehicle `may_fly`.
    pub fn reaction_to_loss(&mut self, may_fly: bool) -> Option<KillSwitchLoss> {
        let switch = &mut self.kill_switch;
        let on_loss = switch
            .on_loss
            .filter(|_| switch.is_lost && !switch.is_handled && may_fly)?;
        switch.is_handled = true;
        Some(on_loss)
    }
}
