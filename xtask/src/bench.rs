//! `cargo xtask bench`

use std::path::PathBuf;
use std::time::Duration;

use clap::ValueEnum;
use eigenhand_train::bench::{
    self, BenchSetting, LearnerSpeed, SimSpeed, TrainingSpeed, find_peers, learner_speed, sim_speed, training_speed,
};
use eigenhand_train::config::worker_count;
use serde::Serialize;

use crate::output::{Outcome, print, print_json, table};
use crate::setup;

/// Sizes of minibatch that are measured.
const BATCHES: [usize; 2] = [256, 1024];
const SECONDS: f64 = 10.0;

/// Measures the speed of simulation, learner and training
#[derive(clap::Args)]
#[command(
    after_help = "What is compared runs in turn in one process, and ratios are medians: trust them more than rates.\n\
    Other implementations are measured too when bench/peers has a virtual environment for them (.venv), or\n\
    EIGENHAND_PEERS_PYTHON names a Python that has their packages.\n\n\
    Examples:\n  cargo xtask bench\n  cargo xtask bench learner --seconds 30 --json"
)]
pub struct Args {
    /// What to measure [default: all]
    #[arg(value_enum)]
    what: Option<What>,
    /// Hand, by name or directory [default: that of the default configuration]
    #[arg(long, value_name = "NAME")]
    hand: Option<String>,
    /// Seconds for each measurement
    #[arg(long, value_name = "S", default_value_t = SECONDS)]
    seconds: f64,
    /// Further directory of hands; can be given several times
    #[arg(long, value_name = "DIR")]
    plugins: Vec<PathBuf>,
    /// Prints one JSON document on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    install: setup::InstallArgs,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum What {
    /// The environment against bare mj_step calls
    Sim,
    /// Updates of the learner
    Learner,
    /// Rollouts and updates together
    Training,
}

#[derive(Serialize)]
struct Report {
    cores: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    sim: Option<Vec<SimSpeed>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    learner: Option<Vec<LearnerSpeed>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    training: Option<Vec<TrainingSpeed>>,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    setup::ensure_mujoco(&args.install)?;
    let duration = Duration::try_from_secs_f64(args.seconds).ok().filter(|duration| !duration.is_zero());
    let duration = duration.ok_or_else(|| eigenhand_train::TrainError::Option {
        option: format!("--seconds {}", args.seconds),
        reason: "expected a number above 0".to_owned(),
    })?;
    let setting = BenchSetting { hand: args.hand.clone(), plugins: args.plugins.clone(), duration };
    let wanted = |what: What| args.what.is_none_or(|only| only == what);
    let cores = worker_count(0);
    let threads: Vec<usize> = if cores > 1 { vec![1, 2] } else { vec![1] };
    let mut report = Report { cores, sim: None, learner: None, training: None };
    if wanted(What::Sim) {
        eprintln!("simulation ...");
        let found = sim_speed(&setting, &threads)?;
        say(args.json, || describe_sim(&found))?;
        report.sim = Some(found);
    }
    if wanted(What::Learner) {
        let peers = find_peers();
        let names: Vec<&str> = peers.iter().map(|peer| peer.name.as_str()).collect();
        match names.as_slice() {
            [] => {
                eprintln!("learner ... (no peers: {} is not set and bench/peers has no .venv)", bench::PYTHON_VARIABLE)
            }
            names => eprintln!("learner ... (in turn with {})", names.join(", ")),
        }
        let found = learner_speed(&setting, &BATCHES, &peers)?;
        say(args.json, || describe_learner(&found))?;
        report.learner = Some(found);
    }
    if wanted(What::Training) {
        eprintln!("training ...");
        let found = training_speed(&setting, &threads)?;
        say(args.json, || describe_training(&found))?;
        report.training = Some(found);
    }
    if args.json {
        print_json(&report)?;
    }
    Ok(Outcome::Done)
}

fn say(json: bool, text: impl FnOnce() -> String) -> anyhow::Result<()> {
    if json { Ok(()) } else { print(&text()) }
}

fn describe_sim(found: &[SimSpeed]) -> String {
    let heads = ["simulation", "env steps/s", "mj_step/s", "env over mj_step", "reset"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    for speed in found {
        rows.push(vec![
            format!("{}, {} thread{}", speed.hand, speed.threads, if speed.threads == 1 { "" } else { "s" }),
            format!("{:.0}", speed.env_steps_per_s),
            format!("{:.0}", speed.mj_steps_per_s),
            format!("{:.3}", speed.ratio),
            format!("{:.1} ms", speed.reset_ms),
        ]);
    }
    let mut text = table(&rows);
    if found.iter().any(|speed| !speed.identical) {
        text.push_str("warning: the two sides did not end in the same states, so they are not comparable\n");
    }
    text.push('\n');
    text
}

fn describe_learner(found: &[LearnerSpeed]) -> String {
    let heads = ["learner, one thread", "updates/s", "with sampling", "GFLOP/s", "sgemm", "share"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    let mut text = String::new();
    for speed in found {
        rows.push(vec![
            format!("batch {}, {} + {} => {}", speed.batch, speed.obs_dim, speed.goal_dim, speed.act_dim),
            format!("{:.1}", speed.updates_per_s),
            format!("{:.1}", speed.updates_with_sampling_per_s),
            format!("{:.1}", speed.gflops),
            format!("{:.1}", speed.sgemm_gflops),
            format!("{:.2}", speed.share_of_sgemm),
        ]);
        for peer in &speed.peers {
            text.push_str(&format!(
                "batch {}: {:.1} updates/s in turn with {} at {:.1}: {:.2} times as fast\n",
                speed.batch, peer.ours_per_s, peer.name, peer.updates_per_s, peer.ratio
            ));
        }
        for reason in &speed.peers_failed {
            text.push_str(&format!("batch {}: not compared: {reason}\n", speed.batch));
        }
    }
    format!("{}{text}\n", table(&rows))
}

fn describe_training(found: &[TrainingSpeed]) -> String {
    let heads = ["training", "env steps/s", "updates/s", "peak memory"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    for speed in found {
        rows.push(vec![
            format!("{}, {} worker{}", speed.hand, speed.workers, if speed.workers == 1 { "" } else { "s" }),
            format!("{:.0}", speed.env_steps_per_s),
            format!("{:.1}", speed.updates_per_s),
            speed.peak_memory_mb.map_or_else(|| "-".to_owned(), |mb| format!("{mb:.0} MB")),
        ]);
    }
    table(&rows)
}
