//! Consistency of inertial navigation: whether its innovations scatter as it predicts, and which sources were cut off.

use std::fmt::{Display, Formatter, Result};

use scenario::Scenario;
use serde::Serialize;
use shared_types::samples::{BaselineInnovations, ImuSample, NavigationInnovations, PoseInnovations};
use shared_types::service::seconds;

/// The sources but poses and baselines, in the order of the sample.
pub const SOURCES: [&str; 6] = [
    "position",
    "velocity",
    "field",
    "altitude",
    "zero velocity",
    "resting rate",
];

/// The sources of poses, in the order of their sample.
pub const POSE_SOURCES: [&str; 2] = ["pose position", "pose attitude"];

/// The source of baselines.
pub const BASELINE_SOURCES: [&str; 1] = ["baseline"];

/// Number of all sources.
const ALL: usize = BASELINE + BASELINE_SOURCES.len();

/// Degrees of freedom of their normalised squares.
pub const FREEDOM: [f64; ALL] = [3.0, 3.0, 3.0, 1.0, 3.0, 3.0, 3.0, 3.0, 3.0];

/// Their 99.9 % quantiles, at which the filter's gates are. A refused square counts as that large, so that a fault does not hide all
/// others.
const LARGEST: [f64; ALL] = [16.27, 16.27, 16.27, 10.83, 16.27, 16.27, 16.27, 16.27, 16.27];

/// The sources that measure at rest only.
const AT_REST: std::ops::Range<usize> = 4..6;

/// The sources that fixes are.
const FIXES: std::ops::Range<usize> = 0..2;

/// Positions by fixes, and by poses.
const POSITION: usize = FIXES.start;
const POSE_POSITION: usize = SOURCES.len();

/// Baselines of two antennas.
pub const BASELINE: usize = SOURCES.len() + POSE_SOURCES.len();

/// Name of the inertial measurement unit, which predicts and has no innovations.
const INERTIAL: &str = "inertial";

/// Time without its samples above which it counts as cut off, s: the state is not tracked then.
const NO_MOTION: f64 = 0.1;

/// Time without a fused measurement above which a source counts as cut off, s. Without fixes the state coasts then; heading and height
/// drift by less than the noise of a field and of an altitude in theirs.
const CUT_OFF: [f64; ALL] = [1.0, 1.0, 3.0, 3.0, f64::INFINITY, f64::INFINITY, 1.0, 1.0, 3.0];

/// Ratio of the mean normalised square to its expectation above which a source is inconsistent: then the errors that the filter does
/// not model are larger than those that it does. Any unmodelled error leaves the 95 % interval of a whole flight, which is narrow:
/// airspeed at a typical barometer makes 1.6 of 1.
const INCONSISTENT: f64 = 2.0;

/// Share of refused measurements above which a source is inconsistent: 0.1 % of consistent ones are beyond the gate, and 4.3 % of those
/// whose variance is twice the predicted one. Airspeed at a typical barometer makes 3 %.
const REFUSED: f64 = 0.05;

/// What became of the measurements of a source.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SourceInnovations {
    /// Name of the source.
    pub source: &'static str,
    /// Measurements fused; of the inertial measurement unit the samples that planned faults did not lose.
    pub fused: u32,
    /// Measurements beyond the gate.
    pub refused: u32,
    /// Measurements that were late, from the future, not finite, or too many.
    pub unusable: u32,
    /// Degrees of freedom of a normalised square, which is the expectation of its mean.
    pub freedom: f64,
    /// Mean normalised square, in which one beyond the gate counts as at the gate; `None` without any.
    pub mean_square: Option<f64>,
    /// Half of the width of its 95 % interval, for independent innovations of the predicted variance.
    pub half_width: f64,
    /// Longest time without a fused measurement, s; `None` for a source that measures only at rest.
    pub largest_gap: Option<f64>,
    /// Time of the last measurement before it, s.
    pub gap_begins: f64,
    /// The gap for which the source counts as cut off, and its begin, s: poses and fixes stand in for each other.
    #[serde(skip)]
    cut_off: Option<[f64; 2]>,
}

/// Running [`SourceInnovations`] in constant memory.
#[derive(Clone, Debug, Default)]
pub(super) struct InnovationWatch {
    /// Time of the last sample, ns; `None` before the first.
    last_ns: Option<u64>,
    tallies: [Tally; ALL],
    /// `true` if the receiver never solves a fix.
    has_no_fixes: bool,
    /// `true` if poses are fused.
    fuses_poses: bool,
    /// `true` if baselines are fused.
    fuses_baselines: bool,
    /// Positions by fixes or poses.
    positions: Tally,
    inertial: Tally,
    /// Samples of the inertial measurement unit that planned faults lost.
    lost: u32,
    /// Time from which a measurement can be fused, ns: that of the first of any source.
    from_ns: Option<u64>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    /// Time of validity of the last measurement, ns.
    valid_ns: u64,
    sum: f64,
    count: u32,
    /// Measurements fused, refused and unusable.
    counts: [u32; 3],
    fused_ns: Option<u64>,
    gap_ns: u64,
    gap_begins_ns: u64,
}

