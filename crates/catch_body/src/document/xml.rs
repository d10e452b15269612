//! XML as a document: elements with their attributes and all of their text, comments left out.

use roxmltree::{Error, Node, ParsingOptions};

use super::{Document, Format, MOST_PARTS, NONE};
use crate::InputError;

/// Attributes of one element at most: a parser compares each with each.
const MOST_ATTRIBUTES: usize = 200;
/// Declarations of name spaces in one file at most: each is handed down to all elements within.
const MOST_NAME_SPACES: usize = 100;
/// Elements within one another at most.
const DEEPEST: usize = 400;
/// Prefixes at most that a file uses without declaring them.
const MOST_UNDECLARED: usize = 20;

impl Document {
    /// A document of XML; `expected` says what it should be. Prefixes that nobody declares are taken as they
    /// stand.
    ///
    /// # Errors
    /// If it is no XML, or has too many attributes or elements.
    pub fn from_xml(file: &str, text: &str, expected: &str) -> Result<Self, InputError> {
        let fault = |found: String| InputError::new(file, "content", found, expected);
        bounded(text).map_err(fault)?;
        let mut text = std::borrow::Cow::Borrowed(text);
        for _ in 0..=MOST_UNDECLARED {
            let options = ParsingOptions { nodes_limit: MOST_PARTS as u32, ..ParsingOptions::default() };
            let prefix = match roxmltree::Document::parse_with_options(&text, options) {
                Ok(parsed) => return Self::from_parsed(file, &parsed),
                Err(Error::UnknownNamespace(prefix, _)) => prefix,
                Err(other) => return Err(fault(other.to_string())),
            };
            let at = end_of_root_name(&text).ok_or_else(|| fault("no element".into()))?;
            text = format!("{} xmlns:{prefix}=\"undeclared:{prefix}\"{}", &text[..at], &text[at..]).into();
        }
        Err(fault(format!("more than {MOST_UNDECLARED} prefixes without a declaration")))
    }

    fn from_parsed(file: &str, parsed: &roxmltree::Document) -> Result<Self, InputError> {
        let mut document = Self::new(file, Format::Xml);
        // Lines are counted as elements come, in the order of the text.
        let source = parsed.input_text();
        let (mut line, mut counted) = (1u32, 0);
        let mut waiting = vec![(parsed.root_element(), NONE, 0)];
        while let Some((node, parent, depth)) = waiting.pop() {
            if depth > DEEPEST {
                let found = format!("elements more than {DEEPEST} deep");
                return Err(InputError::new(file, "content", found, "fewer within one another"));
            }
            let start = node.range().start;
            line += source.as_bytes()[counted..start].iter().filter(|it| **it == b'\n').count() as u32;
            counted = start;
            let index =
                document.add(parent, &prefixed(node.tag_name().name(), node.tag_name().namespace(), node), line)?;
            for attribute in node.attributes() {
                let of = document.add(index, &prefixed(attribute.name(), attribute.namespace(), node), line)?;
                let part = &mut document.parts[of as usize];
                (part.is_attribute, part.text) = (true, attribute.value().into());
            }
            let mut texts = node.children().filter(Node::is_text).filter_map(|it| it.text());
            let first = texts.next().unwrap_or_default();
            let text = texts.fold(first.to_owned(), |all, it| all + " " + it);
            document.parts[index as usize].text = text.trim().into();
            let before = waiting.len();
            waiting.extend(node.children().filter(Node::is_element).map(|it| (it, index, depth + 1)));
            waiting[before..].reverse();
        }
        Ok(document)
    }
}

/// The name of an element or of its attribute, with its prefix where it is in another name space than all
/// around it.
fn prefixed(name: &str, name_space: Option<&str>, node: Node) -> String {
    let prefix = name_space.and_then(|uri| node.lookup_prefix(uri));
    prefix.map_or_else(|| name.to_owned(), |prefix| format!("{prefix}:{name}"))
}

/// Checks that a parser's work with a text grows no faster than its length.
fn bounded(text: &str) -> Result<(), String> {
    if text.matches("xmlns").count() > MOST_NAME_SPACES {
        return Err(format!("more than {MOST_NAME_SPACES} declarations of name spaces"));
    }
    let mut rest = text;
    while let Some(start) = rest.find('<') {
        let tag = &rest[start..];
        let opaque = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")];
        if let Some((_, close)) = opaque.iter().find(|(open, _)| tag.starts_with(open)) {
            rest = tag.find(close).map_or("", |at| &tag[at + close.len()..]);
            continue;
        }
        let (mut quote, mut equals, mut end) = (None, 0, tag.len());
        for (i, byte) in tag.bytes().enumerate() {
            match (quote, byte) {
                (Some(open), _) if byte == open => quote = None,
                (Some(_), _) => {}
                (None, b'"' | b'\'') => quote = Some(byte),
                (None, b'=') => equals += 1,
                (None, b'>') => {
                    end = i + 1;
                    break;
                }
                _ => {}
            }
        }
        if equals > MOST_ATTRIBUTES {
            return Err(format!("an element with more than {MOST_ATTRIBUTES} attributes"));
        }
        rest = &tag[end..];
    }
    Ok(())
}

/// The name of the outermost element of a text of XML, whatever else it and its comments say.
pub fn root_element(text: &str) -> Option<&str> {
    let before = &text[..end_of_root_name(text)?];
    Some(&before[before.rfind('<')? + 1..])
}

/// Position in the text at which attributes of the outermost element may begin.
fn end_of_root_name(text: &str) -> Option<usize> {
    let mut at = 0;
    loop {
        let rest = &text[at..];
        let start = at + rest.find('<')?;
        let tag = &text[start..];
        at = if tag.starts_with("<!--") {
            start + tag.find("-->")? + 3
        } else if tag.starts_with("<?") {
            start + tag.find("?>")? + 2
        } else if tag.starts_with("<!") {
            start + tag.find('>')? + 1
        } else {
            let end = tag.find(|it: char| it.is_whitespace() || it == '>' || it == '/')?;
            return Some(start + end);
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_are_no_text_and_prefixes_need_no_declaration() {
        let text = "<?xml version=\"1.0\"?><!-- <b> --><a><c>1 2<!-- x=\"${y}\" --> 3</c><sensor:d/></a>";
        let document = Document::from_xml("a.xml", text, "an a").unwrap();
        assert_eq!((root_element(text), root_element("<!-- <a> -->")), (Some("a"), None));
        assert_eq!(document.root().child("c").unwrap().text(), "1 2  3");
        assert_eq!(document.root().elements().last().unwrap().name(), "sensor:d");
    }

    #[test]
    fn a_parser_never_has_quadratic_work() {
        let attributes: String = (0..300).map(|i| format!(" a{i}='1'")).collect();
        let spaces: String = (0..300).map(|i| format!("<b xmlns:a{i}='1'>")).collect();
        let hidden = format!("<a>x='<!-- it's --><b{attributes}/></a>");
        let deep = "<a>".repeat(500) + &"</a>".repeat(500);
        for text in [format!("<a{attributes}/>"), spaces, hidden, deep] {
            assert!(Document::from_xml("a.xml", &text, "an a").is_err());
        }
    }
}
