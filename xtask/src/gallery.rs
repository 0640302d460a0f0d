//! `cargo xtask gallery`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail};
use eigenhand_cli::output::Outcome;
use eigenhand_cli::{INTERRUPTED, on_stop, say, search_path};
use eigenhand_files::{create_directory, write_atomically};
use eigenhand_hands::Registry;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Directory with a directory for each hand, and the files in it.
const SYNERGIES: &str = "synergies";
const SYNERGY: &str = "synergy.toml";
const TRAINING: &str = "training.toml";
/// The page, the directory of its pictures as it names them, and the picture that `render` makes.
const PAGE: &str = "docs/gallery.md";
const PICTURES: &str = "pictures/gallery";
const PICTURE: &str = "overview.png";
/// Numbers of components that have a column.
const COLUMNS: [usize; 4] = [5, 2, 1, 0];

/// Trains hands, and keeps their synergies and pictures in this repository (synergies, docs/gallery.md)
#[derive(clap::Args)]
#[command(
    after_help = "A hand takes about half an hour on two cores. A finished run below --runs is used as it is, and one that was\n\
    stopped goes on, so the same command continues after Ctrl-C. Rows of other hands stay.\n\n\
    Examples:\n  cargo xtask gallery\n  cargo xtask gallery --hand shadow\n  \
    cargo xtask gallery --from allegro=../mujoco_menagerie/wonik_allegro/right_hand.xml"
)]
pub struct Args {
    /// Name of a hand, or its directory; can be given several times [default: every hand of this repository]
    #[arg(long = "hand", value_name = "NAME|PATH")]
    hands: Vec<String>,
    /// Model file of a hand (MJCF or URDF), from which `hands new` makes it; can be given several times
    #[arg(long, value_name = "NAME=FILE", value_parser = named_file)]
    from: Vec<(String, PathBuf)>,
    /// Directory of the runs
    #[arg(long, value_name = "DIR", default_value = "runs/gallery")]
    runs: PathBuf,
    /// Training episodes of each hand
    #[arg(long, value_name = "N", default_value_t = 4000)]
    episodes: u64,
    /// Threads of each training [default: every core]
    #[arg(long, value_name = "N")]
    workers: Option<usize>,
}

/// What the page says of a hand.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Entry {
    hand: String,
    description: String,
    /// Name of the maker's model file; none for a hand of this repository.
    #[serde(skip_serializing_if = "Option::is_none")]
    file: Option<String>,
    licence: String,
    fingers: usize,
    joints: usize,
    actuators: usize,
    /// SHA-256 over the hand's files.
    hand_digest: String,
    revision: String,
    platform: String,
    mujoco: String,
    seed: u64,
    episodes: u64,
    eval_episodes: u64,
    /// Shares of the evaluated episodes: with all joints, and with 0, 1, 2... numbers.
    success: f64,
    success_with_components: Vec<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    recommended_components: Option<usize>,
}

/// What `hands show --json` says of a hand.
#[derive(Deserialize)]
struct About {
    name: String,
    description: String,
    licence: String,
    n_fingers: usize,
    n_joints: usize,
    n_actuators: usize,
}

/// What a finished run says in `summary.json`.
#[derive(Deserialize)]
struct Results {
    seed: u64,
    episodes: u64,
    eval_episodes: u64,
    success_rate: Option<f64>,
    success_with_components: Vec<f64>,
}

/// What a run says in `provenance.toml`.
#[derive(Deserialize)]
struct Origin {
    hand_digest: String,
    git_revision: String,
    platform: String,
    mujoco_version: String,
}

/// What a synergy says of itself.
#[derive(Deserialize)]
struct Header {
    hand: String,
    recommended_components: Option<usize>,
}

fn named_file(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, file)) if !name.is_empty() && !file.is_empty() => Ok((name.into(), file.into())),
        _ => Err("expected NAME=FILE, such as allegro=../allegro/right_hand.xml".to_owned()),
    }
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    // Ctrl-C reaches the command that is running too; that one saves, and says how it ended.
    on_stop(|| {})?;
    let root = Path::new(".");
    if !root.join(SYNERGIES).is_dir() || !root.join("docs").is_dir() {
        bail!("there is no directory {SYNERGIES} here: run this in a checkout of the repository");
    }
    let mut hands: Vec<(String, Option<&Path>)> = args.hands.iter().map(|hand| (hand.clone(), None)).collect();
    for (name, file) in &args.from {
        let directory = args.runs.join("hands").join(name);
        if !directory.is_dir() {
            let made = ["hands", "new", name, "--from", &path(file), "--out", &path(&directory)].map(str::to_owned);
            if !step(&made)? {
                return Ok(Outcome::Interrupted);
            }
        }
        hands.push((path(&directory), Some(file)));
    }
    if hands.is_empty() {
        let registry = Registry::discover(&search_path(&[]))?;
        hands = registry.list().iter().map(|entry| (entry.name.clone(), None)).collect();
    }
    for (hand, file) in hands {
        if !add(root, args, &hand, file)? {
            return Ok(Outcome::Interrupted);
        }
        // A later hand that fails costs no earlier one its row.
        write_atomically(&root.join(PAGE), page(&entries(&root.join(SYNERGIES))?).as_bytes())?;
    }
    Ok(Outcome::Done)
}

