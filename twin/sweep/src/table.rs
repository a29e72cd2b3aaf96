//! A table stored by columns, and as a Parquet file: zstd, in row groups, every column optional.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, Result, anyhow, bail};
use parquet::basic::{Compression, ConvertedType, Repetition, Type as Physical, ZstdLevel};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

use crate::columns::{ColumnKind, TableColumn};

/// Number of rows in a row group.
const ROW_GROUP_SIZE: usize = 1 << 17;

/// Values of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum ColumnValues {
    Whole(Vec<Option<i64>>),
    Number(Vec<Option<f64>>),
    Flag(Vec<Option<bool>>),
    Text(Vec<Option<ByteArray>>),
}

/// A single value.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    None,
    Whole(i64),
    Number(f64),
    Flag(bool),
    Text(String),
}

impl ColumnValues {
    fn new(kind: ColumnKind) -> Self {
        match kind {
            ColumnKind::Whole => Self::Whole(Vec::new()),
            ColumnKind::Number => Self::Number(Vec::new()),
            ColumnKind::Flag => Self::Flag(Vec::new()),
            ColumnKind::Text => Self::Text(Vec::new()),
        }
    }

    fn push(&mut self, cell: Cell) -> Result<()> {
        match (self, cell) {
            (Self::Whole(values), Cell::Whole(value)) => values.push(Some(value)),
            (Self::Number(values), Cell::Number(value)) => values.push(Some(value)),
            (Self::Number(values), Cell::Whole(value)) => values.push(Some(value as f64)),
            (Self::Flag(values), Cell::Flag(value)) => values.push(Some(value)),
            (Self::Text(values), Cell::Text(value)) => values.push(Some(value.into_bytes().into())),
            (Self::Whole(values), Cell::None) => values.push(None),
            (Self::Number(values), Cell::None) => values.push(None),
            (Self::Flag(values), Cell::None) => values.push(None),
            (Self::Text(values), Cell::None) => values.push(None),
            (_, cell) => bail!("found {cell:?}, expected a value of the column's kind"),
        }
        Ok(())
    }

    /// Returns the rows given by `order`, in that order.
    fn take(&self, order: &[usize]) -> Self {
        fn picked<T: Clone>(values: &[T], order: &[usize]) -> Vec<T> {
            order.iter().map(|row| values[*row].clone()).collect()
        }
        match self {
            Self::Whole(values) => Self::Whole(picked(values, order)),
            Self::Number(values) => Self::Number(picked(values, order)),
            Self::Flag(values) => Self::Flag(picked(values, order)),
            Self::Text(values) => Self::Text(picked(values, order)),
        }
    }

    fn append(&mut self, other: Self) -> Result<()> {
        match (self, other) {
            (Self::Whole(own), Self::Whole(more)) => own.extend(more),
            (Self::Number(own), Self::Number(more)) => own.extend(more),
            (Self::Flag(own), Self::Flag(more)) => own.extend(more),
            (Self::Text(own), Self::Text(more)) => own.extend(more),
            _ => bail!("columns are of different kinds"),
        }
        Ok(())
    }

    /// Returns platform-independent bytes of a value, for a digest.
    pub fn bytes(&self, row: usize) -> Option<Vec<u8>> {
        match self {
            Self::Whole(values) => values[row].map(|value| value.to_le_bytes().to_vec()),
            Self::Number(values) => values[row].map(|value| value.to_bits().to_le_bytes().to_vec()),
            Self::Flag(values) => values[row].map(|value| vec![u8::from(value)]),
            Self::Text(values) => values[row].as_ref().map(|value| value.data().to_vec()),
        }
    }
}

/// A table of equally long columns.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnTable {
    pub columns: Vec<TableColumn>,
    /// Values of each column.
    pub values: Vec<ColumnValues>,
    pub rows: usize,
}

impl ColumnTable {
    /// Creates an empty table.
    pub fn new(columns: Vec<TableColumn>) -> Self {
        let values = columns.iter().map(|column| ColumnValues::new(column.kind)).collect();
        Self { columns, values, rows: 0 }
    }

    /// Adds a row with one cell per column.
    pub fn push(&mut self, cells: impl IntoIterator<Item = Cell>) -> Result<()> {
        let mut count = 0;
        for ((values, column), cell) in self.values.iter_mut().zip(&self.columns).zip(cells) {
            values.push(cell).with_context(|| format!("column {}", column.name))?;
            count += 1;
        }
        if count != self.columns.len() {
            bail!("found a row of {count} cells, expected {}", self.columns.len());
        }
        self.rows += 1;
        Ok(())
    }

    /// Appends the rows of another table with the same columns.
    pub fn append(&mut self, other: Self) -> Result<()> {
        if self.columns != other.columns {
            bail!("schema mismatch");
        }
        for (own, more) in self.values.iter_mut().zip(other.values) {
            own.append(more)?;
        }
        self.rows += other.rows;
        Ok(())
    }

