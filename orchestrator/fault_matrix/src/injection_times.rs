//! Default injection times: spread over the quiet parts of the flight.

use scenario::Scenario;
use shared_types::service::{nanoseconds, seconds};

/// Settling time after the start and after each planned change of the vehicle, s.
const SETTLING: f64 = 10.0;

/// Rounds a time to the nearest tick, s.
#[must_use]
pub fn on_tick(scenario: &Scenario, time: f64) -> f64 {
    let tick = nanoseconds(scenario.schedule.tick).max(1);
    seconds((nanoseconds(time) + tick / 2) / tick * tick)
}

/// Returns `count` injection times, spread evenly over the quiet parts of the flight: at least 10 s after it is armed and after a
/// change, and `watched` (s) before the next and before its landing. Without a quiet part, spreads them over the whole flight.
#[must_use]
pub fn spread(scenario: &Scenario, count: usize, watched: f64) -> Vec<f64> {
    let mut quiet = quiet_parts(scenario, watched);
    if quiet.is_empty() {
        quiet.push((0.0, scenario.duration));
    }
    let whole: f64 = quiet.iter().map(|(from, to)| to - from).sum();
    (0..count)
        .map(|number| {
            let share = (number as f64 + 0.5) / count as f64;
            on_tick(scenario, at(&quiet, share * whole))
        })
        .collect()
}

/// Returns begin and end of the quiet parts, s.
fn quiet_parts(scenario: &Scenario, watched: f64) -> Vec<(f64, f64)> {
    let flight = scenario.flight.as_ref();
    let begins = flight.and_then(|flight| flight.arm_at).unwrap_or(0.0);
    let ends = flight
        .and_then(|flight| flight.land_at)
        .unwrap_or(scenario.duration);
    let changes = scenario.vehicle.change.iter().map(|change| change.at);
    let changes = changes.filter(|at| (begins..ends).contains(at));
    let mut changes: Vec<f64> = changes.chain([begins, ends]).collect();
    changes.sort_by(f64::total_cmp);
    changes
        .windows(2)
        .map(|pair| (pair[0] + SETTLING, pair[1] - watched))
        .filter(|(from, to)| from < to)
        .collect()
}

/// Returns the time at a distance from the begin of the parts, counted along the parts only, s.
fn at(parts: &[(f64, f64)], mut way: f64) -> f64 {
    for (from, to) in parts {
        if way <= to - from {
            return from + way;
        }
        way -= to - from;
    }
    parts.last().map_or(0.0, |(_, to)| *to)
}

#[cfg(test)]
mod tests {
    use super::*;
    use run_log::test_flight::scenario_of_own_controller as scenario;
    use scenario::Flight;

    #[test]
    fn faults_begin_when_the_vehicle_has_settled_and_is_left_alone() {
        // It changes at 30 s.
        let scenario = scenario(0.001, 60.0);
        assert_eq!(quiet_parts(&scenario, 8.0), [(10.0, 22.0), (40.0, 52.0)]);
        assert_eq!(spread(&scenario, 3, 8.0), [14.0, 22.0, 48.0]);
        assert_eq!(spread(&scenario, 1, 8.0), [22.0]);
    }

    #[test]
    fn faults_of_a_flight_with_phases_begin_between_take_off_and_landing() {
        let mut scenario = scenario(0.001, 90.0);
        scenario.flight = Some(Flight {
            arm_at: Some(14.0),
            land_at: Some(75.0),
            ..Flight::default()
        });
        // It changes at 45 s.
        assert_eq!(quiet_parts(&scenario, 8.0), [(24.0, 37.0), (55.0, 67.0)]);
        scenario.vehicle.change.clear();
        assert_eq!(quiet_parts(&scenario, 8.0), [(24.0, 67.0)]);
    }

    #[test]
    fn a_flight_that_is_never_calm_has_its_moments_all_the_same_on_whole_ticks() {
        let scenario = scenario(0.022, 6.6);
        let moments = spread(&scenario, 3, 8.0);
        assert_eq!(moments, [1.1, 3.3, 5.5]);
        for moment in moments {
            assert_ne!(scenario.tick_of(moment), u64::MAX, "{moment}");
        }
    }
}
