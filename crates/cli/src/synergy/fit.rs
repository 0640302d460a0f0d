//! `eigenhand synergy fit`

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::bail;
use eigenhand_hands::Hand;
use eigenhand_synergy::{JointMap, Space, Synergy, SynergyFile, export};
use eigenhand_train::{is_run, say};
use serde::Serialize;

use super::chosen::{ChoiceArgs, Chosen, OfRuns};
use crate::numbers::{LARGEST, whole};
use crate::output::{Outcome, percent, print, print_json};
use crate::program;

/// Components unless something else is asked for, as in training.
const COMPONENTS: usize = 5;
/// An eigenvalue below this share of the largest is no variation: its direction varies by less than a thousandth of the first.
const VARIES: f64 = 1e-6;

#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    choice: ChoiceArgs,
    /// Directory to write: new, empty, or an earlier synergy
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Number of components [default: 5, or as many as the samples have]
    #[arg(long, value_name = "K", value_parser = whole::<u64>(1..=LARGEST), conflicts_with = "variance")]
    components: Option<u64>,
    /// As few components as express this share of the variance, such as 0.9
    #[arg(long, value_name = "SHARE", value_parser = share)]
    variance: Option<f64>,
    /// Whether all samples count, or equally many of each object
    #[arg(long, value_enum, default_value = "equal")]
    weights: Weights,
    /// Prints one JSON document on standard output
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Weights {
    Equal,
    PerObject,
}

#[derive(Serialize)]
struct Report<'a> {
    out: &'a PathBuf,
    hand: &'a str,
    space: Space,
    samples: usize,
    components: usize,
    contribution: &'a [f64],
}

fn share(text: &str) -> Result<f64, String> {
    let inside = |share: &f64| *share > 0.0 && *share <= 1.0;
    text.parse().ok().filter(inside).ok_or_else(|| format!("expected a share above 0 and at most 1, got {text:?}"))
}

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    if args.out.parent().is_some_and(is_run) {
        bail!("{} is part of a run, which keeps its own synergy: choose another directory", args.out.display());
    }
    let Chosen { mut samples, space, hand, of_runs } = args.choice.read()?;
    if args.weights == Weights::PerObject {
        samples.balance()?;
    }
    let values: Vec<&[f64]> = samples.rows.iter().map(|row| row.values.as_slice()).collect();
    let all = Synergy::fit(&samples.coordinates, &values, samples.coordinates.len())?;
    let synergy = all.first(number_of_components(args, &all, &hand)?);
    let joint_map = match space {
        Space::Commands if !samples.joints.is_empty() => {
            let postures: Vec<&[f64]> = samples.rows.iter().map(|row| row.posture.as_slice()).collect();
            let mut joint_map = JointMap::fit(&synergy, &values, &samples.joints, &postures)?;
            match &hand {
                Ok(hand) => {
                    let free = hand.joints_free_of(synergy.joints().iter().map(|joint| joint.name.as_str()));
                    joint_map
                        .free
                        .extend(free.into_iter().filter(|name| samples.joints.iter().any(|j| j.name == *name)));
                }
                Err(_) => say!(
                    "note: the hand is not known, so joint_map.free does not say which joints stand for the arm; --hand names it"
                ),
            }
            Some(joint_map)
        }
        _ => None,
    };
    let file = SynergyFile {
        hand: match (&hand, of_runs) {
            (Ok(hand), _) => hand.manifest.name.clone(),
            (Err(_), Some(OfRuns { name, .. })) => name,
            (Err(_), None) => "unknown".to_owned(),
        },
        space,
        synergy,
        joint_map,
        actuation: hand
            .ok()
            .filter(|hand| space == Space::Postures && hand.posture == samples.coordinates)
            .map(|h| h.actuation()),
        recommended: None,
        grasps: Vec::new(),
        provenance: provenance(args),
    };
    export(&args.out, &file, &values)?;
    let synergy = &file.synergy;
    if args.json {
        print_json(&Report {
            out: &args.out,
            hand: &file.hand,
            space,
            samples: values.len(),
            components: synergy.n_components(),
            contribution: synergy.contribution(),
        })?;
    } else {
        let sum: f64 = synergy.contribution().iter().sum();
        print(&format!(
            "written: {}: {} components express {} of the variance of {} samples\nnext:    {}\n",
            args.out.display(),
            synergy.n_components(),
            percent(sum),
            values.len(),
            program::line(&format!("synergy show {}", program::path(&args.out)))
        ))?;
    }
    Ok(Outcome::Done)
}

/// Checks the number of components against the directions in which the samples vary.
///
/// Coupled joints differ a little in simulation, so a known hand has at most as many directions as actuators and free joints.
fn number_of_components(args: &Args, all: &Synergy, hand: &anyhow::Result<Hand>) -> anyhow::Result<usize> {
    let eigenvalues = all.eigenvalues();
    let varying = eigenvalues.iter().take_while(|value| **value > VARIES * eigenvalues[0]).count();
    // The slide has an actuator of its own.
    let independent = hand.as_ref().map_or(usize::MAX, |hand| hand.actuators.len() + 1);
    let varying = varying.min(independent);
    if varying == 0 {
        bail!("the samples do not vary, so they have no components");
    }
    if let Some(wanted) = args.components {
        let n = usize::try_from(wanted).unwrap_or(usize::MAX);
        if n > varying {
            bail!(
                "--components {wanted}: the samples of {} coordinates vary in {varying} independent directions, so there are at \
                 most {varying} components",
                all.n_joints()
            );
        }
        return Ok(n);
    }
    let Some(share) = args.variance else { return Ok(COMPONENTS.min(varying)) };
    let mut sum = 0.0;
    let enough = all.contribution().iter().position(|part| {
        sum += part;
        sum >= share - VARIES
    });
    Ok(enough.map_or(varying, |i| i + 1).min(varying))
}

fn provenance(args: &Args) -> BTreeMap<String, String> {
    let mut known = args.choice.provenance();
    known.insert("made_by".to_owned(), format!("eigenhand {} synergy fit", env!("CARGO_PKG_VERSION")));
    if args.weights == Weights::PerObject {
        known.insert("weights".to_owned(), "per-object".to_owned());
    }
    known
}
