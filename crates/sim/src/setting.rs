//! Everything that determines a grasp task, except its hand.

use serde::{Deserialize, Serialize};

use crate::error::SimError;
use crate::physics::PhysicsConfig;
use crate::reward::RewardConfig;

/// Orientation of an object when it is dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Orientation {
    /// Uniform over all rotations.
    Any,
    /// Upright, turned about the vertical.
    Yaw,
}

/// Settings of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TaskConfig {
    /// Control steps of an episode (paper, section 3.1).
    pub steps: usize,
    /// Number of last steps that must all succeed for the episode to succeed (the authors' code).
    pub final_steps: usize,
    /// Lowest and highest goal above the resting object, in m.
    pub goal_height: [f64; 2],
    /// Half width in m of the square in which the object is placed; its centre is below the hand.
    pub object_range: f64,
    /// Lowest and highest factor on the object's lengths; drawn uniformly for each episode. The mass stays.
    pub object_scale: [f64; 2],
    /// Orientation of the object when it is dropped.
    pub orientation: Orientation,
    /// Lowest and highest share by which the hand is closed at the start; drawn uniformly for each episode. The actuators of
    /// `closing` in `hand.toml` close it; a hand without them starts open.
    pub closed_start: [f64; 2],
    /// Time in s that a dropped object has to come to rest.
    pub settle_time: f64,
    /// Whether the observation has the place of every fingertip, seen from the object.
    pub observe_fingertips: bool,
    /// Whether the observation has the number of the object.
    pub observe_id: bool,
    /// Whether the observation ends with the object's shape; see [`ObjectScene::shape_along_axes`](crate::ObjectScene::shape_along_axes).
    pub observe_shape: bool,
}

impl TaskConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`SimError::Setting`] names the first key that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        let check = |name, good: bool, expected, got: String| {
            if good { Ok(()) } else { Err(SimError::Setting { name, expected, got }) }
        };
        let heights = "two heights in m, the lower first, from 0 to 1";
        let ordered = |h: [f64; 2]| 0.0 <= h[0] && h[0] <= h[1] && h[1] <= 1.0;
        check("task.goal_height", ordered(self.goal_height), heights, format!("{:?}", self.goal_height))?;
        check(
            "task.steps",
            (2..=10_000).contains(&self.steps),
            "a whole number from 2 to 10000",
            self.steps.to_string(),
        )?;
        check(
            "task.final_steps",
            (1..=self.steps).contains(&self.final_steps),
            "a whole number from 1 to task.steps",
            self.final_steps.to_string(),
        )?;
        check(
            "task.object_range",
            (0.0..=0.5).contains(&self.object_range),
            "a length from 0 to 0.5 m",
            self.object_range.to_string(),
        )?;
        let [low, high] = self.object_scale;
        check(
            "task.object_scale",
            0.1 <= low && low <= high && high <= 10.0,
            "two factors from 0.1 to 10, the lower first",
            format!("{:?}", self.object_scale),
        )?;
        let [low, high] = self.closed_start;
        check(
            "task.closed_start",
            0.0 <= low && low <= high && high <= 1.0,
            "two shares from 0 to 1, the lower first",
            format!("{:?}", self.closed_start),
        )?;
        check(
            "task.settle_time",
            (0.0..=5.0).contains(&self.settle_time),
            "a time from 0 to 5 s",
            self.settle_time.to_string(),
        )
    }
}

/// Factors on a compiled scene, for evaluations. No setting has them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Factors {
    /// On the object's mass.
    pub mass: f64,
    /// On gain and bias of the hand's actuators, without the slide's; their limits stay.
    pub stiffness: f64,
}

impl Factors {
    /// The factors that change nothing.
    pub const NONE: Factors = Factors { mass: 1.0, stiffness: 1.0 };
}

/// (lowest, highest) => the value in the middle, at which scenes are compiled.
pub(crate) fn middle([low, high]: [f64; 2]) -> f64 {
    (low + high) / 2.0
}

/// Everything that determines a grasp task, except its hand.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// The objects, as [`Object::expand`](crate::Object::expand) takes them.
    pub objects: Vec<String>,
    /// Settings of an episode.
    pub task: TaskConfig,
    /// Settings of the simulation.
    pub physics: PhysicsConfig,
    /// Settings of success.
    pub reward: RewardConfig,
}
