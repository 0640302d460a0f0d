//! The explorer's page in a browser: a slider moves, and joints, commands and fingertips are where the libraries put them.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use eigenhand_explore::{Recording, Shown, check, page};
use eigenhand_hands::Hand;
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
eigenhand.CHANGE;
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
    recording.add(&env, vec![0.1], Vec::new());
    // The hand rises and closes, and the object is pushed aside.
    let action: Vec<f32> = (0..task.action_len()).map(|i| if i % 2 == 0 { 0.8 } else { -0.3 }).collect();
    env.push_object([0.4, 0.3, 0.0]);
    (0..12).for_each(|_| _ = env.step(&action).unwrap());
    let nearest = [0.3, -0.2];
    recording.add(&env, vec![0.2], nearest.to_vec());
    recording.end(true);

    let place = TempDir::new().unwrap();
    let open = |name: &str, text: &str, script: &str| {
        let path = place.path().join(name);
        std::fs::write(&path, text.replace("</body>", script)).unwrap();
        path
    };
    let shown = Shown { file: &file, title: "a" };
    let recordings = [recording];
    let text = page(&hand, &task, shown, None, &recordings).unwrap();
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

    let foreign = SynergyFile::read(workspace().join("synergies/fourfinger/synergy.toml")).unwrap();
    assert!(check(&hand, &file, Some(&foreign)).is_err(), "a synergy of another hand");
    check(&hand, &file, Some(&file)).unwrap();
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
    let text = page(&hand, &task, shown, Some(Shown { file: &second, title: "b" }), &recordings).unwrap();
    let map = second.joint_map.as_ref().unwrap();
    for (change, expected) in [(format!("set({numbers:?})"), &numbers[..2]), ("show(0, 1)".to_owned(), &nearest)] {
        let script = BESIDE_SCRIPT.replace("CHANGE", &change);
        let found: BTreeMap<String, f64> = shown_in(&browser, &open("beside.html", &text, &script), &place);
        for (joint, expected) in map.joints.iter().zip(map.decode(expected)) {
            assert!((found[&joint.name] - expected).abs() < TOLERANCE, "{change}, {}: {found:?}", joint.name);
        }
    }
}

/// Environment variable: a file to which the screenshot goes too, such as the README's.
const SCREENSHOT: &str = "EIGENHAND_SCREENSHOT";
/// Size of the screenshot in pixels.
const WINDOW: [u32; 2] = [1280, 800];
/// Shows the middle of an episode.
const GRASP_SCRIPT: &str = r#"<script>
document.getElementById("recording").value = 0;
eigenhand.show(0, FRAME);
</script></body>"#;

#[test]
fn the_page_shows_a_grasp() {
    let Some(browser) = browser() else { return };
    let file = SynergyFile::read(workspace().join("synergies/shadow/synergy.toml")).unwrap();
    let hand = registry().get(&file.hand).unwrap();
    let task = Arc::new(GraspTask::new(&mujoco(), &hand, &setting()).unwrap());
    let recording = grasp(&hand, &task, &file);
    let shown = Shown { file: &file, title: "shadow, a ready synergy" };
    let text = page(&hand, &task, shown, None, &[recording]).unwrap();
    let place = TempDir::new().unwrap();
    let (path, picture) = (place.path().join("page.html"), place.path().join("page.png"));
    std::fs::write(&path, text.replace("</body>", &GRASP_SCRIPT.replace("FRAME", &(FRAMES - 1).to_string()))).unwrap();
    let window = format!("--window-size={},{}", WINDOW[0], WINDOW[1]);
    visit(&browser, &path, &place, &[&window, &format!("--screenshot={}", picture.display())]);
    let png = std::fs::read(&picture).unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(&png)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let shown = reader.next_frame(&mut pixels).unwrap();
    assert_eq!([shown.width, shown.height], WINDOW);
    // The object is orange, and the fingertips are blue.
    let count = |is: fn(i32, i32, i32) -> bool| {
        let colours = pixels.chunks_exact(shown.color_type.samples());
        colours.filter(|colour| is(colour[0].into(), colour[1].into(), colour[2].into())).count()
    };
    let orange = count(|red, green, blue| red > 120 && red > green + 40 && green > blue + 20);
    let blue = count(|red, green, blue| blue > 100 && blue > red + 40 && green > red);
    assert!(orange > 10_000 && blue > 2_000, "{orange} pixels of the object, {blue} of fingertips");
    if let Some(copy) = std::env::var_os(SCREENSHOT) {
        std::fs::write(copy, png).unwrap();
    }
}

