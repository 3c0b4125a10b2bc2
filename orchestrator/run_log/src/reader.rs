//! Reader of `run.mcap`: the manifest, then every sample in the order of the file.

use std::collections::{BTreeMap, VecDeque};
use std::error::Error;
use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::{Metadata, Record, op};
use shared_types::sample::CDR_HEADER;
use shared_types::service::header_of;
use shared_types::{Header, Published, Topic};
use zerocopy::IntoBytes;

use super::framing::{LAYOUT_KEY, is_being_written};
use super::manifest::{COPY_RECORD_NAME, FORMAT_VERSION, Manifest, ManifestProblem};
use super::metadata_index::metadata_by_index;
use super::parts::{self, Numbered, Part, files_after, next_number};
use super::records::{self, RawRecord, Records, is_declaration, is_message_index};
use super::recovery::{Origin, Recovery, origin};

/// Reason why a log cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LogReadError {
    /// The file cannot be opened or read.
    #[error("cannot read the log {}: {source}; check the path and your permissions", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The file is not a run log.
    #[error("{} is not a run log: {reason}; give a `run.mcap` that `gerono run` has written", .path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: &'static str,
    },
    /// The manifest is invalid.
    #[error("{} is not a run log: {source}; give a `run.mcap` that `gerono run` has written", .path.display())]
    Manifest {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: ManifestProblem,
    },
    /// The log has another format.
    #[error("the log {} is of format version {found}, this program reads version {FORMAT_VERSION}; use the program that wrote it", .path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// Version of the format.
        found: String,
    },
    /// Samples in the log have another layout.
    #[error("the log {} holds samples of another layout of {}; use the program that wrote it, or fly its scenario again", .path.display(), .types.join(", "))]
    Layouts {
        /// The file.
        path: PathBuf,
        /// Names of the types that differ.
        types: Vec<&'static str>,
    },
    /// The log was never completed.
    #[error("the log {} {}", .path.display(), unclosed_in_words(.path, *.samples, .last_tick))]
    Unclosed {
        /// The file.
        path: PathBuf,
        /// Samples before the break.
        samples: u64,
        /// Tick of the last of them.
        last_tick: Option<u64>,
    },
    /// The log continues in a missing file.
    #[error("the log goes on after {} in {}, which is missing; its {samples} samples before that are whole{}; put the file beside it, or run `gerono recover` on the folder to read the log without it", .path.display(), .missing.display(), last_tick_in_words(.last_tick))]
    MissingPart {
        /// The previous file.
        path: PathBuf,
        /// The missing file.
        missing: PathBuf,
        /// Samples before the break.
        samples: u64,
        /// Tick of the last of them.
        last_tick: Option<u64>,
    },
    /// The log is damaged.
    #[error("the log {} is damaged after {samples} samples: {source}; what was read before is whole; `gerono recover {}` keeps that and what is whole behind the damage", .path.display(), .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Samples before the damage.
        samples: u64,
        /// The violated requirement.
        source: Box<dyn Error + Send + Sync>,
    },
}

fn unclosed_in_words(path: &Path, samples: u64, last_tick: &Option<u64>) -> String {
    if is_being_written(path) {
        return "is being written: its flight is under way; wait for its end, or watch it with `gerono view`"
            .to_owned();
    }
    let path = path.display();
    if samples == 0 {
        return format!(
            "was never completed; it breaks off before its first chunk is whole; `gerono recover {path}` shows what is left of that"
        );
    }
    let last_tick = last_tick_in_words(last_tick);
    format!(
        "was never completed; its {samples} samples before the break are whole{last_tick}; `gerono recover {path}` makes a proper log of them"
    )
}

fn last_tick_in_words(last_tick: &Option<u64>) -> String {
    last_tick.map_or_else(String::new, |tick| format!(", the last of tick {tick}"))
}

impl LogReadError {
    /// Returns whether the log is only incomplete or damaged: samples before the error are valid.
    #[must_use]
    pub fn is_incomplete(&self) -> bool {
        matches!(
            self,
            Self::Unclosed { .. } | Self::MissingPart { .. } | Self::Damaged { .. }
        )
    }

    /// Returns the file that cannot be read further.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::Io { path, .. }
            | Self::Foreign { path, .. }
            | Self::Manifest { path, .. }
            | Self::Version { path, .. }
            | Self::Layouts { path, .. }
            | Self::Unclosed { path, .. }
            | Self::MissingPart { path, .. }
            | Self::Damaged { path, .. } => path,
        }
    }
}

