//! The grasp task: everything that all episodes share (hand, objects, goals, layout of the observation).

use std::sync::Arc;

use eigenhand_hands::{Fingertip, FrameKind, Hand, JointInfo, Unit};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use serde::Serialize;

use crate::SimError;
use crate::inertia_box::InertiaBox;
use crate::objects::Object;
use crate::physics::PhysicsConfig;
use crate::reward::RewardConfig;
use crate::scene::{MOUNT, OBJECT_GEOM, OBJECT_JOINT, PLANE, Scene, resting_scene};
use crate::self_contacts::SelfContacts;
use crate::setting::{Factors, Setting, TaskConfig, middle};
use eigenhand_mujoco::{BodyId, Data, GeomId, Model, MuJoCo, MuJoCoError, SiteId};

/// One entry of the observation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ObservationEntry {
    /// Name, such as `qpos:slide`.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
}

/// Indices and ids of the quantities in a scene's model that the task reads and writes.
pub(crate) struct Addresses {
    pub posture_qpos: Vec<usize>,
    pub posture_dof: Vec<usize>,
    pub object_qpos: usize,
    pub object_dof: usize,
    pub plane: GeomId,
    pub object: GeomId,
    pub is_hand: Vec<bool>,
    pub slide_qpos: usize,
    pub slide_ctrl: usize,
    pub tips: Vec<Frame>,
    /// `qpos` of the whole scene with the hand open and the slide at its start.
    pub start_qpos: Vec<f64>,
}

/// A frame of the hand whose place is read.
#[derive(Clone, Copy)]
pub(crate) enum Frame {
    Body(BodyId),
    Site(SiteId),
}

impl Frame {
    fn of(model: &Model, tip: &Fingertip) -> Result<Frame, MuJoCoError> {
        Ok(match tip.kind {
            FrameKind::Body => Frame::Body(model.body(&tip.name)?),
            FrameKind::Site => Frame::Site(model.site(&tip.name)?),
        })
    }

    /// Returns the frame's place in m.
    pub fn position(self, data: &Data) -> Vector3<f64> {
        match self {
            Frame::Body(id) => data.body_position(id),
            Frame::Site(id) => data.site_position(id),
        }
    }
}

/// One object's compiled scene.
pub struct ObjectScene {
    /// The object; its size is in the middle of `task.object_scale`.
    pub object: Object,
    /// The scene as it can be written to a file.
    pub scene: Scene,
    /// The compiled model.
    pub model: Arc<Model>,
    pub(crate) addresses: Addresses,
    /// The object alone on the plane.
    resting: Arc<Model>,
    inertia_box: InertiaBox,
}

/// The grasp task of one hand, shared by all environments.
pub struct GraspTask {
    /// Settings of an episode.
    pub config: TaskConfig,
    /// Settings of the simulation.
    pub physics: PhysicsConfig,
    /// Settings of success.
    pub reward: RewardConfig,
    /// Factors on the compiled scenes, which environments apply; [`Factors::NONE`] in a new task.
    pub factors: Factors,
    /// What lets the links of the hand collide with one another, with `physics.self_collision`.
    pub self_contacts: Option<SelfContacts>,
    /// One scene for each object, in the setting's order.
    pub scenes: Vec<ObjectScene>,
    /// The posture's joints, in order.
    pub posture_joints: Vec<JointInfo>,
    /// Names of the fingertips, in order.
    pub fingertips: Vec<String>,
    /// Names of the actuators, in the order of the action.
    pub actuators: Vec<String>,
    /// Control range of every actuator, in the order of the action.
    pub control_ranges: Vec<(f64, f64)>,
    /// Controls that hold the hand open at the slide's start.
    pub(crate) start_ctrl: Vec<f64>,
    /// Controls that hold the hand closed at the slide's start: the ends of the ranges of the actuators that close it.
    pub(crate) closed_ctrl: Vec<f64>,
    pub(crate) slide_top: f64,
}

/// Distance in m by which the object is moved aside where it would be in the way.
pub(crate) const AWAY: f64 = 0.8;

/// Numbers that describe the object in an observation: pose 7, velocity 6.
const OBJECT_ENTRIES: [(&str, &str); 13] = [
    ("object:x", "m"),
    ("object:y", "m"),
    ("object:z", "m"),
    ("object:qw", "1"),
    ("object:qx", "1"),
    ("object:qy", "1"),
    ("object:qz", "1"),
    ("object:vx", "m/s"),
    ("object:vy", "m/s"),
    ("object:vz", "m/s"),
    ("object:wx", "rad/s"),
    ("object:wy", "rad/s"),
    ("object:wz", "rad/s"),
];

/// Entry of the object's number. It follows the others if `task.observe_id` is set.
const ID_ENTRY: &str = "object:id";

