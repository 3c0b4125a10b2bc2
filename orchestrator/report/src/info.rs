//! Content of a log, with the summary and host log beside it.

mod words;

use std::collections::BTreeMap;
use std::path::Path;

use scenario::{Recorded, Scenario};
use serde::Serialize;
use serde_json::Value;
use shared_types::{Header, ServiceId, Topic};

use metrics::loss::Loss;
use metrics::stretch::Metrics;
use metrics::summary::faults::ReceiverFault;
use metrics::summary::{FlightSummary, Kill, RunFacts, Summary};
use metrics::tracker::StateSource;
use run_log::run_folder::read_summary_beside;
use run_log::{
    FORMAT_VERSION, LogReadError, LogReader, Recovery, files_of_log, host_log_beside, inspect, is_whole,
};

/// Content of a log.
#[derive(Debug, Serialize)]
pub struct Info {
    /// Path of the log.
    pub log: String,
    /// Number of files; one, unless the log was split.
    pub files: usize,
    /// Total size of the files.
    pub bytes: u64,
    /// Completeness of the log.
    pub state: State,
    /// Reading error, if the log is incomplete.
    pub reason: Option<String>,
    /// Gaps of a recovered log; for an incomplete log, the result that a recovery would have.
    pub recovery: Option<Recovery>,
    /// Version of the log format.
    pub format_version: u32,
    /// The compression of its chunks: `none`, `lz4` or `zstd`.
    pub compression: String,
    /// Chunks read.
    pub chunks: u64,
    /// The scenario of the flight.
    pub scenario: Scenario,
    /// The control law: its name in scenarios, or the plug-in or the program in its place.
    pub control_law: String,
    /// Samples read.
    pub samples: u64,
    /// Tick of the first sample.
    pub first_tick: Option<u64>,
    /// Tick of the last sample.
    pub last_tick: Option<u64>,
    /// Time from the first to the last sample, s.
    pub seconds: f64,
    /// Topics with samples, in the order of the log.
    pub topics: Vec<TopicInfo>,
    /// Descriptions of the planned faults.
    pub faults: Vec<String>,
    /// Flight metrics computed from the samples; `None` if the scenario makes no schedule.
    pub judged: Option<Judged>,
    /// Content of `summary.json` beside the log, if present.
    pub summary: Option<Value>,
    /// Content of `host.mcap` beside the log, if present.
    pub host: Option<HostInfo>,
}

/// Flight metrics computed from a log's samples.
#[derive(Debug, Serialize)]
pub struct Judged {
    /// The loss of the vehicle, if it was lost.
    pub lost: Option<Loss>,
    /// The kill of the flight, if it was killed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub killed: Option<Kill>,
    /// That no take-off led to the path, and why not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failed_take_off: Option<String>,
    /// A wrong axis or sign in the response to the first commands.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub response: Option<String>,
    /// Source of the vehicle's position.
    pub source: StateSource,
    /// Distance from the path in steady state, by which the flight is judged; `None` if steady state was not reached.
    pub steady: Option<Metrics>,
    /// Distance from the path over the whole flight; `None` if the vehicle never followed the path.
    pub metrics: Option<Metrics>,
}

impl Judged {
    fn from_summary(summary: Summary) -> Self {
        Self {
            lost: summary.lost,
            killed: summary.killed,
            failed_take_off: summary.failed_take_off,
            response: summary.response,
            source: summary.source,
            steady: summary.steady,
            metrics: summary.metrics,
        }
    }
}

/// Completeness of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Closed, all checksums valid.
    Complete,
    /// Closed, all checksums valid, recovered from a damaged or truncated log.
    Recovered,
    /// Never closed, truncated, or missing one of its files.
    Unclosed,
    /// A checksum or the structure is invalid.
    Damaged,
}

/// A topic in a log.
#[derive(Debug, Serialize)]
pub struct TopicInfo {
    /// Name of the topic.
    pub topic: &'static str,
    /// Number of samples.
    pub samples: u64,
    /// Mean rate between the first and the last sample, Hz; `None` for fewer than two samples.
    pub rate: Option<f64>,
    /// Tick of the first sample.
    pub first_tick: u64,
    /// Tick of the last sample.
    pub last_tick: u64,
    /// Gaps in the sequence numbers.
    pub gaps: u64,
    /// Missing sequence numbers.
    pub missing: u64,
}

