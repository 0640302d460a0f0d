//! `eigenhand synergy compare`

use std::path::PathBuf;

use anyhow::bail;
use eigenhand_synergy::{Compared, Comparison};
use serde::Serialize;

use super::source::{Source, SpaceName, kind_of};
use crate::numbers::{LARGEST, whole};
use crate::output::{Outcome, percent, print, print_json, table};

/// Joints that only one synergy has are named up to this many.
const NAMED: usize = 6;

#[derive(clap::Args)]
pub(super) struct Args {
    /// The first synergy
    #[arg(value_name = "SOURCE")]
    a: PathBuf,
    /// The second synergy
    #[arg(value_name = "SOURCE")]
    b: PathBuf,
    /// Which synergy of runs [default: commands]
    #[arg(long, value_enum)]
    space: Option<SpaceName>,
    /// Number of components of each that count, beginning with the first [default: all]
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=LARGEST))]
    components: Option<usize>,
    /// Prints one JSON document on standard output, with angles in rad
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report<'a> {
    sources: [&'a PathBuf; 2],
    hands: [&'a str; 2],
    #[serde(flatten)]
    comparison: &'a Comparison,
}

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let sources = [Source::read(&args.a, args.space)?, Source::read(&args.b, args.space)?];
    let [a, b] = [&sources[0], &sources[1]].map(|source| source.file.space);
    if a != b {
        bail!(
            "{} is a {}, {} a {}: compare two of one kind; --space chooses that of runs",
            args.a.display(),
            kind_of(a),
            args.b.display(),
            kind_of(b)
        );
    }
    let first = |source: &Source| source.first(args.components);
    let [a, b] = [first(&sources[0])?, first(&sources[1])?];
    let compared = |i: usize, synergy| Compared { synergy, samples: sources[i].samples.as_deref() };
    let comparison = Comparison::of(compared(0, &a), compared(1, &b))?;
    if args.json {
        let hands = [&sources[0], &sources[1]].map(|source| source.file.hand.as_str());
        print_json(&Report { sources: [&args.a, &args.b], hands, comparison: &comparison })?;
    } else {
        print(&text(&sources, &comparison))?;
    }
    Ok(Outcome::Done)
}

fn text(sources: &[Source; 2], found: &Comparison) -> String {
    let mut text = String::new();
    for (name, source) in ["A", "B"].iter().zip(sources) {
        text.push_str(&format!("{name}: {} ({})\n", source.title(), source.path.display()));
    }
    let joints = found.joints.len();
    text.push_str(&format!("in common: {joints} {}", if joints == 1 { "coordinate" } else { "coordinates" }));
    for (name, alone) in ["A", "B"].iter().zip(&found.alone).filter(|(_, alone)| !alone.is_empty()) {
        let more = if alone.len() > NAMED { format!(" and {} more", alone.len() - NAMED) } else { String::new() };
        text.push_str(&format!("; only in {name}: {}{more}", alone[..alone.len().min(NAMED)].join(", ")));
    }
    let angles: Vec<String> = found.angles.iter().map(|angle| format!("{:.1}", angle.to_degrees())).collect();
    text.push_str(&format!(
        "\n\nprincipal angles in degrees (0: a direction that both have; 90: one that the other lacks)\n{}\n\n\
         absolute cosines of the components (1: the same direction)\n",
        angles.join("  ")
    ));
    let numbered = |name: &str, n: usize| (1..=n).map(|i| format!("{name}{i}")).collect::<Vec<_>>();
    let columns = found.cosines.first().map_or(0, Vec::len);
    let mut rows = vec![[vec![String::new()], numbered("B", columns)].concat()];
    for (name, row) in numbered("A", found.cosines.len()).into_iter().zip(&found.cosines) {
        rows.push([vec![name], row.iter().map(|cosine| format!("{cosine:.2}")).collect()].concat());
    }
    text.push_str(&table(&rows));
    for (i, (name, explained)) in ["A", "B"].iter().zip(&found.explained).enumerate() {
        let Some(explained) = explained else { continue };
        let other = ["B", "A"][i];
        text.push_str(&format!("\nshare of the variance of {name}'s {}s\n", sources[i].sample()));
        let most = explained.own.len().max(explained.other.len());
        let mut rows = vec![[vec!["in the first".to_owned()], (1..=most).map(|k| k.to_string()).collect()].concat()];
        for (space, shares) in [(name, &explained.own), (&other, &explained.other)] {
            rows.push([vec![format!("of {space}")], shares.iter().map(|share| percent(*share)).collect()].concat());
        }
        text.push_str(&table(&rows));
    }
    text
}
