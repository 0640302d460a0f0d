//! The edges between the crates, as ARCHITECTURE.md states them.

use std::collections::{BTreeMap, BTreeSet};

use cargo_metadata::{Metadata, MetadataCommand};

use crate::source;
use crate::support::workspace;

/// Every crate, with the crates of this workspace on which it may depend for any purpose.
const ALLOWED: [(&str, &[&str]); 18] = [
    ("eigenhand-hand-abi", &[]),
    ("eigenhand-files", &[]),
    ("eigenhand-font", &[]),
    ("eigenhand-posture", &[]),
    ("eigenhand-mujoco", &[]),
    ("eigenhand-hands", &["eigenhand-files", "eigenhand-hand-abi", "eigenhand-posture"]),
    ("eigenhand-sim", &["eigenhand-files", "eigenhand-hands", "eigenhand-mujoco"]),
    ("eigenhand-render", &["eigenhand-font", "eigenhand-hands", "eigenhand-mujoco", "eigenhand-sim"]),
    (
        "eigenhand-onboard",
        &["eigenhand-files", "eigenhand-hands", "eigenhand-mujoco", "eigenhand-render", "eigenhand-sim"],
    ),
    ("eigenhand-rl", &[]),
    ("eigenhand-synergy", &["eigenhand-posture"]),
    ("eigenhand-reducers", &["eigenhand-rl", "eigenhand-synergy"]),
    (
        "eigenhand-train",
        &[
            "eigenhand-files",
            "eigenhand-hands",
            "eigenhand-mujoco",
            "eigenhand-rl",
            "eigenhand-sim",
            "eigenhand-synergy",
        ],
    ),
    (
        "eigenhand-bench",
        &[
            "eigenhand-hands",
            "eigenhand-mujoco",
            "eigenhand-rl",
            "eigenhand-sim",
            "eigenhand-synergy",
            "eigenhand-train",
        ],
    ),
    ("eigenhand-report", &["eigenhand-files", "eigenhand-font", "eigenhand-synergy", "eigenhand-train"]),
    (
        "eigenhand-explore",
        &["eigenhand-hands", "eigenhand-mujoco", "eigenhand-render", "eigenhand-sim", "eigenhand-synergy"],
    ),
    (
        "eigenhand-bundle",
        &["eigenhand-files", "eigenhand-hands", "eigenhand-posture", "eigenhand-rl", "eigenhand-synergy"],
    ),
    (
        "eigenhand-cli",
        &[
            "eigenhand-bench",
            "eigenhand-bundle",
            "eigenhand-explore",
            "eigenhand-files",
            "eigenhand-hands",
            "eigenhand-mujoco",
            "eigenhand-onboard",
            "eigenhand-reducers",
            "eigenhand-render",
            "eigenhand-report",
            "eigenhand-sim",
            "eigenhand-synergy",
            "eigenhand-train",
            // Its library must be built beside the program that the tests run.
            "eigenhand-hand-parametric",
        ],
    ),
];

/// The developers' command line. It depends on the compiled plugin so that the plugin's library is built beside it.
const XTASK: (&str, &[&str]) = (
    "xtask",
    &["eigenhand-cli", "eigenhand-files", "eigenhand-hands", "eigenhand-hand-parametric", "eigenhand-synergy"],
);

/// The package that may depend on all others, because it tests them together.
const TESTS: &str = "eigenhand-tests";

const MARK: &str = "**Invariant:**";

