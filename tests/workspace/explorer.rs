//! The explorer's page in a browser: a slider moves, and joints, commands and fingertips are where the libraries put them.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::Command;

use eigenhand_explore::page;
use eigenhand_sim::{GraspTask, fingertip_positions};
use eigenhand_synergy::SynergyFile;
use serde::Deserialize;
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
struct Shown {
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
    let text = page(&hand, &task, &file, "a synergy <!--<script></script>").unwrap();
    assert!(text.len() < 10_000_000 && !text.contains("http"), "the page is small and needs no network");
    let place = TempDir::new().unwrap();
    let path = place.path().join("page.html");
    std::fs::write(&path, text.replace("</body>", &SCRIPT.replace("SHARE", &MOVED.to_string()))).unwrap();
    let shown = shown_in(&browser, &path, &place);

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

/// Opens a page, and reads what its script found. Whatever the page says to the console fails the test.
fn shown_in(browser: &PathBuf, page: &std::path::Path, place: &TempDir) -> Shown {
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
