//! The content of a log, and the facts beside it about its run.

mod words;

use std::collections::BTreeMap;
use std::path::Path;

use scenario::{Recorded, Scenario};
use serde::Serialize;
use serde_json::Value;
use shared_types::{Header, Topic};

use metrics::loss::Loss;
use metrics::stretch::Metrics;
use metrics::summary::{FlightSummary, RunFacts, Summary};
use metrics::tracker::StateSource;
use run_log::run_folder::summary_text_beside;
use run_log::{
    FORMAT_VERSION, LogReadError, LogReader, Recovery, files_of_log, host_log_beside, inspect, is_whole,
};

/// The content of a log.
#[derive(Debug, Serialize)]
pub struct Info {
    /// The file.
    pub log: String,
    /// Its files: one, unless it was split.
    pub files: usize,
    /// The size of all of them.
    pub bytes: u64,
    /// Whether all of it is there.
    pub state: State,
    /// If not, what ended the reading.
    pub reason: Option<String>,
    /// The gaps of the log, if it was recovered; of a log that is not whole, the result that a recovery would have.
    pub recovery: Option<Recovery>,
    /// Version of its arrangement.
    pub format_version: u32,
    /// The compression of its chunks: `none`, `lz4` or `zstd`.
    pub compression: String,
    /// Chunks read.
    pub chunks: u64,
    /// The scenario of the flight.
    pub scenario: Scenario,
    /// Samples read.
    pub samples: u64,
    /// Tick of the first sample.
    pub first_tick: Option<u64>,
    /// Tick of the last sample.
    pub last_tick: Option<u64>,
    /// Time from the first to the last sample, s.
    pub seconds: f64,
    /// The topics that have samples, in the order of the log.
    pub topics: Vec<TopicInfo>,
    /// The planned faults, in words.
    pub faults: Vec<String>,
    /// The vehicle's flight by the samples; none of a log whose scenario makes no schedule.
    pub judged: Option<Judged>,
    /// `summary.json` beside the log, if it is there.
    pub summary: Option<Value>,
    /// `host.mcap` beside the log, if it is there.
    pub host: Option<HostInfo>,
}

/// The vehicle's flight by a log's samples.
#[derive(Debug, Serialize)]
pub struct Judged {
    /// The loss of the vehicle, if it was lost.
    pub lost: Option<Loss>,
    /// The source of its position.
    pub source: StateSource,
    /// Its distance from the path in steady state, by which the flight is judged; none if that was not flown.
    pub steady: Option<Metrics>,
    /// Its distance from the path in all of the flight; none if it never flew along it.
    pub metrics: Option<Metrics>,
}

impl Judged {
    fn of(summary: Summary) -> Self {
        Self {
            lost: summary.lost,
            source: summary.source,
            steady: summary.steady,
            metrics: summary.metrics,
        }
    }
}

/// Whether all of a log is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// It was closed, and all checksums hold.
    Complete,
    /// It is a proper file, made of what was left of another one.
    Recovered,
    /// It was never closed, its end is cut off, or a file in which it goes on is missing.
    Unclosed,
    /// It is not what was written.
    Damaged,
}

/// A topic in a log.
#[derive(Debug, Serialize)]
pub struct TopicInfo {
    /// Its name.
    pub topic: &'static str,
    /// Its samples.
    pub samples: u64,
    /// Samples a second of the flight, between the first and the last one; none if there are not two.
    pub rate: Option<f64>,
    /// Tick of the first one.
    pub first_tick: u64,
    /// Tick of the last one.
    pub last_tick: u64,
    /// Places where sequence numbers are left out.
    pub gaps: u64,
    /// Numbers that are left out.
    pub missing: u64,
}

/// The log of the machine.
#[derive(Debug, Serialize)]
pub struct HostInfo {
    /// The file.
    pub log: String,
    /// `true` if it is whole.
    pub is_whole: bool,
    /// Samples of each channel that are whole.
    pub samples: BTreeMap<String, u64>,
}

