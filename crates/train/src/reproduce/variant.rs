//! What the runs of an experiment differ in, besides their seed.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::VARIED;
use super::spaces::SPACES;

/// What an experiment compares.
#[derive(Clone, Debug, PartialEq)]
pub enum Comparison {
    /// How far the policies are confined to their synergies.
    Lambdas(Vec<f64>),
    /// In which space a policy learns to act: every joint, numbers of a synergy, random directions, or one number by hand.
    ControlStudy,
}

/// Runs that differ in their seed alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// Its name, with which the names of its runs begin.
    pub name: String,
    /// What it is, in words.
    pub title: String,
    /// How far the policies are confined to their synergies.
    pub lambda: f64,
    /// Where the policies act; none if they command every joint.
    pub space: Option<Numbers>,
}

/// Numbers in which a policy acts.
#[derive(Clone, Debug, PartialEq)]
pub struct Numbers {
    /// Along which directions.
    pub directions: Directions,
    /// How many.
    pub components: usize,
}

/// Directions of a space, each for one number.
#[derive(Clone, Debug, PartialEq)]
pub enum Directions {
    /// Those of the synergy that the run of this variant with the same seed exported.
    Synergy(String),
    /// Random ones, with mean and range of the numbers from the synergy of this variant.
    Random(String),
    /// One direction, from the open hand to all closing actuators closed.
    Closing,
}

impl Comparison {
    /// Returns the variants, in the order in which the runs of a seed are trained; `components` is that of the runs'
    /// configuration.
    pub fn variants(&self, components: usize) -> Vec<Variant> {
        match self {
            Comparison::Lambdas(lambdas) => lambdas.iter().map(|&lambda| Variant::of_lambda(lambda)).collect(),
            Comparison::ControlStudy => control_study(components),
        }
    }

    /// Returns keys of the configuration in which the runs may differ.
    pub fn varied(&self) -> Vec<&'static str> {
        let own: &[&str] = match self {
            Comparison::Lambdas(_) => return VARIED.to_vec(),
            Comparison::ControlStudy => &["lambda", "seed", "action_space", "episodes", "synergy.components"],
        };
        [own, &self.free()].concat()
    }

    /// Returns keys in which a run may differ from what this experiment asks of it, because no policy learns from them:
    /// a study takes runs that were trained for another experiment, with other distances between evaluations.
    pub(super) fn free(&self) -> Vec<&'static str> {
        match self {
            Comparison::Lambdas(_) => vec!["workers"],
            Comparison::ControlStudy => vec!["workers", "synergy.file", "evaluation.every", "evaluation.few_numbers"],
        }
    }
}

impl Variant {
    fn of_lambda(lambda: f64) -> Variant {
        Variant { name: format!("l{lambda}"), title: format!("lambda {lambda}"), lambda, space: None }
    }

    /// Returns the name of the run with a seed.
    pub fn run_name(&self, seed: u64) -> String {
        run_name(&self.name, seed)
    }

    /// (directory of the runs, seed) => the synergy in which the policy acts
    pub(super) fn synergy_path(&self, directory: &Path, seed: u64) -> Option<PathBuf> {
        let made = |name: &str| directory.join(SPACES).join(format!("{}.toml", run_name(name, seed)));
        Some(match &self.space.as_ref()?.directions {
            Directions::Synergy(variant) => directory.join(run_name(variant, seed)),
            Directions::Random(_) | Directions::Closing => made(&self.name),
        })
    }

    /// (training episodes of a run that commands every joint) => those of a run of this variant
    ///
    /// In few numbers, policies learn in a small part of the episodes, so their runs are shorter.
    pub(super) fn episodes(&self, all_joints: u64) -> u64 {
        if self.space.is_some() { all_joints.div_ceil(3) } else { all_joints }
    }

    /// Returns the variant whose run with the same seed has to be complete before.
    pub(super) fn needs(&self) -> Option<&str> {
        match &self.space.as_ref()?.directions {
            Directions::Synergy(variant) | Directions::Random(variant) => Some(variant),
            Directions::Closing => None,
        }
    }
}

