//! A run in the forms in which other programs take it: NumPy, ONNX, ROS 2, motors.
//!
//! [`export`] adds to an exported run what follows from its synergy and its policy: one archive for NumPy, the policy as an
//! ONNX graph, profiles and trajectories for ROS 2, a map from commands to motors, a README, and the digests of all files.
#![forbid(unsafe_code)]

mod error;
mod manifest;
mod numpy;
mod onnx;
mod readme;
mod ros2;

use std::path::{Path, PathBuf};

use eigenhand_files::{cannot, create_directory, write_atomically};
use eigenhand_hands::Hand;
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

/// An export that was written.
#[derive(Debug)]
pub struct Exported {
    /// All its files.
    pub files: Vec<PathBuf>,
    /// What its owner should know.
    pub notes: Vec<String>,
}

/// Writes an export into a directory: what `write_run` writes of a run, and the files of the bundle. A `motors.toml` that is there
/// stays as it is; files of an earlier export that changed since get the suffix `.edited`, and the others are replaced.
///
/// Everything is written beside the directory first, so an error leaves an earlier export as it was.
///
/// # Errors
/// Those of `write_run`. [`BundleError::Synergy`] for a `motors.toml` that does not fit the synergy, [`BundleError::File`].
pub fn export<E: From<BundleError>>(
    bundle: &Bundle,
    directory: &Path,
    write_run: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<Exported, E> {
    let motors = directory.join(MOTORS);
    let mut notes = Vec::new();
    if let (Some(file), true) = (bundle.synergy, motors.exists()) {
        let hand = &bundle.hand.manifest.name;
        let map = MotorMap::read(&motors, hand, file.synergy.joints()).map_err(BundleError::from)?;
        notes.extend(map.limited().into_iter().map(|(motor, share)| {
            let percent = 100.0 * share;
            format!("{MOTORS}: motor {} reaches {percent:.0} % of the range of {}", motor.id, motor.actuator)
        }));
    }
    let complete = std::path::absolute(directory).map_err(cannot("find", directory)).map_err(BundleError::from)?;
    let parent = complete.parent().unwrap_or(&complete);
    create_directory(parent).map_err(BundleError::from)?;
    let staging = tempfile::Builder::new().prefix(".export-").tempdir_in(parent);
    let staging = staging.map_err(cannot("make a directory in", parent)).map_err(BundleError::from)?;
    write_run(staging.path())?;
    if motors.exists() {
        let kept = staging.path().join(MOTORS);
        std::fs::copy(&motors, &kept).map_err(cannot("copy", &motors)).map_err(BundleError::from)?;
    }
    write(bundle, staging.path())?;
    notes.extend(manifest::replace(directory, staging.path())?);
    Ok(Exported { files: manifest::files(directory)?, notes })
}

/// Adds the files of a bundle to a directory with an exported run. A `motors.toml` that is there stays as it is.
fn write(bundle: &Bundle, directory: &Path) -> Result<(), BundleError> {
    let (hand, actuation) = (&bundle.hand.manifest.name, bundle.hand.actuation());
    let put = |name: &str, bytes: &[u8]| write_atomically(&directory.join(name), bytes);
    put("policy.onnx", &onnx::graph(bundle.policy, &bundle.normalizer, hand, bundle.version)?)?;
    let mut example = None;
    if let Some(file) = bundle.synergy {
        put("synergy.npz", &numpy::archive(file)?)?;
        if !directory.join(MOTORS).exists() {
            put(MOTORS, motor_map(bundle.hand, file).to_toml(hand)?.as_bytes())?;
        }
        if let Some(ros2) = Ros2::of(&actuation, file) {
            create_directory(&directory.join("ros2/trajectories"))?;
            put("ros2/grasp_profiles.yaml", ros2.profiles().as_bytes())?;
            for (name, trajectory) in ros2.trajectories() {
                put(&format!("ros2/trajectories/{name}.json"), &serde_json::to_vec_pretty(&trajectory)?)?;
                example = example.or(Some(name));
            }
        }
    }
    put("README.md", readme::text(bundle, directory, example.as_deref()).as_bytes())?;
    manifest::write(bundle, directory)
}

/// Returns the motors that take the commands as they are, with the joints that move with each.
fn motor_map(hand: &Hand, file: &SynergyFile) -> MotorMap {
    let actuators = file.synergy.joints();
    let joints: Vec<Vec<String>> =
        actuators.iter().map(|actuator| hand.joints_moved_by(&actuator.name).unwrap_or_default()).collect();
    MotorMap::identity(actuators, &joints)
}
