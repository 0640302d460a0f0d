//! `eigenhand train`

use std::fmt::Write;
use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use eigenhand_report::counted;
use eigenhand_train::request::{Launch, NewRun, Plan, ResumedRun};
use eigenhand_train::{
    Bar, Counting, FinishedRun, Lines, MOST_COMPONENTS, PICTURES, Progress, Quiet, Status, StoppedBy, Summary,
    TrainError, add_pictures, say,
};
use serde::Serialize;

use crate::bundled::synergy_at;
use crate::numbers::{LARGEST, number, whole};
use crate::output::{Outcome, duration, percent, print, print_json};
use crate::render::{OVERVIEW, Wanted, draw};
use crate::settings::SettingsArgs;
use crate::signals::on_stop;
use crate::{program, search_path, setup};

/// Exit status of a program that Ctrl-C ended, by the shell's convention.
pub const INTERRUPTED: u8 = 130;
/// Time between two lines of progress where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(20);
/// More numbers than this share of the actuators are hardly a reduction.
const HARDLY_FEWER: f64 = 0.5;

const EXAMPLES: &str = "\
Settings come from these layers; each overrides the layers before it: defaults, --preset, --config, --set, options.
Ctrl-C saves and stops after the current cycle (exit status 130); a second Ctrl-C stops at once.

Examples:
  eigenhand train --hand shadow
  eigenhand train --hand shadow --lambda 0 --objects cube,sphere --set learner.gamma=0.95
  eigenhand train --hand shadow --action-space synergy --synergy runs/shadow-default-l1-s1-1 --components 3
  eigenhand train --resume runs/shadow-default-l1-s1-1
  eigenhand train --from runs/shadow-default-l1-s1-1 --objects varied --episodes 2000
  eigenhand train --hand shadow --preset quick --seed 1";

/// Trains a hand to grasp and lift, and computes its synergy
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Hand to train, by name (`eigenhand hands list` shows the names) or directory
    #[arg(long, value_name = "NAME")]
    hand: Option<String>,
    #[command(flatten)]
    settings: SettingsArgs,
    /// How far the policy is confined to its synergy: 1 is all the way, 0 leaves it free
    #[arg(long, value_name = "X", value_parser = number, allow_negative_numbers = true)]
    lambda: Option<f64>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", value_parser = whole::<u64>(0..=LARGEST))]
    seed: Option<u64>,
    /// Run directory [default: runs/<hand>-<preset>-l<lambda>-s<seed>-<n>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// What the policy commands: every joint, or the numbers of the synergy that --synergy names
    #[arg(long, value_name = "SPACE", value_parser = ["joints", "synergy"])]
    action_space: Option<String>,
    /// Run, export, synergy.toml or ready synergy in whose numbers the policy acts
    #[arg(long, value_name = "PATH", requires = "action_space")]
    synergy: Option<PathBuf>,
    /// Components of the synergy: the numbers that command the hand
    #[arg(long, value_name = "K", value_parser = whole::<u64>(1..=1000))]
    components: Option<u64>,
    /// Starts with the networks of this run, in its settings unless others are given: other objects, another scene
    #[arg(long, value_name = "RUN", conflicts_with_all = ["preset", "action_space", "synergy", "components"])]
    from: Option<PathBuf>,
    /// Continues the run in this directory
    #[arg(
        long,
        value_name = "DIR",
        conflicts_with_all = ["hand", "preset", "lambda", "seed", "objects", "config", "assignments", "out", "action_space", "synergy", "components", "from"]
    )]
    resume: Option<PathBuf>,
    /// Saves and stops after this many training episodes; continue it later with --resume
    #[arg(long, value_name = "N", value_parser = whole::<u64>(1..=LARGEST))]
    until: Option<u64>,
    /// Threads for simulation and for updates; 0 means one for each core. The result does not depend on this number
    #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1024))]
    workers: Option<usize>,
    /// Whether to write event files for TensorBoard into the run directory [default: true]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, default_missing_value = "true")]
    tensorboard: Option<bool>,
    /// Prints the summary as JSON on standard output
    #[arg(long)]
    json: bool,
    /// Draws no pictures at the end (`render` draws them later)
    #[arg(long)]
    no_pictures: bool,
    /// Shows no progress
    #[arg(long)]
    quiet: bool,
    #[command(flatten)]
    install: setup::InstallArgs,
}

