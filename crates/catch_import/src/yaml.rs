//! YAML as a document, as far as files of settings go: mappings and lists in block and flow notation, quotes,
//! comments, `null`.
//!
//! Anchors, aliases and merged keys are refused. A tag stays in front of its value.

use catch_body::{
    InputError,
    document::{Document, Format, NONE},
};

/// Lines of a file at most.
const MOST_LINES: usize = 20_000;
/// Mappings and lists within one another at most.
const DEEPEST: usize = 8;

/// A line without its comment.
struct Line<'a> {
    number: u32,
    indentation: usize,
    content: &'a str,
}

struct Reader<'a> {
    document: Document,
    lines: Vec<Line<'a>>,
    at: usize,
}

type Outcome = Result<(), InputError>;

/// Reads a document of YAML.
///
/// # Errors
/// Lines that are no part of the notation that is read, a key twice, what is nested too deep.
pub fn document(file: &str, text: &str) -> Result<Document, InputError> {
    let mut document = Document::new(file, Format::Keys);
    let root = document.add(NONE, "", 0)?;
    let mut reader = Reader { document, lines: Vec::new(), at: 0 };
    for (i, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let number = i as u32 + 1;
        if i >= MOST_LINES {
            return Err(reader.fault(number, "one more line", &format!("at most {MOST_LINES}")));
        }
        let content = without_comment(line).trim_end();
        let is_marker = matches!(content, "---" | "...") || content.starts_with('%');
        if content.trim().is_empty() || is_marker {
            continue;
        }
        let indentation = content.len() - content.trim_start_matches(' ').len();
        let content = content.trim_start_matches(' ');
        if content.starts_with('\t') {
            return Err(reader.fault(number, "a tab", "spaces in front of a line"));
        }
        reader.lines.push(Line { number, indentation, content });
    }
    reader.block(root, 0, 0)?;
    match reader.lines.get(reader.at) {
        Some(line) => Err(reader.fault(line.number, &quoted(line.content), "`key: value`, one a line")),
        None => Ok(reader.document),
    }
}

impl<'a> Reader<'a> {
    fn fault(&self, line: u32, found: &str, expected: &str) -> InputError {
        InputError::new(self.document.file(), format!("line {line}"), found, expected)
    }

    /// Reads the lines from here on that are indented by `least` or more, as far as the first of them is.
    fn block(&mut self, parent: u32, least: usize, depth: usize) -> Outcome {
        let Some(first) = self.lines.get(self.at).filter(|it| it.indentation >= least) else { return Ok(()) };
        let (column, number) = (first.indentation, first.number);
        let is_list = is_item(first.content);
        if depth > DEEPEST {
            return Err(self.fault(number, &quoted(first.content), &format!("tables at most {DEEPEST} deep")));
        }
        while let Some(line) = self.lines.get(self.at).filter(|it| it.indentation == column) {
            let (number, content) = (line.number, line.content);
            if is_item(content) != is_list {
                break;
            }
            if is_list {
                self.item(parent, column, depth)?;
                continue;
            }
            if content.starts_with(['{', '[']) && self.document.names_in(parent).next().is_none() {
                self.value(parent, content, number, column, depth)?;
                continue;
            }
            self.entry(parent, column, depth)?;
        }
        match self.lines.get(self.at).filter(|it| it.indentation > column) {
            Some(line) => {
                Err(self.fault(line.number, &quoted(line.content), "a line as far to the left as those above"))
            }
            None => Ok(()),
        }
    }

    fn item(&mut self, parent: u32, column: usize, depth: usize) -> Outcome {
        let line = &mut self.lines[self.at];
        let rest = line.content[1..].trim_start();
        let (number, ahead) = (line.number, line.content.len() - rest.len());
        self.document.set_list(parent, true);
        let item = self.document.add(parent, "", number)?;
        if rest.is_empty() {
            self.at += 1;
            return self.block(item, column + 1, depth + 1);
        }
        if is_item(rest) || key_and_value(rest).is_some() {
            // The rest of the line is the first line of the item's own block.
            (line.indentation, line.content) = (column + ahead, rest);
            return self.block(item, column + 1, depth + 1);
        }
        self.value(item, rest, number, column, depth)
    }

