//! The errors of this crate.

use eigenhand_mujoco::MuJoCoError;
use eigenhand_sim::SimError;

/// Errors of pages.
#[derive(Debug, thiserror::Error)]
pub enum ExploreError {
    /// The simulator.
    #[error(transparent)]
    MuJoCo(#[from] MuJoCoError),
    /// The task whose scene shows the hand.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// A synergy of another hand.
    #[error(
        "the hand {hand} has no {name}, which the synergy names: give the hand to which the synergy was fitted, in the same \
         version"
    )]
    OtherHand {
        /// The hand.
        hand: String,
        /// A joint or an actuator of the synergy.
        name: String,
    },
    /// A synergy that does not say where the joints are.
    #[error(
        "the synergy has no joint map, so its numbers do not tell where the joints are; fit it to a run's commands"
    )]
    NoJointMap,
    /// A task without objects, and so without a scene.
    #[error("the task has no object, so there is no scene that shows the hand; give it an object")]
    NoScene,
    /// An object that has nothing to draw.
    #[error("the object {object} has no surface to draw")]
    NoSurface {
        /// The object.
        object: String,
    },
    /// Two synergies on different joints.
    #[error("only one of the two synergies has the joint {name}; fit both to the same joints")]
    DifferentJoints {
        /// The joint.
        name: String,
    },
    /// The hand's data cannot be written.
    #[error("cannot write the page's data: {0}")]
    Data(#[from] serde_json::Error),
}
