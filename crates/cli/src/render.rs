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
/// The coefficients of a component that are drawn.
const SWEEP: [&str; 3] = ["least", "zero", "greatest"];

/// Draws a run's grasps and the components of its synergy
#[derive(clap::Args)]
#[command(
    after_help = "Writes grasps.png with a successful grasp of each object, components.png with a row for each\n\
    component of the control synergy: the hand at its smallest coefficient, at zero, and at its\n\
    largest coefficient, and overview.png with a grasp and the hand at both ends of these components.\n\
    Needs no display.\n\n\
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
        let tiles = postures(&run.hand, &run.task, &sweep(&synergy, args.components as usize))?;
        pictures.push(("components.png", Picture::grid(&tiles, SWEEP.len())));
        if !grasps.is_empty() {
            pictures.push(("overview.png", overview(&grasps, &tiles)));
        }
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

/// Puts a grasp and the hand at both ends of a component into each row.
fn overview(grasps: &[Picture], sweep: &[Picture]) -> Picture {
    let mut tiles = Vec::new();
    for (i, component) in sweep.chunks_exact(SWEEP.len()).enumerate() {
        tiles.push(grasps[i * grasps.len().div_ceil(2) % grasps.len()].clone());
        for end in [0, SWEEP.len() - 1] {
            tiles.push(component[end].clone().labelled(&format!("component {}, {}", i + 1, SWEEP[end])));
        }
    }
    Picture::grid(&tiles, 3)
}

/// Returns postures for each of the first components: at its smallest coefficient, at zero, and at its largest.
fn sweep(file: &SynergyFile, components: usize) -> Vec<Vec<f64>> {
    let (synergy, Some(map)) = (&file.synergy, &file.joint_map) else { return Vec::new() };
    let ranges = synergy.coefficient_min().iter().zip(synergy.coefficient_max()).enumerate();
    let row = |(i, (low, high)): (usize, (&f64, &f64))| -> [Vec<f64>; SWEEP.len()] {
        let at = |value: f64| {
            let mut z = vec![0.0; synergy.n_components()];
            z[i] = value;
            map.decode(&z)
        };
        [*low, 0.0, *high].map(at)
    };
    ranges.take(components).flat_map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tile of one colour, as wide as a label needs.
    fn tile(colour: u8) -> Picture {
        Picture { width: 300, height: 40, rgb: vec![colour; 3 * 300 * 40] }
    }

    #[test]
    fn an_overview_has_a_grasp_and_both_ends_of_a_component_in_each_row() {
        let (grasps, sweep) = ([1, 2, 3].map(tile), [10, 20, 30, 40, 50, 60].map(tile));
        let shown = overview(&grasps, &sweep);
        let colour = |column: usize, row: usize| shown.pixel(column * 304 + 299, row * 44).map(|pixel| pixel[0]);
        let rows = [0, 1].map(|row| [0, 1, 2].map(|column| colour(column, row).unwrap_or_default()));
        assert_eq!(rows, [[1, 10, 30], [3, 40, 60]]);
        assert_eq!((shown.width, shown.height), (3 * 304 - 4, 2 * 44 - 4));
        assert_eq!(overview(&grasps[..1], &sweep).pixel(299, 44), Some([1; 3]), "the only grasp is shown twice");
    }
}
