//! Content and gaps of a recovered log, as stored in the log.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::RangeInclusive;

use mcap::records::Metadata;
use serde::{Deserialize, Serialize};

/// Kept and lost parts of a log, stored in the recovered log to distinguish it from a complete one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Recovery {
    /// Name of the source file.
    pub source: String,
    /// `true` if the source had an end record; otherwise the number of samples after the last one is unknown.
    pub was_closed: bool,
    /// Chunks that were kept.
    pub chunks: u64,
    /// Samples that were kept, by topic.
    pub samples: BTreeMap<String, u64>,
    /// Number of the last samples without a valid checksum: those of a truncated chunk at the end of the source.
    pub unverified: u64,
    /// Messages in valid chunks that are not samples of a known type.
    pub strange: u64,
    /// The damaged places, in their order.
    pub gaps: Vec<Gap>,
    /// First and last sample, if any.
    pub span: Option<[SampleTime; 2]>,
    /// Last tick of the scenario; `None` in a log of the machine.
    pub planned_last_tick: Option<u64>,
    /// `true` if the manifest was damaged and the user has stated the scenario.
    pub is_scenario_restated: bool,
    /// Number of the next file of a split log, if it exists.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goes_on_in: Option<u64>,
    /// Recovery of the source, if that was a recovered log.
    pub earlier: Option<Box<Recovery>>,
}

/// Time at which a sample was published.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SampleTime {
    /// Tick; `None` in a log of the machine.
    pub tick: Option<u64>,
    /// Time, ns.
    pub time_ns: u64,
}

/// A damaged place of a log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// Offset in the source, bytes.
    pub at: u64,
    /// Length, bytes.
    pub bytes: u64,
    /// Number of samples of the recovered log before the gap.
    pub samples_before: u64,
    /// Last sample before the gap.
    pub after: Option<SampleTime>,
    /// First sample after the gap, if any.
    pub before: Option<SampleTime>,
    /// Missing samples by topic, from the numbers of the samples around the gap.
    pub lost: BTreeMap<String, u64>,
}

impl Gap {
    /// Returns whether samples are missing, or may be.
    #[must_use]
    pub fn lacks_samples(&self) -> bool {
        self.before.is_none() || !self.lost.is_empty()
    }
}

impl Recovery {
    /// Name of the metadata record.
    pub(crate) const RECORD_NAME: &str = "gerono_recovery";

    const REPORT_KEY: &str = "report";
    const WORDS_KEY: &str = "in words";

    /// Returns the number of kept samples.
    #[must_use]
    pub fn kept(&self) -> u64 {
        total(self.samples.values())
    }

    /// Returns the number of samples known to be missing between others.
    #[must_use]
    pub fn lost(&self) -> u64 {
        total(self.gaps.iter().flat_map(|gap| gap.lost.values()))
    }

    /// Returns whether the log is complete up to the planned end.
    #[must_use]
    pub fn lacks_nothing(&self) -> bool {
        let ends_as_planned = match self.planned_last_tick {
            Some(planned) => self.last_tick() == Some(planned),
            None => self.was_closed && self.gaps.iter().all(|gap| gap.before.is_some()),
        };
        let is_whole = self.lost() == 0 && self.strange == 0 && ends_as_planned;
        is_whole
            && self
                .earlier
                .as_ref()
                .is_none_or(|earlier| earlier.lacks_nothing())
    }

    /// Returns whether samples of these ticks are missing between others, or may be.
    #[must_use]
    pub fn lacks_samples_in(&self, ticks: &RangeInclusive<u64>) -> bool {
        let tick_of = |moment: Option<SampleTime>| moment.and_then(|moment| moment.tick);
        let lacks = |gap: &Gap| {
            let after = tick_of(gap.after).unwrap_or_default();
            let before = tick_of(gap.before).unwrap_or(u64::MAX);
            !gap.lost.is_empty() && after <= *ticks.end() && before >= *ticks.start()
        };
        let earlier = self.earlier.as_ref();
        self.gaps.iter().any(lacks) || earlier.is_some_and(|earlier| earlier.lacks_samples_in(ticks))
    }

