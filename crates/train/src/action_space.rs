//! The numbers that a policy commands: one for each actuator, or the few of a synergy.

use std::path::{Path, PathBuf};

use eigenhand_files::write_atomically;
use eigenhand_hands::Hand;
use eigenhand_rl::{ActionDimension, Coordination, Numbers};
use eigenhand_sim::GraspTask;
use eigenhand_synergy::{Space, Synergy, SynergyFile};
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

/// Returns the path of that copy.
pub(crate) fn kept_in(run: &Path) -> PathBuf {
    run.join(COPY)
}

/// What the outputs of a policy that acts in a synergy mean: K numbers in [-1, 1] that span the range of the synergy's
/// samples, the slide, and perhaps a rest outside the synergy, see [`HandActuators::act_in`].
#[derive(Clone, Debug)]
pub struct Outputs {
    /// The maps to actions, in the order of their turns. The first has all numbers.
    pub numbers: Vec<Numbers>,
    /// The role of each output in exploration.
    pub dimensions: Vec<ActionDimension>,
}

impl Outputs {
    /// (synergy of the hand's commands, number of its components, factor on the rest, whether fewer numbers take turns) => the
    /// outputs
    ///
    /// With fewer numbers, every other turn is that of all, and the others are those of the first, the first two, and so
    /// on.
    ///
    /// # Errors
    /// [`TrainError::Rl`] for numbers that are not finite.
    pub fn of(
        synergy: &Synergy,
        k: usize,
        rest: f64,
        with_fewer: bool,
        roles: &Roles<'_>,
    ) -> Result<Outputs, TrainError> {
        let Roles { actuators, task, per_actuator } = roles;
        let turn = |fewer: Option<usize>| -> Result<Numbers, TrainError> {
            Ok(Numbers { map: actuators.act_in(synergy, [fewer.unwrap_or(k), k], rest)?, fewer })
        };
        let numbers = if with_fewer && k > 1 {
            (1..k).flat_map(|fewer| [None, Some(fewer)]).map(turn).collect::<Result<_, _>>()?
        } else {
            vec![turn(None)?]
        };
        // (action of each actuator) => the outputs whose numbers are nearest to its commands
        let nearest = |action: &[f32]| -> Vec<f32> {
            let z = synergy.encode(&actuators.commands(action));
            let range = |i: usize| (synergy.coefficient_min()[i], synergy.coefficient_max()[i]);
            let output = |i: usize| match range(i) {
                (low, high) if high > low => ((2.0 * z[i] - low - high) / (high - low)).clamp(-1.0, 1.0) as f32,
                _ => 0.0,
            };
            (0..k).map(output).collect()
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
        let mut dimensions: Vec<ActionDimension> = nearest(&start)
            .into_iter()
            .zip(nearest(&closed))
            .map(|(start, closed)| ActionDimension {
                hold_scale: 1.0,
                coordination: if coordinated { Coordination::Together(closed) } else { Coordination::Free },
                start,
            })
            .collect();
        dimensions.push(per_actuator[task.slide_action()]);
        if rest > 0.0 {
            dimensions.extend(actuators.actions().iter().map(|&action| per_actuator[action]));
        }
        Ok(Outputs { numbers, dimensions })
    }
}

/// A hand's actuators, and the role of each action in exploration.
pub struct Roles<'a> {
    actuators: &'a HandActuators,
    task: &'a GraspTask,
    per_actuator: Vec<ActionDimension>,
}

impl<'a> Roles<'a> {
    /// Returns the roles that a configuration gives a hand's actuators.
    pub fn of(config: &RunConfig, hand: &Hand, task: &'a GraspTask, actuators: &'a HandActuators) -> Roles<'a> {
        Roles { actuators, task, per_actuator: dimensions(hand, task, config.training.slide_hold) }
    }
}

/// The space of a synergy that was made before, as a policy commands it.
#[derive(Clone, Debug)]
pub struct SynergySpace {
    file: SynergyFile,
    /// The policy's outputs.
    pub outputs: Outputs,
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
            ActionSpace::Synergy => Self::read(&kept_in(run), config, hand, task).map(Some),
        }
    }

    /// Writes the copy into a run directory.
    ///
    /// # Errors
    /// [`TrainError::Synergy`], [`TrainError::File`].
    pub fn keep(&self, run: &Path) -> Result<(), TrainError> {
        Ok(write_atomically(&kept_in(run), self.file.to_toml()?.as_bytes())?)
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
        let roles = Roles::of(config, hand, task, &actuators);
        Ok(SynergySpace { outputs: Outputs::of(&file.synergy, k, 0.0, false, &roles)?, file })
    }
}

/// (file, directory of a synergy, export or run) => the path of the synergy file
fn find(path: &Path) -> PathBuf {
    let inside = ["synergy.toml", "synergy/synergy.toml"].map(|name| path.join(name));
    inside.into_iter().find(|file| file.is_file()).unwrap_or_else(|| path.to_owned())
}
