//! Properties that hold of any file that is taken for a log.
//!
//! An input is not the file itself, because a reader hands out nothing whose checksum does not hold, and no checksum is found by chance.
//! It tells how to make one: what of a real log to begin with, and then pieces, each a kind (a byte), a length (two bytes,
//! little-endian) and as many bytes. They become records with proper lengths, in chunks with proper checksums, or raw bytes.

use std::path::Path;

use run_log::{
    Compression, LogReader, Manifest, RecoverError, Recovery, RunLogWriter, inspect, is_whole, recover,
};
use scenario::Scenario;
use shared_types::Topic;
use tempfile::TempDir;

/// The scenario of the log that inputs begin with.
const SCENARIO: &str = "description = \"fuzz\"\nduration = 1.0\n[vehicle]\nmass = 0.2\ninertia = [1e-3, 1e-3, 2e-3]\n\
                        [path.curve.hover]\nposition = [0.0, 0.0, -1.0]\n";

/// Bits of an input's first byte: begin as a log does, up to its manifest; with a chunk that declares the topics; end properly.
const WITH_MANIFEST: u8 = 1;
const WITH_TOPICS: u8 = 2;
const CLOSED: u8 = 4;

/// Kinds of pieces: up to 0x0f a record in the chunk; up to 0x1f one beside chunks; then raw bytes; others begin a new chunk.
const BESIDE_CHUNKS: u8 = 0x10;
const RAW: u8 = 0x20;

/// Lengths of a record's frame and of the header of a chunk that is not compressed.
const FRAME_BYTES: usize = 1 + 8;
const CHUNK_HEADER_BYTES: usize = 8 + 8 + 8 + 4 + 4 + 8;

mod kind {
    pub const CHUNK: u8 = 0x06;
    pub const DATA_END: u8 = 0x0f;
    pub const FOOTER: u8 = 0x02;
}

/// Makes files of inputs and lets them be read and recovered.
pub struct Harness {
    folder: TempDir,
    /// A log up to its manifest.
    manifest: Vec<u8>,
    /// The records that declare the topics.
    topics: Vec<u8>,
}

impl Harness {
    /// Works in a folder of its own among the temporary files.
    ///
    /// # Panics
    /// If it cannot write there.
    #[must_use]
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("temporary files can be written");
        let path = folder.path().join("real.mcap");
        let scenario: Scenario = toml::from_str(SCENARIO).expect("the scenario is well-formed");
        let log = RunLogWriter::create(&path, &Manifest::new(&scenario), Compression::None);
        log.and_then(RunLogWriter::finish)
            .expect("the log can be written");
        let real = std::fs::read(path).expect("it was written");
        let mut chunk_at = mcap::MAGIC.len();
        while real[chunk_at] != kind::CHUNK {
            chunk_at += FRAME_BYTES + length_at(&real, chunk_at + 1);
        }
        let chunk_end = chunk_at + FRAME_BYTES + length_at(&real, chunk_at + 1);
        Self {
            folder,
            manifest: real[..chunk_at].to_vec(),
            topics: real[chunk_at + FRAME_BYTES + CHUNK_HEADER_BYTES..chunk_end].to_vec(),
        }
    }

    /// Panics unless what was made of an input is read and recovered as it should be.
    #[expect(clippy::disallowed_methods, reason = "tests make their own files")]
    pub fn check(&self, input: &[u8]) {
        let [source, target] = ["run.mcap", "run.recovered.mcap"].map(|name| self.folder.path().join(name));
        std::fs::write(&source, self.file(input)).expect("temporary files can be written");
        let (read, is_complete) = read(&source);
        assert!(
            !is_complete || is_whole(&source).unwrap(),
            "read to its end, but not whole"
        );
        let inspected = inspect(&source).unwrap();
        match recover(&source, &target, None) {
            Ok(recovery) => {
                assert_eq!(recovery.kept(), inspected.kept());
                assert!(!recovery.to_string().is_empty());
                check_recovered(&read, &recovery, &target);
                std::fs::remove_file(&target).expect("it was written");
            }
            Err(RecoverError::Nothing(_) | RecoverError::Empty(_) | RecoverError::NoFlight(_)) => {
                assert!(read.is_empty(), "what was read is not recovered");
            }
            Err(RecoverError::Layouts { .. } | RecoverError::Manifest { .. }) => {}
            Err(error) => panic!("{error}"),
        }
    }

    /// Makes the file that an input describes.
    fn file(&self, input: &[u8]) -> Vec<u8> {
        let Some((&begin, mut pieces)) = input.split_first() else {
            return Vec::new();
        };
        let mut file = Vec::new();
        let mut chunk = Vec::new();
        if begin & WITH_MANIFEST != 0 {
            file.extend_from_slice(&self.manifest);
        }
        if begin & WITH_TOPICS != 0 {
            seal(&mut self.topics.clone(), &mut file);
        }
        while let Some((&[kind, low, high], rest)) = pieces.split_first_chunk::<3>() {
            let length = usize::from(u16::from_le_bytes([low, high])).min(rest.len());
            let (body, rest) = rest.split_at(length);
            pieces = rest;
            match kind {
                0..BESIDE_CHUNKS => add_record(kind, body, &mut chunk),
                BESIDE_CHUNKS..RAW => {
                    seal(&mut chunk, &mut file);
                    add_record(kind - BESIDE_CHUNKS, body, &mut file);
                }
                RAW => {
                    seal(&mut chunk, &mut file);
                    file.extend_from_slice(body);
                }
                _ => seal(&mut chunk, &mut file),
            }
        }
        seal(&mut chunk, &mut file);
        if begin & CLOSED != 0 {
            // Without checksums, which MCAP leaves to the writer here.
            add_record(kind::DATA_END, &[0; 4], &mut file);
            add_record(kind::FOOTER, &[0; 20], &mut file);
            file.extend_from_slice(mcap::MAGIC);
        }
        file
    }
}