/// Returns a display of progress: a bar on a terminal, lines elsewhere.
pub fn on_stderr() -> Box<dyn Progress> {
    if std::io::stderr().is_terminal() { Box::new(Bar::new()) } else { Box::new(Lines::new(LINE_EVERY)) }
}

/// Shows progress, and asks the run to stop after some training episodes.
struct Until {
    shown: Box<dyn Progress>,
    episodes: u64,
    stop: Arc<AtomicBool>,
}

impl Progress for Until {
    fn update(&mut self, status: &Status) {
        if status.episodes >= self.episodes {
            self.stop.store(true, Ordering::Relaxed);
        }
        self.shown.update(status);
    }

    fn note(&mut self, line: &str) {
        self.shown.note(line);
    }

    fn warn(&mut self, line: &str) {
        self.shown.warn(line);
    }

    fn counting(&mut self) -> Option<Counting> {
        self.shown.counting()
    }

    fn finish(&mut self) {
        self.shown.finish();
    }
}

/// A summary with its run directory.
#[derive(Serialize)]
struct Report<'a> {
    run: PathBuf,
    #[serde(flatten)]
    summary: &'a Summary,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let launch = setup::with_mujoco(&args.install, || prepare(args))?;
    let plan = launch.plan().clone();
    if !args.quiet {
        say!("{}", heading(&plan).trim_end());
    }
    let stop = stop_on_signal()?;
    let shown: Box<dyn Progress> = if args.quiet { Box::new(Quiet) } else { on_stderr() };
    let until = args.until.unwrap_or(u64::MAX);
    let mut progress = Until { shown, episodes: until, stop: Arc::clone(&stop) };
    let plugins = program::plugins(&args.settings.plugins);
    let resume = program::line(&format!("train --resume {}{plugins}", program::path(&plan.run)));
    let summary = launch.run(&stop, &mut progress).map_err(|error| explain(error, &resume))?;
    // The results come first: what goes wrong in a picture must not cost them.
    if args.json {
        print_json(&Report { run: plan.run.clone(), summary: &summary })?;
    } else {
        print(&describe(&plan, &summary, &plugins))?;
    }
    if !args.no_pictures && plan.episodes_done < summary.episodes {
        draw_pictures(args, &plan, &summary);
    }
    match summary.stopped_by {
        StoppedBy::Episodes => Ok(Outcome::Done),
        StoppedBy::Interrupt => {
            say!("continue with: {resume}");
            Ok(if summary.episodes >= until { Outcome::Done } else { Outcome::Interrupted })
        }
    }
}

/// Draws a run that has succeeded, as `render` does. What stands in the way is only a note: the run is complete without.
fn draw_pictures(args: &Args, plan: &Plan, summary: &Summary) {
    if summary.stopped_by != StoppedBy::Episodes || summary.success_rate.is_none_or(|rate| rate == 0.0) {
        return;
    }
    if !args.quiet {
        say!("drawing {} (render draws them again)", plan.run.join(PICTURES).display());
    }
    let run = FinishedRun::open(&plan.run, &search_path(&args.settings.plugins), &[]).map_err(anyhow::Error::from);
    let drawn = run.and_then(|run| {
        let mut pictures = draw(&run, &Wanted::default())?.files;
        // TensorBoard shows no animation, and the overview repeats parts of the others.
        pictures.retain(|path| path.extension().is_some_and(|kind| kind == "png") && !path.ends_with(OVERVIEW));
        Ok(add_pictures(&plan.run, summary.episodes, &pictures)?)
    });
    if let Err(error) = drawn {
        say!("note: no pictures were drawn: {error:#}");
    }
}

/// Adds the next step to an error.
fn explain(error: TrainError, resume: &str) -> anyhow::Error {
    let context = match &error {
        // Its message has the next step: a resumed run would diverge again.
        TrainError::LearnerDiverged { .. } => return error.into(),
        _ => format!("the run stopped; continue from its last checkpoint with: {resume}"),
    };
    anyhow::Error::from(error).context(context)
}

