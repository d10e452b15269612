//! YAML as a document, as far as files of settings go.
//!
//! Anchors, aliases and merged keys are refused. A tag stays in front of its value.

use catch_body::{
    InputError,
    document::{Document, Format, NONE, Node},
};
use saphyr_parser::{Event, Parser, StrInput};

/// Lines of a file at most.
const MOST_LINES: usize = 20_000;
/// Mappings and lists within one another at most.
const DEEPEST: usize = 8;

/// The value of a key that is true or false, in the words of YAML 1.1 or as a number.
///
/// # Errors
/// Any other word.
pub fn boolean(node: Node) -> Result<bool, InputError> {
    match &*node.text().to_ascii_lowercase() {
        "true" | "yes" | "on" | "y" | "1" => Ok(true),
        "false" | "no" | "off" | "n" | "0" => Ok(false),
        _ => Err(node.fault(format!("`{}`", node.text()), "true or false")),
    }
}

/// A part that has keys or says nothing.
///
/// # Errors
/// A list or a single value.
pub fn table(node: Node) -> Result<Node, InputError> {
    let found = match node.is_list() {
        true => "a list".to_owned(),
        false if node.is_null() || node.elements().next().is_some() => return Ok(node),
        false => format!("`{}`", node.text()),
    };
    Err(node.fault(found, "a table of keys and values"))
}

struct Reader<'a> {
    document: Document,
    parser: Parser<'a, StrInput<'a>>,
    /// Lines of the file.
    lines: usize,
}

/// Reads a document of YAML.
///
/// # Errors
/// What is no YAML, a key twice, what is nested too deep, more than one document.
pub fn document(file: &str, text: &str) -> Result<Document, InputError> {
    let mut document = Document::new(file, Format::Keys);
    let root = document.add(NONE, "", 0)?;
    let parser = Parser::new_from_str(text.trim_start_matches('\u{feff}'));
    let mut reader = Reader { document, parser, lines: text.lines().count() };
    if reader.lines > MOST_LINES {
        return Err(reader.fault(MOST_LINES + 1, "one more line", &format!("at most {MOST_LINES}")));
    }
    let mut is_read = false;
    loop {
        match reader.next()? {
            (Event::StreamEnd, _) => return Ok(reader.document),
            (Event::DocumentStart(_), line) if is_read => {
                return Err(reader.fault(line, "one more document", "a single one"));
            }
            (Event::DocumentStart(_), _) => {
                let first = reader.next()?;
                reader.value(root, first, 0)?;
                is_read = true;
            }
            _ => {}
        }
    }
}

impl<'a> Reader<'a> {
    fn fault(&self, line: usize, found: &str, expected: &str) -> InputError {
        // What is missing at the end is missing behind the last line.
        let line = line.min(self.lines);
        InputError::new(self.document.file(), format!("line {line}"), found, expected)
    }

    /// The next event and its line.
    fn next(&mut self) -> Result<(Event<'a>, usize), InputError> {
        match self.parser.next_event() {
            Some(Ok((event, span))) => Ok((event, span.start.line())),
            Some(Err(fault)) => Err(self.fault(fault.marker().line(), fault.info(), "a document of YAML")),
            None => Ok((Event::StreamEnd, 0)),
        }
    }

    /// Reads the value that begins with an event into a part.
    fn value(&mut self, part: u32, (first, line): (Event<'a>, usize), depth: usize) -> Result<(), InputError> {
        if depth > DEEPEST {
            return Err(self.fault(line, "one more table", &format!("tables at most {DEEPEST} deep")));
        }
        match first {
            Event::Scalar(text, _, 0, None) => self.document.set_text(part, &text),
            Event::Scalar(text, _, 0, Some(tag)) => self.document.set_text(part, &format!("{tag} {text}")),
            Event::SequenceStart(0, None) => {
                self.document.set_list(part, true);
                loop {
                    let item = self.next()?;
                    if item.0 == Event::SequenceEnd {
                        break;
                    }
                    let child = self.document.add(part, "", item.1 as u32)?;
                    self.value(child, item, depth + 1)?;
                }
            }
            Event::MappingStart(0, None) => loop {
                let (key, line) = self.next()?;
                if key == Event::MappingEnd {
                    break;
                }
                let child = self.key(part, &key, line)?;
                let value = self.next()?;
                self.value(child, value, depth + 1)?;
            },
            _ => {
                return Err(self.fault(line, "one of them", "values without anchors and aliases, tables without tags"));
            }
        }
        Ok(())
    }

    fn key(&mut self, parent: u32, key: &Event, line: usize) -> Result<u32, InputError> {
        match key {
            Event::Scalar(key, _, 0, None) if key == "<<" => Err(self.fault(line, "`<<`", "keys without merging")),
            Event::Scalar(key, _, 0, None) if self.document.names_in(parent).any(|it| it == key) => {
                Err(self.fault(line, &format!("the key `{key}` twice"), "each key once"))
            }
            Event::Scalar(key, _, 0, None) => self.document.add(parent, key, line as u32),
            _ => Err(self.fault(line, "another key", "names without anchors, aliases and tags")),
        }
    }
}

#[cfg(test)]
mod tests {
    use catch_body::document::Node;

    /// Block and flow notation of the same content are both read.
    #[test]
    fn both_notations_are_read() {
        let block = "a: # first\n  b: 1\n  'c d': \"x # y\"\n  list:\n  - 1\n  - 2.5\ne: null\n";
        let flow = "---\na: {b: 1, 'c d': \"x # y\",\n  list: [1,\n  2.5]}\ne: ~\n";
        let whole = "{a: {b: 1, 'c d': 'x # y', list: [1, 2.5]}, e: }";
        for text in [block, flow, whole] {
            let document = super::document("a.yaml", text).unwrap();
            let a = document.root().child("a").unwrap();
            assert_eq!((a.child("b").unwrap().text(), a.child("c d").unwrap().text()), ("1", "x # y"), "{text}");
            let items: Vec<&str> = a.child("list").unwrap().items().map(Node::text).collect();
            assert_eq!(items, ["1", "2.5"], "{text}");
            assert!(document.root().child("e").unwrap().is_null());
            document.finish(&[]).unwrap();
        }
        let items = "- a: 1\n  b: 2\n-\n  a: 3\n- - 4\n";
        let document = super::document("a.yaml", items).unwrap();
        let places: Vec<String> = document.root().items().map(Node::place).collect();
        assert_eq!(places, ["line 1: [0]", "line 4: [1]", "line 5: [2]"]);
        assert!(super::document("a.yaml", "").unwrap().root().is_null());
    }

    #[test]
    fn faults_name_the_line() {
        for (text, expected) in [
            ("a: 1\nb", "line 2: found simple key expected, expected a document of YAML"),
            ("a:\n  b: 1\n c: 2\n", "line 3"),
            ("a: [1, 2", "line 1: found while parsing a flow sequence, expected ',' or ']'"),
            ("a: 1\na: 2", "line 2: found the key `a` twice"),
            ("a: &x 1", "anchors"),
            ("a:\n\tb: 1", "line 2: found tab"),
            ("a: {b", "line 1"),
            ("a: 1\n---\nb: 2", "line 2: found one more document"),
            ("a: [1] 2", "line 1"),
            ("[[[[[[[[[[1]]]]]]]]]]", "at most 8 deep"),
        ] {
            let fault = super::document("a.yaml", text).map(drop).unwrap_err().to_string();
            assert!(fault.contains(expected), "{text:?}: {fault}");
        }
    }
}
