//! `eigenhand synergy fit`

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;

use anyhow::{Context, bail};
use eigenhand_explore::Words;
use eigenhand_hands::Hand;
use eigenhand_synergy::{JointMap, Space, Synergy, SynergyFile, export};
use eigenhand_train::{hand_named, is_run, read_config, read_provenance};
use serde::Serialize;

use super::samples::{Map, Samples, Wanted, is_table};
use super::source::SpaceName;
use crate::output::{Outcome, percent, print, print_json};
use crate::{program, search_path};

/// Components unless something else is asked for, as in training.
const COMPONENTS: usize = 5;
/// An eigenvalue below this share of the largest is no variation.
const VARIES: f64 = 1e-12;

#[derive(clap::Args)]
pub(super) struct Args {
    /// Runs, their postures.sqlite, or tables of samples (CSV with a header of joint names, NPY)
    #[arg(value_name = "SOURCE", required = true)]
    sources: Vec<PathBuf>,
    /// Directory to write: new, empty, or an earlier synergy
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What the samples are [default: commands; tables do not tell, so they need it]
    #[arg(long, value_enum)]
    space: Option<SpaceName>,
    /// Hand of a table, which gives names and limits [default: the hand of the run; none for tables]
    #[arg(long, value_name = "NAME")]
    hand: Option<String>,
    /// Joints or actuators that count: all, hand (without the slide), fingers, or names separated by commas
    #[arg(long, value_name = "WHICH", default_value = "all")]
    joints: String,
    /// Counts samples of these objects only; can be given several times
    #[arg(long, value_name = "NAME")]
    object: Vec<String>,
    /// Counts samples of these training episodes only: from A up to and without B
    #[arg(long, value_name = "A..B", value_parser = episodes)]
    episodes: Option<Range<u64>>,
    /// Number of components [default: 5, or as many as the samples have]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u64).range(1..), conflicts_with = "variance")]
    components: Option<u64>,
    /// As few components as express this share of the variance, such as 0.9
    #[arg(long, value_name = "SHARE", value_parser = share)]
    variance: Option<f64>,
    /// Whether all samples count, or equally many of each object
    #[arg(long, value_enum, default_value = "equal")]
    weights: Weights,
    /// File that gives columns of a table other names, factors and offsets
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    /// Additional directory of hands; can be given several times
    #[arg(long, value_name = "DIR")]
    plugins: Vec<PathBuf>,
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

fn episodes(text: &str) -> Result<Range<u64>, String> {
    let wrong = || format!("expected A..B with A below B, such as 1000..3000, got {text:?}");
    let (from, to) = text.split_once("..").ok_or_else(wrong)?;
    let range = from.parse().map_err(|_| wrong())?..to.parse().map_err(|_| wrong())?;
    if range.is_empty() { Err(wrong()) } else { Ok(range) }
}

fn share(text: &str) -> Result<f64, String> {
    let inside = |share: &f64| *share > 0.0 && *share <= 1.0;
    text.parse().ok().filter(inside).ok_or_else(|| format!("expected a share above 0 and at most 1, got {text:?}"))
}

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let space = space_of(args)?;
    if args.out.parent().is_some_and(is_run) {
        bail!("{} is part of a run, which keeps its own synergy: choose another directory", args.out.display());
    }
    let map = args.map.as_deref().map(Map::read).transpose()?.unwrap_or_default();
    let of_runs = hand_of_runs(&args.sources)?;
    let hand = hand(args, of_runs.as_ref());
    if args.hand.is_some()
        && let Err(error) = hand
    {
        return Err(error);
    }
    if let (Ok(hand), Some(OfRuns { name, .. })) = (&hand, &of_runs)
        && hand.manifest.name != *name
    {
        bail!("the runs are of the hand {name}, and --hand names {}; leave --hand out", hand.manifest.name);
    }
    let wanted =
        Wanted { space, objects: &args.object, episodes: args.episodes.clone(), hand: hand.as_ref().ok(), map: &map };
    let mut samples = Samples::read(&args.sources, &wanted)?;
    choose_joints(&mut samples, args, space, &hand)?;
    if args.weights == Weights::PerObject {
        samples.balance()?;
    }
    let values: Vec<&[f64]> = samples.rows.iter().map(|row| row.values.as_slice()).collect();
    let all = Synergy::fit(&samples.coordinates, &values, samples.coordinates.len())?;
    let synergy = all.first(number_of_components(args, &all)?);
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
                Err(_) => eprintln!(
                    "note: the hand is not known, so joint_map.free does not say which joints stand for the arm; --hand names it"
                ),
            }
            Some(joint_map)
        }
        _ => None,
    };
    let listed = args.sources.iter().map(|source| source.display().to_string()).collect::<Vec<_>>().join(", ");
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
        provenance: provenance(args, listed),
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

