//! Where a synergy is read from.

use std::path::{Path, PathBuf};

use crate::bundled::{synergies, synergy_at};
use anyhow::bail;
use eigenhand_synergy::{Import, Space, Synergy, SynergyFile, import};
use eigenhand_train::{POSTURE_SYNERGY, SYNERGY};

/// The file of a synergy in its directory, and an array that lies beside it where the samples do too.
const FILE: &str = "synergy.toml";
const BESIDE: &str = "mean.npy";

/// What the samples of a space are.
#[derive(Clone, Copy, clap::ValueEnum)]
pub(crate) enum SpaceName {
    /// Commands along whole grasps: the control synergy
    Commands,
    /// Joint positions at the end of grasps
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

/// Says what a space is.
pub(crate) fn kind_of(space: Space) -> &'static str {
    match space {
        Space::Commands => "control synergy",
        Space::Postures => "synergy of postures",
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
    /// Reads the synergy at `path`: a file, its directory, or a run or an export, which hold one for each space. Without
    /// `space`, it takes the control synergy of a run.
    pub(crate) fn read(path: &Path, space: Option<SpaceName>) -> anyhow::Result<Source> {
        let given = path;
        let path = &synergy_at(given)?;
        let of_run = space.unwrap_or(SpaceName::Commands).directory();
        let (file, samples) = if path.is_file() {
            match path.parent().filter(|parent| path.ends_with(FILE) && parent.join(BESIDE).exists()) {
                Some(parent) => read_directory(parent)?,
                None => (SynergyFile::read(path)?, None),
            }
        } else if path.join(FILE).is_file() {
            read_directory(path)?
        } else if path.join(of_run).join(FILE).is_file() {
            read_directory(&path.join(of_run))?
        } else if path.is_dir() {
            bail!(
                "{} holds no synergy: expected {FILE}, or {of_run}/{FILE} as in a run directory; a run writes it once it has \
                 enough successes",
                path.display()
            );
        } else {
            bail!(
                "{} does not exist: give a run directory, an export, a {FILE}, or the name of a ready synergy ({})",
                path.display(),
                synergies().join(", ")
            );
        };
        if space.is_some_and(|space| space.of() != file.space) {
            bail!(
                "{} is a {}: leave --space out, or give the directory of the other synergy",
                path.display(),
                kind_of(file.space)
            );
        }
        Ok(Source { path: given.to_owned(), file, samples })
    }

    /// Returns the space of the first `components`, or of all.
    pub(crate) fn first(&self, components: Option<usize>) -> anyhow::Result<Synergy> {
        let synergy = &self.file.synergy;
        let n = synergy.n_components();
        match components {
            Some(k) if k > n => {
                bail!("--components {k}: {} has {n} components", self.path.display())
            }
            asked => Ok(synergy.first(asked.unwrap_or(n))),
        }
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
        let coordinates = match self.file.space {
            Space::Commands => "actuators",
            Space::Postures => "joints",
        };
        let synergy = &self.file.synergy;
        let numbers = match synergy.n_components() {
            1 => "1 number".to_owned(),
            k => format!("{k} numbers"),
        };
        format!(
            "{} of {}: {numbers} for {} {coordinates}, from {} {}s",
            kind_of(self.file.space),
            self.file.hand,
            synergy.n_joints(),
            synergy.n_postures(),
            self.sample()
        )
    }
}

/// A directory with the file alone, as in `synergies/`, has no samples.
fn read_directory(directory: &Path) -> anyhow::Result<(SynergyFile, Option<Vec<Vec<f64>>>)> {
    if !directory.join(BESIDE).exists() {
        return Ok((SynergyFile::read(directory.join(FILE))?, None));
    }
    let Import { file, samples } = import(directory)?;
    Ok((file, Some(samples)))
}
