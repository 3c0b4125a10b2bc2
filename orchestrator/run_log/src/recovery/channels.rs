//! Identification of the samples in a damaged log.

use std::collections::{BTreeMap, BTreeSet};

use mcap::records::{MessageHeader, Record, op};
use scenario::Scenario;
use shared_types::sample::{CDR_HEADER, Record as SampleRecord, layout_hash, msg_definition};
use shared_types::service::header_of;
use shared_types::wiring::TopicVisitor;
use shared_types::{Published, Topic};

use super::origin::Origin;
use super::scan::Chunk;
use crate::framing::LAYOUT_KEY;
use crate::records;
use crate::schema::definition;
use crate::{
    CaptureFigures, HostEvent, HostSample, LinkFigures, ServiceCheckpoint, ServiceHealth, ServiceStep,
};

/// Number of the first channel of a log; the others follow.
const FIRST_CHANNEL: usize = 1;

/// A kind of samples that this program writes.
pub(super) struct Kind {
    /// The channel's name.
    pub(super) channel: &'static str,
    pub(super) schema: &'static str,
    pub(super) definition: String,
    pub(super) layout: String,
    size: usize,
    topic: Option<Topic>,
}

impl Kind {
    fn new<R: SampleRecord>(channel: &'static str, topic: Option<Topic>) -> Self {
        Self {
            channel,
            schema: R::MSG_NAME,
            definition: msg_definition::<R>(),
            layout: layout_hash::<R>(),
            size: size_of::<R>(),
            topic,
        }
    }

    fn of_host<T: HostSample>() -> Self {
        Self::new::<T>(T::CHANNEL, None)
    }

    /// Returns whether samples of this layout can be read, which is the current or a known earlier one.
    fn has_layout(&self, layout: &str) -> bool {
        let is_earlier = |topic: Topic| topic.padding_in(layout).is_some();
        layout == self.layout || self.topic.is_some_and(is_earlier)
    }

    /// Returns whether a channel of a log has samples of this kind, in any layout.
    pub(super) fn is_of(&self, channel: &str, schema: &str) -> bool {
        self.channel == channel && self.schema == schema
    }

    /// Returns the origin of the samples.
    pub(super) fn origin(&self) -> Origin {
        match self.topic {
            Some(_) => Origin::Flight,
            None => Origin::Machine,
        }
    }

    /// Returns whether these bytes can be a sample of this kind at a time.
    fn fits(&self, sample: &[u8], time_ns: u64) -> bool {
        sample.len() == self.size && self.time_ns(sample) == Some(time_ns)
    }

    /// Returns the time of a sample. Samples of the flight begin with their header, those of the machine with their time.
    fn time_ns(&self, sample: &[u8]) -> Option<u64> {
        match self.topic {
            Some(_) => Some(header_of(sample).stamp_ns),
            None => sample.first_chunk().map(|time| u64::from_le_bytes(*time)),
        }
    }
}

struct KindOf;

impl TopicVisitor for KindOf {
    type Result = Kind;

    fn visit<T: Published>(self) -> Kind {
        Kind::new::<T>(T::TOPIC.name(), Some(T::TOPIC))
    }
}

/// A sample in a log.
pub(super) struct Message<'a> {
    /// Index of its kind.
    pub(super) kind: usize,
    pub(super) header: MessageHeader,
    pub(super) sample: &'a [u8],
    /// Tick and number in the header, for samples of the flight.
    pub(super) tick: Option<u64>,
    pub(super) sequence: u64,
}

/// Returns all kinds: the topics in order, then those of the machine.
pub(super) fn kinds() -> Vec<Kind> {
    let mut kinds: Vec<_> = Topic::ALL.map(|topic| topic.dispatch(KindOf)).into();
    kinds.extend([
        Kind::of_host::<HostEvent>(),
        Kind::of_host::<ServiceHealth>(),
        Kind::of_host::<ServiceStep>(),
        Kind::of_host::<ServiceCheckpoint>(),
        Kind::of_host::<CaptureFigures>(),
        Kind::of_host::<LinkFigures>(),
    ]);
    kinds
}

/// Sets the names of the telemetry in a flight of `scenario`.
pub(super) fn name_telemetry(kinds: &mut [Kind], scenario: &Scenario) {
    let topic = Topic::ControlTelemetry;
    kinds[topic.index()].definition = definition(topic, scenario);
}

