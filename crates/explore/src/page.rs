//! One HTML page without other files.

use eigenhand_hands::Hand;
use eigenhand_sim::GraspTask;
use eigenhand_sim::scene::MOUNT;
use eigenhand_synergy::{JointInfo, NamedGrasp, Space, SynergyFile};
use serde::Serialize;

use crate::error::ExploreError;
use crate::recording::{Played, Recording};
use crate::surfaces::{Part, Surface, Tip, parts, surfaces, tips};
use crate::words::Words;

const HTML: &str = include_str!("page/page.html");
const CSS: &str = include_str!("page/page.css");
const JS: &str = include_str!("page/page.js");

/// What the page computes with.
#[derive(Serialize)]
struct Content<'a> {
    title: &'a str,
    hand: &'a str,
    space: Space,
    numbers: Vec<Number>,
    recommended: Option<usize>,
    /// q = mean + z matrix, clamped.
    joints: Affine<'a>,
    /// u = mean + z matrix, clamped; none for a synergy of postures.
    commands: Option<Affine<'a>>,
    grasps: &'a [NamedGrasp],
    parts: Vec<Part>,
    /// Index of the palm among the parts.
    palm: Option<usize>,
    surfaces: Vec<Surface>,
    tips: Vec<Tip>,
    beside: Option<Beside<'a>>,
    recordings: Vec<Played<'a>>,
}

/// A second synergy, which moves a second hand.
#[derive(Serialize)]
struct Beside<'a> {
    title: &'a str,
    numbers: Vec<Number>,
    joints: Affine<'a>,
    grasps: &'a [NamedGrasp],
}

#[derive(Serialize)]
struct Number {
    least: f64,
    greatest: f64,
    /// Share of the variance.
    share: f64,
    words: String,
}

#[derive(Serialize)]
struct Affine<'a> {
    names: Vec<&'a str>,
    units: Vec<&'static str>,
    /// A limit that does not exist is absent.
    lower: Vec<Option<f64>>,
    upper: Vec<Option<f64>>,
    mean: &'a [f64],
    matrix: Vec<&'a [f64]>,
}

impl<'a> Affine<'a> {
    fn of(coordinates: &'a [JointInfo], mean: &'a [f64], matrix: Vec<&'a [f64]>) -> Affine<'a> {
        let finite = |limit: f64| limit.is_finite().then_some(limit);
        Affine {
            names: coordinates.iter().map(|joint| joint.name.as_str()).collect(),
            units: coordinates.iter().map(|joint| joint.unit.symbol()).collect(),
            lower: coordinates.iter().map(|joint| finite(joint.lower)).collect(),
            upper: coordinates.iter().map(|joint| finite(joint.upper)).collect(),
            mean,
            matrix,
        }
    }
}

/// A synergy that a page shows.
#[derive(Clone, Copy)]
pub struct Shown<'a> {
    /// The synergy.
    pub file: &'a SynergyFile,
    /// What it is.
    pub title: &'a str,
}

/// The maps from numbers to joint positions and to commands.
struct Maps<'a> {
    joints: Affine<'a>,
    commands: Option<Affine<'a>>,
}

