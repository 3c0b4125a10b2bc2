//! Recovery of a log that was never closed, was truncated, or is damaged.
//!
//! Every chunk with a valid checksum is kept, before and after the damage. A chunk with an invalid checksum is dropped,
//! because its wrong bytes are unknown. Of a truncated chunk at the end of the file the complete messages are kept, if it
//! is not compressed, and counted as unverified. The first metadata of the new log state that it was recovered and what is
//! missing ([`Recovery`]).

mod channels;
mod origin;
mod report;
mod scan;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use mcap::records::Metadata;
use result_file::ResultFile;
use scenario::{Recorded, Scenario};
use shared_types::Topic;

use self::channels::{Channels, Kind, Message, kinds};
use self::scan::{Chunk, Piece, Scan};
use super::compression::Compression;
use super::framing::{Content, LogError, McapFile, is_being_written};
use super::manifest::{COPY_RECORD_NAME, Manifest, ManifestProblem, topics_of};
use super::parts::{Ending, Part, ending, files_after};
use super::reader::LogReadError;

pub(super) use self::origin::{Origin, origin};
pub use self::report::{Gap, Recovery, SampleTime};

/// Reason why a log cannot be recovered.
#[derive(Debug, thiserror::Error)]
pub enum RecoverError {
    /// The file cannot be opened or read.
    #[error("cannot read the log {}: {source}; check the path and your permissions", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// Reading the file would take an excessive amount of work.
    #[error("the log {} is not read to its end: {source}; recover it with another tool if you trust where it is from", .path.display())]
    Implausible {
        /// The file.
        path: PathBuf,
        /// The exceeded limit.
        source: io::Error,
    },
    /// A file with the name of the recovered log exists.
    #[error("{} exists already and is not overwritten; name another file with `--out`, or remove it", .0.display())]
    Exists(PathBuf),
    /// The flight is under way.
    #[error("{} is being written: its flight is under way; its end completes the log", .0.display())]
    UnderWay(PathBuf),
    /// The file is empty.
    #[error("{} is empty: the run ended before its first chunk was written; there is nothing to recover", .0.display())]
    Empty(PathBuf),
    /// The file is a complete log of another program.
    #[error(transparent)]
    Other(LogReadError),
    /// The file has no part of a flight.
    #[error("{} is not a run log: no part of it is one of a flight; give `run.mcap`, `run.mcap.partial` or the folder of a run", .0.display())]
    NoFlight(PathBuf),
    /// The file has no valid sample.
    #[error("{} holds no sample that is whole: there is nothing to recover; fly its scenario again", .0.display())]
    Nothing(PathBuf),
    /// The samples have another layout.
    #[error("the log {} holds samples of another layout of {}; use the program that wrote it", .path.display(), .types.join(", "))]
    Layouts {
        /// The file.
        path: PathBuf,
        /// Names of the types that differ.
        types: Vec<&'static str>,
    },
    /// The manifest is lost.
    #[error("{samples} samples of the log {} are whole, but not its manifest ({source}); state what was flown with `--scenario FILE`, and `--seed` and `--set` as it was flown", .path.display())]
    Manifest {
        /// The file.
        path: PathBuf,
        /// Reason why the manifest cannot be used.
        source: ManifestProblem,
        /// Number of valid samples.
        samples: u64,
    },
    /// The recovered log cannot be written.
    #[error(transparent)]
    Write(#[from] LogError),
}

/// Returns whether a log is complete to its last checksum.
///
/// # Errors
/// [`LogReadError`] if the file cannot be read, or is not a log of this program.
pub fn is_whole(path: &Path) -> Result<bool, LogReadError> {
    Ok(ending(path)? != Ending::Broken)
}

/// Returns the default path of the recovered log: `run.recovered.mcap` for `run.mcap` and `run.mcap.partial`.
#[must_use]
pub fn recovered_path(log: &Path) -> PathBuf {
    let name = log.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.strip_suffix(".partial").unwrap_or(&name);
    let stem = stem.strip_suffix(".mcap").unwrap_or(stem);
    log.with_file_name(format!("{stem}.recovered.mcap"))
}

/// Writes the valid parts of `source`, a log of a flight or of the machine, to `target`. Returns the report.
///
/// `scenario` replaces only that of an unreadable manifest.
///
/// # Errors
/// [`RecoverError`]; then `target` does not exist. The source is never changed.
pub fn recover(source: &Path, target: &Path, scenario: Option<&Scenario>) -> Result<Recovery, RecoverError> {
    if target.symlink_metadata().is_ok() {
        return Err(RecoverError::Exists(target.to_owned()));
    }
    // What is recovered now would stand before the complete log.
    if is_being_written(source) {
        return Err(RecoverError::UnderWay(source.to_owned()));
    }
    let mut kinds = kinds();
    let survey = Survey::of(source, &kinds)?;
    let (part, known) = (survey.part, survey.kinds.len());
    let (manifest, mut recovery) = survey.finish(source, scenario)?;
    // Record the next file, so that its later loss is detected: the statement in the source may be damaged.
    let next = part.and_then(|_| files_after(source).into_iter().next());
    recovery.goes_on_in = next.map(|(number, _)| number);
    if let Some(manifest) = &manifest {
        channels::name_telemetry(&mut kinds, &manifest.scenario);
    }
    let head = Head {
        part,
        manifest: manifest.as_ref(),
        recovery: &recovery,
    };
    write(source, target, &kinds[..known], &head).map_err(|error| match error {
        RecoverError::Write(LogError::NotMade { path, source })
            if source.kind() == io::ErrorKind::AlreadyExists =>
        {
            RecoverError::Exists(path)
        }
        other => other,
    })?;
    Ok(recovery)
}

/// Returns the result that a recovery of a log would have.
///
/// # Errors
/// [`RecoverError::Read`].
pub fn inspect(log: &Path) -> Result<Recovery, RecoverError> {
    let kinds = kinds();
    Survey::of(log, &kinds).map(|survey| survey.recovery)
}

fn unreadable(path: &Path) -> impl Fn(io::Error) -> RecoverError {
    move |source| {
        let path = path.to_owned();
        match source.kind() {
            io::ErrorKind::InvalidData => RecoverError::Implausible { path, source },
            _ => RecoverError::Read { path, source },
        }
    }
}

/// The content of a log.
struct Survey<'a> {
    kinds: &'a [Kind],
    channels: Channels<'a>,
    recovery: Recovery,
    manifest: Result<Manifest, ManifestProblem>,
    /// Position of the file in a split log.
    part: Option<Part>,
    /// Expected number of the next sample of each kind.
    next: Vec<u64>,
    /// Recorded part of each kind of samples.
    recorded: Vec<Recorded>,
    /// Gap since the last sample of each kind.
    open_gap: Vec<Option<usize>>,
}

