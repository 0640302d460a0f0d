//! `eigenhand synergy show`

use std::path::PathBuf;

use eigenhand_explore::Words;
use eigenhand_train::{hand_named, is_run, read_config, say};
use serde::Serialize;

use super::source::{Source, SpaceName};
use crate::numbers::{LARGEST, whole};
use crate::output::{Outcome, percent, print, print_json, table_left};
use crate::search_path;

/// Components that are shown unless another number is asked for.
const SHOWN: usize = 5;
/// Widest bar of a loading, in characters.
const BAR: usize = 5;

#[derive(clap::Args)]
pub(super) struct Args {
    /// The synergy
    #[arg(value_name = "SOURCE")]
    source: PathBuf,
    /// Which synergy of a run [default: commands]
    #[arg(long, value_enum)]
    space: Option<SpaceName>,
    /// Number of components to show, beginning with the first [default: 5, or all if there are fewer]
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=LARGEST))]
    components: Option<usize>,
    /// Additional directory of hands; can be given several times
    #[arg(long, value_name = "DIR")]
    plugins: Vec<PathBuf>,
    /// Prints one JSON document on standard output
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Shown<'a> {
    hand: &'a str,
    space: eigenhand_synergy::Space,
    samples: usize,
    /// Sum of the sample variances over all joints or actuators, in rad^2 or in their own units.
    total_variance: f64,
    recommended_components: Option<usize>,
    components: Vec<Component<'a>>,
}

#[derive(Serialize)]
struct Component<'a> {
    contribution: f64,
    coefficient_min: f64,
    coefficient_max: f64,
    /// What it does as its number rises; none if the hand was not found.
    words: Option<String>,
    loadings: Vec<(&'a str, f64)>,
}

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let source = Source::read(&args.source, args.space)?;
    let synergy = &source.file.synergy;
    let names: Vec<&str> = synergy.joints().iter().map(|joint| joint.name.as_str()).collect();
    // A run says where its hand is, which may have no place among the others.
    let named = if is_run(&args.source) { read_config(&args.source)?.hand } else { source.file.hand.clone() };
    let words = hand_named(&named, &search_path(&args.plugins)).map(|hand| Words::of(&hand, source.file.space));
    let shown = source.first(Some(args.components.unwrap_or(SHOWN.min(synergy.n_components()))))?.n_components();
    let component = |i: usize| Component {
        contribution: synergy.contribution()[i],
        coefficient_min: synergy.coefficient_min()[i],
        coefficient_max: synergy.coefficient_max()[i],
        words: words.as_ref().ok().map(|words| words.sentence(&names, synergy.component(i))),
        loadings: names.iter().copied().zip(synergy.component(i).iter().copied()).collect(),
    };
    let found = Shown {
        hand: &source.file.hand,
        space: source.file.space,
        samples: synergy.n_postures(),
        total_variance: synergy.total_variance(),
        recommended_components: source.file.recommended.as_ref().map(|recommended| recommended.components),
        components: (0..shown).map(component).collect(),
    };
    if args.json {
        print_json(&found)?;
    } else {
        print(&text(&source, &found))?;
    }
    if let Err(error) = words {
        say!("note: without the hand, nothing is said in words: {error}");
    }
    Ok(Outcome::Done)
}

fn text(source: &Source, found: &Shown<'_>) -> String {
    let mut text = format!("{}\n\n", source.title());
    let mut rows = vec![vec![String::new()], vec!["share".to_owned()], vec!["range of z".to_owned()]];
    for (i, component) in found.components.iter().enumerate() {
        rows[0].push(format!("z{}", i + 1));
        rows[1].push(percent(component.contribution));
        rows[2].push(format!("{:.2} to {:.2}", component.coefficient_min, component.coefficient_max));
    }
    let largest = found.components.iter().flat_map(|c| &c.loadings).fold(0.0_f64, |m, (_, x)| m.max(x.abs()));
    let joints = found.components.first().map_or(0, |component| component.loadings.len());
    for joint in 0..joints {
        let mut row = vec![found.components[0].loadings[joint].0.to_owned()];
        row.extend(found.components.iter().map(|component| {
            let loading = component.loadings[joint].1;
            format!("{loading:+.2} {}", bar(loading.abs() / largest))
        }));
        rows.push(row);
    }
    text.push_str(&table_left(&rows));
    let said: Vec<String> = found
        .components
        .iter()
        .enumerate()
        .filter_map(|(i, component)| {
            Some(format!("z{} rises: {} ({})\n", i + 1, component.words.as_ref()?, percent(component.contribution)))
        })
        .collect();
    if !said.is_empty() {
        text.push_str(&format!("\n{}", said.concat()));
    }
    if let Some(recommended) = &source.file.recommended {
        text.push_str(&format!("\nrecommended: {} ({})\n", recommended.components, recommended.reason));
    }
    text
}

/// (share of the widest bar, 0 to 1) => a bar in eighths of a character
fn bar(share: f64) -> String {
    const EIGHTHS: [&str; 8] = ["", "\u{258f}", "\u{258e}", "\u{258d}", "\u{258c}", "\u{258b}", "\u{258a}", "\u{2589}"];
    let eighths = (share.clamp(0.0, 1.0) * (8 * BAR) as f64).round() as usize;
    format!("{}{}", "\u{2588}".repeat(eighths / 8), EIGHTHS[eighths % 8])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_grow_by_eighths() {
        assert_eq!(
            [0.0, 0.5, 1.0, f64::NAN].map(bar),
            ["", "\u{2588}\u{2588}\u{258c}", "\u{2588}\u{2588}\u{2588}\u{2588}\u{2588}", ""]
        );
    }
}
