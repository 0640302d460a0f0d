//! Damaged manifests and models are errors or hands, never a panic and never an endless loop.
//!
//! Two seconds in CI; for longer, and in release:
//! `EIGENHAND_FUZZ_SECONDS=600 cargo test --release -p eigenhand-hands --test fuzz -- --nocapture`
#![forbid(unsafe_code)]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use eigenhand_hands::{Hand, HandSummary, ImportOptions, import};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

const SECONDS: &str = "EIGENHAND_FUZZ_SECONDS";
const CORPUS: &str = "EIGENHAND_HANDS_CORPUS";
/// The longest that one file may take to be read; meshes of a hundred thousand triangles are among them.
const LONGEST: Duration = Duration::from_secs(20);

/// What is put in place of a number or a piece of text.
const PIECES: &[&str] = &[
    "",
    "0",
    "-1",
    "nan",
    "inf",
    "-inf",
    "1e999",
    "1e-320",
    "4294967296",
    "9223372036854775808",
    "0 0 0",
    "1 2",
    "\"",
    "'",
    "<",
    ">",
    "/>",
    "</",
    "<!--",
    "-->",
    "<![CDATA[",
    "<?xml?>",
    "&amp;",
    "&#0;",
    "&bogus;",
    "\u{0}",
    "é",
    "\u{FEFF}",
    "..",
    "../../../../etc/passwd",
    "package://",
    "file:///dev/null",
    "name=\"\"",
    "class=\"none\"",
    "<include file=\"x.xml\"/>",
    "<body>",
    "</body>",
    "<joint type=\"free\"/>",
    "<frame/>",
    "<mimic joint=\"x\"/>",
    "${x}",
    "[",
    "]",
    "=",
    "\n[a]\n",
    "true",
];

fn mutate(text: &str, random: &mut impl Rng) -> String {
    let mut chars: Vec<char> = text.chars().collect();
    for _ in 0..random.random_range(1..6) {
        let at = random.random_range(0..=chars.len());
        match random.random_range(0..6) {
            0 | 1 => {
                // A word: a number, a name, a tag.
                let is_word = |c: &char| c.is_alphanumeric() || matches!(c, '.' | '-' | '_' | '+');
                let start = chars[..at].iter().rposition(|c| !is_word(c)).map_or(0, |i| i + 1);
                let end = chars[at..].iter().position(|c| !is_word(c)).map_or(chars.len(), |i| at + i);
                chars.splice(start..end, PIECES[random.random_range(0..PIECES.len())].chars());
            }
            2 => {
                let end = (at + random.random_range(0..40)).min(chars.len());
                chars.splice(at..end, PIECES[random.random_range(0..PIECES.len())].chars());
            }
            3 => {
                let (start, end) = line(&chars, at);
                chars.drain(start..end);
            }
            4 => {
                let (start, end) = line(&chars, at);
                let copy: Vec<char> = chars[start..end].to_vec();
                let to = random.random_range(0..=chars.len());
                chars.splice(to..to, copy);
            }
            _ => chars.truncate(at),
        }
    }
    chars.into_iter().collect()
}

fn line(chars: &[char], at: usize) -> (usize, usize) {
    let start = chars[..at].iter().rposition(|c| *c == '\n').map_or(0, |i| i + 1);
    let end = chars[at..].iter().position(|c| *c == '\n').map_or(chars.len(), |i| at + i + 1);
    (start, end)
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &target);
        } else {
            std::fs::copy(&path, &target).unwrap();
        }
    }
}

fn files_below(directory: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        let wanted = |name: &str| name == "hand.toml" || name.ends_with(".xml") || name.ends_with(".urdf");
        if path.is_dir() {
            files_below(&path, found);
        } else if path.file_name().is_some_and(|name| wanted(&name.to_string_lossy())) {
            found.push(path);
        }
    }
    found.sort();
}

#[test]
fn damaged_files_are_errors_or_hands() {
    let place = TempDir::new().unwrap();
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    copy(&workspace.join("plugins"), &place.path().join("plugins"));
    let corpus = std::env::var_os(CORPUS).map_or_else(|| workspace.join("../shared/hands-corpus"), PathBuf::from);
    if corpus.is_dir() {
        copy(&corpus, &place.path().join("corpus"));
    }
    let mut seeds = Vec::new();
    files_below(place.path(), &mut seeds);
    assert!(seeds.len() > 5, "{seeds:?}");

    let seconds = std::env::var(SECONDS).ok().and_then(|text| text.parse().ok()).unwrap_or(2);
    let until = Instant::now() + Duration::from_secs(seconds);
    let mut random = ChaCha8Rng::seed_from_u64(std::process::id().into());
    let (mut n_cases, mut n_hands) = (0_u64, 0_u64);
    while Instant::now() < until {
        let file = &seeds[random.random_range(0..seeds.len())];
        let bytes = std::fs::read(file).unwrap();
        let text = mutate(&String::from_utf8_lossy(&bytes), &mut random);
        std::fs::write(file, &text).unwrap();
        let began = Instant::now();
        let read = std::panic::catch_unwind(|| read(file));
        let took = began.elapsed();
        std::fs::write(file, &bytes).unwrap();
        assert!(read.is_ok() && took < LONGEST, "{} ({took:?}) with these contents:\n{text}", file.display());
        n_cases += 1;
        n_hands += u64::from(read.unwrap_or(false));
    }
    println!("{n_cases} damaged files of {}, of which {n_hands} were still hands", seeds.len());
}

/// Reads a file the way a hand's owner would, and tells whether it is a hand.
fn read(file: &Path) -> bool {
    let directory = file.parent().unwrap();
    if directory.join("hand.toml").is_file() {
        return Hand::load(directory).is_ok_and(|hand| {
            let commands = hand.actuation().control(&hand.open_posture_vector());
            commands.iter().all(|c| c.is_finite()) && serde_json::to_string(&HandSummary::of(&hand)).is_ok()
        });
    }
    import(file, &ImportOptions::default(), &mut Vec::new()).is_ok()
}
