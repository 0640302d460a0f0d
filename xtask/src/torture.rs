//! `cargo xtask torture`

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use eigenhand_cli::output::{Outcome, duration, print, print_json};
use eigenhand_cli::say;
use eigenhand_synergy::PostureDatabase;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use serde::Serialize;

use crate::disk::Disk;

/// The hand: the one of this repository whose episodes take the shortest time.
const HAND: &str = "parallel";
/// Settings of a run of a few seconds that passes through every stage, with many checkpoints.
const SETTINGS: [&str; 12] = [
    "episodes=60",
    "training.warmup_episodes=8",
    "training.checkpoint_every=4",
    "evaluation.every=8",
    "evaluation.episodes=4",
    "evaluation.final_episodes=8",
    "evaluation.selection_episodes=4",
    "task.steps=40",
    "task.settle_time=0.1",
    "learner.hidden=[32, 32]",
    "learner.batch_size=64",
    "workers=1",
];
/// Most interruptions of one run.
const MOST: u32 = 6;
/// Column of metrics.csv that differs from run to run.
const WALL_TIME: &str = "wall_s";
const PAUSE: Duration = Duration::from_millis(2);

/// Kills short trainings and cuts their power at random times, and checks that they lose nothing
#[derive(clap::Args)]
#[command(
    after_help = "Trains a small hand once without a stop. Then it trains it again and again, ends each run at random times by \
    SIGKILL,\nby SIGTERM or by a power cut, and starts the same command again. The end must be the same to the last bit: policy,\n\
    metrics and postures. Power cuts need root, mkfs.ext4 and loop devices, and are left out otherwise. Exit status 1 if\n\
    anything differs; the run is kept.\n\n\
    Examples:\n  cargo xtask torture --minutes 10\n  cargo xtask torture --kills 200 --cuts 20"
)]
pub struct Args {
    /// Minutes after which no further run begins
    #[arg(long, value_name = "M", default_value_t = 10.0)]
    minutes: f64,
    /// Kills after which no further run is killed; half of them are SIGTERM [default: as many as the time allows]
    #[arg(long, value_name = "N")]
    kills: Option<u32>,
    /// Power cuts after which no further power is cut [default: as many as the time allows]
    #[arg(long, value_name = "N")]
    cuts: Option<u32>,
    /// Seed of the times
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Prints one JSON document on standard output
    #[arg(long)]
    json: bool,
}

/// What was done, and what was lost.
#[derive(Debug, Default, Serialize)]
struct Tally {
    runs: u32,
    sigkill: u32,
    sigterm: u32,
    power_cuts: u32,
    /// Runs that were interrupted before their first checkpoint.
    before_first_checkpoint: u32,
    /// What differs from the run that was never stopped.
    differences: Vec<String>,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    if !(args.minutes > 0.0 && args.minutes.is_finite()) {
        bail!("--minutes {}: expected a number above 0", args.minutes);
    }
    let (started, limit) = (Instant::now(), Duration::from_secs_f64(60.0 * args.minutes));
    let scratch = tempfile::tempdir().context("cannot make a temporary directory")?;
    let disk = match Disk::new() {
        Ok(disk) => Some(disk),
        Err(reason) => {
            say!("no power is cut: {reason}");
            None
        }
    };
    let whole = scratch.path().join("whole");
    say!("training without a stop ...");
    let begun = Instant::now();
    let status = start(&whole)?.wait().context("cannot wait for the training")?;
    if !status.success() {
        bail!("the training without a stop failed ({status})");
    }
    let took = begun.elapsed();
    let expected = Results::of(&whole)?;
    let mut random = StdRng::seed_from_u64(args.seed);
    let mut tally = Tally::default();
    let mut said = Instant::now();
    loop {
        let kills_left = args.kills.is_none_or(|most| tally.sigkill + tally.sigterm < most);
        let cuts_left = disk.is_some() && args.cuts.is_none_or(|most| tally.power_cuts < most);
        if started.elapsed() > limit || !(kills_left || cuts_left) {
            break;
        }
        let disk = disk.as_ref().filter(|_| cuts_left && (!kills_left || random.random_bool(0.5)));
        let out = disk.map_or_else(|| scratch.path().to_owned(), Disk::path).join(format!("run-{}", tally.runs));
        torture(&out, disk, took, &mut random, &mut tally)?;
        tally.runs += 1;
        let found = Results::of(&out).map(|found| expected.difference(&found));
        match found {
            Ok(None) => std::fs::remove_dir_all(&out).context("cannot remove a run")?,
            Ok(Some(difference)) => keep(&out, &difference, &mut tally)?,
            Err(error) => keep(&out, &format!("{error:#}"), &mut tally)?,
        }
        if said.elapsed() > Duration::from_secs(20) {
            said = Instant::now();
            say!("{}", describe(&tally, started.elapsed()));
        }
    }
    if args.json {
        print_json(&tally)?;
    } else {
        print(&format!("{}\n", describe(&tally, started.elapsed())))?;
    }
    Ok(if tally.differences.is_empty() { Outcome::Done } else { Outcome::Failed })
}

