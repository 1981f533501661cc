//! Whole logs into other programs' formats: what [`super::write`] knows, and Parquet and MDF 4 where they were built in.
//!
//! Columns have the names that they have in a CSV, micrometres where it has them; times are seconds from the log's own beginning. Metadata
//! are key-value pairs of a Parquet file, and lines of the comment of MDF 4's channel group. These two are written and never read here.

use super::error::LogError;
use super::writer::write;
use super::{Kind, Log};
use std::path::Path;

#[cfg(any(feature = "parquet", feature = "mf4"))]
use super::column::Column;
#[cfg(any(feature = "parquet", feature = "mf4"))]
use super::writer::{Staged, check, check_finite};
#[cfg(any(feature = "parquet", feature = "mf4"))]
use std::io;

/// Rows of a group in a Parquet file, and of a batch of records: some megabytes.
#[cfg(any(feature = "parquet", feature = "mf4"))]
const BATCH: usize = 65_536;

/// Writes a whole log; the extension (`.csv`, `.npy`, `.mat`, `.parquet`, `.mf4`) says how.
///
/// # Errors
/// As [`write()`]; [`LogError::NotBuilt`] for a format that this program was built without.
pub fn export(path: &Path, log: &Log) -> Result<(), LogError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("parquet") => to_parquet(path, log),
        Some("mf4") => to_mf4(path, log),
        _ if Kind::of_extension(path).is_some() => write(path, log),
        _ => Err(LogError::UnknownKind { path: path.to_path_buf() }),
    }
}

#[cfg(not(feature = "parquet"))]
fn to_parquet(path: &Path, _: &Log) -> Result<(), LogError> {
    Err(LogError::NotBuilt { path: path.to_path_buf(), feature: "parquet" })
}

#[cfg(not(feature = "mf4"))]
fn to_mf4(path: &Path, _: &Log) -> Result<(), LogError> {
    Err(LogError::NotBuilt { path: path.to_path_buf(), feature: "mf4" })
}

/// What goes into a file.
#[cfg(any(feature = "parquet", feature = "mf4"))]
struct LaidOut {
    /// Names and values in the file's units, the time first.
    columns: Vec<(&'static str, Vec<f64>)>,
    meta: Vec<(String, String)>,
}

#[cfg(any(feature = "parquet", feature = "mf4"))]
fn laid_out(path: &Path, log: &Log) -> Result<LaidOut, LogError> {
    check(path, log)?;
    check_finite(path, log)?;
    let time: Vec<f64> = (0..log.len()).map(|row| log.time_s(row)).collect();
    let mut columns = vec![(Column::Time.file_name(), time)];
    for (column, values) in log.columns() {
        let scale = 10_f64.powi(-column.file_exponent());
        columns.push((column.file_name(), values.iter().map(|value| value * scale).collect()));
    }
    let mut meta = log.meta.clone();
    meta.rate_hz.get_or_insert(log.dt_s.recip());
    Ok(LaidOut { columns, meta: meta.entries().into_iter().collect() })
}

#[cfg(feature = "parquet")]
fn to_parquet(path: &Path, log: &Log) -> Result<(), LogError> {
    use parquet::basic::{Repetition, Type as Physical};
    use parquet::data_type::DoubleType;
    use parquet::errors::ParquetError;
    use parquet::file::metadata::KeyValue;
    use parquet::file::properties::WriterProperties;
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::types::Type;
    use std::sync::Arc;

    let LaidOut { columns, meta } = laid_out(path, log)?;
    let mut staged = Staged::create(path)?;
    let written = (|| -> Result<(), ParquetError> {
        let fields = columns.iter().map(|(name, _)| {
            let field = Type::primitive_type_builder(name, Physical::DOUBLE).with_repetition(Repetition::REQUIRED);
            field.build().map(Arc::new)
        });
        let schema = Type::group_type_builder("log").with_fields(fields.collect::<Result<_, _>>()?).build()?;
        let pairs = meta.into_iter().map(|(key, value)| KeyValue::new(key, Some(value))).collect();
        // Displacements never repeat, so that a dictionary would only grow.
        let properties =
            WriterProperties::builder().set_key_value_metadata(Some(pairs)).set_dictionary_enabled(false).build();
        let mut writer = SerializedFileWriter::new(&mut staged.file, Arc::new(schema), Arc::new(properties))?;
        for from in (0..log.len()).step_by(BATCH) {
            let to = (from + BATCH).min(log.len());
            let mut group = writer.next_row_group()?;
            for (_, values) in &columns {
                if let Some(mut column) = group.next_column()? {
                    column.typed::<DoubleType>().write_batch(&values[from..to], None, None)?;
                    column.close()?;
                }
            }
            group.close()?;
        }
        writer.close().map(|_| ())
    })();
    written.map_err(|error| staged.unwritable(io::Error::other(error)))?;
    staged.finish()
}

#[cfg(feature = "mf4")]
fn to_mf4(path: &Path, log: &Log) -> Result<(), LogError> {
    use mdf4_rs::{DataType, DecodedValue, Error, MdfWriter};
    use std::io::Write;

    let LaidOut { columns, meta } = laid_out(path, log)?;
    let mut staged = Staged::create(path)?;
    let made = (|| -> Result<Vec<u8>, Error> {
        let mut writer = MdfWriter::in_memory();
        writer.init_mdf_file()?;
        let group = writer.add_channel_group(None, |_| {})?;
        let comment: Vec<String> = meta.iter().map(|(key, value)| format!("{key}: {value}")).collect();
        writer.set_channel_group_comment(&group, &comment.join("\n"))?;
        let mut last: Option<String> = None;
        for (name, _) in &columns {
            let channel = writer.add_channel(&group, last.as_deref(), |channel| {
                channel.data_type = DataType::FloatLE;
                channel.name = Some((*name).to_owned());
                channel.bit_count = 64;
            })?;
            if last.is_none() {
                writer.set_time_channel(&channel)?;
            }
            if let Some((_, unit)) =
                name.rsplit_once('_').filter(|(_, unit)| ["s", "V", "um", "N", "A", "C"].contains(unit))
            {
                writer.set_channel_unit(&channel, unit)?;
            }
            last = Some(channel);
        }
        writer.start_data_block_for_cg(&group, 0)?;
        for row in 0..log.len() {
            let record: Vec<DecodedValue> =
                columns.iter().map(|(_, values)| DecodedValue::Float(values[row])).collect();
            writer.write_record(&group, &record)?;
        }
        writer.finish_data_block(&group)?;
        writer.finalize()?;
        Ok(writer.into_inner().into_inner())
    })();
    let bytes = made.map_err(|error| staged.unwritable(io::Error::other(error.to_string())))?;
    staged.file.write_all(&bytes).map_err(|source| staged.unwritable(source))?;
    staged.finish()
}
