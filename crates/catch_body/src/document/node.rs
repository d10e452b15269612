//! Parts of a document, which note what is asked of them.

use std::fmt::Display;

use super::{Document, Format, Harmless, NONE, Part, State};
use crate::{InputError, quantity::Quantity};

/// Names that an error offers.
const MOST_NAMES: usize = 24;

/// A part of a document.
#[derive(Clone, Copy)]
pub struct Node<'d> {
    pub(super) document: &'d Document,
    pub(super) index: u32,
}

impl<'d> Node<'d> {
    pub(super) fn part(self) -> &'d Part {
        &self.document.parts[self.index as usize]
    }

    /// Name of the part; that of an item of a list is empty.
    pub fn name(self) -> &'d str {
        &self.document.names[self.part().name as usize]
    }

    /// Text or value of the part, without white space around it.
    pub fn text(self) -> &'d str {
        self.part().text.trim()
    }

    /// Returns whether the part is a key that says nothing: `null`, `~` or nothing at all.
    pub fn is_null(self) -> bool {
        self.part().first_child == NONE && matches!(self.text(), "" | "~" | "null" | "Null" | "NULL")
    }

    /// All parts within this one, asked for or not.
    pub(super) fn parts(self) -> impl Iterator<Item = Self> {
        let of = move |index: u32| (index != NONE).then_some(Self { document: self.document, index });
        std::iter::successors(of(self.part().first_child), move |it| of(it.part().next))
    }

    /// The elements within this part, none of which is asked for by this.
    pub fn elements(self) -> impl Iterator<Item = Self> {
        self.parts().filter(|it| !it.part().is_attribute)
    }

    /// Marks the part as asked for, and returns it.
    pub fn read(self) -> Self {
        self.part().state.set(State::Read);
        self
    }

    /// Returns whether the reader asked for anything within the part.
    pub fn is_asked(self) -> bool {
        self.parts().any(|it| it.part().state.get() == State::Read)
    }

    /// Marks the part and all within it as not used.
    pub fn leave_out(self) {
        self.part().state.set(State::LeftOut);
    }

    /// The number of its name; items of a list are called like the list.
    pub(super) fn kind(self) -> u32 {
        let mut part = self.part();
        while let Some(above) = self.document.parts.get(part.parent as usize).filter(|it| it.is_list) {
            part = above;
        }
        part.name
    }

    fn above(self) -> Option<Self> {
        (self.part().parent != NONE).then(|| Self { index: self.part().parent, ..self })
    }

    fn ask(self, name: &'static str) {
        self.document.asked.borrow_mut().insert((self.kind(), name));
    }

    fn named(self, name: &'static str, is_attribute: bool) -> impl Iterator<Item = Self> {
        self.ask(name);
        let number = self.document.by_name.get(name).copied();
        self.parts()
            .filter(move |it| Some(it.part().name) == number && it.part().is_attribute == is_attribute)
            .map(Self::read)
    }

    /// The elements of this name.
    pub fn children(self, name: &'static str) -> impl Iterator<Item = Self> {
        self.named(name, false)
    }

    /// The first element of this name, or the value of this key.
    pub fn child(self, name: &'static str) -> Option<Self> {
        self.named(name, false).next()
    }

    /// The element of this name, if there is one.
    ///
    /// # Errors
    /// If there are several.
    pub fn only(self, name: &'static str) -> Result<Option<Self>, InputError> {
        let mut all = self.children(name);
        let (first, second) = (all.next(), all.next());
        if second.is_some() { Err(self.fault_of(name, "the element twice", "it once")) } else { Ok(first) }
    }

    /// The element of this name.
    ///
    /// # Errors
    /// If there is none, or several.
    pub fn required(self, name: &'static str) -> Result<Self, InputError> {
        self.only(name)?.ok_or_else(|| self.fault_of(name, "nothing", format!("an element <{name}>")))
    }

    /// Items of a list.
    pub fn items(self) -> impl Iterator<Item = Self> {
        self.elements().filter(|it| it.name().is_empty()).map(Self::read)
    }

    /// Returns whether the part is a list.
    pub fn is_list(self) -> bool {
        self.part().is_list
    }

    /// The value of an attribute.
    pub fn attribute(self, name: &'static str) -> Option<&'d str> {
        self.named(name, true).next().map(|it| &*it.part().text)
    }

    /// Returns whether there is an attribute of this name, which is asked for by this.
    pub fn has(self, name: &'static str) -> bool {
        self.attribute(name).is_some()
    }

    fn required_attribute(self, name: &'static str) -> Result<Self, InputError> {
        let missing = || self.fault_of(name, "nothing", format!("an attribute {name}=\"…\""));
        self.named(name, true).next().ok_or_else(missing)
    }

    /// The value of an attribute.
    ///
    /// # Errors
    /// If it is missing.
    pub fn text_of(self, name: &'static str) -> Result<&'d str, InputError> {
        self.required_attribute(name).map(|it| &*it.part().text)
    }

    /// The number that an attribute is.
    ///
    /// # Errors
    /// If it is missing, no number, or out of its range.
    pub fn number_of(self, name: &'static str, range: Quantity) -> Result<f64, InputError> {
        self.required_attribute(name)?.number(range)
    }

    /// The three numbers that an attribute is.
    ///
    /// # Errors
    /// As [`number_of`](Self::number_of).
    pub fn vector(self, name: &'static str, range: Quantity) -> Result<[f64; 3], InputError> {
        self.required_attribute(name)?.numbers(range)
    }

    /// This part and all elements within it, none of which is asked for by this.
    pub fn descendants(self) -> impl Iterator<Item = Self> {
        let mut waiting = vec![self];
        std::iter::from_fn(move || {
            let node = waiting.pop()?;
            let first = waiting.len();
            waiting.extend(node.elements());
            waiting[first..].reverse();
            Some(node)
        })
    }

    /// The numbers of the part's text, or of its list.
    ///
    /// # Errors
    /// Another number of them, or one that is none or out of its range.
    pub fn numbers<const N: usize>(self, range: Quantity) -> Result<[f64; N], InputError> {
        let of = |text: &str| text.parse::<f64>().ok().filter(|it| range.contains(*it));
        let numbers: Option<Vec<f64>> = if self.is_list() {
            self.items().map(|it| of(it.text())).collect()
        } else {
            self.text().split_whitespace().map(of).collect()
        };
        let fault = || {
            let expected = if N == 1 { range.to_string() } else { format!("{N} numbers, each {range}") };
            let listed = || format!("[{}]", self.items().map(Self::text).collect::<Vec<_>>().join(", "));
            let found = if self.is_list() { listed() } else { format!("`{}`", self.text()) };
            self.fault(found, expected)
        };
        numbers.and_then(|it| it.try_into().ok()).ok_or_else(fault)
    }

    /// The number that the part's text is.
    ///
    /// # Errors
    /// As [`numbers`](Self::numbers).
    pub fn number(self, range: Quantity) -> Result<f64, InputError> {
        self.numbers(range).map(|[it]| it)
    }

    /// A fault at the part's place.
    pub fn fault(self, found: impl Display, expected: impl Display) -> InputError {
        InputError::new(&self.document.file, self.place(), found, expected)
    }

    /// A fault of an attribute of this part, or of an element within it.
    pub fn fault_of(self, part: &str, found: impl Display, expected: impl Display) -> InputError {
        InputError::new(&self.document.file, format!("{}.{part}", self.place()), found, expected)
    }

    /// Place of the part: its line, if that is known, and its path.
    pub fn place(self) -> String {
        let mut path = String::new();
        let mut at = self;
        while let Some(above) = at.above() {
            let name = match at.name() {
                "" => format!("[{}]", above.parts().take_while(|it| it.index != at.index).count()),
                name => name.to_owned(),
            };
            let called = at.parts().find(|it| it.part().is_attribute && it.name() == "name");
            let called = called.map(|it| format!(" {}", it.part().text)).unwrap_or_default();
            let dot = if path.is_empty() || path.starts_with('[') { "" } else { "." };
            path = format!("{name}{called}{dot}{path}");
            at = above;
        }
        if path.is_empty() {
            path = self.name().to_owned();
        }
        match self.part().line {
            0 => path,
            line => format!("line {line}: {path}"),
        }
    }

    pub(super) fn is_harmless(self, harmless: Harmless) -> bool {
        let above = self.above().map_or("", |it| &self.document.names[it.kind() as usize]);
        let is_this = |name: &str| match name.strip_prefix('@') {
            Some(attribute) => self.part().is_attribute && (attribute == "*" || attribute == self.name()),
            None => !self.part().is_attribute && (name == "*" || name == self.name()),
        };
        harmless.iter().any(|(parent, names)| (*parent == "*" || *parent == above) && names.split(' ').any(is_this))
    }

    /// Fault of a part that nobody asked for: states what would be read in its place.
    pub(super) fn unread(self) -> InputError {
        let Self { document, .. } = self;
        let parent = self.above().map_or(0, Self::kind);
        let asked = document.asked.borrow();
        let names = asked.iter().filter(|(at, _)| *at == parent).map(|(_, name)| *name);
        let names: Vec<&str> = names.take(MOST_NAMES).collect();
        let within = &document.names[parent as usize];
        let found = match (document.format, self.part().is_attribute) {
            (Format::Xml, true) => format!("the attribute {}=\"{}\"", self.name(), self.part().text),
            (Format::Xml, false) => format!("<{}>", self.name()),
            (Format::Columns, _) => format!("the column `{}`", self.name()),
            _ => format!("`{}`", self.name()),
        };
        let what = if names.is_empty() { "nothing".to_owned() } else { names.join(", ") };
        let place = if within.is_empty() { String::new() } else { format!(" in {within}") };
        let is_twice = document.format == Format::Xml && !self.part().is_attribute && names.contains(&self.name());
        if is_twice {
            return self.fault(format!("{found} once more"), format!("it once{place}"));
        }
        self.fault(format!("{found}, which is not read"), format!("without it; what is read{place}: {what}"))
    }
}