/// `<variant>-s<seed>`
pub(super) fn run_name(variant: &str, seed: u64) -> String {
    format!("{variant}-s{seed}")
}

/// Names of the variants whose synergies the others act in: lambda 0 and 1.
const FREE: &str = "joints";
const CONFINED: &str = "confined";

fn control_study(components: usize) -> Vec<Variant> {
    let joints = |name: &str, title: String, lambda| Variant { name: name.to_owned(), title, lambda, space: None };
    // Lambda has no meaning for a policy that acts in a given space.
    let acting = |name: String, title: String, directions, components| Variant {
        name,
        title,
        lambda: 1.0,
        space: Some(Numbers { directions, components }),
    };
    let numbers = |k: usize| if k == 1 { "1 number".to_owned() } else { format!("{k} numbers") };
    let mut variants = vec![
        joints(FREE, "every joint (lambda 0)".to_owned(), 0.0),
        joints(CONFINED, format!("every joint, confined to {} while it learns (lambda 1)", numbers(components)), 1.0),
        acting(
            format!("free-synergy-{components}"),
            format!("{} of the synergy of lambda 0", numbers(components)),
            Directions::Synergy(FREE.to_owned()),
            components,
        ),
    ];
    let mut fewer = vec![components];
    fewer.extend([3, 2, 1].into_iter().filter(|k| *k < components));
    variants.extend(fewer.into_iter().map(|k| {
        let title = format!("{} of the synergy of lambda 1", numbers(k));
        acting(format!("synergy-{k}"), title, Directions::Synergy(CONFINED.to_owned()), k)
    }));
    let title = format!("{} along random directions", numbers(components));
    variants.push(acting(format!("random-{components}"), title, Directions::Random(CONFINED.to_owned()), components));
    let title = "1 number by hand: all closing joints together".to_owned();
    variants.push(acting("closing-1".to_owned(), title, Directions::Closing, 1));
    variants
}

/// The file of a study, beside its runs: which runs belong to which variant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StudyFile {
    /// Version of these keys.
    pub schema: u32,
    /// In what the variants differ, as the head of a column.
    #[serde(default = "commands")]
    pub varies: String,
    /// What it compares, for a title.
    #[serde(default = "space")]
    pub subject: String,
    /// The variants; the others are compared with the first.
    pub variants: Vec<StudyVariant>,
}

/// In what the variants of a study of action spaces differ.
pub(super) fn commands() -> String {
    "the policy commands".to_owned()
}

/// What a study of action spaces compares.
pub(super) fn space() -> String {
    "the space in which a policy learns to act".to_owned()
}

/// The runs of a variant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StudyVariant {
    /// Its name.
    pub name: String,
    /// What it is, in words.
    pub title: String,
    /// Names of its runs' directories.
    pub runs: Vec<String>,
}

/// Name of the file of a study.
pub const STUDY: &str = "study.json";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_study_compares_each_space_and_needs_its_source_first() {
        let variants = Comparison::ControlStudy.variants(5);
        let names: Vec<&str> = variants.iter().map(|variant| variant.name.as_str()).collect();
        assert_eq!(
            names,
            [
                "joints",
                "confined",
                "free-synergy-5",
                "synergy-5",
                "synergy-3",
                "synergy-2",
                "synergy-1",
                "random-5",
                "closing-1"
            ]
        );
        for (i, variant) in variants.iter().enumerate() {
            let before = |name: &str| names[..i].contains(&name);
            assert!(variant.needs().is_none_or(before), "{} comes after the run that it needs", variant.name);
        }
        let path = |name: &str| {
            let variant = variants.iter().find(|variant| variant.name == name).expect("a variant");
            variant.synergy_path(Path::new("all"), 2)
        };
        assert_eq!(path("joints"), None);
        assert_eq!(path("synergy-3"), Some("all/confined-s2".into()));
        assert_eq!(path("random-5"), Some("all/spaces/random-5-s2.toml".into()));
        let few: Vec<String> = Comparison::ControlStudy.variants(2).into_iter().map(|v| v.name).collect();
        assert_eq!(few[3..], ["synergy-2", "synergy-1", "random-2", "closing-1"]);
    }
}
