//! Lateness of the machine in a flight in real time, from the summary beside its log: what is fitted to such a flight contains it.

use std::path::Path;

use run_log::run_folder::read_summary_beside;
use serde_json::Value;

/// Share of late steps and inputs above which a flight is unfit.
const MOST_LATE: f64 = 5e-3;

/// Returns that a flight is unfit for a fit, with the next step; `None` if it was on time, or nothing is known of it.
#[must_use]
pub fn warning(log: &Path) -> Option<String> {
    let summary: Value = read_summary_beside(log)?;
    let services = summary["timing"]["services"].as_array()?;
    let sum = |name: &str| {
        services
            .iter()
            .filter_map(|service| service[name].as_u64())
            .sum::<u64>()
    };
    let [steps, left_out, late] = ["steps", "missed_steps", "late_inputs"].map(sum);
    ((left_out + late) as f64 > MOST_LATE * (steps + left_out) as f64).then(|| {
        format!(
            "the machine was late in this flight: of {steps} steps {left_out} were left out, and {late} inputs came late. The values \
             below contain that and are not fit for a scenario: fly again on a machine that keeps its time (`gerono doctor`)"
        )
    })
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use super::*;

    #[test]
    fn a_flight_of_which_a_step_in_a_hundred_was_left_out_is_unfit() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("run.mcap");
        assert_eq!(warning(&log), None);
        let warns = |summary: &str| {
            std::fs::write(folder.path().join("summary.json"), summary).unwrap();
            warning(&log).is_some()
        };
        let timed = |left_out: u32, late: u32| {
            format!(
                "{{\"timing\": {{\"services\": [{{\"steps\": 990, \"missed_steps\": {left_out}, \"late_inputs\": 0}}, \
                 {{\"steps\": 10, \"missed_steps\": 0, \"late_inputs\": {late}}}]}}}}"
            )
        };
        assert!(!warns("{\"host\": \"lockstep\"}") && !warns("no summary"));
        assert!(!warns(&timed(0, 0)) && !warns(&timed(2, 2)));
        assert!(warns(&timed(10, 0)) && warns(&timed(0, 10)));
    }
}
