//! The hand contract: conditions that every hand must fulfil in the simulator before it is worth training.
//!
//! The code names no hand, no joint and no count: it reads everything from the hand and from its compiled scenes.

use std::sync::Arc;

use eigenhand_hands::{FrameKind, Hand, Transmission};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use crate::{GraspEnv, GraspTask, ObjectScene, Setting, SimError};
use eigenhand_mujoco::{GeomId, Model, MuJoCo};

mod random_episodes;

/// Starts of episodes with each object.
const STARTS: usize = 3;
/// Time in s that an actuator has to move its joints.
const DRIVE_TIME: f64 = 1.0;
/// Duration in s of the noise: new random commands at every control step.
const NOISE_TIME: f64 = 1.0;
/// Least movement between the ends of an actuator's range, as a share of the joint's range.
const LEAST_MOVEMENT: f64 = 0.1;
/// Range in rad or m that is assumed for a joint without limits.
const UNLIMITED_RANGE: f64 = 1.0;
/// Name of the first condition.
const COMPILES: &str = "compiles";
/// Name of the condition on scripted grasps.
pub const GRASPS: &str = "scripted grasps lift";
/// Seed of the random episodes, so that the contract always gives the same answer for the same hand.
const SEED: u64 = 20;

/// One condition and whether it holds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    /// Short name of the condition.
    pub name: &'static str,
    /// Whether it holds.
    pub passed: bool,
    /// The finding; after a failure, also what to change.
    pub detail: String,
}

/// Result of the contract for one hand.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ContractReport {
    /// Name of the hand.
    pub hand: String,
    /// SHA-256 over the hand's files.
    pub digest: String,
    /// The conditions, in the order of the checks. A failure to compile ends the list.
    pub checks: Vec<Check>,
}

impl ContractReport {
    /// Tells whether every condition holds.
    pub fn passed(&self) -> bool {
        self.faults().next().is_none()
    }

    /// Returns the conditions that do not hold, each with what to change.
    pub fn faults(&self) -> impl Iterator<Item = &Check> {
        self.checks.iter().filter(|check| !check.passed)
    }

    /// Tells whether the hand's scenes compile. If not, nothing else can be checked or drawn.
    pub fn compiles(&self) -> bool {
        self.checks.iter().any(|check| check.name == COMPILES && check.passed)
    }
}

/// `Ok` describes what was found, `Err` what is wrong.
type Finding = Result<String, String>;

/// Checks a hand with every object of the setting.
pub fn check(hand: &Hand, library: &Arc<MuJoCo>, setting: &Setting) -> ContractReport {
    let mut report =
        ContractReport { hand: hand.manifest.name.clone(), digest: hand.digest.clone(), checks: Vec::new() };
    let task = match GraspTask::new(library, hand, setting) {
        Ok(task) => Arc::new(task),
        Err(error) => {
            report.add(COMPILES, Err(with_sources(&error)));
            return report;
        }
    };
    report.add(COMPILES, Ok(format!("with {}", setting.objects.join(", "))));
    report.add("scenes load", scenes_load(&task, library));
    report.add("names resolve", names_resolve(hand, &task));
    report.add("open posture is free", open_posture_is_free(&task));
    report.add("actuators move their joints", actuators_move(hand, &task));
    report.add("noise raises no warning", noise_is_quiet(&task));
    report.add("deterministic", is_deterministic(&task));
    match random_episodes::run(hand, &task) {
        Ok(found) => {
            report.add("observations are finite", found.finite());
            report.add("observations vary", found.varied(&task));
            report.add("object is within reach", found.reach(&task));
        }
        Err(error) => report.add("random episodes", Err(with_sources(&error))),
    }
    // Only the maker of the hand's directory carries out the grasps; without them, nothing is known.
    if let Some(grasps) = hand.manifest.scripted_grasps {
        let verdict = grasps.verdict();
        let finding = if grasps.can_grasp() {
            Ok(verdict)
        } else {
            Err(format!("{verdict}; once you have changed the hand, remove [scripted_grasps] from hand.toml"))
        };
        report.add(GRASPS, finding);
    }
    report
}

impl std::fmt::Display for Check {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.name, self.detail)
    }
}

impl ContractReport {
    fn add(&mut self, name: &'static str, finding: Finding) {
        let passed = finding.is_ok();
        let detail = match finding {
            Ok(text) | Err(text) => text,
        };
        self.checks.push(Check { name, passed, detail });
    }
}

