//! The samples to which `synergy fit` fits a space: of runs, of databases, and of tables.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use eigenhand_hands::Hand;
use eigenhand_synergy::{JointInfo, PostureDatabase, Space, Unit, read_matrix};
use eigenhand_train::{DATABASE, say};
use serde::Deserialize;

/// Rows of numbers, one for each coordinate.
#[derive(Debug)]
pub(super) struct Samples {
    /// Joints or actuators.
    pub(super) coordinates: Vec<JointInfo>,
    pub(super) rows: Vec<Sample>,
    /// The joints of [`Sample::posture`]; empty where no posture is known.
    pub(super) joints: Vec<JointInfo>,
}

/// A posture or a command.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sample {
    pub(super) values: Vec<f64>,
    /// The object that was grasped; empty where it is not known.
    pub(super) object: String,
    /// For a command: the posture that was measured with it, in the order of the joints.
    pub(super) posture: Vec<f64>,
    /// The grasp of which it is part, or the part of its table.
    pub(super) group: u64,
}

/// What is taken of a source.
pub(super) struct Wanted<'a> {
    pub(super) space: Space,
    /// Objects that count; all if there are none.
    pub(super) objects: &'a [String],
    pub(super) episodes: Option<Range<u64>>,
    /// Names and limits of the coordinates of a table.
    pub(super) hand: Option<&'a Hand>,
    pub(super) map: &'a Map,
}

/// A column may leave a joint's limits by this share of their range, and by this much (rad or m): sensors are not exact.
const BEYOND: [f64; 2] = [0.2, 0.05];

/// Parts of a table that count as grasps of their own: it does not tell where a grasp begins.
const PARTS: usize = 100;

/// How the columns of a table become coordinates.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Map {
    /// By the name of a column.
    #[serde(default)]
    columns: BTreeMap<String, Column>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Column {
    /// Name of the coordinate; the same if absent.
    joint: Option<String>,
    /// Factor on the column.
    #[serde(default = "one")]
    factor: f64,
    /// Added after the factor.
    #[serde(default)]
    offset: f64,
    /// Whether the column is no coordinate, such as a time.
    #[serde(default)]
    drop: bool,
}

fn one() -> f64 {
    1.0
}

impl Map {
    /// Reads a map file.
    pub(super) fn read(path: &Path) -> anyhow::Result<Map> {
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        toml::from_str(&text).with_context(|| {
            format!(
                "{} is no map: expected lines such as `columns.J1 = {{ joint = \"thumb_1\", factor = -1, offset = 0.1 }}`",
                path.display()
            )
        })
    }

    fn drops(&self, column: &str) -> bool {
        self.columns.get(column).is_some_and(|column| column.drop)
    }
}

impl Samples {
    /// Reads sources with the same coordinates and puts their samples together.
    pub(super) fn read(sources: &[PathBuf], wanted: &Wanted<'_>) -> anyhow::Result<Samples> {
        let mut all: Option<Samples> = None;
        let mut seen = Seen::default();
        for source in sources {
            let next = of_source(source, wanted, &mut seen)?;
            if next.rows.is_empty() {
                say!("note: {} has no sample that counts", source.display());
            }
            match &mut all {
                None => all = Some(next),
                Some(all) => all.append(next).with_context(|| format!("{} does not fit", source.display()))?,
            }
        }
        let all = all.context("expected at least one source")?;
        seen.check(wanted)?;
        if all.rows.is_empty() {
            bail!("no sample is left: runs need successes, --episodes has to hold some of them, and tables need rows");
        }
        Ok(all)
    }

    fn append(&mut self, other: Samples) -> anyhow::Result<()> {
        let names = |joints: &[JointInfo]| joints.iter().map(|j| (j.name.clone(), j.unit)).collect::<Vec<_>>();
        let (own, others) = (names(&self.coordinates), names(&other.coordinates));
        if let Some((name, unit)) = own.iter().find(|name| !others.contains(name)) {
            bail!("it has no {name} in {unit}, which the first source has; all sources need the same joints");
        }
        if let Some((name, unit)) = others.iter().find(|name| !own.contains(name)) {
            bail!("it has {name} in {unit}, which the first source lacks; all sources need the same joints");
        }
        let order: Vec<usize> = own.iter().filter_map(|name| others.iter().position(|other| other == name)).collect();
        if names(&self.joints) != names(&other.joints) {
            self.joints.clear();
        }
        let next_group = self.rows.iter().map(|row| row.group + 1).max().unwrap_or(0);
        self.rows.extend(other.rows.into_iter().map(|row| Sample {
            values: order.iter().map(|&i| row.values[i]).collect(),
            group: next_group + row.group,
            ..row
        }));
        Ok(())
    }

