//! Compiled plugins in C and in Rust, sound and broken.
//!
//! They are compiled here, by the C compiler of the system and by the Rust compiler, as whoever writes one does it.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::path::{Path, PathBuf};
use std::process::Command;

use eigenhand_hands::{Hand, HandError, Registry, SIDECAR_FILE, SIDECAR_KEYS, SearchPath};
use tempfile::TempDir;

use crate::fixture;

const SIDECAR: &str = r#"schema = 1
name = "c-pincer"
library = "pincer"
abi = [1, 0]
build = "make pincer"
"#;

/// Runs a compiler, which this machine must have.
fn compile(program: &str, command: &mut Command) {
    let output =
        command.output().unwrap_or_else(|error| panic!("cannot run {program}, which this test needs: {error}"));
    assert!(output.status.success(), "{program}: {}", String::from_utf8_lossy(&output.stderr));
}

fn crates() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

fn library_name(name: &str) -> String {
    format!("{DLL_PREFIX}{name}{DLL_SUFFIX}")
}

/// Compiles a C source with macros to a library.
fn compile_c(source: &Path, library: &Path, macros: &[&str]) {
    let mut command = Command::new("cc");
    // A macro may leave a function without use.
    command.args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function", "-shared", "-fPIC", "-I"]);
    command.arg(crates().join("hand-abi/include")).arg(source).arg("-o").arg(library);
    compile("cc", command.args(macros.iter().map(|m| format!("-D{m}"))));
}

/// Compiles a Rust source that uses the interface to a library.
fn compile_rust(source: &Path, library: &Path) {
    let directory = TempDir::new().unwrap();
    let rustc = || {
        let mut command = Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
        command.args(["--edition", "2024", "--crate-type"]);
        command
    };
    let abi = directory.path().join("libeigenhand_hand_abi.rlib");
    let interface = crates().join("hand-abi/src/lib.rs");
    compile("rustc", rustc().args(["rlib", "--crate-name", "eigenhand_hand_abi", "-o"]).arg(&abi).arg(interface));
    let external = format!("eigenhand_hand_abi={}", abi.display());
    compile("rustc", rustc().args(["cdylib", "--extern", &external, "-o"]).arg(library).arg(source));
}

/// The directory of a compiled plugin.
struct Plugin {
    _root: TempDir,
    directory: PathBuf,
}

impl Plugin {
    fn empty() -> Self {
        let root = TempDir::new().unwrap();
        let directory = root.path().join("pincer");
        std::fs::create_dir(&directory).unwrap();
        std::fs::write(directory.join(SIDECAR_FILE), SIDECAR).unwrap();
        Self { _root: root, directory }
    }

    /// The plugin in C, with macros that break it.
    fn c(macros: &[&str]) -> Self {
        let plugin = Self::empty();
        compile_c(&crates().join("hands/tests/plugins/pincer.c"), &plugin.library(), macros);
        plugin
    }

    fn library(&self) -> PathBuf {
        self.directory.join(library_name("pincer"))
    }

    /// Replaces `from`, which must be there, in the sidecar.
    fn edit(&self, from: &str, to: &str) -> &Self {
        let path = self.directory.join(SIDECAR_FILE);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{from}");
        std::fs::write(path, text.replace(from, to)).unwrap();
        self
    }

    fn registry(&self) -> Registry {
        let mut path = SearchPath::new();
        path.push(self.directory.parent().unwrap(), "--plugins");
        Registry::discover(&path).unwrap()
    }

    fn load(&self) -> Result<Hand, HandError> {
        self.registry().get("c-pincer")
    }

    /// Loads the hand, which must be broken, and returns the message with the directory shortened to `DIR`.
    fn message(&self) -> String {
        let registry = self.registry();
        assert_eq!(registry.list().len(), 1, "a broken plugin is listed");
        let listed = registry.list()[0].hand.as_ref().expect_err("the plugin is broken").to_string();
        let error = registry.get(self.directory.to_str().unwrap()).expect_err("the plugin is broken").to_string();
        assert_eq!(error, listed);
        let real = self.directory.canonicalize().unwrap().display().to_string();
        error.replace(&real, "DIR").replace(&self.directory.display().to_string(), "DIR")
    }
}

