//! Products of a run: the synergy, the policy, and scenes in which plain MuJoCo can run the policy.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use eigenhand_files::{create_directory, write_atomically};
use eigenhand_hands::Hand;
use eigenhand_rl::{Policy, PolicyScratch, rng};
use eigenhand_sim::{CLOSING_TIME, GraspEnv, GraspTask, ObservationEntry, SimError, scene};
use eigenhand_synergy::{
    Import, JointInfo, JointMap, Moment, MotionRecord, NamedGrasp, Recommended, Space, Synergy, SynergyFile,
};
use serde::Serialize;

use crate::actuators::HandActuators;
use crate::config::RunConfig;
use crate::control::control_space;
use crate::drive::is_nearly;
use crate::error::TrainError;
use crate::provenance::Provenance;
use crate::task::actuation_map;

pub(crate) const POLICY: &str = "policy.safetensors";
pub(crate) const POLICY_TEXT: &str = "policy.toml";
/// Directory of the control synergy.
pub(crate) const SYNERGY: &str = "synergy";
/// Directory of the synergy of end postures.
const POSTURE_SYNERGY: &str = "synergy-postures";
const SCENES: &str = "scenes";
const REFERENCE: &str = "reference.json";

/// Everything that is needed to write the products.
pub(crate) struct Products<'a> {
    pub hand: &'a Hand,
    pub task: &'a Arc<GraspTask>,
    pub config: &'a RunConfig,
    pub provenance: &'a Provenance,
    pub policy: &'a Policy,
    /// Training episodes before the policy, if known.
    pub policy_episode: Option<u64>,
    /// The synergy that drives the hand.
    pub control: Option<ControlProduct>,
    /// The synergy of end postures.
    pub synergy: Option<&'a Synergy>,
    pub postures: &'a [Vec<f64>],
}

/// Numbers are recommended if they give at least this share of the opening.
const LEAST_OPENING: f64 = 0.5;

/// A control synergy as it is exported.
pub(crate) struct ControlProduct {
    synergy: Synergy,
    commands: Vec<Vec<f64>>,
    joint_map: JointMap,
    recommended: Option<Recommended>,
    grasps: Vec<NamedGrasp>,
}

impl ControlProduct {
    /// (motions that the space describes, motions of the policy, and those with fewer numbers) => the product, with the joint
    /// positions and grasps of the policy; none while there are too few motions
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn of(
        actuators: &HandActuators,
        joints: &[JointInfo],
        described: &[MotionRecord],
        motions: &[MotionRecord],
        with_fewer: &[(usize, Vec<MotionRecord>)],
        components: usize,
    ) -> Result<Option<ControlProduct>, TrainError> {
        let Some(mut synergy) = control_space(&actuators.coordinates, described, components)? else { return Ok(None) };
        let commands_of = |steps: &[MotionRecord]| steps.iter().map(|step| step.command.clone()).collect::<Vec<_>>();
        let postures: Vec<_> = motions.iter().map(|step| step.posture.as_slice()).collect();
        let joint_map = JointMap::fit(&synergy, &commands_of(motions), joints, &postures)?;
        synergy.widen(&commands_of(motions));
        let commands = commands_of(described);
        let with_all = (synergy.n_components(), motions);
        let counted = with_fewer.iter().map(|(k, motions)| (*k, motions.as_slice())).chain([with_all]);
        let grasps = counted.flat_map(|(k, motions)| mean_grasps(&synergy, actuators, k, motions)).collect();
        Ok(Some(ControlProduct { synergy, commands, joint_map, recommended: None, grasps }))
    }