    /// Returns the values of a column.
    pub fn column(&self, name: &str) -> Result<&ColumnValues> {
        let at = self.columns.iter().position(|column| column.name == name);
        at.map(|at| &self.values[at]).with_context(|| format!("found no column {name}"))
    }

    /// Sorts the rows by the values of these columns.
    pub fn sort(&mut self, by: &[&str]) -> Result<()> {
        let mut order: Vec<usize> = (0..self.rows).collect();
        let keys: Vec<&ColumnValues> = by.iter().map(|name| self.column(name)).collect::<Result<_>>()?;
        order.sort_by(|&a, &b| {
            keys.iter()
                .map(|values| match values {
                    ColumnValues::Whole(values) => values[a].cmp(&values[b]),
                    ColumnValues::Flag(values) => values[a].cmp(&values[b]),
                    ColumnValues::Number(values) => {
                        values[a].partial_cmp(&values[b]).unwrap_or(std::cmp::Ordering::Equal)
                    }
                    ColumnValues::Text(values) => {
                        let bytes = |row: usize| values[row].as_ref().map(ByteArray::data);
                        bytes(a).cmp(&bytes(b))
                    }
                })
                .find(|order| order.is_ne())
                .unwrap_or(std::cmp::Ordering::Equal)
        });
        self.values = self.values.iter().map(|values| values.take(&order)).collect();
        Ok(())
    }

    /// Writes the table as a Parquet file with `metadata`.
    pub fn to_parquet(&self, metadata: &[(&str, String)]) -> Result<Vec<u8>> {
        let fields = self.columns.iter().map(|column| {
            let (physical, converted) = match column.kind {
                ColumnKind::Whole => (Physical::INT64, ConvertedType::NONE),
                ColumnKind::Number => (Physical::DOUBLE, ConvertedType::NONE),
                ColumnKind::Flag => (Physical::BOOLEAN, ConvertedType::NONE),
                ColumnKind::Text => (Physical::BYTE_ARRAY, ConvertedType::UTF8),
            };
            let field = Type::primitive_type_builder(&column.name, physical);
            field.with_repetition(Repetition::OPTIONAL).with_converted_type(converted).build().map(Arc::new)
        });
        let schema = Type::group_type_builder("schema").with_fields(fields.collect::<Result<_, _>>()?).build()?;
        let pairs = metadata.iter().map(|(key, value)| KeyValue::new((*key).to_owned(), Some(value.clone())));
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_key_value_metadata(Some(pairs.collect()))
            .build();
        let mut writer = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))?;
        for from in (0..self.rows.max(1)).step_by(ROW_GROUP_SIZE) {
            let rows = from..self.rows.min(from + ROW_GROUP_SIZE);
            let mut group = writer.next_row_group()?;
            for values in &self.values {
                let mut column = group.next_column()?.context("a column less than there are values")?;
                let typed = column.untyped();
                match values {
                    ColumnValues::Whole(values) => write::<Int64Type>(typed, &values[rows.clone()])?,
                    ColumnValues::Number(values) => write::<DoubleType>(typed, &values[rows.clone()])?,
                    ColumnValues::Flag(values) => write::<BoolType>(typed, &values[rows.clone()])?,
                    ColumnValues::Text(values) => write::<ByteArrayType>(typed, &values[rows.clone()])?,
                }
                column.close()?;
            }
            group.close()?;
        }
        Ok(writer.into_inner()?)
    }
}

fn write<T: DataType>(to: &mut parquet::column::writer::ColumnWriter, values: &[Option<T::T>]) -> Result<()> {
    let levels: Vec<i16> = values.iter().map(|value| i16::from(value.is_some())).collect();
    let present: Vec<T::T> = values.iter().flatten().cloned().collect();
    let Some(writer) = T::get_column_writer_mut(to) else { bail!("a column of another kind") };
    writer.write_batch(&present, Some(&levels), None)?;
    Ok(())
}

/// An open Parquet file.
pub struct ParquetReader {
    reader: SerializedFileReader<File>,
}

