//! The services of the wiring table, built from a scenario.

use shared_types::ServiceId;
use shared_types::scenario::Scenario;
use shared_types::service::ErasedService;

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
