//! What comes from outside, as functions that read bytes as a file of one kind. Each has to return: an error is right for bytes
//! that are no such file, and a panic, an endless loop or memory without bound is a defect.
//!
//! The fuzzer feeds them, and a test of the workspace feeds them the kept files of `corpus/`.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use eigenhand_hands::{Hand, HandSummary, ImportOptions, import};
use eigenhand_rl::{EpisodeData, NormalizerConfig, Policy, TensorMap};
use eigenhand_synergy::{MotorMap, SynergyFile, read_matrix};
use tempfile::TempDir;

/// A reader of bytes, which tells whether they were such a file.
pub type Input = fn(&[u8]) -> bool;

/// Each kind of file, by the name of its fuzz target and of its directory in `corpus/`.
pub const INPUTS: [(&str, Input); 13] = [
    ("manifest", manifest),
    ("mjcf", mjcf),
    ("urdf", urdf),
    ("stl", stl),
    ("obj", obj),
    ("collada", collada),
    ("npy", npy),
    ("synergy", synergy),
    ("motors", motors),
    ("policy", policy),
    ("replay", replay),
    ("checkpoint", checkpoint),
    ("metrics", metrics),
];

const MANIFEST: &str = include_str!("../../plugins/parallel/hand.toml");
const MODEL: &str = include_str!("../../plugins/parallel/parallel.xml");
const ROBOT: &str = r#"<robot name="claw">
  <link name="palm"><collision><geometry><mesh filename="MESH"/></geometry></collision></link>
  <link name="finger"><collision><geometry><mesh filename="MESH" scale="0.1 0.1 0.1"/></geometry></collision></link>
  <joint name="bend" type="revolute"><parent link="palm"/><child link="finger"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
</robot>"#;

/// Reads a manifest `hand.toml` beside a good model.
pub fn manifest(bytes: &[u8]) -> bool {
    hand(bytes, MODEL.as_bytes())
}

/// Reads an MJCF file as a hand's own model, and imports it.
pub fn mjcf(bytes: &[u8]) -> bool {
    let is_hand = hand(MANIFEST.as_bytes(), bytes);
    imported("import", "robot.xml", bytes) || is_hand
}

/// Imports a URDF file.
pub fn urdf(bytes: &[u8]) -> bool {
    imported("import", "robot.urdf", bytes)
}

/// Imports a URDF whose links have an STL mesh.
pub fn stl(bytes: &[u8]) -> bool {
    mesh("mesh.stl", bytes)
}

/// Imports a URDF whose links have a Wavefront OBJ mesh.
pub fn obj(bytes: &[u8]) -> bool {
    mesh("mesh.obj", bytes)
}

/// Imports a URDF whose links have a COLLADA mesh.
pub fn collada(bytes: &[u8]) -> bool {
    mesh("mesh.dae", bytes)
}

/// Reads a matrix.
pub fn npy(bytes: &[u8]) -> bool {
    let file = place("npy").join("matrix.npy");
    write(&file, bytes);
    let Ok(rows) = read_matrix(&file) else { return false };
    assert!(rows.iter().all(|row| row.len() == rows[0].len()), "rows of one length");
    true
}

/// Reads a `synergy.toml`, and uses it.
pub fn synergy(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    let Ok(file) = SynergyFile::from_toml(text) else { return false };
    let numbers = vec![0.5; file.synergy.n_components()];
    let decoded = file.synergy.decode(&numbers);
    assert_eq!(file.synergy.encode(&decoded).len(), numbers.len());
    if let Some(map) = &file.joint_map {
        let _ = map.encode(&map.decode(&numbers));
    }
    if let Ok(again) = file.to_toml() {
        assert!(SynergyFile::from_toml(&again).is_ok(), "what it writes can be read");
    }
    true
}

/// Reads a `motors.toml` for the actuators of the synergy in the corpus.
pub fn motors(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    let known = include_str!("../corpus/synergy/small.toml");
    let Ok(SynergyFile { synergy, hand, .. }) = SynergyFile::from_toml(known) else { return false };
    let Ok(map) = MotorMap::from_toml(text, &hand, synergy.joints()) else { return false };
    let values = map.values(&vec![0.1; synergy.joints().len()]);
    assert_eq!(map.commands(&values).len(), synergy.joints().len());
    true
}