/// The known channels of a log.
pub(super) struct Channels<'a> {
    pub(super) kinds: &'a [Kind],
    /// Names of schemas and indices of kinds, by the log's numbers.
    schemas: BTreeMap<u16, String>,
    declared: BTreeMap<u16, usize>,
    /// Types with another layout in the log.
    pub(super) other_layouts: Vec<&'static str>,
    /// Numbers of the samples of each kind.
    numbers: Vec<BTreeSet<u64>>,
}

impl<'a> Channels<'a> {
    pub(super) fn new(kinds: &'a [Kind]) -> Self {
        Self {
            kinds,
            schemas: BTreeMap::new(),
            declared: BTreeMap::new(),
            other_layouts: Vec::new(),
            numbers: vec![BTreeSet::new(); kinds.len()],
        }
    }

    /// Passes on the messages of a chunk. Returns the number of unknown and repeated samples.
    pub(super) fn read<E>(
        &mut self,
        chunk: &Chunk,
        mut take: impl FnMut(&Message<'_>) -> Result<(), E>,
    ) -> Result<u64, E> {
        let mut strange = 0;
        for (opcode, body) in chunk.records() {
            match records::parse(opcode, body) {
                Ok(Record::Schema { header, .. }) => {
                    self.schemas.insert(header.id, header.name);
                }
                Ok(Record::Channel(channel)) => self.declare(&channel),
                Ok(Record::Message { header, data }) if opcode == op::MESSAGE => {
                    match self.message(header, &data) {
                        Some(message) if self.is_new(&message) => take(&message)?,
                        _ => strange += 1,
                    }
                }
                _ => strange += 1,
            }
        }
        Ok(strange)
    }

    /// Records a sample. Returns `false` if a sample of the flight is repeated.
    fn is_new(&mut self, message: &Message<'_>) -> bool {
        self.kinds[message.kind].topic.is_none() || self.numbers[message.kind].insert(message.sequence)
    }

    fn declare(&mut self, channel: &mcap::records::Channel) {
        let Some(schema) = self.schemas.get(&channel.schema_id) else {
            return;
        };
        let mut kinds = self.kinds.iter();
        // Other programs may have channels with these names.
        let Some(position) = kinds.position(|kind| kind.is_of(&channel.topic, schema)) else {
            return;
        };
        let kind = &self.kinds[position];
        if channel
            .metadata
            .get(LAYOUT_KEY)
            .is_some_and(|layout| kind.has_layout(layout))
        {
            self.declared.insert(channel.id, position);
        } else if !self.other_layouts.contains(&kind.schema) {
            self.other_layouts.push(kind.schema);
        }
    }

    /// Returns the index of a kind that the log declares, in any layout.
    pub(super) fn known(&self) -> Option<usize> {
        let of_schema = |schema: &&str| self.kinds.iter().position(|kind| kind.schema == *schema);
        let declared = self.declared.values().next().copied();
        declared.or_else(|| self.other_layouts.first().and_then(of_schema))
    }

    fn message<'m>(&self, header: MessageHeader, data: &'m [u8]) -> Option<Message<'m>> {
        let sample = data.strip_prefix(&CDR_HEADER)?;
        let fits = |&position: &usize| self.kinds[position].fits(sample, header.log_time);
        let kind = match self.declared.get(&header.channel_id) {
            Some(declared) => Some(*declared).filter(fits)?,
            None => self.guesses(header.channel_id).find(fits)?,
        };
        let of_the_flight = self.kinds[kind].topic.map(|_| header_of(sample));
        Some(Message {
            kind,
            header,
            sample,
            tick: of_the_flight.map(|own| own.tick),
            sequence: of_the_flight.map_or(u64::from(header.sequence), |own| own.seq),
        })
    }

    /// Returns the possible kinds of a channel without a declaration: a flight's channels are numbered in the order of the
    /// topics, the machine's in the order of their first samples, but all of these have different sizes.
    fn guesses(&self, channel: u16) -> impl Iterator<Item = usize> + use<> {
        let numbered = usize::from(channel).checked_sub(FIRST_CHANNEL);
        let numbered = numbered.filter(|&position| position < Topic::ALL.len());
        numbered.into_iter().chain(Topic::ALL.len()..self.kinds.len())
    }
}
