//! Metrics of a stretch of a flight: the whole flight, or the part between two changes of the vehicle.

use serde::{Deserialize, Serialize};
use shared_types::samples::RcFrame;
use shared_types::service::seconds;

use super::SETTLED;
use super::percentiles::Percentiles;
use super::statistics::Statistics;
use super::tracker::Moment;

/// Distance from the path and effort in a stretch, while the vehicle flew along the path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// First and last moment, s since the start of the flight.
    pub span: [f64; 2],
    /// Number of moments, one per sample of the vehicle.
    pub moments: u64,
    /// Root mean square of the distance from the path, m.
    pub rmse: f64,
    /// Mean distance, m.
    pub mean: f64,
    /// Standard deviation of the distance, m.
    pub deviation: f64,
    /// Median distance, m.
    pub p50: f64,
    /// 95 % quantile of the distance, m.
    pub p95: f64,
    /// 99 % quantile of the distance, m.
    pub p99: f64,
    /// Maximum distance, m.
    pub max: f64,
    /// Time of the maximum, s since the start of the flight.
    pub time_of_max: f64,
    /// Time from the first moment after which the distance stayed below [`SETTLED`], s; `None` if it did not.
    pub settling_time: Option<f64>,
    /// Mean of the thrust T, N.
    pub thrust_mean: f64,
    /// Root mean square of the body rates ‖ω‖, rad/s.
    pub body_rate_rms: f64,
    /// Share of the radio's frames in which a limit changed the command; `None` without frames.
    pub saturated_share: Option<f64>,
}

/// Running [`Metrics`] in constant memory.
#[derive(Clone, Debug, Default)]
pub struct Stretch {
    distance: Statistics,
    percentiles: Percentiles,
    /// First and last moment, ns.
    span_ns: Option<[u64; 2]>,
    /// Time of the maximum distance, ns.
    largest_ns: u64,
    settled_since_ns: Option<u64>,
    thrust: Statistics,
    body_rate: Statistics,
    frames: u64,
    saturated_frames: u64,
}

impl Stretch {
    /// Adds a moment; ignores moments at which the vehicle does not fly along the path.
    #[inline]
    pub fn observe(&mut self, moment: &Moment) {
        let Some(distance) = moment.distance_on_path() else {
            return;
        };
        let time_ns = moment.vehicle.time_ns;
        if self.span_ns.is_none() || distance > self.distance.max() {
            self.largest_ns = time_ns;
        }
        let first_ns = self.span_ns.map_or(time_ns, |[first, _]| first);
        self.span_ns = Some([first_ns, time_ns]);
        self.distance.add(distance);
        self.percentiles.add(distance);
        self.settled_since_ns = (distance < SETTLED).then(|| self.settled_since_ns.unwrap_or(time_ns));
        self.thrust.add(moment.vehicle.thrust);
        let [x, y, z] = moment.vehicle.angular_velocity_body;
        self.body_rate.add((x * x + y * y + z * z).sqrt());
    }

    /// Adds a frame that was sent on the path.
    #[inline]
    pub fn observe_frame(&mut self, frame: &RcFrame) {
        self.frames += 1;
        self.saturated_frames += u64::from(frame.saturated.is_set());
    }

    /// Appends the stretch that follows.
    pub fn join(&mut self, later: &Self) {
        self.frames += later.frames;
        self.saturated_frames += later.saturated_frames;
        let Some([begin, end]) = later.span_ns else {
            return;
        };
        if self.span_ns.is_none() || later.distance.max() > self.distance.max() {
            self.largest_ns = later.largest_ns;
        }
        // If the later stretch was settled from its first moment on, the settled time of the earlier one continues.
        let continues = self.span_ns.is_some() && later.settled_since_ns == Some(begin);
        self.settled_since_ns = self
            .settled_since_ns
            .filter(|_| continues)
            .or(later.settled_since_ns);
        self.span_ns = Some([self.span_ns.map_or(begin, |[first, _]| first), end]);
        self.distance.join(&later.distance);
        self.percentiles.join(&later.percentiles);
        self.thrust.join(&later.thrust);
        self.body_rate.join(&later.body_rate);
    }

