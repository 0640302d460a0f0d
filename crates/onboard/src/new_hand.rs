//! `hands new`: turns a model file, as its makers publish it, into a plugin directory that trains.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use eigenhand_files::{cannot, create_directory};
use eigenhand_hands::xml::{append_section, attribute, element, elements, elements_mut, numbers, print, set};
use eigenhand_hands::xmltree::{Element, XMLNode};
use eigenhand_hands::{Hand, ImportOptions, Imported, MANIFEST_FILE, import, is_hand_name};
use eigenhand_mujoco::MuJoCo;
use eigenhand_sim::{GraspTask, Setting};
use nalgebra::Vector3;
use serde::Serialize;

use crate::error::OnboardError;
use crate::survey::{Closing, Hints, Survey, arm, survey};
use crate::trial::{Place, best_place};

mod texts;

pub use texts::describe_new_hand;
use texts::{manifest, readme};

const MODEL_FILE: &str = "model.xml";
const ASSETS: &str = "assets";
const README: &str = "README.md";
/// Names of licence files.
const LICENCES: [&str; 4] = ["LICENSE", "LICENSE.txt", "LICENSE.md", "COPYING"];
/// Number of directories, from the model upwards, that are searched for its licence.
const LICENCE_LEVELS: usize = 3;

/// The request for a new hand.
#[derive(Clone, Debug)]
pub struct NewHand {
    /// Name of the hand.
    pub name: String,
    /// Its model file, MJCF or URDF.
    pub source: PathBuf,
    /// The hand's directory, which is created.
    pub directory: PathBuf,
    /// Options for the reader of the file.
    pub options: ImportOptions,
    /// Hints for the survey.
    pub hints: Hints,
}

/// The new hand, with everything that was found and assumed.
#[derive(Clone, Debug, Serialize)]
pub struct NewHandReport {
    /// Name of the hand.
    pub name: String,
    /// The hand's directory.
    pub directory: PathBuf,
    /// Body of the palm.
    pub palm: String,
    /// Direction of approach in the palm's frame.
    pub approach: [f64; 3],
    /// Names of the fingertips' sites.
    pub fingertips: Vec<String>,
    /// Length of each finger in m, in the same order.
    pub reach_m: Vec<f64>,
    /// Distance in m between opposing fingertips of the open hand.
    pub opening_m: f64,
    /// Factor on the objects' lengths.
    pub object_scale: f64,
    /// Number of scripted grasps at the chosen place that lifted the object, and number of all scripted grasps there.
    pub lifted: [u32; 2],
    /// Actuators that close the hand at the upper end of their range.
    pub close_up: Vec<String>,
    /// Actuators that close the hand at the lower end of their range.
    pub close_down: Vec<String>,
    /// All other actuators.
    pub neither: Vec<String>,
    /// Changes to the file, omissions and assumptions.
    pub notes: Vec<String>,
}

/// Reads, surveys and writes a hand; scripted grasps in `setting` choose its place.
///
/// `notes` receives every change to the file, also when an error follows.
///
/// # Errors
/// [`OnboardError::Hand`] for a faulty file, [`OnboardError::MuJoCo`] for a model that MuJoCo refuses,
/// [`OnboardError::Survey`] if the palm or the fingers are not found, [`OnboardError::HandExists`] for a directory that
/// exists and is not empty. After an error, no file is left behind.
pub fn new_hand(
    request: &NewHand,
    library: &Arc<MuJoCo>,
    setting: &Setting,
    notes: &mut Vec<String>,
) -> Result<NewHandReport, OnboardError> {
    let directory = &request.directory;
    if !is_hand_name(&request.name) {
        return Err(OnboardError::HandName { got: request.name.clone() });
    }
    let occupied = directory.is_file() || fs::read_dir(directory).is_ok_and(|mut entries| entries.next().is_some());
    if occupied {
        return Err(OnboardError::HandExists { path: directory.clone() });
    }
    let mut imported = import(&request.source, &request.options, notes)?;
    if let Some(arm) = arm(library, &imported.model, &imported.assets, &request.hints)? {
        imported.leave_out_arm(&arm.hand, &arm.joints, notes);
    }
    let mut found = survey(library, &imported.model, &imported.assets, &request.hints)?;
    found.moving.retain(|joint| !imported.passive.contains(joint));
    let tips = add_tips(&mut imported.model, &found);
    exclude_overlaps(&mut imported.model, &found, notes);
    clear_the_way(&mut imported.model, &found, notes);
    name_meshes_directory(&mut imported);
    if !found.stuck.is_empty() {
        notes.push(format!("the posture leaves out joints that no actuator moves: {}", found.stuck.join(", ")));
    }
    let report = report(request, &found, tips, notes.clone());
    write(request, &imported, found, report, library, setting)
}

