//! The map from the actor's outputs to the actions that are executed.

use crate::RlError;

/// The affine map `action = clamp(matrix output + offset, -1, 1)` behind the actor's last layer.
///
/// With it, an actor can command fewer numbers than there are actions, or be confined to a subspace of them. Replay and
/// critic know the actions alone.
///
/// # Shapes
/// For `m` outputs and `n` actions: `matrix` n x m, `offset` n.
#[derive(Clone, Debug, PartialEq)]
pub struct ActionMap {
    matrix: Vec<f32>,
    offset: Vec<f32>,
    n_outputs: usize,
}

impl ActionMap {
    /// Makes a map from its matrix (row-major) and offset.
    ///
    /// # Errors
    /// [`RlError::Length`] if the matrix does not have `offset.len()` rows of `n_outputs` numbers, [`RlError::NotFinite`]
    /// for a number that is not finite.
    pub fn new(matrix: Vec<f32>, offset: Vec<f32>, n_outputs: usize) -> Result<Self, RlError> {
        let expected = offset.len() * n_outputs;
        if matrix.len() != expected {
            return Err(RlError::Length { name: "action map", expected, got: matrix.len() });
        }
        for (name, numbers) in [("action map", &matrix), ("offset of the action map", &offset)] {
            if let Some(index) = numbers.iter().position(|x| !x.is_finite()) {
                return Err(RlError::NotFinite { name, index, got: numbers[index] });
            }
        }
        Ok(Self { matrix, offset, n_outputs })
    }

    /// Returns the number of the actor's outputs.
    pub fn n_outputs(&self) -> usize {
        self.n_outputs
    }

    /// Returns the number of actions.
    pub fn n_actions(&self) -> usize {
        self.offset.len()
    }

    /// Returns the matrix, n x m, row-major.
    pub fn matrix(&self) -> &[f32] {
        &self.matrix
    }

    /// Returns the offset.
    pub fn offset(&self) -> &[f32] {
        &self.offset
    }

    /// `(output) => action` before it is clamped.
    ///
    /// # Panics
    /// If a length is not the map's.
    pub fn apply(&self, output: &[f32], action: &mut [f32]) {
        assert_eq!((output.len(), action.len()), (self.n_outputs, self.n_actions()), "outputs and actions of the map");
        for ((action, row), offset) in action.iter_mut().zip(self.matrix.chunks_exact(self.n_outputs)).zip(&self.offset)
        {
            *action = offset + row.iter().zip(output).map(|(m, o)| m * o).sum::<f32>();
        }
    }

    /// `(gradient by an action that was not clamped) => gradient by the output`
    pub(crate) fn pull_back(&self, by_action: &[f32], by_output: &mut [f32]) {
        by_output.fill(0.0);
        for (row, slope) in self.matrix.chunks_exact(self.n_outputs).zip(by_action) {
            by_output.iter_mut().zip(row).for_each(|(g, m)| *g += slope * m);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pull_back_is_the_transpose() {
        let map = ActionMap::new(vec![1.0, 2.0, 0.0, -1.0, 0.5, 3.0], vec![0.5, 0.0, -0.25], 2).unwrap();
        let mut action = [0.0; 3];
        map.apply(&[0.25, -0.5], &mut action);
        assert_eq!(action, [-0.25, 0.5, -1.625]);
        let mut by_output = [9.0; 2];
        map.pull_back(&[1.0, 2.0, -4.0], &mut by_output);
        assert_eq!(by_output, [-1.0, -12.0]);
    }

    #[test]
    fn a_matrix_of_another_size_or_with_a_number_that_is_not_finite_is_an_error() {
        assert!(ActionMap::new(vec![1.0; 5], vec![0.0; 3], 2).is_err());
        assert!(ActionMap::new(vec![1.0, f32::NAN], vec![0.0; 1], 2).is_err());
    }
}
