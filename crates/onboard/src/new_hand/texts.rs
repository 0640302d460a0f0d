//! The texts of a new hand: `hand.toml`, `README.md`, and what the terminal shows.

use std::fmt::Write as _;

use eigenhand_files::{read_regular, sha256};
use eigenhand_hands::{Imported, LARGEST_FILE, SCHEMA};

use super::model::slide_name;
use super::{MODEL_FILE, NewHand, NewHandReport};
use crate::survey::Survey;

fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}

fn list(items: &[String]) -> String {
    toml::Value::from(items.to_vec()).to_string()
}

fn fixed(values: &[f64]) -> String {
    // TOML writes a float with a decimal point.
    let parts: Vec<String> = values.iter().map(|v| format!("{:?}", if *v == 0.0 { 0.0 } else { *v })).collect();
    format!("[{}]", parts.join(", "))
}

/// Returns the text of `hand.toml`.
pub(super) fn manifest(request: &NewHand, imported: &Imported, found: &Survey, report: &NewHandReport) -> String {
    let file = request.source.file_name().unwrap_or_default().to_string_lossy();
    let digest = read_regular(&request.source, LARGEST_FILE).map(|bytes| sha256(&bytes)).unwrap_or_default();
    let slide = slide_name(imported);
    let rotation = found.mount.rotation;
    let place = found.mount.translation.vector;
    let mut text = String::new();
    let n_joints = found.moving.len();
    let n_fingers = report.fingertips.len();
    let mut line = |content: String| {
        text.push_str(&content);
        text.push('\n');
    };
    line("# docs/hands.md describes every key. README.md lists what was found and assumed.".to_owned());
    line(format!("schema = {SCHEMA}"));
    line(format!("name = {}", quoted(&request.name)));
    line(format!("description = {}", quoted(&format!("{n_fingers} fingers, {n_joints} moving joints; from {file}"))));
    line(format!("model = {}", quoted(MODEL_FILE)));
    line(format!("palm = {}", quoted(&found.palm)));
    line(format!("fingertips = {}", list(&report.fingertips)));
    if !found.stuck.is_empty() || !imported.passive.is_empty() {
        let joints: Vec<String> = std::iter::once(slide.clone()).chain(found.moving.iter().cloned()).collect();
        line(format!("posture_joints = {}", list(&joints)));
    }
    line("# An SPDX expression for the files here, such as \"BSD-3-Clause\".".to_owned());
    line("licence = \"unknown\"".to_owned());
    line(format!("provenance = {}", list(&[format!("{file}, SHA-256 {digest}")])));
    line(format!("\n# The palm's approach, {}, points down; the grasp is above x = y = 0.", fixed(&found.approach)));
    line("[mount]".to_owned());
    line(format!("position = {}", fixed(place.as_slice())));
    let round = |v: f64| (v * 1e8).round() / 1e8;
    line(format!("quaternion = {}", fixed(&[rotation.w, rotation.i, rotation.j, rotation.k].map(round))));
    line("\n[slide]".to_owned());
    line(format!("name = {}", quoted(&slide)));
    line(format!("range = {}", fixed(&found.slide_range)));
    line("start = 0.0".to_owned());
    line("# A faster rise often shakes the object off.".to_owned());
    line("rise_speed = 0.25".to_owned());
    line("\n[open_posture]".to_owned());
    for (joint, value) in &found.open_posture {
        let _ = writeln!(text, "{} = {:?}", quoted(joint), value);
    }
    text.push_str(
        "\n# 1: the actuator closes the hand at the upper end of its range; -1: at the lower end.\n[closing]\n",
    );
    for (names, sign) in [(&report.close_up, 1), (&report.close_down, -1)] {
        for name in names {
            let _ = writeln!(text, "{} = {sign}", quoted(name));
        }
    }
    let _ = write!(text, "\n[objects]\nscale = {:?}\n", found.object_scale);
    if report.tried > 0 {
        let [tried, lifted, reached] = [report.tried, report.lifted, report.reached];
        let _ = write!(
            text,
            "\n# What became of scripted grasps of every object when this file was made.\n[scripted_grasps]\n\
             tried = {tried}\nlifted = {lifted}\nreached = {reached}\n"
        );
    }
    text
}

/// Describes what was found and assumed, for `README.md` and the terminal.
pub fn describe_new_hand(report: &NewHandReport) -> String {
    let mut text = String::new();
    let centimetres = |metres: f64| format!("{:.1} cm", 100.0 * metres);
    let _ =
        writeln!(text, "- palm: `{}`; it approaches objects along {} of its frame", report.palm, axis(report.approach));
    let fingers: Vec<String> = report
        .fingertips
        .iter()
        .zip(&report.reach_m)
        .map(|(tip, reach)| format!("`{tip}` ({} from the finger's first joint)", centimetres(*reach)))
        .collect();
    let _ = writeln!(text, "- {} fingertips: {}", fingers.len(), fingers.join(", "));
    for (what, actuators) in [
        ("close the hand at the upper end of their range", &report.close_up),
        ("close the hand at the lower end of their range", &report.close_down),
        ("neither close nor open it", &report.neither),
    ] {
        if !actuators.is_empty() {
            let _ = writeln!(text, "- actuators that {what}: {}", actuators.join(", "));
        }
    }
    let _ = writeln!(
        text,
        "- the open hand is {} wide between its fingertips; the objects are scaled by {}",
        centimetres(report.opening_m),
        report.object_scale
    );
    let _ = writeln!(
        text,
        "- at the chosen place, scripted grasps (come down, close, raise to a goal) drag the object aside by {} on average",
        centimetres(report.drag_m)
    );
    report.broken.iter().for_each(|condition| text.push_str(&format!("- fails the hand contract: {condition}\n")));
    report.symptoms.iter().for_each(|symptom| text.push_str(&format!("- look at its {symptom}\n")));
    report.notes.iter().for_each(|note| text.push_str(&format!("- {note}\n")));
    text
}

fn axis(direction: [f64; 3]) -> String {
    let along = |i: usize| direction[i].abs() > 1.0 - 1e-9;
    match (0..3).find(|&i| along(i)) {
        Some(i) => format!("{}{}", if direction[i] < 0.0 { "-" } else { "+" }, ["x", "y", "z"][i]),
        None => format!("({:.2}, {:.2}, {:.2})", direction[0], direction[1], direction[2]),
    }
}

/// Returns the text of `README.md`.
pub(super) fn readme(request: &NewHand, report: &NewHandReport) -> String {
    let file = request.source.file_name().unwrap_or_default().to_string_lossy();
    format!(
        "# {}\n\nMade from `{file}` by `eigenhand hands new`. `model.xml` is that file, repaired or converted for MuJoCo 2.2.2; \
         `hand.toml` describes how to use it.\n\n{}\n\n## Found and assumed\n\n{}",
        request.name,
        report.verdict(),
        describe_new_hand(report)
    )
}