/// Trains a hand if its run is not finished, and keeps its synergy, its picture and its figures. Returns false if the
/// training was interrupted.
fn add(root: &Path, args: &Args, hand: &str, file: Option<&Path>) -> anyhow::Result<bool> {
    let about = about(hand)?;
    let name = &about.name;
    let run = args.runs.join(name);
    if results(&run)?.is_none() {
        let mut command = if run.is_dir() {
            vec!["train".to_owned(), "--resume".to_owned(), path(&run)]
        } else {
            let episodes = args.episodes.to_string();
            ["train", "--hand", hand, "--episodes", &episodes, "--out", &path(&run)].map(str::to_owned).to_vec()
        };
        command.extend(args.workers.iter().flat_map(|n| ["--workers".to_owned(), n.to_string()]));
        if !step(&command)? {
            return Ok(false);
        }
    }
    let Some((results, success)) = results(&run)? else {
        bail!("{} has no evaluation: see its log.txt", run.display());
    };
    let pictures = tempfile::tempdir().context("cannot make a temporary directory")?;
    if !step(&["render", &path(&run), "--out", &path(pictures.path())].map(str::to_owned))? {
        return Ok(false);
    }
    // An export is of this version, whichever trained the run.
    let export = pictures.path().join("export");
    if !step(&["export", &path(&run), "--out", &path(&export)].map(str::to_owned))? {
        return Ok(false);
    }
    let synergy = export.join("synergy").join(SYNERGY);
    if !synergy.is_file() {
        bail!("{} has no synergy: its policy succeeds too seldom ({:.1} %)", run.display(), 100.0 * success);
    }
    let (header, origin): (Header, Origin) = (read_toml(&synergy)?, read_toml(&run.join("provenance.toml"))?);
    if header.hand != *name {
        bail!("{} is a run of the hand {}", run.display(), header.hand);
    }
    let entry = Entry {
        hand: name.clone(),
        description: about.description,
        file: file.and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned()),
        licence: about.licence,
        fingers: about.n_fingers,
        // The slide stands for the arm.
        joints: about.n_joints.saturating_sub(1),
        actuators: about.n_actuators.saturating_sub(1),
        hand_digest: origin.hand_digest,
        revision: origin.git_revision,
        platform: origin.platform,
        mujoco: origin.mujoco_version,
        seed: results.seed,
        episodes: results.episodes,
        eval_episodes: results.eval_episodes,
        success,
        success_with_components: results.success_with_components,
        recommended_components: header.recommended_components,
    };
    let picture = pictures.path().join(PICTURE);
    if !picture.is_file() {
        bail!("{} has no picture: none of the episodes that `render` tried grasped an object", run.display());
    }
    let (directory, shown) = (root.join(SYNERGIES).join(name), root.join("docs").join(PICTURES));
    create_directory(&directory)?;
    create_directory(&shown)?;
    copy(&synergy, &directory.join(SYNERGY))?;
    copy(&picture, &shown.join(format!("{name}.png")))?;
    write_atomically(&directory.join(TRAINING), toml::to_string(&entry)?.as_bytes())?;
    say!("gallery: {name} is in {}", directory.display());
    Ok(true)
}

/// Reads a run's results and its success. None if it does not exist, or was stopped before its evaluation.
fn results(run: &Path) -> anyhow::Result<Option<(Results, f64)>> {
    let file = run.join("summary.json");
    if !file.is_file() {
        return Ok(None);
    }
    let results: Results =
        serde_json::from_str(&text_of(&file)?).with_context(|| format!("cannot read {}", file.display()))?;
    Ok(results.success_rate.map(|success| (results, success)))
}

/// Runs a command of this program. Returns false if it was interrupted.
fn step(arguments: &[String]) -> anyhow::Result<bool> {
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    say!("gallery: {}", arguments.join(" "));
    let status = Command::new(program).args(arguments).status().context("cannot run this program again")?;
    match status.code() {
        Some(0) => Ok(true),
        Some(code) if code == i32::from(INTERRUPTED) => Ok(false),
        _ => bail!("{} failed ({status})", arguments.join(" ")),
    }
}

