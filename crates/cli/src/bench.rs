//! `eigenhand bench`

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, bail};
use clap::ValueEnum;
use eigenhand_bench::{
    self as bench, AllocationCounts, BenchSetting, LearnerSpeed, Peer, PeerKind, PeerSpeed, SimSpeed, TrainingMemory,
    TrainingSpeed, find_peers, learner_speed, sim_speed, training_memory, training_speed,
};
use eigenhand_report::counted;
use eigenhand_train::config::worker_count;
use eigenhand_train::say;
use serde::Serialize;

use crate::output::{Outcome, print, print_json, table};
use crate::{search_path, setup};

/// Sizes of the minibatches that are measured.
const BATCHES: [usize; 2] = [256, 1024];
const SECONDS: f64 = 10.0;

/// Measures the speed of simulation, learner and training
#[derive(clap::Args)]
#[command(
    after_help = "Compared alternatives run by turns, and a ratio is the median over the turns. So ratios are reliable\n\
    also on a busy machine; rates are not. Other learners are measured too if their Python packages are installed\n\
    in bench/peers/.venv, or for the Python that EIGENHAND_PEERS_PYTHON names.\n\n\
    Examples:\n  eigenhand bench\n  eigenhand bench learner --seconds 30 --json"
)]
pub struct Args {
    /// What to measure [default: all]
    #[arg(value_enum)]
    what: Option<What>,
    /// Hand, by name or directory [default: the hand of the default configuration]
    #[arg(long, value_name = "NAME")]
    hand: Option<String>,
    /// Duration of each measurement in seconds
    #[arg(long, value_name = "S", default_value_t = SECONDS)]
    seconds: f64,
    /// Additional directory of hands; can be given several times
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
    /// The environment, compared with bare mj_step calls
    Sim,
    /// Updates of the learner
    Learner,
    /// Rollouts and updates together
    Training,
    /// Memory allocations in the loops of simulation, learner and training; needs a checkout of the repository
    Allocations,
}

#[derive(Serialize)]
struct Report {
    cores: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    sim: Option<Vec<SimSpeed>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    learner: Option<Vec<LearnerSpeed>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    training: Option<TrainingSpeed>,
    #[serde(skip_serializing_if = "Option::is_none")]
    memory: Option<TrainingMemory>,
    #[serde(skip_serializing_if = "Option::is_none")]
    allocations: Option<AllocationCounts>,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    setup::ensure_mujoco(&args.install)?;
    let duration = Duration::try_from_secs_f64(args.seconds).ok().filter(|duration| !duration.is_zero());
    let duration = duration.ok_or_else(|| eigenhand_train::TrainError::Option {
        option: format!("--seconds {}", args.seconds),
        reason: "expected a number above 0".to_owned(),
    })?;
    let setting = BenchSetting { hand: args.hand.clone(), hands: search_path(&args.plugins), duration };
    let wanted = |what: What| args.what.is_none_or(|only| only == what);
    let cores = worker_count(0);
    let threads: Vec<usize> = if cores > 1 { vec![1, 2] } else { vec![1] };
    let mut report = Report { cores, sim: None, learner: None, training: None, memory: None, allocations: None };
    if wanted(What::Training) {
        say!("memory ...");
        let found = training_memory(&setting)?;
        say(args.json, || describe_memory(&found))?;
        report.memory = Some(found);
    }
    if wanted(What::Sim) {
        say!("simulation ...");
        let found = sim_speed(&setting, &threads)?;
        say(args.json, || describe_sim(&found))?;
        report.sim = Some(found);
    }
    if wanted(What::Learner) {
        let peers = find_peers(PeerKind::Update);
        announce("learner", &peers);
        let found = learner_speed(&setting, &BATCHES, &peers)?;
        say(args.json, || describe_learner(&found))?;
        report.learner = Some(found);
    }
    if wanted(What::Training) {
        let peers = find_peers(PeerKind::Training);
        announce("training", &peers);
        let found = training_speed(&setting, &threads, &peers)?;
        say(args.json, || describe_training(&found))?;
        report.training = Some(found);
    }
    if wanted(What::Allocations) {
        say!("allocations ...");
        let found = count_allocations(args)?;
        say(args.json, || describe_allocations(&found))?;
        report.allocations = Some(found);
    }
    if args.json {
        print_json(&report)?;
    }
    Ok(Outcome::Done)
}

fn announce(what: &str, peers: &[Peer]) {
    let names: Vec<&str> = peers.iter().map(|peer| peer.name.as_str()).collect();
    match names.as_slice() {
        [] => {
            say!("{what} ... (no other learners: {} is not set, and bench/peers has no .venv)", bench::PYTHON_VARIABLE)
        }
        names => say!("{what} ... (by turns with {})", names.join(", ")),
    }
}

fn say(json: bool, text: impl FnOnce() -> String) -> anyhow::Result<()> {
    if json { Ok(()) } else { print(&text()) }
}

