//! Several series as one table in the format Parquet, with the same rows and columns as the table of text
//! ([`rcs_formula::csv`]). Numbers are doubles, whole numbers that are too large for doubles are integers of 64 bits,
//! `false` and `true` are booleans, other states and texts are strings by name, and what is missing is null.

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::Result;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;
use rcs_formula::{Points, rows};
use rcs_msg::Stamp;
use std::io::Write;
use std::ops::RangeInclusive;
use std::sync::Arc;

/// Rows of a row group, so that a reader can skip parts of a long table.
const ROWS: usize = 1 << 20;

/// The values of named series between two times, with the time in seconds since `start` and in nanoseconds.
pub(crate) fn parquet(
    columns: &[(String, &Points)],
    times: &RangeInclusive<Stamp>,
    start: Stamp,
) -> Result<Vec<u8>> {
    let points: Vec<&Points> = columns.iter().map(|(_, points)| *points).collect();
    let kinds: Vec<Kind> = points.iter().map(|points| Kind::of(points)).collect();
    let mut table = Table { stamps: Vec::new(), cells: vec![Vec::new(); columns.len()] };
    let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
    let mut writer = SerializedFileWriter::new(Vec::new(), schema(columns, &kinds)?, Arc::new(properties))?;
    let mut failed = None;
    rows(&points, times, |stamp, row| {
        table.stamps.push(stamp);
        for (cells, value) in table.cells.iter_mut().zip(row) {
            cells.push(*value);
        }
        if table.stamps.len() == ROWS && failed.is_none() {
            failed = table.flush(&mut writer, &points, &kinds, start).err();
        }
    });
    failed.map_or(Ok(()), Err)?;
    table.flush(&mut writer, &points, &kinds, start)?;
    writer.into_inner()
}

fn schema(columns: &[(String, &Points)], kinds: &[Kind]) -> Result<Arc<Type>> {
    let field = |name: &str, physical, logical, repetition| {
        let builder = Type::primitive_type_builder(name, physical);
        builder.with_logical_type(logical).with_repetition(repetition).build().map(Arc::new)
    };
    let mut fields = vec![
        field("time_s", Physical::DOUBLE, None, Repetition::REQUIRED)?,
        field("time_ns", Physical::INT64, None, Repetition::REQUIRED)?,
    ];
    for ((name, _), kind) in columns.iter().zip(kinds) {
        let integer = |is_signed| Some(LogicalType::Integer { bit_width: 64, is_signed });
        let (physical, logical) = match kind {
            Kind::Bool => (Physical::BOOLEAN, None),
            Kind::Name => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            Kind::Number => (Physical::DOUBLE, None),
            Kind::Signed => (Physical::INT64, integer(true)),
            Kind::Unsigned => (Physical::INT64, integer(false)),
        };
        fields.push(field(name, physical, logical, Repetition::OPTIONAL)?);
    }
    Ok(Arc::new(Type::group_type_builder("fields").with_fields(fields).build()?))
}

/// What a column contains.
enum Kind {
    /// `false` and `true`.
    Bool,
    /// Other states, and texts, by name.
    Name,
    /// Doubles.
    Number,
    /// Whole numbers of 64 bits with a sign.
    Signed,
    /// Whole numbers of 64 bits, some of them greater than those with a sign.
    Unsigned,
}

impl Kind {
    fn of(points: &Points) -> Self {
        let all = |fits: fn(i128) -> bool| {
            let fits = |(index, value): (usize, &f64)| points.whole_at(index).map_or(value.is_nan(), fits);
            points.values.iter().enumerate().all(fits)
        };
        let is_bool = |value: &f64| value.is_nan() || *value == 0.0 || *value == 1.0;
        let names = points.names.iter().map(|(value, name)| (*value, &**name));
        if names.eq([(0, "false"), (1, "true")]) && points.values.iter().all(is_bool) {
            Self::Bool
        } else if points.are_states() {
            Self::Name
        } else if points.whole.is_empty() {
            Self::Number
        } else if all(|whole| i64::try_from(whole).is_ok()) {
            Self::Signed
        } else if all(|whole| u64::try_from(whole).is_ok()) {
            Self::Unsigned
        } else {
            Self::Number
        }
    }
}

