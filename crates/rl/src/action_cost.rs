//! A cost of actions that is known in closed form. The critic need not learn it.

/// The cost `(a - mean)^T matrix (a - mean)` of the actor's actions on the transitions of a batch that earned enough. `mean`
/// is the mean of these actions, so the cost penalises their variation and not their centre.
///
/// Its mean over the batch is added to the actor's loss. The critic does not know it.
#[derive(Clone, Debug, PartialEq)]
pub struct ActionCost {
    matrix: Vec<f32>,
    act_dim: usize,
    above: f32,
}

impl ActionCost {
    /// Makes a cost for the transitions whose reward is greater than `above`.
    ///
    /// # Shapes
    /// `matrix`: act_dim x act_dim, row-major and symmetric.
    ///
    /// # Panics
    /// If the matrix has another size.
    pub fn new(matrix: Vec<f32>, act_dim: usize, above: f32) -> Self {
        assert_eq!(matrix.len(), act_dim * act_dim, "the matrix is not act_dim x act_dim");
        Self { matrix, act_dim, above }
    }

    /// Returns the number of values in an action.
    pub fn act_dim(&self) -> usize {
        self.act_dim
    }

    /// Returns the cost of one action: `(deviation from the mean: act_dim) => cost`
    pub fn cost(&self, deviation: &[f32]) -> f32 {
        let rows = self.matrix.chunks_exact(self.act_dim).zip(deviation);
        rows.map(|(row, d)| d * row.iter().zip(deviation).map(|(m, d)| m * d).sum::<f32>()).sum()
    }

    /// Adds the gradient of a batch's mean cost and returns that mean.
    ///
    /// # Shapes
    /// `rewards`: one for each row. `actions` and `gradient`: rows of act_dim. `scratch`: 2 x act_dim, overwritten.
    pub(crate) fn add_gradient(
        &self,
        rewards: &[f32],
        actions: &[f32],
        gradient: &mut [f32],
        scratch: &mut [f32],
    ) -> f32 {
        let act_dim = self.act_dim;
        let (mean, deviation) = scratch.split_at_mut(act_dim);
        let earned = || rewards.iter().zip(actions.chunks_exact(act_dim)).filter(|(reward, _)| **reward > self.above);
        mean.fill(0.0);
        for (_, action) in earned() {
            mean.iter_mut().zip(action).for_each(|(sum, a)| *sum += a);
        }
        let n_earned = earned().count().max(1) as f32;
        mean.iter_mut().for_each(|sum| *sum /= n_earned);

        // The mean depends on the actions, but its part of the gradient is zero: the deviations from it sum to zero.
        let n = rewards.len() as f32;
        let mut sum = 0.0;
        let rows = rewards.iter().zip(actions.chunks_exact(act_dim)).zip(gradient.chunks_exact_mut(act_dim));
        for ((_, action), gradient) in rows.filter(|((reward, _), _)| **reward > self.above) {
            deviation.iter_mut().zip(action).zip(&*mean).for_each(|((d, a), m)| *d = a - m);
            for ((g, row), d) in gradient.iter_mut().zip(self.matrix.chunks_exact(act_dim)).zip(&*deviation) {
                let pull: f32 = row.iter().zip(&*deviation).map(|(m, d)| m * d).sum();
                *g += 2.0 * pull / n;
                sum += d * pull;
            }
        }
        sum / n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_is_that_of_the_mean_cost_of_the_rows_that_earned_enough() {
        let cost = ActionCost::new(vec![2.0, 0.5, 0.5, 1.0], 2, -1.0);
        let rewards = [0.0, -1.0, -0.5, -0.25];
        let actions = [0.5, 0.5, 1.0, -1.0, -0.75, 0.0, 0.25, -0.5];
        let mean_cost = |actions: &[f32]| {
            let mut unused = [0.0; 8];
            cost.add_gradient(&rewards, actions, &mut unused, &mut [0.0; 4])
        };
        let mut gradient = [1.0; 8];
        let found = cost.add_gradient(&rewards, &actions, &mut gradient, &mut [7.0; 4]);
        // The mean of the three rows is (0, 0), so that their costs are those of the actions themselves.
        assert_eq!(found, (1.0 + 1.125 + 0.25) / 4.0);
        assert_eq!(gradient[2..4], [1.0, 1.0]);
        for i in 0..8 {
            let moved = |by: f32| {
                let mut moved = actions;
                moved[i] += by;
                mean_cost(&moved)
            };
            let expected = 1.0 + (moved(0.125) - moved(-0.125)) / 0.25;
            assert!((gradient[i] - expected).abs() < 1e-5, "{i}: {} {expected}", gradient[i]);
        }
    }

    #[test]
    fn a_batch_in_which_nothing_was_earned_costs_nothing() {
        let cost = ActionCost::new(vec![1.0], 1, -1.0);
        let mut gradient = [0.5, 0.5];
        assert_eq!(cost.add_gradient(&[-1.0, -1.0], &[0.3, 0.9], &mut gradient, &mut [0.0; 2]), 0.0);
        assert_eq!(gradient, [0.5, 0.5]);
    }
}
