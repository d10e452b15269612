//! Values of a file that say where they come from: published ones as plain numbers, assumed ones with their
//! reason.

use std::{fmt, marker::PhantomData};

use serde::{
    Deserializer, Serialize,
    de::{Error, IntoDeserializer, MapAccess, SeqAccess, Unexpected, Visitor, value::SeqAccessDeserializer},
};

use crate::{
    InputError,
    quantity::{Element, Numbers, Quantity},
};

/// A value of a file, and why it is assumed where nobody published it.
///
/// In a file the value stands alone, or in a table `{ value = …, assumed = true, reason = "…" }`.
#[derive(Debug, Clone, PartialEq)]
pub struct Stated<T> {
    /// The value.
    pub value: T,
    /// Reason for the assumption; `None` where the value is published.
    pub assumed: Option<String>,
}

/// A value that nobody published.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Assumption {
    /// Path of the field within its file.
    pub field: String,
    /// Reason for the value.
    pub reason: String,
}

impl<'de, T: Numbers<'de>> Numbers<'de> for Stated<T> {
    fn within<D: Deserializer<'de>>(range: Quantity, from: D) -> Result<Self, D::Error> {
        from.deserialize_any(StatedVisitor(range, PhantomData))
    }
}

struct StatedVisitor<T>(Quantity, PhantomData<T>);

impl<'de, T: Numbers<'de>> Visitor<'de> for StatedVisitor<T> {
    type Value = Stated<T>;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}", self.0)
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Self::Value, E> {
        Ok(Stated { value: T::within(self.0, value.into_deserializer())?, assumed: None })
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Self::Value, E> {
        self.visit_f64(value as f64)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Self::Value, E> {
        self.visit_f64(value as f64)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, elements: A) -> Result<Self::Value, A::Error> {
        Ok(Stated { value: T::within(self.0, SeqAccessDeserializer::new(elements))?, assumed: None })
    }

    fn visit_map<A: MapAccess<'de>>(self, mut fields: A) -> Result<Self::Value, A::Error> {
        let (mut value, mut assumed, mut reason) = (None, None, None);
        while let Some(name) = fields.next_key::<String>()? {
            match name.as_str() {
                "value" => value = Some(fields.next_value_seed(Element(self.0, PhantomData::<T>))?),
                "assumed" => assumed = Some(fields.next_value::<bool>()?),
                "reason" => reason = Some(fields.next_value::<String>()?),
                _ => return Err(A::Error::unknown_field(&name, &["value", "assumed", "reason"])),
            }
        }
        let value = value.ok_or_else(|| A::Error::missing_field("value"))?;
        let assumed = assumed.ok_or_else(|| A::Error::missing_field("assumed"))?;
        Ok(Stated { value, assumed: reason_of(assumed, reason)? })
    }
}

/// The reason for an assumed value; a published one needs none.
///
/// # Errors
/// An assumption without a reason.
pub(crate) fn reason_of<E: Error>(assumed: bool, reason: Option<String>) -> Result<Option<String>, E> {
    match reason {
        _ if !assumed => Ok(None),
        None => Err(E::missing_field("reason")),
        Some(reason) if reason.trim().is_empty() => {
            Err(E::invalid_value(Unexpected::Str(&reason), &"the reason for an assumed value"))
        }
        Some(reason) => Ok(Some(reason)),
    }
}

/// All values of a TOML file that are marked as assumed, in the order of their paths; none of a file that is
/// no TOML.
///
/// A table is marked by its field `assumed`; its fields `value` and `reason` belong to the mark.
pub fn assumptions(file: &str, text: &str) -> Vec<Assumption> {
    let Ok(table) = InputError::parse_toml::<toml::Table>(file, text) else { return Vec::new() };
    let mut found = Vec::new();
    let mut waiting = vec![(String::new(), toml::Value::Table(table))];
    while let Some((path, value)) = waiting.pop() {
        match value {
            toml::Value::Table(fields) => {
                if fields.get("assumed").and_then(toml::Value::as_bool) == Some(true) {
                    let reason = fields.get("reason").and_then(toml::Value::as_str).unwrap_or_default().to_owned();
                    found.push(Assumption { field: path.clone(), reason });
                }
                let name = |key: String| if path.is_empty() { key } else { format!("{path}.{key}") };
                waiting.extend(fields.into_iter().map(|(key, value)| (name(key), value)));
            }
            toml::Value::Array(elements) => {
                let elements = elements.into_iter().enumerate();
                waiting.extend(elements.map(|(i, element)| (format!("{path}[{i}]"), element)));
            }
            _ => {}
        }
    }
    found.sort_by(|one, other| one.field.cmp(&other.field));
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity;

    #[quantity::checked]
    #[derive(Debug, serde::Deserialize)]
    struct Fields {
        torque_nm: quantity::torque_nm<Stated<f64>>,
        range_rad: quantity::angle_rad<Option<Stated<[f64; 2]>>>,
    }

    fn read(text: &str) -> Result<Fields, InputError> {
        InputError::parse_toml("robot.toml", text)
    }

    #[test]
    fn values_are_plain_or_say_that_they_are_assumed() {
        let fields =
            read("torque_nm = 20\nrange_rad = { value = [-1, 2.5], assumed = true, reason = \"why\" }").unwrap();
        assert_eq!(fields.torque_nm, Stated { value: 20.0, assumed: None });
        assert_eq!(fields.range_rad.unwrap(), Stated { value: [-1.0, 2.5], assumed: Some("why".into()) });
        let fields = read("torque_nm = { value = 3.0, assumed = false, reason = \"a data sheet\" }").unwrap();
        assert_eq!((fields.torque_nm.assumed, fields.range_rad), (None, None));
        assert_eq!(read("torque_nm = 1\nrange_rad = [0, 1]").unwrap().range_rad.unwrap().value, [0.0, 1.0]);
    }

    #[test]
    fn faults_are_told_with_their_place() {
        for (text, expected) in [
            ("torque_nm = -1", "robot.toml: torque_nm: found -1"),
            ("torque_nm = { value = -1, assumed = true, reason = \"why\" }", "robot.toml: torque_nm.value: found -1"),
            ("torque_nm = { value = 1, assumed = true }", "reason"),
            ("torque_nm = { value = 1, assumed = true, reason = \" \" }", "the reason for an assumed value"),
            ("torque_nm = { value = 1, reason = \"why\" }", "assumed"),
            ("torque_nm = { assumed = true, reason = \"why\" }", "value"),
            ("torque_nm = { value = 1, assumed = true, reason = \"why\", unit = 1 }", "unit"),
            ("torque_nm = \"strong\"", "robot.toml: torque_nm: found \"strong\""),
            ("torque_nm = 1\nrange_rad = { value = [1], assumed = true, reason = \"why\" }", "range_rad.value"),
        ] {
            let fault = read(text).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }

    #[test]
    fn all_assumptions_of_a_file_are_found() {
        let text = "[joints.a]\nx = { value = 1, assumed = true, reason = \"one\" }\ny = { value = 1, assumed = false }\n\
            [links.b]\nassumed = true\nreason = \"two\"";
        let found = assumptions("robot.toml", text);
        let expected = [("joints.a.x", "one"), ("links.b", "two")];
        assert_eq!(found.iter().map(|it| (it.field.as_str(), it.reason.as_str())).collect::<Vec<_>>(), expected);
        assert!(assumptions("robot.toml", "a poem").is_empty());
    }
}
