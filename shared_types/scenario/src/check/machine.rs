//! Checks of the use of the machine that do not depend on the machine. The run checks the others when it starts.

use super::Findings;
use crate::{Key, RealTime, Scenario};
use shared_types::schedule::Schedule;
use shared_types::wiring::ServiceId;

impl Scenario {
    /// Checks the sections about the use of the machine.
    pub(super) fn check_machine(&self, found: &mut Findings) {
        let at = Key::root().then("deployment");
        if let Some(deployment) = &self.deployment {
            for (name, role) in deployment.tables() {
                let process = self.process_name(role);
                if name != process {
                    let reason = format!("this flight has no process `{name}`");
                    found.add(
                        at.then(name),
                        reason,
                        format!("name the table `deployment.{process}`"),
                    );
                }
            }
        }
        if let Some(real_time) = &self.real_time {
            let at = Key::root().then("real_time");
            real_time.check(self.schedule().ok().as_ref(), &at, found);
        }
    }
}

impl RealTime {
    fn check(&self, schedule: Option<&Schedule>, at: &Key, found: &mut Findings) {
        let hang = at.then("hang_limit");
        // Unless stated, the limit follows from the schedule.
        let (Some(limit), Some(schedule)) = (self.hang_limit, schedule) else {
            return;
        };
        let waits = ServiceId::ALL.map(|service| (service, self.longest_wait(schedule, service)));
        let longest = waits
            .into_iter()
            .max_by(|(_, one), (_, other)| one.total_cmp(other));
        let (service, longest) = longest.expect("there are services");
        if limit <= longest && found.are_in_range(at, &["grace"]) {
            found.add(
                hang,
                format!(
                    "`{service}` waits up to {longest:?} s for its inputs, so that a healthy one would be replaced after \
                     {limit:?} s"
                ),
                format!("give a time above {longest:?} s, better several times as long"),
            );
        }
    }
}
