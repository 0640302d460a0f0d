//! `eigenhand synergy reducers`

use anyhow::bail;
use eigenhand_reducers::{NAMES, Reconstruction, Reducer, Sample, cross_validate, named};
use eigenhand_synergy::Space;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::chosen::{ChoiceArgs, Chosen};
use crate::numbers::{LARGEST, whole};
use crate::output::{Outcome, percent, print, print_json, table};

/// Numbers that are compared unless others are asked for.
const COMPONENTS: [usize; 5] = [1, 2, 3, 5, 8];

#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    choice: ChoiceArgs,
    /// Numbers of the spaces, separated by commas [default: 1,2,3,5,8, as far as the samples have coordinates]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = whole::<usize>(1..=LARGEST))]
    components: Vec<usize>,
    /// Reducers to compare, separated by commas
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values = NAMES, value_parser = NAMES)]
    reducers: Vec<String>,
    /// Parts into which the grasps are divided: each part is reconstructed from the others
    #[arg(long, value_name = "N", value_parser = whole::<u64>(2..=100), default_value_t = 5)]
    folds: u64,
    /// Prints one JSON document on standard output
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report<'a> {
    space: Space,
    samples: usize,
    coordinates: usize,
    folds: u64,
    reconstructions: &'a [Reconstruction],
}

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let Chosen { samples, space, .. } = args.choice.read()?;
    let n = samples.coordinates.len();
    let components = match args.components.as_slice() {
        [] => COMPONENTS.into_iter().filter(|k| *k <= n).collect(),
        asked => asked.to_vec(),
    };
    if let Some(k) = components.iter().find(|k| **k == 0 || **k > n) {
        bail!("--components {k}: the samples have {n} coordinates, so expected 1 to {n}");
    }
    let reducers: Vec<Box<dyn Reducer>> = args.reducers.iter().filter_map(|name| named(name)).collect();
    let rows: Vec<Sample<'_>> =
        samples.rows.iter().map(|row| Sample { values: &row.values, group: row.group }).collect();
    let bar = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("{elapsed_precise} {bar:24.cyan/dim} {pos}/{len} fits") {
        bar.set_style(style);
    }
    let mut progress = |done: usize, all: usize| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    };
    let found = cross_validate(&reducers, &rows, &components, usize::try_from(args.folds)?, &mut progress)?;
    bar.finish_and_clear();
    if args.json {
        print_json(&Report { space, samples: rows.len(), coordinates: n, folds: args.folds, reconstructions: &found })?;
    } else {
        let title = format!(
            "{} samples of {n} coordinates in {} parts, each reconstructed by spaces that were fitted to the others",
            rows.len(),
            args.folds
        );
        print(&format!("{title}\n{}", text(args, &components, &found)))?;
    }
    Ok(Outcome::Done)
}

fn text(args: &Args, components: &[usize], found: &[Reconstruction]) -> String {
    let error = |result: &Reconstruction| format!("{:.4}", result.error);
    let share = |result: &Reconstruction| result.share.map_or_else(|| "-".to_owned(), percent);
    let density =
        |result: &Reconstruction| result.log_density.map_or_else(|| "-".to_owned(), |sum| format!("{sum:.2}"));
    let mut text = String::new();
    let mut add = |title: &str, cell: &dyn Fn(&Reconstruction) -> String| {
        let mut rows = vec![[vec!["numbers".to_owned()], args.reducers.clone()].concat()];
        for (k, of_k) in components.iter().zip(found.chunks(args.reducers.len().max(1))) {
            rows.push([vec![k.to_string()], of_k.iter().map(cell).collect()].concat());
        }
        text.push_str(&format!("\n{title}\n{}", table(&rows)));
    };
    add("error of a coordinate (root mean square, rad; m where it slides)", &error);
    add("share of the variance", &share);
    if found.iter().any(|result| result.log_density.is_some()) {
        add(
            "mean logarithm of the density (higher is better; it tells how many numbers the samples are worth)",
            &density,
        );
    }
    text
}