impl<'a> Maps<'a> {
    /// # Errors
    /// [`ExploreError::OtherHand`], or [`ExploreError::NoJointMap`].
    fn of(hand: &Hand, file: &'a SynergyFile) -> Result<Maps<'a>, ExploreError> {
        let synergy = &file.synergy;
        let rows = (0..synergy.n_components()).map(|i| synergy.component(i)).collect::<Vec<_>>();
        let own = Affine::of(synergy.joints(), synergy.mean(), rows);
        let (joints, commands) = match (file.space, &file.joint_map) {
            (Space::Postures, _) => (own, None),
            (Space::Commands, None) => return Err(ExploreError::NoJointMap),
            (Space::Commands, Some(map)) => {
                let rows = map.matrix.iter().map(Vec::as_slice).collect();
                (Affine::of(&map.joints, &map.mean, rows), Some(own))
            }
        };
        let slide = &hand.manifest.slide.name;
        match joints.names.iter().find(|name| **name != slide && hand.joint(name).is_none()) {
            None => Ok(Maps { joints, commands }),
            Some(name) => Err(ExploreError::OtherHand { hand: hand.manifest.name.clone(), name: (*name).to_owned() }),
        }
    }
}

fn numbers(hand: &Hand, file: &SynergyFile) -> Vec<Number> {
    let (words, synergy) = (Words::of(hand, file.space), &file.synergy);
    let coordinates: Vec<&str> = synergy.joints().iter().map(|joint| joint.name.as_str()).collect();
    let number = |i: usize| Number {
        least: synergy.coefficient_min()[i],
        greatest: synergy.coefficient_max()[i],
        share: synergy.contribution()[i],
        words: words.sentence(&coordinates, synergy.component(i)),
    };
    (0..synergy.n_components()).map(number).collect()
}

/// Checks that a page can show a synergy of a hand, and another one beside it.
///
/// # Errors
/// As [`page`].
pub fn check(hand: &Hand, file: &SynergyFile, beside: Option<&SynergyFile>) -> Result<(), ExploreError> {
    maps(hand, file, beside).map(|_| ())
}

fn maps<'a>(
    hand: &Hand,
    file: &'a SynergyFile,
    beside: Option<&'a SynergyFile>,
) -> Result<(Maps<'a>, Option<Maps<'a>>), ExploreError> {
    let own = Maps::of(hand, file)?;
    let Some(second) = beside.map(|other| Maps::of(hand, other)).transpose()? else { return Ok((own, None)) };
    let [names, others] = [&own.joints.names, &second.joints.names];
    let alone = |name: &&&str| names.contains(name) != others.contains(name);
    match names.iter().chain(others).find(alone) {
        Some(name) => Err(ExploreError::DifferentJoints { name: (*name).to_owned() }),
        None => Ok((own, Some(second))),
    }
}

/// Returns a page that shows how the numbers of a synergy move a hand; `beside` is another synergy of the same hand, which
/// moves a second hand with the same sliders. The page plays the recordings.
///
/// # Errors
/// [`ExploreError::OtherHand`], [`ExploreError::DifferentJoints`] for two synergies whose joints differ,
/// [`ExploreError::NoJointMap`] for a space of commands without one, those of [`GraspTask::open_hand`].
pub fn page(
    hand: &Hand,
    task: &GraspTask,
    shown: Shown<'_>,
    beside: Option<Shown<'_>>,
    recordings: &[Recording],
) -> Result<String, ExploreError> {
    let Shown { file, title } = shown;
    let (Maps { joints, commands }, second) = maps(hand, file, beside.map(|other| other.file))?;
    let beside = beside.zip(second).map(|(other, maps)| Beside {
        title: other.title,
        numbers: numbers(hand, other.file),
        joints: maps.joints,
        grasps: &other.file.grasps,
    });
    let scene = task.scenes.first().ok_or(ExploreError::NoScene)?;
    let data = task.open_hand(scene)?;
    let palm = data.model().body(&hand.manifest.palm)?;
    let mount = data.model().body(MOUNT)?;
    let names: Vec<String> = joints.names.iter().map(|name| (*name).to_owned()).collect();
    let (bodies, parts) = parts(&data, mount, &names, &hand.manifest.slide.name);
    let height = data.qpos()[data.model().qpos_address(data.model().joint(&hand.manifest.slide.name)?)];
    let content = Content {
        title,
        hand: &hand.manifest.name,
        space: file.space,
        numbers: numbers(hand, file),
        recommended: file.recommended.as_ref().map(|recommended| recommended.components),
        joints,
        commands,
        grasps: &file.grasps,
        palm: bodies.iter().position(|body| *body == palm),
        surfaces: surfaces(&data, &bodies),
        tips: tips(hand, &data, &bodies)?,
        parts,
        beside,
        recordings: recordings.iter().filter_map(|recording| recording.played(height)).collect(),
    };
    // Inside a script element, `<` can begin its end or a comment.
    let json = serde_json::to_string(&content)?.replace('<', "\\u003c");
    Ok(filled(&[("title", &escaped(title)), ("css", CSS), ("js", JS), ("data", &json)]))
}

/// Fills the placeholders of the page; what is filled in is not searched for placeholders.
fn filled(values: &[(&str, &str)]) -> String {
    let mut page = String::new();
    for (i, part) in HTML.split("{{").enumerate() {
        let (name, rest) = if i == 0 { ("", part) } else { part.split_once("}}").unwrap_or(("", part)) };
        page.push_str(values.iter().find(|(known, _)| *known == name).map_or("", |(_, value)| value));
        page.push_str(rest);
    }
    page
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