    /// Keeps the coordinates for which `keep` is true.
    pub(super) fn select(&mut self, keep: impl Fn(&str) -> bool) {
        let kept: Vec<usize> = (0..self.coordinates.len()).filter(|&i| keep(&self.coordinates[i].name)).collect();
        self.coordinates = kept.iter().map(|&i| self.coordinates[i].clone()).collect();
        for row in &mut self.rows {
            row.values = kept.iter().map(|&i| row.values[i]).collect();
        }
    }

    /// Takes equally many samples of each object, evenly spread over those that it has.
    pub(super) fn balance(&mut self) -> anyhow::Result<()> {
        let mut of_object: BTreeMap<String, Vec<Sample>> = BTreeMap::new();
        for row in std::mem::take(&mut self.rows) {
            of_object.entry(row.object.clone()).or_default().push(row);
        }
        if of_object.contains_key("") {
            bail!("--weights per-object needs the objects of the samples, which only runs and databases have");
        }
        let least = of_object.values().map(Vec::len).min().unwrap_or(0);
        for rows in of_object.into_values() {
            let n = rows.len();
            self.rows.extend((0..least).map(|i| rows[i * n / least].clone()));
        }
        Ok(())
    }
}

/// What the sources have of what the user asks for.
#[derive(Default)]
struct Seen {
    objects: BTreeSet<String>,
    columns: BTreeSet<String>,
}

impl Seen {
    /// Refuses a name that no source has, which is a slip.
    fn check(&self, wanted: &Wanted<'_>) -> anyhow::Result<()> {
        let list = |names: &BTreeSet<String>| names.iter().cloned().collect::<Vec<_>>().join(", ");
        if let Some(object) = wanted.objects.iter().find(|object| !self.objects.contains(*object)) {
            bail!("--object {object}: no source has it; they have {}", list(&self.objects));
        }
        match wanted.map.columns.keys().find(|column| !self.columns.contains(*column)) {
            Some(_) if self.columns.is_empty() => bail!("--map changes tables, and no source is one"),
            Some(column) => {
                bail!("--map: no table has the column {column}; they have {}", list(&self.columns))
            }
            None => Ok(()),
        }
    }
}

fn extension_of(source: &Path) -> String {
    source.extension().and_then(|kind| kind.to_str()).unwrap_or_default().to_lowercase()
}

/// Tells whether a source is a table of samples, which knows neither space nor objects.
pub(super) fn is_table(source: &Path) -> bool {
    !source.is_dir() && ["csv", "npy"].contains(&extension_of(source).as_str())
}

fn of_source(source: &Path, wanted: &Wanted<'_>, seen: &mut Seen) -> anyhow::Result<Samples> {
    let extension = extension_of(source);
    let filtered = !wanted.objects.is_empty() || wanted.episodes.is_some();
    match extension.as_str() {
        _ if source.is_dir() => of_database(&source.join(DATABASE), wanted, seen),
        "csv" | "npy" if filtered => bail!(
            "{} does not say which object or episode a row is of; --object and --episodes need a run or its {DATABASE}",
            source.display()
        ),
        "csv" => of_table(&csv(source, wanted.map)?, source, wanted, seen),
        "npy" => {
            let rows = read_matrix(source)?;
            of_table(&(Vec::new(), rows), source, wanted, seen)
        }
        _ => of_database(source, wanted, seen),
    }
}

