//! Use of the machine by a flight: deployment of the services, and settings of real time.
//!
//! It does not affect the log of a flight in simulated time. It is no part of [`Scenario::experiment`], which the log
//! keeps and from which step logic is made.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::kind::MOTION_CAPTURE;
use super::{Plugins, Programs, RadioProtocol, RcLink, Scenario};
use crate::range::{between, not_negative, positive};
use shared_types::schedule::Schedule;
use shared_types::service::seconds;
use shared_types::wiring::ServiceId;

const CORE_HINT: &str = "cores count from 0; `gerono doctor` lists those that a run may use";
const PRIORITY_HINT: &str = "such as 20; leave it out for the ordinary scheduler";
const SLACK_HINT: &str = "1e-6 gives wake-ups as sharp as the system can; leave it out for the system's 5e-5";

macro_rules! deployment {
    ($($name:ident: $service:ident),+) => {
        /// Use of the machine: for all services, except as a service's table states otherwise.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct Deployment {
            /// `true` to refuse the flight if the machine does not permit the stated values; if not, the run warns and
            /// flies.
            pub strict: bool,
            /// Core that the services run on; chosen as the run begins unless stated.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(transform = between(0, 1023), extend("x-hint" = CORE_HINT))]
            pub core: Option<u32>,
            /// Priority of `SCHED_FIFO`, above all ordinary work; the ordinary scheduler unless stated.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(transform = between(1, 99), extend("x-hint" = PRIORITY_HINT))]
            pub priority: Option<u32>,
            /// `true` to lock and touch memory before the flight, so that no step waits for a page; not unless stated.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub lock_memory: Option<bool>,
            /// Delay by which the system may wake a sleeping service late to save energy, s; the system's 5e-5 unless
            /// stated.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(transform = between(1e-9, 1.0), extend("x-hint" = SLACK_HINT))]
            pub timer_slack: Option<f64>,
            $(
                #[doc = concat!("What differs for `", stringify!($name), "`.")]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $name: Option<ServiceDeployment>,
            )+
            /// Differences for `motion_capture`, which replaces the plant in a laboratory.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub motion_capture: Option<ServiceDeployment>,
        }

        impl Deployment {
            /// Returns the separate table of a process, by its name.
            #[must_use]
            pub fn own(&self, process_name: &str) -> Option<&ServiceDeployment> {
                match process_name {
                    $(stringify!($name) => self.$name.as_ref(),)+
                    MOTION_CAPTURE => self.motion_capture.as_ref(),
                    _ => None,
                }
            }

            /// Returns the names of all processes that have a separate table, with their roles.
            pub(crate) fn tables(&self) -> impl Iterator<Item = (&'static str, ServiceId)> {
                let names = ServiceId::ALL.map(|role| (role.name(), role)).into_iter();
                let names = names.chain([(MOTION_CAPTURE, ServiceId::Plant)]);
                names.filter(|(name, _)| self.own(name).is_some())
            }

            fn owns_mut(&mut self) -> impl Iterator<Item = &mut ServiceDeployment> {
                [$(&mut self.$name),+, &mut self.motion_capture].into_iter().flatten()
            }
        }
    };
}
shared_types::with_services!(deployment);

/// Use of the machine by one service.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ServiceDeployment {
    /// Core that it runs on; as for all services unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(0, 1023), extend("x-hint" = CORE_HINT))]
    pub core: Option<u32>,
    /// Priority of `SCHED_FIFO`; as for all services unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(1, 99), extend("x-hint" = PRIORITY_HINT))]
    pub priority: Option<u32>,
    /// `true` to lock and touch its memory before the flight; as for all services unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lock_memory: Option<bool>,
    /// Delay by which the system may wake it late to save energy, s; as for all services unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(1e-9, 1.0), extend("x-hint" = SLACK_HINT))]
    pub timer_slack: Option<f64>,
}

impl Deployment {
    /// Removes all stated cores, so that the caller decides.
    pub fn forget_cores(&mut self) {
        self.core = None;
        self.owns_mut().for_each(|own| own.core = None);
    }

    /// Removes all stated priorities, so that the caller decides.
    pub fn forget_priorities(&mut self) {
        self.priority = None;
        self.owns_mut().for_each(|own| own.priority = None);
    }

    /// Returns the values for all services.
    #[must_use]
    pub fn common(&self) -> ServiceDeployment {
        ServiceDeployment {
            core: self.core,
            priority: self.priority,
            lock_memory: self.lock_memory,
            timer_slack: self.timer_slack,
        }
    }

    /// Returns the values for a process: those of its table, else those for all.
    #[must_use]
    pub fn of(&self, process_name: &str) -> ServiceDeployment {
        let own = self.own(process_name).copied().unwrap_or_default();
        let common = self.common();
        ServiceDeployment {
            core: own.core.or(common.core),
            priority: own.priority.or(common.priority),
            lock_memory: own.lock_memory.or(common.lock_memory),
            timer_slack: own.timer_slack.or(common.timer_slack),
        }
    }
}

