//! `hands new`: turns a model file, as its makers publish it, into a plugin directory that trains.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use eigenhand_files::{cannot, create_directory};
use eigenhand_hands::xml::print;
use eigenhand_hands::xmltree::Element;
use eigenhand_hands::{Hand, ImportOptions, Imported, MANIFEST_FILE, import, is_hand_name};
use eigenhand_mujoco::MuJoCo;
use eigenhand_sim::contract;
use eigenhand_sim::{GraspTask, Setting};
use nalgebra::Vector3;
use serde::Serialize;

use crate::error::OnboardError;
use crate::survey::{Closing, Hints, Survey, arm, other_hands, survey};
use crate::symptoms::{Symptom, symptoms};
use crate::trial::{OnGrasp, Place, Search, best_place};

mod model;
mod texts;
mod verdict;

use model::{add_tips, clear_the_way, colour_plain, exclude_overlaps, leave_out_others, name_meshes_directory};
pub use texts::describe_new_hand;
use texts::{manifest, readme};

const MODEL_FILE: &str = "model.xml";
const ASSETS: &str = "assets";
const README: &str = "README.md";
/// Names of licence files.
const LICENCES: [&str; 4] = ["LICENSE", "LICENSE.txt", "LICENSE.md", "COPYING"];
/// Height in m above rest to which the top of the slide lifts objects, and the shortest and longest slide in m.
const TOP: f64 = 0.21;
const SHORTEST_SLIDE: f64 = 0.15;
const LONGEST_SLIDE: f64 = 0.3;
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
    /// Number of scripted grasps at the chosen place.
    pub tried: u32,
    /// Those that lifted the object.
    pub lifted: u32,
    /// Those that brought the object to its goal, as episodes of training must.
    pub reached: u32,
    /// Those after which the closed hand did not touch the object.
    pub missed: u32,
    /// Mean distance in m by which lifted objects were dragged aside.
    pub drag_m: f64,
    /// Conditions of the hand contract that do not hold, each with what to change.
    pub broken: Vec<String>,
    /// Signs of a fault in the hand's model.
    pub symptoms: Vec<Symptom>,
    /// Actuators that close the hand at the upper end of their range.
    pub close_up: Vec<String>,
    /// Actuators that close the hand at the lower end of their range.
    pub close_down: Vec<String>,
    /// All other actuators.
    pub neither: Vec<String>,
    /// Changes to the file, omissions and assumptions.
    pub notes: Vec<String>,
}

/// What is at work while a hand is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The survey moves the hand.
    Survey,
    /// Scripted grasps try a direction of approach: its number, and the number of directions.
    Approach(usize, usize),
    /// Scripted grasps: those that are done, and all of them.
    Grasps(usize, usize),
    /// The contract is checked.
    Contract,
}

impl std::fmt::Display for Step {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Step::Survey => write!(f, "survey: the hand is moved to find its palm and its fingers"),
            Step::Approach(number, all) => write!(f, "approach {number} of {all}"),
            Step::Grasps(done, all) => write!(f, "scripted grasps {done} of {all}"),
            Step::Contract => write!(f, "hand contract"),
        }
    }
}

/// Receives the steps; several threads call it.
pub type OnStep<'a> = dyn Fn(Step) + Sync + 'a;

/// Reads, surveys and writes a hand; scripted grasps in `setting` choose its approach and its place, and tell whether it
/// can grasp. At the end the contract is checked.
///
/// `notes` receives every change to the file, also when an error follows; `on_step` receives the steps.
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
    on_step: &OnStep,
) -> Result<NewHandReport, OnboardError> {
    let directory = &request.directory;
    if !is_hand_name(&request.name) {
        return Err(OnboardError::HandName { got: request.name.clone() });
    }
    let occupied = directory.is_file() || fs::read_dir(directory).is_ok_and(|mut entries| entries.next().is_some());
    if occupied {
        return Err(OnboardError::HandExists { path: directory.clone() });
    }
    on_step(Step::Survey);
    let mut imported = import(&request.source, &request.options, notes)?;
    if let Some(arm) = arm(library, &imported.model, &imported.assets, &request.hints)? {
        imported.leave_out_arm(&arm.hand, &arm.joints, notes);
    }
    if let Some(others) = other_hands(library, &imported.model, &imported.assets, &request.hints)? {
        leave_out_others(&mut imported, &others, notes);
    }
    let mut surveys = survey(library, &imported.model, &imported.assets, &request.hints)?;
    surveys.iter_mut().for_each(|found| found.moving.retain(|joint| !imported.passive.contains(joint)));
    let drafts: Vec<Draft> =
        surveys.into_iter().map(|found| Draft::new(request, &imported.model, found, notes)).collect();
    let report = write(request, &mut imported, drafts, &Trials { library, setting, on_step })?;
    notes.clone_from(&report.notes);
    Ok(report)
}

/// A hand with one of the directions in which it may approach an object.
struct Draft {
    model: Element,
    found: Survey,
    report: NewHandReport,
}

impl Draft {
    fn new(request: &NewHand, model: &Element, found: Survey, notes: &[String]) -> Draft {
        let (mut model, mut notes) = (model.clone(), notes.to_vec());
        let tips = add_tips(&mut model, &found);
        colour_plain(&mut model, &found);
        exclude_overlaps(&mut model, &found, &mut notes);
        clear_the_way(&mut model, &found, &mut notes);
        if !found.stuck.is_empty() {
            notes.push(format!("the posture leaves out joints that no actuator moves: {}", found.stuck.join(", ")));
        }
        let report = report(request, &found, tips, notes);
        Draft { model, found, report }
    }
}

