//! Checks of `[plugins]` and of `controller.telemetry`.

use super::Findings;
use crate::{Key, Kind, Scenario};
use shared_types::samples::ControlTelemetry;
use shared_types::wiring::ServiceId;

impl Scenario {
    /// Requires valid names of telemetry, and a controller other than Gerono's own.
    pub(super) fn check_telemetry(&self, found: &mut Findings) {
        let names = &self.controller.telemetry;
        let at = Key::root().then("controller").then("telemetry");
        if !names.is_empty() && !self.is_foreign(ServiceId::Controller) {
            let fix = "leave it out, or name a plug-in or a program in place of the controller";
            found.add(at.clone(), "Gerono's own controller has no such numbers", fix);
        }
        if names.len() > ControlTelemetry::NUMBERS {
            let reason = format!("a sample cannot carry {} numbers", names.len());
            let fix = format!("name {} at most", ControlTelemetry::NUMBERS);
            found.add(at.clone(), reason, fix);
        }
        for (index, name) in names.iter().enumerate() {
            let starts_well = name.starts_with(|first: char| first.is_ascii_lowercase());
            let is_field = name
                .chars()
                .all(|letter| letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '_');
            if !starts_well || !is_field || ["header", "pad0"].contains(&name.as_str()) {
                let reason = format!("`{name}` cannot be the name of a number");
                let fix = "give lower-case letters, digits and underscores, a letter first, other than `header` and `pad0`";
                found.add(at.then(index), reason, fix);
            } else if names[..index].contains(name) {
                let fix = "give each number a unique name";
                found.add(at.then(index), format!("`{name}` is listed twice"), fix);
            }
        }
    }

    /// Checks the plug-ins in place of services.
    pub(super) fn check_plugins(&self, found: &mut Findings) {
        if self.is_foreign(ServiceId::Controller) && !self.controller.law.is_adaptive() {
            found.add(
                Key::root().then("controller").then("law"),
                "a plug-in or a program flies in place of the controller, and not this law",
                "leave it out, or leave the plug-in or the program out",
            );
        }
        let Some(plugins) = &self.plugins else {
            return;
        };
        let at = Key::root().then("plugins");
        for service in ServiceId::ALL {
            let Some(library) = plugins.library_of(service) else {
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
                Kind::MotionCapture | Kind::RecordedCaptures | Kind::Receivers => "a real vehicle flies",
            };
            found.add(
                at,
                format!("{occupant} in place of `{service}`, and a plug-in cannot as well"),
                "leave one of the two out",
            );
        }
        for name in plugins.sha256.keys() {
            if ServiceId::from_name(name).is_none_or(|service| plugins.library_of(service).is_none()) {
                found.add(
                    at.then("sha256").then(name.as_str()),
                    format!("no plug-in flies in place of `{name}`"),
                    "leave it out",
                );
            }
        }
        for name in plugins.parameters.keys().filter(|name| name.contains('\0')) {
            found.add(
                at.then("parameters").then(name.as_str()),
                "it cannot be passed to a library",
                "give a name without zero bytes",
            );
        }
    }
}