/// Names the postures that a synergy covers.
fn postures_covered(n_postures: u64, window: usize) -> String {
    match window as u64 {
        window if (1..n_postures).contains(&window) => {
            format!("the newest {window} of {}", counted(n_postures, "posture"))
        }
        _ => counted(n_postures, "posture"),
    }
}

fn prepare(args: &Args) -> Result<Launch, TrainError> {
    match &args.resume {
        Some(run) => Launch::resume(&ResumedRun {
            run: run.clone(),
            episodes: args.settings.episodes,
            workers: args.workers,
            tensorboard: args.tensorboard,
            hands: search_path(&args.settings.plugins),
        }),
        None => {
            let mut request = args.settings.new_run();
            request.assignments.extend(action_space(args)?);
            Launch::start(&NewRun {
                hand: args.hand.clone(),
                from: args.from.clone(),
                lambda: args.lambda,
                seed: args.seed,
                workers: args.workers,
                tensorboard: args.tensorboard,
                out: args.out.clone(),
                ..request
            })
        }
    }
}

/// Returns the options on what the policy commands as assignments of settings.
fn action_space(args: &Args) -> Result<Vec<String>, TrainError> {
    let mut assignments = Vec::new();
    if let Some(space) = &args.action_space {
        assignments.push(format!("action_space={space}"));
    }
    if let Some(path) = &args.synergy {
        let path = synergy_at(path).map_err(|error| TrainError::Option {
            option: format!("--synergy {}", path.display()),
            reason: format!("{error:#}"),
        })?;
        // The run directory keeps the path, so it must not depend on the working directory.
        let path = std::path::absolute(&path).unwrap_or(path);
        assignments.push(format!("synergy.file={}", toml::Value::String(path.display().to_string())));
    }
    if let Some(components) = args.components {
        assignments.push(format!("synergy.components={components}"));
    }
    Ok(assignments)
}

/// Sets the flag at the first Ctrl-C or SIGTERM, and ends the program at the second.
fn stop_on_signal() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    on_stop(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(i32::from(INTERRUPTED));
        }
        // On a terminal, ^C has just appeared in a line of the bar. A new line keeps the bar from covering the message.
        let newline = if std::io::stderr().is_terminal() { "\n" } else { "" };
        say!("{newline}saving and stopping after this cycle; Ctrl-C again stops at once{newline}");
    })?;
    Ok(stop)
}

fn heading(plan: &Plan) -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: String| {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{name:<9} {value}");
    };
    line("run", plan.run.display().to_string());
    let (joints, actuators) = (plan.n_joints, plan.n_actuators);
    line("hand", format!("{}: {joints} joints, {actuators} actuators, {} fingers", plan.hand, plan.n_fingers));
    if let Some(grasps) = plan.scripted_grasps.filter(|grasps| !grasps.can_grasp()) {
        line("warning", grasps.verdict());
    }
    // The slide stands for the arm.
    let driven = plan.n_actuators.saturating_sub(1);
    let hardly = match plan.components {
        k if k == driven => ": no fewer",
        k if k as f64 > HARDLY_FEWER * driven as f64 => ": hardly fewer",
        _ => "",
    };
    line("synergy", format!("{} for {}{hardly}", counted(plan.components, "number"), counted(driven, "actuator")));
    line("objects", plan.objects.join(", "));
    if let Some(from) = &plan.from {
        line("networks", format!("those of {}", from.display()));
    }
    let resumed = match plan.episodes_done {
        0 => String::new(),
        n => format!(", from episode {n}"),
    };
    line(
        "training",
        format!(
            "{} episodes{resumed}, lambda {}, seed {}, preset {}, {}",
            plan.episodes,
            plan.lambda,
            plan.seed,
            plan.preset.name(),
            counted(plan.workers, "worker")
        ),
    );
    line("MuJoCo", format!("{} from {}", plan.mujoco_version, plan.mujoco_library));
    text
}