/// A sample as it was logged.
#[derive(Clone, Copy, Debug)]
pub struct LoggedSample<'a> {
    /// The topic.
    pub topic: Topic,
    /// The header.
    pub header: Header,
    /// The bytes, header included, aligned for the type.
    pub bytes: &'a [u8],
}

/// Sequence numbers of the samples of a topic so far. In real time late samples follow newer ones, but none is repeated.
#[derive(Clone, Copy, Debug, Default)]
struct Numbers {
    count: u64,
    /// Minimum and maximum.
    range: Option<[u64; 2]>,
    last: Option<u64>,
}

impl Numbers {
    /// Adds a number. Returns `false` if it repeats the previous one.
    fn take(&mut self, number: u64) -> bool {
        self.count += 1;
        let [least, largest] = self.range.unwrap_or([number; 2]);
        self.range = Some([least.min(number), largest.max(number)]);
        self.last.replace(number) != Some(number)
    }

    /// Returns whether the range has at least as many numbers as there are samples.
    fn may_be_distinct(&self) -> bool {
        self.range
            .is_none_or(|[least, largest]| self.count - 1 <= largest - least)
    }
}

/// Reader of a run log in constant memory.
///
/// A split log is read as one, beginning with the opened file.
pub struct LogReader {
    /// The current file.
    path: PathBuf,
    manifest: Manifest,
    /// Recoveries of the files of the log.
    recoveries: Vec<Recovery>,
    /// Position of the file in a split log.
    part: Option<Part>,
    /// The next files.
    following: VecDeque<Numbered>,
    /// `true` if the file states that another one follows.
    continues: bool,
    /// Number of the next file at the recovery of this one.
    followed_by: Option<u64>,
    /// `true` if the previous file was recovered.
    follows_recovered: bool,
    /// `true` if this file was recovered.
    is_recovered: bool,
    /// Samples of the log before the opened file.
    opened_at: u64,
    /// Samples and chunks in the previous files.
    samples_before: u64,
    chunks_before: u64,
    records: Records<BufReader<File>>,
    record: RawRecord,
    channels: BTreeMap<u16, Topic>,
    schemas: BTreeMap<u16, String>,
    /// Bytes of the sample, aligned to words for any type.
    sample: Vec<u64>,
    samples: u64,
    last_tick: Option<u64>,
    /// Numbers of the samples of each topic.
    numbers: [Numbers; Topic::ALL.len()],
    /// `true` after the last data.
    is_in_summary: bool,
    has_ended: bool,
}

impl LogReader {
    /// Opens a log and reads its manifest.
    ///
    /// # Errors
    /// [`LogReadError`]; in particular [`LogReadError::Layouts`] for other layouts of samples.
    pub fn open(path: &Path) -> Result<Self, LogReadError> {
        Self::open_with(path, true)
    }

    /// Opens a file of a log without the next ones.
    pub(super) fn open_alone(path: &Path) -> Result<Self, LogReadError> {
        Self::open_with(path, false)
    }

    fn open_with(path: &Path, follows: bool) -> Result<Self, LogReadError> {
        let Opened { records, head } = Opened::open(path)?;
        let part = head.part.filter(|_| follows);
        let following = part.map_or_else(Vec::new, |_| files_after(path));
        let is_recovered = head.recovery.is_some();
        let followed_by = followed_by(&head);
        let numbers: Vec<u64> = following.iter().map(|(number, _)| *number).collect();
        let later = following.iter().filter_map(|(number, path)| {
            let opened = Opened::open(path).ok()?;
            Some((*number, opened.head.recovery?))
        });
        let own = head
            .recovery
            .map(|recovery| (part.map_or(0, |part| part.number), recovery));
        let recoveries = own.into_iter().chain(later).map(|(number, mut recovery)| {
            // A file that was missing then may exist again.
            let next = numbers.iter().copied().find(|next| *next > number);
            recovery.goes_on_in = next.or(recovery.goes_on_in);
            recovery
        });
        Ok(Self {
            path: path.to_owned(),
            manifest: head.manifest,
            recoveries: recoveries.collect(),
            part: head.part,
            following: following.into(),
            continues: false,
            followed_by,
            follows_recovered: false,
            is_recovered,
            opened_at: head.part.map_or(0, |part| part.samples_before),
            samples_before: 0,
            chunks_before: 0,
            records,
            record: RawRecord::default(),
            channels: BTreeMap::new(),
            schemas: BTreeMap::new(),
            sample: Vec::new(),
            samples: 0,
            last_tick: None,
            numbers: [Numbers::default(); Topic::ALL.len()],
            is_in_summary: false,
            has_ended: false,
        })
    }