fn of_database(path: &Path, wanted: &Wanted<'_>, seen: &mut Seen) -> anyhow::Result<Samples> {
    if !path.exists() {
        bail!(
            "{} does not exist: give a run directory, a database of postures, or a table (.csv, .npy)",
            path.display()
        );
    }
    let database = PostureDatabase::open_existing(path)?;
    let mut is_wanted = |object: &str, episode: u64| {
        seen.objects.insert(object.to_owned());
        (wanted.objects.is_empty() || wanted.objects.iter().any(|name| name == object))
            && wanted.episodes.as_ref().is_none_or(|episodes| episodes.contains(&episode))
    };
    let joints = database.joints().to_vec();
    Ok(match wanted.space {
        Space::Commands => {
            let motions = database.motions()?.into_iter().filter(|step| is_wanted(&step.object, step.episode));
            let sample = |step: eigenhand_synergy::MotionRecord| Sample {
                values: step.command,
                object: step.object,
                posture: step.posture,
                group: step.episode,
            };
            Samples { coordinates: database.actuators().to_vec(), rows: motions.map(sample).collect(), joints }
        }
        Space::Postures => {
            let by_policy =
                |record: &eigenhand_synergy::PostureRecord| record.source != eigenhand_synergy::Source::Script;
            let records = database.load()?.into_iter().filter(by_policy);
            let records = records.filter(|record| is_wanted(&record.object, record.episode));
            let sample = |record: eigenhand_synergy::PostureRecord| Sample {
                values: record.posture,
                object: record.object,
                posture: Vec::new(),
                group: record.episode,
            };
            Samples { coordinates: joints, rows: records.map(sample).collect(), joints: Vec::new() }
        }
    })
}

/// Names of columns, and rows.
type Table = (Vec<String>, Vec<Vec<f64>>);

/// A column that the map drops may hold any text.
fn csv(path: &Path, map: &Map) -> anyhow::Result<Table> {
    let mut reader = csv::Reader::from_path(path).with_context(|| format!("cannot read {}", path.display()))?;
    let headers = reader.headers().with_context(|| format!("{} is no table", path.display()))?;
    let names: Vec<String> = headers.iter().map(|name| name.trim().to_owned()).collect();
    if names.iter().all(|name| name.parse::<f64>().is_ok()) {
        bail!("{} has no header: its first line must name the joints", path.display());
    }
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.with_context(|| format!("{} is no table", path.display()))?;
        let line = record.position().map_or(0, csv::Position::line);
        let number = |(text, name): (&str, &String)| {
            if map.drops(name) {
                return Ok(0.0);
            }
            let value = text.trim().parse::<f64>().ok().filter(|value| value.is_finite());
            value.with_context(|| {
                format!("{}, line {line}, column {name}: expected a number, got {text:?}", path.display())
            })
        };
        rows.push(record.iter().zip(&names).map(number).collect::<anyhow::Result<_>>()?);
    }
    Ok((names, rows))
}