impl<'a> Survey<'a> {
    /// Surveys a file. In a file with parts of a flight only the flight's samples count: runs do not mix both kinds.
    fn of(source: &Path, kinds: &'a [Kind]) -> Result<Self, RecoverError> {
        let survey = Self::of_kinds(source, kinds)?;
        let is_of_a_flight = survey.part.is_some()
            || survey.has_flown()
            || !matches!(survey.manifest, Err(ManifestProblem::Absent));
        let (topics, machines) = kinds.split_at(Topic::ALL.len());
        let is_there = |kind: &Kind| {
            let is_kept = survey.recovery.samples.contains_key(kind.channel);
            is_kept || survey.channels.other_layouts.contains(&kind.schema)
        };
        if is_of_a_flight && machines.iter().any(is_there) {
            return Self::of_kinds(source, topics);
        }
        Ok(survey)
    }

    /// Surveys a file for samples of these kinds.
    fn of_kinds(source: &Path, kinds: &'a [Kind]) -> Result<Self, RecoverError> {
        let mut survey = Self {
            kinds,
            channels: Channels::new(kinds),
            recovery: Recovery {
                source: source
                    .file_name()
                    .unwrap_or_default()
                    .to_string_lossy()
                    .into_owned(),
                ..Recovery::default()
            },
            manifest: Err(ManifestProblem::Absent),
            part: None,
            next: vec![0; kinds.len()],
            recorded: vec![Recorded::All; kinds.len()],
            open_gap: vec![None; kinds.len()],
        };
        let failed = unreadable(source);
        let mut scan = Scan::open(source).map_err(&failed)?;
        while let Some(piece) = scan.next().map_err(&failed)? {
            match piece {
                Piece::Chunk(chunk) => survey.take(&chunk),
                Piece::Cut { chunk, at, bytes } => {
                    let kept = survey.recovery.kept();
                    survey.take(&chunk);
                    survey.recovery.unverified = survey.recovery.kept() - kept;
                    survey.lose(at, bytes);
                }
                Piece::Metadata(metadata) if metadata.name == Manifest::RECORD_NAME => {
                    survey.take_manifest(Manifest::from_metadata(&metadata.metadata));
                }
                Piece::Metadata(metadata) if metadata.name == Recovery::RECORD_NAME => {
                    survey.recovery.earlier = Recovery::from_metadata(&metadata.metadata).map(Box::new);
                }
                Piece::Metadata(metadata) if metadata.name == Part::RECORD_NAME => {
                    survey.take_part(Part::from_metadata(&metadata.metadata));
                }
                Piece::Metadata(_) => {}
                Piece::Damage { at, bytes } => survey.lose(at, bytes),
                Piece::End => survey.recovery.was_closed = true,
            }
        }
        Ok(survey)
    }

