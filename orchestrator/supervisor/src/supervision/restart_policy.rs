//! Number and pace of restarts after deaths.

use std::str::FromStr;
use std::time::Duration;

use command_line::values::ValueError;
use scenario::suggest::known_names;
use shared_types::ServiceId;

/// Number of deaths in a row at the same place that are followed by a restart at once; later restarts come after a growing pause.
const AT_ONCE: u32 = 3;

/// The first pause.
const FIRST_PAUSE: Duration = Duration::from_millis(5);

/// The policy for restarts of a service: number and pace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RestartPolicy {
    /// Number of times that in a row it is started again without having flown a tick more; with 0 its first death ends the run.
    pub limit: u32,
    /// Longest pause before it is.
    pub longest_pause: Duration,
}

impl Default for RestartPolicy {
    fn default() -> Self {
        Self {
            limit: 8,
            longest_pause: Duration::from_millis(100),
        }
    }
}

impl RestartPolicy {
    /// Returns how long the service waits for its next life after so many deaths in a row at the same place; `None` if it
    /// gets none.
    #[must_use]
    pub fn pause(&self, fruitless: u32) -> Option<Duration> {
        if self.limit == 0 || fruitless > self.limit {
            return None;
        }
        let doublings = fruitless.saturating_sub(AT_ONCE);
        Some(if doublings == 0 {
            Duration::ZERO
        } else {
            (FIRST_PAUSE * (1 << doublings.min(8))).min(self.longest_pause)
        })
    }
}

/// A value for one service, as `SERVICE=VALUE`, or for all, as `VALUE`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PerService<T> {
    /// The service; all of them if none is named.
    pub service: Option<ServiceId>,
    /// The value.
    pub value: T,
}

impl<T: FromStr> FromStr for PerService<T> {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        let (service, value) = match text.split_once('=') {
            None => (None, text),
            Some((name, value)) => {
                let service = scenario::role_of_process(name).ok_or_else(|| {
                    let names = ServiceId::ALL.map(ServiceId::name);
                    ValueError::Unknown {
                        what: "service",
                        there_is: known_names(name, &names),
                    }
                })?;
                (Some(service), value)
            }
        };
        let value = value
            .parse()
            .map_err(|_| ValueError::unfit(format!("`{value}` is not such a number")))?;
        Ok(Self { service, value })
    }
}

impl<T: Copy> PerService<T> {
    /// The last of `values` that is for `service`.
    pub fn of(values: &[Self], service: ServiceId) -> Option<T> {
        let mut values = values.iter().rev();
        let own = values.find(|value| value.service.is_none_or(|named| named == service));
        own.map(|own| own.value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_begin_after_some_deaths_grow_and_end() {
        let policy = RestartPolicy {
            limit: 12,
            longest_pause: Duration::from_millis(50),
        };
        let pauses: Vec<_> = (0..=14).map(|deaths| policy.pause(deaths)).collect();
        assert_eq!(pauses[..4], [Some(Duration::ZERO); 4]);
        assert!(pauses[3..13].is_sorted() && pauses[12] == Some(policy.longest_pause));
        assert_eq!(pauses[13..], [None; 2]);
        assert_eq!(RestartPolicy { limit: 0, ..policy }.pause(0), None);
    }

    #[test]
    fn a_value_is_for_one_service_or_for_all_and_the_last_one_counts() {
        let values: Vec<PerService<u32>> = ["7", "controller=2", "plant=3", "controller=4"]
            .map(|text| text.parse().unwrap())
            .into();
        let of = |service| PerService::of(&values, service);
        assert_eq!(of(ServiceId::Estimator), Some(7));
        assert_eq!(of(ServiceId::Controller), Some(4));
        assert!(
            "contoller=1"
                .parse::<PerService<u32>>()
                .unwrap_err()
                .to_string()
                .contains("`controller`")
        );
        assert!("controller=-1".parse::<PerService<u32>>().is_err());
    }
}
