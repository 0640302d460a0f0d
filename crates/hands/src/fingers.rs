//! Which joints belong to which finger.

use xmltree::Element;

use crate::hand::Hand;
use crate::mjcf::section;
use crate::parts::FrameKind;
use crate::xml::{attribute, elements};

impl Hand {
    /// Lists for each fingertip the joints that move it and no other fingertip, from the palm outwards.
    pub fn finger_joints(&self) -> Vec<Vec<String>> {
        let ways: Vec<Vec<String>> = self
            .fingertips
            .iter()
            .map(|tip| {
                let kind = if tip.kind == FrameKind::Site { "site" } else { "body" };
                let found = section(&self.model, "worldbody").find_map(|element| joints_to(element, kind, &tip.name));
                found.unwrap_or_default()
            })
            .collect();
        let shared = |joint: &String| ways.iter().filter(|way| way.contains(joint)).count() > 1;
        ways.iter().map(|way| way.iter().filter(|joint| !shared(joint)).cloned().collect()).collect()
    }
}

/// Returns the joints of the bodies from `element` to the body or site `name`; none if it is not below. The recursion is as
/// deep as the tree, whose depth the reader bounds.
fn joints_to(element: &Element, kind: &str, name: &str) -> Option<Vec<String>> {
    let is_it = |e: &Element| e.name == kind && attribute(e, "name") == Some(name);
    if element.name != "body" {
        return is_it(element).then(Vec::new);
    }
    let below = if is_it(element) || elements(element).any(is_it) {
        Vec::new()
    } else {
        elements(element).find_map(|child| joints_to(child, kind, name))?
    };
    let own = elements(element).filter(|e| e.name == "joint").filter_map(|e| attribute(e, "name").map(str::to_owned));
    Some(own.chain(below).collect())
}
