//! Hands that hang, exit or crash: each harms only itself.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use tempfile::TempDir;

use super::{FAILURE, assert_error, eigenhand, json, run};

/// Longer than any command here takes, but for a plugin that never ends.
const SOON: Duration = Duration::from_secs(30);

/// Compiles a plugin of one C function that runs when the library is opened.
fn plugin(directory: &Path, name: &str, body: &str) {
    let home = directory.join(name);
    std::fs::create_dir_all(&home).unwrap();
    let source = home.join("plugin.c");
    let text = format!(
        "#include <stdlib.h>\n#include <unistd.h>\n__attribute__((constructor)) static void begin(void) {{ {body} }}\n"
    );
    std::fs::write(&source, text).unwrap();
    let library = home.join(format!("{}unruly{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX));
    let status = Command::new("cc").args(["-shared", "-fPIC", "-o"]).args([&library, &source]).status().unwrap();
    assert!(status.success());
    let file = library.file_name().unwrap().to_str().unwrap().to_owned();
    let sidecar = format!("schema = 1\nname = \"{name}\"\nlibrary = \"./{file}\"\nabi = [1, 0]\nbuild = \"make\"\n");
    std::fs::write(home.join("hand-plugin.toml"), sidecar).unwrap();
}

#[test]
fn a_plugin_that_exits_crashes_or_never_ends_harms_only_itself() {
    let root = TempDir::new().unwrap();
    let bodies = [("exits", "exit(0);"), ("crashes", "abort();"), ("loops", "for (;;) pause();")];
    bodies.iter().for_each(|(name, body)| plugin(root.path(), name, body));
    let place = root.path().to_str().unwrap();
    let listed = eigenhand()
        .args(["hands", "list", "--json", "--plugins", place])
        .env("EIGENHAND_PLUGIN_SECONDS", "1")
        .output()
        .unwrap();
    let listed = json(&listed);
    let hands = listed.as_array().unwrap();
    let state =
        |name: &str| hands.iter().find(|hand| hand["name"] == name).unwrap_or_else(|| panic!("{name}: {listed}"));
    for (name, expected) in [("exits", "exit status: 0"), ("crashes", "signal: 6"), ("loops", "a hand within 1 s")] {
        let error = state(name)["error"].as_str().unwrap();
        assert!(error.contains(expected), "{name}: {error}");
    }
    assert!(state("shadow")["error"].is_null(), "{listed}");
    let shown = eigenhand()
        .args(["hands", "show", "shadow", "--json", "--plugins", place])
        .env("EIGENHAND_PLUGIN_SECONDS", "1")
        .output()
        .unwrap();
    assert_eq!(json(&shown)["name"], "shadow");
    let exits = root.path().join("exits");
    assert_error(
        &run(&["train", "--hand", exits.to_str().unwrap()]),
        FAILURE,
        &["its process ended", "exit status: 0"],
    );
}

#[test]
fn a_model_that_is_a_pipe_or_a_device_is_not_opened() {
    for (name, make, reason) in [("pipe", "mkfifo", "no regular file"), ("device", "ln", "leads out of")] {
        let root = TempDir::new().unwrap();
        let model = root.path().join("hand.xml");
        let mut command = Command::new(make);
        match name {
            "pipe" => command.arg(&model),
            _ => command.args(["-s", "/dev/zero"]).arg(&model),
        };
        assert!(command.status().unwrap().success());
        let text = "schema = 1\nname = \"x\"\nmodel = \"hand.xml\"\npalm = \"p\"\nfingertips = [\"f\"]\n\n[mount]\nposition = \
                    [0.0, 0.0, 0.12]\n\n[slide]\nrange = [-0.045, 0.12]\n";
        std::fs::write(root.path().join("hand.toml"), text).unwrap();
        let started = Instant::now();
        let shown = run(&["hands", "show", root.path().to_str().unwrap()]);
        assert!(started.elapsed() < SOON, "{name}");
        assert_error(&shown, FAILURE, &["hand.xml", reason]);
        let made = root.path().join("new");
        let new = run(&["hands", "new", "x", "--from", model.to_str().unwrap(), "--out", made.to_str().unwrap()]);
        assert_error(&new, FAILURE, &["hand.xml", "no regular file"]);
    }
}
