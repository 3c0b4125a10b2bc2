//! Downsampled time series: the smallest and the largest value of each bucket of samples.

use serde::Serialize;
use shared_types::schedule::Rate;
use shared_types::service::seconds;
use shared_types::{Schedule, Topic};

use super::encoding::base64;
use crate::plot::downsample::Extreme;

/// Maximum number of buckets for a topic of a single log. With all channels of a flight they take some 2 MB.
const MAX_BUCKETS: u64 = 6_000;

/// Returns the maximum number of buckets for each topic of each log, so that the page's size does not grow with the number of
/// logs.
pub(super) fn buckets(logs: usize) -> u64 {
    MAX_BUCKETS * 2 / (logs as u64).max(2)
}

/// Channels of one topic over time.
///
/// A bucket spans `samples_per_bucket` due samples of the topic. A series has two values of each bucket, the extremes in the
/// order of time, or one if a bucket is a single sample; a bucket without samples has NaN.
pub(super) struct Table {
    rate: Rate,
    tick_ns: u64,
    samples_per_bucket: u64,
    /// Index of the current bucket.
    bucket: u64,
    series: Vec<Series>,
}

/// One channel.
struct Series {
    name: String,
    values: Vec<f32>,
    /// Extremes of the current bucket.
    extreme: Option<Extreme>,
}

/// A table as the page reads it.
#[derive(Serialize)]
pub(super) struct PageTable {
    /// Time of the first sample of the first bucket, s.
    first: f64,
    /// Time between the first samples of consecutive buckets, s.
    step: f64,
    samples_per_bucket: u64,
    /// Values of a bucket: 2, or 1 if the bucket is a single sample.
    values_per_bucket: u64,
    series: Vec<PageSeries>,
}

/// A channel as the page reads it.
#[derive(Serialize)]
struct PageSeries {
    name: String,
    /// Little-endian f32 in base 64.
    values: String,
}

impl Table {
    /// Makes an empty table of these channels with at most `buckets` buckets.
    pub(super) fn new(topic: Topic, names: &[impl ToString], schedule: &Schedule, buckets: u64) -> Self {
        let rate = schedule.topic_rate(topic);
        let samples = rate.count_before(schedule.last_tick() + 1);
        Self {
            rate,
            tick_ns: schedule.tick_ns(),
            samples_per_bucket: samples.div_ceil(buckets).max(1),
            bucket: 0,
            series: names
                .iter()
                .map(|name| Series {
                    name: name.to_string(),
                    values: Vec::new(),
                    extreme: None,
                })
                .collect(),
        }
    }

    /// Adds the values of a tick, in the order of the names. Values that are not finite are ignored.
    pub(super) fn add(&mut self, tick: u64, values: &[f64]) {
        let bucket = self.rate.count_before(tick) / self.samples_per_bucket;
        while self.bucket < bucket {
            self.close_bucket();
        }
        for (series, &value) in self.series.iter_mut().zip(values) {
            if value.is_finite() {
                let point = (tick as f64, value);
                match &mut series.extreme {
                    Some(extreme) => extreme.add(point),
                    none => *none = Some(Extreme::new(point)),
                }
            }
        }
    }

    fn close_bucket(&mut self) {
        let values_per_bucket = self.values_per_bucket();
        for series in &mut self.series {
            let [first, second] = series.extreme.take().map_or([f32::NAN; 2], |extreme| {
                extreme.in_order().map(|(_, value)| as_shown(value))
            });
            series.values.push(first);
            if values_per_bucket == 2 {
                series.values.push(second);
            }
        }
        self.bucket += 1;
    }

    fn values_per_bucket(&self) -> u64 {
        self.samples_per_bucket.min(2)
    }