/// A sentence of ARCHITECTURE.md after its mark, and the check that enforces it.
type Invariant = (&'static str, fn(&Graph));

const INVARIANTS: [Invariant; 17] = [
    ("`hand-abi` depends on nothing.", |g| {
        assert_eq!(g.all("eigenhand-hand-abi"), BTreeSet::new());
    }),
    ("`hands` does not know MuJoCo's library, the simulator or learning.", |g| {
        g.lacks("eigenhand-hands", &["eigenhand-mujoco", "eigenhand-sim", "eigenhand-rl", "eigenhand-train"]);
        lacks_word("crates/hands/src", "mujoco_sys");
        lacks_word("crates/hands/src", "mj_loadXML");
    }),
    (
        "`hands` opens a library only for the registry, from a place of plugins or a directory that the user named.",
        |_| source::check_openers(),
    ),
    ("`mujoco` knows no hand, no scene and no task.", |g| {
        assert_eq!(g.internal("eigenhand-mujoco"), BTreeSet::new());
        for word in ["hand", "grasp", "finger", "episode"] {
            lacks_word("crates/mujoco/src", word);
        }
    }),
    ("`sim` does not know of learning, replay or synergies.", |g| {
        g.lacks("eigenhand-sim", &["eigenhand-rl", "eigenhand-synergy", "eigenhand-train"]);
    }),
    ("`onboard` needs no learner.", |g| {
        g.lacks("eigenhand-onboard", &["eigenhand-rl", "eigenhand-synergy", "eigenhand-train"]);
    }),
    ("`explore` does not know of learning.", |g| {
        g.lacks("eigenhand-explore", &["eigenhand-rl", "eigenhand-train"]);
    }),
    ("`bundle` does not know of simulation or training.", |g| {
        g.lacks("eigenhand-bundle", &["eigenhand-mujoco", "eigenhand-sim", "eigenhand-train"]);
    }),
    ("`rl` does not know of MuJoCo, hands or grasping.", |g| {
        g.lacks("eigenhand-rl", &["eigenhand-hands", "eigenhand-mujoco", "eigenhand-sim", "libloading", "xmltree"]);
        for word in ["mujoco", "hand", "grasp", "object", "finger"] {
            lacks_word("crates/rl/src", word);
        }
    }),
    ("`rl` reads and writes no file.", |_| {
        for word in ["fs", "File", "OpenOptions"] {
            lacks_word("crates/rl/src", word);
        }
    }),
    ("`synergy` does not know of learning, simulation or any hand.", |g| {
        assert_eq!(g.internal("eigenhand-synergy"), BTreeSet::from(["eigenhand-posture".to_owned()]));
        for word in ["reward", "penalty", "learner", "replay"] {
            lacks_word("crates/synergy/src", word);
        }
    }),
    ("`train` alone makes the learner act in the simulator; `bench` measures how fast it does.", |g| {
        let all = ALLOWED.iter().chain([&XTASK]);
        for (name, _) in all {
            let direct = g.internal(name);
            let both = direct.contains("eigenhand-sim") && direct.contains("eigenhand-rl");
            assert_eq!(both, ["eigenhand-train", "eigenhand-bench"].contains(name), "{name} depends on {direct:?}");
        }
    }),
    ("`report` neither simulates nor learns: it reads what runs left behind.", |g| {
        g.lacks("eigenhand-report", &["eigenhand-sim", "eigenhand-mujoco", "eigenhand-rl", "eigenhand-hands"]);
        for word in ["trainer", "workerpool", "rundirectory"] {
            lacks_word("crates/report/src", word);
        }
    }),
    ("`cli` parses, calls and prints: it reaches the learner through `train` alone.", |g| {
        g.lacks("eigenhand-cli", &["eigenhand-rl"]);
    }),
    ("`xtask` has no command of a user's of its own: it forwards to `cli`.", |g| {
        g.lacks("xtask", &["eigenhand-mujoco", "eigenhand-sim", "eigenhand-rl", "eigenhand-train", "eigenhand-report"]);
        lacks_word("xtask/src", "eigenhand_hand_parametric");
    }),
    (
        "`unsafe` code lives only in `crates/mujoco/src`, `crates/hands/src/compiled/library.rs` and \
         `crates/hand-abi/src`; a compiled plugin has none but the export that a macro writes.",
        |_| source::check_fences(),
    ),
    ("No generic crate names a joint, an actuator or a body of any hand.", |_| source::check_names()),
];

struct Graph {
    metadata: Metadata,
}

impl Graph {
    fn read() -> Graph {
        let metadata = MetadataCommand::new()
            .manifest_path(workspace().join("Cargo.toml"))
            .no_deps()
            .other_options(["--offline".to_owned(), "--locked".to_owned()])
            .exec()
            .expect("cargo metadata");
        Graph { metadata }
    }

    /// Returns the names of all dependencies of a package, including those of its builds and tests.
    fn all(&self, package: &str) -> BTreeSet<String> {
        let found = self.metadata.packages.iter().find(|p| p.name.as_str() == package);
        let found = found.unwrap_or_else(|| panic!("the workspace has no package {package}"));
        found.dependencies.iter().map(|d| d.name.clone()).collect()
    }

    /// Returns those dependencies that belong to this workspace.
    fn internal(&self, package: &str) -> BTreeSet<String> {
        let members: BTreeSet<&str> = self.metadata.packages.iter().map(|p| p.name.as_str()).collect();
        self.all(package).into_iter().filter(|name| members.contains(name.as_str())).collect()
    }

    fn lacks(&self, package: &str, absent: &[&str]) {
        let all = self.all(package);
        for name in absent {
            assert!(!all.contains(*name), "{package} depends on {name}");
        }
    }
}

/// Checks that no line of code below a directory has a word; a word in lower case matches every case.
fn lacks_word(directory: &str, word: &str) {
    for file in source::rust_files(&workspace().join(directory)) {
        for (number, line) in source::code(&file) {
            let found = source::words(&line).any(|w| w == word || w.to_lowercase() == word);
            assert!(!found, "{}:{number} has the word {word}: {line}", file.display());
        }
    }
}

#[test]
fn every_crate_depends_on_what_the_design_allows() {
    let graph = Graph::read();
    let allowed: BTreeMap<&str, &[&str]> = ALLOWED.into_iter().chain([XTASK]).collect();
    for package in &graph.metadata.packages {
        let name = package.name.as_str();
        if name == TESTS {
            continue;
        }
        // A compiled plugin is a crate that sees the ABI and nothing else.
        let plugin = package.manifest_path.starts_with(workspace().join("plugins").to_str().expect("UTF-8"));
        let expected: &[&str] = match allowed.get(name) {
            Some(expected) => expected,
            None if plugin => &["eigenhand-hand-abi"],
            None => panic!("the package {name} is not in the design: add it to ARCHITECTURE.md and to this test"),
        };
        for dependency in graph.internal(name) {
            assert!(expected.contains(&dependency.as_str()), "{name} must not depend on {dependency}");
        }
    }
}

#[test]
fn the_invariants_of_the_architecture_hold() {
    let graph = Graph::read();
    for (sentence, check) in INVARIANTS {
        println!("{sentence}");
        check(&graph);
    }
}

#[test]
fn the_architecture_states_the_invariants_that_are_checked() {
    let text = std::fs::read_to_string(workspace().join("ARCHITECTURE.md")).expect("ARCHITECTURE.md");
    // A sentence may span several lines. It ends with the last line of its paragraph or list item.
    let joined = text.split("\n\n").map(|p| p.split_whitespace().collect::<Vec<_>>().join(" "));
    let stated: BTreeSet<String> =
        joined.filter_map(|p| p.split_once(MARK).map(|(_, sentence)| sentence.trim().to_owned())).collect();
    let checked: BTreeSet<String> = INVARIANTS.iter().map(|(sentence, _)| (*sentence).to_owned()).collect();
    assert_eq!(stated, checked);
}