    /// Returns the manifest, which determined the results in the log.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Returns the recovery of the first recovered file of the log, if any.
    #[must_use]
    pub fn recovery(&self) -> Option<&Recovery> {
        self.recoveries.first()
    }

    /// Returns the recoveries of all recovered files of the log.
    #[must_use]
    pub fn recoveries(&self) -> &[Recovery] {
        &self.recoveries
    }

    /// Returns the compression of the last chunk, by its name in `gerono run --compression`.
    #[must_use]
    pub fn compression(&self) -> &str {
        match self.records.chunk.compression.as_str() {
            "" => "none",
            name => name,
        }
    }

    /// Returns the number of chunks read so far.
    #[must_use]
    pub fn chunks(&self) -> u64 {
        self.chunks_before + self.records.chunk.chunks
    }

    /// Returns the next sample in the order of the file; `None` at the end of a complete log.
    ///
    /// # Errors
    /// [`LogReadError::Unclosed`] after the last sample of an incomplete log; [`LogReadError::MissingPart`] after the last
    /// sample before a missing file; [`LogReadError::Damaged`] and [`LogReadError::Io`] at any position. No sample follows an error.
    pub fn next_sample(&mut self) -> Result<Option<LoggedSample<'_>>, LogReadError> {
        if self.has_ended {
            return Ok(None);
        }
        let found = match self.advance() {
            Ok(None) if self.numbers.iter().any(|numbers| !numbers.may_be_distinct()) => Err(self.merged()),
            found => found,
        };
        self.has_ended = !matches!(found, Ok(Some(_)));
        Ok(found?.map(|(topic, header)| LoggedSample {
            topic,
            header,
            bytes: &self.sample.as_bytes()[..topic.kind().size],
        }))
    }

    /// Returns the samples of one topic, in the order of the file.
    pub fn samples<T: Published>(self) -> impl Iterator<Item = Result<T, LogReadError>> {
        let mut reader = self;
        std::iter::from_fn(move || {
            loop {
                match reader.next_sample() {
                    Ok(Some(logged)) if logged.topic == T::TOPIC => {
                        return Some(Ok(
                            T::read_from_bytes(logged.bytes).expect("the reader has checked the size")
                        ));
                    }
                    Ok(Some(_)) => {}
                    Ok(None) => return None,
                    Err(error) => return Some(Err(error)),
                }
            }
        })
    }

    /// Reads the next sample, also from the next file, into `self.sample`.
    fn advance(&mut self) -> Result<Option<(Topic, Header)>, LogReadError> {
        loop {
            let found = match self.advance_in_file() {
                Err(LogReadError::Unclosed { .. }) if self.is_unrecoverable() => return Ok(None),
                found => found?,
            };
            if found.is_some() || !self.open_next_file()? {
                return Ok(found);
            }
        }
    }

    /// Returns whether nothing of this file could be recovered at the recovery of the previous one.
    fn is_unrecoverable(&self) -> bool {
        self.follows_recovered && self.samples == self.samples_before
    }

    /// Opens the next file of a split log. Returns `false` after the last one.
    fn open_next_file(&mut self) -> Result<bool, LogReadError> {
        let Some(part) = self.part else {
            return Ok(false);
        };
        let next = self.following.pop_front();
        let is_there = next
            .as_ref()
            .is_some_and(|(number, _)| *number == part.number + 1);
        let missing = if self.continues && !is_there {
            Some(part.number + 1)
        } else {
            let found = next.as_ref().map_or(u64::MAX, |(number, _)| *number);
            self.followed_by.filter(|followed_by| found > *followed_by)
        };
        if let Some(missing) = missing {
            return Err(LogReadError::MissingPart {
                missing: parts::part_beside(&self.path, missing),
                path: self.path.clone(),
                samples: self.samples,
                last_tick: self.last_tick,
            });
        }
        let Some((number, path)) = next else {
            return Ok(false);
        };
        self.follows_recovered = self.is_recovered;
        self.chunks_before = self.chunks();
        self.samples_before = self.samples;
        self.path = path;
        let Opened { records, head } = match Opened::open(&self.path) {
            Err(LogReadError::Unclosed { .. }) if self.is_unrecoverable() => return Ok(false),
            Err(LogReadError::Unclosed { path, .. }) => {
                return Err(LogReadError::Unclosed {
                    path,
                    samples: self.samples,
                    last_tick: self.last_tick,
                });
            }
            opened => opened?,
        };
        self.check_follows(number, &head)?;
        self.is_recovered = head.recovery.is_some();
        self.followed_by = followed_by(&head);
        self.part = head.part;
        self.records = records;
        self.channels.clear();
        self.schemas.clear();
        self.continues = false;
        self.is_in_summary = false;
        Ok(true)
    }

    /// Checks that a file continues the same flight, without undeclared missing samples.
    fn check_follows(&self, number: u64, head: &LogHead) -> Result<(), LogReadError> {
        let is_next = head.part.is_some_and(|part| {
            let expected = self.opened_at + self.samples;
            part.number == number && (part.samples_before == expected || !self.recoveries.is_empty())
        });
        if is_next && head.manifest == self.manifest {
            return Ok(());
        }
        Err(self.damaged("it is not of the same flight as the file before it"))
    }

    /// Reads the next sample of the file.
    fn advance_in_file(&mut self) -> Result<Option<(Topic, Header)>, LogReadError> {
        loop {
            if !self
                .records
                .next(&mut self.record)
                .map_err(|error| self.explain(error))?
            {
                return Ok(None);
            }
            // Accept only records of MCAP: the samples of a chunk whose kind was damaged would be missing silently until the
            // checksum at the end. Programs that copy logs declare channels outside of chunks, and write metadata and indexes
            // at any position.
            match (self.record.opcode, self.section()) {
                (op::MESSAGE, Section::Chunk) => return self.take_message().map(Some),
                (op::CHANNEL | op::SCHEMA, Section::Chunk) => self.take_declaration()?,
                (op::CHANNEL | op::SCHEMA, Section::Data)
                    if is_declaration(self.record.opcode, &self.record.body) =>
                {
                    self.take_declaration()?;
                }
                (op::MESSAGE_INDEX, Section::Data) if is_message_index(&self.record.body) => {}
                (op::METADATA, Section::Data) if is_declaration(op::METADATA, &self.record.body) => {
                    self.continues |= next_number(&self.record).is_some();
                }
                (op::DATA_END, Section::Data) => self.is_in_summary = true,
                (
                    op::CHANNEL
                    | op::SCHEMA
                    | op::STATISTICS
                    | op::CHUNK_INDEX
                    | op::METADATA_INDEX
                    | op::SUMMARY_OFFSET
                    | op::FOOTER,
                    Section::Summary,
                ) => {}
                (opcode, _) => return Err(self.damaged(format!("a record of kind {opcode} is out of place"))),
            }
        }
    }

    /// Returns the section that contains `self.record`.
    fn section(&self) -> Section {
        match (self.record.is_in_chunk, self.is_in_summary) {
            (true, false) => Section::Chunk,
            (false, false) => Section::Data,
            (false, true) => Section::Summary,
            (true, true) => Section::Nowhere,
        }
    }

    /// Stores the channel or schema in `self.record`.
    fn take_declaration(&mut self) -> Result<(), LogReadError> {
        match records::parse(self.record.opcode, &self.record.body) {
            Ok(Record::Schema { header, .. }) => {
                self.schemas.insert(header.id, header.name);
                Ok(())
            }
            Ok(Record::Channel(channel)) => {
                let schema = self.schemas.get(&channel.schema_id);
                let layout = channel.metadata.get(LAYOUT_KEY);
                let topic = Topic::from_name(&channel.topic).filter(|topic| {
                    schema.is_some_and(|name| name == topic.msg_name())
                        && channel.message_encoding == "cdr"
                        && layout.is_some_and(|layout| topic.padding_in(layout).is_some())
                });
                let Some(topic) = topic else {
                    return Err(self.damaged(format!("the channel `{}` is none of ours", channel.topic)));
                };
                self.channels.insert(channel.id, topic);
                Ok(())
            }
            Ok(_) => Ok(()),
            Err(error) => Err(self.explain(error)),
        }
    }

    /// Copies the sample of the message in `self.record`.
    fn take_message(&mut self) -> Result<(Topic, Header), LogReadError> {
        let (header, data) = match records::parse(op::MESSAGE, &self.record.body) {
            Ok(Record::Message { header, data }) => (header, data),
            Ok(_) => return Err(self.damaged("a message is none")),
            Err(error) => return Err(self.explain(error)),
        };
        let Some(&topic) = self.channels.get(&header.channel_id) else {
            return Err(self.damaged(format!("the channel {} is not declared", header.channel_id)));
        };
        let size = topic.kind().size;
        let Some(sample) = data
            .strip_prefix(&CDR_HEADER)
            .filter(|sample| sample.len() == size)
        else {
            return Err(self.damaged(format!("a message of `{topic}` is not a sample of {size} bytes")));
        };
        self.sample.resize(size.div_ceil(size_of::<u64>()), 0);
        self.sample.as_mut_bytes()[..size].copy_from_slice(sample);
        let sample_header = header_of(sample);
        if sample_header.stamp_ns != header.log_time {
            return Err(self.damaged(format!(
                "a message of `{topic}` and its sample have different times"
            )));
        }
        if !self.numbers[topic.index()].take(sample_header.seq) {
            return Err(self.merged());
        }
        self.samples += 1;
        self.last_tick = Some(sample_header.tick);
        Ok((topic, sample_header))
    }

    fn merged(&self) -> LogReadError {
        LogReadError::Foreign {
            path: self.path.clone(),
            reason: "it holds samples twice, as a log does that another program has merged with one",
        }
    }

    fn explain(&self, error: McapError) -> LogReadError {
        explain(&self.path, error, self.samples, self.last_tick)
    }

    fn damaged(&self, what: impl Into<Box<dyn Error + Send + Sync>>) -> LogReadError {
        LogReadError::Damaged {
            path: self.path.clone(),
            samples: self.samples,
            source: what.into(),
        }
    }
}

