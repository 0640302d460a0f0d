//! The file of a sweep.

use std::collections::BTreeMap;
use std::path::Path;

use eigenhand_files::cannot;
use eigenhand_rl::rng;
use rand::RngExt;
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer};
use toml::Value;

use crate::error::TrainError;
use crate::reproduce::distinct;

/// The most runs of a sweep. Job arrays of Slurm are limited to 1001 tasks by default (`MaxArraySize`).
const MOST_RUNS: usize = 1000;
/// Key of the table of a distribution.
const SAMPLE: &str = "sample";

/// What a sweep varies. Every combination of hand, lambda, values of the grid and drawn values is a variant, which is trained
/// with each seed.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweepFile {
    /// Names or directories of the hands; if there is none, the hand of the default configuration.
    #[serde(default)]
    pub hands: Vec<String>,
    /// Values of lambda; if there is none, that of the settings.
    #[serde(default)]
    pub lambdas: Vec<f64>,
    /// Seeds.
    #[serde(default = "one_seed")]
    pub seeds: Vec<u64>,
    /// The preset.
    pub preset: Option<String>,
    /// Training episodes of each run.
    pub episodes: Option<u64>,
    /// Settings of all runs, by their dotted keys.
    #[serde(default, deserialize_with = "flat")]
    pub settings: BTreeMap<String, Value>,
    /// Values of settings, each combined with all others.
    #[serde(default, deserialize_with = "flat")]
    pub grid: BTreeMap<String, Vec<Value>>,
    /// Values of settings that are drawn.
    pub search: Option<Search>,
    /// Stages after which only the best variants go on.
    pub halving: Option<Halving>,
    /// How the runs are submitted to Slurm.
    #[serde(default)]
    pub slurm: Slurm,
}

/// Settings that are drawn at random.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Search {
    /// Number of draws. The first draws of a longer search are those of a shorter one.
    pub samples: usize,
    /// Seed of the draws.
    #[serde(default)]
    pub seed: u64,
    /// From what each setting is drawn.
    #[serde(deserialize_with = "flat")]
    pub values: BTreeMap<String, Distribution>,
}

/// From what a setting is drawn.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "sample", deny_unknown_fields, rename_all = "lowercase")]
pub enum Distribution {
    /// Evenly from `low` to `high`; a whole number if both are.
    Uniform {
        /// The least value.
        low: Value,
        /// The greatest value.
        high: Value,
    },
    /// So that the logarithm is even from `low` to `high`; a whole number if both are.
    Log {
        /// The least value, above 0.
        low: Value,
        /// The greatest value.
        high: Value,
    },
    /// One of these.
    Choice {
        /// The values.
        of: Vec<Value>,
    },
}

/// Successive halving (Jamieson and Talwalkar 2016): after each stage, only a share of the variants of each hand goes on.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Halving {
    /// Training episodes at which the stages end.
    pub episodes: Vec<u64>,
    /// Share of the variants that go on.
    #[serde(default = "half")]
    pub keep: f64,
}

/// How runs are submitted.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slurm {
    /// Cores of a run.
    #[serde(default = "two")]
    pub cpus: u32,
    /// More options of `sbatch`, such as `--partition=cpu` and `--time=2:00:00`.
    #[serde(default)]
    pub options: Vec<String>,
}

impl Default for Slurm {
    fn default() -> Slurm {
        Slurm { cpus: two(), options: Vec::new() }
    }
}

/// Reads `learner.gamma = x`, which TOML takes for a table in a table, as the key `learner.gamma`.
fn flat<'de, D, T>(deserializer: D) -> Result<BTreeMap<String, T>, D::Error>
where
    D: Deserializer<'de>,
    T: DeserializeOwned,
{
    let mut found = BTreeMap::new();
    let mut waiting = vec![(String::new(), Value::Table(toml::Table::deserialize(deserializer)?))];
    while let Some((key, value)) = waiting.pop() {
        match value {
            Value::Table(table) if !table.contains_key(SAMPLE) => {
                waiting.extend(table.into_iter().map(|(name, value)| {
                    let whole = if key.is_empty() { name } else { format!("{key}.{name}") };
                    (whole, value)
                }))
            }
            value => {
                let read =
                    T::deserialize(value).map_err(|error| D::Error::custom(format!("{key}: {}", error.message())))?;
                found.insert(key, read);
            }
        }
    }
    Ok(found)
}

fn one_seed() -> Vec<u64> {
    vec![1]
}

fn half() -> f64 {
    0.5
}

fn two() -> u32 {
    2
}

/// A combination of settings: `key=value`.
pub type Assignments = Vec<(String, Value)>;

