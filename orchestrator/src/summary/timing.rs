//! How well a flight in real time kept time.

use std::time::Duration;

use comfy_table::{Table, presets};
use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};

/// The timing of a flight in real time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TimingReport {
    /// Of each service.
    pub services: Vec<ServiceTiming>,
    /// From the publication of a capture to that of the frame that rests on it.
    pub capture_to_frame: Option<Quantiles>,
    /// Topics of which samples were published and not recorded, and how many.
    pub unrecorded: Vec<Unrecorded>,
}

/// The timing of one service.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ServiceTiming {
    /// Name of the service.
    pub service: &'static str,
    /// Steps that it did.
    pub steps: u64,
    /// Steps that it left out because their time had passed.
    pub missed_steps: u64,
    /// Inputs of the tick of a step that had not come when the grace was over.
    pub late_inputs: u64,
    /// Inputs of steps that were not the samples due by the schedule.
    pub stale_inputs: u64,
    /// Records of steps that were overwritten before they were read.
    pub records_overwritten: u64,
    /// From the moment when it could have stepped until it did.
    pub wake: Option<Quantiles>,
    /// From the begin of a step until all was published.
    pub step: Option<Quantiles>,
}

/// Samples of a topic that were published and not recorded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Unrecorded {
    /// Name of the topic.
    pub topic: &'static str,
    /// How many.
    pub samples: u64,
}

/// An empty histogram of times in ns to two digits, from 1 ns to a minute.
///
/// # Panics
/// Never: the bounds are those of a histogram.
#[must_use]
pub fn histogram() -> Histogram<u64> {
    Histogram::new_with_bounds(1, 60_000_000_000, 2).expect("the bounds are those of a histogram")
}

/// Quantiles of a time, s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quantiles {
    /// How many times were measured.
    pub count: u64,
    /// Median, s.
    pub p50: f64,
    /// 90 %, s.
    pub p90: f64,
    /// 99 %, s.
    pub p99: f64,
    /// 99.9 %, s.
    pub p999: f64,
    /// The longest, s.
    pub max: f64,
}

impl Quantiles {
    /// Those of a histogram of times in ns, if it has any.
    #[must_use]
    pub fn of(histogram: &Histogram<u64>) -> Option<Self> {
        let seconds = |nanoseconds: u64| Duration::from_nanos(nanoseconds).as_secs_f64();
        let at = |quantile| seconds(histogram.value_at_quantile(quantile));
        (!histogram.is_empty()).then(|| Self {
            count: histogram.len(),
            p50: at(0.5),
            p90: at(0.9),
            p99: at(0.99),
            p999: at(0.999),
            max: seconds(histogram.max()),
        })
    }
}

impl TimingReport {
    /// Steps left out and inputs late or not those due, of all services: none of them in a flight that is that of
    /// lock-step, sample by sample.
    #[must_use]
    pub fn deviations(&self) -> u64 {
        let of = |timing: &ServiceTiming| timing.missed_steps + timing.stale_inputs;
        self.services.iter().map(of).sum()
    }
}

impl std::fmt::Display for TimingReport {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut rows = Table::new();
        rows.load_style(presets::UTF8_HORIZONTAL_ONLY).set_header([
            "service",
            "steps",
            "missed",
            "late inputs",
            "stale inputs",
            "began late by, µs\np50 / p99 / p99.9 / max",
            "step, µs\np50 / p99 / max",
        ]);
        for timing in &self.services {
            rows.add_row([
                timing.service.to_owned(),
                timing.steps.to_string(),
                timing.missed_steps.to_string(),
                timing.late_inputs.to_string(),
                timing.stale_inputs.to_string(),
                in_words(
                    timing.wake.as_ref(),
                    &[|q| q.p50, |q| q.p99, |q| q.p999, |q| q.max],
                ),
                in_words(timing.step.as_ref(), &[|q| q.p50, |q| q.p99, |q| q.max]),
            ]);
        }
        writeln!(formatter, "{rows}")?;
        let chain = in_words(
            self.capture_to_frame.as_ref(),
            &[|q| q.p50, |q| q.p90, |q| q.p99, |q| q.p999, |q| q.max],
        );
        write!(
            formatter,
            "From capture to frame, µs: {chain} (p50 / p90 / p99 / p99.9 / max)."
        )?;
        for Unrecorded { topic, samples } in &self.unrecorded {
            write!(
                formatter,
                "\nNot recorded: {samples} samples of {topic}; the log has gaps there."
            )?;
        }
        Ok(())
    }
}

fn in_words(quantiles: Option<&Quantiles>, wanted: &[fn(&Quantiles) -> f64]) -> String {
    let Some(quantiles) = quantiles else {
        return "–".to_owned();
    };
    let numbers: Vec<_> = wanted
        .iter()
        .map(|of| format!("{:.0}", 1e6 * of(quantiles)))
        .collect();
    numbers.join(" / ")
}
