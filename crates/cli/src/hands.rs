//! `eigenhand hands`

use std::fmt::Write;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use clap::Subcommand;
use eigenhand_hands::{HandSummary, ImportOptions, Registry, RegistryEntry, Transmission};
use eigenhand_mujoco::MuJoCo;
use eigenhand_onboard::{Hints, NewHand, Step, check_hand, default_picture, describe_new_hand, new_hand};
use eigenhand_sim::contract::ContractReport;
use eigenhand_train::config::RunConfig;
use eigenhand_train::{hand_named, say};
use indicatif::ProgressBar;
use serde::Serialize;

use crate::output::{Outcome, print, print_json, table_left};
use crate::{program, search_path, setup};

/// Lists, shows, checks and makes hands
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  eigenhand hands new my-hand --from my_hand.urdf    # a hand of your own, from URDF or MJCF\n  \
    eigenhand hands list"
)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Lists the hands that were found
    #[command(after_help = "Example:\n  eigenhand hands list --plugins ../my-hands")]
    List(ListArgs),
    /// Shows a hand's joints, actuators and settings, and where each setting comes from
    #[command(after_help = "Example:\n  eigenhand hands show shadow")]
    Show(NamedArgs),
    /// Tests a hand in the simulator before training (the hand contract), and draws it
    #[command(after_help = "Examples:\n  eigenhand hands check shadow\n  \
                            eigenhand hands check ../my-hands/gripper --picture gripper.png")]
    Check(CheckArgs),
    /// Makes a hand's directory from its model file (MJCF or URDF)
    #[command(after_help = "Examples:\n  eigenhand hands new gripper --from 2f85.xml --out ../my-hands/gripper\n  \
                            eigenhand hands new my-hand --from my_hand.urdf --package my_description=../my_description\n  \
                            eigenhand hands check my-hand\n  \
                            eigenhand train --hand my-hand")]
    New(NewArgs),
}

#[derive(clap::Args)]
struct ListArgs {
    /// Additional directory of hands; can be given several times
    #[arg(long, value_name = "DIR")]
    plugins: Vec<PathBuf>,
    /// Prints one JSON document on standard output
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args)]
struct NamedArgs {
    /// Name of the hand, or its directory
    #[arg(value_name = "NAME|PATH")]
    name: String,
    #[command(flatten)]
    common: ListArgs,
}

#[derive(clap::Args)]
struct CheckArgs {
    #[command(flatten)]
    named: NamedArgs,
    /// PNG file for a picture of the hand above the table with each object [default: runs/hands/<name>.png]
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Draws no picture
    #[arg(long, conflicts_with = "picture")]
    no_picture: bool,
    #[command(flatten)]
    install: setup::InstallArgs,
}

#[derive(clap::Args)]
struct NewArgs {
    /// Name of the hand: lower-case letters, digits, `-` and `_`
    name: String,
    /// Model file from the hand's maker: MJCF (.xml) or URDF
    #[arg(long, value_name = "FILE")]
    from: PathBuf,
    /// Directory to make for the hand [default: plugins/NAME]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Directory of a ROS package that the model file refers to; can be given several times
    #[arg(long = "package", value_name = "NAME=DIR", value_parser = package)]
    packages: Vec<(String, PathBuf)>,
    /// Body or link of the palm [default: the body that carries all fingers; needed if the file holds several hands]
    #[arg(long, value_name = "LINK")]
    palm: Option<String>,
    /// Direction, in the palm's frame, in which the hand approaches an object: +x, -y, ... or x,y,z [default: the best of
    /// several, by scripted grasps]
    #[arg(long, value_name = "AXIS", value_parser = axis, allow_hyphen_values = true)]
    approach: Option<[f64; 3]>,
    /// Prints one JSON document on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    install: setup::InstallArgs,
}

fn package(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, directory)) if !name.is_empty() && !directory.is_empty() => Ok((name.into(), directory.into())),
        _ => Err("expected NAME=DIR, such as my_description=../my_description".to_owned()),
    }
}

fn axis(text: &str) -> Result<[f64; 3], String> {
    let expected = || "expected an axis such as +z or -y, or three numbers such as 0,0.7,0.7".to_owned();
    let (sign, letter) = match text.strip_prefix('-') {
        Some(rest) => (-1.0, rest),
        None => (1.0, text.strip_prefix('+').unwrap_or(text)),
    };
    if let Some(at) = ["x", "y", "z"].iter().position(|name| *name == letter) {
        return Ok(std::array::from_fn(|i| if i == at { sign } else { 0.0 }));
    }
    let numbers: Vec<f64> =
        text.split(',').map(|part| part.trim().parse().map_err(|_| expected())).collect::<Result<_, _>>()?;
    let vector = <[f64; 3]>::try_from(numbers).map_err(|_| expected())?;
    let length = vector.iter().map(|v| v * v).sum::<f64>().sqrt();
    if length > 1e-6 && length.is_finite() { Ok(vector.map(|v| v / length)) } else { Err(expected()) }
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    match &args.command {
        Command::List(args) => list(args),
        Command::Show(args) => show(args),
        Command::Check(args) => check(args),
        Command::New(args) => new(args),
    }
}