    /// (success with 0, 1, 2... numbers, success with all joints, episodes of each) => recommends the fewest numbers that are
    /// nearly as good and open the hand, if there are such
    ///
    /// Where episodes begin with the open hand, success alone does not show that the numbers open it.
    pub fn recommend(&mut self, success: &[f64], all_joints: f64, episodes: u64) {
        let opening = opening_shares(&self.grasps, self.synergy.n_components());
        let enough = |&k: &usize| is_nearly(success[k], all_joints) && opening[k - 1] >= LEAST_OPENING;
        let Some(components) = (1..success.len().min(opening.len() + 1)).find(enough) else { return };
        let reason = format!(
            "with {components} number{} {:.1} % of {episodes} episodes succeed, with all joints {:.1} %; share of the \
             opening {:.0} %",
            if components == 1 { "" } else { "s" },
            100.0 * success[components],
            100.0 * all_joints,
            100.0 * opening[components - 1]
        );
        self.recommended = Some(Recommended { components, reason });
    }

    /// Reads the directory that a run exported.
    ///
    /// # Errors
    /// [`TrainError::Synergy`] for a file that is missing or damaged, [`TrainError::Damaged`] for a synergy of postures.
    pub fn read(directory: &Path) -> Result<ControlProduct, TrainError> {
        let Import { file, samples } = eigenhand_synergy::import(directory)?;
        match file {
            SynergyFile {
                space: Space::Commands, synergy, joint_map: Some(joint_map), recommended, grasps, ..
            } => Ok(ControlProduct { synergy, commands: samples, joint_map, recommended, grasps }),
            _ => Err(TrainError::Damaged {
                path: directory.to_owned(),
                reason: "it holds no control synergy with a joint map".to_owned(),
                mend: "restore the run's files".to_owned(),
            }),
        }
    }
}

/// Returns the share of the squared distance between the open and the holding hand that lies in the first component, in the
/// first two, and so on, over the grasps with all `k` numbers.
fn opening_shares(grasps: &[NamedGrasp], k: usize) -> Vec<f64> {
    let mut squares = vec![0.0; k];
    for NamedGrasp { open, held, .. } in grasps.iter().filter(|grasp| grasp.numbers == k) {
        let way = open.z.iter().zip(&held.z).map(|(open, held)| open - held);
        squares.iter_mut().zip(way).for_each(|(sum, difference)| *sum += difference * difference);
    }
    let all: f64 = squares.iter().sum();
    let mut so_far = 0.0;
    let share = |square: f64| {
        so_far += square;
        if all > 0.0 { so_far / all } else { 0.0 }
    };
    squares.into_iter().map(share).collect()
}

/// Returns the mean grasp of each object with the first `k` numbers, in the order of the objects' names.
fn mean_grasps(synergy: &Synergy, actuators: &HandActuators, k: usize, motions: &[MotionRecord]) -> Vec<NamedGrasp> {
    let mut of_object: BTreeMap<&str, Vec<&[MotionRecord]>> = BTreeMap::new();
    for motion in motions.chunk_by(|a, b| a.episode == b.episode) {
        of_object.entry(motion[0].object.as_str()).or_default().push(motion);
    }
    // A policy may close while the hand comes down. So its commands lead elsewhere than to the posture in which the hand
    // then is.
    let opening = |step: &MotionRecord| MotionRecord {
        command: actuators.commands_that_hold(&step.posture, &step.command),
        ..step.clone()
    };
    let mean = |moments: &[&MotionRecord]| {
        let average = |rows: Vec<Vec<f64>>| -> Vec<f64> {
            let n = rows.len() as f64;
            (0..rows[0].len()).map(|i| rows.iter().map(|row| row[i]).sum::<f64>() / n).collect()
        };
        Moment {
            z: average(moments.iter().map(|step| synergy.encode(&step.command)[..k].to_vec()).collect()),
            q: average(moments.iter().map(|step| step.posture.clone()).collect()),
        }
    };
    let grasp = |(object, motions): (&str, Vec<&[MotionRecord]>)| {
        let first = |motion: &&'_ [MotionRecord]| -> usize { motion.iter().position(|s| s.held).unwrap_or(0) };
        // A hand that starts closed opens first.
        let most_open = |motion: &&[MotionRecord]| {
            let distance = |step: &MotionRecord| actuators.distance_to_open(&step.posture);
            let approach = &motion[..first(motion).max(1)];
            opening(approach.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(&motion[0]))
        };
        let open: Vec<MotionRecord> = motions.iter().map(most_open).collect();
        let closed: Vec<&MotionRecord> =
            motions.iter().map(|motion| &motion[first(motion).saturating_sub(1)]).collect();
        let held: Vec<&MotionRecord> = motions.iter().map(|motion| &motion[motion.len() - 1]).collect();
        NamedGrasp {
            object: object.to_owned(),
            numbers: k,
            motions: motions.len(),
            open: mean(&open.iter().collect::<Vec<_>>()),
            closed: mean(&closed),
            held: mean(&held),
        }
    };
    of_object.into_iter().map(grasp).collect()
}

