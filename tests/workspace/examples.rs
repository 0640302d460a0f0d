//! The examples in Python, C++ and Rust compute the same numbers.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use eigenhand_synergy::SynergyFile;
use tempfile::TempDir;

use crate::support::{python, python_has, workspace};

/// Names CMake. Without it, `cmake` is searched, and the C++ example is skipped where there is none.
const CMAKE: &str = "EIGENHAND_CMAKE";
/// Largest difference between two languages, in rad, m or units of a number.
const TOLERANCE: f64 = 1e-9;
const OBJECT: &str = "cube";

/// Runs a control loop and returns its lines: names, and the number at the end.
fn numbers(command: &mut Command, synergy: &Path) -> Vec<(String, f64)> {
    let output = command.arg(synergy).arg(OBJECT).output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    let printed = String::from_utf8(output.stdout).unwrap();
    let lines = printed.lines().map(|line| line.rsplit_once(' ').unwrap());
    lines.map(|(name, number)| (name.to_owned(), number.parse().unwrap())).collect()
}

fn assert_same(found: &[(String, f64)], expected: &[(String, f64)], language: &str) {
    assert_eq!(found.len(), expected.len(), "{language}");
    for ((name, number), (expected_name, expected)) in found.iter().zip(expected) {
        assert_eq!(name, expected_name, "{language}");
        assert!((number - expected).abs() < TOLERANCE, "{language}: {name} is {number}, and {expected} in Rust");
    }
}

/// Returns the program of the Rust example, which Cargo builds with the tests.
fn rust_example() -> Command {
    let test = std::env::current_exe().unwrap();
    let built = test.ancestors().nth(2).unwrap();
    Command::new(built.join("examples/control_loop"))
}

#[test]
fn control_loops_in_python_cpp_and_rust_command_the_same() {
    let synergy = workspace().join("synergies/shadow");
    let expected = numbers(&mut rust_example(), &synergy);
    let file = SynergyFile::read(synergy.join("synergy.toml")).unwrap();
    let joint_map = file.joint_map.unwrap();
    assert_eq!(joint_map.free, ["slide"], "the arm does not count in a measured posture");
    let (n, m, k) = (file.synergy.n_joints(), joint_map.joints.len(), file.synergy.n_components());
    // The numbers of both parts' ends, and those of the measured posture.
    assert_eq!(expected.len(), 4 * (n + m) + k);
    let grasp = file.grasps.iter().find(|grasp| grasp.object == OBJECT && grasp.numbers == k).unwrap();
    let held = file.synergy.decode(&grasp.held.z);
    let printed: Vec<f64> =
        expected.iter().filter(|(name, _)| name.starts_with("held command")).map(|(_, number)| *number).collect();
    assert!(printed.iter().zip(&held).all(|(a, b)| (a - b).abs() < TOLERANCE) && printed.len() == n, "{printed:?}");

    if python_has("numpy") {
        let script = workspace().join("examples/python/control_loop.py");
        assert_same(&numbers(Command::new(python()).arg(script), &synergy), &expected, "Python");
    }
    let Some(cmake) = cmake() else {
        let _ = writeln!(std::io::stderr(), "skipped: no cmake; install it, or name it in {CMAKE}");
        return;
    };
    let build = TempDir::new().unwrap();
    let source = workspace().join("examples/cpp");
    for arguments in [
        vec!["-S".into(), source.into_os_string(), "-B".into(), build.path().into(), "-DCMAKE_BUILD_TYPE=Debug".into()],
        vec!["--build".into(), build.path().into()],
    ] {
        let output = Command::new(&cmake).args(&arguments).output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "cmake {arguments:?}: {errors}");
    }
    assert_same(&numbers(&mut Command::new(build.path().join("control_loop")), &synergy), &expected, "C++");
}

fn cmake() -> Option<PathBuf> {
    match std::env::var_os(CMAKE) {
        Some(path) => Some(path.into()),
        None => Command::new("cmake").arg("--version").output().is_ok().then(|| "cmake".into()),
    }
}
