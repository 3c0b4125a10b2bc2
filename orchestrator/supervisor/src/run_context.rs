//! The preparation that the hosts of several processes make before the first of them starts.

use std::os::fd::OwnedFd;

use runtime::control::{Host, Start};
use runtime::deployment::Scheduler;
use runtime::ports::{Delivery, RECORDER_BUFFER, RunNode};
use scenario::Scenario;
use shared_types::{Schedule, ServiceId, Topic};

use super::RunFailure;
use super::deployment::{Cores, Deployment};
use super::reserve::{self, Reserve};
use super::subscription::Subscription;
use super::supervision::{OrphanedService, Shared, Supervisor};
use run_client::run_root::RunRoot;

/// Place where a run takes place: its schedule, its place in shared memory, its cores.
pub(super) struct RunContext {
    /// Time at which everybody steps.
    pub(super) schedule: Schedule,
    /// The scenario, with the command line's word about the machine.
    pub(super) scenario: Scenario,
    /// Which cores the services use.
    pub(super) cores: Cores,
    scheduler: Scheduler,
    member: RunNode,
    /// Goes last: all that is in shared memory goes with it.
    pub(super) root: RunRoot,
}

impl RunContext {
    /// Makes the place of a run and joins it; from then on this process keeps off the services' cores.
    ///
    /// # Errors
    /// [`RunFailure::setup`].
    pub(super) fn prepare(scenario: &Scenario, deployment: &Deployment) -> Result<Self, RunFailure> {
        let schedule = flight::schedule_of(scenario)?;
        let root = RunRoot::create().map_err(RunFailure::setup)?;
        // What dead runs had has just been removed.
        reserve::check().map_err(RunFailure::setup)?;
        let scenario = deployment.stated_over(scenario);
        let cores = Cores::choose(deployment.placement, &scenario);
        cores.keep_off();
        let member = RunNode::join(&root.configuration(), "orchestrator").map_err(RunFailure::setup)?;
        Ok(Self {
            schedule,
            scenario,
            cores,
            scheduler: deployment.scheduler,
            member,
            root,
        })
    }

    /// Comes to the place of a run that is under way: `start` is what its services were told, and `lock` that of the
    /// place, which one of them has handed over.
    ///
    /// # Errors
    /// [`RunFailure::setup`].
    pub(super) fn take_over(start: &Start, lock: OwnedFd) -> Result<Self, RunFailure> {
        let schedule = flight::schedule_of(&start.scenario)?;
        let root = RunRoot::adopt(start.place(), lock);
        let cores = Cores::around(start.core, &start.scenario);
        cores.keep_off();
        let member = RunNode::join(&root.configuration(), "orchestrator").map_err(RunFailure::setup)?;
        member.clean_up_after_the_dead();
        Ok(Self {
            schedule,
            scenario: start.scenario.clone(),
            cores,
            scheduler: start.scheduler,
            member,
            root,
        })
    }

    /// Makes every topic of the run and subscribes to it.
    ///
    /// # Errors
    /// [`RunFailure::setup`].
    pub(super) fn subscribe(&self, delivery: Delivery) -> Result<Vec<Subscription>, RunFailure> {
        let make = |topic| self.member.create_topic(topic, &self.schedule, delivery);
        let external_services = self.scenario.external_services();
        let is_external = |topic: Topic| {
            topic
                .publisher()
                .is_some_and(|service| external_services[service.index()])
        };
        // External programs wait for nobody, but for their inputs: if services wait for the recorder before its buffers of
        // the programs' topics are full, those never are.
        let is_waited_for = delivery == Delivery::Lossless && external_services.contains(&true);
        let places = |topic| match is_waited_for && !is_external(topic) {
            true => RECORDER_BUFFER / 2,
            false => RECORDER_BUFFER,
        };
        Subscription::to_all(&self.schedule, make, places).map_err(RunFailure::setup)
    }

    /// Subscribes to every topic of a flight in real time that is under way; makes those whose publisher was the last to
    /// have them open, and has died.
    ///
    /// # Errors
    /// [`RunFailure::setup`].
    pub(super) fn listen_in(&self) -> Result<Vec<Subscription>, RunFailure> {
        let enter = |topic| {
            let open = self.member.open_topic(topic, &self.schedule);
            open.or_else(|_| {
                self.member
                    .create_topic(topic, &self.schedule, Delivery::NewestWins)
            })
        };
        Subscription::to_all(&self.schedule, enter, |_| RECORDER_BUFFER).map_err(RunFailure::setup)
    }

    /// Starts the services' processes.
    ///
    /// # Errors
    /// [`RunFailure::setup`].
    pub(super) fn start_supervisor(
        &self,
        deployment: &Deployment,
        host: Host,
    ) -> Result<Supervisor<'_>, RunFailure> {
        let start = self.start(host);
        let crashes = deployment.crashes.clone();
        Supervisor::start(
            &self.member,
            self.root.lock(),
            &self.schedule,
            start,
            crashes,
            deployment.restart_policies,
        )
    }

    /// Takes over the services of a flight in real time.
    ///
    /// # Errors
    /// [`RunFailure::setup`].
    pub(super) fn adopt_supervisor(
        &self,
        shared: Shared,
        survivors: [Option<OrphanedService>; ServiceId::ALL.len()],
    ) -> Result<Supervisor<'_>, RunFailure> {
        // Those that have just been killed have ports that others need.
        self.member.clean_up_after_the_dead();
        let start = self.start(Host::RealTime);
        let lock = self.root.lock();
        let supervisor = Supervisor::adopt(&self.member, lock, &self.schedule, start, shared, survivors)?;
        self.root.own();
        let mut supervisor = supervisor;
        if let Ok(mut reserve) = Reserve::new(self.root.prefix()) {
            // The flight is under way: room that is missing now is requested again.
            reserve.refill();
            supervisor.keep_reserve(reserve);
        }
        Ok(supervisor)
    }

    /// Returns the message to every process of the run.
    fn start(&self, host: Host) -> Start {
        Start {
            scenario: self.scenario.clone(),
            iceoryx2_configuration: self.root.configuration(),
            core: self.cores.ring,
            scheduler: self.scheduler,
            role: None,
            host,
        }
    }

    /// Waits until everybody is ready; what could not be had of the deployment, if the flight may do without it.
    ///
    /// # Errors
    /// [`RunFailure::NotPermitted`] if the scenario says that it may not; else that of the supervisor.
    pub(super) fn await_ready(&self, supervisor: &mut Supervisor<'_>) -> Result<Vec<String>, RunFailure> {
        let refusals = supervisor.await_ready()?;
        let mut reserve = Reserve::new(self.root.prefix()).map_err(RunFailure::setup)?;
        reserve.settle().map_err(RunFailure::setup)?;
        supervisor.keep_reserve(reserve);
        let is_strict = self
            .scenario
            .deployment
            .as_ref()
            .is_some_and(|stated| stated.strict);
        if is_strict && !refusals.is_empty() {
            return Err(RunFailure::NotPermitted { refusals });
        }
        Ok(refusals)
    }
}