fn followed_by(head: &LogHead) -> Option<u64> {
    head.recovery.as_ref().and_then(|recovery| recovery.goes_on_in)
}

/// Section of a file.
#[derive(Clone, Copy)]
enum Section {
    /// In a chunk.
    Chunk,
    /// Between chunks.
    Data,
    /// After all data.
    Summary,
    /// In a chunk after all data, which is not permitted.
    Nowhere,
}

/// Metadata that precede all samples of a file.
struct LogHead {
    manifest: Manifest,
    recovery: Option<Recovery>,
    part: Option<Part>,
}

/// File whose metadata have been read.
struct Opened {
    records: Records<BufReader<File>>,
    head: LogHead,
}

impl Opened {
    fn open(path: &Path) -> Result<Self, LogReadError> {
        Self::open_a_log(path).map_err(|error| explain_by_origin(path, error))
    }

    fn open_a_log(path: &Path) -> Result<Self, LogReadError> {
        let failed = |source| LogReadError::Io {
            path: path.to_owned(),
            source,
        };
        let file = File::open(path).map_err(failed)?;
        let file_bytes = file.metadata().map_err(failed)?.len();
        let mut records = Records::new(BufReader::with_capacity(1 << 16, file), file_bytes);
        if let Some(head) = read_head(path, &mut records)? {
            return Ok(Self { records, head });
        }
        // Another program has moved the metadata behind the samples; the summary has their positions.
        let mut collector = HeadCollector::new(path);
        let mut head = None;
        for metadata in metadata_by_index(path).map_err(failed)? {
            head = head.or(collector.take(&metadata)?);
        }
        let head = head.ok_or_else(|| collector.foreign("it holds no manifest of a flight"))?;
        let file = File::open(path).map_err(failed)?;
        let mut records = Records::new(BufReader::with_capacity(1 << 16, file), file_bytes);
        // Skip the header, which was read before.
        let mut header = RawRecord::default();
        records
            .next(&mut header)
            .map_err(|error| explain(path, error, 0, None))?;
        Ok(Self { records, head })
    }
}

