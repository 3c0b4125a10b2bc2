//! The rows as a Parquet file. Its bytes are a function of the rows alone.

use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as PhysicalType, ZstdLevel};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::errors::Result;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties, WriterVersion};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use result_file::ResultFile;

use crate::row::{Cell, Column, Kind, Row};

/// Rows of a row group.
const GROUP: usize = 8192;

/// Writes a table by row groups.
pub struct TableWriter {
    columns: Vec<Column>,
    writer: SerializedFileWriter<ResultFile>,
    rows: Vec<Row>,
}

impl TableWriter {
    /// Creates a table with these columns and metadata.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn create(path: &Path, columns: &[Column], about: &[(&str, &str)]) -> Result<Self> {
        let fields = columns.iter().map(|column| {
            let (physical, logical) = match column.kind {
                Kind::Integer => (PhysicalType::INT64, None),
                Kind::Number => (PhysicalType::DOUBLE, None),
                Kind::Text => (PhysicalType::BYTE_ARRAY, Some(LogicalType::String)),
                Kind::Flag => (PhysicalType::BOOLEAN, None),
            };
            let repetition = if matches!(column.kind, Kind::Number | Kind::Flag) {
                Repetition::OPTIONAL
            } else {
                Repetition::REQUIRED
            };
            let field = Type::primitive_type_builder(&column.name, physical);
            Ok(Arc::new(
                field
                    .with_logical_type(logical)
                    .with_repetition(repetition)
                    .build()?,
            ))
        });
        let fields = fields.collect::<Result<Vec<_>>>()?;
        let schema = Arc::new(Type::group_type_builder("sweep").with_fields(fields).build()?);
        let about = about
            .iter()
            .map(|(key, value)| KeyValue::new((*key).to_owned(), (*value).to_owned()));
        let properties = WriterProperties::builder()
            .set_writer_version(WriterVersion::PARQUET_1_0)
            .set_created_by("gerono".to_owned())
            .set_compression(Compression::ZSTD(ZstdLevel::try_new(3)?))
            .set_dictionary_enabled(false)
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .set_key_value_metadata(Some(about.collect()))
            .build();
        Ok(Self {
            columns: columns.to_vec(),
            writer: SerializedFileWriter::new(ResultFile::create(path, &[])?, schema, Arc::new(properties))?,
            rows: Vec::with_capacity(GROUP),
        })
    }

    /// Appends a row.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&mut self, row: Row) -> Result<()> {
        self.rows.push(row);
        if self.rows.len() == GROUP {
            self.write_group()
        } else {
            Ok(())
        }
    }

    fn write_group(&mut self) -> Result<()> {
        let mut group = self.writer.next_row_group()?;
        for column in 0..self.columns.len() {
            let cells = self.rows.iter().map(|row| &row[column]);
            let mut writer = group.next_column()?.expect("the schema has this column");
            write_column(writer.untyped(), cells)?;
            writer.close()?;
        }
        group.close()?;
        self.rows.clear();
        Ok(())
    }

    /// Completes the table, syncs it to the disk and gives it its name.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self) -> Result<()> {
        if !self.rows.is_empty() {
            self.write_group()?;
        }
        self.writer.into_inner()?.finish()?;
        Ok(())
    }
}

fn write_column<'a>(writer: &mut ColumnWriter<'_>, cells: impl Iterator<Item = &'a Cell>) -> Result<()> {
    match writer {
        ColumnWriter::Int64ColumnWriter(writer) => {
            #[expect(clippy::cast_possible_wrap, reason = "indices and seeds have 53 bits")]
            let values: Vec<i64> = cells
                .map(|cell| {
                    if let Cell::Integer(number) = cell {
                        *number as i64
                    } else {
                        0
                    }
                })
                .collect();
            writer.write_batch(&values, None, None)?;
        }
        ColumnWriter::DoubleColumnWriter(writer) => {
            let numbers: Vec<Option<f64>> = cells
                .map(|cell| {
                    if let Cell::Number(number) = cell {
                        *number
                    } else {
                        None
                    }
                })
                .collect();
            let values: Vec<f64> = numbers.iter().flatten().copied().collect();
            let levels: Vec<i16> = numbers.iter().map(|number| i16::from(number.is_some())).collect();
            writer.write_batch(&values, Some(&levels), None)?;
        }
        ColumnWriter::ByteArrayColumnWriter(writer) => {
            let text = |cell: &Cell| {
                if let Cell::Text(text) = cell {
                    text.clone()
                } else {
                    String::new()
                }
            };
            let values: Vec<ByteArray> = cells
                .map(|cell| ByteArray::from(text(cell).into_bytes()))
                .collect();
            writer.write_batch(&values, None, None)?;
        }
        ColumnWriter::BoolColumnWriter(writer) => {
            let flags: Vec<Option<bool>> = cells
                .map(|cell| {
                    if let Cell::Flag(flag) = cell {
                        Some(*flag)
                    } else {
                        None
                    }
                })
                .collect();
            let values: Vec<bool> = flags.iter().flatten().copied().collect();
            let levels: Vec<i16> = flags.iter().map(|flag| i16::from(flag.is_some())).collect();
            writer.write_batch(&values, Some(&levels), None)?;
        }
        _ => unreachable!("no column has another type"),
    }
    Ok(())
}