/// Returns what is said of a plugin in C that was compiled with these macros, after the library's name.
fn c_message(macros: &[&str]) -> String {
    let message = Plugin::c(macros).message();
    let library = format!("DIR/{}: ", library_name("pincer"));
    message.strip_prefix(&library).unwrap_or(&message).to_owned()
}

#[test]
fn a_plugin_in_c_is_a_hand_like_any_other() {
    let plugin = Plugin::c(&[]);
    let hand = plugin.load().unwrap();
    assert_eq!(hand.manifest.name, "c-pincer");
    assert_eq!(hand.directory, plugin.directory);
    assert_eq!(hand.joints.iter().map(|j| j.name.as_str()).collect::<Vec<_>>(), ["left_turn", "right_turn"]);
    let files: Vec<_> = hand.files.iter().map(|file| file.display().to_string()).collect();
    assert_eq!(files, [SIDECAR_FILE, "hand.toml", "model.xml"]);
    assert!(hand.model_directory.join("model.xml").is_file(), "the simulator reads assets from there");
    let path = plugin.directory.to_str().unwrap();
    assert_eq!(plugin.registry().get(path).unwrap().digest, hand.digest);
    assert_eq!(plugin.load().unwrap().digest, hand.digest, "one hand, one digest");
}

#[test]
fn options_reach_the_plugin_and_change_the_hand() {
    let plugin = Plugin::c(&[]);
    let before = plugin.load().unwrap();
    plugin.edit("build = \"make pincer\"\n", "[options]\nwidth = 0.1\n");
    let after = plugin.load().unwrap();
    let text = |hand: &Hand| std::fs::read_to_string(hand.model_directory.join("model.xml")).unwrap();
    assert!(text(&before).contains("0 0.03 0") && text(&after).contains("0 0.05 0"), "{}", text(&after));
    assert_ne!(before.digest, after.digest);
    plugin.edit("width = 0.1", "width = -1.0");
    assert_eq!(
        plugin.message(),
        format!(
            "DIR/{}: the plugin generated no hand from its options: `width`: expected a positive number of metres, got \
             width = -1.0",
            library_name("pincer")
        )
    );
}

#[test]
fn the_digest_covers_the_sidecar() {
    let plugin = Plugin::c(&[]);
    let before = plugin.load().unwrap().digest;
    plugin.edit("make pincer", "make  pincer");
    assert_ne!(plugin.load().unwrap().digest, before);
}

#[test]
fn another_version_is_refused_before_the_library_is_opened() {
    // There is no library: whoever looked for it would say so.
    let plugin = Plugin::empty();
    plugin.edit("abi = [1, 0]", "abi = [2, 0]");
    assert_eq!(
        plugin.message(),
        "DIR/hand-plugin.toml: built for version 2.0 of the plugin interface, expected 1.0; rebuild the plugin with \
         eigenhand-hand-abi 1.0"
    );
}

#[test]
fn the_sidecar_is_checked_key_by_key() {
    let message = |from: &str, to: &str| Plugin::empty().edit(from, to).message();
    assert_eq!(
        message("library =", "libary ="),
        "DIR/hand-plugin.toml: unknown key `libary` (did you mean `library`?); known here: schema, name, library, abi, \
         build, options"
    );
    assert_eq!(
        message("abi = [1, 0]\n", ""),
        "DIR/hand-plugin.toml: key `abi` is missing; expected two integers [major, minor]: the version of the plugin \
         interface that the library was built for"
    );
    for (from, to, got) in [
        ("schema = 1", "schema = 2", "key `schema`: expected the integer 1, got 2"),
        ("[1, 0]", "[1]", "interface that the library was built for, got [1]"),
        ("[1, 0]", "[-1, 0]", "interface that the library was built for, got [-1, 0]"),
        ("\"pincer\"", "\"\"", "key `library`: expected the library's name"),
        ("\"c-pincer\"", "3", "key `name`: expected the name of the hand that the library generates, in quotes, got 3"),
        ("build =", "options =", "key `options`: expected a table [options], got"),
        ("schema = 1", "schema =", "not valid TOML"),
        ("\"pincer\"", "\"../pincer\"", "`library`: path `../pincer` leads out of the hand's directory DIR"),
        ("\"pincer\"", "\"/lib/pincer\"", "`library`: path `/lib/pincer` leads out of the hand's directory DIR"),
    ] {
        let message = message(from, to);
        assert!(message.contains(got), "{message}");
    }
}

