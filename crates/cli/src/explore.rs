//! `eigenhand explore`

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use eigenhand_explore::{Recording, Shown, check, page};
use eigenhand_files::write_atomically;
use eigenhand_mujoco::MuJoCo;
use eigenhand_sim::{GraspEnv, GraspTask};
use eigenhand_synergy::{Space, SynergyFile};
use eigenhand_train::config::RunConfig;
use eigenhand_train::{FinishedRun, hand_named, is_run};
use serde::Serialize;

use crate::output::{Outcome, print, print_json};
use crate::synergy::{Source, SpaceName};
use crate::{program, search_path, setup};

/// Default name of the page, in the run directory or else in the working directory.
const PAGE: &str = "explore.html";
/// Control steps from one frame of a recorded episode to the next.
const FRAME_STEPS: usize = 2;
/// Largest number of episodes to record one that succeeds.
const TRIES: u64 = 5;

/// Writes a page in which sliders move the hand along its synergy
#[derive(clap::Args)]
#[command(
    after_help = "The page needs no network and no server: it is one file that any browser opens. It shows the hand in 3D,\n\
                        a slider for each number, the mean grasps of a run, recorded episodes with their objects, and the joint\n\
                        angles and commands to copy.\n\n\
                        Examples:\n  eigenhand explore runs/shadow-quick-l1-s1-1\n  \
                        eigenhand explore runs/shadow-default-l1-s1-1 --beside runs/shadow-default-l1-s2-1\n  \
                        eigenhand explore --synergy shadow --out shadow.html"
)]
pub struct Args {
    /// Run directory; without one, --synergy
    #[arg(required_unless_present = "synergy", conflicts_with = "synergy")]
    run: Option<PathBuf>,
    /// A synergy without a run: an export, a directory with synergy.toml, such a file, or a ready synergy (`synergy list`)
    #[arg(long, value_name = "SOURCE")]
    synergy: Option<PathBuf>,
    /// Hand of --synergy, by name or directory [default: the hand that the synergy names]
    #[arg(long, value_name = "NAME", requires = "synergy")]
    hand: Option<String>,
    /// Another synergy of the same hand, which moves a second hand with the same sliders: a run, an export, or a synergy.toml
    #[arg(long, value_name = "SOURCE")]
    beside: Option<PathBuf>,
    /// Which synergy of a run [default: commands]
    #[arg(long, value_enum)]
    space: Option<SpaceName>,
    /// The page; an older one is replaced [default: explore.html, in the run directory if there is one]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Does not open the page in a browser
    #[arg(long)]
    no_open: bool,
    /// Additional directory of hands; can be given several times
    #[arg(long, value_name = "DIR")]
    plugins: Vec<PathBuf>,
    /// Prints one JSON document on standard output, and opens nothing
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    install: setup::InstallArgs,
}

