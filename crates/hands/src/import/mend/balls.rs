//! Ball joints: each becomes three hinges.

use std::collections::BTreeSet;
use std::path::Path;

use xmltree::{Element, XMLNode};

use crate::error::HandError;
use crate::mjcf::{Defaults, section};
use crate::notes::note;
use crate::xml::{attribute, elements, set};

/// Least damping (N m s) and armature (kg m2) of each hinge: nothing else steadies a rod's turn about itself.
const DAMPING: f64 = 1e-3;
const ARMATURE: f64 = 1e-4;
const AXES: [(&str, &str); 3] = [("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1")];

/// Replaces every ball joint by three hinges without limits, and returns their names. No servo moves them; in a closed
/// loop, the loop does.
///
/// # Errors
/// Names an actuator that acts on a ball joint.
pub(super) fn to_hinges(
    root: &mut Element,
    defaults: &Defaults,
    file: &Path,
    notes: &mut Vec<String>,
) -> Result<Vec<String>, HandError> {
    let mut taken = BTreeSet::new();
    names(root, &mut taken);
    let mut replaced = Replaced { taken, balls: Vec::new(), hinges: Vec::new() };
    for node in &mut root.children {
        if let XMLNode::Element(world) = node
            && world.name == "worldbody"
        {
            replaced.below(world, None, defaults, file)?;
        }
    }
    for actuator in section(root, "actuator") {
        let joint = ["joint", "jointinparent"].iter().find_map(|key| attribute(actuator, key));
        if let Some(joint) = joint.filter(|joint| replaced.balls.iter().any(|ball| ball == joint)) {
            return Err(HandError::model(
                file,
                format!("actuator `{}`", attribute(actuator, "name").unwrap_or_default()),
                "a hinge or a slide to act on",
                format!(
                    "the ball joint `{joint}`; write three hinges in its place, each with an actuator of its own, or \
                     remove the actuator"
                ),
            ));
        }
    }
    note(notes, "ball joints became three hinges without limits, which are no part of the posture", &replaced.balls);
    Ok(replaced.hinges)
}

fn names(element: &Element, found: &mut BTreeSet<String>) {
    found.extend(element.attributes.get("name").cloned());
    elements(element).for_each(|child| names(child, found));
}

struct Replaced {
    taken: BTreeSet<String>,
    balls: Vec<String>,
    hinges: Vec<String>,
}

impl Replaced {
    /// The recursion is as deep as the document, whose depth is bounded.
    fn below(
        &mut self,
        parent: &mut Element,
        childclass: Option<&str>,
        defaults: &Defaults,
        file: &Path,
    ) -> Result<(), HandError> {
        let mut kept = Vec::with_capacity(parent.children.len());
        for node in std::mem::take(&mut parent.children) {
            let XMLNode::Element(mut child) = node else { continue };
            if child.name == "joint" {
                let resolved = defaults.resolve(&child, childclass, file)?;
                if resolved.text("type") == Some("ball") {
                    let own = [resolved.number("damping")?.unwrap_or(0.0), resolved.number("armature")?.unwrap_or(0.0)];
                    kept.extend(self.hinges(&child, own).map(XMLNode::Element));
                    continue;
                }
            }
            if child.name == "body" {
                let own = attribute(&child, "childclass").map(str::to_owned);
                self.below(&mut child, own.as_deref().or(childclass), defaults, file)?;
            }
            kept.push(XMLNode::Element(child));
        }
        parent.children = kept;
        Ok(())
    }

    fn hinges(&mut self, ball: &Element, [damping, armature]: [f64; 2]) -> [Element; 3] {
        let like = attribute(ball, "name").unwrap_or("ball").to_owned();
        let made = AXES.map(|(suffix, axis)| {
            let mut name = format!("{like}_{suffix}");
            while !self.taken.insert(name.clone()) {
                name.push('_');
            }
            let mut hinge = ball.clone();
            // The range of a ball joint is the angle of a cone.
            hinge.attributes.shift_remove("range");
            for (key, value) in [
                ("name", name.clone()),
                ("type", "hinge".to_owned()),
                ("axis", axis.to_owned()),
                ("limited", "false".to_owned()),
                ("damping", damping.max(DAMPING).to_string()),
                ("armature", armature.max(ARMATURE).to_string()),
            ] {
                set(&mut hinge, key, value);
            }
            self.hinges.push(name);
            hinge
        });
        self.balls.push(like);
        made
    }
}