#[test]
fn a_library_that_is_missing_is_told_with_the_command_that_builds_it() {
    let plugin = Plugin::empty();
    let message = plugin.message();
    let expected = format!(
        "DIR/hand-plugin.toml: `library`: no {} was found; build it with `make pincer`; looked in: DIR, ",
        library_name("pincer")
    );
    assert!(message.starts_with(&expected), "{message}");
    plugin.edit("build = \"make pincer\"\n", "");
    assert!(plugin.message().contains("put the library into this directory"));
}

#[test]
fn a_library_is_found_by_path_and_where_cargo_builds_it() {
    let plugin = Plugin::c(&[]);
    std::fs::create_dir(plugin.directory.join("lib")).unwrap();
    std::fs::rename(plugin.library(), plugin.directory.join("lib").join(library_name("pincer"))).unwrap();
    plugin.edit("library = \"pincer\"", "library = \"lib/pincer\"");
    assert!(plugin.load().is_ok());
    plugin.edit("library = \"lib/pincer\"", &format!("library = \"lib/{}\"", library_name("pincer")));
    assert!(plugin.load().is_ok());

    // Beside the running program, as in a build of the workspace; the name is this test's own.
    let beside = std::env::current_exe().unwrap().with_file_name(library_name("eigenhand_test_of_lookup"));
    std::fs::rename(plugin.directory.join("lib").join(library_name("pincer")), &beside).unwrap();
    plugin.edit(&format!("library = \"lib/{}\"", library_name("pincer")), "library = \"eigenhand_test_of_lookup\"");
    let loaded = plugin.load();
    std::fs::remove_file(beside).unwrap();
    assert!(loaded.is_ok(), "{loaded:?}");
}

#[test]
fn two_manifests_in_one_directory_are_refused() {
    let plugin = Plugin::c(&[]);
    fixture::write(&plugin.directory);
    assert_eq!(
        plugin.message(),
        "DIR: holds both hand.toml and hand-plugin.toml; a hand is either written or generated, so remove one"
    );
}

#[test]
fn the_name_in_the_sidecar_is_the_generated_one() {
    let plugin = Plugin::c(&[]);
    plugin.edit("c-pincer", "other");
    assert_eq!(
        plugin.message(),
        "DIR/hand-plugin.toml: key `name`: expected \"c-pincer\", the name of the hand that the library generates, got \
         \"other\""
    );
}

#[test]
fn a_table_of_another_kind_is_refused() {
    let broken = "; this is a bug in the plugin, report it to its author";
    assert_eq!(
        c_message(&["MAJOR=2"]),
        "built for version 2.0 of the plugin interface, expected 1.0; rebuild the plugin with eigenhand-hand-abi 1.0"
    );
    assert_eq!(
        c_message(&["STRUCT_SIZE=24"]),
        format!(
            "struct_size: expected at least {} bytes, the table of its version, got 24 bytes{broken}",
            size_of::<usize>() * 5 + 16
        )
    );
    assert_eq!(
        c_message(&["MAGIC=7"]),
        format!("magic: expected 0x45484e44, the mark of a hand plugin, got 0x00000007{broken}")
    );
    assert_eq!(
        c_message(&["SYMBOL=another_symbol"]),
        format!("the library: expected a symbol `eigenhand_hand_plugin`, got none{broken}")
    );
    assert_eq!(c_message(&["GENERATE=0"]), format!("generate: expected a function, got null{broken}"));
    assert!(
        Plugin::c(&["MINOR=7", "STRUCT_SIZE=4096"]).load().is_ok(),
        "a newer minor version has all that is asked for"
    );
}

#[test]
fn a_function_that_is_nowhere_is_told_when_the_library_is_opened() {
    let message = c_message(&["UNDEFINED_FUNCTION"]);
    assert!(message.starts_with("cannot open this library: ") && message.contains("defined_nowhere"), "{message}");
}