/// Reaction of a flight in real time to services that are late or hang, and to the loss of the orchestrator.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RealTime {
    /// Time after a due step that a service has not made until the service counts as hanging and is replaced, s; 0.1, or
    /// twice the longest time that a step waits for its inputs if that is longer, unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = positive)]
    pub hang_limit: Option<f64>,
    /// Time beyond the due time that a step waits for due inputs, s; half its service's period if that is longer.
    #[schemars(transform = not_negative)]
    pub grace: f64,
    /// Reaction of the services to the loss of the orchestrator.
    pub orchestrator_loss: OrchestratorLoss,
}

impl Default for RealTime {
    fn default() -> Self {
        Self {
            hang_limit: None,
            grace: 0.002,
            orchestrator_loss: OrchestratorLoss::default(),
        }
    }
}

impl RealTime {
    /// Returns the time after a due step at which a service of a flight hangs, s: as stated, or far from what its steps wait.
    #[must_use]
    pub fn hang_limit(&self, schedule: &Schedule, service: ServiceId) -> f64 {
        let default = || (2.0 * self.longest_wait(schedule, service)).max(0.1);
        self.hang_limit.unwrap_or_else(default)
    }

    /// Returns how long a step of a service waits for its inputs at most, s: the grace, or half a period.
    pub(crate) fn longest_wait(&self, schedule: &Schedule, service: ServiceId) -> f64 {
        let period = schedule.service_rate(service).period;
        self.grace.max(seconds(schedule.time_ns(period)) / 2.0)
    }
}

/// Reaction of the services to the loss of the orchestrator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OrchestratorLoss {
    /// They land the vehicle and end.
    #[default]
    Land,
    /// They fly on, without recording and without a supervisor to replace them.
    Continue,
}

impl Scenario {
    /// Returns the scenario without the use of the machine: the part that determines the results, and that step logic
    /// may know.
    #[must_use]
    pub fn experiment(&self) -> Self {
        Self {
            deployment: None,
            real_time: None,
            operator: None,
            // With the gains that were flown, for an external service with other rules too.
            controller: self.controller.with_gains(&self.gains()),
            plugins: self.plugins.as_ref().map(Plugins::without_folder),
            programs: self.programs.as_ref().map(Programs::without_folder),
            rc_output: self.rc_output.as_ref().map(|link| RcLink {
                link: RadioProtocol::Simulated,
                transmitter: None,
                ..link.clone()
            }),
            ..self.clone()
        }
    }

    /// Returns a service's use of the machine.
    #[must_use]
    pub fn deployment_of(&self, service: ServiceId) -> ServiceDeployment {
        self.deployment
            .as_ref()
            .map_or_else(ServiceDeployment::default, |deployment| {
                deployment.of(self.process_name(service))
            })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests_support::{fig1, rig};
    use super::super::{OperatorDevices, Transmitter};
    use super::*;

    #[test]
    fn a_services_table_overrides_the_values_for_all() {
        let deployment = Deployment {
            core: Some(1),
            priority: Some(20),
            lock_memory: Some(true),
            rc_output: Some(ServiceDeployment {
                priority: Some(40),
                lock_memory: Some(false),
                ..ServiceDeployment::default()
            }),
            ..Deployment::default()
        };
        let of = |service: ServiceId| deployment.of(service.name());
        assert_eq!(of(ServiceId::Plant).priority, Some(20));
        assert_eq!(of(ServiceId::RcOutput).priority, Some(40));
        assert_eq!(of(ServiceId::RcOutput).core, Some(1));
        assert_eq!(of(ServiceId::RcOutput).lock_memory, Some(false));
        assert_eq!(of(ServiceId::RcOutput).timer_slack, None);
    }

    #[test]
    fn removed_values_are_removed_for_every_service() {
        let own = Some(ServiceDeployment {
            core: Some(2),
            priority: Some(30),
            lock_memory: Some(true),
            ..ServiceDeployment::default()
        });
        let mut deployment = Deployment {
            core: Some(1),
            priority: Some(20),
            plant: own,
            estimator: own,
            path_generator: own,
            controller: own,
            rc_output: own,
            motion_capture: own,
            ..Deployment::default()
        };
        deployment.forget_cores();
        for service in ServiceId::ALL {
            let of = deployment.of(service.name());
            assert_eq!(
                (of.core, of.priority, of.lock_memory),
                (None, Some(30), Some(true))
            );
        }
        deployment.forget_priorities();
        for service in ServiceId::ALL {
            assert_eq!(deployment.of(service.name()).priority, None);
        }
    }

    #[test]
    fn the_use_of_the_machine_is_no_part_of_the_experiment() {
        let deployed = Scenario {
            deployment: Some(Deployment::default()),
            real_time: Some(RealTime::default()),
            operator: Some(OperatorDevices::new("/dev/null")),
            ..fig1()
        };
        assert_eq!(deployed.experiment(), fig1().experiment());
    }

    #[test]
    fn the_radio_link_is_no_part_of_the_experiment() {
        let plugged_in = Scenario {
            rc_output: Some(RcLink {
                link: RadioProtocol::Crsf,
                transmitter: Some(Transmitter::default()),
                ..RcLink::default()
            }),
            ..rig()
        };
        assert_eq!(plugged_in.experiment(), rig().experiment());
    }
}
