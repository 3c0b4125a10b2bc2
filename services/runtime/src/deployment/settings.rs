//! Applies a service's deployment settings as far as the system permits.

use std::fmt;
use std::num::NonZeroU64;

use scenario::ServiceDeployment;
use shared_types::service::nanoseconds;

use super::memory;

/// Part of a deployment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Setting {
    /// The core.
    Core,
    /// The timer slack.
    TimerSlack,
    /// Locked memory.
    LockMemory,
    /// The priority of `SCHED_FIFO`.
    Priority,
}

impl Setting {
    /// Returns the fix for a refusal by the system.
    #[must_use]
    pub fn fix(self) -> &'static str {
        match self {
            Self::Core => {
                "state a core that `gerono doctor` lists, or let the container or `taskset` that starts gerono allow \
                 this one"
            }
            Self::TimerSlack => "leave `timer_slack` out: this system does not let it be set",
            Self::LockMemory => {
                "grant `memlock unlimited` in /etc/security/limits.conf and log in again, or the capability \
                 CAP_IPC_LOCK (docs/deployment.md)"
            }
            Self::Priority => {
                "grant `rtprio` in /etc/security/limits.conf and log in again, or the capability CAP_SYS_NICE \
                 (docs/deployment.md)"
            }
        }
    }
}

/// Refusal of a part of a deployment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// The part.
    pub setting: Setting,
    /// The refused request, and the error of the system.
    pub what: String,
}

impl fmt::Display for Refusal {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}; {}", self.what, self.setting.fix())
    }
}

/// Applies the settings to the calling thread and the memory of its process. Unstated settings stay as they are;
/// refused ones are left out and returned.
///
/// Allocates and touches memory: call it before the flight.
#[must_use]
pub fn apply(settings: &ServiceDeployment) -> Vec<Refusal> {
    let mut refusals = Vec::new();
    let mut refuse = |setting, what| refusals.push(Refusal { setting, what });
    if let Some(core) = settings.core
        && let Err(error) = super::pin_to(&[core as usize])
    {
        refuse(Setting::Core, format!("core {core} cannot be used ({error})"));
    }
    if let Some(slack) = settings.timer_slack
        && let Err(error) = rustix::thread::set_current_timer_slack(NonZeroU64::new(nanoseconds(slack)))
    {
        let what = format!("a timer slack of {slack:?} s is not permitted ({error})");
        refuse(Setting::TimerSlack, what);
    }
    if settings.lock_memory == Some(true)
        && let Err(error) = memory::lock()
    {
        let what = format!("memory may not be locked ({error})");
        refuse(Setting::LockMemory, what);
    }
    // Last: the other settings may take long, and must not do so at a real-time priority.
    if let Some(priority) = settings.priority
        && let Err(error) = super::use_fifo(priority)
    {
        let what = format!("SCHED_FIFO with priority {priority} is not permitted ({error})");
        refuse(Setting::Priority, what);
    }
    refusals
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A core that no machine has: the sets of the system end before it.
    const NO_CORE: u32 = 1023;

    /// Returns the refusals of settings that a separate thread applies; its scheduler and core end with it.
    fn refusals_of(settings: ServiceDeployment) -> Vec<Refusal> {
        std::thread::spawn(move || apply(&settings)).join().unwrap()
    }

    #[test]
    fn what_is_not_stated_is_not_touched() {
        let before = super::super::allowed_cores();
        let after = std::thread::spawn(|| {
            assert_eq!(apply(&ServiceDeployment::default()), []);
            super::super::allowed_cores()
        });
        assert_eq!(after.join().unwrap(), before);
    }

    #[test]
    fn what_everyone_may_is_done() {
        let core = u32::try_from(super::super::allowed_cores()[0]).unwrap();
        let settings = ServiceDeployment {
            core: Some(core),
            timer_slack: Some(1e-6),
            ..ServiceDeployment::default()
        };
        let (refusals, cores, slack) = std::thread::spawn(move || {
            let refusals = apply(&settings);
            let slack = rustix::thread::current_timer_slack().unwrap();
            (refusals, super::super::allowed_cores(), slack)
        })
        .join()
        .unwrap();
        assert_eq!((refusals, cores, slack), (vec![], vec![core as usize], 1000));
    }

    #[test]
    fn a_core_that_is_not_there_is_refused_with_the_fix() {
        let refusals = refusals_of(ServiceDeployment {
            core: Some(NO_CORE),
            ..ServiceDeployment::default()
        });
        let [refusal] = refusals.as_slice() else {
            panic!("{refusals:?}")
        };
        let shown = refusal.to_string();
        assert!(
            shown.starts_with("core 1023 cannot be used (") && shown.ends_with(Setting::Core.fix()),
            "{shown}"
        );
    }

    #[test]
    fn a_priority_is_had_or_refused_with_the_fix() {
        let (refusals, policy) = std::thread::spawn(|| {
            let refusals = apply(&ServiceDeployment {
                priority: Some(7),
                ..ServiceDeployment::default()
            });
            let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
            let (_, fields) = stat.rsplit_once(')').unwrap();
            // Fields 40 and 41 of proc(5): priority and policy; the first behind the name is the third.
            let field = |number: usize| fields.split_whitespace().nth(number - 3).unwrap().to_owned();
            (refusals, [field(40), field(41)])
        })
        .join()
        .unwrap();
        let had = ["7".to_owned(), libc::SCHED_FIFO.to_string()];
        match refusals.as_slice() {
            [] => assert_eq!(policy, had),
            [refusal] => assert!(refusal.setting == Setting::Priority && policy != had, "{refusal}"),
            more => panic!("{more:?}"),
        }
    }
}
