//! Copies checkpoints to the record of the machine, about one a second of flight time, whatever that is in wall time.

use runtime::checkpoints::Checkpoints;
use scenario::Scenario;
use shared_types::{Schedule, ServiceId};

use run_log::LoggedCheckpoint;

/// Period of a service's checkpoints in the record, ns of flight time.
const PERIOD_NS: u64 = 1_000_000_000;

/// Checkpoints taken so far.
#[derive(Debug)]
pub(super) struct Snapshots {
    services: [Taken; ServiceId::ALL.len()],
}

#[derive(Debug)]
struct Taken {
    service: ServiceId,
    layout: u64,
    /// Tick from which the next checkpoint is due.
    next_at: u64,
    /// 1 + `next_tick` of the last checkpoint; 0 before the first.
    last: u64,
}

impl Snapshots {
    /// Creates the state without any checkpoint taken.
    pub(super) fn new(scenario: &Scenario) -> Self {
        Self {
            services: ServiceId::ALL.map(|service| Taken {
                service,
                layout: registry::state_layout(service, scenario),
                next_at: 0,
                last: 0,
            }),
        }
    }

    /// Returns the checkpoints that are due at `tick`. If one cannot be read, because there is none or the service
    /// writes faster, it stays due.
    pub(super) fn take(
        &mut self,
        checkpoints: &Checkpoints,
        schedule: &Schedule,
        tick: u64,
    ) -> Vec<LoggedCheckpoint> {
        let due = self.services.iter_mut().filter(|taken| tick >= taken.next_at);
        let new = due.filter_map(|taken| {
            let checkpoint = checkpoints.snapshot(taken.service)?;
            taken.next_at = tick + PERIOD_NS.div_ceil(schedule.tick_ns());
            // A service that is away or idle has an unchanged checkpoint.
            let last = std::mem::replace(&mut taken.last, checkpoint.next_tick + 1);
            (taken.last != last).then_some(LoggedCheckpoint {
                service: taken.service,
                layout: taken.layout,
                checkpoint,
            })
        });
        new.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SERVICE: ServiceId = ServiceId::Controller;

    fn scenario() -> Scenario {
        let vehicle = scenario::Vehicle::new(0.2, [6.5e-4, 6.5e-4, 13.0e-4]);
        let position = scenario::Hover { position: [0.0; 3] };
        Scenario::new(
            1.0,
            vehicle,
            scenario::Path::new(scenario::Curve::Hover(position)),
        )
    }

    #[test]
    fn a_checkpoint_is_taken_once_a_second_of_the_flight_and_only_if_it_is_a_new_one() {
        let schedule = Schedule::ideal(1_000_000, 10_000);
        let checkpoints = Checkpoints::create().unwrap();
        let mut snapshots = Snapshots::new(&scenario());
        let mut taken = Vec::new();
        for tick in 0..5500 {
            for found in snapshots.take(&checkpoints, &schedule, tick) {
                assert_eq!(found.service, SERVICE);
                assert_eq!(found.layout, registry::state_layout(SERVICE, &scenario()));
                taken.push((tick, found.checkpoint.next_tick));
            }
            // It is late, and away for a while.
            if !(2500..4200).contains(&tick) {
                checkpoints.write(SERVICE, tick + 1, |keep| keep(&[0; 8]));
            }
        }
        assert_eq!(
            taken,
            [(1, 1), (1001, 1001), (2001, 2001), (3001, 2500), (5001, 5001)]
        );
    }
}
