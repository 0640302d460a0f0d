//! A hand that was read and checked: its manifest, its model, and the joints, actuators and couplings of the model.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;
use xmltree::Element;

use crate::additions;
use crate::closure;
use crate::error::HandError;
use crate::import;
use crate::manifest::{HandManifest, MANIFEST_FILE, ModelFormat};
use crate::mjcf::Compiler;
use crate::model::Contents;
use crate::resolve;

/// A hand whose files were read and whose names all resolve.
#[derive(Debug, Clone)]
pub struct Hand {
    /// What the hand's owner wrote.
    pub manifest: HandManifest,
    /// The hand's directory.
    pub directory: PathBuf,
    /// Root `<mujoco>` element of the model, its includes expanded.
    pub model: Element,
    /// Settings of the model's `<compiler>`.
    pub compiler: Compiler,
    /// Folder that the model's asset paths are relative to, before `meshdir` and `texturedir`.
    pub model_directory: PathBuf,
    /// Files that the model names and that are held here, by the names it uses; all others lie in the model's directory.
    pub assets: Vec<(String, Vec<u8>)>,
    /// What was changed or assumed while the model was read, one line each.
    pub notes: Vec<String>,
    /// Every file that makes the hand, relative to its directory; a compiled plugin's sidecar and the files it generates.
    /// The meshes that a URDF names are not listed.
    pub files: Vec<PathBuf>,
    /// SHA-256 over the names and contents of [`Self::files`], in hexadecimal; for a URDF, of [`Self::assets`] too, which
    /// its meshes have become.
    pub digest: String,
    /// The model's joints in MuJoCo's order, without the slide.
    pub joints: Vec<HandJoint>,
    /// Joints of the posture in order, with the slide where the posture has it.
    pub posture: Vec<HandJoint>,
    /// The model's actuators in document order, without the slide's.
    pub actuators: Vec<HandActuator>,
    /// Joints that follow another joint.
    pub couplings: Vec<HandCoupling>,
    /// The fingers' tips, in the manifest's order.
    pub fingertips: Vec<Fingertip>,
}

/// Kind of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum JointKind {
    /// Turns about an axis.
    Hinge,
    /// Moves along an axis.
    Slide,
}

impl JointKind {
    /// Returns the unit of the joint's position.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Hinge => "rad",
            Self::Slide => "m",
        }
    }
}

/// A joint with one degree of freedom.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HandJoint {
    /// Name in the model.
    pub name: String,
    /// Kind of motion.
    pub kind: JointKind,
    /// Lowest and highest position (rad or m); none where the joint is not limited.
    pub range: Option<(f64, f64)>,
    /// Unit of the position, `rad` or `m`.
    pub unit: &'static str,
    /// Position in the model's initial configuration (rad or m).
    pub reference: f64,
    /// Body that the joint moves; empty for the slide.
    pub body: String,
}

impl HandJoint {
    /// Returns `value` moved to the nearest position that the joint can take.
    pub fn clamp(&self, value: f64) -> f64 {
        self.range.map_or(value, |(low, high)| value.clamp(low, high))
    }
}

/// What an actuator acts on.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub enum Transmission {
    /// A joint.
    Joint(String),
    /// A fixed tendon: its length is the sum of joint position times coefficient.
    FixedTendon {
        /// The tendon's name.
        name: String,
        /// Joint and coefficient of each term.
        terms: Vec<(String, f64)>,
    },
    /// Anything else, by attribute and name: a spatial tendon, a site, a body.
    Other(String),
}

/// Force law of an actuator that holds a position: `force = gain * ctrl + bias - stiffness * length`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Servo {
    /// Force for one unit of control.
    pub gain: f64,
    /// Force at no control and no length (N or N m).
    pub bias: f64,
    /// Force for one unit of length (N/m or N m/rad).
    pub stiffness: f64,
}

/// An actuator of the model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HandActuator {
    /// Name in the model.
    pub name: String,
    /// Element of the model, such as `position`.
    pub tag: String,
    /// What it acts on.
    pub transmission: Transmission,
    /// Factor from the position of the transmission to the actuator's length.
    pub gear: f64,
    /// Lowest and highest command, in the actuator's own unit.
    pub ctrlrange: (f64, f64),
    /// True where the model gives no control range and it was computed from the joint's.
    pub ctrlrange_computed: bool,
    /// Lowest and highest force (N or N m), where limited.
    pub forcerange: Option<(f64, f64)>,
    /// Its force law where it is a position servo.
    pub servo: Option<Servo>,
}