/// Copies a run that lost something to where it stays.
fn keep(out: &Path, difference: &str, tally: &mut Tally) -> anyhow::Result<()> {
    let kept = std::env::temp_dir().join(format!("eigenhand-torture-{}-{}", std::process::id(), tally.runs));
    let status = Command::new("cp").arg("-r").args([out, &kept]).status().context("cannot copy the run")?;
    let place = if status.success() { kept } else { out.to_owned() };
    let text = format!("{difference}; the run is kept in {}", place.display());
    say!("lost: {text}");
    tally.differences.push(text);
    std::fs::remove_dir_all(out).context("cannot remove a run")
}

/// Trains a run to its end, with interruptions at random times.
fn torture(
    out: &Path,
    disk: Option<&Disk>,
    took: Duration,
    random: &mut StdRng,
    tally: &mut Tally,
) -> anyhow::Result<()> {
    for _ in 0..random.random_range(1..=MOST) {
        let mut child = start(out)?;
        // Some interruptions come at once, and some when the run has almost ended.
        let wait = took.mul_f64(random.random_range(0.0..1.0_f64).powi(2));
        let begun = Instant::now();
        while begun.elapsed() < wait {
            if child.try_wait().context("cannot wait for the training")?.is_some() {
                break;
            }
            std::thread::sleep(PAUSE);
        }
        if let Some(status) = child.try_wait().context("cannot wait for the training")? {
            if !status.success() {
                tally.differences.push(format!("{} ended with {status}", out.display()));
            }
            continue;
        }
        tally.before_first_checkpoint += u32::from(!has_checkpoint(out));
        if let Some(disk) = disk {
            disk.cut_power()?;
            end(&mut child, "-KILL")?;
            disk.restart()?;
            tally.power_cuts += 1;
        } else if random.random_bool(0.5) {
            end(&mut child, "-KILL")?;
            tally.sigkill += 1;
        } else {
            end(&mut child, "-TERM")?;
            tally.sigterm += 1;
        }
    }
    let status = start(out)?.wait().context("cannot wait for the training")?;
    if !status.success() {
        tally.differences.push(format!("{} cannot be continued: {status}", out.display()));
    }
    Ok(())
}

fn end(child: &mut Child, signal: &str) -> anyhow::Result<()> {
    let mut kill = Command::new("kill");
    // It may have ended by itself.
    kill.args([signal, &child.id().to_string()]).stderr(Stdio::null()).status().context("cannot run kill")?;
    child.wait().context("cannot wait for the training")?;
    Ok(())
}

fn has_checkpoint(run: &Path) -> bool {
    let entries = std::fs::read_dir(run.join("checkpoints")).into_iter().flatten().flatten();
    entries.into_iter().any(|entry| entry.file_name().to_string_lossy().starts_with("episode-"))
}

/// Starts or continues the training of a run.
fn start(out: &Path) -> anyhow::Result<Child> {
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    let mut command = Command::new(program);
    command.args(["train", "--quiet"]);
    if has_checkpoint(out) {
        command.arg("--resume").arg(out);
    } else {
        command.args(["--hand", HAND, "--preset", "quick", "--seed", "1", "--out"]).arg(out);
        SETTINGS.iter().for_each(|setting| _ = command.args(["--set", setting]));
    }
    let silent = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    silent.spawn().context("cannot start a training")
}

/// What must be the same at the end of every run.
struct Results {
    policy: Vec<u8>,
    metrics: Vec<String>,
    postures: String,
}

impl Results {
    fn of(run: &Path) -> anyhow::Result<Results> {
        let file = |name: &str| -> anyhow::Result<Vec<u8>> {
            let path: PathBuf = run.join(name);
            std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))
        };
        file("summary.json")?;
        let metrics = String::from_utf8(file("metrics.csv")?).context("metrics.csv is no text")?;
        let wall = metrics.lines().next().and_then(|line| line.split(',').position(|column| column == WALL_TIME));
        let without = |line: &str| {
            let cells = line.split(',').enumerate().filter(|(i, _)| Some(*i) != wall);
            cells.map(|(_, cell)| cell).collect::<Vec<_>>().join(",")
        };
        let database = PostureDatabase::open_existing(run.join("postures.sqlite"))?;
        database.check_integrity()?;
        Ok(Results {
            policy: file("policy.safetensors")?,
            metrics: metrics.lines().map(without).collect(),
            postures: database.digest_before(u64::MAX)?,
        })
    }

    /// Names what differs.
    fn difference(&self, other: &Results) -> Option<String> {
        let mut found = Vec::new();
        if self.policy != other.policy {
            found.push("the policy differs".to_owned());
        }
        if self.metrics != other.metrics {
            found.push(format!("metrics.csv has {} rows of {}, or others", other.metrics.len(), self.metrics.len()));
        }
        if self.postures != other.postures {
            found.push("the postures differ".to_owned());
        }
        (!found.is_empty()).then(|| found.join(", "))
    }
}

fn describe(tally: &Tally, elapsed: Duration) -> String {
    let Tally { runs, sigkill, sigterm, power_cuts, before_first_checkpoint, differences } = tally;
    format!(
        "{runs} runs in {}: {sigkill} SIGKILL, {sigterm} SIGTERM, {power_cuts} power cuts, {before_first_checkpoint} of them \
         before the first checkpoint; {} lost something",
        duration(elapsed.as_secs_f64()),
        differences.len()
    )
}