fn report(request: &NewHand, found: &Survey, fingertips: Vec<String>, notes: Vec<String>) -> NewHandReport {
    let those = |which: Closing| {
        found.closing.iter().filter(|(_, closing)| *closing == which).map(|(name, _)| name.clone()).collect()
    };
    NewHandReport {
        name: request.name.clone(),
        directory: request.directory.clone(),
        palm: found.palm.clone(),
        approach: found.approach,
        fingertips,
        reach_m: found.fingers.iter().map(|finger| finger.reach).collect(),
        opening_m: found.opening,
        object_scale: found.object_scale,
        lifted: [0, 0],
        close_up: those(Closing::Up),
        close_down: those(Closing::Down),
        neither: those(Closing::Neither),
        notes,
    }
}

/// Puts a site on the tip of every finger and returns their names.
fn add_tips(model: &mut Element, found: &Survey) -> Vec<String> {
    let mut taken = BTreeSet::new();
    names(model, &mut taken);
    let mut tips = Vec::new();
    for finger in &found.fingers {
        let mut name = format!("{}_{}", finger.body, if finger.body.ends_with("tip") { "site" } else { "tip" });
        while taken.contains(&name) {
            name.push('_');
        }
        taken.insert(name.clone());
        let attributes = [
            ("name", name.clone()),
            ("pos", numbers(&finger.tip)),
            ("size", "0.003".to_owned()),
            ("group", "4".to_owned()),
        ];
        if let Some(body) = body_named(model, &finger.body) {
            body.children.insert(0, XMLNode::Element(element("site", &attributes)));
        }
        tips.push(name);
    }
    tips
}

fn names(element: &Element, found: &mut BTreeSet<String>) {
    found.extend(element.attributes.get("name").cloned());
    elements(element).for_each(|child| names(child, found));
}

fn body_named<'a>(element: &'a mut Element, name: &str) -> Option<&'a mut Element> {
    if element.name == "body" && attribute(element, "name") == Some(name) {
        return Some(element);
    }
    elements_mut(element).filter(|e| matches!(e.name.as_str(), "worldbody" | "body")).find_map(|e| body_named(e, name))
}

fn exclude_overlaps(model: &mut Element, found: &Survey, notes: &mut Vec<String>) {
    if found.overlaps.is_empty() {
        return;
    }
    let exclude = |(a, b): &(String, String)| element("exclude", &[("body1", a.clone()), ("body2", b.clone())]);
    append_section(model, "contact", found.overlaps.iter().map(exclude));
    let pairs: Vec<String> = found.overlaps.iter().map(|(a, b)| format!("{a} and {b}")).collect();
    notes.push(format!("contacts between links that overlap at rest are switched off: {}", pairs.join(", ")));
}