#[derive(Serialize)]
struct PolicyRecord {
    schema: u32,
    hand: String,
    hand_digest: String,
    policy_episode: Option<u64>,
    seed: u64,
    lambda: f64,
    control_period_s: f64,
    substeps: usize,
    episode_steps: usize,
    final_steps: usize,
    success_distance_m: f64,
    goal_height_m: [f64; 2],
    object_range_m: f64,
    scene: SceneRecord,
    network: NetworkRecord,
    normalizer: NormalizerRecord,
    action: Vec<ActionRecord>,
    observation: Vec<ObservationEntry>,
    goal: Vec<ObservationEntry>,
    start: StartRecord,
}

/// Names in every `scenes/<object>.xml` that another program needs to recognise success.
#[derive(Serialize)]
struct SceneRecord {
    object_joint: &'static str,
    object_geom: &'static str,
    plane_geom: &'static str,
    hand_body: &'static str,
}

#[derive(Serialize)]
struct NetworkRecord {
    weights: &'static str,
    input: &'static str,
    hidden: Vec<usize>,
    hidden_activation: &'static str,
    output_activation: &'static str,
    /// How the actions follow from the outputs.
    action: &'static str,
}

#[derive(Serialize)]
struct NormalizerRecord {
    formula: &'static str,
    raw_clip: f32,
    norm_clip: f32,
}

#[derive(Serialize)]
struct ActionRecord {
    actuator: String,
    low: f64,
    high: f64,
}

#[derive(Serialize)]
struct StartRecord {
    joints: BTreeMap<String, f64>,
    ctrl: Vec<f64>,
    closed_ctrl: Vec<f64>,
    closed_share: [f64; 2],
    closing_time_s: f64,
}

/// First step of an episode in one scene, so that another program can check its own results.
#[derive(Serialize)]
struct ReferenceStep {
    object: String,
    qpos: Vec<f64>,
    ctrl: Vec<f64>,
    desired_goal: [f32; GraspTask::GOAL_LEN],
    observation: Vec<f32>,
    action: Vec<f32>,
    next_observation: Vec<f32>,
}

/// Writes `synergy/`, `synergy-postures/`, `policy.safetensors`, `policy.toml` and `scenes/` into a directory.
pub(crate) fn write_products(products: &Products, directory: &Path) -> Result<(), TrainError> {
    create_directory(directory)?;
    write_synergies(products, directory)?;
    write_atomically(&directory.join(POLICY), &products.policy.export_tensors().save_bytes()?)?;
    let path = directory.join(POLICY_TEXT);
    let text = toml::to_string(&policy_record(products))
        .map_err(|error| TrainError::Format { path: path.clone(), reason: error.to_string() })?;
    write_atomically(&path, text.as_bytes())?;
    write_scenes(products, &directory.join(SCENES))
}

