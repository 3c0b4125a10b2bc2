//! External services: programs that fly in place of services.
//!
//! The choice of the program is a part of the experiment; its folder is not.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Scenario;
use shared_types::{ExternalServices, ServiceId};

macro_rules! programs {
    ($($name:ident: $service:ident),+) => {
        /// External services: for each service a command line, the program and its arguments.
        #[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct Programs {
            /// Folder in which programs are started, relative to the scenario's file; the folder of that file unless
            /// stated.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub folder: Option<PathBuf>,
            $(
                #[doc = concat!("Command line that flies in place of `", stringify!($name), "`: program and arguments.")]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $name: Option<Vec<String>>,
            )+
        }

        impl Programs {
            /// Returns the program that flies in place of a service, with its arguments.
            #[must_use]
            pub fn command_of(&self, service: ServiceId) -> Option<&[String]> {
                match service {
                    $(ServiceId::$service => self.$name.as_deref(),)+
                }
            }
        }
    };
}
shared_types::with_services!(programs);

impl Programs {
    /// Makes the programs of a flight with the caller's own controller, of this name.
    #[must_use]
    pub fn own_controller(name: String) -> Self {
        Self {
            controller: Some(vec![name]),
            ..Self::default()
        }
    }

    /// Sets the folder of the scenario's file.
    pub fn anchor(&mut self, file_folder: &Path) {
        self.folder = Some(anchored(self.folder.as_deref(), file_folder));
    }

    /// Returns the programs without their folder.
    #[must_use]
    pub fn without_folder(&self) -> Self {
        Self {
            folder: None,
            ..self.clone()
        }
    }
}

/// Resolves a folder of a scenario relative to that of its file.
pub(crate) fn anchored(stated: Option<&Path>, file_folder: &Path) -> PathBuf {
    stated.map_or_else(|| file_folder.to_owned(), |stated| file_folder.join(stated))
}

impl Scenario {
    /// Returns the program that flies in place of a service, with its arguments.
    #[must_use]
    pub fn program_of(&self, service: ServiceId) -> Option<&[String]> {
        self.programs.as_ref()?.command_of(service)
    }

    /// Returns the set of external services.
    #[must_use]
    pub fn external_services(&self) -> ExternalServices {
        ServiceId::ALL.map(|service| self.program_of(service).is_some())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests_support::fig1;
    use super::*;

    fn programs(folder: Option<&str>) -> Programs {
        Programs {
            folder: folder.map(PathBuf::from),
            controller: Some(vec!["python3".to_owned(), "controller.py".to_owned()]),
            ..Programs::default()
        }
    }

    #[test]
    fn the_program_is_a_part_of_the_experiment_and_its_folder_is_not() {
        let scenario = Scenario {
            programs: Some(programs(Some("somewhere"))),
            ..fig1()
        };
        let experiment = scenario.experiment();
        assert_eq!(experiment.programs, Some(programs(None)));
        assert_eq!(experiment.external_services(), scenario.external_services());
        assert_eq!(
            scenario
                .external_services()
                .iter()
                .filter(|&&is_external_service| is_external_service)
                .count(),
            usize::from(scenario.external_services()[ServiceId::Controller.index()])
        );
    }

    #[test]
    fn a_folder_is_seen_from_that_of_the_scenarios_file() {
        for (stated, expected) in [
            (None, "/lab/flights"),
            (Some("programs"), "/lab/flights/programs"),
            (Some("/opt/programs"), "/opt/programs"),
        ] {
            let mut programs = programs(stated);
            programs.anchor(Path::new("/lab/flights"));
            assert_eq!(programs.folder, Some(PathBuf::from(expected)));
        }
    }
}
