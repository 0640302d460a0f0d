//! `eigenhand export`

use std::path::PathBuf;

use eigenhand_bundle::{Bundle, Exported};
use eigenhand_train::{FinishedRun, say};
use serde::Serialize;

use crate::output::{Outcome, print, print_json};
use crate::{search_path, setup};

/// Exports a run for other programs: the synergy, the policy, files for motors and ROS 2, and scenes for plain MuJoCo
#[derive(clap::Args)]
#[command(after_help = "Example:\n  eigenhand export runs/shadow-quick-l1-s1-1 --out my-shadow")]
pub struct Args {
    /// Run directory
    run: PathBuf,
    /// Directory to write: new, empty, or an earlier export
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Additional directory of hands; can be given several times
    #[arg(long, value_name = "DIR")]
    plugins: Vec<PathBuf>,
    /// Prints one JSON document on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    install: setup::InstallArgs,
}

#[derive(Serialize)]
struct Report<'a> {
    run: &'a PathBuf,
    out: &'a PathBuf,
    files: &'a [PathBuf],
    notes: &'a [String],
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let run = {
        let hands = search_path(&args.plugins);
        setup::with_mujoco(&args.install, || FinishedRun::open(&args.run, &hands, &[]))?
    };
    run.check_export(&args.out)?;
    let synergy = run.control_synergy()?;
    let bundle = Bundle {
        hand: &run.hand,
        synergy: synergy.as_ref(),
        policy: &run.policy,
        normalizer: run.config.learner.normalizer,
        version: env!("CARGO_PKG_VERSION"),
    };
    let Exported { files, notes } =
        eigenhand_bundle::export(&bundle, &args.out, |staging| Ok::<(), anyhow::Error>(run.export(staging)?))?;
    if args.json {
        print_json(&Report { run: &args.run, out: &args.out, files: &files, notes: &notes })?;
        return Ok(Outcome::Done);
    }
    let listed: String = files.iter().map(|file| format!("{}\n", file.display())).collect();
    print(&listed)?;
    notes.iter().for_each(|note| say!("note: {note}"));
    if !files.iter().any(|file| file.ends_with("synergy/synergy.toml")) {
        say!("note: the run has too few postures for a synergy, so only the policy and the scenes were written");
    }
    Ok(Outcome::Done)
}