impl Tally {
    /// Ends a stretch without fused measurements.
    fn end_gap(&mut self, from_ns: u64, to_ns: u64) {
        let begins_ns = self.fused_ns.unwrap_or(from_ns);
        let gap_ns = to_ns.saturating_sub(begins_ns);
        if gap_ns > self.gap_ns {
            (self.gap_ns, self.gap_begins_ns) = (gap_ns, begins_ns);
        }
    }
}

impl Tally {
    /// Returns the longest stretch without fused measurements, and its begin, s.
    fn gap(&self) -> [f64; 2] {
        [self.gap_ns, self.gap_begins_ns].map(seconds)
    }
}

/// Adds a sample with the sources from `first` on to a watch.
macro_rules! observe_sources {
    ($watch:ident, $sample:ident, $first:expr) => {
        $watch.last_ns = Some($sample.header.stamp_ns);
        for (index, &valid_ns) in $sample.valid_ns.iter().enumerate() {
            let tally = &mut $watch.tallies[$first + index];
            tally.counts = [$sample.fused, $sample.refused, $sample.unusable].map(|counts| counts[index]);
            // Of several in one step the sample has the last.
            if std::mem::replace(&mut tally.valid_ns, valid_ns) == valid_ns {
                continue;
            }
            let from_ns = *$watch.from_ns.get_or_insert(valid_ns);
            tally.sum += $sample.normalised_squares[index].min(LARGEST[$first + index]);
            tally.count += 1;
            if $sample.accepted[index].is_set() {
                tally.end_gap(from_ns, valid_ns);
                tally.fused_ns = Some(valid_ns);
                if [POSITION, POSE_POSITION].contains(&($first + index)) {
                    $watch.positions.end_gap(from_ns, valid_ns);
                    $watch.positions.fused_ns = $watch.positions.fused_ns.max(Some(valid_ns));
                }
            }
        }
    };
}

impl InnovationWatch {
    /// Makes the watch over a flight of a scenario.
    pub(super) fn new(scenario: &Scenario) -> Self {
        let gnss = scenario.sensors.as_ref().map(|sensors| &sensors.gnss);
        Self {
            has_no_fixes: gnss.is_some_and(|gnss| gnss.least_accurate().is_none()),
            fuses_poses: scenario.fuses_poses() == Some(true),
            fuses_baselines: scenario.baseline().is_some(),
            ..Self::default()
        }
    }

    pub(super) fn observe(&mut self, sample: &NavigationInnovations) {
        observe_sources!(self, sample, 0);
    }

    pub(super) fn observe_poses(&mut self, sample: &PoseInnovations) {
        observe_sources!(self, sample, SOURCES.len());
    }

    pub(super) fn observe_baselines(&mut self, sample: &BaselineInnovations) {
        observe_sources!(self, sample, BASELINE);
    }

    /// Adds a sample of the inertial measurement unit, and whether a planned fault loses it.
    pub(super) fn observe_imu(&mut self, sample: &ImuSample, is_lost: bool) {
        if is_lost {
            self.lost = self.lost.saturating_add(1);
        } else if sample.measured.is_set() {
            let valid_ns = sample.measured_ns;
            self.inertial.end_gap(valid_ns, valid_ns);
            self.inertial.fused_ns = Some(valid_ns);
            self.inertial.count += 1;
        }
    }

    /// Returns what became of the samples of the inertial measurement unit; `None` without any.
    fn inertial(&self, end_ns: u64) -> Option<SourceInnovations> {
        let mut tally = self.inertial;
        tally.end_gap(tally.fused_ns?, end_ns);
        Some(SourceInnovations {
            source: INERTIAL,
            fused: tally.count,
            refused: 0,
            unusable: self.lost,
            freedom: 0.0,
            mean_square: None,
            half_width: 0.0,
            largest_gap: Some(seconds(tally.gap_ns)),
            gap_begins: seconds(tally.gap_begins_ns),
            cut_off: Some(tally.gap()).filter(|[gap, _]| *gap > NO_MOTION),
        })
    }

