//! Small helpers over the XML library, for reading and writing MJCF.

use xmltree::{Element, EmitterConfig, XMLNode};

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

/// Appends a section with these elements, or nothing where there are none. MJCF allows a section to be repeated.
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

/// Lists the child elements for changing.
pub fn elements_mut(parent: &mut Element) -> impl Iterator<Item = &mut Element> {
    parent.children.iter_mut().filter_map(XMLNode::as_mut_element)
}

/// Keeps the child elements that `keep` wants, and nothing that is no element.
pub fn retain_elements(parent: &mut Element, mut keep: impl FnMut(&Element) -> bool) {
    parent.children.retain(|node| node.as_element().is_some_and(&mut keep));
}

/// Writes numbers as MJCF wants them: separated by blanks, and exactly.
pub fn numbers(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

/// Prints a document with indentation and without a declaration.
pub fn print(root: &Element) -> String {
    let mut text = Vec::new();
    let config = EmitterConfig::new().perform_indent(true).write_document_declaration(false);
    // A document in memory can be written; were it not so, the empty text would be refused by whoever reads it.
    match root.write_with_config(&mut text, config) {
        Ok(()) => String::from_utf8_lossy(&text).into_owned(),
        Err(_) => String::new(),
    }
}

/// Returns a file's text without a byte-order mark. Tells whether it was not UTF-8 and so was read as Latin-1.
pub(crate) fn decode(bytes: &[u8]) -> (String, bool) {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match std::str::from_utf8(bytes) {
        Ok(text) => (text.to_owned(), false),
        Err(_) => (bytes.iter().map(|&byte| char::from(byte)).collect(), true),
    }
}

/// Removes the XML declaration and what stands before it, keeping the line numbers of the rest. Tells whether a
/// comment stood there.
///
/// Makers put licences before the declaration, which XML does not allow; and the text is UTF-8 by now, whatever it
/// declares.
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
