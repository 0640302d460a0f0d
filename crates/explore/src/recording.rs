//! An episode that the page plays: the hand as it was measured, and the object as it moved.

use eigenhand_hands::Hand;
use eigenhand_sim::{GraspEnv, ObjectScene};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::Serialize;

use crate::error::ExploreError;
use crate::surfaces::{Surface, packed};

/// An episode with one object. Positions are those in the world; the page takes the hand's own motion on its slide off.
#[derive(Debug, Clone)]
pub struct Recording {
    object: String,
    success: bool,
    /// Seconds from one frame to the next.
    period: f64,
    /// The object where the first frame has it.
    surface: Surface,
    /// Where the slide's position stands in the simulation.
    slide: usize,
    frames: Vec<Frame>,
}

#[derive(Debug, Clone)]
struct Frame {
    z: Vec<f64>,
    beside: Vec<f64>,
    posture: Vec<f64>,
    place: Vector3<f64>,
    orientation: UnitQuaternion<f64>,
    /// Height of the hand on its slide.
    height: f64,
}

/// A recording as the page reads it.
#[derive(Debug, Serialize)]
pub(crate) struct Played<'a> {
    object: &'a str,
    success: bool,
    period: f64,
    surface: &'a Surface,
    frames: Vec<PlayedFrame<'a>>,
}

/// A frame as the page reads it.
#[derive(Debug, Serialize)]
struct PlayedFrame<'a> {
    /// The numbers nearest to the commands.
    z: &'a [f64],
    /// Those of the second synergy; empty without one.
    beside: &'a [f64],
    /// Positions of the page's joints.
    q: &'a [f64],
    /// Motion of the object since the first frame, as the hand sees it: rotation row by row, and shift in m.
    r: Vec<f64>,
    t: [f64; 3],
}

impl Recording {
    /// Begins a recording with the start of an episode.
    ///
    /// # Errors
    /// [`ExploreError::NoSurface`] for an object without a surface, [`ExploreError::MuJoCo`] for a scene without the slide.
    pub fn begin(hand: &Hand, scene: &ObjectScene, env: &GraspEnv, period: f64) -> Result<Recording, ExploreError> {
        let model = env.simulation().model();
        Ok(Recording {
            object: scene.object.name.clone(),
            success: false,
            period,
            surface: packed(env.simulation(), scene.object_geom(), 0)
                .ok_or_else(|| ExploreError::NoSurface { object: scene.object.name.clone() })?,
            slide: model.qpos_address(model.joint(&hand.manifest.slide.name)?),
            frames: Vec::new(),
        })
    }

    /// Adds a frame: the numbers nearest to the commands now, those of the synergy beside (none without one), and where hand
    /// and object are.
    pub fn add(&mut self, env: &GraspEnv, z: Vec<f64>, beside: Vec<f64>) {
        let mut posture = vec![0.0; env.task().posture_joints.len()];
        env.posture(&mut posture);
        let [x, y, height, w, i, j, k] = env.object_pose();
        self.frames.push(Frame {
            z,
            beside,
            place: Vector3::new(x, y, height),
            orientation: UnitQuaternion::new_normalize(Quaternion::new(w, i, j, k)),
            height: env.simulation().qpos()[self.slide],
            posture,
        });
    }

    /// Ends the recording.
    pub fn end(&mut self, success: bool) {
        self.success = success;
    }

    /// Returns the recording as a hand sees it that stands still at a height on its slide.
    pub(crate) fn played(&self, height: f64) -> Option<Played<'_>> {
        let first = self.frames.first()?;
        let frame = |frame: &'_ Frame| {
            let turn = (frame.orientation * first.orientation.inverse()).to_rotation_matrix();
            // A point of the object: first to its frame, then to where the hand now sees it.
            let seen = frame.place + (height - frame.height) * Vector3::z();
            let shift = seen - turn * first.place;
            (turn, shift)
        };
        let frames = self.frames.iter().map(|shown| {
            let (turn, shift) = frame(shown);
            PlayedFrame {
                z: &shown.z,
                beside: &shown.beside,
                q: &shown.posture,
                r: turn.matrix().transpose().iter().copied().collect(),
                t: shift.into(),
            }
        });
        Some(Played {
            object: &self.object,
            success: self.success,
            period: self.period,
            surface: &self.surface,
            frames: frames.collect(),
        })
    }
}
