//! What can be found out about a hand nobody has described: palm, fingers, fingertips, the way it closes, and how to
//! hang it above a plane.
//!
//! Nothing is read from names. The hand is driven without gravity and without contacts, by its own actuators, and what
//! its parts do is measured; so couplings, tendons and closed loops count as they are.

use std::collections::BTreeMap;
use std::sync::Arc;

use eigenhand_hands::xml::{append, element, elements_mut, print, retain_elements};
use eigenhand_hands::xmltree::Element;
use nalgebra::Isometry3;

use crate::SimError;
use crate::ffi::{Model, MuJoCo};

mod arm;
mod fingers;
mod lab;

pub use arm::{Arm, arm};
use fingers::{chains, palm};
use lab::Lab;

/// Name of the body that carries the hand while it is surveyed.
const CARRIAGE: &str = "survey/carriage";
/// Step of its simulation in s.
const TIMESTEP: f64 = 0.004;

/// What the owner of a hand knows better.
#[derive(Clone, Debug, Default)]
pub struct Hints {
    /// Body of the palm.
    pub palm: Option<String>,
    /// Direction in the palm's frame in which the hand approaches an object.
    pub approach: Option<[f64; 3]>,
}

/// A finger of a surveyed hand.
#[derive(Clone, Debug, PartialEq)]
pub struct Finger {
    /// Body that bears the tip.
    pub body: String,
    /// The tip in the body's frame, in m.
    pub tip: [f64; 3],
    /// Length in m from the finger's first joint to its tip when it is straight.
    pub reach: f64,
}

/// Which way an actuator closes the hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Closing {
    /// Towards the upper end of its control range.
    Up,
    /// Towards the lower end of its control range.
    Down,
    /// It does neither: it spreads fingers or turns a wrist.
    Neither,
}

/// What was found out about a hand.
#[derive(Clone, Debug)]
pub struct Survey {
    /// Body of the palm.
    pub palm: String,
    /// The fingers, in the order of the model.
    pub fingers: Vec<Finger>,
    /// Direction of approach in the palm's frame.
    pub approach: [f64; 3],
    /// What each actuator does, in the order of the model.
    pub closing: Vec<(String, Closing)>,
    /// Positions of the joints in the open posture, in rad and m.
    pub open_posture: BTreeMap<String, f64>,
    /// Distance in m between opposing fingertips of the open hand.
    pub opening: f64,
    /// Factor on the objects' lengths.
    pub object_scale: f64,
    /// Pose of the hand's root above the plane: `slide_from_root`.
    pub mount: Isometry3<f64>,
    /// Lowest and highest position of the slide in m.
    pub slide_range: [f64; 2],
    /// Joints that can move, in the order of the model.
    pub moving: Vec<String>,
    /// Joints that never moved.
    pub stuck: Vec<String>,
    /// Bodies above the palm, such as a forearm, that would touch the plane before the palm or a finger does.
    pub in_the_way: Vec<String>,
    /// Pairs of bodies that overlap in the open posture or the initial one.
    pub overlaps: Vec<(String, String)>,
}

/// Surveys the hand whose model is `root`, with the files that it names.
///
/// # Errors
/// [`SimError::Compile`] with MuJoCo's reason, [`SimError::Survey`] where no palm or finger can be made out.
pub fn survey(
    library: &Arc<MuJoCo>,
    root: &Element,
    assets: &[(String, Vec<u8>)],
    hints: &Hints,
) -> Result<Survey, SimError> {
    let model = Arc::new(Model::from_xml(library, &stand(root, "disable"), assets)?);
    let touching = Arc::new(Model::from_xml(library, &stand(root, "enable"), assets)?);
    let palm = palm(&model, hints)?;
    let chains = chains(&model, palm)?;
    let mut lab = Lab::new(&model, palm)?;
    let mut poses = lab.postures(chains)?;
    lab.approach(&poses, hints.approach)?;
    lab.leave_out_guides(&mut poses);
    lab.straighten(&poses);
    lab.check_fingers(&poses)?;
    let closing = lab.closing(&poses)?;
    let open = lab.open(&closing)?;
    lab.report(&poses, closing, open, &touching)
}

/// The hand alone on a heavy carriage, so that nothing of it is welded to the world.
fn stand(root: &Element, contacts: &str) -> String {
    let mut stand = root.clone();
    retain_elements(&mut stand, |e| !matches!(e.name.as_str(), "option" | "size"));
    let flag = element("flag", &[("gravity", "disable".into()), ("contact", contacts.to_owned())]);
    let mut option = element("option", &[("timestep", TIMESTEP.to_string())]);
    append(&mut option, flag);
    append(&mut stand, option);
    append(&mut stand, element("size", &[("nconmax", "1000".into()), ("njmax", "4000".into())]));
    for world in elements_mut(&mut stand).filter(|e| e.name == "worldbody") {
        let mut carriage = element("body", &[("name", CARRIAGE.into())]);
        let inertial = [("pos", "0 0 0"), ("mass", "1000"), ("diaginertia", "10 10 10")];
        append(&mut carriage, element("inertial", &inertial.map(|(key, value)| (key, value.to_owned()))));
        let slide =
            [("name", CARRIAGE), ("type", "slide"), ("axis", "0 0 1"), ("limited", "false"), ("stiffness", "0")];
        append(&mut carriage, element("joint", &slide.map(|(key, value)| (key, value.to_owned()))));
        carriage.children.append(&mut world.children);
        append(world, carriage);
    }
    print(&stand)
}

fn refuse(reason: impl Into<String>) -> SimError {
    SimError::Survey { reason: reason.into() }
}
