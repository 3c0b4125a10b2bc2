//! Preparation of a run in several processes, before the first of them starts.

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

/// Resources of a run: schedule, run folder, shared-memory prefix, cores.
pub(super) struct RunContext {
    pub(super) schedule: Schedule,
    /// The scenario with the command line's deployment.
    pub(super) scenario: Scenario,
    pub(super) cores: Cores,
    scheduler: Scheduler,
    node: RunNode,
    /// Must be the last field: dropping it removes all shared memory of the run.
    pub(super) root: RunRoot,
}

impl RunContext {
    /// Creates the run's folder and joins its iceoryx2 domain; moves this process off the services' cores.
    ///
    /// # Errors
    /// If there is no room for the run, or it cannot be set up.
    pub(super) fn prepare(scenario: &Scenario, deployment: &Deployment) -> Result<Self, RunFailure> {
        let schedule = flight::schedule_of(scenario)?;
        let root = RunRoot::create().map_err(RunFailure::setup)?;
        // Leftovers of dead runs have been removed by now.
        reserve::check(&schedule).map_err(RunFailure::setup)?;
        let scenario = deployment.override_deployment(scenario);
        let cores = Cores::choose(deployment.placement, &scenario);
        cores.leave_service_cores();
        let node = RunNode::join(&root.configuration(), "orchestrator").map_err(RunFailure::setup)?;
        Ok(Self {
            schedule,
            scenario,
            cores,
            scheduler: deployment.scheduler,
            node,
            root,
        })
    }

    /// Joins a run in flight. `start` is the message that its services got at their start; `lock`, the lock of its
    /// folder, comes from one of them.
    ///
    /// # Errors
    /// If the run cannot be joined.
    pub(super) fn take_over(start: &Start, lock: OwnedFd) -> Result<Self, RunFailure> {
        let schedule = flight::schedule_of(&start.scenario)?;
        let root = RunRoot::adopt(start.place(), lock);
        let cores = Cores::around(start.core, &start.scenario);
        cores.leave_service_cores();
        let node = RunNode::join(&root.configuration(), "orchestrator").map_err(RunFailure::setup)?;
        node.clean_up_after_the_dead();
        Ok(Self {
            schedule,
            scenario: start.scenario.clone(),
            cores,
            scheduler: start.scheduler,
            node,
            root,
        })
    }

    /// Creates every topic of the run and subscribes to it.
    ///
    /// # Errors
    /// If a port or topic cannot be created.
    pub(super) fn subscribe(&self, delivery: Delivery) -> Result<Vec<Subscription>, RunFailure> {
        let make = |topic| self.node.create_topic(topic, &self.schedule, delivery);
        let external_services = self.scenario.external_services();
        let is_external = |topic: Topic| {
            topic
                .publisher()
                .is_some_and(|service| external_services[service.index()])
        };
        // External programs wait only for their inputs. With smaller buffers for the other topics, services wait for
        // the recorder before its buffers for the programs' topics are full, so those never overflow.
        let is_waited_for = delivery == Delivery::Lossless && external_services.contains(&true);
        let places = |topic| match is_waited_for && !is_external(topic) {
            true => RECORDER_BUFFER / 2,
            false => RECORDER_BUFFER,
        };
        Subscription::to_all(&self.schedule, make, places).map_err(RunFailure::setup)
    }

    /// Subscribes to every topic of a flight in real time; creates those whose publisher has died and was the last
    /// process to hold them.
    ///
    /// # Errors
    /// If a port or topic cannot be created or opened.
    pub(super) fn subscribe_in_flight(&self) -> Result<Vec<Subscription>, RunFailure> {
        let enter = |topic| {
            let open = self.node.open_topic(topic, &self.schedule);
            open.or_else(|_| {
                self.node
                    .create_topic(topic, &self.schedule, Delivery::NewestWins)
            })
        };
        Subscription::to_all(&self.schedule, enter, |_| RECORDER_BUFFER).map_err(RunFailure::setup)
    }

    /// Starts the services' processes.
    ///
    /// # Errors
    /// If one cannot be started.
    pub(super) fn start_supervisor(
        &self,
        deployment: &Deployment,
        host: Host,
    ) -> Result<Supervisor<'_>, RunFailure> {
        let start = self.start(host);
        let crashes = deployment.crashes.clone();
        Supervisor::start(
            &self.node,
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
    /// If one that has died cannot be restarted.
    pub(super) fn adopt_supervisor(
        &self,
        shared: Shared,
        survivors: [Option<OrphanedService>; ServiceId::ALL.len()],
    ) -> Result<Supervisor<'_>, RunFailure> {
        // Frees the ports of the services that were just killed: their successors need them.
        self.node.clean_up_after_the_dead();
        let start = self.start(Host::RealTime);
        let lock = self.root.lock();
        let supervisor = Supervisor::adopt(&self.node, lock, &self.schedule, start, shared, survivors)?;
        self.root.own();
        let mut supervisor = supervisor;
        if let Ok(mut reserve) = Reserve::new(self.root.prefix(), reserve::estimate(&self.schedule)) {
            // The flight is under way: if memory is missing now, it is requested again later.
            reserve.refill();
            supervisor.keep_reserve(reserve);
        }
        Ok(supervisor)
    }

    /// Returns the start message of the run's processes.
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

    /// Waits until all services are ready. Returns the refused settings of the deployment.
    ///
    /// # Errors
    /// [`RunFailure::NotPermitted`] if settings were refused although the deployment is strict; otherwise the
    /// supervisor's failure.
    pub(super) fn await_ready(&self, supervisor: &mut Supervisor<'_>) -> Result<Vec<String>, RunFailure> {
        let refusals = supervisor.await_ready()?;
        let mut reserve =
            Reserve::new(self.root.prefix(), reserve::estimate(&self.schedule)).map_err(RunFailure::setup)?;
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