/// A hand in the list.
#[derive(Serialize)]
struct Listed {
    name: String,
    directory: PathBuf,
    description: Option<String>,
    n_joints: Option<usize>,
    n_actuators: Option<usize>,
    n_fingers: Option<usize>,
    digest: Option<String>,
    error: Option<String>,
}

impl Listed {
    fn of(entry: &RegistryEntry) -> Listed {
        let summary = entry.summary();
        let summary = summary.as_ref();
        Listed {
            name: entry.name.clone(),
            directory: entry.directory.clone(),
            description: summary.map(|s| s.description.clone()),
            n_joints: summary.map(|s| s.n_joints),
            n_actuators: summary.map(|s| s.n_actuators),
            n_fingers: summary.map(|s| s.n_fingers),
            digest: summary.map(|s| s.digest.clone()),
            error: entry.hand.as_ref().err().map(ToString::to_string),
        }
    }
}

fn list(args: &ListArgs) -> anyhow::Result<Outcome> {
    let registry = Registry::discover(&search_path(&args.plugins))?;
    let hands: Vec<Listed> = registry.list().iter().map(Listed::of).collect();
    if args.json {
        print_json(&hands)?;
        return Ok(Outcome::Done);
    }
    if hands.is_empty() {
        say!("no hands were found; name a directory of hands with --plugins");
        return Ok(Outcome::Done);
    }
    let width = hands.iter().map(|hand| hand.name.len()).max().unwrap_or(0);
    let mut text = String::new();
    for hand in &hands {
        let (name, directory) = (&hand.name, hand.directory.display());
        match (&hand.error, hand.n_joints, hand.n_actuators, hand.n_fingers) {
            (None, Some(joints), Some(actuators), Some(fingers)) => {
                let description = hand.description.as_deref().unwrap_or_default();
                writeln!(text, "{name:<width$}  {joints:>2} joints, {actuators:>2} actuators, {fingers} fingers")?;
                if !description.is_empty() {
                    writeln!(text, "{:<width$}  {description}", "")?;
                }
                writeln!(text, "{:<width$}  {directory}", "")?;
            }
            (error, ..) => {
                let error = error.as_deref().unwrap_or_default();
                writeln!(text, "{name:<width$}  BROKEN: {error}")?;
            }
        }
    }
    print(&text)?;
    Ok(Outcome::Done)
}

fn show(args: &NamedArgs) -> anyhow::Result<Outcome> {
    let hand = hand_named(&args.name, &search_path(&args.common.plugins))?;
    let summary = HandSummary::of(&hand);
    if args.common.json {
        print_json(&summary)?;
    } else {
        print(&describe_hand(&summary))?;
    }
    Ok(Outcome::Done)
}

fn describe_hand(hand: &HandSummary) -> String {
    let range = |range: Option<(f64, f64)>| {
        range.map_or_else(|| "unlimited".to_owned(), |(low, high)| format!("{low:.4} to {high:.4}"))
    };
    let mut text = format!(
        "{}: {}\n{} joints, {} actuators, {} fingers; licence {}\n{}, digest {}\n",
        hand.name,
        hand.description,
        hand.n_joints,
        hand.n_actuators,
        hand.n_fingers,
        hand.licence,
        hand.directory.display(),
        hand.digest
    );
    if let Some(grasps) = hand.scripted_grasps {
        text.push_str(&format!("{}\n", grasps.verdict()));
    }
    let mut section = |title: &str, rows: Vec<Vec<String>>| {
        if !rows.is_empty() {
            text.push_str(&format!("\n{title}\n"));
            table_left(&rows).lines().for_each(|line| text.push_str(&format!("  {line}\n")));
        }
    };
    section(
        &format!("posture: {} joints", hand.n_posture),
        hand.posture.iter().map(|j| vec![j.name.clone(), range(j.range), j.unit.to_owned()]).collect(),
    );
    section(
        "actuators, without that of the slide",
        hand.actuators
            .iter()
            .map(|a| {
                let acts_on = match &a.transmission {
                    Transmission::Joint(joint) => joint.clone(),
                    Transmission::FixedTendon { terms, .. } => {
                        terms.iter().map(|(joint, factor)| format!("{factor} {joint}")).collect::<Vec<_>>().join(" + ")
                    }
                    Transmission::Other(what) => what.clone(),
                };
                vec![a.name.clone(), format!("on {acts_on}"), range(Some(a.ctrlrange)), a.tag.clone()]
            })
            .collect(),
    );
    section(
        "couplings",
        hand.couplings
            .iter()
            .map(|c| match &c.driver {
                Some(driver) => vec![c.dependent.clone(), format!("follows {driver}")],
                None => vec![c.dependent.clone(), "is held in place".to_owned()],
            })
            .collect(),
    );
    section("changed or assumed while the model was read", hand.notes.iter().map(|note| vec![note.clone()]).collect());
    section(
        "settings, and where they come from",
        hand.values
            .iter()
            .map(|v| vec![v.key.clone(), format!("{:?}", v.origin).to_lowercase(), v.value.to_string()])
            .collect(),
    );
    text
}