impl Info {
    /// Returns whether all of the log could be read, or is what was left of another one.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        matches!(self.state, State::Complete | State::Recovered)
    }

    /// Reads a log from begin to end, and what lies beside it.
    ///
    /// # Errors
    /// [`LogReadError`] if it is no log of a flight or cannot be read at all; what is only damaged or never closed is told.
    pub fn read(log: &Path) -> Result<Self, LogReadError> {
        let mut reader = LogReader::open(log)?;
        let mut tallies = Topic::ALL.map(|_| None::<Tally>);
        let mut span: Option<[Header; 2]> = None;
        let mut samples = 0;
        let scenario = reader.manifest().scenario.clone();
        let schedule = scenario.schedule().ok();
        let recorded = Recorded::of_topics(&scenario);
        let mut judge = schedule.map(|schedule| FlightSummary::new(&scenario, &schedule));
        let end = loop {
            match reader.next_sample() {
                Ok(Some(sample)) => {
                    samples += 1;
                    if let Some(judge) = &mut judge {
                        judge.observe(sample.topic, sample.bytes);
                    }
                    span = Some([span.map_or(sample.header, |[first, _]| first), sample.header]);
                    let at = sample.topic.index();
                    tallies[at]
                        .get_or_insert(Tally::new(sample.header))
                        .count(sample.header, recorded[at]);
                }
                Ok(None) => break Ok(()),
                Err(error @ (LogReadError::Io { .. } | LogReadError::Foreign { .. })) => return Err(error),
                Err(error) => break Err(error),
            }
        };
        let seconds = span.map_or(0.0, |[first, last]| seconds_between(first, last));
        let files = files_of_log(log);
        let sizes = files.iter().filter_map(|file| std::fs::metadata(file).ok());
        Ok(Self {
            files: files.len(),
            bytes: sizes.map(|file| file.len()).sum(),
            state: match &end {
                Ok(()) if reader.recovery().is_some() => State::Recovered,
                Ok(()) => State::Complete,
                Err(LogReadError::Unclosed { .. } | LogReadError::MissingPart { .. }) => State::Unclosed,
                Err(_) => State::Damaged,
            },
            recovery: match &end {
                Ok(()) => reader.recovery().cloned(),
                Err(error) => inspect(error.path()).ok(),
            },
            reason: end.err().map(|error| error.to_string()),
            format_version: FORMAT_VERSION,
            compression: reader.compression().to_owned(),
            chunks: reader.chunks(),
            samples,
            first_tick: span.map(|[first, _]| first.tick),
            last_tick: span.map(|[_, last]| last.tick),
            seconds,
            topics: Topic::ALL
                .into_iter()
                .zip(tallies)
                .filter_map(|(topic, tally)| Some(tally?.finish(topic)))
                .collect(),
            faults: planned_faults(&scenario),
            judged: judge.map(|judge| Judged::of(judge.finish(RunFacts::default()))),
            scenario,
            summary: summary_beside(log),
            host: host_beside(log),
            log: log.display().to_string(),
        })
    }
}

/// The samples of a topic so far.
struct Tally {
    first: Header,
    last: Header,
    samples: u64,
    gaps: u64,
    missing: u64,
}

impl Tally {
    fn new(first: Header) -> Self {
        Self {
            first,
            last: first,
            samples: 0,
            gaps: 0,
            missing: 0,
        }
    }

    fn count(&mut self, header: Header, recorded: Recorded) {
        let due = recorded.count_before(header.seq);
        let missing = due.saturating_sub(recorded.count_before(self.last.seq + 1));
        self.gaps += u64::from(missing > 0);
        self.missing += missing;
        self.samples += 1;
        self.last = header;
    }

    fn finish(self, topic: Topic) -> TopicInfo {
        let seconds = seconds_between(self.first, self.last);
        TopicInfo {
            topic: topic.name(),
            samples: self.samples,
            rate: (seconds > 0.0).then(|| (self.samples - 1) as f64 / seconds),
            first_tick: self.first.tick,
            last_tick: self.last.tick,
            gaps: self.gaps,
            missing: self.missing,
        }
    }
}

fn seconds_between(first: Header, last: Header) -> f64 {
    last.stamp_ns.saturating_sub(first.stamp_ns) as f64 * 1e-9
}

fn planned_faults(scenario: &Scenario) -> Vec<String> {
    let words = |fault: &scenario::Fault| {
        let lasts = fault
            .lasts
            .map_or_else(|| "for good".to_owned(), |lasts| format!("for {lasts} s"));
        format!("from {} s {lasts}: {fault}", fault.at)
    };
    scenario.fault.iter().map(words).collect()
}

fn summary_beside(log: &Path) -> Option<Value> {
    serde_json::from_str(&summary_text_beside(log)?).ok()
}

fn host_beside(log: &Path) -> Option<HostInfo> {
    let path = host_log_beside(log)?;
    Some(HostInfo {
        is_whole: is_whole(&path).ok()?,
        samples: inspect(&path).map_or_else(|_| BTreeMap::new(), |found| found.samples),
        log: path.display().to_string(),
    })
}