    fn entry(&mut self, parent: u32, column: usize, depth: usize) -> Outcome {
        let line = &self.lines[self.at];
        let (number, content) = (line.number, line.content);
        let Some((key, value)) = key_and_value(content) else {
            return Err(self.fault(number, &quoted(content), "`key: value`, one a line"));
        };
        let key = self.key(parent, key, number)?;
        if !value.is_empty() {
            return self.value(key, value, number, column, depth);
        }
        self.at += 1;
        // A list may stand as far to the left as its key.
        let is_list = self.lines.get(self.at).is_some_and(|it| it.indentation == column && is_item(it.content));
        if is_list { self.block(key, column, depth + 1) } else { self.block(key, column + 1, depth + 1) }
    }

    fn key(&mut self, parent: u32, key: &str, line: u32) -> Result<u32, InputError> {
        let key = unquoted(key.trim());
        if key == "<<" {
            return Err(self.fault(line, "`<<`", "keys without merging"));
        }
        if self.document.names_in(parent).any(|it| it == key) {
            return Err(self.fault(line, &format!("the key {} twice", quoted(&key)), "each key once"));
        }
        self.document.add(parent, &key, line)
    }

    /// Reads what stands behind a key or a dash, and the lines on which it goes on.
    fn value(&mut self, part: u32, first: &'a str, line: u32, column: usize, depth: usize) -> Outcome {
        self.at += 1;
        if first.starts_with(['|', '>']) {
            let mut text = String::new();
            while let Some(more) = self.lines.get(self.at).filter(|it| it.indentation > column) {
                text = text + more.content + "\n";
                self.at += 1;
            }
            self.document.set_text(part, &text);
            return Ok(());
        }
        if first.starts_with(['&', '*']) {
            return Err(self.fault(line, &quoted(first), "values without anchors and aliases"));
        }
        if !first.starts_with(['[', '{']) {
            self.document.set_text(part, &unquoted(first));
            return Ok(());
        }
        let mut text = first.to_owned();
        while !is_complete(&text) {
            let Some(more) = self.lines.get(self.at) else {
                return Err(self.fault(line, &quoted(first), "brackets that are closed"));
            };
            text = text + " " + more.content;
            self.at += 1;
        }
        let mut rest = text.as_str();
        self.flow(part, &mut rest, line, depth + 1)?;
        if rest.trim().is_empty() {
            Ok(())
        } else {
            Err(self.fault(line, &quoted(rest.trim()), "nothing behind the brackets"))
        }
    }

    /// Reads one value in flow notation, and leaves the rest of the text.
    fn flow(&mut self, part: u32, rest: &mut &str, line: u32, depth: usize) -> Outcome {
        if depth > DEEPEST {
            return Err(self.fault(line, &quoted(rest), &format!("tables at most {DEEPEST} deep")));
        }
        *rest = rest.trim_start();
        let close = match rest.chars().next() {
            Some('[') => ']',
            Some('{') => '}',
            _ => {
                let (word, behind) = word(rest);
                self.document.set_text(part, &unquoted(word.trim()));
                *rest = behind;
                return Ok(());
            }
        };
        self.document.set_list(part, close == ']');
        *rest = rest[1..].trim_start();
        while !rest.starts_with(close) {
            let child = if close == ']' {
                self.document.add(part, "", line)?
            } else {
                let (key, behind) = match rest.strip_prefix(['"', '\'']) {
                    Some(_) => word(rest),
                    None => rest.split_at(rest.find([':', ',', '}']).unwrap_or(rest.len())),
                };
                let Some(behind) = behind.trim_start().strip_prefix(':') else {
                    return Err(self.fault(line, &quoted(rest), "`key: value`, with commas between"));
                };
                *rest = behind;
                self.key(part, key, line)?
            };
            self.flow(child, rest, line, depth + 1)?;
            *rest = rest.trim_start();
            match rest.strip_prefix(',') {
                Some(behind) => *rest = behind.trim_start(),
                None if rest.starts_with(close) => {}
                None => return Err(self.fault(line, &quoted(rest), &format!("a comma or `{close}`"))),
            }
        }
        *rest = &rest[1..];
        Ok(())
    }
}