/// What scripted grasps need besides the hand.
struct Trials<'a> {
    library: &'a Arc<MuJoCo>,
    setting: &'a Setting,
    on_step: &'a OnStep<'a>,
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
        lifted: 0,
        reached: 0,
        missed: 0,
        tried: 0,
        drag_m: 0.0,
        broken: Vec::new(),
        symptoms: Vec::new(),
        close_up: those(Closing::Up),
        close_down: those(Closing::Down),
        neither: those(Closing::Neither),
        notes,
    }
}

/// Writes the hand to a temporary directory, reads it back, finds its approach and its place by scripted grasps, checks
/// the contract, and renames the directory.
fn write(
    request: &NewHand,
    imported: &mut Imported,
    mut drafts: Vec<Draft>,
    trials: &Trials,
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
    if !imported.assets.is_empty() {
        create_directory(&place(ASSETS))?;
    }
    for (name, bytes) in &imported.assets {
        save(place(ASSETS).join(name), bytes)?;
    }
    if let Some(licence) = licence_of(&request.source) {
        let copy = partial.path().join(licence.file_name().unwrap_or_default());
        fs::copy(&licence, &copy).map_err(cannot("copy", &licence))?;
    }
    let save_draft = |imported: &mut Imported, draft: &Draft| {
        imported.model.clone_from(&draft.model);
        name_meshes_directory(imported);
        save(place(MODEL_FILE), print(&imported.model).as_bytes())?;
        save(place(MANIFEST_FILE), manifest(request, imported, &draft.found, &draft.report).as_bytes())?;
        Ok::<Hand, OnboardError>(Hand::load(partial.path())?)
    };
    let mut best = 0;
    if drafts.len() > 1 {
        let mut promises = Vec::new();
        for (i, draft) in drafts.iter().enumerate() {
            (trials.on_step)(Step::Approach(i + 1, drafts.len()));
            promises.push(save_draft(imported, draft).and_then(|hand| trials.promise(&hand)));
        }
        best = likeliest(&promises);
    }
    let Draft { model, mut found, mut report } = drafts.swap_remove(best);
    let draft = Draft { model, found: found.clone(), report: report.clone() };
    let Place { shift, grasps, .. } = trials.best_place(&save_draft(imported, &draft)?)?;
    let moved = found.mount.translation.vector + Vector3::new(shift[0], shift[1], 0.0);
    found.mount.translation.vector = moved.map(|v| (v * 1e4).round() / 1e4);
    found.slide_range = lower_top(found.slide_range, grasps.height);
    report.take(&grasps);
    let hand = save_draft(imported, &Draft { model: draft.model, found, report: report.clone() })?;
    (trials.on_step)(Step::Contract);
    let contract = contract::check(&hand, trials.library, trials.setting);
    // The verdict tells of the grasps.
    report.broken =
        contract.faults().filter(|check| check.name != contract::GRASPS).map(|check| check.to_string()).collect();
    if contract.compiles() {
        report.symptoms = symptoms(&hand, &GraspTask::new(trials.library, &hand, trials.setting)?)?;
    }
    save(place(README), readme(request, &report).as_bytes())?;
    if directory.is_dir() {
        fs::remove_dir(directory).map_err(cannot("replace", directory))?;
    }
    fs::rename(partial.path(), directory).map_err(cannot("write", directory))?;
    Ok(report)
}

/// Returns the index of the approach that promises most. An earlier one is kept unless a later one is clearly better.
fn likeliest(promises: &[Result<Place, OnboardError>]) -> usize {
    const CLEARLY: f64 = 0.08;
    let merit = |i: usize| promises[i].as_ref().map_or(f64::NEG_INFINITY, |place| place.merit);
    (1..promises.len()).fold(0, |best, i| if merit(i) > merit(best) + CLEARLY { i } else { best })
}

/// Moves the top of the slide so that it lifts objects to [`TOP`] above rest, given the height to which it lifts them
/// now. Goals lie below, so a hand that stands at its stop does not miss all of them.
fn lower_top([low, high]: [f64; 2], height: Option<f64>) -> [f64; 2] {
    let by = height.map_or(0.0, |height| TOP - height);
    let top = (high + by).clamp(low + SHORTEST_SLIDE, low + LONGEST_SLIDE);
    [low, (top.max(0.0) * 1e4).round() / 1e4]
}

impl Trials<'_> {
    /// Tries every second object at few places.
    fn promise(&self, hand: &Hand) -> Result<Place, OnboardError> {
        let objects = self.setting.objects.iter().step_by(2).cloned().collect();
        self.search(hand, &Setting { objects, ..self.setting.clone() }, Search::Quick, &|_, _| {})
    }

    fn best_place(&self, hand: &Hand) -> Result<Place, OnboardError> {
        self.search(hand, self.setting, Search::Whole, &|done, all| (self.on_step)(Step::Grasps(done, all)))
    }

    fn search(
        &self,
        hand: &Hand,
        setting: &Setting,
        search: Search,
        on_grasp: &OnGrasp,
    ) -> Result<Place, OnboardError> {
        let task = Arc::new(GraspTask::new(self.library, hand, setting)?);
        let manifest = &hand.manifest;
        let n_fingertips = hand.fingertips.len();
        Ok(best_place(&task, &manifest.closing, manifest.objects.scale, n_fingertips, search, on_grasp)?)
    }
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
