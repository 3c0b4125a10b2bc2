//! Registry: the only list of the constructors of each role and kind.
//!
//! Without the feature `laboratory` it has only the experiment, without hardware.

#[cfg(feature = "laboratory")]
use std::sync::Arc;

use control_law::law::registry::flight_law;
#[cfg(feature = "laboratory")]
use runtime::shared_page::SharedPage;
use scenario::{Kind, Problem, Scenario};
use shared_types::sample::layout_hash;
use shared_types::service::{BuildError, Built, ErasedService};
use shared_types::{Service, ServiceId};

use controller::ControllerService;
use estimator::{EstimatorService, InertialEstimatorService};
use path_generator::PathGeneratorService;
use plant::PlantService;
use plugin::library_file;
use rc_output::RcOutputService;

/// Constructor of a service in a role.
#[derive(Clone, Copy, Debug)]
pub enum Constructor {
    /// Step logic from the scenario.
    StepLogic(StepLogic),
    /// Driver from the step logic and the hardware that the scenario names.
    #[cfg(feature = "laboratory")]
    Driver(laboratory::Connect),
    /// External program that the scenario names.
    Program,
}

/// Step logic of a role.
#[derive(Clone, Copy, Debug)]
pub struct StepLogic {
    build: fn(&Scenario) -> Built,
    state_layout: fn() -> String,
    state_size: usize,
}

/// Returns the constructor of a kind in a role; `None` if the role has no such kind.
#[must_use]
pub fn constructor(role: ServiceId, kind: Kind) -> Option<Constructor> {
    match (role, kind) {
        (_, Kind::StepLogic) => Some(Constructor::StepLogic(step_logic(role))),
        (_, Kind::Program) => Some(Constructor::Program),
        #[cfg(feature = "laboratory")]
        (ServiceId::Plant, Kind::MotionCapture) => Some(Constructor::Driver(laboratory::motion_capture)),
        #[cfg(feature = "laboratory")]
        (ServiceId::Plant, Kind::RecordedCaptures) => {
            Some(Constructor::Driver(laboratory::recorded_captures))
        }
        #[cfg(feature = "laboratory")]
        (ServiceId::Plant, Kind::Receivers) => Some(Constructor::Driver(laboratory::receivers)),
        #[cfg(feature = "laboratory")]
        (ServiceId::RcOutput, Kind::RadioLink) => Some(Constructor::Driver(laboratory::radio_link)),
        _ => None,
    }
}

/// Returns the step logic of a role in flights without inertial navigation.
fn step_logic(role: ServiceId) -> StepLogic {
    match role {
        ServiceId::Plant => {
            step_logic_of::<PlantService>(|scenario| Ok(Box::new(PlantService::new(scenario))))
        }
        ServiceId::Estimator => {
            step_logic_of::<EstimatorService>(|scenario| Ok(Box::new(EstimatorService::new(scenario)?)))
        }
        ServiceId::PathGenerator => step_logic_of::<PathGeneratorService>(|scenario| {
            Ok(Box::new(PathGeneratorService::new(scenario)?))
        }),
        ServiceId::Controller => {
            step_logic_of::<ControllerService>(|scenario| Ok(Box::new(ControllerService::new(scenario))))
        }
        ServiceId::RcOutput => {
            step_logic_of::<RcOutputService>(|scenario| Ok(Box::new(RcOutputService::new(scenario))))
        }
    }
}

fn step_logic_of<S: Service>(build: fn(&Scenario) -> Built) -> StepLogic {
    StepLogic {
        build,
        state_layout: layout_hash::<S::State>,
        state_size: size_of::<S::State>(),
    }
}

/// Returns the step logic of a role in a flight: inertial navigation is an estimator with a state of its own.
fn step_logic_in(role: ServiceId, scenario: &Scenario) -> StepLogic {
    match role {
        ServiceId::Estimator if scenario.navigation.is_some() => {
            step_logic_of::<InertialEstimatorService>(|scenario| {
                Ok(Box::new(InertialEstimatorService::new(scenario)?))
            })
        }
        _ => step_logic(role),
    }
}

/// Builds the step logic of a role, built-in or a plug-in, from the scenario without the sections on the use of the machine.
///
/// # Errors
/// If the service does not support the scenario, or a plug-in cannot be used.
pub fn build(role: ServiceId, scenario: &Scenario) -> Built {
    let service = build_one(role, scenario)?;
    let plugins = ServiceId::ALL
        .into_iter()
        .filter(|&role| scenario.has_plugin(role));
    match plugins.count() {
        1 if scenario.has_plugin(role) => refuse_unasked()?,
        // With several plug-ins the parameters may be meant for another one.
        _ => drop(plugin::loader::take_unasked()),
    }
    Ok(service)
}

fn build_one(role: ServiceId, scenario: &Scenario) -> Built {
    match library_file::find(scenario, role)? {
        Some(library) => plugin::loader::load(role, &library.path, &scenario.experiment()),
        None => (step_logic_in(role, scenario).build)(&scenario.experiment()),
    }
}