/// Entries of the object's shape. They come last if `task.observe_shape` is set.
const SHAPE_ENTRIES: [&str; 6] =
    ["object:shape_xx", "object:shape_yy", "object:shape_zz", "object:shape_xy", "object:shape_xz", "object:shape_yz"];

/// Whether an entry of the observation is the same in every episode with one object.
pub(crate) fn tells_objects_apart(entry: &str) -> bool {
    entry == ID_ENTRY || SHAPE_ENTRIES.contains(&entry)
}

impl GraspTask {
    /// Number of values of a goal: the object's position.
    pub const GOAL_LEN: usize = 3;

    /// Compiles the scenes of `hand` with each object of the setting.
    ///
    /// # Errors
    /// Settings out of range, an unknown object, a model that MuJoCo refuses, a hand whose actuators
    /// have no control range.
    pub fn new(library: &Arc<MuJoCo>, hand: &Hand, setting: &Setting) -> Result<GraspTask, SimError> {
        let Setting { objects, task: config, physics, reward } = setting.clone();
        config.validate()?;
        physics.validate()?;
        reward.validate()?;
        let scale = hand.manifest.objects.scale * middle(config.object_scale);
        let objects = Object::read_all(&objects, scale)?;
        let first = objects.first().ok_or(SimError::Setting {
            name: "objects",
            expected: "at least one object",
            got: "none".to_owned(),
        })?;
        let compile = |object: &Object, mass, contacts: Option<&SelfContacts>| -> Result<(Scene, Model), SimError> {
            let scene = Scene::compose(hand, object, &physics, mass, contacts)?;
            let model = Model::from_xml(library, &scene.xml, &scene.assets)?;
            Ok((scene, model))
        };
        let (_, weighed) = compile(first, 0.0, None)?;
        let mass = weighed.subtree_mass(weighed.body(MOUNT)?);
        let find = || {
            let compose = |contacts: &SelfContacts| Scene::compose(hand, first, &physics, mass, Some(contacts));
            SelfContacts::find(library, hand, &weighed, compose)
        };
        let self_contacts = physics.self_collision.then(find).transpose()?;
        let scenes: Vec<ObjectScene> = objects
            .iter()
            .map(|object| {
                let (scene, model) = compile(object, mass, self_contacts.as_ref())?;
                let addresses = Addresses::resolve(&model, hand)?;
                let inertia_box = InertiaBox::of(&model, model.geom_body(addresses.object));
                let resting = resting_scene(object, &physics);
                let resting = Arc::new(Model::from_xml(library, &resting.xml, &resting.assets)?);
                Ok(ObjectScene {
                    object: object.clone(),
                    scene,
                    model: Arc::new(model),
                    addresses,
                    resting,
                    inertia_box,
                })
            })
            .collect::<Result<_, SimError>>()?;

        let model = &scenes[0].model;
        let actuators: Vec<String> = model.actuators().map(|id| model.actuator_name(id)).collect();
        let control_ranges = model
            .actuators()
            .map(|id| {
                model.control_range(id).ok_or_else(|| SimError::Hand {
                    hand: hand.manifest.name.clone(),
                    reason: format!(
                        "actuator {:?} has no control range: give it ctrllimited=\"true\" and a ctrlrange",
                        model.actuator_name(id)
                    ),
                })
            })
            .collect::<Result<Vec<_>, _>>()?;
        let start_ctrl = start_controls(hand, actuators.len())?;
        let closed = |((name, &start), &(low, high)): ((&String, &f64), &(f64, f64))| {
            hand.manifest.closing.get(name).map_or(start, |&sign| if sign > 0.0 { high } else { low })
        };
        let closed_ctrl = actuators.iter().zip(&start_ctrl).zip(&control_ranges).map(closed).collect();
        Ok(GraspTask {
            config,
            physics,
            reward,
            factors: Factors::NONE,
            posture_joints: hand.posture.clone(),
            fingertips: hand.fingertips.iter().map(|tip| tip.name.clone()).collect(),
            actuators,
            control_ranges,
            start_ctrl,
            closed_ctrl,
            slide_top: hand.manifest.slide.range[1],
            self_contacts,
            scenes,
        })
    }

    /// Gives every object the number of the one among `known` whose size is most similar; an object of the same name
    /// comes first. So a policy that was trained with `known` observes only numbers that it has seen.
    ///
    /// Two sizes are compared by the half sizes, in order, of the boxes with the objects' mass and inertia.
    pub fn take_ids_from(&mut self, known: &GraspTask) {
        let sizes = |scene: &ObjectScene| {
            let mut half = scene.inertia_box.half_sizes;
            half.as_mut_slice().sort_by(f64::total_cmp);
            half
        };
        for scene in &mut self.scenes {
            let own = sizes(scene);
            let same = |other: &&ObjectScene| other.object.name == scene.object.name;
            let distance = |other: &&ObjectScene| (sizes(other) - own).norm();
            let nearest = known.scenes.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            if let Some(other) = known.scenes.iter().find(same).or(nearest) {
                scene.object.id = other.object.id;
            }
        }
    }