/// `plugins` holds the options for additional directories of hands, because later commands need them.
fn describe(plan: &Plan, summary: &Summary, plugins: &str) -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: &str| {
        let _ = writeln!(text, "{name:<10} {value}");
    };
    line(
        "trained",
        &format!(
            "{} in {} ({} environment steps, {} updates)",
            counted(summary.episodes, "episode"),
            duration(summary.wall_s),
            summary.env_steps,
            summary.updates
        ),
    );
    match summary.success_rate {
        Some(rate) => {
            let policy = summary.policy_episode;
            line(
                "success",
                &format!("{} of {} new episodes (policy after episode {policy})", percent(rate), summary.eval_episodes),
            );
            if summary.success_rate_per_object.len() > 1 {
                for (object, rate) in &summary.success_rate_per_object {
                    line("", &format!("{object:<10} {:>7}", percent(*rate)));
                }
            }
        }
        None => line("success", "not evaluated, because the run was interrupted"),
    }
    for (i, k) in driven_rows(summary).into_iter().enumerate() {
        let rate = percent(summary.success_with_components[k]);
        let note = if k == 0 { " (a constant command)" } else { "" };
        line(if i == 0 { "driven" } else { "" }, &format!("with {}: {rate}{note}", counted(k as u64, "number")));
    }
    if let Some(other) = &summary.other_objects {
        let with = other.success_with_components.map_or_else(String::new, |rate| {
            format!(", with {} {}", counted(summary.components, "number"), percent(rate))
        });
        let objects = counted(other.success_rate_per_object.len(), "object");
        let rate = percent(other.success_rate);
        line("others", &format!("{rate} of {} episodes with {objects} of no training{with}", other.episodes));
    }
    match (summary.contribution_sum, summary.mean_error_rad) {
        (Some(sum), Some(error)) => {
            let rates: Vec<String> = summary.contribution.iter().map(|rate| format!("{:.1}", 100.0 * rate)).collect();
            line(
                "postures",
                &format!(
                    "{} components of {}: {} = {:.1} % of the variance, mean error {error:.3} rad",
                    rates.len(),
                    postures_covered(summary.n_postures, plan.window),
                    rates.join(" + "),
                    100.0 * sum
                ),
            );
        }
        _ => line("postures", &format!("{}: too few, or too little success, for an analysis", summary.n_postures)),
    }
    if summary.diverged_episodes > 0 {
        line("diverged", &format!("{}, discarded", counted(summary.diverged_episodes, "episode")));
    }
    if summary.buffer_warnings > 0 {
        line("warnings", &format!("MuJoCo's buffers were full at {}", counted(summary.buffer_warnings, "step")));
    }
    let run = plan.run.display().to_string();
    line("files", &format!("{run}/"));
    if plan.run.join("synergy").is_dir() {
        line("", "  synergy/                      the synergy that drives the hand, as TOML and NPY");
    }
    if summary.contribution_sum.is_some() {
        line("", "  synergy-postures/             the synergy of the grasps' end postures");
    }
    line("", "  policy.safetensors, .toml     the policy, and how to run it");
    line("", "  scenes/                       scenes for plain MuJoCo");
    line("", "  postures.sqlite               the posture database");
    line("", "  metrics.csv, summary.json     learning curves, and results");
    if summary.stopped_by == StoppedBy::Episodes {
        let run = program::path(&plan.run);
        // One actuator is the slide's.
        let most = (plan.n_actuators - 1).min(MOST_COMPONENTS);
        line("next", &program::line(&format!("eval {run}{plugins} --components 0..{most}")));
        line("", &program::line(&format!("explore {run}{plugins}")));
        line(
            "",
            &program::line(&format!("export {run}{plugins} --out {}", program::word(&format!("my-{}", plan.hand)))),
        );
    }
    text
}

/// Returns the numbers of components whose success is worth a line: a constant command, one, two, and as configured.
fn driven_rows(summary: &Summary) -> Vec<usize> {
    let most = summary.success_with_components.len().saturating_sub(1);
    let mut rows: Vec<usize> = [0, 1, 2, summary.components].map(|k| k.min(most)).to_vec();
    rows.sort_unstable();
    rows.dedup();
    rows.retain(|&k| k < summary.success_with_components.len());
    rows
}