    /// Returns the table for the page, without channels that never had a value.
    pub(super) fn finish(mut self) -> PageTable {
        self.close_bucket();
        let step = self.samples_per_bucket * self.rate.period * self.tick_ns;
        let values_per_bucket = self.values_per_bucket();
        PageTable {
            first: seconds(self.rate.phase * self.tick_ns),
            step: seconds(step),
            samples_per_bucket: self.samples_per_bucket,
            values_per_bucket,
            series: self
                .series
                .into_iter()
                .filter(|series| series.values.iter().any(|value| !value.is_nan()))
                .map(|series| PageSeries {
                    name: series.name,
                    values: base64(&series.values),
                })
                .collect(),
        }
    }
}

/// Largest magnitude shown: the page's axes have no ticks for much larger numbers.
const LARGEST: f64 = 1e30;

/// Clamps a value to the range that the page can show; a diverged flight exceeds it.
fn as_shown(value: f64) -> f32 {
    value.clamp(-LARGEST, LARGEST) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoding::decoded;
    use proptest::prelude::*;

    fn values(table: &PageTable, name: &str) -> Option<Vec<f32>> {
        let series = table.series.iter().find(|series| series.name == name)?;
        Some(decoded(&series.values))
    }

    fn table(ticks: u64, buckets: u64) -> Table {
        let schedule = Schedule::ideal(10_000_000, ticks);
        Table::new(Topic::VehicleTruth, &["a", "b"], &schedule, buckets)
    }

    proptest! {
        #[test]
        fn every_bucket_keeps_its_extremes_in_the_order_of_time(
            values in proptest::collection::vec(-1e3..1e3f64, 2..300),
            buckets in 1..50u64,
        ) {
            let last_tick = values.len() as u64 - 1;
            let mut table = table(last_tick, buckets);
            for (tick, &value) in values.iter().enumerate() {
                table.add(tick as u64, &[value, f64::NAN]);
            }
            let page = table.finish();
            prop_assert!(self::values(&page, "b").is_none(), "a channel without values is left out");
            let kept = self::values(&page, "a").unwrap();
            let size = page.samples_per_bucket as usize;
            prop_assert!(values.len().div_ceil(size) as u64 <= buckets);
            prop_assert_eq!(kept.len(), values.len().div_ceil(size) * page.values_per_bucket as usize);
            for (bucket, kept) in values.chunks(size).zip(kept.chunks(page.values_per_bucket as usize)) {
                let least = bucket.iter().copied().fold(f64::INFINITY, f64::min) as f32;
                let greatest = bucket.iter().copied().fold(f64::NEG_INFINITY, f64::max) as f32;
                let position = |wanted: f32| bucket.iter().position(|&value| value as f32 == wanted);
                let expected = if position(least) <= position(greatest) {
                    [least, greatest]
                } else {
                    [greatest, least]
                };
                prop_assert_eq!(kept, &expected[..kept.len()]);
            }
        }
    }

    #[test]
    fn a_gap_stays_a_gap() {
        let mut table = table(9, 5);
        for tick in [0, 1, 6, 7] {
            table.add(tick, &[tick as f64, 0.0]);
        }
        let page = table.finish();
        assert_eq!(page.samples_per_bucket, 2);
        let kept = values(&page, "a").unwrap();
        assert_eq!(kept[..2], [0.0, 1.0]);
        assert!(kept[2..6].iter().all(|value| value.is_nan()));
        assert_eq!(kept[6..], [6.0, 7.0]);
    }

    #[test]
    fn a_bucket_of_one_sample_has_one_value_at_its_time() {
        let mut table = table(3, 100);
        for tick in 0..=3 {
            table.add(tick, &[tick as f64, 0.0]);
        }
        let page = table.finish();
        assert_eq!((page.first, page.step), (0.0, 0.01));
        assert_eq!(values(&page, "a").unwrap(), [0.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn a_value_gone_wrong_is_still_a_number() {
        assert_eq!([1e300, -1e300, 0.5].map(as_shown), [1e30, -1e30, 0.5]);
    }

    #[test]
    fn two_logs_share_what_one_has() {
        assert_eq!(buckets(1), buckets(2));
        assert_eq!(buckets(4), buckets(2) / 2);
    }
}
