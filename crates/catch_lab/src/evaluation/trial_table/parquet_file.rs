//! The table of trials in Parquet.

use std::{fs::File, sync::Arc};

use parquet::{
    basic::{Compression, LogicalType, Repetition, Type as Physical},
    data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type},
    errors::ParquetError,
    file::{
        metadata::KeyValue,
        properties::WriterProperties,
        writer::{SerializedFileWriter, SerializedRowGroupWriter},
    },
    schema::types::Type,
};
use serde_json::Value;

use super::{Column, GROUP_ROWS, Kind, columns};
use crate::{VERSION, evaluation::Row};

/// Writes the rows as columns, those that have no value in a row as null there.
pub fn write(file: &mut File, rows: &[Row], identity: &str) -> Result<(), ParquetError> {
    let field = |column: &Column| {
        let physical = match column.kind {
            Kind::Text => Physical::BYTE_ARRAY,
            Kind::Count => Physical::INT64,
            Kind::Flag => Physical::BOOLEAN,
            Kind::Number => Physical::DOUBLE,
        };
        let logical = match column.kind {
            Kind::Text => Some(LogicalType::String),
            Kind::Count => Some(LogicalType::integer(64, false)),
            Kind::Flag | Kind::Number => None,
        };
        let builder = Type::primitive_type_builder(&column.name, physical);
        builder.with_repetition(Repetition::OPTIONAL).with_logical_type(logical).build().map(Arc::new)
    };
    let fields = columns(&[]).iter().map(field).collect::<Result<_, _>>()?;
    let schema = Arc::new(Type::group_type_builder("trials").with_fields(fields).build()?);
    let about = KeyValue::new("evaluation".to_owned(), identity.to_owned());
    let properties = WriterProperties::builder()
        .set_created_by(format!("catchingbot {VERSION}"))
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(Some(vec![about]))
        .build();
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties))?;
    for rows in rows.chunks(GROUP_ROWS) {
        let mut group = writer.next_row_group()?;
        for column in &columns(rows) {
            match column.kind {
                Kind::Text => add::<ByteArrayType>(&mut group, column, |value| value.as_str().map(ByteArray::from))?,
                // The bits of an unsigned number.
                Kind::Count => add::<Int64Type>(&mut group, column, |value| value.as_u64().map(u64::cast_signed))?,
                Kind::Flag => add::<BoolType>(&mut group, column, Value::as_bool)?,
                Kind::Number => add::<DoubleType>(&mut group, column, Value::as_f64)?,
            }
        }
        group.close()?;
    }
    writer.close()?;
    Ok(())
}

/// Adds a column: the values that there are, and for each row whether there is one.
fn add<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, &mut File>,
    column: &Column,
    read: impl Fn(&Value) -> Option<T::T>,
) -> Result<(), ParquetError> {
    let Some(mut writer) = group.next_column()? else { return Ok(()) };
    let values: Vec<Option<T::T>> = column.values.iter().map(read).collect();
    let levels: Vec<i16> = values.iter().map(|value| i16::from(value.is_some())).collect();
    let present: Vec<T::T> = values.into_iter().flatten().collect();
    writer.typed::<T>().write_batch(&present, Some(&levels), None)?;
    writer.close()
}
