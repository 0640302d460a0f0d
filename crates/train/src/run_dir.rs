//! The run directory: names, creation, and the lock that keeps a second process out.

use std::fs::{File, OpenOptions, TryLockError};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use eigenhand_files::{cannot, create_directory, write_atomically};

use crate::config::{RunConfig, Settings, parse_settings, read_layer};
use crate::error::TrainError;
use crate::provenance::Provenance;

/// Name of the posture database in a run directory.
pub const DATABASE: &str = "postures.sqlite";
pub(crate) const CONFIG: &str = "config.toml";
const PROVENANCE: &str = "provenance.toml";
pub(crate) const LOCK: &str = ".lock";

mod beginning;

/// A run directory, locked for this process.
pub struct RunDirectory {
    path: PathBuf,
    lock_file: File,
}

impl RunDirectory {
    /// Creates a new run directory with its configuration and provenance.
    ///
    /// Without `out` the directory is `runs/<hand>-<preset>-l<lambda>-s<seed>-<n>`, with the first unused `n`.
    ///
    /// # Errors
    /// [`TrainError::RunExists`] when `out` exists and is not empty; [`TrainError::File`] when it cannot be written.
    pub fn create(out: Option<&Path>, config: &RunConfig, provenance: &Provenance) -> Result<RunDirectory, TrainError> {
        let path = match out {
            Some(path) => {
                let occupied = path.read_dir().is_ok_and(|mut entries| entries.next().is_some());
                if (occupied && !beginning::is_beginning(path)?) || path.is_file() {
                    return Err(TrainError::RunExists { path: path.to_owned() });
                }
                create_directory(path)?;
                path.to_owned()
            }
            None => first_free(Path::new("runs"), config, &provenance.hand)?,
        };
        let run = RunDirectory { lock_file: lock(&path)?, path };
        run.begin()?;
        let config = config.to_toml()?;
        write_atomically(&run.file(CONFIG), config.as_bytes())?;
        write_atomically(&run.file(PROVENANCE), provenance.to_toml(&run.file(PROVENANCE))?.as_bytes())?;
        beginning::keep_config(&run.path, &config)?;
        Ok(run)
    }

    /// Removes what a run has left that was stopped before its first checkpoint.
    fn begin(&self) -> Result<(), TrainError> {
        // Another process may have begun between the look at the directory and the lock.
        if !beginning::is_beginning(&self.path)? {
            return Err(TrainError::RunExists { path: self.path.clone() });
        }
        beginning::clear(&self.path)
    }

    /// Prepares a run to begin anew, with a configuration, that was stopped before its first checkpoint. Returns false for another run, in which
    /// nothing is changed.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub(crate) fn begin_again(&self, config: &RunConfig) -> Result<bool, TrainError> {
        if !beginning::is_beginning(&self.path)? {
            return Ok(false);
        }
        beginning::clear(&self.path)?;
        let config = config.to_toml()?;
        write_atomically(&self.file(CONFIG), config.as_bytes())?;
        beginning::keep_config(&self.path, &config)?;
        Ok(true)
    }

    /// Checks that the configuration is still the one with which the run began, but for the keys that may change.
    ///
    /// # Errors
    /// [`TrainError::ConfigChanged`] with the first key that differs, and the errors of reading both files.
    pub(crate) fn check_config(&self) -> Result<(), TrainError> {
        beginning::check_config(&self.path)
    }

    /// Opens a run directory to continue the run in it.
    ///
    /// # Errors
    /// [`TrainError::NotARun`] when it holds no configuration, [`TrainError::Locked`] when another process uses it.
    pub fn open(path: &Path) -> Result<RunDirectory, TrainError> {
        require_run(path)?;
        Ok(RunDirectory { lock_file: lock(path)?, path: path.to_owned() })
    }

    /// Makes sure that the directory is still where it was.
    ///
    /// # Errors
    /// [`TrainError::Moved`].
    pub fn require_in_place(&self) -> Result<(), TrainError> {
        let identity = |metadata: std::fs::Metadata| (metadata.dev(), metadata.ino());
        let held = self.lock_file.metadata().map(identity).ok();
        let found = std::fs::metadata(self.file(LOCK)).map(identity).ok();
        if held.is_some() && held == found { Ok(()) } else { Err(TrainError::Moved { path: self.path.clone() }) }
    }

    /// Returns the directory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the path of a file in the directory.
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Reads the run's configuration.
    ///
    /// # Errors
    /// As [`read_config`].
    pub fn config(&self) -> Result<RunConfig, TrainError> {
        read_config(&self.path)
    }
}

/// Reads the configuration of the run in a directory.
///
/// # Errors
/// [`TrainError::NotARun`] when the directory is no run, [`TrainError::Config`] when its configuration is not valid.
pub fn read_config(path: &Path) -> Result<RunConfig, TrainError> {
    require_run(path)?;
    Ok(RunConfig::read(&path.join(CONFIG))?)
}

/// Reads the settings of the run in a directory. Unknown keys are allowed, because another version of this program may
/// have written them.
///
/// # Errors
/// [`TrainError::NotARun`] when the directory is no run, [`TrainError::Config`] when its settings are not TOML.
pub fn read_settings(run: &Path) -> Result<Settings, TrainError> {
    require_run(run)?;
    let path = run.join(CONFIG);
    Ok(parse_settings(&path.display().to_string(), &read_layer(&path)?)?)
}

/// Reads the provenance of the run in a directory.
///
/// # Errors
/// [`TrainError::Damaged`] when it is missing or not valid.
pub fn read_provenance(path: &Path) -> Result<Provenance, TrainError> {
    Provenance::read(&path.join(PROVENANCE))
}

/// Tells whether a directory holds a run.
pub fn is_run(path: &Path) -> bool {
    path.join(CONFIG).is_file()
}

pub(crate) fn require_run(path: &Path) -> Result<(), TrainError> {
    let reason = if !path.exists() {
        "there is no such directory"
    } else if !is_run(path) {
        "it holds no config.toml"
    } else {
        return Ok(());
    };
    Err(TrainError::NotARun { path: path.to_owned(), reason: reason.to_owned() })
}

fn first_free(parent: &Path, config: &RunConfig, hand: &str) -> Result<PathBuf, TrainError> {
    create_directory(parent)?;
    let stem = format!("{hand}-{}-l{}-s{}", config.preset.name(), config.lambda, config.seed);
    for n in 1u32.. {
        let path = parent.join(format!("{stem}-{n}"));
        match std::fs::create_dir(&path) {
            Ok(()) => return Ok(path),
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(source) => return Err(cannot("create the directory", &path)(source).into()),
        }
    }
    Err(TrainError::RunExists { path: parent.join(stem) })
}

/// Locks a directory until the returned file is dropped.
pub(crate) fn lock(directory: &Path) -> Result<File, TrainError> {
    let path = directory.join(LOCK);
    let file = OpenOptions::new()
        .create(true)
        .truncate(false)
        .write(true)
        .open(&path)
        .map_err(cannot("write to the run directory", directory))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(TrainError::Locked { path: directory.to_owned() }),
        Err(TryLockError::Error(source)) => Err(cannot("lock", &path)(source).into()),
    }
}
