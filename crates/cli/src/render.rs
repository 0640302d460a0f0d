//! `eigenhand render`

use std::path::{Path, PathBuf};

use anyhow::bail;
use eigenhand_files::{create_directory, write_atomically};
use eigenhand_render::{Film, Picture, View, grasp, postures};
use eigenhand_synergy::{Moment, SynergyFile};
use eigenhand_train::{FinishedRun, PICTURES, say};
use serde::Serialize;

use crate::numbers::{LARGEST, whole};
use crate::output::{Outcome, percent, print, print_json};
use crate::{program, search_path, setup};

/// Name of the small picture.
pub const OVERVIEW: &str = "overview.png";
/// Largest number of episodes to get one successful grasp of an object.
const TRIES: u64 = 20;
/// Number of grasps in one row of the picture.
const COLUMNS: usize = 4;
/// The coefficients of a component that are drawn.
const SWEEP: [&str; 3] = ["least", "zero", "greatest"];
/// Control steps from one frame of an episode to the next.
const FRAME_STEPS: usize = 3;
/// Seconds for which the last frame of an episode is shown.
const LAST_FRAME: f64 = 1.5;

/// Draws a run's grasps, the components of its synergy, and an episode
#[derive(clap::Args)]
#[command(after_help = "Writes into RUN/pictures, and needs no display:\n\n\
    grasps.png      a successful grasp of each object, from two sides\n\
    components.png  a row for each number of the control synergy, from its least to its greatest value\n\
    motion.png      the hand along the numbers of the mean grasp of an object\n\
    episode.gif     an episode of the policy with this object, marked as a success or a failure\n\
    overview.png    a grasp and the hand at both ends of the first two numbers, small\n\n\
    `train` draws them at its end.\n\n\
    Examples:\n  eigenhand render runs/shadow-quick-l1-s1-1\n  \
    eigenhand render runs/shadow-default-l1-s1-1 --object disc --seed 7 --components 2")]
pub struct Args {
    /// Run directory
    run: PathBuf,
    /// Directory for the pictures; older pictures are replaced [default: pictures, in the run directory]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of components to draw, beginning with the first [default: all]
    #[arg(long, value_name = "N", value_parser = whole::<u64>(1..=100))]
    components: Option<u64>,
    /// Object of motion.png and episode.gif [default: the first of the run's]
    #[arg(long, value_name = "NAME")]
    object: Option<String>,
    /// Seed of the episode [default: the run's]
    #[arg(long, value_name = "N", value_parser = whole::<u64>(0..=LARGEST))]
    seed: Option<u64>,
    /// Additional directory of hands; can be given several times
    #[arg(long, value_name = "DIR")]
    plugins: Vec<PathBuf>,
    /// Prints one JSON document on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    install: setup::InstallArgs,
}

/// What to draw of a run.
#[derive(Default)]
pub struct Wanted<'a> {
    /// Directory of the pictures; absent, it is the run's.
    pub out: Option<&'a Path>,
    /// How many components.
    pub components: Option<usize>,
    /// Object of the motion and of the episode.
    pub object: Option<&'a str>,
    /// Seed of the episode.
    pub seed: Option<u64>,
}

/// What was drawn of a run.
#[derive(Serialize)]
pub struct Drawn {
    run: PathBuf,
    /// The pictures.
    pub files: Vec<PathBuf>,
    /// Objects without a successful grasp.
    pub not_grasped: Vec<String>,
    /// Whether the episode succeeded.
    episode_success: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let hands = search_path(&args.plugins);
    let run = setup::with_mujoco(&args.install, || FinishedRun::open(&args.run, &hands, &[]))?;
    let wanted = Wanted {
        out: args.out.as_deref(),
        components: args.components.map(|k| k as usize),
        object: args.object.as_deref(),
        seed: args.seed,
    };
    let drawn = draw(&run, &wanted)?;
    if args.json {
        print_json(&drawn)?;
    } else {
        let next = program::line(&format!("explore {}", program::path(&args.run)));
        let files: String = drawn.files.iter().map(|file| format!("{}\n", file.display())).collect();
        print(&format!("{files}next: {next}\n"))?;
    }
    if !drawn.not_grasped.is_empty() {
        say!(
            "note: these objects are not drawn, because none of {TRIES} episodes grasped them: {}",
            drawn.not_grasped.join(", ")
        );
    }
    Ok(Outcome::Done)
}