/// Without names, the columns are the coordinates of the hand in their order.
fn of_table((names, rows): &Table, path: &Path, wanted: &Wanted<'_>, seen: &mut Seen) -> anyhow::Result<Samples> {
    let known: Vec<JointInfo> = match (wanted.hand, wanted.space) {
        (None, _) => Vec::new(),
        (Some(hand), Space::Postures) => hand.posture.clone(),
        (Some(hand), Space::Commands) => hand.command_coordinates(),
    };
    let names: Vec<String> = match (names.is_empty(), wanted.hand) {
        (false, _) => names.clone(),
        (true, Some(_)) => known.iter().map(|joint| joint.name.clone()).collect(),
        (true, None) => {
            bail!("{} has no names: give the hand whose joints its columns are, with --hand", path.display())
        }
    };
    if let Some(row) = rows.iter().find(|row| row.len() != names.len()) {
        bail!(
            "{} has {} columns; expected {}, one for each joint: {}",
            path.display(),
            row.len(),
            names.len(),
            names.join(", ")
        );
    }
    seen.columns.extend(names.iter().cloned());
    let mut coordinates = Vec::new();
    let mut columns: Vec<(usize, f64, f64)> = Vec::new();
    for (i, name) in names.iter().enumerate() {
        if wanted.map.drops(name) {
            continue;
        }
        let column = wanted.map.columns.get(name);
        let target = column.and_then(|column| column.joint.clone()).unwrap_or_else(|| name.clone());
        let info = known.iter().find(|joint| joint.name == target).cloned();
        if info.is_none() && wanted.hand.is_some() {
            bail!(
                "{}: the hand has no joint {target}; --map gives a column another name, or drops it. The hand's joints: {}",
                path.display(),
                known.iter().map(|joint| joint.name.as_str()).collect::<Vec<_>>().join(", ")
            );
        }
        let unlimited = JointInfo { name: target, unit: Unit::Radian, lower: f64::NEG_INFINITY, upper: f64::INFINITY };
        coordinates.push(info.unwrap_or(unlimited));
        let (factor, offset) = column.map_or((1.0, 0.0), |column| (column.factor, column.offset));
        columns.push((i, factor, offset));
    }
    let sample = |(i, row): (usize, &Vec<f64>)| Sample {
        values: columns.iter().map(|&(i, factor, offset)| factor * row[i] + offset).collect(),
        object: String::new(),
        posture: Vec::new(),
        // Rows that follow one another may be of one motion.
        group: (i * PARTS / rows.len()) as u64,
    };
    let rows: Vec<Sample> = rows.iter().enumerate().map(sample).collect();
    for (j, joint) in coordinates.iter().enumerate() {
        let room = BEYOND[0] * (joint.upper - joint.lower) + BEYOND[1];
        let outside = |row: &&Sample| row.values[j] < joint.lower - room || row.values[j] > joint.upper + room;
        if let Some(row) = rows.iter().find(outside) {
            bail!(
                "{}: {} reaches {:.4} {}, its limits are {:.4} to {:.4}; check unit, order and sign of the columns. For degrees, \
                 --map can give `factor = 0.0174533`",
                path.display(),
                joint.name,
                row.values[j],
                joint.unit,
                joint.lower,
                joint.upper
            );
        }
    }
    Ok(Samples { coordinates, rows, joints: Vec::new() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wanted(map: &Map) -> Wanted<'_> {
        Wanted { space: Space::Postures, objects: &[], episodes: None, hand: None, map }
    }

    #[test]
    fn columns_are_renamed_turned_and_put_in_the_order_of_the_first_table() {
        let place = tempfile::tempdir().expect("a directory");
        let write = |name: &str, text: &str| {
            let path = place.path().join(name);
            std::fs::write(&path, text).expect("written");
            path
        };
        let (a, b) = (write("a.csv", "bend, curl\n0.5,1\n"), write("b.csv", "C,bend\n2,3\n"));
        let map: Map = toml::from_str("columns.C = { joint = \"curl\", factor = -1, offset = 0.25 }").expect("a map");
        let found = Samples::read(&[a.clone(), b], &wanted(&map)).expect("samples");
        let rows: Vec<Vec<f64>> = found.rows.into_iter().map(|row| row.values).collect();
        assert_eq!(rows, [[0.5, 1.0], [3.0, -1.75]]);
        let says = |path: PathBuf, part: &str| {
            let error =
                format!("{:#}", Samples::read(&[a.clone(), path], &wanted(&Map::default())).expect_err("refused"));
            assert!(error.contains(part), "{error}");
        };
        says(write("c.csv", "bend\n1\n"), "it has no curl");
        says(write("d.csv", "bend,curl\n1,x\n"), "line 2, column curl: expected a number, got \"x\"");
        says(write("e.csv", "1,2\n3,4\n"), "no header");
    }

    #[test]
    fn each_object_counts_the_same() {
        let sample = |object: &str, value: f64| Sample {
            values: vec![value],
            object: object.to_owned(),
            posture: Vec::new(),
            group: 0,
        };
        let rows = vec![
            sample("a", 1.0),
            sample("a", 2.0),
            sample("b", 7.0),
            sample("a", 3.0),
            sample("a", 4.0),
            sample("b", 8.0),
        ];
        let mut samples = Samples { coordinates: Vec::new(), rows, joints: Vec::new() };
        samples.balance().expect("objects are known");
        assert_eq!(samples.rows.iter().map(|row| row.values[0]).collect::<Vec<_>>(), [1.0, 3.0, 7.0, 8.0]);
    }
}
