//! What the `mcap` crate, an independent reader, finds in files of any content.

use proptest::prelude::*;

use super::*;
use crate::log::Compression;

/// What happens to a file.
#[derive(Clone, Debug)]
enum Step {
    Message {
        channel: u16,
        sequence: u32,
        time_ns: u64,
        sample: Vec<u8>,
    },
    EndChunk,
    Metadata(String),
}

const CHANNELS: u16 = 3;

fn step() -> impl Strategy<Value = Step> {
    let message = (
        1..=CHANNELS,
        any::<u32>(),
        0..1000u64,
        proptest::collection::vec(any::<u8>(), 0..40),
    )
        .prop_map(|(channel, sequence, time_ns, sample)| Step::Message {
            channel,
            sequence,
            time_ns,
            sample,
        });
    prop_oneof![8 => message, 1 => Just(Step::EndChunk), 1 => "[a-zé]{0,5}".prop_map(Step::Metadata)]
}

fn file_of(compression: Compression, steps: &[Step]) -> Vec<u8> {
    let mut file = Vec::new();
    let compressor = Compressor::new(compression).unwrap();
    let mut writer = McapWriter::new(&mut file, "profile", "library", compressor).unwrap();
    for channel in 1..=CHANNELS {
        let schema = writer.add_schema(&format!("type{channel}"), "ros2msg", "uint8 x\n");
        let metadata = BTreeMap::from([("key".to_owned(), format!("value {channel}"))]);
        assert_eq!(
            writer.add_channel(schema, &format!("topic{channel}"), "cdr", &metadata),
            channel
        );
    }
    for step in steps {
        match step {
            Step::Message {
                channel,
                sequence,
                time_ns,
                sample,
            } => writer.push_message(&Message {
                channel: *channel,
                sequence: *sequence,
                time_ns: *time_ns,
                prefix: [9, 8, 7, 6],
                sample,
            }),
            Step::EndChunk => writer.end_chunk().unwrap(),
            Step::Metadata(name) => {
                let facts = BTreeMap::from([
                    (name.clone(), "1".to_owned()),
                    ("other".to_owned(), String::new()),
                ]);
                writer.write_metadata(name, &facts).unwrap();
            }
        }
    }
    let bytes = writer.finish().unwrap();
    assert_eq!(bytes, file.len() as u64);
    file
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn an_independent_reader_finds_everything_front_to_back_and_by_index(
        compression in prop::sample::select(&[Compression::None, Compression::Lz4, Compression::Zstd][..]),
        steps in proptest::collection::vec(step(), 0..60),
    ) {
        let file = file_of(compression, &steps);
        let expected: Vec<_> = steps.iter().filter_map(|step| match step {
            Step::Message { channel, sequence, time_ns, sample } => {
                Some((*channel, *sequence, *time_ns, [&[9, 8, 7, 6], sample.as_slice()].concat()))
            }
            _ => None,
        }).collect();
        let read = |message: mcap::Message<'_>| {
            assert_eq!(message.publish_time, message.log_time);
            (message.channel.id, message.sequence, message.log_time, message.data.to_vec())
        };

        let front_to_back: Vec<_> = mcap::MessageStream::new(&file).unwrap().map(|message| read(message.unwrap())).collect();
        prop_assert_eq!(&front_to_back, &expected);

        let summary = mcap::Summary::read(&file).unwrap().unwrap();
        let mut by_index = Vec::new();
        // A chunk of nothing but channels has no index.
        for chunk in summary.chunk_indexes.iter().filter(|chunk| !chunk.message_index_offsets.is_empty()) {
            let mut entries: Vec<_> = summary.read_message_indexes(&file, chunk).unwrap().into_values().flatten().collect();
            entries.sort_by_key(|entry| entry.offset);
            for entry in entries {
                let message = summary.seek_message(&file, chunk, &entry).unwrap();
                prop_assert_eq!(message.log_time, entry.log_time);
                prop_assert!((chunk.message_start_time..=chunk.message_end_time).contains(&entry.log_time));
                by_index.push(read(message));
            }
        }
        prop_assert_eq!(&by_index, &expected);

        let statistics = summary.stats.as_ref().unwrap();
        prop_assert_eq!(statistics.message_count, expected.len() as u64);
        prop_assert_eq!(statistics.channel_message_counts.values().sum::<u64>(), expected.len() as u64);
        prop_assert_eq!(statistics.chunk_count as usize, summary.chunk_indexes.len());
        let times = || expected.iter().map(|message| message.2);
        prop_assert_eq!(statistics.message_start_time, times().min().unwrap_or(0));
        prop_assert_eq!(statistics.message_end_time, times().max().unwrap_or(0));
        prop_assert_eq!(summary.channels.len(), usize::from(CHANNELS));
        for channel in summary.channels.values() {
            prop_assert_eq!(&channel.metadata["key"], &format!("value {}", channel.id));
            prop_assert_eq!(&channel.schema.as_ref().unwrap().name, &format!("type{}", channel.id));
        }
        let names = steps.iter().filter_map(|step| match step { Step::Metadata(name) => Some(name), _ => None });
        prop_assert_eq!(summary.metadata_indexes.len(), names.clone().count());
        for (index, name) in summary.metadata_indexes.iter().zip(names) {
            let metadata = mcap::read::metadata(&file, index).unwrap();
            prop_assert_eq!(&metadata.name, name);
            prop_assert_eq!(metadata.metadata.get("other"), Some(&String::new()));
        }
    }

    /// The `mcap` crate writes the same file: its bytes are the second opinion on ours.
    #[test]
    fn the_file_is_byte_for_byte_what_the_mcap_crate_writes(steps in proptest::collection::vec(step(), 0..60)) {
        prop_assert!(file_of(Compression::None, &steps) == reference_file(&steps));
    }
}

fn reference_file(steps: &[Step]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut writer = mcap::WriteOptions::new()
        .profile("profile")
        .library("library")
        .compression(None)
        .chunk_size(None)
        .create(io::Cursor::new(&mut file))
        .unwrap();
    for channel in 1..=CHANNELS {
        let schema = writer
            .add_schema(&format!("type{channel}"), "ros2msg", b"uint8 x\n")
            .unwrap();
        let metadata = BTreeMap::from([("key".to_owned(), format!("value {channel}"))]);
        writer
            .add_channel(schema, &format!("topic{channel}"), "cdr", &metadata)
            .unwrap();
    }
    for step in steps {
        match step {
            Step::Message {
                channel,
                sequence,
                time_ns,
                sample,
            } => {
                let header = mcap::records::MessageHeader {
                    channel_id: *channel,
                    sequence: *sequence,
                    log_time: *time_ns,
                    publish_time: *time_ns,
                };
                writer
                    .write_to_known_channel(&header, &[&[9, 8, 7, 6], sample.as_slice()].concat())
                    .unwrap();
            }
            Step::EndChunk => writer.flush().unwrap(),
            Step::Metadata(name) => {
                let metadata = BTreeMap::from([
                    (name.clone(), "1".to_owned()),
                    ("other".to_owned(), String::new()),
                ]);
                writer
                    .write_metadata(&mcap::records::Metadata {
                        name: name.clone(),
                        metadata,
                    })
                    .unwrap();
            }
        }
    }
    writer.finish().unwrap();
    drop(writer);
    file
}
