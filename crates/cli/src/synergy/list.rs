//! `eigenhand synergy list`

use std::collections::BTreeSet;
use std::path::Path;

use serde::Serialize;

use super::source::Source;
use crate::bundled::synergies;
use crate::output::{Outcome, print, print_json, table_left};
use crate::program;

#[derive(clap::Args)]
pub(super) struct Args {
    /// Prints one JSON document on standard output
    #[arg(long)]
    json: bool,
}

/// A ready synergy.
#[derive(Serialize)]
struct Ready {
    name: &'static str,
    hand: String,
    numbers: usize,
    recommended_numbers: Option<usize>,
    actuators: usize,
    objects: Vec<String>,
}

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let ready = synergies().into_iter().map(|name| {
        let file = Source::read(Path::new(name), None)?.file;
        // There is a grasp of each object with each number.
        let objects: BTreeSet<String> = file.grasps.iter().map(|grasp| grasp.object.clone()).collect();
        Ok(Ready {
            name,
            hand: file.hand,
            numbers: file.synergy.n_components(),
            recommended_numbers: file.recommended.map(|recommended| recommended.components),
            actuators: file.synergy.n_joints(),
            objects: objects.into_iter().collect(),
        })
    });
    let ready = ready.collect::<anyhow::Result<Vec<Ready>>>()?;
    if args.json {
        print_json(&ready)?;
        return Ok(Outcome::Done);
    }
    let mut rows = vec![["hand", "numbers", "enough", "actuators", "grasps of"].map(str::to_owned).to_vec()];
    for one in &ready {
        let enough = one.recommended_numbers.map_or_else(|| "-".to_owned(), |k| k.to_string());
        let [numbers, actuators] = [one.numbers, one.actuators].map(|n| n.to_string());
        rows.push(vec![one.name.to_owned(), numbers, enough, actuators, one.objects.join(", ")]);
    }
    let mut text = table_left(&rows);
    if let Some(first) = ready.first() {
        let next = |command: &str| program::line(&format!("{command} {}", first.name));
        text.push_str(&format!("\nnext: {}\n      {}\n", next("synergy show"), next("explore --synergy")));
    }
    print(&text)?;
    Ok(Outcome::Done)
}
