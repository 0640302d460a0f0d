//! Where a synergy is read from.

use std::path::{Path, PathBuf};

use anyhow::bail;
use eigenhand_synergy::{Import, Space, SynergyFile, import};
use eigenhand_train::{POSTURE_SYNERGY, SYNERGY};

/// The file of a synergy in its directory.
const FILE: &str = "synergy.toml";

/// The spaces that a run has.
#[derive(Clone, Copy, clap::ValueEnum)]
pub(crate) enum SpaceName {
    /// The control synergy: commands along whole grasps
    Commands,
    /// The synergy of end postures
    Postures,
}

impl SpaceName {
    pub(crate) fn of(self) -> Space {
        match self {
            SpaceName::Commands => Space::Commands,
            SpaceName::Postures => Space::Postures,
        }
    }

    fn directory(self) -> &'static str {
        match self {
            SpaceName::Commands => SYNERGY,
            SpaceName::Postures => POSTURE_SYNERGY,
        }
    }
}

/// A synergy as it was read.
pub(crate) struct Source {
    /// The path that the user gave.
    pub(crate) path: PathBuf,
    pub(crate) file: SynergyFile,
    /// The samples to which it was fitted, if they lie beside it.
    pub(crate) samples: Option<Vec<Vec<f64>>>,
}

impl Source {
    /// Reads the synergy at `path`: a file, its directory, or a run or an export, which hold one for each space.
    pub(crate) fn read(path: &Path, space: SpaceName) -> anyhow::Result<Source> {
        let (file, samples) = if path.is_file() {
            (SynergyFile::read(path)?, None)
        } else if path.join(FILE).is_file() {
            read_directory(path)?
        } else if path.join(space.directory()).join(FILE).is_file() {
            read_directory(&path.join(space.directory()))?
        } else if path.is_dir() {
            bail!(
                "{} holds no synergy: expected {FILE}, or {}/{FILE} as in a run directory; a run writes it once it has enough \
                 successes",
                path.display(),
                space.directory()
            );
        } else {
            bail!("{} does not exist: give a run directory, an export, or a {FILE}", path.display());
        };
        Ok(Source { path: path.to_owned(), file, samples })
    }

    /// Returns what one sample is.
    pub(crate) fn sample(&self) -> &'static str {
        match self.file.space {
            Space::Commands => "command",
            Space::Postures => "posture",
        }
    }

    /// Says what the synergy is, in one line.
    pub(crate) fn title(&self) -> String {
        let (kind, coordinates) = match self.file.space {
            Space::Commands => ("control synergy", "actuators"),
            Space::Postures => ("synergy of end postures", "joints"),
        };
        let synergy = &self.file.synergy;
        let numbers = match synergy.n_components() {
            1 => "1 number".to_owned(),
            k => format!("{k} numbers"),
        };
        format!(
            "{kind} of {}: {numbers} for {} {coordinates}, from {} {}s",
            self.file.hand,
            synergy.n_joints(),
            synergy.n_postures(),
            self.sample()
        )
    }
}

/// A directory with the file alone, as in `synergies/`, has no samples.
fn read_directory(directory: &Path) -> anyhow::Result<(SynergyFile, Option<Vec<Vec<f64>>>)> {
    let alone = !directory.join("mean.npy").exists();
    if alone {
        return Ok((SynergyFile::read(directory.join(FILE))?, None));
    }
    let Import { file, samples } = import(directory)?;
    Ok((file, Some(samples)))
}
