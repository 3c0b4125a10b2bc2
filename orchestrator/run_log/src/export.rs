//! Export of a log as JSON lines, for programs without MCAP and CDR, and for tests of programs with them.

use std::io::{self, Write};
use std::path::Path;

use serde_json::json;
use shared_types::Topic;

use super::reader::{LogReadError, LogReader};
use super::schema::Schema;

/// Reason why a log cannot be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The log cannot be read.
    #[error("{0}")]
    Read(#[from] LogReadError),
    /// The lines cannot be written.
    #[error("cannot write the exported lines: {0}; make room, or write elsewhere")]
    Write(#[from] io::Error),
}

/// Writes every sample of every `every`-th tick, or those of one topic, as a line
/// `{"log_time": ns, "sample": {…}, "sequence": n, "topic": "…"}`.
///
/// Numbers are written with full precision; those that are not finite are the strings `NaN`, `inf` and `-inf`.
///
/// # Errors
/// [`ExportError`]; lines written before it are complete.
pub fn export_json(
    path: &Path,
    topic: Option<Topic>,
    every: u64,
    out: &mut impl Write,
) -> Result<(), ExportError> {
    let mut reader = LogReader::open(path)?;
    let schemas = Topic::ALL.map(|topic| Schema::of(topic, &reader.manifest().scenario));
    while let Some(logged) = reader.next_sample()? {
        let is_other = topic.is_some_and(|topic| topic != logged.topic);
        if is_other || !logged.header.tick.is_multiple_of(every) {
            continue;
        }
        let mut bytes = logged.bytes;
        let sample = schemas[logged.topic.index()]
            .decode(&mut bytes)
            .expect("a sample is as long as its definition");
        let line = json!({
            "topic": logged.topic.name(),
            "sequence": logged.header.seq,
            "log_time": logged.header.stamp_ns,
            "sample": sample,
        });
        writeln!(out, "{line}")?;
    }
    Ok(())
}

/// Converts a sample of a topic to JSON, by the topic's definition.
///
/// # Panics
/// If the bytes are not as long as a sample of the topic.
#[must_use]
pub fn decode_sample(topic: Topic, mut bytes: &[u8]) -> serde_json::Value {
    let schema = Schema::parse(&topic.msg_definition()).expect("our own definitions are well-formed");
    schema
        .decode(&mut bytes)
        .expect("a sample is as long as its definition")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Compression;
    use crate::test_flight::{errors, record, record_samples, scenario};
    use serde_json::Value;

    fn lines(path: &Path, every: u64) -> Vec<Value> {
        let mut text = Vec::new();
        export_json(path, None, every, &mut text).unwrap();
        let text = String::from_utf8(text).unwrap();
        text.lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    }

    #[test]
    fn every_nth_tick_is_exported_with_all_its_samples() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        record(&path, &scenario(0.01, 1.0), Compression::Lz4);
        assert_eq!(lines(&path, 1).len(), 101 * Topic::ALL.len());
        let some = lines(&path, 25);
        assert_eq!(some.len(), 5 * Topic::ALL.len());
        for (index, line) in some.iter().enumerate() {
            let tick = 25 * (index / Topic::ALL.len()) as u64;
            assert_eq!(line["topic"], Topic::ALL[index % Topic::ALL.len()].name());
            assert_eq!(line["sample"]["header"]["tick"], tick);
            assert_eq!(line["log_time"], tick * 10_000_000);
            assert_eq!(line["sequence"], tick);
        }
    }

    #[test]
    fn numbers_come_back_to_the_bit_under_their_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let scenario = scenario(0.01, 1.0);
        let header = scenario.schedule().unwrap().header(Topic::ControlErrors, 0);
        let z1 = [0.1 + 0.2, -1e-300, std::f64::consts::PI];
        let sample = (Topic::ControlErrors, errors(header, z1));
        record_samples(&path, &scenario, Compression::None, std::iter::once(sample));
        let exported = &lines(&path, 1)[0]["sample"]["z1"];
        let read = [0, 1, 2].map(|axis| exported[axis].as_f64().unwrap().to_bits());
        assert_eq!(read, z1.map(f64::to_bits));
    }
}