/// A joint equality of the model: `dependent = polynomial(driver)`, each measured from its reference.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HandCoupling {
    /// The joint that follows.
    pub dependent: String,
    /// The joint that is followed; none where the dependent joint is held in place.
    pub driver: Option<String>,
    /// Coefficients of powers 0 to 4.
    pub polynomial: [f64; 5],
    /// Reference position of the dependent joint.
    pub dependent_reference: f64,
    /// Reference position of the driver.
    pub driver_reference: f64,
}

impl HandCoupling {
    /// Returns the dependent joint's position for a position of its driver.
    pub fn evaluate(&self, driver: f64) -> f64 {
        let x = driver - self.driver_reference;
        self.dependent_reference + self.polynomial.iter().rev().fold(0.0, |sum, a| sum * x + a)
    }
}

/// Kind of frame that a fingertip names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FrameKind {
    /// A body's frame.
    Body,
    /// A site.
    Site,
}

/// Tip of a finger.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Fingertip {
    /// Name in the model.
    pub name: String,
    /// What bears the name; a site where both do.
    pub kind: FrameKind,
}

impl Hand {
    /// Reads and checks the hand in `directory`, which holds a manifest. A compiled plugin is loaded by
    /// [`Registry::get`](crate::Registry::get) alone, which knows where the user allowed libraries.
    ///
    /// # Errors
    /// Names the file, the key and what is expected there: see [`HandError`].
    pub fn load(directory: impl AsRef<Path>) -> Result<Self, HandError> {
        let directory = directory.as_ref();
        let manifest_path = directory.join(MANIFEST_FILE);
        if directory.is_dir() && !manifest_path.is_file() {
            return Err(HandError::NoManifest { path: directory.to_path_buf(), expected: MANIFEST_FILE });
        }
        let text = std::fs::read_to_string(&manifest_path).map_err(HandError::io(&manifest_path))?;
        let manifest = HandManifest::parse(&text, &manifest_path)?;
        let model_path = directory.join(&manifest.model);
        let mut notes = Vec::new();
        let (mut closure, assets) = match manifest.format {
            ModelFormat::Mjcf => (closure::read(directory, &manifest_path, &manifest.model, &mut notes)?, Vec::new()),
            ModelFormat::Urdf => import::read_urdf(directory, &manifest_path, &manifest, &mut notes)?,
        };
        additions::apply(&mut closure.model, &manifest, &manifest_path)?;
        let contents = Contents::read(&closure.model, &model_path)?;
        let fingertips = resolve::frames(&manifest, &contents, &manifest_path)?;
        let posture = resolve::posture(&manifest, &contents, &manifest_path)?;
        resolve::check_open_posture(&manifest, &contents, &manifest_path)?;
        resolve::check_closing(&manifest, &contents, &manifest_path)?;
        Ok(Self {
            directory: directory.to_path_buf(),
            model_directory: model_path.parent().unwrap_or(directory).to_path_buf(),
            compiler: contents.compiler,
            assets,
            notes,
            files: closure.files,
            digest: closure.digest,
            model: closure.model,
            joints: contents.joints,
            posture,
            actuators: contents.actuators,
            couplings: contents.couplings,
            fingertips,
            manifest,
        })
    }

    /// Finds a joint of the model by name.
    pub fn joint(&self, name: &str) -> Option<&HandJoint> {
        self.joints.iter().find(|joint| joint.name == name)
    }

    /// Returns the position of every joint of the model at the start of an episode, by name.
    ///
    /// A joint that the manifest leaves out follows its coupling, else it takes the position nearest to 0.
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

    /// Returns the posture at the start of an episode, in the order of [`Self::posture`].
    pub fn open_posture_vector(&self) -> Vec<f64> {
        let values = self.open_posture();
        self.posture.iter().map(|joint| values.get(&joint.name).copied().unwrap_or(self.manifest.slide.start)).collect()
    }
}