/// Returns what the samples are. A table does not tell.
fn space_of(args: &Args) -> anyhow::Result<Space> {
    match (args.space, args.sources.iter().find(|source| is_table(source))) {
        (Some(space), _) => Ok(space.of()),
        (None, None) => Ok(Space::Commands),
        (None, Some(table)) => {
            bail!("{} does not tell what its rows are: add --space postures or --space commands", table.display())
        }
    }
}

/// The hand of runs.
struct OfRuns {
    name: String,
    /// As the run was told: a name or a directory.
    given: String,
}

/// Returns the hand of the runs among the sources, which must be one.
fn hand_of_runs(sources: &[PathBuf]) -> anyhow::Result<Option<OfRuns>> {
    let mut found: Option<(OfRuns, &PathBuf)> = None;
    for run in sources.iter().filter(|source| source.is_dir()) {
        if !is_run(run) {
            bail!("{} is no run directory: give runs, their postures.sqlite, or tables (CSV, NPY)", run.display());
        }
        let name = read_provenance(run)?.hand;
        match &found {
            Some((known, first)) if known.name != name => {
                let known = &known.name;
                bail!("{} is of the hand {known}, {} of {name}; fit one hand at a time", first.display(), run.display())
            }
            Some(_) => {}
            None => found = Some((OfRuns { name, given: read_config(run)?.hand }, run)),
        }
    }
    Ok(found.map(|(hand, _)| hand))
}

/// Loads the hand that the user named, or else that of the runs. A run's database has names and limits of its own, so the
/// hand of runs may be gone.
fn hand(args: &Args, of_runs: Option<&OfRuns>) -> anyhow::Result<Hand> {
    let name = args.hand.as_ref().or(of_runs.map(|hand| &hand.given)).context("name it with --hand")?;
    Ok(hand_named(name, &search_path(&args.plugins))?)
}

fn choose_joints(samples: &mut Samples, args: &Args, space: Space, hand: &anyhow::Result<Hand>) -> anyhow::Result<()> {
    let needed = || match hand {
        Ok(hand) => Ok(hand),
        Err(error) => bail!("--joints {} needs the hand: {error:#}", args.joints),
    };
    match args.joints.as_str() {
        "all" => {}
        "hand" => {
            let slide = &needed()?.manifest.slide.name;
            samples.select(|name| name != slide);
        }
        "fingers" => {
            let words = Words::of(needed()?, space);
            samples.select(|name| words.is_of_finger(name));
        }
        names => {
            let names: Vec<&str> = names.split(',').map(str::trim).collect();
            let known: Vec<&str> = samples.coordinates.iter().map(|joint| joint.name.as_str()).collect();
            if let Some(unknown) = names.iter().find(|name| !known.contains(name)) {
                bail!("--joints: the samples have no {unknown}; they have {}", known.join(", "));
            }
            samples.select(|name| names.contains(&name));
        }
    }
    if samples.coordinates.is_empty() {
        bail!("--joints {} leaves no joint", args.joints);
    }
    Ok(())
}

/// Checks the number of components against the directions in which the samples vary.
fn number_of_components(args: &Args, all: &Synergy) -> anyhow::Result<usize> {
    let eigenvalues = all.eigenvalues();
    let varying = eigenvalues.iter().take_while(|value| **value > VARIES * eigenvalues[0]).count();
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

fn provenance(args: &Args, sources: String) -> BTreeMap<String, String> {
    let mut known = BTreeMap::from([
        ("made_by".to_owned(), format!("eigenhand {} synergy fit", env!("CARGO_PKG_VERSION"))),
        ("sources".to_owned(), sources),
        ("joints".to_owned(), args.joints.clone()),
    ]);
    if !args.object.is_empty() {
        known.insert("objects".to_owned(), args.object.join(", "));
    }
    if let Some(Range { start, end }) = args.episodes {
        known.insert("episodes".to_owned(), format!("{start}..{end}"));
    }
    if args.weights == Weights::PerObject {
        known.insert("weights".to_owned(), "per-object".to_owned());
    }
    known
}
