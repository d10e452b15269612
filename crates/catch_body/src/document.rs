//! Documents of any format as one tree that remembers what its reader asked for.
//!
//! A reader asks for elements, attributes and keys by their names. When it is done, [`Document::finish`]
//! walks the tree once more: what nobody asked for and what stands in no list of harmless names is a fault
//! with its place. So nothing is dropped in silence, in whatever format: [XML](Document::from_xml),
//! [columns](Document::from_columns), and what another reader [adds](Document::add) part by part.

mod node;
mod xml;

use std::{
    cell::{Cell, RefCell},
    collections::{BTreeSet, HashMap},
};

use crate::InputError;

pub use node::Node;
pub use xml::root_element;

/// Elements, attributes, keys and items of a document at most.
pub const MOST_PARTS: usize = 2_000_000;
/// Greatest number of faults of one document that are reported at once.
const MOST_FAULTS: usize = 12;
/// Index that stands for no part.
pub const NONE: u32 = u32::MAX;

/// Names that say nothing to this program, spaces between them, by the name of what they stand in; `*` is
/// any, and attributes begin with `@`.
pub type Harmless = &'static [(&'static str, &'static str)];

/// A parsed file, and what was asked of it.
pub struct Document {
    file: String,
    /// Format, which decides how errors name the entries.
    format: Format,
    names: Vec<Box<str>>,
    by_name: HashMap<Box<str>, u32>,
    parts: Vec<Part>,
    /// Names that were asked for, by the name of what they stand in.
    asked: RefCell<BTreeSet<(u32, &'static str)>>,
}

/// The notation of a file, which decides how errors name its parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Format {
    /// Elements and attributes.
    Xml,
    /// Keys and values.
    Keys,
    /// A table with a header.
    Columns,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum State {
    Unread,
    Read,
    LeftOut,
}

/// An element, an attribute, a key or an item.
struct Part {
    name: u32,
    is_attribute: bool,
    is_list: bool,
    line: u32,
    parent: u32,
    first_child: u32,
    last_child: u32,
    next: u32,
    text: Box<str>,
    state: Cell<State>,
}

impl Document {
    /// A document without a part; the first that is added is its root.
    pub fn new(file: &str, format: Format) -> Self {
        Self {
            file: file.to_owned(),
            format,
            names: Vec::new(),
            by_name: HashMap::new(),
            parts: Vec::new(),
            asked: RefCell::default(),
        }
    }

    /// The columns of a table as a tree: an entry for each name of a header, in small letters and without
    /// quotes, whose text is the column's number from zero.
    ///
    /// # Errors
    /// A name twice.
    pub fn from_columns(file: &str, line: usize, header: &[&str]) -> Result<Self, InputError> {
        let mut document = Self::new(file, Format::Columns);
        let root = document.add(NONE, "", line as u32)?;
        let clean = |it: &&str| it.to_lowercase().trim_matches(['"', '\'', '/']).to_owned();
        let names: Vec<String> = header.iter().map(clean).collect();
        for (i, name) in names.iter().enumerate() {
            if !name.is_empty() && names[..i].contains(name) {
                let found = format!("the column `{name}` twice");
                return Err(InputError::new(file, format!("line {line}"), found, "each column once"));
            }
            let column = document.add(root, name, line as u32)?;
            document.parts[column as usize].text = i.to_string().into();
        }
        Ok(document)
    }

