//! The explorer's page in a browser: a slider moves, and joints, commands and fingertips are where the libraries put them.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;

use eigenhand_explore::{Recording, Shown, page};
use eigenhand_mujoco::Data;
use eigenhand_render::surface;
use eigenhand_sim::scene::MOUNT;
use eigenhand_sim::{GraspEnv, GraspTask, fingertip_positions};
use eigenhand_synergy::{JointMap, SynergyFile};
use rand::SeedableRng;
use rand::rngs::StdRng;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use tempfile::TempDir;

use crate::contract::setting;
use crate::support::{mujoco, registry, workspace};

/// Names the browser. Without it, `chromium` is searched, and the test is skipped where there is none.
const VARIABLE: &str = "EIGENHAND_CHROMIUM";
/// Largest error of an angle (rad), a command, or a fingertip's place (m).
const TOLERANCE: f64 = 1e-6;
/// Share of the first number's range to which the slider moves.
const MOVED: f64 = 0.8;

/// Moves a slider as a person does, and writes what the page shows.
const SCRIPT: &str = r#"<script>
const slider = document.getElementById("z1");
slider.value = Number(slider.min) + SHARE * (slider.max - slider.min);
slider.dispatchEvent(new Event("input"));
const shown = (id) => Object.fromEntries(
  [...document.querySelectorAll(`#${id} tbody tr`)].map((row) => [row.cells[0].textContent, Number(row.cells[1].dataset.value)]));
const gl = document.getElementById("view").getContext("webgl");
const pixels = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
let drawn = 0;
for (let i = 0; i < pixels.length; i += 4) drawn += pixels[i] !== pixels[0] || pixels[i + 2] !== pixels[2] ? 1 : 0;
const result = { z: Number(slider.value), joints: shown("joints"), commands: shown("commands"), tips: eigenhand.tips(), drawn };
document.body.insertAdjacentHTML("beforeend", `<pre>RESULT${JSON.stringify(result)}END</pre>`);
</script></body>"#;

#[derive(Deserialize)]
struct Moved {
    z: f64,
    joints: BTreeMap<String, f64>,
    commands: BTreeMap<String, f64>,
    tips: BTreeMap<String, [f64; 3]>,
    /// Pixels that do not have the background's colour.
    drawn: usize,
}

#[test]
fn a_slider_moves_the_hand_as_the_synergy_says() {
    let Some(browser) = browser() else {
        let _ = writeln!(std::io::stderr(), "skipped: no chromium; install it, or name it in {VARIABLE}");
        return;
    };
    let file = SynergyFile::read(workspace().join("synergies/shadow/synergy.toml")).unwrap();
    let hand = registry().get(&file.hand).unwrap();
    let task = GraspTask::new(&mujoco(), &hand, &setting()).unwrap();
    let text = page(&hand, &task, Shown { file: &file, title: "a synergy <!--<script></script>" }, None, &[]).unwrap();
    assert!(text.len() < 10_000_000 && !text.contains("http"), "the page is small and needs no network");
    let place = TempDir::new().unwrap();
    let path = place.path().join("page.html");
    std::fs::write(&path, text.replace("</body>", &SCRIPT.replace("SHARE", &MOVED.to_string()))).unwrap();
    let shown: Moved = shown_in(&browser, &path, &place);

    let synergy = &file.synergy;
    let (low, high) = (synergy.coefficient_min()[0], synergy.coefficient_max()[0]);
    assert!((shown.z - (low + MOVED * (high - low))).abs() < TOLERANCE, "{} is between {low} and {high}", shown.z);
    let mut z = vec![0.0; synergy.n_components()];
    z[0] = shown.z;
    let map = file.joint_map.as_ref().unwrap();
    let (posture, commands) = (map.decode(&z), synergy.decode(&z));
    let names = |joints: &[eigenhand_hands::JointInfo]| joints.iter().map(|j| j.name.clone()).collect::<Vec<_>>();
    for (shown, names, expected) in
        [(&shown.joints, names(&map.joints), &posture), (&shown.commands, names(synergy.joints()), &commands)]
    {
        assert_eq!(shown.len(), names.len());
        for (name, expected) in names.iter().zip(expected) {
            assert!((shown[name] - expected).abs() < TOLERANCE, "{name}: {} is not {expected}", shown[name]);
        }
    }
    let posed = task.posed_hand(&task.scenes[0], &posture).unwrap();
    let tips = fingertip_positions(&hand, &posed).unwrap();
    assert_eq!(shown.tips.len(), hand.fingertips.len());
    for (tip, expected) in hand.fingertips.iter().zip(tips) {
        let found = nalgebra::Vector3::from(shown.tips[&tip.name]);
        assert!((found - expected).norm() < TOLERANCE, "{}: {found:?} is not {expected:?}", tip.name);
    }
    assert!(shown.drawn > 5000, "{} pixels show the hand", shown.drawn);
}

/// Shows a frame of a recorded episode, and moves a slider beside a second synergy.
const FRAME_SCRIPT: &str = r#"<script>
eigenhand.show(0, 1);
const frame = eigenhand.shown();
document.body.insertAdjacentHTML("beforeend", `<pre>RESULT${JSON.stringify(frame)}END</pre>`);
</script></body>"#;
const BESIDE_SCRIPT: &str = r#"<script>
eigenhand.set(NUMBERS);
document.body.insertAdjacentHTML("beforeend", `<pre>RESULT${JSON.stringify(eigenhand.other())}END</pre>`);
</script></body>"#;

