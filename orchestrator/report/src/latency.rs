//! Timing of the services in real time: histograms of the steps recorded in `host.mcap`.

use std::path::Path;

use scenario::Scenario;
use serde::Serialize;
use shared_types::{Schedule, ServiceId};

use run_log::{HostReadError, HostReader, host_log_beside};

/// Edges of the bins in a decade.
const EDGES: [u64; 10] = [100, 126, 158, 200, 251, 316, 398, 501, 631, 794];

/// Number of decades, from 100 ns up.
const DECADES: u32 = 7;

/// A histogram of times.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Histogram {
    /// Name of the service.
    service: &'static str,
    /// The measured quantity.
    what: &'static str,
    /// Lower edges of the bins, s. The first bin also counts shorter times, and the last one all longer times.
    edges: Vec<f64>,
    /// Times in each bin.
    counts: Vec<u64>,
}

impl Histogram {
    fn new(service: &'static str, what: &'static str) -> Self {
        let edges: Vec<f64> = edges().map(|edge| edge as f64 / 1e9).collect();
        Self {
            service,
            what,
            counts: vec![0; edges.len()],
            edges,
        }
    }

    fn count(&mut self, time_ns: u64) {
        let above = edges().take_while(|&edge| edge <= time_ns).count();
        self.counts[above.saturating_sub(1)] += 1;
    }

    fn is_empty(&self) -> bool {
        self.counts.iter().all(|&count| count == 0)
    }
}

/// Edges of all bins, ns.
fn edges() -> impl Iterator<Item = u64> {
    (0..DECADES).flat_map(|decade| EDGES.map(|edge| edge * 10_u64.pow(decade)))
}

/// Returns histograms of the start delay and the duration of each service's steps, and the error if the host log breaks off.
/// There are none for a flight in simulated time.
pub(super) fn histograms(
    log: &Path,
    scenario: &Scenario,
    schedule: &Schedule,
) -> (Vec<Histogram>, Option<HostReadError>) {
    let (steps, mut broken) = match host_log_beside(log)
        .map(|path| HostReader::open(&path))
        .transpose()
    {
        Ok(steps) => (steps, None),
        Err(error) => (None, Some(error)),
    };
    let mut late = ServiceId::ALL
        .map(|service| Histogram::new(scenario.process_name(service), "step began after its tick"));
    let mut long = ServiceId::ALL.map(|service| Histogram::new(scenario.process_name(service), "step took"));
    for found in steps.into_iter().flat_map(HostReader::steps) {
        let (service, step) = match found {
            Ok(found) => found,
            Err(error) => {
                broken = Some(error);
                break;
            }
        };
        late[service.index()].count(step.began_ns.saturating_sub(schedule.time_ns(step.tick)));
        // The duration of a step in which a process died is not recorded.
        if step.published_ns != 0 {
            long[service.index()].count(step.published_ns.saturating_sub(step.began_ns));
        }
    }
    let pairs = late.into_iter().zip(long);
    let mut histograms: Vec<_> = pairs.flat_map(|(late, long)| [late, long]).collect();
    histograms.retain(|histogram| !histogram.is_empty());
    (histograms, broken)
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use super::*;

    #[test]
    fn every_time_is_counted_in_the_bin_that_holds_it() {
        let mut histogram = Histogram::new("plant", "step took");
        assert!(histogram.is_empty() && histogram.edges.is_sorted());
        for time_ns in [0, 100, 125, 126, 999_999, 1_000_000, u64::MAX] {
            histogram.count(time_ns);
        }
        assert_eq!(histogram.counts[..2], [3, 1]);
        let millisecond = histogram.edges.iter().position(|&edge| edge >= 1e-3).unwrap();
        assert_eq!(histogram.counts[millisecond - 1..=millisecond], [1, 1]);
        assert_eq!(histogram.counts.last(), Some(&1));
    }

    #[test]
    fn a_flight_without_a_record_of_the_machine_has_none_and_a_damaged_record_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let flown = run_log::test_flight::scenario(0.001, 0.01);
        let schedule = flown.schedule().unwrap();
        let log = folder.path().join("run.mcap");
        let (found, broken) = histograms(&log, &flown, &schedule);
        assert!(found.is_empty() && broken.is_none());
        std::fs::write(folder.path().join("host.mcap"), "this is no log").unwrap();
        let (found, broken) = histograms(&log, &flown, &schedule);
        assert!(
            found.is_empty() && matches!(broken, Some(HostReadError::Damaged { .. })),
            "{broken:?}"
        );
    }
}
