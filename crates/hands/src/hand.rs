//! A hand after reading and checking: its manifest, its model, and the model's joints, actuators and couplings.

use std::collections::BTreeMap;
use std::path::PathBuf;

use eigenhand_posture::JointInfo;
use xmltree::Element;

use crate::manifest::HandManifest;
use crate::mjcf::Compiler;
use crate::parts::{Fingertip, HandActuator, HandCoupling, HandJoint};

/// A hand after reading: every name in its manifest resolves.
#[derive(Debug, Clone)]
pub struct Hand {
    /// The contents of `hand.toml`.
    pub manifest: HandManifest,
    /// The hand's directory.
    pub directory: PathBuf,
    /// Root `<mujoco>` element of the model, its includes expanded.
    pub model: Element,
    /// Settings of the model's `<compiler>`.
    pub compiler: Compiler,
    /// Folder that the model's asset paths are relative to, before `meshdir` and `texturedir`.
    pub model_directory: PathBuf,
    /// Files of the model that are held in memory, by the names that the model uses; all other files lie in the model's
    /// directory.
    pub assets: Vec<(String, Vec<u8>)>,
    /// Changes and assumptions made while reading the model, one line each.
    pub notes: Vec<String>,
    /// Every file of the hand, relative to its directory. For a compiled plugin: its sidecar and the generated files.
    /// For a URDF: without its meshes.
    pub files: Vec<PathBuf>,
    /// SHA-256 over the names and contents of [`Self::files`], in hexadecimal. For a URDF it also covers
    /// [`Self::assets`], the converted meshes.
    pub digest: String,
    /// The model's joints in MuJoCo's order, without the slide.
    pub joints: Vec<HandJoint>,
    /// Joints of the posture in order, including the slide if it is part of the posture.
    pub posture: Vec<JointInfo>,
    /// The model's actuators in document order, without the slide's.
    pub actuators: Vec<HandActuator>,
    /// Joints that follow another joint.
    pub couplings: Vec<HandCoupling>,
    /// The fingers' tips, in the manifest's order.
    pub fingertips: Vec<Fingertip>,
}

impl Hand {
    /// Finds a joint of the model by name.
    pub fn joint(&self, name: &str) -> Option<&HandJoint> {
        self.joints.iter().find(|joint| joint.name == name)
    }

    /// Returns the position of every joint of the model in the open hand, by name.
    ///
    /// A joint without a value in the manifest follows its coupling; without a coupling it takes the position nearest
    /// to 0.
    ///
    /// # Units
    /// rad for hinges, m for slides.
    pub fn open_posture(&self) -> BTreeMap<String, f64> {
        let written = &self.manifest.open_posture;
        let mut values: BTreeMap<String, f64> = self
            .joints
            .iter()
            .map(|j| (j.name.clone(), written.get(&j.name).copied().unwrap_or_else(|| j.clamp(0.0))))
            .collect();
        // A chain of couplings settles after as many passes as it has links.
        for _ in &self.couplings {
            for coupling in self.couplings.iter().filter(|c| !written.contains_key(&c.dependent)) {
                let driver = coupling
                    .driver
                    .as_ref()
                    .and_then(|name| values.get(name))
                    .copied()
                    .unwrap_or(coupling.driver_reference);
                if let Some(joint) = self.joint(&coupling.dependent) {
                    values.insert(joint.name.clone(), joint.clamp(coupling.evaluate(driver)));
                }
            }
        }
        values
    }

    /// Returns the posture of the open hand with the slide at its start, in the order of [`Self::posture`].
    pub fn open_posture_vector(&self) -> Vec<f64> {
        let values = self.open_posture();
        self.posture.iter().map(|joint| values.get(&joint.name).copied().unwrap_or(self.manifest.slide.start)).collect()
    }
}
