//! Reads the contents of a model: joints, actuators, couplings and the names of bodies and sites.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use eigenhand_posture::{JointInfo, Unit};
use xmltree::Element;

use crate::error::HandError;
use crate::mjcf::{Attributes, Compiler, Defaults, section};
use crate::parts::{HandActuator, HandCoupling, HandJoint, Transmission};
use crate::servo;
use crate::xml::elements;

/// The joints, actuators, couplings and names of a model.
#[derive(Debug)]
pub(crate) struct Contents {
    pub(crate) compiler: Compiler,
    pub(crate) joints: Vec<HandJoint>,
    pub(crate) actuators: Vec<HandActuator>,
    pub(crate) couplings: Vec<HandCoupling>,
    pub(crate) bodies: BTreeSet<String>,
    pub(crate) sites: BTreeSet<String>,
}

/// The joints of a model, in MuJoCo's order; the model may still lack its actuators.
pub(crate) struct Joints(pub(crate) Vec<HandJoint>);

impl Joints {
    /// Reads the joints under `root`; `file` is named in errors.
    pub(crate) fn read(root: &Element, file: &Path) -> Result<Self, HandError> {
        let defaults = Defaults::read(root, file)?;
        let mut reader = Reader { file, defaults: &defaults, contents: Contents::empty(Compiler::read(root, file)?) };
        reader.bodies(root)?;
        Ok(Self(reader.contents.joints))
    }
}

type FixedTendons = BTreeMap<String, Vec<(String, f64)>>;

impl Contents {
    fn empty(compiler: Compiler) -> Self {
        Self {
            compiler,
            joints: Vec::new(),
            actuators: Vec::new(),
            couplings: Vec::new(),
            bodies: BTreeSet::new(),
            sites: BTreeSet::new(),
        }
    }

    /// Reads the model under `root`; `file` is named in errors.
    pub(crate) fn read(root: &Element, file: &Path) -> Result<Self, HandError> {
        let compiler = Compiler::read(root, file)?;
        let defaults = Defaults::read(root, file)?;
        let mut reader = Reader { file, defaults: &defaults, contents: Self::empty(compiler) };
        reader.bodies(root)?;
        if reader.contents.joints.is_empty() {
            return Err(HandError::model(file, "<worldbody>", "at least one joint", "none"));
        }
        let (tendons, other_tendons) = reader.tendons(root)?;
        for element in section(root, "actuator") {
            let actuator = reader.actuator(element, &tendons, &other_tendons)?;
            if reader.contents.actuators.iter().any(|a| a.name == actuator.name) {
                return Err(HandError::model(
                    file,
                    format!("actuator `{}`", actuator.name),
                    "distinct names",
                    "this name twice",
                ));
            }
            reader.contents.actuators.push(actuator);
        }
        if reader.contents.actuators.is_empty() {
            return Err(HandError::model(file, "<actuator>", "at least one actuator", "none"));
        }
        for element in section(root, "equality").filter(|e| e.name == "joint") {
            let coupling = reader.coupling(element)?;
            reader.contents.couplings.extend(coupling);
        }
        Ok(reader.contents)
    }
}

struct Reader<'a> {
    file: &'a Path,
    defaults: &'a Defaults,
    contents: Contents,
}