/// Writes the control synergy and the synergy of end postures, each if there is one.
fn write_synergies(products: &Products, directory: &Path) -> Result<(), TrainError> {
    let provenance = BTreeMap::from([
        ("hand_digest".to_owned(), products.provenance.hand_digest.clone()),
        ("lambda".to_owned(), products.config.lambda.to_string()),
        ("seed".to_owned(), products.config.seed.to_string()),
        ("preset".to_owned(), products.config.preset.name().to_owned()),
        ("eigenhand_version".to_owned(), products.provenance.eigenhand_version.clone()),
        ("git_revision".to_owned(), products.provenance.git_revision.clone()),
        ("mujoco_version".to_owned(), products.provenance.mujoco_version.clone()),
    ]);
    let hand = products.hand.manifest.name.clone();
    if let Some(ControlProduct { synergy, commands, joint_map, recommended, grasps }) = &products.control {
        let file = SynergyFile {
            hand: hand.clone(),
            space: Space::Commands,
            synergy: synergy.clone(),
            joint_map: Some(joint_map.clone()),
            actuation: None,
            recommended: recommended.clone(),
            grasps: grasps.clone(),
            provenance: provenance.clone(),
        };
        eigenhand_synergy::export(directory.join(SYNERGY), &file, commands)?;
    }
    let Some(synergy) = products.synergy else { return Ok(()) };
    let file = SynergyFile {
        hand,
        space: Space::Postures,
        synergy: synergy.clone(),
        joint_map: None,
        actuation: Some(actuation_map(products.hand, products.task)),
        recommended: None,
        grasps: Vec::new(),
        provenance,
    };
    Ok(eigenhand_synergy::export(directory.join(POSTURE_SYNERGY), &file, products.postures)?)
}

fn policy_record(products: &Products) -> PolicyRecord {
    let (task, config) = (products.task, products.config);
    let axis = |name: &str| ObservationEntry { name: format!("object:{name}"), unit: "m" };
    PolicyRecord {
        schema: 1,
        hand: products.hand.manifest.name.clone(),
        hand_digest: products.provenance.hand_digest.clone(),
        policy_episode: products.policy_episode,
        seed: config.seed,
        lambda: config.lambda,
        control_period_s: task.physics.control_period(),
        substeps: task.physics.substeps,
        episode_steps: task.config.steps,
        final_steps: task.config.final_steps,
        success_distance_m: task.reward.success_distance,
        goal_height_m: task.config.goal_height,
        object_range_m: task.config.object_range,
        scene: SceneRecord {
            object_joint: scene::OBJECT_JOINT,
            object_geom: scene::OBJECT_GEOM,
            plane_geom: scene::PLANE,
            hand_body: scene::MOUNT,
        },
        network: NetworkRecord {
            weights: "policy.safetensors: actor.{i}.weight (outputs x inputs), actor.{i}.bias",
            input: "normalised observation, then normalised goal",
            hidden: config.learner.hidden.clone(),
            hidden_activation: "relu",
            output_activation: "tanh",
            action: match products.policy.map() {
                Some(_) => "clip(action.matrix @ output + action.offset, -1, 1), of policy.safetensors",
                None => "output",
            },
        },
        normalizer: NormalizerRecord {
            formula: "clip((clip(x, -raw_clip, raw_clip) - mean) / std, -norm_clip, norm_clip)",
            raw_clip: config.learner.normalizer.raw_clip,
            norm_clip: config.learner.normalizer.norm_clip,
        },
        action: task
            .actuators
            .iter()
            .zip(&task.control_ranges)
            .map(|(name, &(low, high))| ActionRecord { actuator: name.clone(), low, high })
            .collect(),
        observation: task.observation_layout(),
        goal: ["x", "y", "z"].map(axis).to_vec(),
        start: StartRecord {
            joints: start_joints(products.hand),
            ctrl: task.start_controls().to_vec(),
            closed_ctrl: task.closed_controls().to_vec(),
            closed_share: task.config.closed_start,
            closing_time_s: CLOSING_TIME,
        },
    }
}

/// Returns the positions of the open hand's joints, and of the slide at its start.
fn start_joints(hand: &Hand) -> BTreeMap<String, f64> {
    let slide = &hand.manifest.slide;
    hand.open_posture().into_iter().chain([(slide.name.clone(), slide.start)]).collect()
}

