//! Checks of `[plugins]`: libraries that can be named, for services that step logic flies.

use super::Findings;
use crate::{Key, Kind, Scenario};
use shared_types::wiring::ServiceId;

impl Scenario {
    /// The plug-ins that fly in place of services.
    pub(super) fn check_plugins(&self, found: &mut Findings) {
        let Some(plugins) = &self.plugins else {
            return;
        };
        let at = Key::root().then("plugins");
        for service in ServiceId::ALL {
            let Some(library) = plugins.of(service) else {
                continue;
            };
            let at = at.then(service.name());
            if library.file_name().is_none() {
                let fix = "name a shared library, such as `\"libmine.so\"`, or leave the key out";
                found.add(at.clone(), "it names no library", fix);
            }
            let occupant = match self.kind_of(service) {
                Kind::StepLogic | Kind::RadioLink => continue,
                Kind::Program => "a program flies",
                Kind::MotionCapture | Kind::RecordedCaptures => "motion capture tells of a real vehicle",
            };
            found.add(
                at,
                format!("{occupant} in place of `{service}`, and a plug-in cannot as well"),
                "leave one of the two out",
            );
        }
        for name in plugins.sha256.keys() {
            if ServiceId::from_name(name).is_none_or(|service| plugins.of(service).is_none()) {
                found.add(
                    at.then("sha256").then(name.as_str()),
                    format!("no plug-in flies in place of `{name}`"),
                    "leave it out",
                );
            }
        }
        for (name, value) in &plugins.parameters {
            if name.contains('\0') || !value.is_finite() {
                let at = at.then("parameters").then(name.as_str());
                found.add(
                    at,
                    "no library can be handed it",
                    "give a finite number and a name without zero bytes",
                );
            }
        }
    }
}
