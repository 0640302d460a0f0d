//! Which samples a command counts: of which sources, objects and episodes, and which of their coordinates.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;

use anyhow::{Context, bail};
use eigenhand_explore::Words;
use eigenhand_hands::Hand;
use eigenhand_synergy::Space;
use eigenhand_train::{hand_named, is_run, read_config, read_provenance};

use super::samples::{Map, Samples, Wanted, is_table};
use super::source::SpaceName;
use crate::search_path;

/// Options that choose samples.
#[derive(clap::Args)]
pub(super) struct ChoiceArgs {
    /// Runs, their postures.sqlite, or tables of samples (CSV with a header of joint names, NPY)
    #[arg(value_name = "SOURCE", required = true)]
    sources: Vec<PathBuf>,
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
    /// File that gives columns of a table other names, factors and offsets
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    /// Additional directory of hands; can be given several times
    #[arg(long, value_name = "DIR")]
    plugins: Vec<PathBuf>,
}

/// The samples that were chosen.
pub(super) struct Chosen {
    pub(super) samples: Samples,
    pub(super) space: Space,
    /// The hand, or why it is not known.
    pub(super) hand: anyhow::Result<Hand>,
    /// The hand of the runs among the sources.
    pub(super) of_runs: Option<OfRuns>,
}

impl ChoiceArgs {
    /// Reads the samples.
    pub(super) fn read(&self) -> anyhow::Result<Chosen> {
        let space = space_of(self)?;
        let map = self.map.as_deref().map(Map::read).transpose()?.unwrap_or_default();
        let of_runs = hand_of_runs(&self.sources)?;
        let hand = hand(self, of_runs.as_ref());
        if self.hand.is_some()
            && let Err(error) = hand
        {
            return Err(error);
        }
        if let (Ok(hand), Some(OfRuns { name, .. })) = (&hand, &of_runs)
            && hand.manifest.name != *name
        {
            bail!("the runs are of the hand {name}, and --hand names {}; leave --hand out", hand.manifest.name);
        }
        let wanted = Wanted {
            space,
            objects: &self.object,
            episodes: self.episodes.clone(),
            hand: hand.as_ref().ok(),
            map: &map,
        };
        let mut samples = Samples::read(&self.sources, &wanted)?;
        choose_joints(&mut samples, self, space, &hand)?;
        Ok(Chosen { samples, space, hand, of_runs })
    }

    /// Returns what was chosen, for the file of a synergy.
    pub(super) fn provenance(&self) -> BTreeMap<String, String> {
        let listed = self.sources.iter().map(|source| source.display().to_string()).collect::<Vec<_>>().join(", ");
        let mut known = BTreeMap::from([("sources".to_owned(), listed), ("joints".to_owned(), self.joints.clone())]);
        if !self.object.is_empty() {
            known.insert("objects".to_owned(), self.object.join(", "));
        }
        if let Some(Range { start, end }) = self.episodes {
            known.insert("episodes".to_owned(), format!("{start}..{end}"));
        }
        known
    }
}

fn episodes(text: &str) -> Result<Range<u64>, String> {
    let wrong = || format!("expected A..B with A below B, such as 1000..3000, got {text:?}");
    let (from, to) = text.split_once("..").ok_or_else(wrong)?;
    let range = from.parse().map_err(|_| wrong())?..to.parse().map_err(|_| wrong())?;
    if range.is_empty() { Err(wrong()) } else { Ok(range) }
}

/// Returns what the samples are. A table does not tell.
fn space_of(args: &ChoiceArgs) -> anyhow::Result<Space> {
    match (args.space, args.sources.iter().find(|source| is_table(source))) {
        (Some(space), _) => Ok(space.of()),
        (None, None) => Ok(Space::Commands),
        (None, Some(table)) => {
            bail!("{} does not tell what its rows are: add --space postures or --space commands", table.display())
        }
    }
}

/// The hand of runs.
pub(super) struct OfRuns {
    pub(super) name: String,
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
fn hand(args: &ChoiceArgs, of_runs: Option<&OfRuns>) -> anyhow::Result<Hand> {
    let name = args.hand.as_ref().or(of_runs.map(|hand| &hand.given)).context("name it with --hand")?;
    Ok(hand_named(name, &search_path(&args.plugins))?)
}

fn choose_joints(
    samples: &mut Samples,
    args: &ChoiceArgs,
    space: Space,
    hand: &anyhow::Result<Hand>,
) -> anyhow::Result<()> {
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
