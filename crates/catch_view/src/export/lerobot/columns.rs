//! Columns of lists and images in Parquet, as `datasets` reads them.

use std::{fs::File, sync::Arc};

use parquet::{
    basic::{Compression, LogicalType, Repetition, Type as Physical},
    data_type::{BoolType, ByteArray, ByteArrayType, DataType, FloatType, Int64Type},
    errors::ParquetError,
    file::{
        metadata::KeyValue,
        properties::WriterProperties,
        writer::{SerializedFileWriter, SerializedRowGroupWriter},
    },
    schema::types::Type,
};

use catch_lab::VERSION;

/// A column of a table.
#[derive(Debug, Clone)]
pub struct Column {
    /// Name of the column.
    pub name: String,
    /// A value for each row.
    pub values: Values,
}

/// Values of a column.
#[derive(Debug, Clone)]
pub enum Values {
    /// Truth values.
    Flags(Vec<bool>),
    /// Whole numbers.
    Whole(Vec<i64>),
    /// Numbers.
    Numbers(Vec<f32>),
    /// Numbers in vectors of this length, one per row.
    Vectors(usize, Vec<f32>),
    /// Texts.
    Words(Vec<String>),
    /// Lists of texts.
    Texts(Vec<Vec<String>>),
    /// Files of images.
    Images(Vec<Vec<u8>>),
}

impl Column {
    /// Creates a column.
    pub fn new(name: &str, values: Values) -> Self {
        Self { name: name.to_owned(), values }
    }

    /// Returns the column's entry in the schema: lists and images are groups.
    fn field(&self) -> Result<Type, ParquetError> {
        let plain = |name: &str, physical: Physical, logical: Option<LogicalType>| {
            Type::primitive_type_builder(name, physical)
                .with_repetition(Repetition::REQUIRED)
                .with_logical_type(logical)
                .build()
        };
        let group = |name: &str, repetition, logical: Option<LogicalType>, fields: Vec<Type>| {
            let fields = fields.into_iter().map(Arc::new).collect();
            Type::group_type_builder(name)
                .with_repetition(repetition)
                .with_logical_type(logical)
                .with_fields(fields)
                .build()
        };
        let list = |element: Type| {
            let elements = group("list", Repetition::REPEATED, None, vec![element])?;
            group(&self.name, Repetition::REQUIRED, Some(LogicalType::List), vec![elements])
        };
        match &self.values {
            Values::Flags(_) => plain(&self.name, Physical::BOOLEAN, None),
            Values::Whole(_) => plain(&self.name, Physical::INT64, None),
            Values::Numbers(_) => plain(&self.name, Physical::FLOAT, None),
            Values::Words(_) => plain(&self.name, Physical::BYTE_ARRAY, Some(LogicalType::String)),
            Values::Vectors(..) => list(plain("element", Physical::FLOAT, None)?),
            Values::Texts(_) => list(plain("element", Physical::BYTE_ARRAY, Some(LogicalType::String))?),
            Values::Images(_) => {
                let bytes = plain("bytes", Physical::BYTE_ARRAY, None)?;
                let path = Type::primitive_type_builder("path", Physical::BYTE_ARRAY)
                    .with_repetition(Repetition::OPTIONAL)
                    .with_logical_type(Some(LogicalType::String))
                    .build()?;
                group(&self.name, Repetition::REQUIRED, None, vec![bytes, path])
            }
        }
    }
}

/// Writes the columns as one row group, with a name and a text about them.
pub fn write(file: &mut File, columns: &[Column], about: Option<(String, String)>) -> Result<(), ParquetError> {
    let fields = columns.iter().map(|it| it.field().map(Arc::new)).collect::<Result<_, _>>()?;
    let schema = Arc::new(Type::group_type_builder("schema").with_fields(fields).build()?);
    let properties = WriterProperties::builder()
        .set_created_by(format!("catchingbot {VERSION}"))
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(about.map(|(name, text)| vec![KeyValue::new(name, text)]))
        .build();
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    for column in columns {
        match &column.values {
            Values::Flags(values) => add::<BoolType>(&mut group, values, None, None)?,
            Values::Whole(values) => add::<Int64Type>(&mut group, values, None, None)?,
            Values::Numbers(values) => add::<FloatType>(&mut group, values, None, None)?,
            Values::Words(values) => add::<ByteArrayType>(&mut group, &texts(values), None, None)?,
            Values::Vectors(length, values) => {
                let begins: Vec<i16> = (0..values.len()).map(|it| i16::from(it % length != 0)).collect();
                add::<FloatType>(&mut group, values, Some(&vec![1; values.len()]), Some(&begins))?;
            }
            Values::Texts(rows) => {
                let values: Vec<String> = rows.concat();
                let begins: Vec<i16> = rows.iter().flat_map(|row| (0..row.len()).map(|it| i16::from(it > 0))).collect();
                add::<ByteArrayType>(&mut group, &texts(&values), Some(&vec![1; values.len()]), Some(&begins))?;
            }
            Values::Images(files) => {
                let bytes: Vec<ByteArray> = files.iter().cloned().map(ByteArray::from).collect();
                add::<ByteArrayType>(&mut group, &bytes, None, None)?;
                // No path: the bytes are all.
                add::<ByteArrayType>(&mut group, &[], Some(&vec![0; files.len()]), None)?;
            }
        }
    }
    group.close()?;
    writer.close()?;
    Ok(())
}

fn texts(values: &[String]) -> Vec<ByteArray> {
    values.iter().map(|it| ByteArray::from(it.as_str())).collect()
}

/// Adds the next column with its definition and repetition levels.
fn add<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, &mut File>,
    values: &[T::T],
    definition: Option<&[i16]>,
    repetition: Option<&[i16]>,
) -> Result<(), ParquetError> {
    let Some(mut writer) = group.next_column()? else { return Ok(()) };
    writer.typed::<T>().write_batch(values, definition, repetition)?;
    writer.close()
}