/// Returns the problem of a scenario that one of Gerono's own services does not support, if there is one.
#[must_use]
pub fn problem_of_services(scenario: &Scenario) -> Option<Problem> {
    let experiment = scenario.experiment();
    let mut own = ServiceId::ALL
        .into_iter()
        .filter(|&role| !scenario.is_foreign(role));
    own.find_map(|role| {
        let error = (step_logic_in(role, &experiment).build)(&experiment).err()?;
        error.downcast::<Problem>().ok().map(|problem| *problem)
    })
}

/// Refuses a parameter that no library has requested: its name is misspelt, or it is meant for another library.
fn refuse_unasked() -> Result<(), BuildError> {
    match plugin::loader::take_unasked().first() {
        None => Ok(()),
        Some(name) => Err(format!(
            "no plug-in asks for `plugins.parameters.{name}`: correct its name, or leave it out"
        )
        .into()),
    }
}

/// Builds the step logic of all roles, for a flight in one process.
///
/// # Errors
/// As [`build`].
pub fn build_all(scenario: &Scenario) -> Result<Vec<Box<dyn ErasedService>>, BuildError> {
    drop(plugin::loader::take_unasked());
    let roles = ServiceId::ALL.into_iter();
    let services = roles
        .map(|role| build_one(role, scenario))
        .collect::<Result<_, _>>()?;
    refuse_unasked()?;
    Ok(services)
}

/// Connects step logic to the laboratory hardware that the scenario names, if any.
///
/// # Errors
/// If the hardware cannot be used, with the fix.
#[cfg(feature = "laboratory")]
pub fn connect(service: Box<dyn ErasedService>, scenario: &Scenario, page: &Arc<SharedPage>) -> Built {
    let role = service.id();
    match constructor(role, scenario.kind_of(role)) {
        Some(Constructor::Driver(connect)) => connect(service, scenario, page),
        _ => Ok(service),
    }
}

/// Returns the identifier of the layout of a role's state: the beginning of the layout hash, of the controller with that of
/// the law's record, or of the hash of the plug-in's file. A state of another build may only be restored if the identifiers are equal.
#[must_use]
pub fn state_layout(role: ServiceId, scenario: &Scenario) -> u64 {
    let plugins = scenario.plugins.as_ref().filter(|_| scenario.has_plugin(role));
    let identifier = |hash: &str| {
        let digits = hash.get(..16);
        digits.map_or(0, |digits| u64::from_str_radix(digits, 16).unwrap_or_default())
    };
    match plugins {
        Some(plugins) => plugins.sha256.get(role.name()).map_or(0, |hash| identifier(hash)),
        None => {
            let record = (role == ServiceId::Controller).then(|| flight_law(scenario).record_layout());
            identifier(&(step_logic_in(role, scenario).state_layout)())
                ^ record.map_or(0, |record| identifier(&record))
        }
    }
}

/// Returns the size of a role's state, bytes; `None` for a plug-in, whose size is known only after loading.
#[must_use]
pub fn state_size(role: ServiceId, scenario: &Scenario) -> Option<usize> {
    (!scenario.has_plugin(role)).then(|| step_logic_in(role, scenario).state_size)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use scenario::LawKind;

    use super::*;

    #[test]
    fn no_two_services_have_one_layout() {
        let layouts: BTreeSet<_> = ServiceId::ALL
            .map(|role| (step_logic(role).state_layout)())
            .into();
        assert_eq!(layouts.len(), ServiceId::ALL.len());
    }

    #[test]
    fn what_a_service_does_not_support_is_a_problem_of_a_key() {
        let text = include_str!("../../../scenarios/fig3_6.toml");
        let mut scenario: Scenario = toml::from_str(text).unwrap();
        assert_eq!(problem_of_services(&scenario), None);
        scenario.model.get_or_insert_default().radio_latency = 2.0;
        let problem = problem_of_services(&scenario).unwrap();
        assert_eq!(problem.key.to_string(), "model.radio_latency");
    }

    #[test]
    fn laws_with_records_of_their_own_have_layouts_of_their_own() {
        let text = include_str!("../../../scenarios/fig3_6.toml");
        let mut scenario: Scenario = toml::from_str(text).unwrap();
        let laws = [LawKind::Adaptive, LawKind::L1, LawKind::Indi, LawKind::Nmpc];
        let layouts: BTreeSet<_> = laws
            .map(|law| {
                scenario.controller.law = law;
                state_layout(ServiceId::Controller, &scenario)
            })
            .into();
        assert_eq!(layouts.len(), laws.len());
    }

    #[test]
    #[cfg(feature = "laboratory")]
    fn every_kind_flies_in_some_role_and_its_process_has_a_name_of_its_own_there() {
        for kind in Kind::ALL {
            let mut roles = ServiceId::ALL.into_iter();
            assert!(roles.any(|role| constructor(role, kind).is_some()), "{kind:?}");
            let roles = ServiceId::ALL
                .into_iter()
                .filter(|&role| constructor(role, kind).is_some());
            let names: BTreeSet<_> = roles.clone().map(|role| kind.process_name(role)).collect();
            assert_eq!(names.len(), roles.count(), "{kind:?}");
        }
    }
}
