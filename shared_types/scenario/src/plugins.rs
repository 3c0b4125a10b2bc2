//! Plug-ins: shared libraries that fly in place of a service's step logic.
//!
//! The SHA-256 of the library is a part of the experiment; its path is not.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shared_types::ServiceId;

use super::Scenario;
use super::programs::anchored;
use crate::range::any_finite;

macro_rules! plugins {
    ($($name:ident: $service:ident),+) => {
        /// Plug-ins: for each service the file of a shared library.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct Plugins {
            /// Folder of the libraries, relative to the scenario's file; the folder of that file unless stated.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub folder: Option<PathBuf>,
            $(
                #[doc = concat!("Library that flies in place of `", stringify!($name), "`.")]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $name: Option<PathBuf>,
            )+
            /// Numbers for the libraries, by names that they define.
            #[serde(skip_serializing_if = "BTreeMap::is_empty")]
            #[schemars(transform = any_finite)]
            pub parameters: BTreeMap<String, f64>,
            /// SHA-256 of each service's library; another library is refused.
            #[serde(skip_serializing_if = "BTreeMap::is_empty")]
            pub sha256: BTreeMap<String, String>,
        }

        impl Plugins {
            /// Returns the stated library in place of a service.
            #[must_use]
            pub fn library_of(&self, service: ServiceId) -> Option<&Path> {
                match service {
                    $(ServiceId::$service => self.$name.as_deref(),)+
                }
            }

            /// Replaces the name of the library in place of a service.
            pub fn rename(&mut self, service: ServiceId, name: &OsStr) {
                match service {
                    $(ServiceId::$service => self.$name = Some(name.into()),)+
                }
            }
        }
    };
}
shared_types::with_services!(plugins);

impl Plugins {
    /// Sets the folder of the scenario's file.
    pub fn anchor(&mut self, file_folder: &Path) {
        self.folder = Some(anchored(self.folder.as_deref(), file_folder));
    }

    /// Returns the path of the library in place of a service. It always contains a slash: the dynamic linker searches other
    /// folders for a name without one.
    #[must_use]
    pub fn path_of(&self, service: ServiceId) -> Option<PathBuf> {
        let folder = self.folder.as_deref().unwrap_or(Path::new("."));
        Some(folder.join(self.library_of(service)?))
    }

    /// Returns the plug-ins without their folders.
    #[must_use]
    pub fn without_folder(&self) -> Self {
        let mut plugins = Self {
            folder: None,
            ..self.clone()
        };
        for service in ServiceId::ALL {
            if let Some(name) = self.library_of(service).and_then(Path::file_name) {
                plugins.rename(service, name);
            }
        }
        plugins
    }
}

impl Scenario {
    /// Returns whether a plug-in or a program flies in place of a service.
    #[must_use]
    pub fn is_foreign(&self, service: ServiceId) -> bool {
        self.has_plugin(service) || self.program_of(service).is_some()
    }

    /// Returns the services that a plug-in or a program replaces.
    pub fn foreign_services(&self) -> impl Iterator<Item = ServiceId> {
        ServiceId::ALL
            .into_iter()
            .filter(|&service| self.is_foreign(service))
    }

    /// Returns whether the flight has plug-ins.
    #[must_use]
    pub fn has_plugins(&self) -> bool {
        ServiceId::ALL.into_iter().any(|service| self.has_plugin(service))
    }

    /// Returns whether a plug-in flies in place of a service.
    #[must_use]
    pub fn has_plugin(&self, service: ServiceId) -> bool {
        self.plugins
            .as_ref()
            .is_some_and(|plugins| plugins.library_of(service).is_some())
    }
}