fn describe_sim(found: &[SimSpeed]) -> String {
    let heads = ["simulation", "env steps/s", "mj_step/s", "time over mj_step", "scaling", "mj_step scaling", "reset"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    for speed in found {
        rows.push(vec![
            format!("{}, {}", speed.hand, counted(speed.threads, "thread")),
            format!("{:.0}", speed.env_steps_per_s),
            format!("{:.0}", speed.mj_steps_per_s),
            format!("{:.3}", speed.ratio),
            format!("{:.2}", speed.scaling),
            format!("{:.2}", speed.raw_scaling),
            format!("{:.1} ms", speed.reset_ms),
        ]);
    }
    let mut text = table(&rows);
    if found.iter().any(|speed| !speed.identical) {
        text.push_str(
            "warning: environment and bare mj_step ended in different states, so their speeds are not comparable\n",
        );
    }
    text.push('\n');
    text
}

fn describe_learner(found: &[LearnerSpeed]) -> String {
    let heads = [
        "learner, one thread",
        "updates/s",
        "with sampling",
        "two threads",
        "GFLOP/s",
        "sgemm",
        "of sgemm",
        "peak",
        "of peak",
    ];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    let mut text = String::new();
    for speed in found {
        rows.push(vec![
            format!("batch {}, {} + {} => {}", speed.batch, speed.obs_dim, speed.goal_dim, speed.act_dim),
            format!("{:.1}", speed.updates_per_s),
            format!("{:.1}", speed.updates_with_sampling_per_s),
            format!("{:.1}", speed.updates_on_two_threads_per_s),
            format!("{:.1}", speed.gflops),
            format!("{:.1}", speed.sgemm_gflops),
            format!("{:.2}", speed.share_of_sgemm),
            format!("{:.1}", speed.peak_gflops),
            format!("{:.2}", speed.share_of_peak),
        ]);
        text.push_str(&describe_peers(&format!("batch {}", speed.batch), &speed.peers, &speed.peers_failed));
    }
    format!("{}{text}\n", table(&rows))
}

/// Runs the benchmark whose allocator counts; it needs a checkout of the repository.
fn count_allocations(args: &Args) -> anyhow::Result<AllocationCounts> {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(["bench", "--quiet", "--package", "eigenhand-bench", "--bench", "allocations", "--"]);
    // Cargo runs it in its package's directory, so paths must be absolute.
    let complete = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
    if let Some(hand) = &args.hand {
        let named = !hand.contains(std::path::MAIN_SEPARATOR);
        command.arg("--hand").arg(if named { PathBuf::from(hand) } else { complete(Path::new(hand)) });
    }
    args.plugins.iter().for_each(|directory| _ = command.arg("--plugins").arg(complete(directory)));
    let output = command.stderr(Stdio::inherit()).output().context("cannot run cargo")?;
    let text = String::from_utf8_lossy(&output.stdout);
    match text.lines().rev().find(|line| !line.trim().is_empty()) {
        Some(line) if output.status.success() => {
            serde_json::from_str(line).with_context(|| format!("cannot read the allocation counts {line:?}"))
        }
        _ => bail!("counting the allocations failed ({}); the reason is above", output.status),
    }
}

fn describe_allocations(found: &AllocationCounts) -> String {
    let AllocationCounts { per_update, per_sampling, per_env_step, per_episode } = found;
    let counts = [
        ("update", per_update),
        ("minibatch drawn", per_sampling),
        ("environment step", per_env_step),
        ("episode", per_episode),
    ];
    let mut rows = vec![vec!["allocations for each".to_owned(), "count".to_owned()]];
    rows.extend(counts.map(|(what, count)| vec![what.to_owned(), format!("{count:.1}")]));
    format!("{}\n", table(&rows))
}

fn describe_peers(what: &str, peers: &[PeerSpeed], failed: &[String]) -> String {
    let compared = peers.iter().map(|peer| {
        let (ours, theirs, ratio) = (peer.ours_per_s, peer.updates_per_s, peer.ratio);
        format!("{what}: {ours:.1} updates/s, {} {theirs:.1} updates/s: {ratio:.2} times as fast\n", peer.name)
    });
    compared.chain(failed.iter().map(|reason| format!("{what}: not compared: {reason}\n"))).collect()
}

fn describe_memory(found: &TrainingMemory) -> String {
    match found.peak_mb {
        Some(mb) => format!("peak memory with a replay of {} episodes: {mb:.0} MB\n\n", found.replay_episodes),
        None => "peak memory: not available on this system\n\n".to_owned(),
    }
}

fn describe_training(found: &TrainingSpeed) -> String {
    let heads = ["training", "env steps/s", "updates/s", "scaling", "first rollout"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    for speed in &found.workers {
        rows.push(vec![
            format!("{}, {}", found.hand, counted(speed.workers, "worker")),
            format!("{:.0}", speed.env_steps_per_s),
            format!("{:.1}", speed.updates_per_s),
            format!("{:.2}", speed.scaling),
            format!("{:.2} s", speed.first_rollout_s),
        ]);
    }
    let what = found.workers.last().map(|speed| counted(speed.workers, "worker")).unwrap_or_default();
    format!("{}{}\n", table(&rows), describe_peers(&what, &found.peers, &found.peers_failed))
}