/// Collector of the metadata of a file, of which the manifest is the last.
struct HeadCollector<'a> {
    path: &'a Path,
    recovery: Option<Recovery>,
    part: Option<Part>,
}

impl<'a> HeadCollector<'a> {
    fn new(path: &'a Path) -> Self {
        Self {
            path,
            recovery: None,
            part: None,
        }
    }

    fn foreign(&self, reason: &'static str) -> LogReadError {
        LogReadError::Foreign {
            path: self.path.to_owned(),
            reason,
        }
    }

    /// Adds a record. Returns the collected metadata if it is the manifest. Ignores metadata of other programs.
    fn take(&mut self, metadata: &Metadata) -> Result<Option<LogHead>, LogReadError> {
        let facts = &metadata.metadata;
        match metadata.name.as_str() {
            Recovery::RECORD_NAME => {
                let invalid = || self.foreign("what it says of its recovery makes no sense");
                self.recovery = Some(Recovery::from_metadata(facts).ok_or_else(invalid)?);
            }
            Part::RECORD_NAME => {
                let invalid = || self.foreign("what it says of its place in the log makes no sense");
                self.part = Some(Part::from_metadata(facts).ok_or_else(invalid)?);
            }
            Manifest::RECORD_NAME => {
                let manifest = Manifest::from_metadata(facts);
                return Ok(Some(LogHead {
                    manifest: manifest.map_err(|problem| explain_manifest(self.path, problem))?,
                    recovery: self.recovery.take(),
                    part: self.part,
                }));
            }
            COPY_RECORD_NAME => return Err(self.foreign("it is a copy for viewers")),
            _ => {}
        }
        Ok(None)
    }
}