#[derive(Deserialize)]
struct ShownFrame {
    tips: BTreeMap<String, [f64; 3]>,
    corner: [f64; 3],
}

#[test]
fn a_recorded_episode_and_a_second_synergy_are_where_the_simulator_and_the_library_put_them() {
    let Some(browser) = browser() else { return };
    let file = SynergyFile::read(workspace().join("synergies/shadow/synergy.toml")).unwrap();
    let hand = registry().get(&file.hand).unwrap();
    let task = Arc::new(GraspTask::new(&mujoco(), &hand, &setting()).unwrap());
    let (scene, mut env) = (&task.scenes[0], GraspEnv::new(&task).unwrap());
    env.reset(0, &mut StdRng::seed_from_u64(3)).unwrap();
    let mut recording = Recording::begin(&hand, scene, &env, 0.1).unwrap();
    recording.add(&env, vec![0.1]);
    // The hand rises and closes, and the object is pushed aside.
    let action: Vec<f32> = (0..task.action_len()).map(|i| if i % 2 == 0 { 0.8 } else { -0.3 }).collect();
    env.push_object([0.4, 0.3, 0.0]);
    (0..12).for_each(|_| _ = env.step(&action).unwrap());
    recording.add(&env, vec![0.2]);
    recording.end(true);

    let place = TempDir::new().unwrap();
    let open = |name: &str, text: &str, script: &str| {
        let path = place.path().join(name);
        std::fs::write(&path, text.replace("</body>", script)).unwrap();
        path
    };
    let shown = Shown { file: &file, title: "a" };
    let text = page(&hand, &task, shown, None, &[recording]).unwrap();
    let found: ShownFrame = shown_in(&browser, &open("frame.html", &text, FRAME_SCRIPT), &place);
    // The page's hand stands where it is in the open posture.
    let reference = task.open_hand(scene).unwrap();
    // After a step, bodies are where they were before its last integration.
    let mut data = Data::new(env.simulation().model()).unwrap();
    data.copy_from(env.simulation()).unwrap();
    data.forward();
    let mount = |data: &Data| data.body_position(data.model().body(MOUNT).unwrap());
    let moved = mount(&reference) - mount(&data);
    assert!(moved.norm() > 0.01, "the hand has risen");
    for (tip, expected) in hand.fingertips.iter().zip(fingertip_positions(&hand, &data).unwrap()) {
        let found = nalgebra::Vector3::from(found.tips[&tip.name]);
        assert!((found - expected - moved).norm() < TOLERANCE, "{}: {found:?} is not {expected:?}", tip.name);
    }
    // The corners of a surface are rounded to the 65535th part of its size.
    let corner = surface(&data, scene.object_geom())[0][0].position + moved;
    assert!((nalgebra::Vector3::from(found.corner) - corner).norm() < 1e-5, "{:?} is not {corner:?}", found.corner);

    // The second synergy has two numbers, which take the same shares of their ranges.
    let map = file.joint_map.clone().unwrap();
    let second = SynergyFile {
        synergy: file.synergy.first(2),
        joint_map: Some(JointMap { matrix: map.matrix[..2].to_vec(), ..map }),
        grasps: Vec::new(),
        recommended: None,
        ..file.clone()
    };
    let numbers = [0.5 * file.synergy.coefficient_max()[0], 0.25 * file.synergy.coefficient_min()[1], 0.7];
    let script = BESIDE_SCRIPT.replace("NUMBERS", &format!("{numbers:?}"));
    let text = page(&hand, &task, shown, Some(Shown { file: &second, title: "b" }), &[]).unwrap();
    let found: BTreeMap<String, f64> = shown_in(&browser, &open("beside.html", &text, &script), &place);
    let map = second.joint_map.as_ref().unwrap();
    for (joint, expected) in map.joints.iter().zip(map.decode(&numbers[..2])) {
        assert!((found[&joint.name] - expected).abs() < TOLERANCE, "{}: {found:?}", joint.name);
    }
}

/// Opens a page, and reads what its script found. Whatever the page says to the console fails the test.
fn shown_in<T: DeserializeOwned>(browser: &PathBuf, page: &std::path::Path, place: &TempDir) -> T {
    let output = Command::new(browser)
        .args([
            "--headless",
            "--no-sandbox",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--no-first-run",
        ])
        .args([
            "--disable-quic",
            "--disable-background-networking",
            "--disable-dev-shm-usage",
            "--window-size=1000,700",
            "--enable-logging=stderr",
        ])
        .args(["--virtual-time-budget=5000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", place.path().join("profile").display()))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    let console: Vec<&str> = said.lines().filter(|line| line.contains(":CONSOLE")).collect();
    assert!(console.is_empty(), "{console:?}");
    let text = String::from_utf8_lossy(&output.stdout);
    let result = text.rsplit("<pre>RESULT").next().and_then(|rest| rest.split("END</pre>").next());
    serde_json::from_str(result.unwrap_or_else(|| panic!("the script did not end: {said}"))).unwrap()
}

fn browser() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os(VARIABLE) {
        return Some(named.into());
    }
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|directory| directory.join("chromium")).find(|file| file.is_file())
}
