//! JSON as a document.

use catch_body::{
    InputError,
    document::{Document, Format, MOST_PARTS, NONE},
};
use serde_json::Value;

/// Reads a document of JSON.
///
/// # Errors
/// If it is no JSON, or has too many parts.
pub fn document(file: &str, bytes: &[u8]) -> Result<Document, InputError> {
    // Separators of values are counted, so that their number is bounded before memory is taken for them.
    if bytes.iter().filter(|it| matches!(it, b',' | b'[' | b'{')).count() > MOST_PARTS {
        return Err(InputError::new(file, "content", "more values", format!("at most {MOST_PARTS}")));
    }
    let value: Value =
        serde_json::from_slice(bytes).map_err(|fault| InputError::new(file, "content", fault, "a document of JSON"))?;
    let mut document = Document::new(file, Format::Keys);
    let root = document.add(NONE, "", 0)?;
    add(&mut document, root, value)?;
    Ok(document)
}

fn add(document: &mut Document, part: u32, value: Value) -> Result<(), InputError> {
    match value {
        Value::Object(entries) => {
            for (key, value) in entries {
                let child = document.add(part, &key, 0)?;
                add(document, child, value)?;
            }
        }
        Value::Array(items) => {
            document.set_list(part, true);
            for value in items {
                let child = document.add(part, "", 0)?;
                add(document, child, value)?;
            }
        }
        Value::Null => {}
        Value::String(text) => document.set_text(part, &text),
        other => document.set_text(part, &other.to_string()),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_body::quantity::Quantity;

    #[test]
    fn json_is_a_tree() {
        let any = Quantity { least: -1e9, most: 1e9, unit: "" };
        let document = document("a.gltf", br#"{"a": [{"b": 1, "c": [1, 2.5]}], "d": null}"#).unwrap();
        let item = document.root().child("a").unwrap().items().next().unwrap();
        assert_eq!(item.child("c").unwrap().numbers::<2>(any).unwrap(), [1.0, 2.5]);
        assert!(document.root().child("d").unwrap().is_null());
        let fault = document.finish(&[]).unwrap_err().to_string();
        assert_eq!(fault, "a.gltf: a[0].b: found `b`, which is not read, expected without it; what is read in a: c");
    }
}
