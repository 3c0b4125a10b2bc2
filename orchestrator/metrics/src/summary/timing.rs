//! The timing of a flight in real time.

use std::time::Duration;

use comfy_table::{Table, presets};
use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};

/// The timing of a flight in real time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TimingReport {
    /// Of each service.
    pub services: Vec<ServiceTiming>,
    /// Latency from the publication of a capture to that of the frame computed from it.
    pub capture_to_frame: Option<Distribution>,
    /// Topics of which samples were published and not recorded, and how many.
    pub unrecorded: Vec<Unrecorded>,
}

/// The timing of one service.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ServiceTiming {
    /// Name of the service.
    pub service: &'static str,
    /// Executed steps.
    pub steps: u64,
    /// Steps skipped because their time had passed.
    pub missed_steps: u64,
    /// Inputs of the tick of a step that had not come when the grace was over.
    pub late_inputs: u64,
    /// Inputs of steps that were not the samples due by the schedule.
    pub stale_inputs: u64,
    /// Records of steps that were overwritten before they were read.
    pub records_overwritten: u64,
    /// Delay from the earliest possible begin of a step to its begin.
    pub wake: Option<Distribution>,
    /// Duration from the begin of a step to its last publication.
    pub step: Option<Distribution>,
}

/// Samples of a topic that were published and not recorded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Unrecorded {
    /// Name of the topic.
    pub topic: &'static str,
    /// The number of samples.
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
    /// Number of measurements.
    pub count: u64,
    /// Median, s.
    pub p50: f64,
    /// 90 %, s.
    pub p90: f64,
    /// 99 %, s.
    pub p99: f64,
    /// 99.9 %, s.
    pub p999: f64,
    /// Maximum, s.
    pub max: f64,
}

/// Distribution of times: quantiles for users, and buckets for programs, which can be merged with those of other services
/// and flights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Distribution {
    /// Quantiles of all times.
    #[serde(flatten)]
    pub quantiles: Quantiles,
    /// Non-empty buckets.
    pub buckets: Vec<Bucket>,
}

/// Bucket of a histogram with a resolution of two digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Bucket {
    /// Upper limit, ns.
    pub up_to_ns: u64,
    /// The number of measurements.
    pub count: u64,
}

impl Distribution {
    /// Makes the distribution of a histogram of times in ns; `None` if it is empty.
    #[must_use]
    pub fn of(histogram: &Histogram<u64>) -> Option<Self> {
        let bucket = |value: hdrhistogram::iterators::IterationValue<u64>| Bucket {
            up_to_ns: value.value_iterated_to(),
            count: value.count_at_value(),
        };
        Some(Self {
            quantiles: Quantiles::of(histogram)?,
            buckets: histogram.iter_recorded().map(bucket).collect(),
        })
    }

    /// Converts to a histogram.
    #[must_use]
    pub fn histogram(&self) -> Histogram<u64> {
        let mut merged = histogram();
        for bucket in &self.buckets {
            merged.saturating_record_n(bucket.up_to_ns, bucket.count);
        }
        merged
    }
}

impl Quantiles {
    /// Makes the quantiles of a histogram of times in ns; `None` if it is empty.
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
    /// Describes the lateness of the machine, if steps were skipped or inputs were late.
    #[must_use]
    pub fn lateness(&self) -> Option<String> {
        let counts = match (self.steps_left_out(), self.late_inputs()) {
            (0, 0) => return None,
            (0, late) => format!("{late} inputs came late"),
            (left_out, 0) => format!("{left_out} steps were left out"),
            (left_out, late) => format!("{left_out} steps were left out and {late} inputs came late"),
        };
        let worst = self.worst_wake().map_or_else(String::new, |worst| {
            format!(", the worst step began {:.1} ms after it could have", 1e3 * worst)
        });
        Some(format!("{counts}{worst}"))
    }

    /// Returns the number of skipped steps.
    #[must_use]
    pub fn steps_left_out(&self) -> u64 {
        self.services.iter().map(|timing| timing.missed_steps).sum()
    }