fn with_sources(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        text.push_str(&format!(": {cause}"));
        source = cause.source();
    }
    text
}

fn scenes_load(task: &GraspTask, library: &Arc<MuJoCo>) -> Finding {
    for scene in &task.scenes {
        let again = Model::from_xml(library, &scene.scene.xml, &scene.scene.assets)
            .map_err(|error| format!("{}: {}", scene.object.name, with_sources(&error)))?;
        let sizes = |model: &Model| [model.nq(), model.nv(), model.nu(), model.nbody(), model.ngeom(), model.nsite()];
        if sizes(&again) != sizes(&scene.model) {
            return Err(format!("{}: a second compilation gives a model of another size", scene.object.name));
        }
    }
    let bytes: usize = task.scenes.iter().map(|s| s.scene.xml.len()).sum();
    Ok(format!("{} scenes, {} kB of MJCF", task.scenes.len(), bytes / 1000))
}

fn names_resolve(hand: &Hand, task: &GraspTask) -> Finding {
    let model = &task.scenes[0].model;
    let manifest = &hand.manifest;
    let missing =
        |what: &str, name: &str| format!("the hand names the {what} {name:?}, which the compiled scene lacks");
    model.body(&manifest.palm).map_err(|_| missing("body", &manifest.palm))?;
    for joint in hand.joints.iter().map(|joint| &joint.info).chain(&hand.posture) {
        let id = model.joint(&joint.name).map_err(|_| missing("joint", &joint.name))?;
        let compiled = model.joint_range(id);
        let same = match (compiled, joint.range()) {
            (Some(a), Some(b)) => (a.0 - b.0).abs() < 1e-6 && (a.1 - b.1).abs() < 1e-6,
            (a, b) => a.is_none() && b.is_none(),
        };
        if !same {
            return Err(format!(
                "joint {:?}: the hand's range is {:?}, but the compiled model's is {compiled:?}",
                joint.name,
                joint.range()
            ));
        }
    }
    for tip in &hand.fingertips {
        match tip.kind {
            FrameKind::Body => model.body(&tip.name).map(|_| ()).map_err(|_| missing("body", &tip.name))?,
            FrameKind::Site => model.site(&tip.name).map(|_| ()).map_err(|_| missing("site", &tip.name))?,
        }
    }
    let expected = hand.actuation().actuators;
    if task.actuators != expected {
        return Err(format!("actuators in the model: {:?}; expected {expected:?}", task.actuators));
    }
    let (joints, tips) = (hand.posture.len(), hand.fingertips.len());
    Ok(format!("{joints} joints, {} actuators, {tips} fingertips", task.actuators.len()))
}

fn open_posture_is_free(task: &Arc<GraspTask>) -> Finding {
    let mut env = GraspEnv::new(task).map_err(|error| with_sources(&error))?;
    env.start_open();
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    for (index, scene) in task.scenes.iter().enumerate() {
        for _ in 0..STARTS {
            env.reset(index, &mut random)
                .map_err(|error| format!("{}: {}", scene.object.name, with_sources(&error)))?;
            let at = &scene.addresses;
            let touching = env.simulation().contacts().find(|c| c.geoms.iter().any(|geom| at.is_hand[geom.index()]));
            if let Some(contact) = touching {
                let [a, b] = contact.geoms.map(|geom| describe(geom, scene));
                return Err(format!(
                    "{a} touches {b} at the start of an episode with the {} (depth {:.1} mm): change the open \
                     posture, the mount's height or slide.start, or exclude the pair of bodies from contact",
                    scene.object.name,
                    -1000.0 * contact.distance
                ));
            }
        }
    }
    Ok("no contact with the plane, an object or itself at the start".to_owned())
}

fn describe(geom: GeomId, scene: &ObjectScene) -> String {
    let (at, model) = (&scene.addresses, &scene.model);
    if geom == at.plane {
        return "the plane".to_owned();
    }
    if geom == at.object {
        return format!("the {}", scene.object.name);
    }
    match model.geom_name(geom) {
        name if name.is_empty() => format!("a geom of body {:?}", model.body_name(model.geom_body(geom))),
        name => format!("geom {name:?}"),
    }
}