/// Draws a run.
///
/// # Errors
/// An object that the run does not have, an episode that diverges, or a file that cannot be written.
pub fn draw(run: &FinishedRun, wanted: &Wanted) -> anyhow::Result<Drawn> {
    let names: Vec<&str> = run.task.scenes.iter().map(|scene| scene.object.name.as_str()).collect();
    let scene = match wanted.object {
        None => 0,
        Some(object) => match names.iter().position(|name| *name == object) {
            Some(scene) => scene,
            None => bail!("the run has no object {object}; it has {}", names.join(", ")),
        },
    };
    let synergy = run.control_synergy()?;
    let n = synergy.as_ref().map_or(0, |synergy| synergy.synergy.n_components());
    let k = wanted.components.unwrap_or(n);
    if k > n {
        bail!("--components {k}: the run's synergy has {n} components");
    }
    let (grasps, not_grasped) = grasps(run)?;
    let mut pictures: Vec<(&str, Vec<u8>)> = Vec::new();
    if !grasps.is_empty() {
        // A cell shows one grasp, one view above the other.
        let cells: Vec<Picture> = grasps.iter().map(|views| Picture::grid(views, 1)).collect();
        pictures.push(("grasps.png", Picture::grid(&cells, COLUMNS).png()?));
    }
    if let Some(synergy) = synergy {
        let tiles = postures(&run.hand, &run.task, &sweep(&synergy, k), View::Palm)?;
        let labelled: Vec<Picture> =
            tiles.iter().zip(sweep_labels(&synergy)).map(|(tile, label)| tile.clone().labelled(&label)).collect();
        pictures.push(("components.png", Picture::grid(&labelled, SWEEP.len()).png()?));
        if !grasps.is_empty() {
            let sides: Vec<Picture> = grasps.iter().map(|[side, _]| side.clone()).collect();
            pictures.push((OVERVIEW, overview(&sides, &labelled[..labelled.len().min(2 * SWEEP.len())]).png()?));
        }
        let motion = motion(&synergy, names[scene]);
        if !motion.is_empty() {
            let (labels, along): (Vec<String>, Vec<Vec<f64>>) = motion.into_iter().unzip();
            let tiles = postures(&run.hand, &run.task, &along, View::Side)?;
            let tiles: Vec<Picture> =
                tiles.into_iter().zip(labels).map(|(tile, label)| tile.labelled(&label)).collect();
            pictures.push(("motion.png", Picture::grid(&tiles, tiles.len()).png()?));
        }
    }
    if pictures.is_empty() {
        bail!(
            "there is nothing to draw: none of {TRIES} episodes grasped an object, and the run has no synergy; train \
             longer, or see metrics.csv in {}",
            run.directory.display()
        );
    }
    let (frames, episode_success) = episode(run, scene, wanted.seed.unwrap_or(run.config.seed))?;
    // Of an episode that diverges there is nothing to see.
    if !frames.is_empty() {
        pictures.push(("episode.gif", Picture::gif(&frames)?));
    }
    let out = wanted.out.map_or_else(|| run.directory.join(PICTURES), Path::to_path_buf);
    create_directory(&out)?;
    let mut files = Vec::new();
    for (name, bytes) in pictures {
        let file = out.join(name);
        write_atomically(&file, &bytes)?;
        files.push(file);
    }
    Ok(Drawn { run: run.directory.clone(), files, not_grasped, episode_success })
}

/// Draws a successful grasp of each object, and names the objects without one.
fn grasps(run: &FinishedRun) -> anyhow::Result<(Vec<[Picture; 2]>, Vec<String>)> {
    let (mut drawn, mut missing) = (Vec::new(), Vec::new());
    for (index, scene) in run.task.scenes.iter().enumerate() {
        match run.successful_grasp(index, TRIES)? {
            Some(env) => {
                let [side, other] = grasp(&run.hand, scene, env.simulation())?;
                let name = &scene.object.name;
                drawn.push([side.labelled(name), other.labelled(&format!("{name}, other side"))]);
            }
            None => missing.push(scene.object.name.to_owned()),
        }
    }
    Ok((drawn, missing))
}

/// Draws an episode frame by frame, each with the seconds for which it is shown, and tells whether it succeeded. An episode that
/// diverges has no frames.
fn episode(run: &FinishedRun, scene: usize, seed: u64) -> anyhow::Result<(Vec<(Picture, f64)>, bool)> {
    let drawn_scene = &run.task.scenes[scene];
    let (mut film, mut wrong) = (Film::default(), Ok(()));
    let success = run.watch(scene, seed, 0, |env| {
        if wrong.is_ok() {
            wrong = film.include(&run.hand, drawn_scene, env.simulation());
        }
    })?;
    wrong?;
    let (name, period) = (&drawn_scene.object.name, run.task.physics.control_period());
    let (mut frames, mut step) = (Vec::new(), 0);
    let last = run.task.config.steps;
    run.watch(scene, seed, 0, |env| {
        if step % FRAME_STEPS == 0 || step == last {
            let picture = film.frame(env.simulation());
            let (label, shown) = if step == last {
                (format!("{name}: {}", if success { "success" } else { "failure" }), LAST_FRAME)
            } else {
                (format!("{name}, {:.1} s", period * step as f64), period * FRAME_STEPS as f64)
            };
            frames.push((picture.labelled(&label), shown));
        }
        step += 1;
    })?;
    Ok((frames, success))
}

