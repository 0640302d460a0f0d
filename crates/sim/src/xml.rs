//! Small helpers over the XML library.

use xmltree::{Element, XMLNode};

/// Makes an element with attributes, in the order given.
pub(crate) fn element(name: &str, attributes: &[(&str, String)]) -> Element {
    let mut made = Element::new(name);
    for (key, value) in attributes {
        made.attributes.insert((*key).to_owned(), value.clone());
    }
    made
}

/// Appends a child element.
pub(crate) fn append(parent: &mut Element, child: Element) {
    parent.children.push(XMLNode::Element(child));
}

/// Lists the child elements.
pub(crate) fn elements(parent: &Element) -> impl Iterator<Item = &Element> {
    parent.children.iter().filter_map(XMLNode::as_element)
}

/// Lists the child elements for changing.
pub(crate) fn elements_mut(parent: &mut Element) -> impl Iterator<Item = &mut Element> {
    parent.children.iter_mut().filter_map(XMLNode::as_mut_element)
}

/// Writes numbers as MJCF wants them: separated by blanks, and exactly.
pub(crate) fn numbers(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}
