//! The results of a survey, and the hints that its caller may give.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

/// Hints of the caller, which replace the findings of the survey.
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
    /// Body that holds the tip.
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
    /// Neither: it spreads fingers or turns a wrist, for example.
    Neither,
}

/// The results of a survey.
#[derive(Clone, Debug)]
pub struct Survey {
    /// Body of the palm.
    pub palm: String,
    /// The fingers, in the order of the model.
    pub fingers: Vec<Finger>,
    /// Direction of approach in the palm's frame.
    pub approach: [f64; 3],
    /// Which way each actuator closes the hand, in the order of the model.
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
    /// Bodies above the palm, such as a forearm, that would touch the plane before the palm or a finger.
    pub in_the_way: Vec<String>,
    /// Pairs of bodies that overlap in the open posture or the initial one.
    pub overlaps: Vec<(String, String)>,
}