    /// Returns the metrics; `None` if the vehicle never flew along the path.
    #[must_use]
    pub fn finish(&self) -> Option<Metrics> {
        let [first_ns, last_ns] = self.span_ns?;
        let max = self.distance.max();
        let percentile = |share| self.percentiles.at(share).map(|distance| distance.min(max));
        Some(Metrics {
            span: [first_ns, last_ns].map(seconds),
            moments: self.distance.count(),
            rmse: self.distance.rmse(),
            mean: self.distance.mean(),
            deviation: self.distance.deviation(),
            p50: percentile(0.5)?,
            p95: percentile(0.95)?,
            p99: percentile(0.99)?,
            max,
            time_of_max: seconds(self.largest_ns),
            settling_time: self
                .settled_since_ns
                .map(|since| seconds(since.saturating_sub(first_ns))),
            thrust_mean: self.thrust.mean(),
            body_rate_rms: self.body_rate.rmse(),
            saturated_share: (self.frames > 0).then(|| self.saturated_frames as f64 / self.frames as f64),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use shared_types::FlightPhase;
    use zerocopy::FromZeros;

    fn moment(time_ns: u64, distance: f64, phase: FlightPhase) -> Moment {
        let mut moment = Moment::hovering(time_ns, Some(distance), phase);
        moment.vehicle.angular_velocity_body = [0.0, 3.0, 4.0];
        moment
    }

    fn of(distances: &[f64]) -> Metrics {
        let mut stretch = Stretch::default();
        for (&distance, step) in distances.iter().zip(1..) {
            stretch.observe(&moment(10_000_000 * step, distance, FlightPhase::Fly));
        }
        stretch.finish().unwrap()
    }

    #[test]
    fn only_what_is_flown_along_the_path_counts() {
        let mut stretch = Stretch::default();
        for phase in [FlightPhase::TakeOff, FlightPhase::Land, FlightPhase::Disarmed] {
            stretch.observe(&moment(0, 9.0, phase));
        }
        assert_eq!(stretch.finish(), None);
        stretch.observe(&moment(5, 0.5, FlightPhase::Fly));
        assert_eq!(stretch.finish().unwrap().max, 0.5);
    }

    #[test]
    fn a_distance_has_its_time_and_settles_when_it_falls_below_two_centimetres_for_good() {
        let metrics = of(&[0.1, 0.01, 0.3, 0.3, 0.019, 0.0]);
        assert_eq!((metrics.max, metrics.time_of_max), (0.3, 0.03));
        assert_eq!(metrics.settling_time, Some(0.04));
        assert_eq!(of(&[0.01, 0.02]).settling_time, None);
        assert_eq!(of(&[0.0, 0.0]).settling_time, Some(0.0));
    }

    #[test]
    fn effort_is_the_mean_thrust_and_the_root_mean_square_of_the_rates() {
        let metrics = of(&[0.1, 0.2]);
        assert!((metrics.thrust_mean - 2.0).abs() < 1e-15 && (metrics.body_rate_rms - 5.0).abs() < 1e-15);
        assert_eq!(metrics.saturated_share, None);
        let mut stretch = Stretch::default();
        stretch.observe(&moment(0, 0.0, FlightPhase::Fly));
        for is_saturated in [true, false, false, true] {
            stretch.observe_frame(&RcFrame {
                saturated: is_saturated.into(),
                ..RcFrame::new_zeroed()
            });
        }
        assert_eq!(stretch.finish().unwrap().saturated_share, Some(0.5));
    }

    proptest! {
        #[test]
        fn stretches_that_are_joined_have_the_metrics_of_the_whole(
            distances in proptest::collection::vec(prop_oneof![0.0..0.02f64, 0.0..0.1f64], 1..60), place in 0..60usize,
        ) {
            let of_part = |from: usize, to: usize| {
                let mut stretch = Stretch::default();
                for (index, &distance) in distances.iter().enumerate().take(to).skip(from) {
                    stretch.observe(&moment(10_000_000 * (index as u64 + 1), distance, FlightPhase::Fly));
                }
                stretch
            };
            let place = place.min(distances.len());
            let mut joined = of_part(0, place);
            joined.join(&of_part(place, distances.len()));
            let (joined, whole) = (joined.finish().unwrap(), of(&distances));
            prop_assert!((joined.rmse - whole.rmse).abs() < 1e-13);
            let exact = |metrics: &Metrics| {
                let Metrics { span, moments, p50, p95, p99, max, time_of_max, settling_time, .. } = *metrics;
                (span, moments, [p50, p95, p99, max, time_of_max], settling_time)
            };
            prop_assert_eq!(exact(&joined), exact(&whole));
        }

        #[test]
        fn the_numbers_stand_in_the_order_that_they_must(
            distances in proptest::collection::vec(0.0..10.0f64, 1..300),
        ) {
            let metrics = of(&distances);
            prop_assert!(metrics.p50 <= metrics.p95 && metrics.p95 <= metrics.p99 && metrics.p99 <= metrics.max);
            prop_assert!(metrics.mean <= metrics.rmse + 1e-12 && metrics.rmse <= metrics.max + 1e-12);
            let squares = metrics.mean * metrics.mean + metrics.deviation * metrics.deviation;
            prop_assert!((squares - metrics.rmse * metrics.rmse).abs() < 1e-9);
            prop_assert_eq!(metrics.moments, distances.len() as u64);
        }
    }
}