/// Content of the host log.
#[derive(Debug, Serialize)]
pub struct HostInfo {
    /// Path of the host log.
    pub log: String,
    /// `true` if it is complete.
    pub is_whole: bool,
    /// Number of intact samples of each channel.
    pub samples: BTreeMap<String, u64>,
}

impl Info {
    /// Returns whether the whole log, possibly a recovered one, could be read.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        matches!(self.state, State::Complete | State::Recovered)
    }

    /// Reads a log from start to end, and the files beside it.
    ///
    /// # Errors
    /// [`LogReadError`] if the file is no flight log or cannot be read at all. A damaged or unclosed log is no error: `state`
    /// and `reason` report it.
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
            control_law: control_law(&scenario),
            faults: planned_faults(&scenario),
            judged: judge.map(|judge| Judged::from_summary(judge.finish(RunFacts::default()))),
            scenario,
            summary: read_summary_beside(log),
            host: host_beside(log),
            log: log.display().to_string(),
        })
    }
}

/// Running counts of a topic's samples.
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

/// Returns the program with its arguments, or the plug-in, that flies in place of a service.
#[must_use]
pub fn replacement(scenario: &Scenario, service: ServiceId) -> Option<String> {
    if let Some(words) = scenario.program_of(service) {
        return Some(words.join(" "));
    }
    let library = scenario.plugins.as_ref()?.library_of(service)?;
    Some(library.display().to_string())
}

/// Returns the control law that flies, as the scenario names it.
fn control_law(scenario: &Scenario) -> String {
    match replacement(scenario, ServiceId::Controller) {
        Some(library) if scenario.has_plugin(ServiceId::Controller) => format!("the plug-in {library}"),
        Some(words) => format!("the program {words}"),
        None => {
            let law = serde_json::to_value(scenario.controller.law);
            law.ok()
                .and_then(|law| Some(law.as_str()?.to_owned()))
                .unwrap_or_default()
        }
    }
}

fn planned_faults(scenario: &Scenario) -> Vec<String> {
    let words = |at: f64, lasts: Option<f64>, words: String| {
        let lasts = lasts.map_or_else(|| "for good".to_owned(), |lasts| format!("for {lasts} s"));
        format!("from {at} s {lasts}: {words}")
    };
    let faults = scenario.fault.iter();
    let faults = faults.map(|fault| words(fault.at, fault.lasts, fault.to_string()));
    let of_receiver = ReceiverFault::all(scenario).into_iter();
    let of_receiver =
        of_receiver.map(|fault| words(fault.at, fault.until.map(|until| until - fault.at), fault.words));
    faults.chain(of_receiver).collect()
}

fn host_beside(log: &Path) -> Option<HostInfo> {
    let path = host_log_beside(log)?;
    Some(HostInfo {
        is_whole: is_whole(&path).ok()?,
        samples: inspect(&path).map_or_else(|_| BTreeMap::new(), |found| found.samples),
        log: path.display().to_string(),
    })
}

#[cfg(test)]
mod tests {
    use scenario::{LawKind, Plugins, Programs};

    use super::*;

    #[test]
    fn the_control_law_is_named_as_in_the_scenario_or_by_what_flies_in_its_place() {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenarios/fig1.toml"));
        let mut scenario = scenario_file::load(path, &[], None).unwrap();
        assert_eq!(control_law(&scenario), "adaptive");
        scenario.controller.law = LawKind::NfConstant;
        assert_eq!(control_law(&scenario), "nf_constant");
        scenario.programs = Some(Programs::own_controller("mine.Hover".to_owned()));
        assert_eq!(control_law(&scenario), "the program mine.Hover");
        scenario.programs = None;
        scenario.plugins = Some(Plugins {
            controller: Some("libpid.so".into()),
            ..Plugins::default()
        });
        assert_eq!(control_law(&scenario), "the plug-in libpid.so");
    }
}
