//! `eigenhand sweep`

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::Ordering;

use anyhow::{Context, bail};
use eigenhand_report::counted;
use eigenhand_train::request::NewRun;
use eigenhand_train::runs::children::{Ending, train};
use eigenhand_train::runs::{Job, State};
use eigenhand_train::say;
use eigenhand_train::sweep::{Sweep, SweepFile, slurm};

use crate::numbers::whole;
use crate::output::{Outcome, print, table_left};
use crate::several::{Share, again, count_signals, display, failed, own_program, same_command};
use crate::{program, report, search_path, setup};

/// File with the numbers of the jobs that were submitted, in the directory of a sweep.
const SUBMITTED: &str = "slurm-jobs.txt";

const EXAMPLES: &str = "\
A file names what varies; every combination is trained with every seed:

  hands = [\"shadow\", \"myhand\"]
  lambdas = [0, 1]
  seeds = [1, 2, 3]
  [settings]                       # the same for all
  evaluation.every = 100
  [grid]                           # each value with all others
  learner.gamma = [0.95, 0.98]
  [search]                         # drawn at random
  samples = 8
  [search.values]
  learner.actor_learning_rate = { sample = \"log\", low = 1e-4, high = 1e-2 }
  synergy.components = { sample = \"choice\", of = [3, 5] }
  [halving]                        # after 300 and 900 episodes, the better half of each hand goes on
  episodes = [300, 900]
  keep = 0.5
  [slurm]
  cpus = 2
  options = [\"--time=2:00:00\"]

Each run is a separate process with a directory of its own. To continue after an interruption, give the same command again: it
keeps complete runs and resumes the others.

Examples:
  eigenhand sweep gamma.toml --dry-run
  eigenhand sweep gamma.toml --jobs 2
  eigenhand sweep gamma.toml --slurm";

/// Trains every combination of hands, lambdas, seeds and settings, here or on a cluster, and compares them
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// TOML file that says what varies
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Directory of the runs [default: runs/sweep-<name of the file>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Additional directory of hands; can be given several times
    #[arg(long, value_name = "DIR")]
    plugins: Vec<PathBuf>,
    /// Trains hands that fail the hand contract, too
    #[arg(long)]
    force: bool,
    /// Number of runs at a time [default: one for every two cores]
    #[arg(long, value_name = "N", value_parser = whole::<u64>(1..=1024))]
    jobs: Option<u64>,
    /// Submits the runs to Slurm as a job array, instead of training here
    #[arg(long, conflicts_with = "jobs")]
    slurm: bool,
    /// Lists the runs and their state, and trains nothing
    #[arg(long, conflicts_with = "slurm")]
    dry_run: bool,
    /// Prints the report as JSON on standard output
    #[arg(long)]
    json: bool,
    /// Shows no progress
    #[arg(long)]
    quiet: bool,
    /// Trains the run of this number: what a task of a job array does
    #[arg(long, value_name = "N", hide = true)]
    task: Option<usize>,
    /// The stage in which it does
    #[arg(long, value_name = "N", hide = true, default_value_t = 0)]
    stage: usize,
    /// Its threads
    #[arg(long, value_name = "N", hide = true, default_value_t = 0)]
    workers: usize,
    #[command(flatten)]
    install: setup::InstallArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let file = SweepFile::read(&args.file)?;
    let stem = args.file.file_stem().unwrap_or_default().to_string_lossy();
    let directory = args.out.clone().unwrap_or_else(|| Path::new("runs").join(format!("sweep-{stem}")));
    let base = NewRun { force: args.force, hands: search_path(&args.plugins), ..NewRun::default() };
    let sweep = Sweep::prepare(&file, &base, &directory, args.task)?;
    if let Some(task) = args.task {
        return run_task(args, &sweep, task);
    }
    if args.dry_run {
        return list(&sweep);
    }
    setup::ensure_mujoco(&args.install)?;
    if args.slurm {
        return submit(args, &sweep, &stem);
    }
    train_here(args, &sweep)
}

fn train_here(args: &Args, sweep: &Sweep) -> anyhow::Result<Outcome> {
    sweep.write_studies()?;
    let _locked = sweep.lock()?;
    let stop = count_signals()?;
    let program = own_program()?;
    let mut failures: Vec<String> = Vec::new();
    let others = sweep.others()?.len();
    if others > 0 && !args.quiet {
        say!(
            "note: {} there that the file does not name",
            if others == 1 { "a run is".to_owned() } else { format!("{others} runs are") }
        );
    }
    for stage in 0..sweep.stages() {
        let (positions, jobs): (Vec<usize>, Vec<Job>) = sweep.jobs(stage)?.into_iter().unzip();
        let share = Share::of(args.jobs, jobs.iter().filter(|job| !job.is_done()).count());
        if !args.quiet {
            say!("{}", heading(sweep, stage, &jobs, share).trim_end());
        }
        let mut shown = display(args.quiet);
        let command = |i: usize| {
            let mut command = again(&program);
            command.args(arguments(args, sweep, positions[i], &jobs[i], share.workers));
            Ok(command)
        };
        let endings = train(&jobs, share.jobs, &stop, &command, shown.as_mut())?;
        failures.extend(failed(&jobs, &endings).into_iter().map(str::to_owned));
        if stop.load(Ordering::Relaxed) > 0 && endings.contains(&Ending::Stopped) {
            say!("continue with: {}", same_command());
            return Ok(Outcome::Interrupted);
        }
    }
    let shown = report::show_studies(&sweep.studies(), args.json);
    if failures.is_empty() {
        return shown.map(|()| Outcome::Done);
    }
    if let Err(error) = shown {
        say!("no report: {error:#}");
    }
    say!("failed: {}; try again with: {}", failures.join(", "), same_command());
    Ok(Outcome::Failed)
}

/// Becomes the training of one run.
fn run_task(args: &Args, sweep: &Sweep, task: usize) -> anyhow::Result<Outcome> {
    let Some(member) = sweep.members.get(task) else {
        bail!("--task {task}: the sweep has {}", counted(sweep.members.len(), "run"));
    };
    let name = &member.job.name;
    let Some(job) = sweep.job(args.stage, task)? else {
        say!("{name} is not among the best, and ends here");
        return Ok(Outcome::Done);
    };
    if job.is_done() {
        say!("{name} is done");
        return Ok(Outcome::Done);
    }
    let mut command = Command::new(own_program()?);
    command.args(arguments(args, sweep, task, &job, args.workers));
    // In place of this process, so that the signals of Slurm reach the training.
    Err(command.exec()).context("cannot start the training")
}

/// Returns the arguments with which this program trains or resumes a run.
fn arguments(args: &Args, sweep: &Sweep, position: usize, job: &Job, workers: usize) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = vec!["train".into(), "--no-install".into()];
    let mut option = |name: &str, value: OsString| arguments.extend([name.into(), value]);
    option("--workers", workers.to_string().into());
    if let Some(until) = job.until {
        option("--until", until.to_string().into());
    }
    args.plugins.iter().for_each(|directory| option("--plugins", directory.into()));
    if job.state != State::New {
        option("--resume", job.run.clone().into());
        return arguments;
    }
    let request = &sweep.members[position].request;
    option("--out", job.run.clone().into());
    if let Some(preset) = request.preset {
        option("--preset", preset.name().into());
    }
    // A request without a hand means the hand of the default configuration.
    let hand = request.hand.clone().unwrap_or_else(|| sweep.variants[sweep.members[position].variant].hand.clone());
    option("--hand", hand.into());
    if let Some(lambda) = request.lambda {
        option("--lambda", lambda.to_string().into());
    }
    if let Some(seed) = request.seed {
        option("--seed", seed.to_string().into());
    }
    if let Some(episodes) = request.episodes {
        option("--episodes", episodes.to_string().into());
    }
    request.assignments.iter().for_each(|assignment| option("--set", assignment.into()));
    if args.force {
        arguments.push("--force".into());
    }
    arguments
}

fn heading(sweep: &Sweep, stage: usize, jobs: &[Job], Share { jobs: at_a_time, workers }: Share) -> String {
    let done = jobs.iter().filter(|job| job.is_done()).count();
    let until = jobs.iter().find_map(|job| job.until);
    let until = until.map_or_else(|| "to their end".to_owned(), |until| format!("to episode {until}"));
    let stage = if sweep.stages() > 1 { format!("stage {} of {}: ", stage + 1, sweep.stages()) } else { String::new() };
    format!(
        "runs      {}/\ntraining  {stage}{} of {} {until}, {done} done, {at_a_time} at a time with {} each\n",
        sweep.directory.display(),
        counted(jobs.len(), "run"),
        counted(sweep.variants.len(), "variant"),
        counted(workers, "worker"),
    )
}

/// Prints the runs, with the numbers that tasks of a job array have.
fn list(sweep: &Sweep) -> anyhow::Result<Outcome> {
    let heads = ["task", "run", "what", "state"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    for (i, member) in sweep.members.iter().enumerate() {
        let state = match member.job.state {
            State::New => "new".to_owned(),
            State::Interrupted { episodes } => format!("{episodes} of {} episodes", member.job.episodes),
            State::Complete => "complete".to_owned(),
        };
        rows.push(vec![i.to_string(), member.job.name.clone(), sweep.variants[member.variant].title.clone(), state]);
    }
    print(&table_left(&rows))?;
    Ok(Outcome::Done)
}

/// Submits every stage; each waits for the one before it.
fn submit(args: &Args, sweep: &Sweep, stem: &str) -> anyhow::Result<Outcome> {
    sweep.write_studies()?;
    let _locked = sweep.lock()?;
    let waiting: Vec<usize> = sweep
        .members
        .iter()
        .enumerate()
        .filter(|(_, member)| member.job.state != State::Complete)
        .map(|(i, _)| i)
        .collect();
    let last = sweep.jobs(sweep.stages() - 1)?;
    if last.iter().all(|(_, job)| job.is_done()) {
        report::show_studies(&sweep.studies(), args.json)?;
        return Ok(Outcome::Done);
    }
    refuse_queued(sweep)?;
    let directory = sweep.directory.canonicalize().context("cannot find the directory of the sweep")?;
    let file = args.file.canonicalize().context("cannot find the file of the sweep")?;
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    let mut command: Vec<String> = vec![program::path(&program), "sweep".to_owned(), program::path(&file)];
    command.extend(["--out".to_owned(), program::path(&directory)]);
    args.plugins.iter().for_each(|place| command.extend(["--plugins".to_owned(), program::path(place)]));
    if args.force {
        command.push("--force".to_owned());
    }
    let script = directory.join(slurm::SCRIPT);
    let text = slurm::script(&sweep.file.slurm, &format!("eigenhand-{stem}"), &directory, &command.join(" "));
    eigenhand_files::write_atomically(&script, text.as_bytes())?;
    let mut submitted: Vec<String> = Vec::new();
    for stage in 0..sweep.stages() {
        let mut sbatch = Command::new("sbatch");
        sbatch.arg("--parsable").arg(format!("--array={}", slurm::array(&waiting)));
        if let Some(before) = submitted.last() {
            sbatch.arg(format!("--dependency=afterany:{before}"));
        }
        let job = said(sbatch.arg(&script).arg(stage.to_string()))?;
        // Where there are several clusters, the name of the cluster follows.
        submitted.push(job.split(';').next().unwrap_or_default().to_owned());
        eigenhand_files::write_atomically(&directory.join(SUBMITTED), submitted.join("\n").as_bytes())?;
    }
    let jobs = submitted.join(",");
    print(&format!(
        "submitted: {} as job {jobs}\nlogs:      {}/slurm-*.log\nwatch:     squeue --jobs {jobs}\n\
         When the jobs have ended, the same command submits what is not complete, or shows the results.\n",
        counted(waiting.len(), "run"),
        directory.display(),
    ))?;
    Ok(Outcome::Done)
}

/// Refuses to submit runs twice.
fn refuse_queued(sweep: &Sweep) -> anyhow::Result<()> {
    let Ok(before) = std::fs::read_to_string(sweep.directory.join(SUBMITTED)) else { return Ok(()) };
    let jobs: Vec<&str> = before.split_whitespace().collect();
    if jobs.is_empty() {
        return Ok(());
    }
    // Slurm forgets ended jobs, and then calls their numbers invalid.
    let queued =
        said(Command::new("squeue").args(["--noheader", "--format=%A", "--jobs", &jobs.join(",")])).unwrap_or_default();
    if queued.is_empty() {
        return Ok(());
    }
    bail!(
        "jobs of this sweep are still queued or run ({}); wait for them, or end them with: scancel {}",
        jobs.join(", "),
        jobs.join(" ")
    );
}

/// Returns what a command of Slurm prints.
fn said(command: &mut Command) -> anyhow::Result<String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = match command.output() {
        Ok(output) => output,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            bail!("{name} is not here: run this where Slurm is installed, or train here without --slurm")
        }
        Err(error) => return Err(error).with_context(|| format!("cannot run {name}")),
    };
    if !output.status.success() {
        bail!("{name} failed: {}", String::from_utf8_lossy(&output.stderr).trim());
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
