//! What the hosts of several processes set up before the first of them starts.

use runtime::control::Start;
use runtime::deployment::Scheduler;
use runtime::ports::{Delivery, Member};
use shared_types::Schedule;
use shared_types::scenario::Scenario;

use super::FlightFailure;
use super::crew::Crew;
use super::deployment::{Cores, Deployment};
use super::subscription::Subscription;
use crate::run_root::RunRoot;

/// Where a run takes place: its schedule, its place in shared memory, its cores.
pub(super) struct Site {
    /// When everybody steps.
    pub(super) schedule: Schedule,
    /// The scenario, with the command line's word about the machine.
    pub(super) scenario: Scenario,
    /// Which cores the services use.
    pub(super) cores: Cores,
    scheduler: Scheduler,
    member: Member,
    /// Goes last: all that is in shared memory goes with it.
    pub(super) root: RunRoot,
}

impl Site {
    /// Makes the place of a run and joins it; from then on this process keeps off the services' cores.
    ///
    /// # Errors
    /// [`FlightFailure::Setup`].
    pub(super) fn prepare(scenario: &Scenario, deployment: &Deployment) -> Result<Self, FlightFailure> {
        let schedule = super::schedule_of(scenario)?;
        let root = RunRoot::create().map_err(FlightFailure::setup)?;
        let scenario = deployment.stated_over(scenario);
        let cores = Cores::choose(deployment.placement, &scenario);
        cores.keep_off();
        let member = Member::join(&root.configuration(), "orchestrator").map_err(FlightFailure::setup)?;
        Ok(Self {
            schedule,
            scenario,
            cores,
            scheduler: deployment.scheduler,
            member,
            root,
        })
    }

    /// Makes every topic of the run and subscribes to it.
    ///
    /// # Errors
    /// [`FlightFailure::Setup`].
    pub(super) fn subscribe(&self, delivery: Delivery) -> Result<Vec<Subscription>, FlightFailure> {
        Subscription::to_all(&self.member, &self.schedule, delivery).map_err(FlightFailure::setup)
    }

    /// Starts the services' processes, which fly in lock-step or in real time.
    ///
    /// # Errors
    /// [`FlightFailure::Setup`].
    pub(super) fn start_crew(
        &self,
        deployment: &Deployment,
        in_real_time: bool,
    ) -> Result<Crew<'_>, FlightFailure> {
        let start = Start {
            scenario: self.scenario.clone(),
            iceoryx2_configuration: self.root.configuration(),
            core: self.cores.ring,
            scheduler: self.scheduler,
            role: None,
            in_real_time,
        };
        let crashes = deployment.crashes.clone();
        Crew::start(
            &self.member,
            self.root.lock(),
            &self.schedule,
            start,
            crashes,
            deployment.restarts,
        )
    }

    /// Waits until everybody is ready; what could not be had of the deployment, if the flight may do without it.
    ///
    /// # Errors
    /// [`FlightFailure::NotPermitted`] if the scenario says that it may not; else that of the crew.
    pub(super) fn await_ready(&self, crew: &mut Crew<'_>) -> Result<Vec<String>, FlightFailure> {
        let refusals = crew.await_ready()?;
        let is_strict = self
            .scenario
            .deployment
            .as_ref()
            .is_some_and(|stated| stated.strict);
        if is_strict && !refusals.is_empty() {
            return Err(FlightFailure::NotPermitted { refusals });
        }
        Ok(refusals)
    }
}
