//! Products of a run: the synergy, the policy, and scenes in which plain MuJoCo can run the policy.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use eigenhand_files::{cannot, create_directory, write_atomically};
use eigenhand_hands::Hand;
use eigenhand_rl::{Policy, PolicyScratch, rng};
use eigenhand_sim::{CLOSING_TIME, DROP, GraspEnv, GraspTask, ObservationEntry, Orientation, SimError, scene};
use eigenhand_synergy::{Space, Synergy, SynergyFile};
use serde::Serialize;

use crate::config::RunConfig;
use crate::control_product::ControlProduct;
use crate::error::TrainError;
use crate::provenance::Provenance;
use crate::task::actuation_map;

pub(crate) const POLICY: &str = "policy.safetensors";
pub(crate) const POLICY_TEXT: &str = "policy.toml";
/// Directory of the control synergy.
pub const SYNERGY: &str = "synergy";
/// Directory of the synergy of end postures.
pub const POSTURE_SYNERGY: &str = "synergy-postures";
/// Directory of the pictures of a run.
pub const PICTURES: &str = "pictures";
/// The pictures that are drawn of a policy, and the page that shows it; they are of no other.
const DRAWN: [&str; 6] = [
    "explore.html",
    "pictures/components.png",
    "pictures/episode.gif",
    "pictures/grasps.png",
    "pictures/motion.png",
    "pictures/overview.png",
];
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
    object: ObjectRecord,
    scene: SceneRecord,
    network: NetworkRecord,
    normalizer: NormalizerRecord,
    action: Vec<ActionRecord>,
    observation: Vec<ObservationEntry>,
    goal: Vec<ObservationEntry>,
    start: StartRecord,
}

/// How an object comes to rest before an episode.
#[derive(Serialize)]
struct ObjectRecord {
    orientation: Orientation,
    /// How far above the plane its lowest point is when it is dropped.
    drop_m: f64,
    settle_time_s: f64,
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

/// Removes what was drawn of an earlier policy of a run.
pub(crate) fn remove_drawn(run: &Path) -> Result<(), TrainError> {
    for path in DRAWN.map(|name| run.join(name)).into_iter().filter(|path| path.is_file()) {
        std::fs::remove_file(&path).map_err(cannot("remove", &path))?;
    }
    Ok(())
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
        eigenhand_synergy::export_beside_others(directory.join(SYNERGY), &file, commands)?;
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
    Ok(eigenhand_synergy::export_beside_others(directory.join(POSTURE_SYNERGY), &file, products.postures)?)
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
        object: ObjectRecord {
            orientation: task.config.orientation,
            drop_m: DROP,
            settle_time_s: task.config.settle_time,
        },
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
