//! The exported directory: `synergy.toml`, and the same arrays as NPY files.

use std::path::Path;

use crate::atomic::{self, Others};
use crate::joint::check_posture;
use crate::{Space, Synergy, SynergyError, SynergyFile, npy};

const TOML: &str = "synergy.toml";
const POSTURES: &str = "postures.npy";
const COMMANDS: &str = "commands.npy";

/// Returns the name of the file of the samples to which a space was fitted.
fn samples_file(space: Space) -> &'static str {
    match space {
        Space::Commands => COMMANDS,
        Space::Postures => POSTURES,
    }
}

/// A reader of an array of a synergy: (synergy) => (shape, values in C order).
type Array = fn(&Synergy) -> (Vec<usize>, &[f64]);

/// The arrays that `synergy.toml` holds too.
const ARRAYS: [(&str, Array); 4] = [
    ("components.npy", |s| (vec![s.n_components(), s.n_joints()], s.components())),
    ("mean.npy", |s| (vec![s.n_joints()], s.mean())),
    ("explained_variance.npy", |s| (vec![s.n_components()], s.explained_variance())),
    ("contribution.npy", |s| (vec![s.n_components()], s.contribution())),
];

/// An exported directory, as [`import`] reads it.
#[derive(Debug, Clone, PartialEq)]
pub struct Import {
    /// The content of `synergy.toml`.
    pub file: SynergyFile,
    /// The postures or commands to which the space was fitted, N x n.
    pub samples: Vec<Vec<f64>>,
}

/// Writes the directory `dir`: `synergy.toml`, `components.npy` (k x n), `mean.npy` (n), `explained_variance.npy` (k),
/// `contribution.npy` (k) and the samples, `postures.npy` or `commands.npy` (N x n), float64 in C order.
///
/// The files are written to a temporary directory beside `dir`, which is then renamed, so an interrupted export leaves
/// no incomplete directory. An earlier export at `dir` is replaced.
///
/// # Errors
/// A number or a length of postures that does not fit the space, an error of [`SynergyFile::to_toml`], a directory at
/// `dir` that holds other files than an export, or a failure to write.
pub fn export<P: AsRef<[f64]>>(dir: impl AsRef<Path>, file: &SynergyFile, samples: &[P]) -> Result<(), SynergyError> {
    write(dir.as_ref(), file, samples, Others::Refuse)
}

/// Like [`export`], but other files in `dir` stay there, as for the directory of a run's synergy.
///
/// # Errors
/// As [`export`].
pub fn export_beside_others<P: AsRef<[f64]>>(
    dir: impl AsRef<Path>,
    file: &SynergyFile,
    samples: &[P],
) -> Result<(), SynergyError> {
    write(dir.as_ref(), file, samples, Others::Keep)
}

fn write<P: AsRef<[f64]>>(dir: &Path, file: &SynergyFile, samples: &[P], others: Others) -> Result<(), SynergyError> {
    let synergy = &file.synergy;
    let n_joints = synergy.n_joints();
    check_count(samples.len(), synergy)?;
    for (row, sample) in samples.iter().enumerate() {
        check_posture(sample.as_ref(), n_joints, row)?;
    }
    let encode = |name: &str, shape: &[usize], values: &mut dyn Iterator<Item = f64>| {
        npy::to_bytes(shape, values).map_err(SynergyError::io("encode", dir.join(name)))
    };
    let mut files = vec![(TOML, file.to_toml()?.into_bytes())];
    for (name, array) in ARRAYS {
        let (shape, values) = array(synergy);
        files.push((name, encode(name, &shape, &mut values.iter().copied())?));
    }
    let mut values = samples.iter().flat_map(|sample| sample.as_ref().iter().copied());
    let name = samples_file(file.space);
    files.push((name, encode(name, &[samples.len(), n_joints], &mut values)?));
    atomic::replace_directory(dir, &files, is_export_file, others)
}

/// Reads a directory that [`export`] wrote.
///
/// # Errors
/// A file that is missing or malformed, an array that differs from the one in `synergy.toml`, or an error of
/// [`SynergyFile::read`].
pub fn import(dir: impl AsRef<Path>) -> Result<Import, SynergyError> {
    let dir = dir.as_ref();
    let file = SynergyFile::read(dir.join(TOML))?;
    let synergy = &file.synergy;
    for (name, array) in ARRAYS {
        let path = dir.join(name);
        let (shape, values) = read_npy(&path)?;
        let (expected_shape, expected) = array(synergy);
        check_shape(name, &shape, &expected_shape).map_err(|error| error.in_file(&path))?;
        if let Some(i) = (0..expected.len()).find(|&i| values[i].to_bits() != expected[i].to_bits()) {
            let wanted = format!("{}, as in {TOML}", expected[i]);
            return Err(SynergyError::invalid(format!("{name}, number {i}"), wanted, values[i]).in_file(path));
        }
    }
    let name = samples_file(file.space);
    let path = dir.join(name);
    let (shape, values) = read_npy(&path)?;
    let n_joints = synergy.n_joints();
    let inner = || {
        check_shape(name, &shape, &[synergy.n_postures(), n_joints])?;
        let samples: Vec<Vec<f64>> = values.chunks_exact(n_joints).map(<[f64]>::to_vec).collect();
        for (row, sample) in samples.iter().enumerate() {
            check_posture(sample, n_joints, row)?;
        }
        Ok(samples)
    };
    let samples = inner().map_err(|error: SynergyError| error.in_file(path))?;
    Ok(Import { file, samples })
}

/// Reads a table of float64 numbers from an NPY file, N x n.
///
/// # Errors
/// A file that cannot be read, is no NPY file in C order, or has another number of dimensions.
pub fn read_matrix(path: impl AsRef<Path>) -> Result<Vec<Vec<f64>>, SynergyError> {
    let path = path.as_ref();
    let (shape, values) = read_npy(path)?;
    match shape[..] {
        [_, n] if n > 0 => Ok(values.chunks_exact(n).map(<[f64]>::to_vec).collect()),
        _ => {
            let got = format!("{shape:?}");
            Err(SynergyError::invalid("shape of the array", "two dimensions, N x n", got).in_file(path))
        }
    }
}

fn read_npy(path: &Path) -> Result<(Vec<usize>, Vec<f64>), SynergyError> {
    let bytes = std::fs::read(path).map_err(SynergyError::io("read", path))?;
    npy::from_bytes(&bytes).map_err(SynergyError::io("decode", path))
}

fn check_shape(name: &str, got: &[usize], expected: &[usize]) -> Result<(), SynergyError> {
    if got == expected {
        return Ok(());
    }
    Err(SynergyError::invalid(format!("shape of {name}"), format!("{expected:?}"), format!("{got:?}")))
}

fn check_count(n_postures: usize, synergy: &Synergy) -> Result<(), SynergyError> {
    if n_postures == synergy.n_postures() {
        return Ok(());
    }
    let expected = format!("{}, the number to which the space was fitted", synergy.n_postures());
    Err(SynergyError::invalid("number of samples", expected, n_postures))
}

/// Tells whether an export writes a file with this name.
fn is_export_file(name: &str) -> bool {
    name == TOML || name == POSTURES || name == COMMANDS || ARRAYS.iter().any(|(array, _)| *array == name)
}