    fn take_manifest(&mut self, manifest: Result<Manifest, ManifestProblem>) {
        if let Ok(Manifest { scenario, .. }) = &manifest {
            let topics = Recorded::of_topics(scenario);
            self.recorded[..topics.len()].copy_from_slice(&topics);
            let schedule = scenario.schedule().ok();
            self.recovery.planned_last_tick = schedule.map(|schedule| schedule.last_tick());
        }
        self.manifest = manifest;
    }

    /// Records the file's position in its log. The first numbers of a later file are unknown.
    fn take_part(&mut self, part: Option<Part>) {
        self.part = part;
        if self.recovery.kept() == 0 && part.is_some_and(|part| part.number > 0) {
            self.next.fill(u64::MAX);
        }
    }

    fn take(&mut self, chunk: &Chunk) {
        let Self {
            kinds,
            channels,
            recovery,
            next,
            recorded,
            open_gap,
            ..
        } = self;
        recovery.chunks += 1;
        let strange = channels.read(chunk, |message: &Message<'_>| {
            let moment = SampleTime {
                tick: message.tick,
                time_ns: message.header.log_time,
            };
            let name = kinds[message.kind].channel;
            let expected = std::mem::replace(&mut next[message.kind], message.sequence.saturating_add(1));
            if let Some(gap) = open_gap[message.kind].take() {
                let recorded = recorded[message.kind];
                let missing = recorded
                    .count_before(message.sequence)
                    .saturating_sub(recorded.count_before(expected));
                if missing > 0 {
                    recovery.gaps[gap].lost.insert(name.to_owned(), missing);
                }
            }
            if let Some(gap) = recovery.gaps.last_mut() {
                gap.before.get_or_insert(moment);
            }
            *recovery.samples.entry(name.to_owned()).or_default() += 1;
            recovery.span = Some([recovery.span.map_or(moment, |[first, _]| first), moment]);
            Ok::<(), std::convert::Infallible>(())
        });
        let Ok(strange) = strange;
        recovery.strange += strange;
    }

    /// Records a damaged range.
    fn lose(&mut self, at: u64, bytes: u64) {
        let kept = self.recovery.kept();
        if let Some(gap) = self
            .recovery
            .gaps
            .last_mut()
            .filter(|gap| gap.samples_before == kept)
        {
            gap.bytes = at + bytes - gap.at;
            return;
        }
        self.recovery.gaps.push(Gap {
            at,
            bytes,
            samples_before: kept,
            after: self.recovery.span.map(|[_, last]| last),
            before: None,
            lost: BTreeMap::new(),
        });
        self.open_gap.fill(Some(self.recovery.gaps.len() - 1));
    }

    /// Returns whether samples of a flight were found.
    fn has_flown(&self) -> bool {
        let mut topics = Topic::ALL.iter();
        topics.any(|topic| self.recovery.samples.contains_key(topic.name()))
    }

    /// Returns the manifest for the new log, if it is one of a flight, and the report.
    fn finish(
        mut self,
        source: &Path,
        scenario: Option<&Scenario>,
    ) -> Result<(Option<Manifest>, Recovery), RecoverError> {
        let path = source.to_owned();
        if !self.channels.other_layouts.is_empty() {
            let types = self.channels.other_layouts;
            return Err(RecoverError::Layouts { path, types });
        }
        let samples = self.recovery.kept();
        if samples == 0 {
            return Err(nothing_in(path));
        }
        if !self.has_flown() {
            return Ok((None, self.recovery));
        }
        if let (Err(_), Some(scenario)) = (&self.manifest, scenario) {
            self.recovery.is_scenario_restated = true;
            self.take_manifest(Ok(Manifest::new(scenario)));
        }
        match self.manifest {
            Ok(manifest) => Ok((Some(manifest), self.recovery)),
            Err(source) => Err(RecoverError::Manifest {
                path,
                source,
                samples,
            }),
        }
    }
}