/// A scalar in flow notation, and what stands behind it.
fn word(text: &str) -> (&str, &str) {
    let quote = text.chars().next().filter(|it| matches!(it, '"' | '\''));
    let end = match quote {
        Some(quote) => text[1..].find(quote).map_or(text.len(), |at| at + 2),
        None => text.find([',', ']', '}']).unwrap_or(text.len()),
    };
    text.split_at(end)
}

fn is_item(content: &str) -> bool {
    content == "-" || content.starts_with("- ")
}

/// The key of a line and what stands behind its colon.
fn key_and_value(content: &str) -> Option<(&str, &str)> {
    if content.starts_with(['{', '[', '&', '*', '\t', '?']) {
        return None;
    }
    let from = match content.chars().next().filter(|it| matches!(it, '"' | '\'')) {
        Some(quote) => content[1..].find(quote)? + 2,
        None => 0,
    };
    let colons = content[from..].match_indices(':').map(|(at, _)| from + at);
    let at = colons.into_iter().find(|&at| matches!(content.as_bytes().get(at + 1), None | Some(b' ' | b'\t')))?;
    Some((&content[..at], content[at + 1..].trim()))
}

/// Returns whether all brackets outside of quotes are closed.
fn is_complete(text: &str) -> bool {
    let (mut open, mut quote) = (0i32, None);
    for it in text.chars() {
        match (quote, it) {
            (Some(closing), _) if it == closing => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(it),
            (None, '[' | '{') => open += 1,
            (None, ']' | '}') => open -= 1,
            _ => {}
        }
    }
    open <= 0
}

fn without_comment(line: &str) -> &str {
    let mut quote = None;
    for (at, it) in line.char_indices() {
        let is_first = at == 0 || line[..at].ends_with([' ', '\t', '[', '{', ',', ':']);
        match (quote, it) {
            (Some(closing), _) if it == closing => quote = None,
            (None, '"' | '\'') if is_first => quote = Some(it),
            (None, '#') if at == 0 || line[..at].ends_with([' ', '\t']) => return &line[..at],
            _ => {}
        }
    }
    line
}

fn unquoted(text: &str) -> String {
    let inner = |quote| text.strip_prefix(quote).and_then(|it| it.strip_suffix(quote));
    inner('"').or_else(|| inner('\'')).unwrap_or(text).to_owned()
}

fn quoted(text: &str) -> String {
    format!("`{}`", text.chars().take(60).collect::<String>())
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
        assert_eq!(places, ["line 1: [0]", "line 3: [1]", "line 5: [2]"]);
        assert!(super::document("a.yaml", "").unwrap().root().is_null());
    }

    #[test]
    fn faults_name_the_line() {
        for (text, expected) in [
            ("a: 1\nb", "line 2: found `b`, expected `key: value`"),
            ("a:\n  b: 1\n c: 2\n", "line 3"),
            ("a: [1, 2", "line 1: found `[1, 2`, expected brackets that are closed"),
            ("a: 1\na: 2", "line 2: found the key `a` twice"),
            ("a: &x 1", "anchors"),
            ("a:\n\tb: 1", "line 2: found a tab"),
            ("a: {b}", "line 1"),
            ("a: [1] 2", "line 1: found `2`"),
            ("[[[[[[[[[[1]]]]]]]]]]", "at most 8 deep"),
        ] {
            let fault = super::document("a.yaml", text).map(drop).unwrap_err().to_string();
            assert!(fault.contains(expected), "{text:?}: {fault}");
        }
    }
}