    /// Returns the tick of the last sample.
    #[must_use]
    pub fn last_tick(&self) -> Option<u64> {
        self.span.and_then(|[_, last]| last.tick)
    }

    pub(crate) fn to_metadata(&self) -> Metadata {
        let report = serde_json::to_string(self).expect("a report has only string keys");
        Metadata {
            name: Self::RECORD_NAME.to_owned(),
            metadata: BTreeMap::from([
                (Self::REPORT_KEY.to_owned(), report),
                (Self::WORDS_KEY.to_owned(), self.to_string()),
            ]),
        }
    }

    /// Converts from metadata.
    pub(crate) fn from_metadata(metadata: &BTreeMap<String, String>) -> Option<Self> {
        serde_json::from_str(metadata.get(Self::REPORT_KEY)?).ok()
    }
}

impl fmt::Display for Recovery {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            formatter,
            "kept {} samples in {} chunks",
            self.kept(),
            self.chunks
        )?;
        if let Some([first, last]) = self.span {
            write!(formatter, ", from {first} to {last}")?;
        }
        writeln!(formatter)?;
        if self.unverified > 0 {
            writeln!(
                formatter,
                "  the last {} of them are under no checksum: the file breaks off within their chunk",
                self.unverified
            )?;
        }
        for gap in &self.gaps {
            writeln!(formatter, "  {gap}")?;
        }
        if self.strange > 0 {
            writeln!(
                formatter,
                "  {} messages were none of ours and left out",
                self.strange
            )?;
        }
        if self.is_scenario_restated {
            writeln!(
                formatter,
                "  the manifest was damaged; the scenario is the one that was given"
            )?;
        }
        if let Some(earlier) = &self.earlier {
            writeln!(
                formatter,
                "  {} was a recovered log itself: {earlier}",
                self.source
            )?;
        }
        write!(formatter, "  {}", self.ending())
    }
}

impl Recovery {
    /// Describes the end of the log, in words.
    #[must_use]
    pub fn ending(&self) -> String {
        if self.lacks_nothing() {
            return "nothing is missing".to_owned();
        }
        if let Some(number) = self.goes_on_in {
            return format!("the log goes on in its file {number}");
        }
        let planned = match (self.planned_last_tick, self.last_tick()) {
            (Some(planned), Some(last)) if last < planned => {
                format!(
                    "it ends {} ticks before the planned end (tick {planned})",
                    planned - last
                )
            }
            (Some(planned), None) => format!("planned were ticks 0 to {planned}"),
            _ => "it reaches to its end".to_owned(),
        };
        let known = if self.was_closed {
            ""
        } else {
            "; the file was never closed, so how much came after is not known"
        };
        planned + known
    }
}

/// Returns the saturating sum of counts, which a damaged log may falsify.
fn total<'a>(counts: impl IntoIterator<Item = &'a u64>) -> u64 {
    counts.into_iter().copied().fold(0, u64::saturating_add)
}

impl fmt::Display for Gap {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { at, bytes, .. } = self;
        write!(formatter, "damaged from byte {at} on ({bytes} bytes): ")?;
        let from = self
            .after
            .map_or_else(|| "the begin".to_owned(), |after| after.to_string());
        let Some(before) = self.before else {
            return write!(formatter, "nothing was kept after {from}");
        };
        if self.lost.is_empty() {
            return formatter.write_str("no samples were lost");
        }
        let total = total(self.lost.values());
        let begins_ns = self.after.map_or(0, |after| after.time_ns);
        let seconds = before.time_ns.saturating_sub(begins_ns) as f64 * 1e-9;
        write!(
            formatter,
            "lost {total} samples of {seconds:.3} s between {from} and {before}: "
        )?;
        let topics: Vec<_> = self
            .lost
            .iter()
            .map(|(topic, count)| format!("{count} of {topic}"))
            .collect();
        formatter.write_str(&topics.join(", "))
    }
}

impl fmt::Display for SampleTime {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = self.time_ns as f64 * 1e-9;
        match self.tick {
            Some(tick) => write!(formatter, "tick {tick} ({seconds:.3} s)"),
            None => write!(formatter, "{seconds:.3} s"),
        }
    }
}
