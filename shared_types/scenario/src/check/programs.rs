//! Checks of `[programs]`: commands that can be started, in flights that they can fly.

use super::Findings;
use crate::{Key, Scenario};
use shared_types::wiring::ServiceId;

impl Scenario {
    /// The programs that fly in place of services.
    pub(super) fn check_programs(&self, found: &mut Findings) {
        let Some(programs) = &self.programs else {
            return;
        };
        let at = Key::root().then("programs");
        for service in ServiceId::ALL {
            if let Some(words) = programs.of(service) {
                check_words(words, &at.then(service.name()), found);
                self.check_plans(service, &at.then(service.name()), found);
            }
        }
    }

    /// Refuses plans that a program does not receive: it would have to compute them, as services do.
    fn check_plans(&self, service: ServiceId, at: &Key, found: &mut Findings) {
        if !self.fault.is_empty() {
            found.add(
                at.clone(),
                format!("faults are planned, of which a program in place of `{service}` knows nothing"),
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
                "no program can be handed a word with a zero byte in it",
                "leave the `\\u0000` out",
            );
        }
    }
}