    /// Returns what became of all sources, the inertial measurement unit last; nothing before the first measurement.
    pub(super) fn finish(&self) -> Vec<SourceInnovations> {
        let (Some(last_ns), Some(from_ns)) = (self.last_ns, self.from_ns) else {
            return Vec::new();
        };
        let mut positions = self.positions;
        positions.end_gap(from_ns, last_ns);
        let of_source = |(index, source): (usize, &'static str)| {
            let (freedom, mut tally) = (FREEDOM[index], self.tallies[index]);
            tally.end_gap(from_ns, last_ns);
            let count = f64::from(tally.count);
            let [fused, refused, unusable] = tally.counts;
            let judged = match index {
                POSE_POSITION => Some(positions.gap()),
                index if self.fuses_poses && (FIXES.contains(&index) || index > POSE_POSITION) => None,
                _ => Some(tally.gap()),
            };
            SourceInnovations {
                source,
                fused,
                refused,
                unusable,
                freedom,
                mean_square: (count > 0.0).then(|| tally.sum / count),
                half_width: 1.96 * (2.0 * freedom / count.max(1.0)).sqrt(),
                largest_gap: (!AT_REST.contains(&index)).then(|| seconds(tally.gap_ns)),
                gap_begins: seconds(tally.gap_begins_ns),
                cut_off: judged.filter(|[gap, _]| *gap > CUT_OFF[index]),
            }
        };
        let is_there = |&(index, _): &(usize, &str)| match index {
            index if FIXES.contains(&index) => !self.has_no_fixes,
            BASELINE => self.fuses_baselines,
            index => index < SOURCES.len() || self.fuses_poses,
        };
        let sources = SOURCES
            .into_iter()
            .chain(POSE_SOURCES)
            .chain(BASELINE_SOURCES)
            .enumerate()
            .filter(is_there);
        sources.map(of_source).chain(self.inertial(last_ns)).collect()
    }
}

impl SourceInnovations {
    /// Describes all that is wrong with the source; `None` if nothing is.
    #[must_use]
    pub fn problem(&self) -> Option<String> {
        let Self { source, .. } = self;
        let cut_off = self
            .cut_off
            .map(|[gap, begins]| format!("cut off for {gap:.1} s from {begins:.1} s on"));
        let of = |mean: f64| mean > INCONSISTENT * self.freedom && mean > self.freedom + self.half_width;
        let mean = self.mean_square.filter(|mean| of(*mean));
        let wrong = mean.map(|mean| {
            let ratio = (mean / self.freedom).sqrt();
            format!("inconsistent, its innovations {ratio:.1} times as large as predicted")
        });
        let judged = f64::from(self.fused) + f64::from(self.refused);
        let refused = (f64::from(self.refused) > REFUSED * judged)
            .then(|| format!("{} of {judged} measurements refused", self.refused));
        let all: Vec<_> = [cut_off, wrong, refused].into_iter().flatten().collect();
        (!all.is_empty()).then(|| format!("{source} {}", all.join(", ")))
    }
}

impl Display for SourceInnovations {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        let Self {
            source,
            fused,
            refused,
            freedom,
            half_width,
            ..
        } = self;
        write!(formatter, "{source:<14}{fused:>7}{refused:>9}  ")?;
        match self.mean_square {
            Some(mean) => write!(formatter, "{mean:>6.3} of {freedom} ± {half_width:.3}")?,
            None => write!(formatter, "{:>18}", "–")?,
        }
        match self.largest_gap {
            Some(gap) => write!(formatter, "{gap:>9.2} s"),
            None => Ok(()),
        }
    }
}