impl Reader<'_> {
    fn bodies(&mut self, root: &Element) -> Result<(), HandError> {
        elements(root).filter(|e| e.name == "worldbody").try_for_each(|world| self.children(world, "world", None))
    }

    /// Reads the children of a body: its joints and sites first, then its child bodies, as MuJoCo numbers them.
    fn children(&mut self, parent: &Element, body: &str, childclass: Option<&str>) -> Result<(), HandError> {
        for child in elements(parent) {
            match child.name.as_str() {
                "joint" => self.joint(child, body, childclass)?,
                "freejoint" => {
                    return Err(HandError::model(
                        self.file,
                        format!("body `{body}`"),
                        "hinge and slide joints",
                        "a free joint; remove it, the mount carries the hand",
                    ));
                }
                "site" => self.contents.sites.extend(child.attributes.get("name").cloned()),
                _ => {}
            }
        }
        for child in elements(parent).filter(|e| e.name == "body") {
            let name = child.attributes.get("name").cloned().unwrap_or_default();
            let childclass = child.attributes.get("childclass").map(String::as_str).or(childclass);
            self.children(child, &name, childclass)?;
            self.contents.bodies.insert(name);
        }
        Ok(())
    }

    fn joint(&mut self, element: &Element, body: &str, childclass: Option<&str>) -> Result<(), HandError> {
        let attributes = self.defaults.resolve(element, childclass, self.file)?;
        let unit = match attributes.text("type").unwrap_or("hinge") {
            "hinge" => Unit::Radian,
            "slide" => Unit::Metre,
            other => {
                return Err(attributes.error("type", "`hinge` or `slide`", format!("`{other}`")));
            }
        };
        let Some(name) = element.attributes.get("name") else {
            return Err(HandError::model(
                self.file,
                format!("<joint> in body `{body}`"),
                "an attribute `name`",
                "none",
            ));
        };
        if self.contents.joints.iter().any(|joint| joint.info.name == *name) {
            return Err(HandError::model(self.file, attributes.place(), "distinct names", "this name twice"));
        }
        let compiler = &self.contents.compiler;
        let convert = |value: f64| {
            if unit == Unit::Radian { compiler.radians(value) } else { value }
        };
        let range = attributes.limits("range", "limited")?.map(|(low, high)| (convert(low), convert(high)));
        let (lower, upper) = range.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
        let reference = convert(attributes.number("ref")?.unwrap_or(0.0));
        self.contents.joints.push(HandJoint {
            info: JointInfo { name: name.clone(), unit, lower, upper },
            reference,
            body: body.to_owned(),
        });
        Ok(())
    }

    /// Reads the fixed tendons with their terms, and the names of all other tendons.
    fn tendons(&self, root: &Element) -> Result<(FixedTendons, BTreeSet<String>), HandError> {
        let (mut fixed, mut other) = (FixedTendons::new(), BTreeSet::new());
        for tendon in section(root, "tendon") {
            let name = tendon.attributes.get("name").cloned().unwrap_or_default();
            if tendon.name != "fixed" {
                other.insert(name);
                continue;
            }
            let mut terms = Vec::new();
            for term in elements(tendon).filter(|e| e.name == "joint") {
                let joint = self.known_joint(term.attributes.get("joint"), || format!("tendon `{name}` joint"))?;
                let coefficient = Attributes::of(term, self.file).number("coef")?;
                terms.push((joint, coefficient.unwrap_or(1.0)));
            }
            fixed.insert(name, terms);
        }
        Ok((fixed, other))
    }

    fn known_joint(&self, name: Option<&String>, key: impl Fn() -> String) -> Result<String, HandError> {
        let joints = &self.contents.joints;
        match name {
            Some(name) if joints.iter().any(|joint| joint.info.name == *name) => Ok(name.clone()),
            Some(name) => {
                let known = joints.iter().map(|j| j.name.as_str());
                Err(HandError::unresolved(self.file, key(), "a joint of the model", name, known))
            }
            None => Err(HandError::model(self.file, key(), "the name of a joint", "none")),
        }
    }

    fn actuator(
        &self,
        element: &Element,
        tendons: &FixedTendons,
        other_tendons: &BTreeSet<String>,
    ) -> Result<HandActuator, HandError> {
        let attributes = self.defaults.resolve(element, None, self.file)?;
        let Some(name) = element.attributes.get("name").cloned() else {
            return Err(HandError::model(
                self.file,
                format!("<{}> in <actuator>", element.name),
                "an attribute `name`",
                "none",
            ));
        };
        let key = |attribute: &str| format!("actuator `{name}` {attribute}");
        let transmission = if let Some(joint) = attributes.text("joint").or(attributes.text("jointinparent")) {
            Transmission::Joint(self.known_joint(Some(&joint.to_owned()), || key("joint"))?)
        } else if let Some(tendon) = attributes.text("tendon") {
            match tendons.get(tendon) {
                Some(terms) => Transmission::FixedTendon { name: tendon.to_owned(), terms: terms.clone() },
                None if other_tendons.contains(tendon) => Transmission::Other(format!("tendon {tendon}")),
                None => {
                    let known = tendons.keys().chain(other_tendons).map(String::as_str);
                    return Err(HandError::unresolved(
                        self.file,
                        key("tendon"),
                        "a tendon of the model",
                        tendon,
                        known,
                    ));
                }
            }
        } else {
            let found =
                ["site", "body", "cranksite"].into_iter().find_map(|a| attributes.text(a).map(|n| format!("{a} {n}")));
            let missing =
                || HandError::model(self.file, attributes.place(), "a joint, tendon, site or body to act on", "none");
            Transmission::Other(found.ok_or_else(missing)?)
        };
        let gear = attributes.number("gear")?.unwrap_or(1.0);
        let servo = servo::read(&element.name, &attributes)?;
        let written = attributes.limits("ctrlrange", "ctrllimited")?;
        let Some(ctrlrange) = written.or_else(|| servo::reach(&self.contents.joints, &transmission, gear, servo))
        else {
            return Err(attributes.error("ctrlrange", "two numbers with ctrllimited=\"true\"", "none"));
        };
        let forcerange = attributes.limits("forcerange", "forcelimited")?;
        Ok(HandActuator {
            name,
            tag: element.name.clone(),
            transmission,
            gear,
            ctrlrange,
            ctrlrange_computed: written.is_none(),
            forcerange,
            servo,
        })
    }

    fn coupling(&self, element: &Element) -> Result<Option<HandCoupling>, HandError> {
        let name = element.attributes.get("name").or(element.attributes.get("joint1")).cloned().unwrap_or_default();
        let mut general = element.clone();
        general.name = "equality".to_owned();
        if self.defaults.resolve(&general, None, self.file)?.flag("active")? == Some(false) {
            return Ok(None);
        }
        let key = |attribute: &str| format!("equality `{name}` {attribute}");
        let dependent = self.known_joint(element.attributes.get("joint1"), || key("joint1"))?;
        let driver = match element.attributes.get("joint2") {
            Some(name) => Some(self.known_joint(Some(name), || key("joint2"))?),
            None => None,
        };
        let mut polynomial = [0.0, 1.0, 0.0, 0.0, 0.0];
        let written = Attributes::of(element, self.file).numbers("polycoef")?.unwrap_or_default();
        if written.len() > polynomial.len() {
            return Err(HandError::model(self.file, key("polycoef"), "at most five numbers", written.len()));
        }
        polynomial.iter_mut().zip(written).for_each(|(to, from)| *to = from);
        let reference = |name: &str| self.contents.joints.iter().find(|j| j.name == name).map_or(0.0, |j| j.reference);
        Ok(Some(HandCoupling {
            dependent_reference: reference(&dependent),
            driver_reference: driver.as_deref().map_or(0.0, reference),
            dependent,
            driver,
            polynomial,
        }))
    }
}
