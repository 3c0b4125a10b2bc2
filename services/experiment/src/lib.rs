//! All services of the wiring table, built from a scenario: the experiment alone, without anything of the machine that it runs on.

use scenario::Scenario;
use shared_types::sample::layout_hash;
use shared_types::service::ErasedService;
use shared_types::{Service, ServiceId};

use controller::ControllerService;
use estimator::EstimatorService;
use path_generator::PathGeneratorService;
use plant::PlantService;
use rc_output::RcOutputService;

/// Builds the step logic of a service, which knows nothing of how the machine is used.
///
/// # Errors
/// What the scenario asks for and the service cannot do, in words.
pub fn build(service: ServiceId, scenario: &Scenario) -> Result<Box<dyn ErasedService>, String> {
    let scenario = &scenario.experiment();
    Ok(match service {
        ServiceId::Plant => Box::new(PlantService::new(scenario)),
        ServiceId::Estimator => {
            Box::new(EstimatorService::new(scenario).map_err(|problem| problem.to_string())?)
        }
        ServiceId::PathGenerator => {
            Box::new(PathGeneratorService::new(scenario).map_err(|error| error.to_string())?)
        }
        ServiceId::Controller => Box::new(ControllerService::new(scenario)),
        ServiceId::RcOutput => Box::new(RcOutputService::new(scenario)),
    })
}

/// Builds all services of a flight in one process.
///
/// # Errors
/// As [`build`].
pub fn build_all(scenario: &Scenario) -> Result<Vec<Box<dyn ErasedService>>, String> {
    ServiceId::ALL
        .into_iter()
        .map(|service| build(service, scenario))
        .collect()
}

/// What tells the layout of a service's state from any other: the beginning of its hash. A state of another build is only
/// to be restored if it is the same.
///
/// # Panics
/// Never: a hash is a hexadecimal number of more digits.
#[must_use]
pub fn state_layout(service: ServiceId) -> u64 {
    fn of<S: Service>() -> u64 {
        u64::from_str_radix(&layout_hash::<S::State>()[..16], 16).expect("hexadecimal digits")
    }
    match service {
        ServiceId::Plant => of::<PlantService>(),
        ServiceId::Estimator => of::<EstimatorService>(),
        ServiceId::PathGenerator => of::<PathGeneratorService>(),
        ServiceId::Controller => of::<ControllerService>(),
        ServiceId::RcOutput => of::<RcOutputService>(),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn no_two_services_have_one_layout() {
        let layouts: BTreeSet<_> = ServiceId::ALL.into_iter().map(state_layout).collect();
        assert_eq!(layouts.len(), ServiceId::ALL.len());
    }
}