fn check(args: &CheckArgs) -> anyhow::Result<Outcome> {
    let NamedArgs { name, common } = &args.named;
    let hand = hand_named(name, &search_path(&common.plugins))?;
    let library = setup::with_mujoco(&args.install, MuJoCo::load)?;
    let picture = args.picture.clone().unwrap_or_else(|| default_picture(&hand));
    let found = check_hand(
        &hand,
        &library,
        &RunConfig::default_preset()?.setting(),
        (!args.no_picture).then_some(picture.as_path()),
    )?;
    if common.json {
        print_json(&found)?;
    } else {
        let picture = found.picture.iter().map(|file| format!("picture {}\n", file.display()));
        let symptoms = found.symptoms.iter().map(|symptom| format!("look at {symptom}\n"));
        let plugins = program::plugins(&common.plugins);
        let train = program::line(&format!("train --hand {}{plugins}", program::word(name)));
        let next = found.report.passed().then(|| format!("next:    {train}\n"));
        print(&symptoms.chain([describe(&found.report)]).chain(picture).chain(next).collect::<String>())?;
    }
    Ok(if found.report.passed() { Outcome::Done } else { Outcome::Failed })
}

fn new(args: &NewArgs) -> anyhow::Result<Outcome> {
    let request = NewHand {
        name: args.name.clone(),
        source: args.from.clone(),
        directory: args.out.clone().unwrap_or_else(|| PathBuf::from("plugins").join(&args.name)),
        options: ImportOptions { packages: args.packages.iter().cloned().collect() },
        hints: Hints { palm: args.palm.clone(), approach: args.approach },
    };
    let library = setup::with_mujoco(&args.install, MuJoCo::load)?;
    let mut notes = Vec::new();
    let setting = RunConfig::default_preset()?.setting();
    let progress = StepLines::new();
    let made = new_hand(&request, &library, &setting, &mut notes, &|step| progress.show(step));
    progress.end();
    let report = match made {
        Ok(report) => report,
        Err(error) => {
            notes.iter().for_each(|note| say!("note: {note}"));
            return Err(error.into());
        }
    };
    let outcome = if report.is_usable() { Outcome::Done } else { Outcome::Failed };
    if args.json {
        print_json(&report)?;
        return Ok(outcome);
    }
    let directory = program::path(&report.directory);
    let check = program::line(&format!("hands check {directory}"));
    let next = if report.is_usable() {
        format!("next:    {check}\n         {}\n", program::line(&format!("train --hand {directory}")))
    } else {
        let reason = report.likeliest_reason().or_else(|| report.broken.first().cloned()).unwrap_or_default();
        format!("likeliest reason: {reason}\nnext:    {check}\n")
    };
    print(&format!("{}\nwritten: {directory}\n{}\n{next}", describe_new_hand(&report), report.verdict()))?;
    Ok(outcome)
}

/// The steps of `hands new` on standard error: one line that changes on a terminal, and otherwise a line now and then.
struct StepLines {
    line: ProgressBar,
    last: Mutex<Option<(Step, Instant)>>,
}

impl StepLines {
    fn new() -> StepLines {
        StepLines { line: ProgressBar::new_spinner(), last: Mutex::new(None) }
    }

    fn show(&self, step: Step) {
        const EVERY: Duration = Duration::from_secs(5);
        self.line.set_message(step.to_string());
        self.line.tick();
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let another = |(before, at): (Step, Instant)| {
            std::mem::discriminant(&before) != std::mem::discriminant(&step)
                || matches!(step, Step::Approach(..))
                || at.elapsed() >= EVERY
        };
        // Without a terminal, the line above is hidden.
        if self.line.is_hidden() && last.is_none_or(another) {
            // Nobody is harmed by a step that cannot be shown.
            let _ = writeln!(std::io::stderr(), "{step}");
            *last = Some((step, Instant::now()));
        }
    }

    fn end(&self) {
        self.line.finish_and_clear();
    }
}

/// Describes the results of the contract, one line for each check.
pub fn describe(report: &ContractReport) -> String {
    let width = report.checks.iter().map(|check| check.name.len()).max().unwrap_or(0);
    let mut text = String::new();
    for check in &report.checks {
        let mark = if check.passed { "ok  " } else { "FAIL" };
        text.push_str(&format!("{mark}  {:<width$}  {}\n", check.name, check.detail));
    }
    let failed = report.checks.iter().filter(|check| !check.passed).count();
    let verdict = match failed {
        0 => "passes the hand contract".to_owned(),
        n => format!("fails {n} of {} checks of the hand contract", report.checks.len()),
    };
    text.push_str(&format!("hand {} {verdict}\n", report.hand));
    text
}