/// Switches off the contacts of bodies above the palm that would touch the plane first. On a real robot, these bodies
/// are beside the table.
fn clear_the_way(model: &mut Element, found: &Survey, notes: &mut Vec<String>) {
    for name in &found.in_the_way {
        let geoms =
            body_named(model, name).into_iter().flat_map(|body| elements_mut(body).filter(|e| e.name == "geom"));
        for geom in geoms {
            for bits in ["contype", "conaffinity"] {
                set(geom, bits, "0");
            }
        }
    }
    if !found.in_the_way.is_empty() {
        let names = found.in_the_way.join(", ");
        notes.push(format!("contacts of bodies that would touch the plane before the palm are switched off: {names}"));
    }
}

fn name_meshes_directory(imported: &mut Imported) {
    if !imported.assets.is_empty() {
        let compiler = element("compiler", &[("meshdir", ASSETS.to_owned())]);
        imported.model.children.insert(0, XMLNode::Element(compiler));
    }
}

/// Writes the hand to a temporary directory, reads it back, finds the hand's place by scripted grasps, and renames the
/// directory.
fn write(
    request: &NewHand,
    imported: &Imported,
    mut found: Survey,
    mut report: NewHandReport,
    library: &Arc<MuJoCo>,
    setting: &Setting,
) -> Result<NewHandReport, OnboardError> {
    let directory = &request.directory;
    let parent = directory.parent().filter(|path| !path.as_os_str().is_empty()).unwrap_or(Path::new("."));
    create_directory(parent)?;
    // The directory is removed with its content if a line below fails.
    let partial = tempfile::Builder::new()
        .prefix(&format!(".{}.", request.name))
        .permissions(fs::Permissions::from_mode(0o777))
        .tempdir_in(parent)
        .map_err(cannot("create a directory in", parent))?;
    let place = |name: &str| partial.path().join(name);
    let save = |path: PathBuf, bytes: &[u8]| fs::write(&path, bytes).map_err(cannot("write", &path));
    save(place(MODEL_FILE), print(&imported.model).as_bytes())?;
    if !imported.assets.is_empty() {
        create_directory(&place(ASSETS))?;
    }
    for (name, bytes) in &imported.assets {
        save(place(ASSETS).join(name), bytes)?;
    }
    save(place(MANIFEST_FILE), manifest(request, imported, &found, &report).as_bytes())?;
    if let Some(licence) = licence_of(&request.source) {
        let copy = partial.path().join(licence.file_name().unwrap_or_default());
        fs::copy(&licence, &copy).map_err(cannot("copy", &licence))?;
    }
    let Place { shift, lifted, tried } = best_place_of(&Hand::load(partial.path())?, library, setting)?;
    let moved = found.mount.translation.vector + Vector3::new(shift[0], shift[1], 0.0);
    found.mount.translation.vector = moved.map(|v| (v * 1e4).round() / 1e4);
    report.lifted = [lifted, tried];
    save(place(MANIFEST_FILE), manifest(request, imported, &found, &report).as_bytes())?;
    save(place(README), readme(request, &report).as_bytes())?;
    Hand::load(partial.path())?;
    if directory.is_dir() {
        fs::remove_dir(directory).map_err(cannot("replace", directory))?;
    }
    fs::rename(partial.path(), directory).map_err(cannot("write", directory))?;
    Ok(report)
}

fn best_place_of(hand: &Hand, library: &Arc<MuJoCo>, setting: &Setting) -> Result<Place, OnboardError> {
    let task = GraspTask::new(library, hand, setting)?;
    Ok(best_place(&Arc::new(task), &hand.manifest.closing, hand.manifest.objects.scale)?)
}

fn licence_of(source: &Path) -> Option<PathBuf> {
    let source = source.canonicalize().ok()?;
    source
        .ancestors()
        .skip(1)
        .take(LICENCE_LEVELS)
        .flat_map(|directory| LICENCES.map(|name| directory.join(name)))
        .find(|path| path.is_file())
}

fn slide_name(imported: &Imported) -> String {
    let mut taken = BTreeSet::new();
    names(&imported.model, &mut taken);
    let mut name = "slide".to_owned();
    while taken.contains(&name) {
        name.insert_str(0, "hand_");
    }
    name
}
