//! `eigenhand eval`

use std::path::PathBuf;

use eigenhand_train::config::MOST_EVALUATED;
use eigenhand_train::{
    Assessment, Drive, Driven, FinishedRun, Freedom, Progress, Silent, Stress, StressRow, Workers, say,
};

use crate::numbers::{LARGEST, whole};
use crate::output::{Outcome, percent, print, print_json, table};
use crate::train::on_stderr;
use crate::{search_path, setup};

const EPISODES: u64 = 200;
/// Episodes of each row of `--stress`.
const STRESS_EPISODES: u64 = 70;

/// Measures the success rate of a run's policy, without exploration and on new episodes
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  eigenhand eval runs/shadow-quick-l1-s1-1 --episodes 500\n  \
    eigenhand eval runs/shadow-default-l1-s1-1 --set 'physics.friction=[0.8,0.8]'\n  \
    eigenhand eval runs/shadow-default-l1-s1-1 --objects unseen\n  \
    eigenhand eval runs/shadow-default-l1-s1-1 --components 0..8\n  \
    eigenhand eval runs/shadow-default-l1-s1-1 --components 0..8 --free wrist_1,wrist_2\n  \
    eigenhand eval runs/shadow-default-l1-s1-1 --stress")]
pub struct Args {
    /// Run directory
    run: PathBuf,
    /// Number of episodes; the objects take turns [default: 200; with --stress 70 for each row]
    #[arg(long, value_name = "N", value_parser = whole::<u64>(1..=MOST_EVALUATED))]
    episodes: Option<u64>,
    /// Seed of the episodes
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = whole::<u64>(0..=LARGEST))]
    seed: u64,
    /// Measures success with so many numbers instead of all joints, for example 0..8
    #[arg(long, value_name = "FROM..TO", value_parser = parse_range)]
    components: Option<(usize, usize)>,
    /// Measures what the grasps endure: the same episodes with less friction, a heavier object, a push and more
    #[arg(long, conflicts_with = "components")]
    stress: bool,
    /// First steps of an episode in which all joints are free
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = whole::<usize>(0..=LARGEST), requires = "components")]
    free_steps: usize,
    /// Actuators that are always free, separated by commas, such as those of a wrist
    #[arg(long, value_name = "NAMES", value_delimiter = ',', requires = "components")]
    free: Vec<String>,
    /// Threads that simulate; 0 means one for each core
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = whole::<usize>(0..=1024))]
    workers: usize,
    /// Other objects than those of the training, separated by commas: objects, sets, directories or files
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    objects: Option<Vec<String>>,
    /// Changes one setting of the scene, such as physics.noslip_iterations=0; can be given several times
    #[arg(long = "set", value_name = "KEY=VALUE")]
    assignments: Vec<String>,
    /// Additional directory of hands; can be given several times
    #[arg(long, value_name = "DIR")]
    plugins: Vec<PathBuf>,
    /// Prints one JSON document on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    install: setup::InstallArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut changes = args.assignments.clone();
    changes.extend(args.objects.as_ref().map(|words| format!("objects={words:?}")));
    let run = {
        let hands = search_path(&args.plugins);
        setup::with_mujoco(&args.install, || FinishedRun::open(&args.run, &hands, &changes))?
    };
    let episodes = args.episodes.unwrap_or(if args.stress { STRESS_EPISODES } else { EPISODES });
    let count = eigenhand_train::config::worker_count(args.workers);
    let mut shown: Box<dyn Progress> = if args.json { Box::new(Silent) } else { on_stderr() };
    let workers = Workers { count, counting: shown.counting() };
    if !args.json {
        let hand = &run.hand.manifest.name;
        say!(
            "evaluating the hand {hand} of {} on {} new episodes, seed {}{}{}",
            args.run.display(),
            episodes,
            args.seed,
            if changes.is_empty() { "" } else { ", with " },
            changes.join(", ")
        );
    }
    if args.stress {
        let progress = |row: &StressRow| shown.note(&format!("{}: {}", name_of(row), percent(row.success_rate)));
        let found = run.stress(episodes, args.seed, workers, progress)?;
        if args.json {
            print_json(&found)?
        } else {
            print(&describe_stress(&found))?
        }
        // A report shows what the run itself endures, not what it endures in another scene.
        if changes.is_empty()
            && let Err(error) = found.write(&args.run)
        {
            say!("note: a report cannot show this table: {error}");
        }
        return Ok(Outcome::Done);
    }
    if let Some((from, to)) = args.components {
        let progress = |row: &Driven| shown.note(&row.to_string());
        let free = Freedom { steps: args.free_steps, actuators: args.free.clone() };
        let found = run.drive(from..=to, &free, episodes, args.seed, workers, progress)?;
        if args.json {
            print_json(&found)?
        } else {
            print(&describe_driven(&found))?
        }
        return Ok(Outcome::Done);
    }
    let found = run.evaluate(episodes, args.seed, workers)?;
    if args.json {
        print_json(&found)?
    } else {
        print(&describe(&found))?
    }
    Ok(Outcome::Done)
}