/// Reads the manifest and the preceding metadata of a recovery and of a split; `None` if samples come first.
fn read_head(path: &Path, records: &mut Records<BufReader<File>>) -> Result<Option<LogHead>, LogReadError> {
    let mut collector = HeadCollector::new(path);
    let mut record = RawRecord::default();
    while records
        .next(&mut record)
        .map_err(|error| explain(path, error, 0, None))?
    {
        if record.opcode == op::HEADER {
            continue;
        }
        let metadata = match records::parse(record.opcode, &record.body) {
            Ok(Record::Metadata(metadata)) => metadata,
            Ok(_) => return Ok(None),
            Err(error) => return Err(explain(path, error, 0, None)),
        };
        if let Some(head) = collector.take(&metadata)? {
            return Ok(Some(head));
        }
    }
    Err(collector.foreign("it holds no manifest of a flight"))
}

fn explain_manifest(path: &Path, problem: ManifestProblem) -> LogReadError {
    let path = path.to_owned();
    match problem {
        ManifestProblem::Version(found) => LogReadError::Version { path, found },
        ManifestProblem::Layouts(types) => LogReadError::Layouts { path, types },
        source => LogReadError::Manifest { path, source },
    }
}

/// Explains why a file cannot be opened: it is incomplete or damaged if it has a part of a flight, and foreign otherwise.
fn explain_by_origin(path: &Path, error: LogReadError) -> LogReadError {
    use LogReadError::{Damaged, Foreign, Unclosed};
    let foreign = |reason| LogReadError::Foreign {
        path: path.to_owned(),
        reason,
    };
    match (origin(path), error) {
        (Ok(Origin::Flight), Foreign { path, reason }) => Damaged {
            path,
            samples: 0,
            source: reason.into(),
        },
        (Ok(Origin::Machine), Foreign { .. } | Unclosed { .. } | Damaged { .. }) => {
            foreign("it is the record of a machine, and of no flight")
        }
        (Ok(Origin::Foreign), Unclosed { .. } | Damaged { .. }) => {
            foreign("no part of it is one of a flight")
        }
        (_, error) => error,
    }
}

/// Converts an error of the MCAP library.
fn explain(path: &Path, error: McapError, samples: u64, last_tick: Option<u64>) -> LogReadError {
    let path = path.to_owned();
    match error {
        McapError::BadMagic if samples == 0 => LogReadError::Foreign {
            path,
            reason: "it is no MCAP file",
        },
        McapError::UnexpectedEof => LogReadError::Unclosed {
            path,
            samples,
            last_tick,
        },
        McapError::Io(source) => LogReadError::Io { path, source },
        other => LogReadError::Damaged {
            path,
            samples,
            source: other.into(),
        },
    }
}

#[cfg(test)]
mod tests;