impl Default for Harness {
    fn default() -> Self {
        Self::new()
    }
}

/// The recovered log is whole, has what the recovery says, and begins with what could be read before.
fn check_recovered(before: &[(Topic, Vec<u8>)], recovery: &Recovery, target: &Path) {
    let is_of_a_flight = recovery
        .samples
        .keys()
        .all(|name| Topic::from_name(name).is_some());
    assert!(is_whole(target).unwrap(), "the recovered log is not whole");
    if is_of_a_flight {
        let (after, is_complete) = read(target);
        assert!(is_complete, "the recovered log cannot be read to its end");
        assert_eq!(after.len() as u64, recovery.kept());
        assert!(
            after.starts_with(before),
            "what was read is not in the recovered log"
        );
    }
}

/// The samples that a reader hands out, and whether it came to the proper end.
fn read(log: &Path) -> (Vec<(Topic, Vec<u8>)>, bool) {
    let mut samples = Vec::new();
    let Ok(mut reader) = LogReader::open(log) else {
        return (samples, false);
    };
    loop {
        match reader.next_sample() {
            Ok(Some(sample)) => samples.push((sample.topic, sample.bytes.to_vec())),
            Ok(None) => return (samples, true),
            Err(_) => return (samples, false),
        }
    }
}

fn length_at(bytes: &[u8], at: usize) -> usize {
    let length = std::array::from_fn(|index| bytes[at + index]);
    usize::try_from(u64::from_le_bytes(length)).expect("a length in a real log")
}

fn add_record(kind: u8, body: &[u8], out: &mut Vec<u8>) {
    out.push(kind);
    out.extend_from_slice(&(body.len() as u64).to_le_bytes());
    out.extend_from_slice(body);
}

/// Makes a chunk of these records, unless there are none.
fn seal(records: &mut Vec<u8>, file: &mut Vec<u8>) {
    if records.is_empty() {
        return;
    }
    let length = (records.len() as u64).to_le_bytes();
    let mut body = [[0; 8], [0; 8], length].concat();
    body.extend_from_slice(&checksum(records).to_le_bytes());
    body.extend_from_slice(&0_u32.to_le_bytes());
    body.extend_from_slice(&length);
    body.append(records);
    add_record(kind::CHUNK, &body, file);
}

/// The CRC-32 that MCAP prescribes.
fn checksum(bytes: &[u8]) -> u32 {
    const POLYNOMIAL: u32 = 0xedb8_8320;
    let shifted = |crc: u32, _| {
        if crc & 1 == 0 {
            crc >> 1
        } else {
            crc >> 1 ^ POLYNOMIAL
        }
    };
    let crc = bytes
        .iter()
        .fold(u32::MAX, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), shifted));
    !crc
}
