//! Writing a report's files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use eigenhand_files::{cannot, create_directory, write_atomically};
use serde::Serialize;

use crate::analysis::analyse;
use crate::figures::{self, Figure, render_png};
use crate::records::Analysis;
use crate::run::{EXPLORER, Run, best};
use crate::study::{self, Study, StudyAnalysis};
use crate::{ReportError, page, tables};

/// Name of the page.
pub const PAGE: &str = "index.html";
/// Name of the file with all results on the page.
pub(crate) const JSON: &str = "report.json";
/// Directory of the figures; it holds no other files.
const FIGURES: &str = "figures";
/// Extensions of a figure's files.
const EXTENSIONS: [&str; 3] = ["svg", "png", "csv"];

/// A report that was written.
#[derive(Clone, Debug)]
pub struct Report {
    /// Its directory.
    pub directory: PathBuf,
    /// Its page.
    pub page: PathBuf,
    /// Its results.
    pub analysis: Analysis,
}

/// A study's report that was written.
#[derive(Clone, Debug)]
pub struct StudyReport {
    /// Its page.
    pub page: PathBuf,
    /// Its results.
    pub analysis: StudyAnalysis,
}

/// Writes a report on runs into a directory that is new, empty, or holds an earlier report.
///
/// Everything is computed and drawn before the first file is written.
///
/// # Errors
/// [`ReportError::OutExists`] for any other directory, [`ReportError::Draw`], [`ReportError::File`].
pub fn write(runs: &[Run], out: &Path) -> Result<Report, ReportError> {
    check_out(out)?;
    let analysis = analyse(runs);
    let figures = figures::all(runs, &analysis)?;
    let page = page::render(runs, &analysis, &figures);
    let mut tables = vec![(tables::RUNS, tables::runs(&analysis)?), (tables::LAMBDAS, tables::lambdas(&analysis)?)];
    tables.extend(best(runs).and_then(|run| Some((EXPLORER, run.explorer.clone()?))));
    write_files(out, page, &analysis, tables, &figures)?;
    Ok(Report { directory: out.to_owned(), page: out.join(PAGE), analysis })
}

/// Writes a study's report into a directory that is new, empty, or holds an earlier report.
///
/// # Errors
/// As [`write()`].
pub fn write_study(study: &Study, out: &Path) -> Result<StudyReport, ReportError> {
    check_out(out)?;
    let analysis = study::analyse(study);
    let figures = study::figures(study)?;
    let page = study::render(study, &analysis, &figures);
    write_files(out, page, &analysis, vec![(tables::RUNS, study::table(&analysis)?)], &figures)?;
    Ok(StudyReport { page: out.join(PAGE), analysis })
}

/// Writes page, results, tables and figures.
fn write_files(
    out: &Path,
    page: String,
    analysis: &impl Serialize,
    tables: Vec<(&str, Vec<u8>)>,
    figures: &[Figure],
) -> Result<(), ReportError> {
    let mut files: BTreeMap<PathBuf, Vec<u8>> = BTreeMap::new();
    for figure in figures {
        let path = |extension: &str| out.join(FIGURES).join(format!("{}.{extension}", figure.name));
        files.insert(path("svg"), figure.svg.clone().into_bytes());
        files.insert(path("png"), render_png(&figure.name, &figure.svg)?);
        files.insert(path("csv"), figure.csv.clone());
    }
    let json = serde_json::to_vec_pretty(analysis)
        .map_err(|error| ReportError::Draw { name: JSON.to_owned(), reason: error.to_string() })?;
    files.insert(out.join(JSON), json);
    files.extend(tables.into_iter().map(|(name, bytes)| (out.join(name), bytes)));
    files.insert(out.join(PAGE), page.into_bytes());
    create_directory(&out.join(FIGURES))?;
    for (path, bytes) in &files {
        write_atomically(path, bytes)?;
    }
    remove_stale(&out.join(FIGURES), &files)
}

fn check_out(out: &Path) -> Result<(), ReportError> {
    let occupied = out.read_dir().is_ok_and(|mut entries| entries.next().is_some());
    let earlier = out.join(tables::RUNS).is_file() && out.join(JSON).is_file();
    if out.is_file() || (occupied && !earlier) {
        return Err(ReportError::OutExists { path: out.to_owned() });
    }
    Ok(())
}

/// Removes figures of an earlier report that the new report does not have.
fn remove_stale(directory: &Path, files: &BTreeMap<PathBuf, Vec<u8>>) -> Result<(), ReportError> {
    for entry in directory.read_dir().map_err(cannot("read", directory))? {
        let path = entry.map_err(cannot("read", directory))?.path();
        let extension = path.extension().and_then(|extension| extension.to_str());
        let figure = extension.is_some_and(|extension| EXTENSIONS.contains(&extension));
        if figure && !files.contains_key(&path) {
            std::fs::remove_file(&path).map_err(cannot("remove", &path))?;
        }
    }
    Ok(())
}