fn actuators_move(hand: &Hand, task: &GraspTask) -> Finding {
    let scene = &task.scenes[0];
    let steps = (DRIVE_TIME / task.physics.timestep).ceil() as usize;
    let mut least: Option<(f64, &str)> = None;
    let mut skipped = Vec::new();
    for (index, name) in task.actuators.iter().enumerate() {
        let joints: Vec<&str> = if index == scene.addresses.slide_ctrl {
            vec![hand.manifest.slide.name.as_str()]
        } else {
            match hand.actuators.iter().find(|a| a.name == *name).map(|a| &a.transmission) {
                Some(Transmission::Joint(joint)) => vec![joint.as_str()],
                Some(Transmission::FixedTendon { terms, .. }) => {
                    terms.iter().map(|(joint, _)| joint.as_str()).collect()
                }
                _ => {
                    skipped.push(name.as_str());
                    continue;
                }
            }
        };
        let (low, high) = task.control_ranges[index];
        let mut ends = Vec::new();
        for command in [low, high] {
            let mut data = task.open_hand(scene).map_err(|error| with_sources(&error))?;
            data.ctrl_mut()[index] = command;
            (0..steps).for_each(|_| data.step());
            if !data.warnings().is_clear() {
                return Err(format!("actuator {name:?} at {command:.3}: MuJoCo warns {:?}", data.warnings()));
            }
            ends.push(data);
        }
        for joint in joints {
            let id = scene.model.joint(joint).map_err(|error| with_sources(&error))?;
            let address = scene.model.qpos_address(id);
            let moved = (ends[1].qpos()[address] - ends[0].qpos()[address]).abs();
            let range = scene.model.joint_range(id).map_or(UNLIMITED_RANGE, |(a, b)| b - a);
            let share = moved / range;
            if share.is_nan() || share < LEAST_MOVEMENT {
                return Err(format!(
                    "actuator {name:?} moves joint {joint:?} by only {:.1} % of the joint's range when its command goes \
                     from {low:.3} to {high:.3}: check its gain, its force limits and the joint's damping",
                    100.0 * share
                ));
            }
            if least.is_none_or(|(other, _)| share < other) {
                least = Some((share, joint));
            }
        }
    }
    let mut text = match least {
        Some((share, joint)) => format!("the least movement is {:.0} % of a joint's range ({joint})", 100.0 * share),
        None => "no actuator acts on a joint".to_owned(),
    };
    if !skipped.is_empty() {
        text.push_str(&format!("; not checked, because they act on no joint: {}", skipped.join(", ")));
    }
    Ok(text)
}

fn noise_is_quiet(task: &Arc<GraspTask>) -> Finding {
    let mut env = GraspEnv::new(task).map_err(|error| with_sources(&error))?;
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let steps = (NOISE_TIME / task.physics.control_period()).ceil() as usize;
    let mut action = vec![0.0; task.action_len()];
    for (index, scene) in task.scenes.iter().enumerate() {
        let at = |error: SimError| format!("with the {}: {}", scene.object.name, with_sources(&error));
        env.reset(index, &mut random).map_err(at)?;
        for _ in 0..steps {
            action.iter_mut().for_each(|a| *a = random.random_range(-1.0..=1.0));
            env.step(&action).map_err(at)?;
        }
        let warnings = env.warnings();
        if !warnings.is_clear() {
            return Err(format!("with the {}: MuJoCo warns {warnings:?}", scene.object.name));
        }
    }
    Ok(format!("{NOISE_TIME} s with each of {} objects", task.scenes.len()))
}

fn is_deterministic(task: &Arc<GraspTask>) -> Finding {
    let play = || -> Result<Vec<u32>, SimError> {
        let mut env = GraspEnv::new(task)?;
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let mut seen = Vec::new();
        let mut observation = vec![0.0; task.observation_len()];
        let mut action = vec![0.0; task.action_len()];
        env.reset(task.scenes.len() - 1, &mut random)?;
        for _ in 0..task.config.steps {
            action.iter_mut().for_each(|a| *a = random.random_range(-1.0..=1.0));
            env.step(&action)?;
            env.observe(&mut observation);
            seen.extend(observation.iter().map(|value| value.to_bits()));
        }
        Ok(seen)
    };
    let first = play().map_err(|error| with_sources(&error))?;
    let second = play().map_err(|error| with_sources(&error))?;
    match first.iter().zip(&second).position(|(a, b)| a != b) {
        Some(at) => Err(format!(
            "two simulations with the same seed differ from step {} on, first in {}",
            at / task.observation_len() + 1,
            task.observation_layout()[at % task.observation_len()].name
        )),
        None => Ok(format!("two simulations with the same seed agree to the last bit for {} steps", task.config.steps)),
    }
}
