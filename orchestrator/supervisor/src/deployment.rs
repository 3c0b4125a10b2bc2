//! Use of the machine by the processes. It does not affect the results of a flight.

use runtime::crash::Crash;
use runtime::deployment::{self, Scheduler};
use scenario::Scenario;
use shared_types::ServiceId;

use super::supervision::RestartPolicies;

/// Settings of the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Deployment {
    pub placement: Placement,
    /// Scheduling of the services' core.
    pub scheduler: Scheduler,
    /// `true` if a waiting service yields before it sleeps; otherwise it sleeps at once.
    pub yielding: bool,
    /// Planned crashes: the first one of a service applies to its first process, and so on.
    pub crashes: Vec<(ServiceId, Crash)>,
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
    /// Returns the scenario with cores and priorities of the command line in place of its own.
    pub(super) fn override_deployment(&self, scenario: &Scenario) -> Scenario {
        let mut scenario = scenario.clone();
        if let Some(stated) = &mut scenario.deployment {
            if self.placement != Placement::AsStated {
                stated.clear_cores();
            }
            if self.scheduler == Scheduler::Fifo {
                stated.clear_priorities();
            }
        }
        scenario
    }
}

/// Cores of the services. Sharing one core is the fastest; the recorder uses the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// As in the scenario; by default the core that is idlest at the start of the run.
    AsStated,
    Core(usize),
    /// No affinity.
    Anywhere,
}

/// Cores of the services and the recorder.
pub(super) struct Cores {
    /// Core of all services without their own setting.
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

    /// Returns the cores with the services on `ring`, unless they have their own setting.
    pub(super) fn around(ring: Option<usize>, scenario: &Scenario) -> Self {
        let own = ServiceId::ALL.map(|service| scenario.deployment_of(service).core);
        let taken = |core: usize| Some(core) == ring || own.contains(&u32::try_from(core).ok());
        let others = deployment::allowed_cores()
            .into_iter()
            .filter(|&core| !taken(core))
            .collect();
        Self { ring, others }
    }

    /// Moves this process off the services' cores, if others are available.
    pub(super) fn leave_service_cores(&self) {
        if !self.others.is_empty() {
            // A refusal is ignored: it only costs time.
            let _ = deployment::pin_to(&self.others);
        }
    }
}