    /// Tells whether size or friction of the object differs from episode to episode.
    pub fn varies(&self) -> bool {
        [self.config.object_scale, self.physics.friction].iter().any(|[low, high]| low < high)
    }

    /// Returns the number of values of an observation.
    pub fn observation_len(&self) -> usize {
        let shape = if self.config.observe_shape { SHAPE_ENTRIES.len() } else { 0 };
        let id = usize::from(self.config.observe_id);
        let tips = if self.config.observe_fingertips { 3 * self.fingertips.len() } else { 0 };
        2 * self.posture_joints.len() + OBJECT_ENTRIES.len() + tips + id + shape
    }

    /// Returns the number of values of an action.
    pub fn action_len(&self) -> usize {
        self.actuators.len()
    }

    /// Describes every entry of the observation, in order (paper, section 3.1, and the object's shape).
    pub fn observation_layout(&self) -> Vec<ObservationEntry> {
        let joints = |prefix: &'static str, per_second: bool| {
            self.posture_joints.iter().map(move |joint| ObservationEntry {
                name: format!("{prefix}:{}", joint.name),
                unit: match (joint.unit, per_second) {
                    (Unit::Metre, true) => "m/s",
                    (Unit::Radian, true) => "rad/s",
                    (unit, false) => unit.symbol(),
                },
            })
        };
        let object = OBJECT_ENTRIES.map(|(name, unit)| ObservationEntry { name: name.to_owned(), unit });
        let tips = self.fingertips.iter().filter(|_| self.config.observe_fingertips).flat_map(|tip| {
            ["x", "y", "z"].map(|axis| ObservationEntry { name: format!("fingertip:{tip}:{axis}"), unit: "m" })
        });
        let id = self.config.observe_id.then(|| ObservationEntry { name: ID_ENTRY.to_owned(), unit: "1" });
        let shape = SHAPE_ENTRIES.iter().filter(|_| self.config.observe_shape);
        let shape = shape.map(|&name| ObservationEntry { name: name.to_owned(), unit: "m" });
        joints("qpos", false).chain(joints("qvel", true)).chain(object).chain(tips).chain(id).chain(shape).collect()
    }

    /// Returns the index of the slide's actuator in an action.
    pub fn slide_action(&self) -> usize {
        self.scenes.first().map_or(0, |scene| scene.addresses.slide_ctrl)
    }

    /// Returns the controls of the open hand at the slide's start.
    pub fn start_controls(&self) -> &[f64] {
        &self.start_ctrl
    }

    /// Returns the controls of the closed hand at the slide's start.
    pub fn closed_controls(&self) -> &[f64] {
        &self.closed_ctrl
    }

    /// Tells whether the hand has actuators that close it.
    pub(crate) fn closes(&self) -> bool {
        self.closed_ctrl != self.start_ctrl
    }

    /// (share by which the hand is closed) => the controls at the start of an episode
    pub(crate) fn controls_of_start(&self, share: f64) -> impl Iterator<Item = f64> {
        self.start_ctrl.iter().zip(&self.closed_ctrl).map(move |(open, closed)| open + share * (closed - open))
    }

    /// Returns the action of these controls.
    pub fn start_action(&self) -> Vec<f32> {
        self.action_of(&self.start_ctrl)
    }

    /// (controls) => the action that gives them; 0 for an actuator whose range is a single value
    pub fn action_of(&self, controls: &[f64]) -> Vec<f32> {
        let action = |(&ctrl, &(low, high)): (&f64, &(f64, f64))| {
            if high > low { (2.0 * (ctrl - low) / (high - low) - 1.0) as f32 } else { 0.0 }
        };
        controls.iter().zip(&self.control_ranges).map(action).collect()
    }

    /// Returns a simulation of the open hand in a scene, with the slide at its top and the object out of the way.
    ///
    /// # Errors
    /// [`MuJoCoError::OutOfMemory`](eigenhand_mujoco::MuJoCoError::OutOfMemory).
    pub fn open_hand(&self, scene: &ObjectScene) -> Result<Data, SimError> {
        let at = &scene.addresses;
        let mut data = scene.data()?;
        data.qpos_mut().copy_from_slice(&at.start_qpos);
        data.qpos_mut()[at.slide_qpos] = self.slide_top;
        data.qpos_mut()[at.object_qpos] += AWAY;
        data.ctrl_mut().copy_from_slice(&self.start_ctrl);
        data.ctrl_mut()[at.slide_ctrl] = self.slide_top;
        data.forward();
        Ok(data)
    }

    /// Returns the same simulation with the hand in a posture. The posture's value for the slide is ignored.
    ///
    /// # Shapes
    /// `posture`: one number for each of [`posture_joints`](Self::posture_joints), in rad and m.
    ///
    /// # Errors
    /// As [`open_hand`](Self::open_hand).
    pub fn posed_hand(&self, scene: &ObjectScene, posture: &[f64]) -> Result<Data, SimError> {
        let at = &scene.addresses;
        let mut data = self.open_hand(scene)?;
        for (&address, &value) in at.posture_qpos.iter().zip(posture).filter(|(address, _)| **address != at.slide_qpos)
        {
            data.qpos_mut()[address] = value;
        }
        data.forward();
        Ok(data)
    }

    /// (action in [-1, 1]) => controls, each scaled to its actuator's range.
    pub fn scale_action(&self, action: &[f32], ctrl: &mut [f64]) {
        for ((ctrl, &action), &(low, high)) in ctrl.iter_mut().zip(action).zip(&self.control_ranges) {
            let unit = (f64::from(action).clamp(-1.0, 1.0) + 1.0) / 2.0;
            *ctrl = low + unit * (high - low);
        }
    }
}