    /// The number of the column with the first of these names that a header has.
    pub fn column(&self, names: &[&'static str]) -> Option<usize> {
        names.iter().find_map(|name| self.root().child(name)?.text().parse().ok())
    }

    /// Adds a part behind the last child of `parent`, which is [`NONE`] for the root; its number.
    ///
    /// # Errors
    /// If there are too many.
    pub fn add(&mut self, parent: u32, name: &str, line: u32) -> Result<u32, InputError> {
        if self.parts.len() >= MOST_PARTS {
            let expected = format!("at most {MOST_PARTS} elements, attributes and items");
            return Err(InputError::new(&self.file, "content", "more elements", expected));
        }
        let name = match self.by_name.get(name) {
            Some(known) => *known,
            None => {
                let number = self.names.len() as u32;
                self.names.push(name.into());
                self.by_name.insert(name.into(), number);
                number
            }
        };
        let index = self.parts.len() as u32;
        self.parts.push(Part {
            name,
            is_attribute: false,
            is_list: false,
            line,
            parent,
            first_child: NONE,
            last_child: NONE,
            next: NONE,
            text: "".into(),
            state: Cell::new(State::Unread),
        });
        if let Some(above) = self.parts.get_mut(parent as usize) {
            let before = std::mem::replace(&mut above.last_child, index);
            match self.parts.get_mut(before as usize) {
                Some(before) => before.next = index,
                None => self.parts[parent as usize].first_child = index,
            }
        }
        Ok(index)
    }

    /// Gives a part its text.
    pub fn set_text(&mut self, part: u32, text: &str) {
        self.parts[part as usize].text = text.into();
    }

    /// Sets whether a part is a list, whose items have no name.
    pub fn set_list(&mut self, part: u32, is_list: bool) {
        self.parts[part as usize].is_list = is_list;
    }

    /// Names of what was added to a part.
    pub fn names_in(&self, part: u32) -> impl Iterator<Item = &str> {
        Node { document: self, index: part }.parts().map(Node::name)
    }

    /// The outermost element, which is asked for.
    pub fn root(&self) -> Node<'_> {
        self.parts[0].state.set(State::Read);
        Node { document: self, index: 0 }
    }

    /// Name of the file in errors.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Looks at all that nobody asked for.
    ///
    /// # Errors
    /// Names that are not among the `harmless` ones, each with its place and the names that would be read
    /// there.
    pub fn finish(&self, harmless: &[Harmless]) -> Result<(), InputError> {
        let mut faults = Vec::new();
        let mut waiting = vec![self.root()];
        while let Some(node) = waiting.pop() {
            for child in node.parts() {
                if child.part().state.get() == State::LeftOut || harmless.iter().any(|it| child.is_harmless(it)) {
                    continue;
                }
                match child.part().state.get() {
                    State::Read => waiting.push(child),
                    _ if faults.len() < MOST_FAULTS => faults.push(Err::<(), _>(child.unread())),
                    _ => {}
                }
            }
        }
        InputError::first_of(faults)
    }

    /// The first part outside of what is harmless of which `said` has something to say.
    pub fn first_used<T>(&self, harmless: Harmless, said: impl Fn(Node<'_>) -> Option<T>) -> Option<(Node<'_>, T)> {
        let mut waiting = vec![self.root()];
        while let Some(node) = waiting.pop() {
            if let Some(it) = said(node) {
                return Some((node, it));
            }
            waiting.extend(node.parts().filter(|it| !it.is_harmless(harmless)));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    #[test]
    fn what_nobody_asks_for_is_told_with_its_place() {
        let text = "<a>\n  <b name=\"one\" x=\"1\" id=\"7\">\n    <c/>\n  </b>\n  <b name=\"two\"/>\n  <note><deep/></note>\n</a>";
        let document = Document::from_xml("a.xml", text, "an a").unwrap();
        let harmless: Harmless = &[("*", "@id note"), ("note", "@*")];
        let first = document.root().child("b").unwrap();
        assert_eq!((first.attribute("name"), first.attribute("y")), (Some("one"), None));
        let faults = document.finish(&[harmless]).unwrap_err().all();
        let said: Vec<String> = faults.iter().map(ToString::to_string).collect();
        assert_eq!(
            said,
            [
                "a.xml: line 5: b two: found <b> once more, expected it once in a",
                "a.xml: line 2: b one.x: found the attribute x=\"1\", which is not read, expected without it; what is read in b: name, y",
                "a.xml: line 3: b one.c: found <c>, which is not read, expected without it; what is read in b: name, y"
            ]
        );
        first.attribute("x").unwrap();
        first.child("c").unwrap();
        document.root().children("b").for_each(|it| assert!(it.has("name")));
        document.finish(&[harmless]).unwrap();
    }

    #[test]
    fn columns_are_a_tree_too() {
        let columns = Document::from_columns("a.csv", 1, &["\"T\"", "w"]).unwrap();
        assert_eq!((columns.column(&["s", "t"]), columns.column(&["s"])), (Some(0), None));
        assert!(columns.finish(&[]).unwrap_err().to_string().contains("line 1: w: found the column `w`"));
        assert!(Document::from_columns("a.csv", 1, &["t", "t"]).is_err());
    }
}
