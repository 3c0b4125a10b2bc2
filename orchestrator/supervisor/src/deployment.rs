//! The processes' use of the machine. Nothing of it changes what is flown.

use runtime::crash::Crash;
use runtime::deployment::{self, Scheduler};
use scenario::Scenario;
use shared_types::ServiceId;

use super::supervision::RestartPolicies;

/// The command line's statements on the processes' use of the machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Deployment {
    /// Which core the services use.
    pub placement: Placement,
    /// The sharing of the services' core.
    pub scheduler: Scheduler,
    /// `true` if a waiting service may yield first or always sleeps at once.
    pub yielding: bool,
    /// Deaths that processes shall bring upon themselves: the first of a service upon its first process, and so on.
    pub crashes: Vec<(ServiceId, Crash)>,
    /// The restart policy of each service.
    pub restart_policies: RestartPolicies,
}

impl Default for Deployment {
    fn default() -> Self {
        Self {
            placement: Placement::AsStated,
            scheduler: Scheduler::Fair,
            yielding: true,
            crashes: Vec::new(),
            restart_policies: RestartPolicies::default(),
        }
    }
}

impl Deployment {
    /// The scenario with the command line's word in place of its own about cores and priorities.
    pub(super) fn stated_over(&self, scenario: &Scenario) -> Scenario {
        let mut scenario = scenario.clone();
        if let Some(stated) = &mut scenario.deployment {
            if self.placement != Placement::AsStated {
                stated.forget_cores();
            }
            if self.scheduler == Scheduler::Fifo {
                stated.forget_priorities();
            }
        }
        scenario
    }
}

/// Which core the services of a run use. Together on one is the fastest way; the recorder takes the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// As the scenario says; where it does not, the one that is idlest as the run begins.
    AsStated,
    /// This one.
    Core(usize),
    /// Wherever the system puts them.
    Anywhere,
}

/// Which cores the services and the recorder use.
pub(super) struct Cores {
    /// That of all services that state none of their own.
    pub(super) ring: Option<usize>,
    others: Vec<usize>,
}

impl Cores {
    pub(super) fn choose(placement: Placement, scenario: &Scenario) -> Self {
        let allowed = deployment::allowed_cores();
        let of_all = scenario.deployment.as_ref().and_then(|stated| stated.core);
        let ring = match (placement, of_all) {
            (Placement::AsStated, Some(core)) => Some(core as usize),
            (Placement::AsStated, None) => deployment::idlest(&allowed),
            (Placement::Core(core), _) => Some(core),
            (Placement::Anywhere, _) => None,
        };
        Self::around(ring, scenario)
    }

    /// With the services that state no core of their own on this one.
    pub(super) fn around(ring: Option<usize>, scenario: &Scenario) -> Self {
        let own = ServiceId::ALL.map(|service| scenario.deployment_of(service).core);
        let taken = |core: usize| Some(core) == ring || own.contains(&u32::try_from(core).ok());
        let others = deployment::allowed_cores()
            .into_iter()
            .filter(|&core| !taken(core))
            .collect();
        Self { ring, others }
    }

    /// Keeps this process off the services' cores, if there is another.
    pub(super) fn keep_off(&self) {
        if !self.others.is_empty() {
            // Only slower if it is refused.
            let _ = deployment::pin_to(&self.others);
        }
    }
}