/// Returns why there is no sample to recover in a file.
fn nothing_in(path: PathBuf) -> RecoverError {
    match (origin(&path), path.metadata()) {
        (Ok(Origin::Foreign), _) => RecoverError::NoFlight(path),
        (_, Ok(file)) if file.len() == 0 => RecoverError::Empty(path),
        (Ok(_), _) => RecoverError::Nothing(path),
        (Err(source), _) => unreadable(&path)(source),
    }
}

/// Copies the valid parts of `source`, chunk by chunk.
fn write(source: &Path, target: &Path, kinds: &[Kind], head: &Head<'_>) -> Result<(), RecoverError> {
    let failed = unreadable(source);
    let mut scan = Scan::open(source).map_err(&failed)?;
    let mut copy: Option<Copy> = None;
    let mut facts = Vec::new();
    while let Some(piece) = scan.next().map_err(&failed)? {
        match piece {
            Piece::Chunk(chunk) | Piece::Cut { chunk, .. } => {
                if copy.is_none() {
                    let mut begun = Copy::begin(target, kinds, &chunk, head)?;
                    begun.write_facts(std::mem::take(&mut facts))?;
                    copy = Some(begun);
                }
                copy.as_mut().expect("begun above").write(&chunk)?;
            }
            Piece::Metadata(metadata)
                if head.manifest.is_none()
                    && ![Recovery::RECORD_NAME, COPY_RECORD_NAME].contains(&metadata.name.as_str()) =>
            {
                facts.push(metadata);
                if let Some(copy) = &mut copy {
                    copy.write_facts(std::mem::take(&mut facts))?;
                }
            }
            Piece::Metadata(_) | Piece::Damage { .. } | Piece::End => {}
        }
    }
    match copy {
        Some(copy) => Ok(copy.file.finish().map(drop)?),
        None => Err(RecoverError::Nothing(source.to_owned())),
    }
}

/// Metadata of the new log before its samples.
struct Head<'a> {
    part: Option<Part>,
    manifest: Option<&'a Manifest>,
    recovery: &'a Recovery,
}

/// The new log.
struct Copy<'a> {
    file: McapFile,
    kinds: &'a [Kind],
    /// The channels of the old one.
    channels: Channels<'a>,
    /// Declared channels of the new log, by kind.
    numbers: Vec<Option<u16>>,
}

impl<'a> Copy<'a> {
    /// Begins the new log, with the compression of the first chunk.
    fn begin(target: &Path, kinds: &'a [Kind], first: &Chunk, head: &Head<'_>) -> Result<Self, LogError> {
        let compression = Compression::of_name(&first.compression);
        let result = ResultFile::create_new(target);
        let mut copy = Self {
            file: McapFile::create_result(result, Content::Samples, target, compression, None)?,
            kinds,
            channels: Channels::new(kinds),
            numbers: vec![None; kinds.len()],
        };
        copy.write_facts(vec![head.recovery.to_metadata()])?;
        if let Some(part) = head.part {
            copy.file.write_metadata(Part::RECORD_NAME, part.to_metadata())?;
        }
        if let Some(manifest) = head.manifest {
            copy.file
                .write_metadata(Manifest::RECORD_NAME, manifest.to_metadata())?;
            for topic in topics_of(&manifest.scenario) {
                declare(&mut copy.file, kinds, &mut copy.numbers, topic.index())?;
            }
        }
        Ok(copy)
    }

    fn write_facts(&mut self, facts: Vec<Metadata>) -> Result<(), LogError> {
        facts
            .into_iter()
            .try_for_each(|fact| self.file.write_metadata(&fact.name, fact.metadata))
    }

    fn write(&mut self, chunk: &Chunk) -> Result<(), LogError> {
        let Self {
            file, kinds, numbers, ..
        } = self;
        self.channels.read(chunk, |message| {
            let number = declare(file, kinds, numbers, message.kind)?;
            let header = &message.header;
            file.write(number, header.sequence, header.log_time, message.sample)
        })?;
        self.file.flush()
    }
}

/// Returns the number of a kind's channel; declares it at the first call.
fn declare(
    file: &mut McapFile,
    kinds: &[Kind],
    numbers: &mut [Option<u16>],
    kind: usize,
) -> Result<u16, LogError> {
    if let Some(number) = numbers[kind] {
        return Ok(number);
    }
    let of = &kinds[kind];
    let number = file.declare_channel(of.channel, of.schema, &of.definition, &of.layout)?;
    numbers[kind] = Some(number);
    Ok(number)
}