impl SweepFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`TrainError::File`]; [`TrainError::Option`] names what in the file is wrong.
    pub fn read(path: &Path) -> Result<SweepFile, TrainError> {
        let text = std::fs::read_to_string(path).map_err(cannot("read", path))?;
        SweepFile::from_toml(&text).map_err(|reason| TrainError::Option { option: path.display().to_string(), reason })
    }

    fn from_toml(text: &str) -> Result<SweepFile, String> {
        let mut file: SweepFile = toml::from_str(text).map_err(|error| error.to_string().trim_end().to_owned())?;
        file.seeds = distinct(&file.seeds);
        file.lambdas = distinct(&file.lambdas);
        let empty = |key: &str| Err(format!("{key}: expected at least one value, got none"));
        if file.seeds.is_empty() {
            return empty("seeds");
        }
        if let Some((key, _)) = file.grid.iter().find(|(_, values)| values.is_empty()) {
            return empty(&format!("grid.{key:?}"));
        }
        let search = file.search.iter().flat_map(|search| &search.values);
        search
            .clone()
            .try_for_each(|(key, from)| from.check().map_err(|why| format!("search.values.{key:?}: {why}")))?;
        let keys = file.settings.keys().chain(file.grid.keys()).chain(search.map(|(key, _)| key));
        let mut seen = Vec::new();
        for key in keys {
            if let Some((own, _)) = OWN.iter().find(|(_, taken)| taken == key) {
                return Err(format!("{key:?}: set it by the key {own} of the file"));
            }
            if seen.contains(&key) {
                return Err(format!("{key:?} stands in two tables; expected one of settings, grid and search.values"));
            }
            seen.push(key);
        }
        if file.search.as_ref().is_some_and(|search| search.samples == 0) {
            return Err("search.samples: expected at least 1, got 0".to_owned());
        }
        if let Some(Halving { episodes, keep }) = &file.halving {
            if episodes.is_empty() || episodes[0] == 0 || episodes.windows(2).any(|pair| pair[0] >= pair[1]) {
                return Err("halving.episodes: expected numbers above 0, each larger than the one before".to_owned());
            }
            if !(*keep > 0.0 && *keep < 1.0) {
                return Err(format!("halving.keep: expected a share between 0 and 1, got {keep}"));
            }
        }
        if file.slurm.cpus == 0 {
            return Err("slurm.cpus: expected at least 1, got 0".to_owned());
        }
        let count = |n: usize| n.max(1);
        let sizes = [count(file.hands.len()), count(file.lambdas.len()), file.seeds.len()];
        let draws = file.search.as_ref().map_or(1, |search| search.samples);
        let all = file.grid.values().map(Vec::len).chain(sizes).chain([draws]);
        match all.fold(1_usize, usize::saturating_mul) {
            runs if runs > MOST_RUNS => Err(format!("expected at most {MOST_RUNS} runs, got {runs}")),
            _ => Ok(file),
        }
    }

    /// Returns the combinations of settings in which variants differ.
    pub fn combinations(&self) -> Vec<Assignments> {
        let mut combinations = vec![Vec::new()];
        for (key, values) in &self.grid {
            let with = |before: &Assignments| -> Vec<Assignments> {
                values.iter().map(|value| [&before[..], &[(key.clone(), value.clone())]].concat()).collect()
            };
            combinations = combinations.iter().flat_map(with).collect();
        }
        let Some(search) = &self.search else { return combinations };
        let drawn: Vec<Assignments> = (0..search.samples as u64).map(|i| search.draw(i)).collect();
        combinations.iter().flat_map(|fixed| drawn.iter().map(move |drawn| [&fixed[..], drawn].concat())).collect()
    }
}

/// Keys of the file, and the settings that they stand for.
const OWN: [(&str, &str); 5] =
    [("hands", "hand"), ("lambdas", "lambda"), ("seeds", "seed"), ("preset", "preset"), ("episodes", "episodes")];

impl Search {
    fn draw(&self, i: u64) -> Assignments {
        let mut random = rng::stream(self.seed, "sweep", i);
        let mut one = |distribution: &Distribution| match distribution {
            Distribution::Choice { of } => of[random.random_range(0..of.len())].clone(),
            Distribution::Uniform { low, high } => between(low, high, random.random(), |x| x, |x| x),
            Distribution::Log { low, high } => between(low, high, random.random(), f64::ln, f64::exp),
        };
        self.values.iter().map(|(key, distribution)| (key.clone(), one(distribution))).collect()
    }
}

impl Distribution {
    fn check(&self) -> Result<(), String> {
        match self {
            Distribution::Choice { of } if of.is_empty() => Err("expected at least one value in of".to_owned()),
            Distribution::Choice { .. } => Ok(()),
            Distribution::Uniform { low, high } => ordered(low, high, f64::NEG_INFINITY),
            Distribution::Log { low, high } => ordered(low, high, 0.0),
        }
    }
}

