//! Writing a report's files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use eigenhand_files::{cannot, create_directory, write_atomically};

use crate::analysis::analyse;
use crate::figures::{self, render_png};
use crate::records::Analysis;
use crate::run::Run;
use crate::{ReportError, page, tables};

/// Name of the page.
pub const PAGE: &str = "index.html";
/// Name of the file with all results on the page.
const JSON: &str = "report.json";
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
    let mut files: BTreeMap<PathBuf, Vec<u8>> = BTreeMap::new();
    for figure in &figures {
        let path = |extension: &str| out.join(FIGURES).join(format!("{}.{extension}", figure.name));
        files.insert(path("svg"), figure.svg.clone().into_bytes());
        files.insert(path("png"), render_png(&figure.name, &figure.svg)?);
        files.insert(path("csv"), figure.csv.clone());
    }
    let json = serde_json::to_vec_pretty(&analysis)
        .map_err(|error| ReportError::Draw { name: JSON.to_owned(), reason: error.to_string() })?;
    files.insert(out.join(JSON), json);
    files.insert(out.join(tables::RUNS), tables::runs(&analysis)?);
    files.insert(out.join(tables::LAMBDAS), tables::lambdas(&analysis)?);
    files.insert(out.join(PAGE), page::render(runs, &analysis, &figures).into_bytes());
    create_directory(&out.join(FIGURES))?;
    for (path, bytes) in &files {
        write_atomically(path, bytes)?;
    }
    remove_stale(&out.join(FIGURES), &files)?;
    Ok(Report { directory: out.to_owned(), page: out.join(PAGE), analysis })
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
