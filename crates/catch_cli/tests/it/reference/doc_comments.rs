//! Structs and enums of the sources with their doc comments, as rustfmt lays them out.

/// A struct or an enum.
pub struct Item {
    pub name: String,
    pub doc: String,
    pub fields: Vec<Field>,
    /// True if it is read from files of users, strictly.
    pub is_strict: bool,
}

/// A field, or a variant.
#[derive(Default, Clone)]
pub struct Field {
    /// Name in files.
    pub name: String,
    /// Type; for a variant that of its content, empty if it has none.
    pub kind: String,
    pub doc: String,
    /// Its quantity.
    pub quantity: Option<String>,
}

/// All structs and enums of a file outside of its test modules.
pub fn items(text: &str) -> Vec<Item> {
    let text = text.split("\n#[cfg(test)]\nmod ").next().unwrap_or_default();
    let mut items = Vec::new();
    let (mut doc, mut attributes) = (String::new(), String::new());
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        if let Some(comment) = line.strip_prefix("///") {
            push_comment(&mut doc, comment);
        } else if line.starts_with("#[") {
            attributes.push_str(line);
        } else {
            let code = visible(line);
            let named = ["struct ", "enum "].iter().find_map(|kind| code.strip_prefix(kind));
            if let Some(name) = named.and_then(|it| it.strip_suffix(" {")) {
                let body: Vec<&str> = lines.by_ref().take_while(|it| *it != "}").collect();
                let snake_case = attributes.contains("rename_all = \"snake_case\"");
                items.push(Item {
                    name: name.split('<').next().unwrap_or(name).to_owned(),
                    doc: std::mem::take(&mut doc),
                    fields: fields(&body, snake_case, "    "),
                    is_strict: attributes.contains("deny_unknown_fields"),
                });
            }
            doc.clear();
            attributes.clear();
        }
    }
    items
}

fn fields(body: &[&str], snake_case: bool, indent: &str) -> Vec<Field> {
    let mut found: Vec<Field> = Vec::new();
    let (mut doc, mut attributes) = (String::new(), String::new());
    let mut lines = body.iter();
    while let Some(line) = lines.next() {
        let line = line.strip_prefix(indent).unwrap_or(line);
        if let Some(comment) = line.strip_prefix("///") {
            push_comment(&mut doc, comment);
            continue;
        }
        if line.starts_with("#[") {
            attributes.push_str(line);
            continue;
        }
        let code = visible(line).trim_end_matches(',');
        let mut field = Field { doc: std::mem::take(&mut doc), ..Field::default() };
        let mut inner = Vec::new();
        if let Some(name) = code.strip_suffix(" {") {
            // A variant with fields.
            let end = format!("{indent}}},");
            let body: Vec<&str> = lines.by_ref().take_while(|it| **it != end).copied().collect();
            (field.name, field.kind) = (name.to_owned(), "table".to_owned());
            inner = fields(&body, false, &format!("{indent}    "));
        } else if let Some((name, kind)) = code.split_once(": ").filter(|(name, _)| !name.contains(['(', '{'])) {
            (field.name, field.kind) = (name.to_owned(), kind.to_owned());
        } else if let Some((name, kind)) = code.split_once('(') {
            (field.name, field.kind) = (name.to_owned(), kind.trim_end_matches(')').to_owned());
        } else {
            field.name = code.split(" {").next().unwrap_or(code).to_owned();
        }
        if field.name.is_empty() || !field.name.chars().all(|it| it.is_alphanumeric() || it == '_') {
            attributes.clear();
            continue;
        }
        if attributes.contains("serde(skip)") {
            attributes.clear();
            continue;
        }
        if snake_case {
            field.name = snake(&field.name);
        }
        field.quantity = quantity(&field.kind).or(quantity(&attributes));
        field.kind = bare(&field.kind).to_owned();
        if let Some((_, name)) = attributes.split_once("rename = \"") {
            field.name = name.split('"').next().unwrap_or(name).to_owned();
        }
        attributes.clear();
        let prefix = field.name.clone();
        found.push(field);
        found.extend(inner.into_iter().map(|it| Field { name: format!("{prefix}: {}", it.name), ..it }));
    }
    found
}

fn push_comment(doc: &mut String, comment: &str) {
    let separator = if doc.is_empty() || comment.trim().is_empty() { "" } else { " " };
    doc.push_str(separator);
    doc.push_str(comment.trim());
}

fn visible(line: &str) -> &str {
    let kept = ["pub(crate) ", "pub(super) ", "pub "].iter().find_map(|it| line.strip_prefix(it));
    kept.unwrap_or(line)
}

/// Type of the numbers of a quantity.
fn bare(kind: &str) -> &str {
    let Some((_, kind)) = kind.split_once("quantity::") else { return kind };
    kind.split_once('<').and_then(|(_, inner)| inner.strip_suffix('>')).unwrap_or("f64")
}

fn quantity(code: &str) -> Option<String> {
    let name = code.split_once("quantity::")?.1;
    Some(name.chars().take_while(|it| it.is_alphanumeric() || *it == '_').collect())
}

/// `OutOfReach` → `out_of_reach`.
pub fn snake(name: &str) -> String {
    let mut words = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !words.is_empty() {
            words.push('_');
        }
        words.extend(letter.to_lowercase());
    }
    words
}

#[test]
fn fields_and_variants_are_found() {
    let text = r#"
/// A thing.
#[quantity::checked(rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum Thing {
    /// None
    /// at all.
    NotOne,
    /// One.
    One(quantity::size_m),
    Two {
        /// Long.
        a_m: quantity::shape_m<Option<f64>>,
    },
}
"#;
    let [item] = &items(text)[..] else { panic!("one item") };
    let found: Vec<[&str; 4]> = item
        .fields
        .iter()
        .map(|it| [&it.name, &it.kind, &it.doc, it.quantity.as_deref().unwrap_or("")].map(|it| it as &str))
        .collect();
    let expected = [
        ["not_one", "", "None at all.", ""],
        ["one", "f64", "One.", "size_m"],
        ["two", "table", "", ""],
        ["two: a_m", "Option<f64>", "Long.", "shape_m"],
    ];
    assert!(item.is_strict && item.doc == "A thing." && item.name == "Thing");
    assert_eq!(found, expected);
}
