//! When the faults of the matrix begin, unless told: spread over those parts of the flight in which nothing else happens.

use scenario::Scenario;
use shared_types::service::{nanoseconds, seconds};

/// Time for which the vehicle is left alone after the start and after each change of it, s: it has settled by then.
const SETTLING: f64 = 10.0;

/// A time as the nearest whole number of ticks, s.
#[must_use]
pub fn on_tick(scenario: &Scenario, time: f64) -> f64 {
    let tick = nanoseconds(scenario.schedule.tick).max(1);
    seconds((nanoseconds(time) + tick / 2) / tick * tick)
}

/// So many moments, spread evenly over the calm parts of the flight: with 10 s since anything happened, and
/// `watched` (s) until it does. Where nothing is calm, over the flight.
#[must_use]
pub fn spread(scenario: &Scenario, count: usize, watched: f64) -> Vec<f64> {
    let mut calm = calm_parts(scenario, watched);
    if calm.is_empty() {
        calm.push((0.0, scenario.duration));
    }
    let whole: f64 = calm.iter().map(|(from, to)| to - from).sum();
    (0..count)
        .map(|number| {
            let share = (number as f64 + 0.5) / count as f64;
            on_tick(scenario, at(&calm, share * whole))
        })
        .collect()
}

/// Begins and ends of the calm parts, s.
fn calm_parts(scenario: &Scenario, watched: f64) -> Vec<(f64, f64)> {
    let changes = scenario.vehicle.change.iter().map(|change| change.at);
    let mut happenings: Vec<f64> = changes.chain([0.0, scenario.duration]).collect();
    happenings.sort_by(f64::total_cmp);
    happenings
        .windows(2)
        .map(|pair| (pair[0] + SETTLING, pair[1] - watched))
        .filter(|(from, to)| from < to)
        .collect()
}

/// The moment that lies so far into the parts, s.
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

    #[test]
    fn faults_begin_when_the_vehicle_has_settled_and_is_left_alone() {
        // It changes at 30 s.
        let scenario = scenario(0.001, 60.0);
        assert_eq!(calm_parts(&scenario, 8.0), [(10.0, 22.0), (40.0, 52.0)]);
        assert_eq!(spread(&scenario, 3, 8.0), [14.0, 22.0, 48.0]);
        assert_eq!(spread(&scenario, 1, 8.0), [22.0]);
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