/// Controls of the open posture, the slide's first, in the order of the scene's actuators.
fn start_controls(hand: &Hand, n_actuators: usize) -> Result<Vec<f64>, SimError> {
    let actuation = hand.actuation();
    if actuation.actuators.len() != n_actuators {
        return Err(SimError::Hand {
            hand: hand.manifest.name.clone(),
            reason: format!(
                "the compiled model has {} actuators, but the hand's file lists {}",
                n_actuators,
                actuation.actuators.len()
            ),
        });
    }
    Ok(actuation.control(&hand.open_posture_vector()))
}

impl Addresses {
    pub(crate) fn resolve(model: &Model, hand: &Hand) -> Result<Addresses, SimError> {
        let joints = &hand.posture;
        let ids = joints.iter().map(|joint| model.joint(&joint.name)).collect::<Result<Vec<_>, _>>()?;
        let object = model.joint(OBJECT_JOINT)?;
        let slide = model.joint(&hand.manifest.slide.name)?;
        let mut start_qpos = model.qpos0().to_vec();
        for (name, value) in hand.open_posture() {
            start_qpos[model.qpos_address(model.joint(&name)?)] = value;
        }
        start_qpos[model.qpos_address(slide)] = hand.manifest.slide.start;
        Ok(Addresses {
            posture_qpos: ids.iter().map(|&id| model.qpos_address(id)).collect(),
            posture_dof: ids.iter().map(|&id| model.dof_address(id)).collect(),
            object_qpos: model.qpos_address(object),
            object_dof: model.dof_address(object),
            plane: model.geom(PLANE)?,
            object: model.geom(OBJECT_GEOM)?,
            is_hand: model.geoms_below(model.body(MOUNT)?),
            slide_qpos: model.qpos_address(slide),
            slide_ctrl: model.actuator(&hand.manifest.slide.name)?.index(),
            tips: hand.fingertips.iter().map(|tip| Frame::of(model, tip)).collect::<Result<_, _>>()?,
            start_qpos,
        })
    }
}

impl ObjectScene {
    /// Returns the object's geom.
    pub fn object_geom(&self) -> GeomId {
        self.addresses.object
    }

    /// Tells for every geom of the model whether it belongs to the hand.
    pub fn is_hand(&self) -> &[bool] {
        &self.addresses.is_hand
    }

    /// Allocates a simulation of this scene.
    ///
    /// # Errors
    /// [`MuJoCoError::OutOfMemory`](eigenhand_mujoco::MuJoCoError::OutOfMemory).
    pub fn data(&self) -> Result<Data, SimError> {
        Ok(Data::new(&self.model)?)
    }

    /// Returns the model of the object alone on the plane; its `qpos` and `qvel` are the object's pose and velocity.
    pub(crate) fn resting(&self) -> &Arc<Model> {
        &self.resting
    }

    /// `(orientation: w, x, y, z) => xx, yy, zz, xy, xz, yz` in m: a symmetric matrix that describes the shape of
    /// [`object`](Self::object).
    ///
    /// Its principal axes are those of the turned object. Its principal values are the half sizes of the box that has
    /// the object's mass and inertia. When an object is turned by one of its symmetries, these numbers stay the same; a
    /// quaternion does not.
    pub fn shape_along_axes(&self, orientation: [f64; 4]) -> [f64; 6] {
        let [w, x, y, z] = orientation;
        let turned = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)) * self.inertia_box.axes;
        let axes = turned.to_rotation_matrix();
        let m = axes.matrix() * Matrix3::from_diagonal(&self.inertia_box.half_sizes) * axes.matrix().transpose();
        [m[(0, 0)], m[(1, 1)], m[(2, 2)], m[(0, 1)], m[(0, 2)], m[(1, 2)]]
    }
}