#[test]
fn files_that_break_the_rules_are_refused() {
    let broken = |says: &str| format!("{says}; this is a bug in the plugin, report it to its author");
    for (macros, says) in [
        (&["N_FILES=1001"][..], "file_count: expected at most 1000 files, got 1001"),
        (&["N_FILES=3"], "the names of the files: expected distinct names, got model.xml twice"),
        (&["N_FILES=0"], "the files: expected hand.toml, got none of that name"),
        (&["FILE_STATUS=5"], "file: expected status 0, got status 5"),
        (&["MODEL_NAME_LEN=256"], "file: expected a name of at most 255 bytes, got 256 bytes"),
        (&["MODEL_NAME_LEN=0"], "the name of a file: expected a plain path below the hand's directory, got ``"),
        (&["MODEL_NAME=\"../x\""], "the name of a file: expected a plain path below the hand's directory, got `../x`"),
        (
            &["MODEL_NAME=\"a\\xff\""],
            "the name of a file: expected a plain path below the hand's directory, got `a\\xff`, which is not UTF-8",
        ),
        (&["MODEL_DATA=0"], "file: expected content, got null"),
        (&["NO_HAND=0"], "generate: expected a hand, got null"),
    ] {
        assert_eq!(c_message(macros), broken(says), "{macros:?}");
    }
    let message = c_message(&["MODEL_LEN=(size_t)-1"]);
    assert!(message.starts_with("file: expected content of at most 268435"), "{message}");
}

#[test]
fn a_failure_without_a_message_is_one() {
    assert_eq!(
        c_message(&["NO_HAND=77"]),
        "the plugin generated no hand from its options: status 77 without a message"
    );
}

#[test]
fn a_generated_hand_that_is_broken_names_the_key() {
    let message = Plugin::c(&["MANIFEST_END=\"depth=3\\n\""]).message();
    assert!(message.starts_with("DIR/hand-plugin.toml: the generated hand is broken: "), "{message}");
    assert!(message.contains("hand.toml: unknown key `mount.depth`"), "{message}");
    let message = c_message(&["MANIFEST_END=\"\\xff\""]);
    assert!(message.starts_with("hand.toml: expected UTF-8, got invalid utf-8 sequence"), "{message}");
}

#[test]
fn a_file_that_is_no_library_is_refused() {
    let plugin = Plugin::c(&[]);
    let sound = std::fs::read(plugin.library()).unwrap();
    // A file of its own for each try: the system knows an opened library again by its file.
    let message = |content: &[u8]| {
        let broken = Plugin::empty();
        std::fs::write(broken.library(), content).unwrap();
        broken.message()
    };
    let says = format!("DIR/{}: cannot open this library: ", library_name("pincer"));
    assert!(message(&[]).starts_with(&says));
    assert!(message(&[b'x'; 5000]).starts_with(&says));
    let mut damaged = sound.clone();
    damaged[4..64].iter_mut().for_each(|byte| *byte ^= 0xa5);
    assert!(message(&damaged).starts_with(&says));
}

#[test]
fn a_plugin_in_rust_that_panics_is_an_error() {
    let plugin = Plugin::empty();
    compile_rust(&crates().join("hands/tests/plugins/panics.rs"), &plugin.library());
    let says = format!("DIR/{}: the plugin generated no hand from its options: ", library_name("pincer"));
    assert_eq!(plugin.message(), format!("{says}panicked: out of ideas"));
    plugin.edit("build = \"make pincer\"\n", "[options]\nfingers = 9\n");
    assert_eq!(plugin.message(), format!("{says}no hand of fingers = 9"));
}

fn documented() -> String {
    let text = std::fs::read_to_string(crates().join("../docs/hands.md")).unwrap();
    text.split_once("\n## Compiled plugins\n").expect("docs/hands.md has the section").1.to_owned()
}

#[test]
fn the_documented_plugin_works() {
    let text = documented();
    let block = |language: &str| {
        let start = text.split_once(&format!("```{language}\n")).expect("a block of code").1;
        start.split_once("```").unwrap().0.to_owned()
    };
    let plugin = Plugin::empty();
    std::fs::write(plugin.directory.join(SIDECAR_FILE), block("toml")).unwrap();
    let source = plugin.directory.join("lib.rs");
    std::fs::write(&source, block("rust")).unwrap();
    compile_rust(&source, &plugin.directory.join(library_name("claw")));
    let hand = plugin.registry().get("claw").unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(hand.manifest.name, "claw");
    assert!(!hand.joints.is_empty() && !hand.actuators.is_empty());
}

#[test]
fn every_key_of_the_sidecar_is_documented() {
    let text = documented();
    for (key, _) in SIDECAR_KEYS {
        assert!(text.contains(&format!("| `{key}` |")), "docs/hands.md lacks `{key}`");
    }
}
