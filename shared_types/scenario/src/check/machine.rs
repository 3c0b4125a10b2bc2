//! Checks of the use of the machine: values that some machine permits. The run checks those of this machine when it
//! begins.

use super::Findings;
use crate::{Key, RealTime, Scenario, ServiceDeployment};
use shared_types::schedule::Schedule;
use shared_types::wiring::ServiceId;

/// Cores that the system can distinguish.
const CORES: u32 = 1024;

/// Priorities of `SCHED_FIFO`.
const PRIORITIES: std::ops::RangeInclusive<u32> = 1..=99;

/// Shortest and longest timer slack, s: the system counts nanoseconds and takes none for its default.
const TIMER_SLACK: std::ops::RangeInclusive<f64> = 1e-9..=1.0;

impl Scenario {
    /// The sections that say how the machine is used.
    pub(super) fn check_machine(&self, found: &mut Findings) {
        let at = Key::root().then("deployment");
        if let Some(deployment) = &self.deployment {
            deployment.common().check(&at, found);
            for (name, role) in deployment.tables() {
                let process = self.process_name(role);
                if name != process {
                    let reason = format!("no process is called `{name}` in this flight");
                    found.add(
                        at.then(name),
                        reason,
                        format!("name the table `deployment.{process}`"),
                    );
                }
                if let Some(own) = deployment.own(name) {
                    own.check(&at.then(name), found);
                }
            }
        }
        if let Some(real_time) = &self.real_time {
            let at = Key::root().then("real_time");
            real_time.check(self.schedule().ok().as_ref(), &at, found);
        }
    }
}

impl ServiceDeployment {
    fn check(&self, at: &Key, found: &mut Findings) {
        if let Some(core) = self.core.filter(|&core| core >= CORES) {
            found.add(
                at.then("core"),
                format!("no system has a core {core}"),
                "cores count from 0; `gerono doctor` lists those that a run may use",
            );
        }
        if let Some(priority) = self.priority.filter(|priority| !PRIORITIES.contains(priority)) {
            found.add(
                at.then("priority"),
                format!("{priority} is no priority of SCHED_FIFO"),
                "give a whole number from 1 to 99, such as 20; leave it out for the ordinary scheduler",
            );
        }
        if let Some(slack) = self.timer_slack.filter(|slack| !TIMER_SLACK.contains(slack)) {
            found.add(
                at.then("timer_slack"),
                format!("{slack:?} s is not a slack from 1e-9 s to 1.0 s"),
                "give 1e-6 for wake-ups as sharp as the system can; leave it out for the system's 5e-5",
            );
        }
    }
}

impl RealTime {
    fn check(&self, schedule: Option<&Schedule>, at: &Key, found: &mut Findings) {
        let hang = at.then("hang_limit");
        let is_grace = found.not_negative(&at.then("grace"), "grace", self.grace);
        // One that is not stated follows from the schedule.
        let is_good = |limit: &f64| found.positive(&hang, "hang_limit", *limit) && is_grace;
        let (Some(limit), Some(schedule)) = (self.hang_limit.filter(is_good), schedule) else {
            return;
        };
        let waits = ServiceId::ALL.map(|service| (service, self.longest_wait(schedule, service)));
        let longest = waits
            .into_iter()
            .max_by(|(_, one), (_, other)| one.total_cmp(other));
        let (service, longest) = longest.expect("there are services");
        if limit <= longest {
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
