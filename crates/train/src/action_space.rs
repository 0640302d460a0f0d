//! The numbers that a policy commands: one for each actuator, or the few of a synergy that was made before.

use std::path::{Path, PathBuf};

use eigenhand_files::write_atomically;
use eigenhand_hands::Hand;
use eigenhand_rl::{ActionDimension, ActionMap, Coordination};
use eigenhand_sim::GraspTask;
use eigenhand_synergy::{Space, SynergyFile};
use serde::{Deserialize, Serialize};

use crate::actuators::HandActuators;
use crate::config::RunConfig;
use crate::error::TrainError;
use crate::exploration::dimensions;

/// What a policy commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ActionSpace {
    /// Every actuator.
    Joints,
    /// The slide, and the first numbers of the synergy in `synergy.file`.
    Synergy,
}

/// Copy of the synergy in the run directory, so that the run can be resumed without the original.
const COPY: &str = "action-space.toml";

/// The space of a given synergy as a policy commands it: K numbers in [-1, 1] that span the range of the synergy's samples,
/// and the slide.
#[derive(Clone, Debug)]
pub struct SynergySpace {
    file: SynergyFile,
    /// From the K numbers and the slide to actions.
    pub map: ActionMap,
    /// The role of each number in exploration.
    pub dimensions: Vec<ActionDimension>,
}

impl SynergySpace {
    /// Reads the synergy that a new run's configuration names; none if the policy commands the joints.
    ///
    /// # Errors
    /// [`TrainError::ActionSpace`] when no synergy of this hand's commands can be read there.
    pub fn of(config: &RunConfig, hand: &Hand, task: &GraspTask) -> Result<Option<SynergySpace>, TrainError> {
        match config.action_space {
            ActionSpace::Joints => Ok(None),
            ActionSpace::Synergy => Self::read(&find(Path::new(&config.synergy.file)), config, hand, task).map(Some),
        }
    }

    /// Reads the copy in the directory of a resumed run.
    ///
    /// # Errors
    /// As [`of`](Self::of).
    pub fn resume(
        run: &Path,
        config: &RunConfig,
        hand: &Hand,
        task: &GraspTask,
    ) -> Result<Option<SynergySpace>, TrainError> {
        match config.action_space {
            ActionSpace::Joints => Ok(None),
            ActionSpace::Synergy => Self::read(&run.join(COPY), config, hand, task).map(Some),
        }
    }

    /// Writes the copy into a run directory.
    ///
    /// # Errors
    /// [`TrainError::Synergy`], [`TrainError::File`].
    pub fn keep(&self, run: &Path) -> Result<(), TrainError> {
        Ok(write_atomically(&run.join(COPY), self.file.to_toml()?.as_bytes())?)
    }

    fn read(path: &Path, config: &RunConfig, hand: &Hand, task: &GraspTask) -> Result<SynergySpace, TrainError> {
        let wrong = |reason: String| TrainError::ActionSpace { path: path.to_owned(), reason };
        if path.is_dir() {
            return Err(wrong("it holds no control synergy: a run has one once its policy has succeeded".to_owned()));
        }
        let file = SynergyFile::read(path).map_err(|error| wrong(error.to_string()))?;
        let actuators = HandActuators::of(hand, task);
        if file.space != Space::Commands {
            return Err(wrong("it holds a space of end postures, which cannot open a hand".to_owned()));
        }
        let names = |joints: &[eigenhand_synergy::JointInfo]| joints.iter().map(|j| j.name.clone()).collect::<Vec<_>>();
        let (found, expected) = (names(file.synergy.joints()), names(&actuators.coordinates));
        if found != expected {
            let hand = &hand.manifest.name;
            return Err(wrong(format!(
                "it commands the actuators {}, but the hand {hand} has {}",
                found.join(", "),
                expected.join(", ")
            )));
        }
        let k = config.synergy.components;
        if k > file.synergy.n_components() {
            return Err(wrong(format!(
                "it has {} components, fewer than the {k} of --components (synergy.components)",
                file.synergy.n_components()
            )));
        }
        let per_actuator = dimensions(hand, task, config.training.slide_hold);
        let synergy = &file.synergy;
        let n = synergy.n_joints();
        let half: Vec<f64> =
            (0..k).map(|i| (synergy.coefficient_max()[i] - synergy.coefficient_min()[i]) / 2.0).collect();
        let middle: Vec<f64> =
            (0..k).map(|i| (synergy.coefficient_max()[i] + synergy.coefficient_min()[i]) / 2.0).collect();
        let rows: Vec<Vec<f64>> = (0..k).map(|i| synergy.component(i).iter().map(|c| c * half[i]).collect()).collect();
        let centre: Vec<f64> = (0..n)
            .map(|j| synergy.mean()[j] + (0..k).map(|i| middle[i] * synergy.component(i)[j]).sum::<f64>())
            .collect();
        let map = actuators.map_of_numbers(&centre, &rows)?;
        // (action of each actuator) => the numbers nearest to its commands
        let numbers = |action: &[f32]| -> Vec<f32> {
            let z = synergy.encode(&actuators.commands(action));
            (0..k)
                .map(|i| if half[i] > 0.0 { ((z[i] - middle[i]) / half[i]).clamp(-1.0, 1.0) as f32 } else { 0.0 })
                .collect()
        };
        let start: Vec<f32> = per_actuator.iter().map(|dimension| dimension.start).collect();
        let closed: Vec<f32> = per_actuator
            .iter()
            .map(|dimension| match dimension.coordination {
                Coordination::Together(sign) => sign,
                Coordination::Free | Coordination::Ends => dimension.start,
            })
            .collect();
        let coordinated = per_actuator.iter().any(|d| matches!(d.coordination, Coordination::Together(_)));
        let mut dimensions: Vec<ActionDimension> = numbers(&start)
            .into_iter()
            .zip(numbers(&closed))
            .map(|(start, closed)| ActionDimension {
                hold_scale: 1.0,
                coordination: if coordinated { Coordination::Together(closed) } else { Coordination::Free },
                start,
            })
            .collect();
        dimensions.push(per_actuator[task.slide_action()]);
        Ok(SynergySpace { map, dimensions, file })
    }
}

/// (file, directory of a synergy, export or run) => the path of the synergy file
fn find(path: &Path) -> PathBuf {
    let inside = ["synergy.toml", "synergy/synergy.toml"].map(|name| path.join(name));
    inside.into_iter().find(|file| file.is_file()).unwrap_or_else(|| path.to_owned())
}
