//! One topic of a log as a table, for spreadsheets and data frames.

use std::io::Write;
use std::path::Path;

use serde_json::Value;
use shared_types::Topic;

use super::export::ExportError;
use super::reader::LogReader;
use super::schema::Schema;

/// Writes the samples of a topic of every `every`-th tick as CSV (RFC 4180, lines end with a line feed).
///
/// The first line names the columns: members of records are joined by a dot (`header.tick`), arrays have a column
/// an element (`position_world.0`), but a text has one and padding has none. Numbers are written with full precision; those
/// that are not finite are the words `NaN`, `inf` and `-inf`.
///
/// # Errors
/// [`ExportError`]; lines written before it are complete.
pub fn export_csv(path: &Path, topic: Topic, every: u64, out: &mut impl Write) -> Result<(), ExportError> {
    let mut reader = LogReader::open(path)?;
    let schema = Schema::of(topic, &reader.manifest().scenario);
    writeln!(out, "{}", schema.columns().join(","))?;
    while let Some(logged) = reader.next_sample()? {
        if logged.topic != topic || !logged.header.tick.is_multiple_of(every) {
            continue;
        }
        let cells = schema
            .cells(&mut &*logged.bytes)
            .expect("a sample is as long as its definition");
        let cells: Vec<_> = cells.iter().map(cell).collect();
        writeln!(out, "{}", cells.join(","))?;
    }
    Ok(())
}

/// Formats a number, or a text with quotes if required.
fn cell(value: &Value) -> String {
    match value {
        Value::String(text) if text.contains([',', '"', '\n', '\r']) => {
            format!("\"{}\"", text.replace('"', "\"\""))
        }
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Compression;
    use crate::test_flight::{errors, record_samples, scenario};
    use shared_types::Sample;
    use shared_types::samples::RunEvent;
    use zerocopy::{FromZeros, IntoBytes};

    /// The table of one sample: a name and a cell a column.
    fn row(topic: Topic, bytes: Vec<u8>) -> Vec<(String, String)> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let samples = std::iter::once((topic, bytes));
        record_samples(&path, &scenario(0.01, 1.0), Compression::None, samples);
        let mut text = Vec::new();
        export_csv(&path, topic, 1, &mut text).unwrap();
        let text = String::from_utf8(text).unwrap();
        let (names, cells) = text.trim_end().split_once('\n').unwrap();
        let names: Vec<_> = names.split(',').map(str::to_owned).collect();
        let cells: Vec<_> = cells.splitn(names.len(), ',').map(str::to_owned).collect();
        assert_eq!(names.len(), cells.len());
        names.into_iter().zip(cells).collect()
    }

    #[test]
    fn every_element_has_its_column_and_comes_back_to_the_bit() {
        let header = scenario(0.01, 1.0)
            .schedule()
            .unwrap()
            .header(Topic::ControlErrors, 7);
        let z1 = [0.1 + 0.2, -1e-300, f64::NEG_INFINITY];
        let row = row(Topic::ControlErrors, errors(header, z1));
        let cell = |name: &str| &row.iter().find(|(column, _)| column == name).unwrap().1;
        assert_eq!(row[0], ("header.tick".to_owned(), "7".to_owned()));
        for (axis, number) in z1.iter().enumerate() {
            let read: f64 = cell(&format!("z1.{axis}")).parse().unwrap();
            assert_eq!(read.to_bits(), number.to_bits());
        }
    }

    #[test]
    fn a_text_is_one_cell_whatever_stands_in_it() {
        let schedule = scenario(0.01, 1.0).schedule().unwrap();
        let text = "off, \"cold\"";
        let mut event = RunEvent::new_zeroed();
        *event.header_mut() = schedule.header(Topic::RunEvent, 3);
        event.text[..text.len()].copy_from_slice(text.as_bytes());
        event.text_length = u32::try_from(text.len()).unwrap();
        let row = row(Topic::RunEvent, event.as_bytes().to_vec());
        let last = row.last().unwrap();
        assert_eq!(last, &("text".to_owned(), "\"off, \"\"cold\"\"\"".to_owned()));
    }
}