/// The rows of the row group that is being filled.
struct Table {
    stamps: Vec<Stamp>,
    /// By column, the index of the value in each row.
    cells: Vec<Vec<Option<usize>>>,
}

impl Table {
    /// Writes the rows, and forgets them.
    fn flush<W: Write + Send>(
        &mut self,
        writer: &mut SerializedFileWriter<W>,
        columns: &[&Points],
        kinds: &[Kind],
        start: Stamp,
    ) -> Result<()> {
        let mut group = writer.next_row_group()?;
        let seconds: Vec<f64> = self.stamps.iter().map(|stamp| stamp.seconds_since(start)).collect();
        write::<DoubleType, _>(&mut group, &seconds, None)?;
        let nanos: Vec<i64> = self.stamps.iter().map(|stamp| stamp.0 as i64).collect();
        write::<Int64Type, _>(&mut group, &nanos, None)?;
        for ((points, kind), cells) in columns.iter().zip(kinds).zip(&mut self.cells) {
            let is_present = |index: &usize| !points.values[*index].is_nan();
            let cells: Vec<Option<usize>> = cells.drain(..).map(|cell| cell.filter(is_present)).collect();
            let present: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
            let indices = cells.into_iter().flatten();
            match kind {
                Kind::Bool => {
                    let values: Vec<bool> = indices.map(|index| points.values[index] != 0.0).collect();
                    write::<BoolType, _>(&mut group, &values, Some(&present))?;
                }
                Kind::Name => {
                    let name =
                        |value| points.name(value).map_or_else(|| value.to_string(), ToString::to_string);
                    let names: Vec<ByteArray> = indices
                        .map(|index| ByteArray::from(name(points.values[index]).into_bytes()))
                        .collect();
                    write::<ByteArrayType, _>(&mut group, &names, Some(&present))?;
                }
                Kind::Number => {
                    let values: Vec<f64> = indices.map(|index| points.values[index]).collect();
                    write::<DoubleType, _>(&mut group, &values, Some(&present))?;
                }
                // The bits of an integer without a sign are stored as those of one with a sign.
                Kind::Signed | Kind::Unsigned => {
                    let whole = |index| points.whole_at(index).unwrap_or_default() as i64;
                    let values: Vec<i64> = indices.map(whole).collect();
                    write::<Int64Type, _>(&mut group, &values, Some(&present))?;
                }
            }
        }
        self.stamps.clear();
        group.close().map(|_| ())
    }
}