fn ordered(low: &Value, high: &Value, above: f64) -> Result<(), String> {
    match (number(low), number(high)) {
        (Some(a), Some(b)) if a > above && a < b && b.is_finite() => Ok(()),
        _ if above == 0.0 => Err(format!("expected two numbers above 0, low and a greater high; got {low} and {high}")),
        _ => Err(format!("expected two numbers, low and a greater high; got {low} and {high}")),
    }
}

fn number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|n| n as f64))
}

/// (ends, share of the way between them on the scale of `to`) => the value there
fn between(low: &Value, high: &Value, share: f64, to: fn(f64) -> f64, from: fn(f64) -> f64) -> Value {
    if let (Some(a), Some(b)) = (low.as_integer(), high.as_integer()) {
        // Each whole number has the stretch that begins there.
        let (start, end) = (to(a as f64), to(b as f64 + 1.0));
        return Value::Integer((from(start + share * (end - start)).floor() as i64).clamp(a, b));
    }
    let (a, b) = (number(low).unwrap_or_default(), number(high).unwrap_or_default());
    let value = from(to(a) + share * (to(b) - to(a))).clamp(a, b);
    // Nobody wants to read or repeat seventeen digits.
    Value::Float(format!("{value:.3e}").parse::<f64>().unwrap_or(value).clamp(a, b))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(text: &str) -> SweepFile {
        SweepFile::from_toml(text).unwrap_or_else(|error| panic!("{error}"))
    }

    #[test]
    fn a_grid_and_a_search_are_combined() {
        let text = r#"
            lambdas = [0, 1]
            [grid]
            "learner.gamma" = [0.95, 0.98]
            [search]
            samples = 3
            [search.values]
            learner.actor_learning_rate = { sample = "log", low = 1e-4, high = 1e-2 }
            "synergy.components" = { sample = "uniform", low = 2, high = 6 }
            objects = { sample = "choice", of = [["cube"], ["sphere"]] }
        "#;
        let all = file(text).combinations();
        assert_eq!(all.len(), 6);
        assert!(all.iter().all(|assignments| assignments.len() == 4));
        assert_eq!(all[0][1..], all[3][1..], "each value of the grid meets the same draws");
        for assignments in &all {
            let value = |key: &str| assignments.iter().find(|(k, _)| k == key).unwrap().1.clone();
            assert!((1e-4..=1e-2).contains(&value("learner.actor_learning_rate").as_float().unwrap()));
            assert!((2..=6).contains(&value("synergy.components").as_integer().unwrap()));
        }
        let more = file(&text.replace("samples = 3", "samples = 9")).combinations();
        assert_eq!(all[..3], more[..3], "a longer search begins with the same draws");
    }

    #[test]
    fn draws_fill_their_range() {
        let draws = |from: Distribution| -> Vec<f64> {
            let search = Search { samples: 0, seed: 7, values: BTreeMap::from([("a".to_owned(), from)]) };
            (0..2000).map(|i| number(&search.draw(i)[0].1).unwrap()).collect()
        };
        let whole = draws(Distribution::Uniform { low: Value::Integer(1), high: Value::Integer(4) });
        for n in 1..=4 {
            let share = whole.iter().filter(|x| **x == f64::from(n)).count() as f64 / 2000.0;
            assert!((share - 0.25).abs() < 0.05, "{n}: {share}");
        }
        let log = draws(Distribution::Log { low: Value::Float(1e-4), high: Value::Float(1.0) });
        let below = log.iter().filter(|x| **x < 1e-2).count() as f64 / 2000.0;
        assert!((below - 0.5).abs() < 0.05, "{below}");
    }

    #[test]
    fn what_is_wrong_is_named() {
        let wrong = |text: &str| SweepFile::from_toml(text).unwrap_err();
        for (text, words) in [
            ("seeds = []", "seeds: expected at least one"),
            ("sedes = [1]", "sedes"),
            ("[grid]\n\"learner.gamma\" = []", "learner.gamma"),
            ("[grid]\nlambda = [1]", "the key lambdas"),
            ("[grid]\na = [1]\n[settings]\na = 1", "two tables"),
            ("[search]\nsamples = 2\n[search.values]\na = { sample = \"log\", low = 0, high = 1 }", "above 0"),
            (
                "[search]\nsamples = 2\n[search.values]\na = { sample = \"uniform\", low = 2, high = 1 }",
                "a greater high",
            ),
            ("[search]\nsamples = 2\n[search.values]\na = { sample = \"choice\", of = [] }", "at least one"),
            ("[halving]\nepisodes = [300, 200]", "each larger"),
            ("[halving]\nepisodes = [300]\nkeep = 1.0", "between 0 and 1"),
            (
                "seeds = [1, 2, 3]\n[search]\nsamples = 900\n[search.values]\na = { sample = \"choice\", of = [1] }",
                "2700",
            ),
        ] {
            let got = wrong(text);
            assert!(got.contains(words), "{text}: {got}");
        }
    }
}
