//! The evaluations of a run, as rows of `metrics.csv` and as curves for TensorBoard.

use crate::checkpoint::Lost;
use crate::config::RunConfig;
use crate::counters::Counters;
use crate::error::TrainError;
use crate::metrics::{MetricsFile, MetricsRow, read_metrics};
use crate::provenance::Provenance;
use crate::run_dir::RunDirectory;
use crate::tensorboard::EventFile;

/// The files to which a run writes its evaluations.
pub(crate) struct Journal {
    metrics: MetricsFile,
    events: Option<EventFile>,
}

impl Journal {
    /// Opens the files of a run and drops the rows after `episode`; a resumed run writes them again.
    ///
    /// # Errors
    /// [`TrainError::File`], or [`TrainError::Damaged`] when a row cannot be read.
    pub fn open(
        run: &RunDirectory,
        config: &RunConfig,
        provenance: &Provenance,
        episode: u64,
    ) -> Result<Journal, TrainError> {
        let metrics = MetricsFile::open(run.path(), episode)?;
        let events = if config.tensorboard {
            Some(EventFile::create(
                run.path(),
                provenance.started_unix_s,
                &config.settings()?,
                &read_metrics(run.path())?,
            )?)
        } else {
            None
        };
        Ok(Journal { metrics, events })
    }

    /// Returns the missing rows of a run at a checkpoint, if there are any.
    ///
    /// # Errors
    /// [`TrainError::File`], or [`TrainError::Damaged`] when a row cannot be read.
    pub fn lost(run: &RunDirectory, counters: &Counters) -> Result<Option<Lost>, TrainError> {
        MetricsFile::lost(run.path(), counters.episodes, counters.metrics_rows)
    }

    /// Waits until the disk has all rows. The curves are made anew from the rows when a run is resumed.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn sync(&self) -> Result<(), TrainError> {
        self.metrics.sync()
    }

    /// Appends a row.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn append(&mut self, row: &MetricsRow) -> Result<(), TrainError> {
        self.metrics.append(row)?;
        self.events.as_mut().map_or(Ok(()), |events| events.append(row))
    }
}
