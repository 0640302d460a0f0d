//! Figures, each with its plotted numbers.

mod canvas;
mod contribution;
mod few_numbers;
mod lines;
mod loadings;
mod points;
mod variance;

use std::collections::BTreeMap;

use crate::ReportError;
use crate::records::Analysis;
use crate::run::Run;

pub use canvas::render_png;
pub use few_numbers::NAME as FEW_NUMBERS;
pub(crate) use lines::learning_curves;

/// A figure.
#[derive(Clone, Debug)]
pub struct Figure {
    /// Name of its files, without an extension.
    pub name: String,
    /// Its title.
    pub title: String,
    /// How to read it.
    pub caption: String,
    /// The drawing.
    pub svg: String,
    /// The plotted numbers.
    pub csv: Vec<u8>,
    /// Whether the page shows its parts as figures of their own.
    pub is_repeated: bool,
}

/// Runs that differ in their seed alone: those of a lambda, or of a variant of a study.
pub(crate) struct Group<'a> {
    /// Its name in the tables of figures.
    pub key: String,
    /// Its name in legends.
    pub label: String,
    /// Its runs.
    pub runs: Vec<&'a Run>,
}

/// `lambda = 1 (5 runs)`
pub(crate) fn label(lambda: f64, n_runs: usize) -> String {
    format!("\u{3bb} = {lambda} ({n_runs} {})", if n_runs == 1 { "run" } else { "runs" })
}

/// Says what lines and bands are.
const SPREAD: &str = "Lines are medians over the runs; bands extend from the lowest run to the highest.";

/// Says what lines and bands are, where a group has several runs.
fn spread(groups: &[Group<'_>]) -> &'static str {
    if groups.iter().any(|group| group.runs.len() > 1) { SPREAD } else { "" }
}

/// Draws every figure that has numbers.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn all(runs: &[Run], analysis: &Analysis) -> Result<Vec<Figure>, ReportError> {
    let groups = groups(runs);
    let mut figures: Vec<Figure> = few_numbers::figure(analysis)?.into_iter().collect();
    figures.extend(loadings::figures(runs)?);
    figures.extend(variance::figure(&groups)?);
    figures.extend(contribution::figures(&groups)?);
    figures.extend(lines::figures(&groups)?);
    figures.extend(points::figures(analysis)?);
    Ok(figures)
}

fn groups(runs: &[Run]) -> Vec<Group<'_>> {
    let mut groups: BTreeMap<u64, Vec<&Run>> = BTreeMap::new();
    for run in runs {
        // The bits of numbers of at least 0 have the same order as the numbers.
        groups.entry(run.lambda.abs().to_bits()).or_default().push(run);
    }
    groups
        .into_values()
        .map(|runs| Group { key: runs[0].lambda.to_string(), label: label(runs[0].lambda, runs.len()), runs })
        .collect()
}

/// Writes rows of numbers as CSV; a number that is not finite becomes an empty field.
pub(crate) fn csv(
    name: &str,
    header: &[&str],
    rows: impl IntoIterator<Item = Vec<Cell>>,
) -> Result<Vec<u8>, ReportError> {
    let failed = ReportError::draw(name);
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(header).map_err(|error| failed(error.to_string()))?;
    for row in rows {
        writer.write_record(row.iter().map(Cell::text)).map_err(|error| failed(error.to_string()))?;
    }
    writer.into_inner().map_err(|error| failed(error.to_string()))
}

/// A field of a CSV file.
pub(crate) enum Cell {
    /// A number.
    Number(f64),
    /// A word.
    Text(String),
}

impl Cell {
    fn text(&self) -> String {
        match self {
            Cell::Number(value) if value.is_finite() => value.to_string(),
            Cell::Number(_) => String::new(),
            Cell::Text(text) => text.clone(),
        }
    }
}

impl From<f64> for Cell {
    fn from(value: f64) -> Cell {
        Cell::Number(value)
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Cell {
        Cell::Text(text)
    }
}

impl From<usize> for Cell {
    fn from(value: usize) -> Cell {
        Cell::Number(value as f64)
    }
}
