//! The stored numbers of a synergy, and the relations that must hold between them.

use crate::joint::check_joints;
use crate::{JointInfo, SynergyError};

/// Largest difference of the products of the components from those of an orthonormal basis.
const ORTHONORMAL_TOLERANCE: f64 = 1e-8;

/// The numbers from which a [`Synergy`] is rebuilt.
pub(crate) struct SynergyParts {
    pub(crate) joints: Vec<JointInfo>,
    pub(crate) mean: Vec<f64>,
    pub(crate) components: Vec<Vec<f64>>,
    pub(crate) eigenvalues: Vec<f64>,
    pub(crate) coefficient_min: Vec<f64>,
    pub(crate) coefficient_max: Vec<f64>,
    pub(crate) n_postures: usize,
}

impl SynergyParts {
    pub(super) fn check(&self) -> Result<(), SynergyError> {
        check_joints(&self.joints)?;
        let (n, k) = (self.joints.len(), self.components.len());
        if k == 0 || k > n {
            return Err(SynergyError::invalid("components", format!("1 to {n} rows"), k));
        }
        check_numbers("mean", &self.mean, n)?;
        check_numbers("eigenvalues", &self.eigenvalues, n)?;
        check_numbers("coefficient_min", &self.coefficient_min, k)?;
        check_numbers("coefficient_max", &self.coefficient_max, k)?;
        for (i, row) in self.components.iter().enumerate() {
            check_numbers(&format!("components[{i}]"), row, n)?;
            for (j, other) in self.components[..=i].iter().enumerate() {
                let product: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
                let expected = if i == j { 1.0 } else { 0.0 };
                if (product - expected).abs() > ORTHONORMAL_TOLERANCE {
                    let name = format!("components[{i}] . components[{j}]");
                    return Err(SynergyError::invalid(name, format!("{expected} (orthonormal rows)"), product));
                }
            }
        }
        if let Some(i) = (0..n).find(|&i| self.eigenvalues[i] < 0.0) {
            return Err(SynergyError::invalid(format!("eigenvalues[{i}]"), "0 or more", self.eigenvalues[i]));
        }
        if let Some(i) = (1..n).find(|&i| self.eigenvalues[i] > self.eigenvalues[i - 1]) {
            let expected = format!("at most {}, the one before it", self.eigenvalues[i - 1]);
            return Err(SynergyError::invalid(format!("eigenvalues[{i}]"), expected, self.eigenvalues[i]));
        }
        if let Some(i) = (0..k).find(|&i| self.coefficient_min[i] > self.coefficient_max[i]) {
            let expected = format!("at most coefficient_max[{i}] = {}", self.coefficient_max[i]);
            return Err(SynergyError::invalid(format!("coefficient_min[{i}]"), expected, self.coefficient_min[i]));
        }
        Ok(())
    }
}

/// Checks that `values` are `expected` finite numbers.
pub(crate) fn check_numbers(name: &str, values: &[f64], expected: usize) -> Result<(), SynergyError> {
    if values.len() != expected {
        return Err(SynergyError::invalid(format!("length of {name}"), expected.to_string(), values.len()));
    }
    match values.iter().position(|value| !value.is_finite()) {
        Some(i) => Err(SynergyError::invalid(format!("{name}[{i}]"), "a finite number", values[i])),
        None => Ok(()),
    }
}
