//! Finalists: the policies with the best evaluations. The best of them becomes the result.

use eigenhand_rl::Policy;

use crate::error::TrainError;

/// A policy whose evaluation was among the best.
#[derive(Clone, Debug)]
pub struct Finalist {
    /// Success rate of its evaluation.
    pub success_rate: f64,
    /// Training episodes before the evaluation.
    pub episode: u64,
    /// The policy.
    pub policy: Policy,
}

/// The finalists so far, the best first.
#[derive(Clone, Debug, Default)]
pub struct Finalists {
    best: Vec<Finalist>,
}

impl Finalists {
    /// Starts with the finalists of a checkpoint, the best first.
    pub fn new(best: Vec<Finalist>) -> Finalists {
        Finalists { best }
    }

    /// Adds a policy and keeps the best `most`. Of two policies with equal success, the later one ranks higher.
    pub fn enter(&mut self, finalist: Finalist, most: usize) {
        let place = self.best.partition_point(|known| known.success_rate > finalist.success_rate);
        self.best.insert(place, finalist);
        self.best.truncate(most);
    }

    /// Keeps the finalists for which `good` holds.
    pub fn retain(&mut self, good: impl FnMut(&Finalist) -> bool) {
        self.best.retain(good);
    }

    /// Returns all finalists, the best first.
    pub fn list(&self) -> &[Finalist] {
        &self.best
    }

    /// Measures the finalists again with `score`, and returns the one with the highest success rate; of equals, the
    /// first.
    ///
    /// The best of many noisy evaluations is partly luck, so the finalists are compared on further episodes. A single
    /// finalist needs no comparison.
    ///
    /// # Errors
    /// The errors of `score`.
    pub fn choose(
        &self,
        mut score: impl FnMut(&Finalist) -> Result<f64, TrainError>,
    ) -> Result<Option<&Finalist>, TrainError> {
        let mut chosen: Option<(f64, &Finalist)> = None;
        for finalist in &self.best {
            let rate = if self.best.len() > 1 { score(finalist)? } else { finalist.success_rate };
            if chosen.is_none_or(|(best, _)| rate > best) {
                chosen = Some((rate, finalist));
            }
        }
        Ok(chosen.map(|(_, finalist)| finalist))
    }
}

#[cfg(test)]
mod tests {
    use eigenhand_rl::{NormalizerConfig, Tensor, TensorMap};

    use super::*;

    fn finalist(episode: u64, success_rate: f64) -> Finalist {
        let mut tensors = TensorMap::default();
        for (name, shape) in [
            ("actor.0.weight", vec![1, 2]),
            ("actor.0.bias", vec![1]),
            ("observation.mean", vec![1]),
            ("observation.std", vec![1]),
            ("goal.mean", vec![1]),
            ("goal.std", vec![1]),
        ] {
            let length = shape.iter().product();
            tensors.insert(name, Tensor::f32(shape, vec![1.0; length]));
        }
        let normalizer = NormalizerConfig { epsilon: 0.01, norm_clip: 5.0, raw_clip: 200.0 };
        Finalist { success_rate, episode, policy: Policy::import_tensors(&tensors, &normalizer).expect("a policy") }
    }

    fn finalists(of: &[(u64, f64)], most: usize) -> Finalists {
        let mut all = Finalists::default();
        of.iter().for_each(|&(episode, rate)| all.enter(finalist(episode, rate), most));
        all
    }

    fn episodes(finalists: &Finalists) -> Vec<u64> {
        finalists.list().iter().map(|finalist| finalist.episode).collect()
    }

    #[test]
    fn the_best_are_kept_and_the_later_of_equals_comes_first() {
        let kept = finalists(&[(1, 0.5), (2, 0.9), (3, 0.1), (4, 0.9), (5, 0.6)], 3);
        assert_eq!(episodes(&kept), [4, 2, 5]);
        assert_eq!(episodes(&finalists(&[(1, 0.5)], 0)), [0; 0]);
    }

    #[test]
    fn the_second_look_decides() {
        let kept = finalists(&[(1, 0.5), (2, 0.9), (3, 0.8)], 5);
        let second = |scores: [f64; 3]| {
            let chosen = kept.choose(|finalist| Ok(scores[finalist.episode as usize - 1])).expect("no error");
            chosen.map(|finalist| finalist.episode)
        };
        assert_eq!(second([0.7, 0.6, 0.65]), Some(1));
        assert_eq!(second([0.6, 0.7, 0.7]), Some(2), "the first of equals");
        let single = finalists(&[(7, 0.2)], 5);
        let chosen = single.choose(|_| panic!("a single one is not compared")).expect("no error");
        assert_eq!(chosen.map(|finalist| finalist.episode), Some(7));
    }
}