/// Writes the next column: its values, and for each row whether it has one.
fn write<T: DataType, W: Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    values: &[T::T],
    present: Option<&[i16]>,
) -> Result<()> {
    if let Some(mut column) = group.next_column()? {
        column.typed::<T>().write_batch(values, present, None)?;
        column.close()?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::Field;

    #[test]
    fn the_table_has_the_values_the_names_and_the_gaps_of_the_text() {
        let a = Points::from_seconds(&[(0.0, 1.0), (1.0, 2.5), (1.0, 3.0), (2.0, f64::NAN)]);
        let names = Arc::new([(0, Arc::from("DONE")), (1, Arc::from("EXEC"))].into());
        let b = Points { names, ..Points::from_seconds(&[(1.0, 1.0), (2.5, 0.0), (9.0, 0.0)]) };
        let columns = [("/a.x".to_owned(), &a), ("/b.state".to_owned(), &b)];
        let times = Stamp(500_000_000)..=Stamp(3_000_000_000);
        let bytes = parquet(&columns, &times, Stamp(500_000_000)).unwrap();
        let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap();
        let read: Vec<Vec<(String, Field)>> = reader
            .get_row_iter(None)
            .unwrap()
            .map(|row| row.unwrap().get_column_iter().map(|(n, f)| (n.clone(), f.clone())).collect())
            .collect();
        let names: Vec<&str> = read[0].iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["time_s", "time_ns", "/a.x", "/b.state"]);
        let cells = |row: usize| read[row].iter().map(|(_, cell)| cell.clone()).collect::<Vec<_>>();
        let text = |text: &str| Field::Str(text.to_owned());
        let time = |ns: i64| [Field::Double((ns - 500_000_000) as f64 / 1e9), Field::Long(ns)];
        let row = |ns, a, b| [time(ns).to_vec(), vec![a, b]].concat();
        assert_eq!(cells(0), row(1_000_000_000, Field::Double(2.5), text("EXEC")));
        assert_eq!(cells(1), row(1_000_000_000, Field::Double(3.0), Field::Null));
        assert_eq!(cells(2), row(2_000_000_000, Field::Null, Field::Null));
        assert_eq!(cells(3), row(2_500_000_000, Field::Null, text("DONE")));
        assert_eq!(read.len(), 4);
    }

    #[test]
    fn whole_numbers_that_a_double_cannot_hold_are_integers() {
        let column = |whole: [Option<i128>; 3]| {
            let value = |index: usize| whole[index].map_or(f64::NAN, |whole| whole as f64);
            let seconds = [(0.0, value(0)), (1.0, value(1)), (2.0, value(2))];
            Points { whole: Arc::from(whole), ..Points::from_seconds(&seconds) }
        };
        let signed = column([Some(-(1 << 60) - 1), None, Some(3)]);
        let unsigned = column([Some((1 << 63) + 1), Some(0), None]);
        let neither = column([Some((1 << 63) + 1), Some(-1), None]);
        let columns =
            [("/a.n", &signed), ("/b.n", &unsigned), ("/c.n", &neither)].map(|(n, c)| (n.to_owned(), c));
        let bytes = parquet(&columns, &(Stamp(0)..=Stamp(9_000_000_000)), Stamp(0)).unwrap();
        let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap();
        let read: Vec<Vec<Field>> = reader
            .get_row_iter(None)
            .unwrap()
            .map(|row| row.unwrap().get_column_iter().skip(2).map(|(_, field)| field.clone()).collect())
            .collect();
        let double = |value: i128| Field::Double(value as f64);
        assert_eq!(
            read,
            [
                vec![Field::Long(-(1 << 60) - 1), Field::ULong((1 << 63) + 1), double(1 << 63)],
                vec![Field::Null, Field::ULong(0), double(-1)],
                vec![Field::Long(3), Field::Null, Field::Null],
            ]
        );
    }

    #[test]
    fn what_is_false_or_true_is_a_boolean() {
        let points = Points::from_seconds(&[(0.0, 1.0), (1.0, f64::NAN), (2.0, 0.0)]).as_truth();
        let columns = [("/a.is_on".to_owned(), &points)];
        let bytes = parquet(&columns, &(Stamp(0)..=Stamp(9_000_000_000)), Stamp(0)).unwrap();
        let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap();
        let read: Vec<Field> = reader
            .get_row_iter(None)
            .unwrap()
            .filter_map(|row| row.unwrap().get_column_iter().nth(2).map(|(_, field)| field.clone()))
            .collect();
        assert_eq!(read, [Field::Bool(true), Field::Null, Field::Bool(false)]);
    }

    #[test]
    fn a_table_without_rows_has_its_columns() {
        let none = Points::from_seconds(&[]);
        let bytes = parquet(&[("/a.x".to_owned(), &none)], &(Stamp(0)..=Stamp(1)), Stamp(0)).unwrap();
        let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap();
        let schema = reader.metadata().file_metadata().schema_descr();
        assert_eq!((schema.num_columns(), reader.metadata().file_metadata().num_rows()), (3, 0));
    }
}
