//! Use of the machine by a flight: deployment of the services, and settings of real time.
//!
//! It does not affect the log of a flight in simulated time. It is not a part of [`Scenario::experiment`], which the log
//! stores and from which step logic is constructed.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::kind::{MOTION_CAPTURE, RECEIVERS};
use super::{Flight, Plugins, Programs, RadioProtocol, RcLink, Scenario, VoltageSource};
use crate::range::{between, not_negative, positive};
use shared_types::schedule::Schedule;
use shared_types::service::seconds;
use shared_types::wiring::ServiceId;

const CORE_HINT: &str = "cores count from 0; `gerono doctor` lists those that a run may use";
const PRIORITY_HINT: &str = "such as 20; leave it out for the ordinary scheduler";
const SLACK_HINT: &str = "1e-6 gives wake-ups as sharp as the system can; leave it out for the system's 5e-5";

macro_rules! deployment {
    ($($name:ident: $service:ident),+) => {
        /// Use of the machine: for all services, unless a service's table states otherwise.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct Deployment {
            /// `true` to refuse the flight if the machine does not permit the stated values, `false` to warn and fly.
            pub strict: bool,
            /// Core that the services run on; chosen at the start of the run unless stated.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(transform = between(0, 1023), extend("x-hint" = CORE_HINT))]
            pub core: Option<u32>,
            /// Priority of `SCHED_FIFO`, above all ordinary processes; the ordinary scheduler unless stated.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(transform = between(1, 99), extend("x-hint" = PRIORITY_HINT))]
            pub priority: Option<u32>,
            /// `true` to lock and pre-fault memory before the flight, so that no step waits for a page; not unless stated.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub lock_memory: Option<bool>,
            /// Timer slack: delay by which the kernel may wake a sleeping service late to save energy, s; the kernel's 5e-5
            /// unless stated.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(transform = between(1e-9, 1.0), extend("x-hint" = SLACK_HINT))]
            pub timer_slack: Option<f64>,
            $(
                #[doc = concat!("Differences for `", stringify!($name), "`.")]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $name: Option<ServiceDeployment>,
            )+
            /// Differences for `motion_capture`, which replaces the plant in a laboratory.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub motion_capture: Option<ServiceDeployment>,
            /// Differences for `receivers`, which replaces the plant outdoors.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub receivers: Option<ServiceDeployment>,
        }

        impl Deployment {
            /// Returns the table of a process, by its name.
            #[must_use]
            pub fn table_of(&self, process_name: &str) -> Option<&ServiceDeployment> {
                match process_name {
                    $(stringify!($name) => self.$name.as_ref(),)+
                    MOTION_CAPTURE => self.motion_capture.as_ref(),
                    RECEIVERS => self.receivers.as_ref(),
                    _ => None,
                }
            }

            /// Returns the names of all processes with a table, with their roles.
            pub(crate) fn tables(&self) -> impl Iterator<Item = (&'static str, ServiceId)> {
                let names = ServiceId::ALL.map(|role| (role.name(), role)).into_iter();
                let names = names.chain([MOTION_CAPTURE, RECEIVERS].map(|name| (name, ServiceId::Plant)));
                names.filter(|(name, _)| self.table_of(name).is_some())
            }

            fn tables_mut(&mut self) -> impl Iterator<Item = &mut ServiceDeployment> {
                [$(&mut self.$name),+, &mut self.motion_capture, &mut self.receivers].into_iter().flatten()
            }
        }
    };
}
shared_types::with_services!(deployment);

/// Use of the machine by one service.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ServiceDeployment {
    /// Core that the service runs on; as for all services unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(0, 1023), extend("x-hint" = CORE_HINT))]
    pub core: Option<u32>,
    /// Priority of `SCHED_FIFO`; as for all services unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(1, 99), extend("x-hint" = PRIORITY_HINT))]
    pub priority: Option<u32>,
    /// `true` to lock and pre-fault its memory before the flight; as for all services unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lock_memory: Option<bool>,
    /// Timer slack: delay by which the kernel may wake it late to save energy, s; as for all services unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(1e-9, 1.0), extend("x-hint" = SLACK_HINT))]
    pub timer_slack: Option<f64>,
}

impl Deployment {
    /// Removes all stated cores, so that the caller decides.
    pub fn clear_cores(&mut self) {
        self.core = None;
        self.tables_mut().for_each(|table| table.core = None);
    }

    /// Removes all stated priorities, so that the caller decides.
    pub fn clear_priorities(&mut self) {
        self.priority = None;
        self.tables_mut().for_each(|table| table.priority = None);
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

    /// Returns the values for a process: those of its table, otherwise those for all.
    #[must_use]
    pub fn for_process(&self, process_name: &str) -> ServiceDeployment {
        let own = self.table_of(process_name).copied().unwrap_or_default();
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
    /// Delay of a due step after which the service counts as hung and is restarted, s; 0.1, or twice the longest wait of a
    /// step for its inputs if that is longer, unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = positive)]
    pub hang_limit: Option<f64>,
    /// Time after its due time for which a step waits for due inputs, s; half its service's period if that is longer.
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
    /// Returns the delay of a due step after which a service counts as hung, s: as stated, or well above the longest wait.
    #[must_use]
    pub fn hang_limit(&self, schedule: &Schedule, service: ServiceId) -> f64 {
        let default = || (2.0 * self.longest_wait(schedule, service)).max(0.1);
        self.hang_limit.unwrap_or_else(default)
    }

    /// Returns the longest wait of a service's step for its inputs, s: the grace, or half a period.
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
    /// They fly on, without recording and without restarts.
    Continue,
}

impl Scenario {
    /// Returns the scenario without the use of the machine: the part that determines the results and that step logic may read.
    #[must_use]
    pub fn experiment(&self) -> Self {
        Self {
            deployment: None,
            real_time: None,
            operator: None,
            // With all gains stated: an external service may derive them by other rules.
            controller: self.controller.with_gains(&self.gains()),
            flight: self.flight.clone().map(|flight| Flight {
                hand_test: None,
                ..flight
            }),
            plugins: self.plugins.as_ref().map(Plugins::without_folder),
            programs: self.programs.as_ref().map(Programs::without_folder),
            rc_output: self.rc_output.as_ref().map(|link| RcLink {
                link: RadioProtocol::Simulated,
                transmitter: None,
                // Nothing is measured in simulated time.
                battery: link
                    .battery
                    .clone()
                    .filter(|battery| battery.source == VoltageSource::Modelled),
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
                deployment.for_process(self.process_name(service))
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
        let of = |service: ServiceId| deployment.for_process(service.name());
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
        deployment.clear_cores();
        for service in ServiceId::ALL {
            let of = deployment.for_process(service.name());
            assert_eq!(
                (of.core, of.priority, of.lock_memory),
                (None, Some(30), Some(true))
            );
        }
        deployment.clear_priorities();
        for service in ServiceId::ALL {
            assert_eq!(deployment.for_process(service.name()).priority, None);
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