#[derive(Serialize)]
struct Report<'a> {
    page: &'a PathBuf,
    bytes: usize,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let hands = search_path(&args.plugins);
    let beside = args.beside.as_ref().map(|path| Source::read(path, args.space)).transpose()?;
    // Two synergies of a hand differ in where they are from.
    let title = |path: &Path, source: &Source| match args.beside {
        Some(_) => format!("{}: {}", path.display(), source.title()),
        None => source.title(),
    };
    let beside_title = args.beside.as_deref().zip(beside.as_ref()).map(|(path, source)| title(path, source));
    let beside_title = beside_title.unwrap_or_default();
    let beside = beside.as_ref().map(|source| Shown { file: &source.file, title: &beside_title });
    let (text, out) = match (&args.run, &args.synergy) {
        (Some(run), _) => {
            if !is_run(run) {
                bail!("{} is no run directory; for a synergy without a run, use --synergy", run.display());
            }
            let source = Source::read(run, args.space)?;
            let finished = setup::with_mujoco(&args.install, || FinishedRun::open(run, &hands, &[]))?;
            check(&finished.hand, &source.file, beside.map(|shown| shown.file))?;
            let recordings = recordings(&finished, &source.file, beside.map(|shown| shown.file))?;
            let shown = Shown { file: &source.file, title: &title(run, &source) };
            (page(&finished.hand, &finished.task, shown, beside, &recordings)?, run.join(PAGE))
        }
        (None, Some(path)) => {
            let source = Source::read(path, args.space)?;
            let hand = hand_named(args.hand.as_ref().unwrap_or(&source.file.hand), &hands)
                .context("the page needs the synergy's hand; --hand takes its name or its directory")?;
            let mujoco = setup::with_mujoco(&args.install, MuJoCo::load)?;
            let task = GraspTask::new(&mujoco, &hand, &RunConfig::default_preset()?.setting())?;
            let shown = Shown { file: &source.file, title: &title(path, &source) };
            (page(&hand, &task, shown, beside, &[])?, PathBuf::from(PAGE))
        }
        (None, None) => bail!("expected a run directory or --synergy"),
    };
    let out = args.out.clone().unwrap_or(out);
    if out.is_dir() {
        bail!("{} is a directory: give the page's file, such as {}", out.display(), out.join(PAGE).display());
    }
    write_atomically(&out, text.as_bytes())?;
    if args.json {
        print_json(&Report { page: &out, bytes: text.len() })?;
        return Ok(Outcome::Done);
    }
    let next = args.run.as_ref().map_or_else(String::new, |run| {
        let export = format!("export {}{} --out my-hand", program::path(run), program::plugins(&args.plugins));
        format!("next: {}\n", program::line(&export))
    });
    print(&format!("{} ({:.1} MB)\n{next}", out.display(), text.len() as f64 / 1e6))?;
    if !args.no_open && std::io::stdout().is_terminal() && has_display() {
        open::that_detached(&out).with_context(|| format!("no browser opened; open {} yourself", out.display()))?;
    }
    Ok(Outcome::Done)
}

/// Records an episode with each object, a successful one if one of the first does.
fn recordings(run: &FinishedRun, file: &SynergyFile, beside: Option<&SynergyFile>) -> anyhow::Result<Vec<Recording>> {
    let nearest = |file: &SynergyFile, env: &GraspEnv| -> Vec<f64> {
        let position = |name: &String| run.task.actuators.iter().position(|actuator| actuator == name);
        let mut values = vec![0.0; run.task.posture_joints.len()];
        if file.space == Space::Commands {
            let driven = file.synergy.joints().iter().filter_map(|joint| position(&joint.name));
            values = driven.map(|i| env.simulation().ctrl()[i]).collect();
        } else {
            env.posture(&mut values);
        }
        file.synergy.encode(&values)
    };
    let period = run.task.physics.control_period() * FRAME_STEPS as f64;
    let mut found = Vec::new();
    for (index, scene) in run.task.scenes.iter().enumerate() {
        let mut last = None;
        for episode in 0..TRIES {
            let (mut recording, mut step): (Option<Recording>, usize) = (None, 0);
            let mut add = |env: &GraspEnv| -> anyhow::Result<()> {
                if step % FRAME_STEPS == 0 || step == run.task.config.steps {
                    let recording = match &mut recording {
                        Some(recording) => recording,
                        None => recording.insert(Recording::begin(&run.hand, scene, env, period)?),
                    };
                    let second = beside.map(|file| nearest(file, env)).unwrap_or_default();
                    recording.add(env, nearest(file, env), second);
                }
                step += 1;
                Ok(())
            };
            let mut outcome = Ok(());
            let success = run.watch(index, run.config.seed, episode, |env| {
                if outcome.is_ok() {
                    outcome = add(env);
                }
            })?;
            outcome?;
            last = recording;
            if let Some(recording) = &mut last {
                recording.end(success);
            }
            if success {
                break;
            }
        }
        found.extend(last);
    }
    Ok(found)
}

fn has_display() -> bool {
    cfg!(target_os = "macos") || ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some())
}