/// Describes all sources as a table.
#[must_use]
pub fn in_words(sources: &[SourceInnovations]) -> String {
    let head = format!(
        "{:<14}{:>7}{:>9}   {:<18}{:>11}",
        "navigation", "fused", "refused", "normalised square", "gap"
    );
    let lines = sources.iter().map(ToString::to_string);
    std::iter::once(head).chain(lines).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    /// A watch of 100 s in which each source is fused at 10 Hz, with these normalised squares per degree of freedom, but for
    /// altitudes from 40 to 52 s.
    fn watched(square: f64, refused: u32) -> Vec<SourceInnovations> {
        let mut watch = InnovationWatch::default();
        let mut sample = NavigationInnovations::new_zeroed();
        for step in 0..=1000_u32 {
            sample.header.stamp_ns = u64::from(step) * 100_000_000;
            watch.observe(&sample);
            for source in (0..SOURCES.len()).filter(|&source| source != 3 || !(400..520).contains(&step)) {
                sample.fused[source] += 1;
                sample.accepted[source] = true.into();
                sample.valid_ns[source] = sample.header.stamp_ns + 1;
                sample.normalised_squares[source] = square * FREEDOM[source];
            }
        }
        sample.refused[2] = refused;
        watch.observe(&sample);
        watch.finish()
    }

    #[test]
    fn of_each_source_the_mean_and_the_longest_gap_are_found() {
        let sources = watched(1.02, 5);
        for (source, freedom) in sources.iter().zip(FREEDOM) {
            assert!(
                (source.mean_square.unwrap() - 1.02 * freedom).abs() < 1e-9,
                "{source:?}"
            );
            assert_eq!(source.freedom, freedom);
        }
        let [position, _, field, altitude, rest, _] = sources.as_slice() else {
            panic!()
        };
        assert_eq!((position.fused, field.refused, altitude.fused), (1001, 5, 881));
        assert!((position.half_width - 1.96 * (6.0 / 1001.0_f64).sqrt()).abs() < 1e-9);
        assert!(
            (altitude.largest_gap.unwrap() - 12.1).abs() < 1e-6 && (altitude.gap_begins - 39.9).abs() < 1e-6
        );
        assert!((position.largest_gap.unwrap() - 0.1).abs() < 1e-6 && rest.largest_gap.is_none());
    }

    #[test]
    fn a_source_that_is_wrong_or_cut_off_is_a_problem_and_no_other() {
        let problems = |sources: Vec<SourceInnovations>| {
            let problems = sources.iter().map(SourceInnovations::problem);
            problems.collect::<Vec<_>>()
        };
        let cut_off = Some("altitude cut off for 12.1 s from 39.9 s on".to_owned());
        assert_eq!(
            problems(watched(1.0, 5)),
            [None, None, None, cut_off.clone(), None, None]
        );
        let refused = Some("field 60 of 1061 measurements refused".to_owned());
        assert_eq!(problems(watched(1.0, 50))[2], None);
        assert_eq!(
            problems(watched(1.0, 60)),
            [None, None, refused, cut_off.clone(), None, None]
        );
        let both = "field inconsistent, its innovations 2.0 times as large as predicted, 60 of 1061 measurements refused";
        assert_eq!(problems(watched(4.0, 60))[2].as_deref(), Some(both));
        assert_eq!(problems(watched(1.95, 0))[1], None);
        assert!(problems(watched(2.05, 0))[1].is_some());
        let wrong = Some("velocity inconsistent, its innovations 2.0 times as large as predicted".to_owned());
        assert_eq!(problems(watched(4.0, 0))[1], wrong);
    }

    #[test]
    fn poses_have_rows_where_they_are_fused_and_fixes_have_none_without_a_receiver() {
        let mut watch = InnovationWatch {
            fuses_poses: true,
            has_no_fixes: true,
            ..InnovationWatch::default()
        };
        let mut sample = PoseInnovations::new_zeroed();
        for step in 1..=1000_u32 {
            sample.header.stamp_ns = u64::from(step) * 10_000_000;
            sample.valid_ns = [sample.header.stamp_ns; 2];
            (sample.fused, sample.accepted) = ([step; 2], [true.into(); 2]);
            sample.normalised_squares = [3.0, 7.5];
            watch.observe_poses(&sample);
        }
        let sources = watch.finish();
        let names: Vec<_> = sources.iter().map(|source| source.source).collect();
        assert_eq!(names[..4], SOURCES[2..]);
        assert_eq!(names[4..], POSE_SOURCES);
        assert_eq!(
            (sources[4].mean_square, sources[5].mean_square),
            (Some(3.0), Some(7.5))
        );
        assert!(sources[4].fused == 1000 && sources[4].problem().is_none());
        assert!(
            sources[5]
                .problem()
                .is_some_and(|problem| problem.contains("inconsistent"))
        );
    }

    #[test]
    fn samples_of_the_inertial_measurement_unit_have_a_row_with_their_longest_gap() {
        let mut watch = InnovationWatch::default();
        let mut sample = ImuSample::new_zeroed();
        sample.measured = true.into();
        for step in 1..=1000_u64 {
            sample.measured_ns = step * 4_000_000;
            watch.observe_imu(&sample, (500..=530).contains(&step));
        }
        let mut innovations = NavigationInnovations::new_zeroed();
        innovations.header.stamp_ns = 4_000_000_000;
        innovations.valid_ns[0] = 1;
        watch.observe(&innovations);
        let sources = watch.finish();
        let inertial = sources.last().unwrap();
        assert_eq!(
            (inertial.source, inertial.fused, inertial.unusable),
            ("inertial", 969, 31)
        );
        assert!((inertial.largest_gap.unwrap() - 0.128).abs() < 1e-9);
        let problem = "inertial cut off for 0.1 s from 2.0 s on";
        assert_eq!(inertial.problem().as_deref(), Some(problem));
    }
}
