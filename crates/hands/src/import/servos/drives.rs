//! The servos of a model and the joints that they move.

use std::collections::BTreeMap;
use std::path::Path;

use eigenhand_posture::Unit;
use xmltree::Element;

use crate::error::HandError;
use crate::mjcf::{Attributes, Defaults, section};
use crate::model::Joints;
use crate::servo;
use crate::xml::elements;

/// Action of a servo on a joint.
#[derive(Debug, Clone)]
pub(super) struct Pull {
    pub(super) joint: String,
    pub(super) unit: Unit,
    /// Limits of the joint (rad, m).
    pub(super) range: Option<(f64, f64)>,
    /// Torque or force on the joint for each unit of the servo's force.
    pub(super) lever: f64,
}

/// A position servo.
#[derive(Debug)]
pub(super) struct Drive {
    pub(super) name: String,
    /// Force for each unit of length, and for each unit of velocity.
    pub(super) stiffness: f64,
    pub(super) feedback: f64,
    /// Lowest and highest force.
    pub(super) limit: Option<(f64, f64)>,
    /// The joints that it moves; none if it acts on a spatial tendon or a site.
    pub(super) pulls: Vec<Pull>,
}

impl Drive {
    /// Returns the joint on which the servo acts most strongly.
    pub(super) fn strongest(&self) -> Option<&Pull> {
        self.pulls.iter().max_by(|a, b| a.lever.abs().total_cmp(&b.lever.abs()))
    }
}

/// Lists the actuators in the order of the file; none for one that is no servo.
pub(super) fn drives(root: &Element, file: &Path) -> Result<Vec<Option<Drive>>, HandError> {
    let defaults = Defaults::read(root, file)?;
    let joints = Joints::read(root, file)?.0;
    let mut tendons: BTreeMap<&str, Vec<(&str, f64)>> = BTreeMap::new();
    for tendon in section(root, "tendon").filter(|tendon| tendon.name == "fixed") {
        let Some(name) = tendon.attributes.get("name") else { continue };
        let terms = tendons.entry(name).or_default();
        for term in elements(tendon).filter(|term| term.name == "joint") {
            let coefficient = Attributes::of(term, file).number("coef")?.unwrap_or(1.0);
            terms.extend(term.attributes.get("joint").map(|joint| (joint.as_str(), coefficient)));
        }
    }
    let pull = |name: &str, lever: f64| {
        let joint = joints.iter().find(|joint| joint.name == name)?;
        let pull = Pull { joint: name.to_owned(), unit: joint.unit, range: joint.range(), lever };
        (lever != 0.0).then_some(pull)
    };
    let mut found = Vec::new();
    for actuator in section(root, "actuator") {
        let resolved = defaults.resolve(actuator, None, file)?;
        let Some(servo) = servo::read(&actuator.name, &resolved)?.filter(|servo| servo.stiffness > 0.0) else {
            found.push(None);
            continue;
        };
        let feedback = match actuator.name.as_str() {
            "general" => -resolved.numbers("biasprm")?.unwrap_or_default().get(2).copied().unwrap_or(0.0),
            _ => 0.0,
        };
        let gear = resolved.number("gear")?.unwrap_or(1.0);
        let joint = resolved.text("joint").or(resolved.text("jointinparent"));
        let tendon = resolved.text("tendon").and_then(|name| tendons.get(name));
        let pulls = match (joint, tendon) {
            (Some(name), _) => pull(name, gear).into_iter().collect(),
            (None, Some(terms)) => terms.iter().filter_map(|(name, c)| pull(name, gear * c)).collect(),
            (None, None) => Vec::new(),
        };
        found.push(Some(Drive {
            name: actuator.attributes.get("name").cloned().unwrap_or_default(),
            stiffness: servo.stiffness,
            feedback,
            limit: resolved.limits("forcerange", "forcelimited")?,
            pulls,
        }));
    }
    Ok(found)
}
