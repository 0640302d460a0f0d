//! A preference among actions that is known in closed form, and so need not be learned by a critic.

/// The cost `(a - centre)^T matrix (a - centre)` of the actor's actions, on the transitions that earned enough.
///
/// It is added to the actor's loss, averaged over the batch; the critic does not see it.
#[derive(Clone, Debug, PartialEq)]
pub struct ActionCost {
    matrix: Vec<f32>,
    centre: Vec<f32>,
    above: f32,
}

impl ActionCost {
    /// Makes a cost that holds for transitions whose reward is greater than `above`.
    ///
    /// # Shapes
    /// `matrix`: act_dim x act_dim, row-major and symmetric. `centre`: act_dim.
    ///
    /// # Panics
    /// When the matrix is not square, or not of the centre's size.
    pub fn new(matrix: Vec<f32>, centre: Vec<f32>, above: f32) -> Self {
        assert_eq!(matrix.len(), centre.len() * centre.len(), "the matrix is not act_dim x act_dim");
        Self { matrix, centre, above }
    }

    /// Returns the number of values in an action.
    pub fn act_dim(&self) -> usize {
        self.centre.len()
    }

    /// (action) => its cost
    pub fn cost(&self, action: &[f32]) -> f32 {
        (0..self.act_dim()).map(|i| (action[i] - self.centre[i]) * self.pull(i, action)).sum()
    }

    /// Adds the gradient of a batch's mean cost and returns that mean.
    ///
    /// # Shapes
    /// `rewards`: one a row. `actions` and `gradient`: rows of act_dim.
    pub(crate) fn add_gradient(&self, rewards: &[f32], actions: &[f32], gradient: &mut [f32]) -> f32 {
        let act_dim = self.act_dim();
        let scale = 2.0 / rewards.len() as f32;
        let mut sum = 0.0;
        let rows = rewards.iter().zip(actions.chunks_exact(act_dim)).zip(gradient.chunks_exact_mut(act_dim));
        for ((_, action), gradient) in rows.filter(|((reward, _), _)| **reward > self.above) {
            for (i, g) in gradient.iter_mut().enumerate() {
                let pull = self.pull(i, action);
                *g += scale * pull;
                sum += (action[i] - self.centre[i]) * pull;
            }
        }
        sum / rewards.len() as f32
    }

    /// One number of `matrix (a - centre)`.
    fn pull(&self, i: usize, action: &[f32]) -> f32 {
        let row = &self.matrix[i * self.act_dim()..][..self.act_dim()];
        row.iter().zip(action).zip(&self.centre).map(|((m, a), c)| m * (a - c)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_is_that_of_the_mean_cost_of_the_rows_that_earned_enough() {
        let cost = ActionCost::new(vec![2.0, 0.5, 0.5, 1.0], vec![0.25, -0.5], -1.0);
        let rewards = [0.0, -1.0, -0.5, -0.25];
        let actions = [0.5, 0.5, 1.0, -1.0, -0.75, 0.0, 0.25, -0.5];
        let mean = |actions: &[f32]| {
            let rows = actions.chunks_exact(2).zip(rewards).filter(|(_, reward)| *reward > -1.0);
            rows.map(|(action, _)| cost.cost(action)).sum::<f32>() / 4.0
        };
        let mut gradient = [1.0; 8];
        let found = cost.add_gradient(&rewards, &actions, &mut gradient);
        assert!((found - mean(&actions)).abs() < 1e-6);
        assert_eq!(cost.cost(&[0.25, -0.5]), 0.0);
        for i in 0..8 {
            let moved = |by: f32| {
                let mut moved = actions;
                moved[i] += by;
                mean(&moved)
            };
            let expected = 1.0 + (moved(0.125) - moved(-0.125)) / 0.25;
            assert!((gradient[i] - expected).abs() < 1e-5, "{i}: {} {expected}", gradient[i]);
        }
    }
}
