//! A run in the forms in which other programs take it: NumPy, ONNX, ROS 2, motors.
//!
//! [`write()`] adds to an exported run what follows from its synergy and its policy: one archive for NumPy, the policy as an
//! ONNX graph, profiles and trajectories for ROS 2, a map from commands to motors, a README, and the digests of all files.
#![forbid(unsafe_code)]

mod error;
mod manifest;
mod numpy;
mod onnx;
mod readme;
mod ros2;

use std::path::{Path, PathBuf};

use eigenhand_files::{create_directory, write_atomically};
use eigenhand_hands::Hand;
use eigenhand_posture::ActuationMap;
use eigenhand_rl::{NormalizerConfig, Policy};
use eigenhand_synergy::{MotorMap, SynergyFile};

pub use error::BundleError;
use ros2::Ros2;

/// The map from a synergy's commands to motors, which its owner fills in.
pub const MOTORS: &str = "motors.toml";

/// What a bundle is made of.
pub struct Bundle<'a> {
    /// The hand.
    pub hand: &'a Hand,
    /// The control synergy, where the run has one.
    pub synergy: Option<&'a SynergyFile>,
    /// The policy.
    pub policy: &'a Policy,
    /// The limits at which the policy's inputs are clipped.
    pub normalizer: NormalizerConfig,
    /// Version of this program.
    pub version: &'a str,
}

/// Adds the files of a bundle to a directory with an exported run, and returns all files of the directory. A `motors.toml` that
/// is there stays as it is.
///
/// # Errors
/// [`BundleError`]: a file cannot be written, or the `motors.toml` that is there does not fit the synergy.
pub fn write(bundle: &Bundle, directory: &Path) -> Result<Vec<PathBuf>, BundleError> {
    let (hand, actuation) = (&bundle.hand.manifest.name, bundle.hand.actuation());
    let put = |name: &str, bytes: &[u8]| write_atomically(&directory.join(name), bytes);
    put("policy.onnx", &onnx::graph(bundle.policy, &bundle.normalizer, hand, bundle.version)?)?;
    if let Some(file) = bundle.synergy {
        put("synergy.npz", &numpy::archive(file)?)?;
        let motors = directory.join(MOTORS);
        if motors.exists() {
            MotorMap::read(&motors, file.synergy.joints())?;
        } else {
            put(MOTORS, motor_map(bundle.hand, &actuation, file).to_toml(hand)?.as_bytes())?;
        }
        if let Some(ros2) = Ros2::of(&actuation, file) {
            create_directory(&directory.join("ros2/trajectories"))?;
            put("ros2/grasp_profiles.yaml", ros2.profiles().as_bytes())?;
            for (name, trajectory) in ros2.trajectories() {
                put(&format!("ros2/trajectories/{name}.json"), &serde_json::to_vec_pretty(&trajectory)?)?;
            }
        }
    }
    put("README.md", readme::text(hand, bundle, directory).as_bytes())?;
    let mut files = manifest::write(bundle, directory)?;
    files.push(directory.join(manifest::NAME));
    files.extend(Some(directory.join(MOTORS)).filter(|motors| motors.exists()));
    Ok(files)
}

/// Returns the motors that take the commands as they are, with the joints that move with each: those on which the actuator acts,
/// and those that follow them.
fn motor_map(hand: &Hand, actuation: &ActuationMap, file: &SynergyFile) -> MotorMap {
    let moved = |actuator: &str| -> Vec<String> {
        let row = actuation.actuators.iter().position(|name| name == actuator).map(|i| &actuation.matrix[i]);
        let weights = row.into_iter().flatten();
        let driven = hand.posture.iter().zip(weights).filter(|(_, weight)| **weight != 0.0);
        let mut joints: Vec<String> = driven.map(|(joint, _)| joint.name.clone()).collect();
        // Followers of followers are found as the list grows.
        let mut next = 0;
        while let Some(driver) = joints.get(next).cloned() {
            let followers = hand.couplings.iter().filter(|coupling| coupling.driver.as_ref() == Some(&driver));
            let followers: Vec<String> = followers.map(|coupling| coupling.dependent.clone()).collect();
            joints.extend(followers.into_iter().filter(|name| !joints.contains(name)).collect::<Vec<_>>());
            next += 1;
        }
        joints
    };
    let actuators = file.synergy.joints();
    MotorMap::identity(actuators, &actuators.iter().map(|actuator| moved(&actuator.name)).collect::<Vec<_>>())
}
