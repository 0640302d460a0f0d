//! The exported directory: bit-identical numbers, clear errors, no incomplete directory.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use crate::common::{file, joints, postures};
use eigenhand_synergy::{JointMap, Moment, NamedGrasp, Recommended, Space, Synergy, SynergyFile, export, import};
use proptest::prelude::*;
use tempfile::TempDir;

const FILES: [&str; 6] =
    ["components.npy", "contribution.npy", "explained_variance.npy", "mean.npy", "postures.npy", "synergy.toml"];

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn entries(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn numbers_come_back_to_the_last_bit() {
    for (n_postures, n, k) in [(120, 25, 5), (2, 1, 1), (3, 9, 9)] {
        let parent = TempDir::new().unwrap();
        let dir = parent.path().join("deep/synergy");
        let (file, postures) = file(n_postures, n, k);
        export(&dir, &file, &postures).unwrap();
        assert_eq!(entries(&dir), FILES);
        assert_eq!(entries(dir.parent().unwrap()), ["synergy"]);
        let back = import(&dir).unwrap();
        let (a, b) = (&file.synergy, &back.file.synergy);
        assert_eq!(bits(a.components()), bits(b.components()));
        assert_eq!(bits(a.mean()), bits(b.mean()));
        assert_eq!(bits(a.eigenvalues()), bits(b.eigenvalues()));
        assert_eq!(bits(a.contribution()), bits(b.contribution()));
        assert_eq!(bits(a.coefficient_min()), bits(b.coefficient_min()));
        assert_eq!(bits(a.coefficient_max()), bits(b.coefficient_max()));
        assert_eq!(bits(&postures.concat()), bits(&back.samples.concat()));
        assert_eq!(back.file, file);
        let actuation = back.file.actuation.unwrap();
        assert_eq!(bits(&actuation.matrix[1]), bits(&vec![-0.0; n]));
        assert_eq!(bits(&actuation.offset), bits(&[1e-300, -1.5]));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_numbers_survive_toml(
        rows in prop::collection::vec(prop::collection::vec(-1e9..1e9f64, 3), 2..12),
        offsets in prop::collection::vec(prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO, 2),
        hand in ".*",
        key in ".*",
    ) {
        let (mut file, _) = file(10, 3, 2);
        file.synergy = Synergy::fit(&joints(3), &rows, 2).unwrap();
        file.actuation.as_mut().unwrap().offset = offsets.clone();
        file.hand = hand;
        file.provenance.insert(key.clone(), key);
        let text = file.to_toml().unwrap();
        let back = SynergyFile::from_toml(&text).unwrap();
        prop_assert_eq!(bits(back.synergy.components()), bits(file.synergy.components()));
        prop_assert_eq!(bits(&back.actuation.as_ref().unwrap().offset), bits(&offsets));
        prop_assert_eq!(&back, &file);
        prop_assert_eq!(back.to_toml().unwrap(), text);
    }
}

#[test]
fn an_earlier_export_is_replaced_and_anything_else_is_not() {
    let parent = TempDir::new().unwrap();
    let dir = parent.path().join("synergy");
    let (first, postures_first) = file(10, 3, 2);
    let (second, postures_second) = file(20, 4, 3);
    export(&dir, &first, &postures_first).unwrap();
    export(&dir, &second, &postures_second).unwrap();
    assert_eq!(import(&dir).unwrap().file, second);
    assert_eq!(entries(parent.path()), ["synergy"]);

    fs::write(dir.join("thesis.tex"), "years of work").unwrap();
    let message = export(&dir, &first, &postures_first).unwrap_err().to_string();
    assert!(message.contains("thesis.tex"), "{message}");
    assert_eq!(fs::read_to_string(dir.join("thesis.tex")).unwrap(), "years of work");
    assert_eq!(import(&dir).unwrap().file, second);
    assert_eq!(entries(parent.path()), ["synergy"]);

    let plain = parent.path().join("plain");
    fs::write(&plain, "a file").unwrap();
    export(&plain, &first, &postures_first).unwrap_err();
    assert_eq!(fs::read_to_string(&plain).unwrap(), "a file");
}

#[test]
fn what_cannot_be_exported_leaves_no_trace() {
    let parent = TempDir::new().unwrap();
    let dir = parent.path().join("synergy");
    let (file, mut rows) = file(10, 3, 2);
    let message = export(&dir, &file, &rows[..9]).unwrap_err().to_string();
    assert!(message.contains("expected 10") && message.contains("got 9"), "{message}");
    rows[3][0] = f64::NAN;
    export(&dir, &file, &rows).unwrap_err();

    let mut wrong = file.clone();
    wrong.actuation.as_mut().unwrap().matrix.pop();
    export(&dir, &wrong, &postures(10, 3)).unwrap_err();
    assert!(entries(parent.path()).is_empty());
}

/// Returns the text of a small file with round numbers; tests damage it by replacing text.
fn plain_file() -> String {
    let joints = &joints(2);
    let file = SynergyFile {
        hand: "h".to_owned(),
        space: Space::Postures,
        synergy: Synergy::fit(joints, &[[0.0, 0.0], [2.0, 0.0], [1.0, 0.0]], 2).unwrap(),
        joint_map: None,
        actuation: None,
        recommended: None,
        grasps: Vec::new(),
        provenance: [("by".to_owned(), "test".to_owned())].into(),
    };
    file.to_toml().unwrap()
}

#[test]
fn the_text_is_what_a_person_expects() {
    let text = plain_file();
    let body: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
    let expected = r#"
schema = 2
hand = "h"
space = "postures"
n_postures = 3
joints = [
    { name = "FFJ3", unit = "rad", lower = -2.0, upper = 2.5 },
    { name = "ffj3", unit = "rad", lower = -2.3333333333333335, upper = 2.642857142857143 },
]
mean = [1.0, 0.0]
components = [
    [1.0, 0.0],
    [0.0, 1.0],
]
explained_variance = [1.0, 0.0]
contribution = [1.0, 0.0]
coefficient_min = [-1.0, 0.0]
coefficient_max = [1.0, 0.0]
total_variance = 1.0
eigenvalues = [1.0, 0.0]

[provenance]
by = "test"
"#;
    assert_eq!(body.join("\n").trim(), expected.trim());
}

#[test]
fn a_space_of_commands_comes_back_with_its_joint_map() {
    let parent = TempDir::new().unwrap();
    let dir = parent.path().join("synergy");
    let (commands, measured) = (postures(40, 3), postures(40, 5));
    let synergy = Synergy::fit(&joints(3), &commands, 2).unwrap();
    let joint_map = JointMap::fit(&synergy, &commands, &joints(5), &measured).unwrap();
    let file = SynergyFile {
        hand: "h".to_owned(),
        space: Space::Commands,
        synergy,
        joint_map: Some(joint_map),
        actuation: None,
        recommended: Some(Recommended { components: 2, reason: "two succeed".to_owned() }),
        grasps: vec![NamedGrasp {
            numbers: 2,
            object: "cube".to_owned(),
            motions: 4,
            open: Moment { z: vec![0.1, -0.2], q: vec![0.0; 5] },
            closed: Moment { z: vec![1.0 / 3.0, 0.2], q: vec![0.5; 5] },
            held: Moment { z: vec![0.4, 0.2], q: vec![0.6; 5] },
        }],
        provenance: BTreeMap::new(),
    };
    export(&dir, &file, &commands).unwrap();
    let back = import(&dir).unwrap();
    assert_eq!((back.file, back.samples), (file.clone(), commands));
    let text = file.to_toml().unwrap();
    for (from, to, part) in [
        ("[joint_map]", "[joint_map]\nunknown = 1", ""),
        ("recommended_components = 2", "recommended_components = 9", "recommended_components"),
        ("actuators = [", "actuator = [", "actuators"),
        ("n_commands = 40", "", "n_commands"),
        ("z = [0.4, 0.2]", "z = [0.4]", "grasps[0].held.z"),
    ] {
        assert!(text.contains(from), "{from}");
        match SynergyFile::from_toml(&text.replacen(from, to, 1)) {
            Ok(_) => assert_eq!(part, "", "{from} -> {to}"),
            Err(error) => assert!(error.to_string().contains(part), "{error}"),
        }
    }
}

#[test]
fn malformed_files_are_refused_by_name() {
    let good = plain_file();
    SynergyFile::from_toml(&good).unwrap();
    for (from, to, parts) in [
        ("schema = 2", "schema = 1", &["schema 1", "schema 2"][..]),
        ("schema = 2", "", &["schema"]),
        ("schema = 2", "schema = = 2", &["TOML"]),
        ("space = \"postures\"", "space = \"commands\"", &["actuators"]),
        ("n_postures = 3", "n_postures = 3\nrecommended_components = 3", &["recommended_components", "1 to 2"]),
        ("mean = [1.0, 0.0]", "", &["mean"]),
        ("mean = [1.0, 0.0]", "mean = [1.0]", &["length of mean", "expected 2", "got 1"]),
        ("mean = [1.0, 0.0]", "mean = [1.0, nan]", &["mean[1]", "finite", "NaN"]),
        ("mean = [1.0, 0.0]", "mean = [1.0, \"x\"]", &["string \"x\""]),
        ("    [0.0, 1.0],\n", "    [0.0],\n", &["length of components[1]"]),
        ("    [0.0, 1.0],\n", "    [0.0, 1.1],\n", &["components[1] . components[1]", "orthonormal"]),
        ("    [0.0, 1.0],\n", "    [0.1, 0.99498743710662],\n", &["components[1] . components[0]"]),
        ("    [1.0, 0.0],\n    [0.0, 1.0],\n", "", &["components", "1 to 2 rows"]),
        ("eigenvalues = [1.0, 0.0]", "eigenvalues = [1.0, -0.5]", &["eigenvalues[1]", "0 or more"]),
        ("eigenvalues = [1.0, 0.0]", "eigenvalues = [0.0, 1.0]", &["eigenvalues[1]", "the one before it"]),
        ("explained_variance = [1.0, 0.0]", "explained_variance = [0.5, 0.0]", &["explained_variance[0]"]),
        ("contribution = [1.0, 0.0]", "contribution = [0.9, 0.0]", &["contribution[0]", "expected 1"]),
        ("total_variance = 1.0", "total_variance = 2.0", &["total_variance[0]"]),
        ("coefficient_min = [-1.0, 0.0]", "coefficient_min = [3.0, 0.0]", &["coefficient_min[0]", "at most"]),
        ("unit = \"rad\"", "unit = \"deg\"", &["deg", "rad"]),
        ("name = \"ffj3\"", "name = \"FFJ3\"", &["FFJ3", "twice"]),
        ("n_postures = 3", "n_postures = -3", &["n_postures"]),
    ] {
        assert!(good.contains(from), "{from}");
        let message = SynergyFile::from_toml(&good.replacen(from, to, 1)).unwrap_err().to_string();
        for part in parts {
            assert!(message.contains(part), "{from} -> {to}: {message}");
        }
    }
    // Whole numbers written by hand are numbers.
    let whole = good.replace("mean = [1.0, 0.0]", "mean = [1, 0]");
    assert_eq!(SynergyFile::from_toml(&whole).unwrap().synergy.mean(), [1.0, 0.0]);
}

#[test]
fn damaged_directories_are_refused_by_file() {
    let parent = TempDir::new().unwrap();
    let dir = parent.path().join("synergy");
    let (file, postures) = file(10, 3, 2);
    for name in FILES {
        export(&dir, &file, &postures).unwrap();
        let whole = fs::read(dir.join(name)).unwrap();
        fs::write(dir.join(name), &whole[..whole.len() - 9]).unwrap();
        let message = import(&dir).unwrap_err().to_string();
        if name != "synergy.toml" {
            assert!(message.contains(name), "{message}");
        }
        fs::remove_file(dir.join(name)).unwrap();
        let message = import(&dir).unwrap_err().to_string();
        assert!(message.contains(name), "{message}");
    }
    // An array of another export.
    export(&dir, &file, &postures).unwrap();
    let mut bytes = fs::read(dir.join("mean.npy")).unwrap();
    let last = bytes.len() - 8;
    bytes[last] ^= 1;
    fs::write(dir.join("mean.npy"), &bytes).unwrap();
    let message = import(&dir).unwrap_err().to_string();
    assert!(message.contains("mean.npy, number 2"), "{message}");
    fs::copy(dir.join("components.npy"), dir.join("mean.npy")).unwrap();
    let message = import(&dir).unwrap_err().to_string();
    assert!(message.contains("shape of mean.npy") && message.contains("[2, 3]"), "{message}");
}

/// Checks in NumPy, from the files alone: shapes, types, and the definition of the error.
const SCRIPT: &str = r#"
import sys, numpy as np
load = lambda name: np.load(f"{sys.argv[1]}/{name}.npy")
c, m, v, r, p = map(load, ["components", "mean", "explained_variance", "contribution", "postures"])
assert all(a.dtype == np.dtype("<f8") and a.flags.c_contiguous for a in (c, m, v, r, p))
assert c.shape == (5, 25) and m.shape == (25,) and v.shape == (5,) and r.shape == (5,) and p.shape == (120, 25)
assert np.allclose(c @ c.T, np.eye(5), atol=1e-12)
assert np.allclose(p.mean(axis=0), m, atol=1e-13)
d = p - m
assert np.allclose(np.var(d @ c.T, axis=0, ddof=1), v, rtol=1e-10)
assert np.allclose(v / np.var(d, axis=0, ddof=1).sum(), r, rtol=1e-10)
print(repr(float(np.linalg.norm(d - d @ c.T @ c, axis=1).mean())))
"#;

#[test]
fn numpy_reads_the_arrays() {
    let python = std::env::var("EIGENHAND_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let probe = Command::new(&python).args(["-c", "import numpy"]).output();
    if !probe.is_ok_and(|output| output.status.success()) {
        assert!(std::env::var_os("EIGENHAND_PYTHON_REQUIRED").is_none(), "{python} cannot import numpy");
        println!("skipped: {python} cannot import numpy; set EIGENHAND_PYTHON to another interpreter");
        return;
    }
    let parent = TempDir::new().unwrap();
    let dir = parent.path().join("synergy");
    let (file, postures) = file(120, 25, 5);
    export(&dir, &file, &postures).unwrap();
    let output = Command::new(&python).args(["-c", SCRIPT]).arg(&dir).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mean_error: f64 = String::from_utf8(output.stdout).unwrap().trim().parse().unwrap();
    assert!((mean_error - file.synergy.mean_error(&postures)).abs() < 1e-12);
}
