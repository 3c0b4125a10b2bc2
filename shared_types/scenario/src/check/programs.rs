//! Checks of `[programs]`.

use super::Findings;
use crate::{Key, Scenario};
use shared_types::wiring::ServiceId;

impl Scenario {
    /// Checks the programs in place of services.
    pub(super) fn check_programs(&self, found: &mut Findings) {
        let Some(programs) = &self.programs else {
            return;
        };
        let at = Key::root().then("programs");
        for service in ServiceId::ALL {
            if let Some(words) = programs.command_of(service) {
                check_words(words, &at.then(service.name()), found);
                self.check_plans(service, &at.then(service.name()), found);
            }
        }
    }

    /// Refuses planned faults: a program would have to compute them, as services do.
    fn check_plans(&self, service: ServiceId, at: &Key, found: &mut Findings) {
        if !self.fault.is_empty() {
            found.add(
                at.clone(),
                format!("faults are planned, which a program in place of `{service}` does not receive"),
                "leave the faults out, or let the service itself fly",
            );
        }
    }
}

fn check_words(words: &[String], at: &Key, found: &mut Findings) {
    if words.first().is_none_or(|program| program.trim().is_empty()) {
        found.add(
            at.clone(),
            "it names no program",
            "give the program and its arguments, such as `[\"python3\", \"controller.py\"]`, or leave the key out",
        );
    }
    for (index, word) in words.iter().enumerate() {
        if word.contains('\0') {
            found.add(
                at.then(index),
                "an argument with a zero byte cannot be passed to a program",
                "leave the `\\u0000` out",
            );
        }
    }
}