/// Frames of the recorded grasp, and control steps from one to the next.
const FRAMES: usize = 30;
const FRAME_STEPS: usize = 4;

/// Grasps and lifts an object with the numbers of a mean grasp alone: open, down, closed, held, up.
fn grasp(hand: &Hand, task: &Arc<GraspTask>, file: &SynergyFile) -> Recording {
    let k = file.synergy.n_components();
    let mean = file.grasps.iter().find(|grasp| grasp.object == "cube" && grasp.numbers == k).unwrap();
    let map = file.joint_map.as_ref().unwrap();
    let slide = map.joints.iter().position(|joint| joint.name == hand.manifest.slide.name).unwrap();
    let index = task.scenes.iter().position(|scene| scene.object.name == mean.object).unwrap();
    let mut env = GraspEnv::new(task).unwrap();
    env.start_open();
    env.reset(index, &mut StdRng::seed_from_u64(1)).unwrap();
    let start = env.simulation().ctrl()[task.slide_action()];
    // The hand comes down before it closes, so it comes lower than the policy, which closes on its way.
    let (low, high) = (mean.closed.q[slide] - 0.04, mean.held.q[slide]);
    // (share of the episode, numbers, height of the slide); between two of them, commands change steadily
    let moments = [
        (0.0, &mean.open.z, start),
        (0.25, &mean.open.z, low),
        (0.45, &mean.closed.z, low),
        (0.55, &mean.held.z, low),
        (0.85, &mean.held.z, high),
        (1.0, &mean.held.z, high),
    ];
    let mut recording = Recording::begin(hand, &task.scenes[index], &env, 0.1).unwrap();
    let before = env.object_pose()[2];
    for step in 0..FRAMES * FRAME_STEPS {
        let share = step as f64 / (FRAMES * FRAME_STEPS) as f64;
        let next = moments.iter().position(|moment| moment.0 > share).unwrap();
        let [(t0, z0, height0), (t1, z1, height1)] = [moments[next - 1], moments[next]];
        let between = |from: f64, to: f64| from + (to - from) * (share - t0) / (t1 - t0);
        let z: Vec<f64> = z0.iter().zip(z1).map(|(from, to)| between(*from, *to)).collect();
        if step % FRAME_STEPS == 0 {
            recording.add(&env, z.clone(), Vec::new());
        }
        let mut controls = env.simulation().ctrl().to_vec();
        for (coordinate, command) in file.synergy.joints().iter().zip(file.synergy.decode(&z)) {
            controls[task.actuators.iter().position(|name| *name == coordinate.name).unwrap()] = command;
        }
        controls[task.slide_action()] = between(height0, height1);
        env.step(&task.action_of(&controls)).unwrap();
    }
    let lift = env.object_pose()[2] - before;
    assert!(lift > 0.05, "the object is lifted by {lift} m");
    recording.end(true);
    recording
}

/// Opens a page, and reads what its script found.
fn shown_in<T: DeserializeOwned>(browser: &Path, page: &Path, place: &TempDir) -> T {
    let text = visit(browser, page, place, &["--window-size=1000,700", "--dump-dom"]);
    let result = text.rsplit("<pre>RESULT").next().and_then(|rest| rest.split("END</pre>").next());
    serde_json::from_str(result.unwrap_or_else(|| panic!("the script did not end: {text}"))).unwrap()
}

/// Opens a page, and returns what the browser printed. Whatever the page says to the console fails the test.
fn visit(browser: &Path, page: &Path, place: &TempDir, options: &[&str]) -> String {
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
            "--enable-logging=stderr",
            "--virtual-time-budget=5000",
        ])
        .args(options)
        .arg(format!("--user-data-dir={}", place.path().join("profile").display()))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    let console: Vec<&str> = said.lines().filter(|line| line.contains(":CONSOLE")).collect();
    assert!(console.is_empty(), "{console:?}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn browser() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os(VARIABLE) {
        return Some(named.into());
    }
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|directory| directory.join("chromium")).find(|file| file.is_file())
}