    /// Inputs of the tick of a step that had not come when the grace was over.
    #[must_use]
    pub fn late_inputs(&self) -> u64 {
        self.services.iter().map(|timing| timing.late_inputs).sum()
    }

    /// Returns the maximum delay of the begin of a step, s.
    #[must_use]
    pub fn worst_wake(&self) -> Option<f64> {
        let wakes = self.services.iter().filter_map(|timing| timing.wake.as_ref());
        wakes.map(|wake| wake.quantiles.max).max_by(f64::total_cmp)
    }

    /// Samples of a topic that were published and not recorded.
    #[must_use]
    pub fn unrecorded_of(&self, topic: &str) -> u64 {
        let of_topic = self
            .unrecorded
            .iter()
            .filter(|unrecorded| unrecorded.topic == topic);
        of_topic.map(|unrecorded| unrecorded.samples).sum()
    }
}

impl std::fmt::Display for TimingReport {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let table = |header: &[&str]| {
            let mut table = Table::new();
            table.load_style(presets::UTF8_HORIZONTAL_ONLY).set_header(header);
            table
        };
        let mut counts = table(&["service", "steps", "left out", "late inputs", "stale inputs"]);
        let mut times = table(&[
            "service",
            "began late by, µs\np50 / p99 / p99.9 / max",
            "step took, µs\np50 / p99 / max",
        ]);
        for timing in &self.services {
            counts.add_row([
                timing.service.to_owned(),
                timing.steps.to_string(),
                timing.missed_steps.to_string(),
                timing.late_inputs.to_string(),
                timing.stale_inputs.to_string(),
            ]);
            times.add_row([
                timing.service.to_owned(),
                in_words(
                    timing.wake.as_ref(),
                    &[|q| q.p50, |q| q.p99, |q| q.p999, |q| q.max],
                ),
                in_words(timing.step.as_ref(), &[|q| q.p50, |q| q.p99, |q| q.max]),
            ]);
        }
        writeln!(formatter, "{counts}\n{times}")?;
        let chain = in_words(
            self.capture_to_frame.as_ref(),
            &[|q| q.p50, |q| q.p90, |q| q.p99, |q| q.p999, |q| q.max],
        );
        write!(
            formatter,
            "From capture to frame, µs: {chain}\n(p50 / p90 / p99 / p99.9 / max)."
        )
    }
}

fn in_words(distribution: Option<&Distribution>, wanted: &[fn(&Quantiles) -> f64]) -> String {
    let Some(Distribution { quantiles, .. }) = distribution else {
        return "–".to_owned();
    };
    let numbers: Vec<_> = wanted
        .iter()
        .map(|of| format!("{:.0}", 1e6 * of(quantiles)))
        .collect();
    numbers.join(" / ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn recorded(times: &[u64]) -> Histogram<u64> {
        let mut recorded = histogram();
        times.iter().for_each(|&time| recorded.saturating_record(time));
        recorded
    }

    proptest! {
        #[test]
        fn what_is_written_of_two_flights_merges_to_what_would_be_written_of_both(
            first in prop::collection::vec(1u64..10_000_000_000, 1..50),
            second in prop::collection::vec(1u64..10_000_000_000, 1..50),
        ) {
            let read_back = |times: &[u64]| {
                let text = serde_json::to_string(&Distribution::of(&recorded(times))).unwrap();
                let distribution: Distribution = serde_json::from_str(&text).unwrap();
                distribution.histogram()
            };
            let mut merged = read_back(&first);
            merged.add(read_back(&second)).unwrap();
            let both = recorded(&[first, second].concat());
            prop_assert_eq!(Distribution::of(&merged).unwrap().buckets, Distribution::of(&both).unwrap().buckets);
            for quantile in [0.5, 0.9, 0.99, 0.999] {
                prop_assert_eq!(merged.value_at_quantile(quantile), both.value_at_quantile(quantile));
            }
        }
    }

    #[test]
    fn of_nothing_there_is_no_distribution() {
        assert_eq!(Distribution::of(&histogram()), None);
    }
}
