//! Several runs of one experiment, each trained in a process of its own: [`reproduce`](crate::reproduce) and
//! [`sweep`](crate::sweep) list them as [`Job`]s, [`children`] trains them, and an [`OverviewDisplay`] shows how far they are.

use std::path::{Path, PathBuf};

use eigenhand_files::cannot;

use crate::run_dir::{LOCK, is_run, lock};
use crate::{Summary, TrainError, checkpoint};

pub mod children;
mod overview;

pub use overview::{Overview, OverviewBars, OverviewDisplay, OverviewLines, Progressing, Silent};

/// State of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// It has no checkpoint.
    New,
    /// It can be resumed from its newest checkpoint.
    Interrupted {
        /// Training episodes before that checkpoint.
        episodes: u64,
    },
    /// It was trained and evaluated to its end.
    Complete,
}

/// A run to be trained.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// Its name, which its directory ends with.
    pub name: String,
    /// The run that has to be complete before this one starts.
    pub needs: Option<PathBuf>,
    /// Training episodes in all.
    pub episodes: u64,
    /// Training episodes after which it stops, saved; none if it is trained to its end.
    pub until: Option<u64>,
    /// The run directory.
    pub run: PathBuf,
    /// File with the output of its process.
    pub log: PathBuf,
    /// Its state.
    pub state: State,
}

impl Job {
    /// Makes the run `name` of `episodes` training episodes in a directory, as if it were new.
    pub(crate) fn new(directory: &Path, name: String, episodes: u64) -> Job {
        let run = directory.join(&name);
        let log = directory.join(format!("{name}.log"));
        Job { state: State::New, name, needs: None, episodes, until: None, run, log }
    }

    /// Tells whether nothing is left to be trained.
    pub fn is_done(&self) -> bool {
        match self.state {
            State::New => false,
            State::Interrupted { episodes } => self.until.is_some_and(|until| episodes >= until),
            State::Complete => true,
        }
    }

    /// Returns the training episodes at its end.
    pub fn target(&self) -> u64 {
        self.until.unwrap_or(self.episodes).min(self.episodes)
    }

    /// Returns the number of training episodes that are done, up to its end.
    pub fn episodes_done(&self) -> u64 {
        match self.state {
            State::New => 0,
            State::Interrupted { episodes } => episodes.min(self.target()),
            State::Complete => self.target(),
        }
    }

    /// Finds the state of its directory.
    ///
    /// # Errors
    /// [`TrainError::File`], or [`TrainError::Damaged`] for a summary that cannot be read.
    pub(crate) fn refresh(&mut self) -> Result<(), TrainError> {
        self.state = state_of(&self.run)?;
        Ok(())
    }

    /// Removes the directory of a run without a checkpoint, so that the run can start again.
    ///
    /// # Errors
    /// [`TrainError::NotARun`] when the directory holds other files, [`TrainError::Locked`] when another process still
    /// trains there, [`TrainError::File`].
    pub(crate) fn clear(&self) -> Result<(), TrainError> {
        let foreign = |entry: &std::fs::DirEntry| {
            let name = entry.file_name();
            name != LOCK && !name.to_string_lossy().ends_with(".partial")
        };
        let Ok(entries) = self.run.read_dir() else { return Ok(()) };
        if !is_run(&self.run) && entries.flatten().any(|entry| foreign(&entry)) {
            let reason = "it holds other files; move them away".to_owned();
            return Err(TrainError::NotARun { path: self.run.clone(), reason });
        }
        let _held = lock(&self.run)?;
        Ok(std::fs::remove_dir_all(&self.run).map_err(cannot("remove", &self.run))?)
    }
}

/// Lists the run directories in a directory, by name.
///
/// # Errors
/// [`TrainError::File`].
pub fn runs_in(directory: &Path) -> Result<Vec<PathBuf>, TrainError> {
    let mut runs = Vec::new();
    for entry in directory.read_dir().map_err(cannot("read", directory))? {
        let path = entry.map_err(cannot("read", directory))?.path();
        if is_run(&path) {
            runs.push(path);
        }
    }
    runs.sort();
    Ok(runs)
}

fn state_of(run: &Path) -> Result<State, TrainError> {
    if Summary::read(run)?.is_some_and(|summary| summary.is_complete()) {
        return Ok(State::Complete);
    }
    Ok(checkpoint::newest(run)?.map_or(State::New, |episodes| State::Interrupted { episodes }))
}