/// Reads a policy from safetensors, and lets it act.
pub fn policy(bytes: &[u8]) -> bool {
    let Ok(tensors) = TensorMap::load_bytes(bytes) else { return false };
    let Ok(policy) =
        Policy::import_tensors(&tensors, &NormalizerConfig { epsilon: 1e-2, norm_clip: 5.0, raw_clip: 200.0 })
    else {
        return false;
    };
    let mut action = vec![0.0; policy.act_dim()];
    policy.act(&vec![0.1; policy.obs_dim()], &vec![0.1; policy.goal_dim()], &mut policy.scratch(), &mut action);
    true
}

/// Reads the episodes of a replay file, of which the last has the checksum of its bytes.
pub fn replay(bytes: &[u8]) -> bool {
    let mut bytes = bytes.to_vec();
    if let Some(end) = bytes.len().checked_sub(8) {
        let digest = eigenhand_files::sha256(&bytes[..end]);
        let sum = u64::from_str_radix(&digest[..16], 16).expect("hexadecimal digits");
        bytes[end..].copy_from_slice(&sum.to_be_bytes());
    }
    let mut rest = bytes.as_slice();
    while let Ok((episode, after)) = EpisodeData::read_prefix(rest) {
        assert!(after.len() < rest.len(), "an episode has bytes");
        assert!(episode.validate().is_ok() && episode.to_bytes().is_ok(), "what is read can be written");
        rest = after;
    }
    rest.len() < bytes.len()
}

/// Reads the record of a checkpoint, behind a digest that agrees with it.
pub fn checkpoint(bytes: &[u8]) -> bool {
    let run = place("checkpoint");
    let record = run.join("checkpoints/episode-00000001/state.toml");
    let digest = format!("digest = \"{}\"\n", eigenhand_files::sha256(bytes));
    write(&record, &[digest.as_bytes(), bytes].concat());
    write(&record.with_file_name("learner.safetensors"), include_bytes!("../corpus/policy/small.safetensors"));
    eigenhand_train::newest_learner(&run).is_ok()
}

/// Reads `metrics.csv`.
pub fn metrics(bytes: &[u8]) -> bool {
    let run = place("metrics");
    write(&run.join("metrics.csv"), bytes);
    eigenhand_train::read_metrics(&run).is_ok_and(|rows| !rows.is_empty())
}

fn hand(manifest: &[u8], model: &[u8]) -> bool {
    let directory = place("hand");
    write(&directory.join("hand.toml"), manifest);
    write(&directory.join("parallel.xml"), model);
    let Ok(hand) = Hand::load(&directory) else { return false };
    let commands = hand.actuation().control(&hand.open_posture_vector());
    assert!(commands.iter().all(|command| command.is_finite()));
    assert!(!HandSummary::of(&hand).name.is_empty());
    true
}

fn mesh(name: &str, bytes: &[u8]) -> bool {
    write(&place("mesh").join("robot.urdf"), ROBOT.replace("MESH", name).as_bytes());
    let file = place("mesh").join(name);
    write(&file, bytes);
    import(&place("mesh").join("robot.urdf"), &ImportOptions::default(), &mut Vec::new()).is_ok()
}

fn imported(directory: &str, name: &str, bytes: &[u8]) -> bool {
    let file = place(directory).join(name);
    write(&file, bytes);
    import(&file, &ImportOptions::default(), &mut Vec::new()).is_ok()
}

/// Returns a directory of this process, which is in memory where there is such a place.
fn place(name: &str) -> PathBuf {
    static PLACE: OnceLock<TempDir> = OnceLock::new();
    let place = PLACE.get_or_init(|| {
        let memory = Path::new("/dev/shm");
        let made = if memory.is_dir() { TempDir::new_in(memory) } else { TempDir::new() };
        made.expect("a temporary directory")
    });
    place.path().join(name)
}

fn write(file: &Path, bytes: &[u8]) {
    fs::create_dir_all(file.parent().expect("a parent")).expect("a directory");
    fs::write(file, bytes).expect("a file");
}
