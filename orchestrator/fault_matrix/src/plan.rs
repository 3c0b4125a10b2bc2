//! The flights of the matrix.

use scenario::{EdgeName, Problem, Scenario, Target};
use serde::Serialize;
use shared_types::ServiceId;

use super::fault_kind::MatrixFault;
use super::injection_times;
use metrics::summary::faults::PlannedFault;

/// Returns the services that can fail: all but the plant, which is the vehicle itself.
pub fn services() -> impl Iterator<Item = ServiceId> {
    let all = ServiceId::ALL.into_iter();
    all.filter(|&service| service != ServiceId::Plant)
}

/// Fault kind and target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MatrixCase {
    pub target: Target,
    pub fault: MatrixFault,
}

/// Injection times, and durations of the fault and of the flight after it, s.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Times {
    /// Injection times.
    pub moments: Vec<f64>,
    /// Duration of a fault.
    pub lasts: f64,
    /// Time flown after a fault.
    pub after: f64,
}

/// One flight of the matrix.
#[derive(Clone, Debug)]
pub struct MatrixCell {
    /// The fault and its target; `None` in an undisturbed flight.
    pub case: Option<MatrixCase>,
    /// Injection time, also in an undisturbed flight, s.
    pub moment: f64,
    /// The scenario of the flight; it ends some time after the fault.
    pub scenario: Scenario,
    /// The fault that the flight's evaluation expects, also in an undisturbed flight.
    pub watched: PlannedFault,
}

/// Returns all applicable combinations of services, edges and kinds, the services first.
#[must_use]
pub fn cases(services: &[ServiceId], edges: &[EdgeName], faults: &[MatrixFault]) -> Vec<MatrixCase> {
    let services = services.iter().copied().map(Target::Service);
    let edges = edges.iter().copied().map(Target::Edge);
    let targets: Vec<Target> = services.chain(edges).collect();
    targets
        .into_iter()
        .flat_map(|target| {
            let fitting = faults.iter().filter(move |fault| fault.applies_to(target));
            fitting.map(move |&fault| MatrixCase { target, fault })
        })
        .collect()
}

/// Returns an undisturbed cell for every injection time, then one for every case and injection time.
///
/// # Errors
/// The first problem of a cell's scenario.
pub fn cells(scenario: &Scenario, cases: &[MatrixCase], times: &Times) -> Result<Vec<MatrixCell>, Problem> {
    let rows = std::iter::once(None).chain(cases.iter().copied().map(Some));
    rows.flat_map(|case| times.moments.iter().map(move |&moment| (case, moment)))
        .map(|(case, moment)| cell(scenario, case, moment, times))
        .collect()
}

fn cell(
    plain: &Scenario,
    case: Option<MatrixCase>,
    moment: f64,
    times: &Times,
) -> Result<MatrixCell, Problem> {
    let mut scenario = plain.clone();
    if let Some(MatrixCase { target, fault }) = case {
        scenario.fault = vec![fault.fault(target, plain, moment, times.lasts)];
        // Validated before the duration is cut: events planned after the new end are no problem.
        if let Some(problem) = scenario.problems().into_iter().next() {
            return Err(problem);
        }
    }
    let end = injection_times::on_tick(plain, moment + times.lasts + times.after);
    // Beyond the planned end where needed: a recovery that is cut off is neither a loss nor a survival.
    scenario.duration = end;
    Ok(MatrixCell {
        case,
        moment,
        watched: PlannedFault {
            words: scenario
                .fault
                .first()
                .map_or_else(|| "nothing".to_owned(), ToString::to_string),
            from: scenario.tick_of(moment),
            until: Some(scenario.tick_of(injection_times::on_tick(plain, moment + times.lasts))),
        },
        scenario,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use run_log::test_flight::scenario_of_own_controller as scenario;

    fn times() -> Times {
        Times {
            moments: vec![2.0, 15.0],
            lasts: 0.1,
            after: 3.0,
        }
    }

    #[test]
    fn the_whole_matrix_has_every_service_but_the_plant_and_every_edge_in_all_ways() {
        let services: Vec<_> = services().collect();
        let flight = scenario(0.001, 20.0);
        let schedule = flight.schedule().unwrap();
        let edges: Vec<_> = EdgeName::all()
            .filter(|edge| schedule.has_topic(edge.topic))
            .collect();
        let cases = cases(&services, &edges, &MatrixFault::ALL);
        assert_eq!(cases.len(), 3 * (ServiceId::ALL.len() - 1) + 6 * edges.len());
        assert!(
            cases
                .iter()
                .all(|case| case.target != Target::Service(ServiceId::Plant))
        );
        let cells = cells(&flight, &cases, &times()).unwrap();
        assert_eq!(cells.len(), 2 * (cases.len() + 1));
        assert!(cells[..2].iter().all(|cell| cell.scenario.fault.is_empty()));
        assert!(cells[2..].iter().all(|cell| cell.scenario.fault.len() == 1));
    }

    #[test]
    fn a_cell_ends_some_time_after_its_fault_also_beyond_the_end_of_the_flight() {
        let cells = cells(&scenario(0.001, 17.0), &[], &times()).unwrap();
        let ends: Vec<_> = cells.iter().map(|cell| cell.scenario.duration).collect();
        assert_eq!(ends, [5.1, 18.1]);
        assert_eq!(
            (cells[0].watched.from, cells[0].watched.until),
            (2000, Some(2100))
        );
    }

    #[test]
    fn a_moment_that_the_flight_does_not_have_is_refused() {
        let late = Times {
            moments: vec![20.5],
            ..times()
        };
        let case = MatrixCase {
            target: Target::Service(ServiceId::Controller),
            fault: MatrixFault::Freeze,
        };
        let problem = cells(&scenario(0.001, 20.0), &[case], &late).unwrap_err();
        assert_eq!(problem.key.to_string(), "fault.0.at");
    }
}