fn about(hand: &str) -> anyhow::Result<About> {
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    let shown = Command::new(program)
        .args(["hands", "show", hand, "--json"])
        .stderr(std::process::Stdio::inherit())
        .output()
        .context("cannot run this program again")?;
    if !shown.status.success() {
        bail!("hands show {hand} failed ({})", shown.status);
    }
    Ok(serde_json::from_slice(&shown.stdout)?)
}

fn text_of(file: &Path) -> anyhow::Result<String> {
    std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))
}

fn read_toml<T: DeserializeOwned>(file: &Path) -> anyhow::Result<T> {
    toml::from_str(&text_of(file)?).with_context(|| format!("cannot read {}", file.display()))
}

fn path(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

fn copy(from: &Path, to: &Path) -> anyhow::Result<()> {
    let bytes = std::fs::read(from).with_context(|| format!("cannot read {}", from.display()))?;
    Ok(write_atomically(to, &bytes)?)
}

/// Reads what is known of the hands, in the order of their names.
fn entries(synergies: &Path) -> anyhow::Result<Vec<Entry>> {
    let mut found = Vec::new();
    for directory in std::fs::read_dir(synergies).with_context(|| format!("cannot read {}", synergies.display()))? {
        let file = directory?.path().join(TRAINING);
        if file.is_file() {
            found.push(read_toml::<Entry>(&file)?);
        }
    }
    found.sort_by(|a, b| a.hand.cmp(&b.hand));
    Ok(found)
}

/// Writes the page in Markdown.
fn page(entries: &[Entry]) -> String {
    let percent = |rate: Option<&f64>| rate.map_or_else(|| "-".to_owned(), |rate| format!("{:.1} %", 100.0 * rate));
    let mut text = "# Gallery\n\n\
        Hands that were trained with the default settings, and the control synergy of each, ready to use: \
        `synergies/<hand>/synergy.toml` ([how](README.md)).\nEach hand was trained once, with one seed. `cargo xtask \
        gallery` makes this page again; `--hand NAME` renews one hand.\n\n\
        Success is that of new episodes: with all joints, and with so many numbers, which command the hand from the first \
        step on.\nWith 0, the command is constant.\n\n\
        | hand | fingers | actuators | all joints |"
        .to_owned();
    COLUMNS.iter().for_each(|k| _ = write!(text, " {k} |"));
    text.push_str(" recommended | episodes | revision |\n|---|---|---|---|");
    COLUMNS.iter().for_each(|_| text.push_str("---|"));
    text.push_str("---|---|---|\n");
    for entry in entries {
        let _ = write!(text, "| [{0}](#{0}) | {1} | {2} | ", entry.hand, entry.fingers, entry.actuators);
        let _ = write!(text, "{} |", percent(Some(&entry.success)));
        for k in COLUMNS {
            let _ = write!(text, " {} |", percent(entry.success_with_components.get(k)));
        }
        let recommended = entry.recommended_components.map_or_else(|| "-".to_owned(), |k| k.to_string());
        let revision: String = entry.revision.chars().take(7).collect();
        let _ = writeln!(text, " {recommended} | {} | {revision} |", entry.episodes);
    }
    for entry in entries {
        let name = &entry.hand;
        let _ = write!(
            text,
            "\n## {name}\n\n![{name}: a grasp, and the hand at both ends of the first two components]({PICTURES}/{name}.png)\n\n\
             {}. {} joints; licence {}.\n[synergy.toml](../{SYNERGIES}/{name}/{SYNERGY}), \
             [{TRAINING}](../{SYNERGIES}/{name}/{TRAINING}).",
            entry.description.trim_end_matches('.'),
            entry.joints,
            entry.licence
        );
        match &entry.file {
            Some(file) => _ = writeln!(text, " Made from `{file}`, not edited, by `hands new`."),
            None => text.push('\n'),
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_the_one_of_the_synergies() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let entries = entries(&root.join(SYNERGIES)).unwrap();
        assert!(!entries.is_empty());
        assert_eq!(std::fs::read_to_string(root.join(PAGE)).unwrap(), page(&entries));
        for entry in &entries {
            assert!(root.join("docs").join(PICTURES).join(format!("{}.png", entry.hand)).is_file(), "{}", entry.hand);
            let synergy: Header = read_toml(&root.join(SYNERGIES).join(&entry.hand).join(SYNERGY)).unwrap();
            assert_eq!(
                (synergy.hand, synergy.recommended_components),
                (entry.hand.clone(), entry.recommended_components)
            );
        }
    }
}