/// Returns labels and postures along the mean grasp of an object with all numbers, or of the first object that has one.
fn motion(file: &SynergyFile, object: &str) -> Vec<(String, Vec<f64>)> {
    let k = file.synergy.n_components();
    let mut grasps = file.grasps.iter().filter(|grasp| grasp.numbers == k);
    let first = grasps.clone().next();
    let (Some(map), Some(grasp)) = (&file.joint_map, grasps.find(|grasp| grasp.object == object).or(first)) else {
        return Vec::new();
    };
    let half = |a: &Moment, b: &Moment| -> Vec<f64> { a.z.iter().zip(&b.z).map(|(a, b)| (a + b) / 2.0).collect() };
    let moments = [
        (format!("{}, open", grasp.object), grasp.open.z.clone()),
        ("half closed".to_owned(), half(&grasp.open, &grasp.closed)),
        ("closed".to_owned(), grasp.closed.z.clone()),
        ("half lifted".to_owned(), half(&grasp.closed, &grasp.held)),
        ("held".to_owned(), grasp.held.z.clone()),
    ];
    let shown = |(name, z): (String, Vec<f64>)| {
        // A zero is added, so that none is written as -0.0.
        let numbers = z.iter().map(|number| format!("{:+.1}", (10.0 * number).round() / 10.0 + 0.0));
        let numbers = numbers.collect::<Vec<_>>().join(" ");
        (format!("{name}: z = {numbers}"), map.decode(&z))
    };
    moments.map(shown).into()
}

/// Puts a grasp and the hand at both ends of a component into each row.
fn overview(grasps: &[Picture], sweep: &[Picture]) -> Picture {
    let mut tiles = Vec::new();
    for (i, component) in sweep.chunks_exact(SWEEP.len()).enumerate() {
        tiles.push(grasps[i * grasps.len().div_ceil(2) % grasps.len()].clone());
        tiles.extend([component[0].clone(), component[SWEEP.len() - 1].clone()]);
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

/// Returns the labels of [`sweep`].
fn sweep_labels(file: &SynergyFile) -> impl Iterator<Item = String> + '_ {
    let ranges = file.synergy.coefficient_min().iter().zip(file.synergy.coefficient_max()).enumerate();
    ranges.flat_map(|(i, (low, high))| {
        let share = percent(file.synergy.contribution()[i]);
        let label = move |(z, name)| match name {
            name if name == SWEEP[0] => format!("number {} ({share} of the variance), {name}: {z:+.2}", i + 1),
            name => format!("number {}, {name}: {z:+.2}", i + 1),
        };
        [*low, 0.0, *high].into_iter().zip(SWEEP).map(label)
    })
}

#[cfg(test)]
mod tests {
    use eigenhand_synergy::{JointInfo, JointMap, NamedGrasp, Synergy, Unit};

    use super::*;

    #[test]
    fn a_motion_goes_along_the_grasp_of_the_object_with_all_numbers() {
        let joint = |name: &str| JointInfo { name: name.to_owned(), unit: Unit::Radian, lower: -9.0, upper: 9.0 };
        let joints = ["a", "b"].map(joint);
        let commands = [[3.0, 0.0], [-3.0, 0.0], [0.0, 2.0], [0.0, -2.0]];
        let synergy = Synergy::fit(&joints, &commands, 2).unwrap();
        let joint_map = JointMap::fit(&synergy, &commands, &joints, &commands).unwrap();
        let moment = |z: &[f64]| Moment { z: z.to_vec(), q: vec![0.0; 2] };
        let grasp = |object: &str, first: f64, k: usize| NamedGrasp {
            object: object.to_owned(),
            numbers: k,
            motions: 1,
            open: moment(&[first, 0.04][..k]),
            closed: moment(&[first + 1.0, -0.04][..k]),
            held: moment(&[first + 2.0, 0.0][..k]),
        };
        let file = SynergyFile {
            hand: "h".to_owned(),
            space: eigenhand_synergy::Space::Commands,
            synergy,
            joint_map: Some(joint_map),
            actuation: None,
            recommended: None,
            grasps: vec![grasp("disc", 7.0, 1), grasp("cube", -1.0, 2), grasp("disc", 0.5, 2)],
            provenance: Default::default(),
        };
        let shown = motion(&file, "disc");
        let labels: Vec<&str> = shown.iter().map(|(label, _)| label.as_str()).collect();
        let expected = ["disc, open: z = +0.5 +0.0", "half closed: z = +1.0 +0.0", "closed: z = +1.5 +0.0"];
        assert_eq!(labels[..3], expected);
        assert_eq!(labels[3..], ["half lifted: z = +2.0 +0.0", "held: z = +2.5 +0.0"]);
        assert!((shown[1].1[0].abs() - 1.0).abs() < 1e-6, "the posture follows the numbers: {shown:?}");
        assert!(motion(&file, "moon")[0].0.starts_with("cube, open"), "the first object that has a grasp");
        let labels: Vec<String> = sweep_labels(&file).collect();
        assert_eq!(labels.len(), 2 * SWEEP.len());
        assert_eq!(labels[2], "number 1, greatest: +3.00");
    }

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