/// Writes every scene with the files that it refers to, and a reference step in each.
fn write_scenes(products: &Products, directory: &Path) -> Result<(), TrainError> {
    create_directory(directory)?;
    let task = products.task;
    let mut env = GraspEnv::without_draws(task)?;
    let mut scratch = products.policy.scratch();
    let mut steps = Vec::new();
    for (index, scene) in task.scenes.iter().enumerate() {
        let name = &scene.object.name;
        write_atomically(&directory.join(format!("{name}.xml")), scene.scene.xml.as_bytes())?;
        for (file, bytes) in &scene.scene.assets {
            write_atomically(&directory.join(file), bytes)?;
        }
        match reference_step(products, &mut env, &mut scratch, index) {
            Ok(step) => steps.push(step),
            // A simulation that diverges in its first step is no reference.
            Err(SimError::Diverged { .. }) => {
                tracing::warn!("reference.json has no step with the object {name}: its simulation diverges")
            }
            Err(error) => return Err(error.into()),
        }
    }
    let path = directory.join(REFERENCE);
    let text = serde_json::to_string(&steps)
        .map_err(|error| TrainError::Format { path: path.clone(), reason: error.to_string() })?;
    Ok(write_atomically(&path, text.as_bytes())?)
}

/// Simulates the first step of an episode.
fn reference_step(
    products: &Products,
    env: &mut GraspEnv,
    scratch: &mut PolicyScratch,
    index: usize,
) -> Result<ReferenceStep, SimError> {
    let task = products.task;
    let mut random = rng::stream(products.config.seed, "reference", index as u64);
    env.reset(index, &mut random)?;
    let mut step = ReferenceStep {
        object: task.scenes[index].object.name.to_owned(),
        qpos: env.simulation().qpos().to_vec(),
        ctrl: env.simulation().ctrl().to_vec(),
        desired_goal: env.desired_goal(),
        observation: vec![0.0; task.observation_len()],
        action: vec![0.0; task.action_len()],
        next_observation: vec![0.0; task.observation_len()],
    };
    env.observe(&mut step.observation);
    products.policy.act(&step.observation, &step.desired_goal, scratch, &mut step.action);
    env.step(&step.action)?;
    env.observe(&mut step.next_observation);
    Ok(step)
}

#[cfg(test)]
mod tests {
    use eigenhand_synergy::Unit;

    use super::*;

    #[test]
    fn numbers_are_recommended_if_they_lift_and_open() {
        let joint = |name: &str| JointInfo { name: name.to_owned(), unit: Unit::Radian, lower: -9.0, upper: 9.0 };
        let joints = ["a", "b", "c"].map(joint);
        let commands = vec![vec![3.0, 0.0, 0.0], vec![-3.0, 0.0, 0.0], vec![0.0, 2.0, 0.0], vec![0.0, -2.0, 1.0]];
        let synergy = Synergy::fit(&joints, &commands, 3).unwrap();
        let joint_map = JointMap::fit(&synergy, &commands, &joints, &commands).unwrap();
        let moment = |z: &[f64]| Moment { z: z.to_vec(), q: Vec::new() };
        let grasp = |open: &[f64], held: &[f64]| NamedGrasp {
            object: "cube".to_owned(),
            numbers: open.len(),
            motions: 1,
            open: moment(open),
            closed: moment(held),
            held: moment(held),
        };
        // Squared distances of the two grasps: 1 + 1, 1 + 4 and 1 + 0.
        let grasps =
            vec![grasp(&[9.0], &[0.0]), grasp(&[1.0, 2.0, 0.0], &[0.0, 1.0, 1.0]), grasp(&[0.0; 3], &[1.0, 2.0, 0.0])];
        assert_eq!(opening_shares(&grasps, 3), [2.0 / 8.0, 7.0 / 8.0, 1.0]);
        let mut product = ControlProduct { synergy, commands, joint_map, recommended: None, grasps };
        product.recommend(&[0.1, 0.96, 0.97, 0.98], 0.97, 200);
        let Recommended { components, reason } = product.recommended.clone().unwrap();
        assert_eq!(components, 2, "one number lifts but does not open");
        assert!(reason.contains("97.0 % of 200") && reason.contains("opening 88 %"), "{reason}");
        product.recommended = None;
        product.recommend(&[0.1, 0.2, 0.3, 0.4], 0.97, 200);
        assert_eq!(product.recommended, None);
    }
}