fn describe(found: &Assessment) -> String {
    let row = |name: &str, successes: u64, episodes: u64, rate: f64, [low, high]: [f64; 2]| {
        let interval = format!("{:.1} to {:.1} %", 100.0 * low, 100.0 * high);
        vec![name.to_owned(), episodes.to_string(), successes.to_string(), percent(rate), interval]
    };
    let heads = ["object", "episodes", "successes", "success", "95 % interval"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    if found.objects.len() > 1 {
        rows.extend(found.objects.iter().map(|o| row(&o.object, o.successes, o.episodes, o.success_rate, o.interval)));
    }
    let name = match found.objects.as_slice() {
        [only] => &only.object,
        _ => "all",
    };
    rows.push(row(name, found.successes, found.episodes, found.success_rate, found.interval));
    let mut text = table(&rows);
    text.push_str(&format!(
        "mean distance from the object to the goal at the end: {:.1} cm",
        100.0 * found.mean_final_distance_m
    ));
    if found.successes > 0 {
        let depth = 1000.0 * found.mean_penetration_m;
        text.push_str(&format!("\nmean penetration between object and hand in successes: {depth:.1} mm"));
        if let Some(depth) = found.mean_self_penetration_m {
            let depth = 1000.0 * depth;
            text.push_str(&format!("\nmean penetration between links of the hand in successes: {depth:.1} mm"));
        }
    }
    text.push('\n');
    if found.diverged > 0 {
        text.push_str(&format!("{} episodes diverged and count as failures\n", found.diverged));
    }
    text
}

fn describe_driven(found: &Drive) -> String {
    let heads = ["numbers", "success", "95 % interval", "random directions", "share of the variance"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    let interval = |[low, high]: [f64; 2]| format!("{:.1} to {:.1} %", 100.0 * low, 100.0 * high);
    for row in &found.rows {
        let name = if row.components == 0 { "0 (constant)".to_owned() } else { row.components.to_string() };
        let random = row.random_success_rate.map_or_else(|| "-".to_owned(), percent);
        rows.push(vec![name, percent(row.success_rate), interval(row.interval), random, percent(row.variance_share)]);
    }
    let all = "all joints".to_owned();
    rows.push(vec![all, percent(found.success_rate), interval(found.interval), "-".to_owned(), percent(1.0)]);
    let mut text = table(&rows);
    match found.k_for_95 {
        Some(1) => text.push_str("one number is within 5 points of all joints\n"),
        Some(k) => text.push_str(&format!("{k} numbers are within 5 points of all joints\n")),
        None => {}
    }
    text
}

fn describe_stress(found: &Stress) -> String {
    let mut rows = vec![["changed", "success", "95 % interval"].map(str::to_owned).to_vec()];
    for row in &found.rows {
        let [low, high] = row.interval;
        let interval = format!("{:.1} to {:.1} %", 100.0 * low, 100.0 * high);
        rows.push(vec![name_of(row), percent(row.success_rate), interval]);
    }
    table(&rows)
}

fn name_of(row: &StressRow) -> String {
    format!("{} {}", row.group, row.change).trim_end().to_owned()
}

fn parse_range(text: &str) -> Result<(usize, usize), String> {
    let number = |part: &str| part.trim().parse::<usize>().map_err(|_| format!("{part:?} is not a whole number"));
    let (from, to) = match text.split_once("..") {
        Some((from, to)) => (number(from)?, number(to.trim_start_matches('='))?),
        None => (number(text)?, number(text)?),
    };
    if from <= to { Ok((from, to)) } else { Err(format!("{from} is greater than {to}")) }
}
