//! `eigenhand render`

use std::path::{Path, PathBuf};

use anyhow::bail;
use eigenhand_files::{create_directory, write_atomically};
use eigenhand_render::{Picture, grasp, postures};
use eigenhand_synergy::SynergyFile;
use eigenhand_train::FinishedRun;
use serde::Serialize;

use crate::output::{Outcome, print, print_json};
use crate::{search_path, setup};

/// Default directory for the pictures, in the run directory.
const DIRECTORY: &str = "pictures";
/// Largest number of episodes to get one successful grasp of an object.
const TRIES: u64 = 20;
/// Number of grasps in one row of the picture.
const COLUMNS: usize = 4;

/// Draws a run's grasps and the components of its synergy
#[derive(clap::Args)]
#[command(
    after_help = "Writes grasps.png with a successful grasp of each object, and components.png with a row for each\n\
    component of the control synergy: the hand at its smallest coefficient, at zero, and at its\n\
    largest coefficient. Needs no display.\n\n\
    Example:\n  eigenhand render runs/shadow-quick-l1-s1-1"
)]
pub struct Args {
    /// Run directory
    run: PathBuf,
    /// Directory for the pictures; older pictures are replaced [default: pictures, in the run directory]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of components to draw, beginning with the first
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u64).range(1..=100))]
    components: u64,
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
    run: &'a Path,
    files: &'a [PathBuf],
    /// Objects without a successful grasp.
    not_grasped: &'a [String],
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let hands = search_path(&args.plugins);
    let run = setup::with_mujoco(&args.install, || FinishedRun::open(&args.run, &hands, &[]))?;
    let out = args.out.clone().unwrap_or_else(|| args.run.join(DIRECTORY));
    let (grasps, not_grasped) = grasps(&run)?;
    let mut pictures = Vec::new();
    if !grasps.is_empty() {
        pictures.push(("grasps.png", Picture::grid(&grasps, COLUMNS)));
    }
    if let Some(synergy) = run.control_synergy()? {
        let rows = sweep(&synergy, args.components as usize);
        pictures.push(("components.png", postures(&run.hand, &run.task, &rows)?));
    }
    if pictures.is_empty() {
        bail!(
            "there is nothing to draw: none of {TRIES} episodes grasped an object, and the run has no synergy; train \
             longer, or see metrics.csv in {}",
            args.run.display()
        );
    }
    create_directory(&out)?;
    let mut files = Vec::new();
    for (name, picture) in pictures {
        let file = out.join(name);
        write_atomically(&file, &picture.png()?)?;
        files.push(file);
    }
    if args.json {
        print_json(&Report { run: &args.run, files: &files, not_grasped: &not_grasped })?;
    } else {
        print(&files.iter().map(|file| format!("{}\n", file.display())).collect::<String>())?;
    }
    if !not_grasped.is_empty() {
        eprintln!(
            "note: these objects are not drawn, because none of {TRIES} episodes grasped them: {}",
            not_grasped.join(", ")
        );
    }
    Ok(Outcome::Done)
}

/// Draws a successful grasp of each object, and names the objects without one.
fn grasps(run: &FinishedRun) -> anyhow::Result<(Vec<Picture>, Vec<String>)> {
    let (mut drawn, mut missing) = (Vec::new(), Vec::new());
    for (index, scene) in run.task.scenes.iter().enumerate() {
        match run.successful_grasp(index, TRIES)? {
            Some(env) => drawn.push(grasp(&run.hand, scene, env.simulation())?),
            None => missing.push(scene.object.name.to_owned()),
        }
    }
    Ok((drawn, missing))
}

/// Returns a row of postures for each of the first components: at its smallest coefficient, at zero, and at its
/// largest.
fn sweep(file: &SynergyFile, components: usize) -> Vec<Vec<Vec<f64>>> {
    let (synergy, Some(map)) = (&file.synergy, &file.joint_map) else { return Vec::new() };
    let ranges = synergy.coefficient_min().iter().zip(synergy.coefficient_max()).enumerate();
    let row = |(i, (low, high)): (usize, (&f64, &f64))| -> Vec<Vec<f64>> {
        let at = |value: f64| {
            let mut z = vec![0.0; synergy.n_components()];
            z[i] = value;
            map.decode(&z)
        };
        [*low, 0.0, *high].map(at).to_vec()
    };
    ranges.take(components).map(row).collect()
}
