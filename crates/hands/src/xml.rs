//! Small helpers over the XML library, for reading and writing MJCF.

use std::path::Path;

use xmltree::{Element, EmitterConfig, XMLNode};

use crate::error::HandError;

/// Deepest nesting of elements that is read; real hands stay far below.
const MAX_DEPTH: usize = 200;

/// Makes an element with attributes, in the order given.
pub fn element(name: &str, attributes: &[(&str, String)]) -> Element {
    let mut made = Element::new(name);
    for (key, value) in attributes {
        set(&mut made, key, value.clone());
    }
    made
}

/// Sets an attribute.
pub fn set(element: &mut Element, key: &str, value: impl Into<String>) {
    element.attributes.insert(key.to_owned(), value.into());
}

/// The value of an attribute.
pub fn attribute<'a>(element: &'a Element, key: &str) -> Option<&'a str> {
    element.attributes.get(key).map(String::as_str)
}

/// Appends a child element.
pub fn append(parent: &mut Element, child: Element) {
    parent.children.push(XMLNode::Element(child));
}

/// Appends a section with these elements; without elements it appends nothing. MJCF allows a section to be repeated.
pub fn append_section(parent: &mut Element, name: &str, children: impl IntoIterator<Item = Element>) {
    let mut section = Element::new(name);
    section.children = children.into_iter().map(XMLNode::Element).collect();
    if !section.children.is_empty() {
        append(parent, section);
    }
}

/// Lists the child elements.
pub fn elements(parent: &Element) -> impl Iterator<Item = &Element> {
    parent.children.iter().filter_map(XMLNode::as_element)
}

/// Lists the child elements mutably.
pub fn elements_mut(parent: &mut Element) -> impl Iterator<Item = &mut Element> {
    parent.children.iter_mut().filter_map(XMLNode::as_mut_element)
}

/// Keeps the child elements for which `keep` is true; text and comments go.
pub fn retain_elements(parent: &mut Element, mut keep: impl FnMut(&Element) -> bool) {
    parent.children.retain(|node| node.as_element().is_some_and(&mut keep));
}

/// Writes numbers exactly, separated by blanks, as in MJCF.
pub fn numbers(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

/// Prints a document with indentation and without a declaration.
pub fn print(root: &Element) -> String {
    let mut text = Vec::new();
    let config = EmitterConfig::new().perform_indent(true).write_document_declaration(false);
    // Writing to memory does not fail; if it did, the reader of the empty text would report it.
    match root.write_with_config(&mut text, config) {
        Ok(()) => String::from_utf8_lossy(&text).into_owned(),
        Err(_) => String::new(),
    }
}

/// Returns a file's text without a byte-order mark, and true if it was not UTF-8 and was read as Latin-1.
pub(crate) fn decode(bytes: &[u8]) -> (String, bool) {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match std::str::from_utf8(bytes) {
        Ok(text) => (text.to_owned(), false),
        Err(_) => (bytes.iter().map(|&byte| char::from(byte)).collect(), true),
    }
}

/// Removes the XML declaration and everything before it; line numbers of the rest stay. Returns the text, and true if a
/// comment was removed.
///
/// Some makers put a licence before the declaration, which XML forbids. The declared encoding no longer matters,
/// because the text is UTF-8 by now.
pub(crate) fn without_declaration(text: &str) -> (String, bool) {
    let mut at = 0;
    let mut comment = false;
    loop {
        let rest = &text[at..];
        let trimmed = rest.trim_start();
        at += rest.len() - trimmed.len();
        if !trimmed.starts_with("<!--") {
            break;
        }
        let Some(end) = trimmed.find("-->") else { return (text.to_owned(), false) };
        comment = true;
        at += end + "-->".len();
    }
    let declaration = &text[at..];
    if !declaration.starts_with("<?xml") {
        return (text.to_owned(), false);
    }
    let Some(end) = declaration.find("?>") else { return (text.to_owned(), false) };
    let end = at + end + "?>".len();
    let lines = text[..end].matches('\n').count();
    (format!("{}{}", "\n".repeat(lines), &text[end..]), comment)
}

/// Parses XML of bounded depth; `file` is named in errors.
pub(crate) fn parse(text: &str, file: &Path) -> Result<Element, HandError> {
    // The XML reader breaks long reasons into several lines.
    let xml_error = |message: String| HandError::Xml {
        file: file.to_path_buf(),
        message: message.split_whitespace().collect::<Vec<_>>().join(" "),
    };
    let text = &without_declaration(text).0;
    check_depth(text).map_err(xml_error)?;
    let nodes = Element::parse_all(text.as_bytes()).map_err(|e| xml_error(e.to_string()))?;
    nodes
        .into_iter()
        .find_map(|node| match node {
            XMLNode::Element(element) => Some(element),
            _ => None,
        })
        .ok_or_else(|| xml_error("no root element".to_owned()))
}

/// Finds the first element of a document, after any comments and declarations: the position of its name, and the name.
pub(crate) fn first_tag(text: &str) -> Option<(usize, &str)> {
    let mut rest = text;
    loop {
        rest = &rest[rest.find('<')?..];
        let end = if rest.starts_with("<!--") {
            rest.find("-->")? + 3
        } else if rest.starts_with("<?") || rest.starts_with("<!") {
            rest.find('>')? + 1
        } else {
            let name = rest[1..].split(|c: char| c.is_whitespace() || c == '>' || c == '/').next()?;
            return Some((text.len() - rest.len() + 1, name));
        };
        rest = &rest[end..];
    }
}

/// Refuses nesting so deep that it would exhaust the stack of the recursive parser.
fn check_depth(text: &str) -> Result<(), String> {
    let mut depth = 0_usize;
    let mut rest = text;
    while let Some(start) = rest.find('<') {
        rest = &rest[start..];
        let end = if rest.starts_with("<!--") {
            rest.find("-->").map(|i| i + 3)
        } else if rest.starts_with("<![CDATA[") {
            rest.find("]]>").map(|i| i + 3)
        } else if rest.starts_with("<?") {
            rest.find("?>").map(|i| i + 2)
        } else if rest.starts_with("<!") {
            return Err("a document type declaration; remove it".to_owned());
        } else {
            let end = tag_end(rest);
            if rest.starts_with("</") {
                depth = depth.saturating_sub(1);
            } else if end.is_some_and(|i| !rest[..i].ends_with("/>")) {
                depth += 1;
            }
            end
        };
        if depth > MAX_DEPTH {
            return Err(format!("elements nested deeper than {MAX_DEPTH}"));
        }
        match end {
            Some(end) => rest = &rest[end..],
            None => return Ok(()),
        }
    }
    Ok(())
}

/// Returns the length of the tag at the start of `text`; a `>` inside quotes does not end it.
fn tag_end(text: &str) -> Option<usize> {
    let mut quote = None;
    for (i, c) in text.char_indices() {
        match (quote, c) {
            (None, '"' | '\'') => quote = Some(c),
            (Some(open), _) if open == c => quote = None,
            (None, '>') => return Some(i + 1),
            _ => {}
        }
    }
    None
}