impl ParquetReader {
    /// Opens a file. Fails with its name if it is not a complete Parquet file.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).with_context(|| path.display().to_string())?;
        let reader = SerializedFileReader::new(file)
            .with_context(|| format!("{}: found no whole Parquet file, expected one", path.display()))?;
        Ok(Self { reader })
    }

    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        usize::try_from(self.reader.metadata().file_metadata().num_rows()).unwrap_or(0)
    }

    /// Returns a value of the file's metadata.
    pub fn metadata(&self, key: &str) -> Option<&str> {
        let pairs = self.reader.metadata().file_metadata().key_value_metadata()?;
        pairs.iter().find(|pair| pair.key == key)?.value.as_deref()
    }

    /// Reads the columns `wanted`, one row group after the other.
    pub fn groups<'a>(&'a self, wanted: &'a [TableColumn]) -> Result<impl Iterator<Item = Result<ColumnTable>> + 'a> {
        let schema = self.reader.metadata().file_metadata().schema_descr();
        let place = |column: &TableColumn| {
            let found = (0..schema.num_columns()).find(|at| schema.column(*at).name() == column.name);
            found.ok_or_else(|| anyhow!("found no column {}", column.name))
        };
        let places: Vec<usize> = wanted.iter().map(place).collect::<Result<_>>()?;
        Ok((0..self.reader.num_row_groups()).map(move |group| {
            let group = self.reader.get_row_group(group)?;
            let rows = usize::try_from(group.metadata().num_rows())?;
            let values = wanted.iter().zip(&places).map(|(column, at)| {
                let read = read(group.get_column_reader(*at)?, column.kind, rows);
                read.with_context(|| format!("column {}", column.name))
            });
            Ok(ColumnTable { columns: wanted.to_vec(), values: values.collect::<Result<_>>()?, rows })
        }))
    }

    /// Reads the whole table.
    pub fn read(&self, columns: &[TableColumn]) -> Result<ColumnTable> {
        let mut table = ColumnTable::new(columns.to_vec());
        for group in self.groups(columns)? {
            table.append(group?)?;
        }
        Ok(table)
    }
}

fn read(reader: ColumnReader, kind: ColumnKind, rows: usize) -> Result<ColumnValues> {
    Ok(match (kind, reader) {
        (ColumnKind::Whole, ColumnReader::Int64ColumnReader(reader)) => ColumnValues::Whole(optional(reader, rows)?),
        (ColumnKind::Number, ColumnReader::DoubleColumnReader(reader)) => ColumnValues::Number(optional(reader, rows)?),
        (ColumnKind::Flag, ColumnReader::BoolColumnReader(reader)) => ColumnValues::Flag(optional(reader, rows)?),
        (ColumnKind::Text, ColumnReader::ByteArrayColumnReader(reader)) => ColumnValues::Text(optional(reader, rows)?),
        (kind, _) => bail!("found another kind of column, expected {kind:?}"),
    })
}

fn optional<T: DataType>(mut reader: ColumnReaderImpl<T>, rows: usize) -> Result<Vec<Option<T::T>>> {
    let (mut present, mut levels) = (Vec::with_capacity(rows), Vec::with_capacity(rows));
    reader.read_records(rows, Some(&mut levels), None, &mut present)?;
    if levels.len() != rows {
        bail!("found {} values, expected {rows}", levels.len());
    }
    let mut present = present.into_iter();
    levels
        .iter()
        .map(|level| if *level == 0 { Ok(None) } else { present.next().map(Some).context("a value is missing") })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns() -> Vec<TableColumn> {
        [("n", ColumnKind::Whole), ("x", ColumnKind::Number), ("yes", ColumnKind::Flag), ("word", ColumnKind::Text)]
            .map(|(name, kind)| TableColumn { name: name.into(), kind, description: "" })
            .to_vec()
    }

    fn table() -> ColumnTable {
        let mut table = ColumnTable::new(columns());
        for n in 0..300 {
            let word = if n % 7 == 0 { Cell::None } else { Cell::Text(format!("word {}", n % 5)) };
            let x = if n % 3 == 0 { Cell::None } else { Cell::Number(0.1 * f64::from(n)) };
            table.push([Cell::Whole(300 - i64::from(n)), x, Cell::Flag(n % 2 == 0), word]).expect("a row");
        }
        table
    }

    #[test]
    fn a_table_comes_back_bit_for_bit() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("t.parquet");
        let table = table();
        std::fs::write(&file, table.to_parquet(&[("ftac.unit", "u".into())]).expect("written")).expect("written");
        let reader = ParquetReader::open(&file).expect("opens");
        assert_eq!((reader.rows(), reader.metadata("ftac.unit")), (300, Some("u")));
        assert_eq!(reader.read(&columns()).expect("read"), table);
        // Reads some columns only, and a missing one.
        let some = reader.read(&columns()[3..]).expect("read");
        assert_eq!(some.values, table.values[3..]);
        let other = TableColumn { name: "y".into(), kind: ColumnKind::Number, description: "" };
        assert!(reader.read(&[other]).expect_err("no y").to_string().contains("no column y"));
    }

    #[test]
    fn half_a_file_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("half.parquet");
        let whole = table().to_parquet(&[]).expect("written");
        std::fs::write(&file, &whole[..whole.len() / 2]).expect("written");
        let error = format!("{:#}", ParquetReader::open(&file).err().expect("an error"));
        assert!(error.contains("half.parquet") && error.contains("no whole Parquet file"), "{error}");
    }

    #[test]
    fn rows_are_sorted_together() {
        let mut table = table();
        table.sort(&["word", "n"]).expect("sorted");
        let (ColumnValues::Text(words), ColumnValues::Whole(n)) = (&table.values[3], &table.values[0]) else {
            panic!("kinds")
        };
        let keys: Vec<_> = words.iter().map(|word| word.as_ref().map(|word| word.data().to_vec())).zip(n).collect();
        assert!(keys.windows(2).all(|pair| pair[0] <= pair[1]));
    }
}
