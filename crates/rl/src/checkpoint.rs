//! The learner's whole state as named tensors.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::ddpg::Learned;
use crate::tensors::{Tensor, TensorMap};
use crate::{Ddpg, DdpgConfig, RlError, RunningNormalizer};

const SCHEMA: u64 = 1;

impl Ddpg {
    /// Returns networks, targets, optimisers and normalisers as named tensors. The configuration is not among them.
    pub fn to_tensors(&self) -> TensorMap {
        let mut tensors = TensorMap::default();
        tensors.insert("schema", Tensor::u64(SCHEMA));
        tensors.insert("n_updates", Tensor::u64(self.n_updates));
        for (name, learned) in self.learned() {
            tensors.insert_network(&name, &learned.online);
            tensors.insert_network(&format!("{name}_target"), &learned.target);
            tensors.insert_layers(&format!("{name}_adam.first_moment"), &learned.online, &learned.adam.first_moment);
            tensors.insert_layers(&format!("{name}_adam.second_moment"), &learned.online, &learned.adam.second_moment);
            tensors.insert(format!("{name}_adam.n_steps"), Tensor::u64(learned.adam.n_steps));
            let rate = Tensor::f32(vec![1], vec![learned.adam.learning_rate()]);
            tensors.insert(format!("{name}_adam.learning_rate"), rate);
        }
        tensors.insert_network("actor_average", &self.average);
        for (name, normalizer) in [("observation", &self.observation), ("goal", &self.goal)] {
            tensors.insert(format!("{name}.count"), Tensor::u64(normalizer.count));
            tensors.insert(format!("{name}.sum"), Tensor::f64(normalizer.sum.clone()));
            tensors.insert(format!("{name}.sum_of_squares"), Tensor::f64(normalizer.sum_of_squares.clone()));
        }
        tensors
    }

    /// Rebuilds a learner from the configuration and sizes it was made with and its tensors.
    ///
    /// # Errors
    /// As [`new`](Self::new); and an error that names the tensor when one is missing, unexpected, of another shape or type,
    /// or holds a value that no learner has.
    pub fn from_tensors(
        config: DdpgConfig,
        obs_dim: usize,
        goal_dim: usize,
        act_dim: usize,
        tensors: &TensorMap,
    ) -> Result<Self, RlError> {
        let schema = tensors.u64("schema")?;
        if schema != SCHEMA {
            return Err(value_error("schema", "1", schema));
        }
        // The drawn weights are all overwritten below.
        let mut learner = Self::new(config, obs_dim, goal_dim, act_dim, &mut ChaCha8Rng::seed_from_u64(0))?;
        let normalizer = learner.config.normalizer;
        let mut learned = vec![("actor".to_owned(), &mut learner.actor)];
        learned.extend(learner.critics.iter_mut().enumerate().map(|(i, c)| (critic_name(i), c)));
        for (name, network) in learned {
            read_learned(tensors, &name, network)?;
        }
        let layout = learner.average.clone();
        tensors.read_layers("actor_average", &layout, learner.average.parameters_mut())?;
        learner.n_updates = tensors.u64("n_updates")?;
        learner.observation = read_normalizer(tensors, "observation", normalizer, obs_dim)?;
        learner.goal = read_normalizer(tensors, "goal", normalizer, goal_dim)?;
        let expected = learner.to_tensors();
        match tensors.iter().find(|(name, _)| expected.get(name).is_err()) {
            Some((name, _)) => Err(RlError::TensorUnexpected { name: name.to_owned() }),
            None => Ok(learner),
        }
    }

    /// Returns [`to_tensors`](Self::to_tensors) in the safetensors format.
    ///
    /// # Errors
    /// As [`TensorMap::save_bytes`].
    pub fn save_bytes(&self) -> Result<Vec<u8>, RlError> {
        self.to_tensors().save_bytes()
    }

    /// Reads what [`save_bytes`](Self::save_bytes) wrote.
    ///
    /// # Errors
    /// As [`TensorMap::load_bytes`] and [`from_tensors`](Self::from_tensors).
    pub fn load_bytes(
        config: DdpgConfig,
        obs_dim: usize,
        goal_dim: usize,
        act_dim: usize,
        bytes: &[u8],
    ) -> Result<Self, RlError> {
        Self::from_tensors(config, obs_dim, goal_dim, act_dim, &TensorMap::load_bytes(bytes)?)
    }

    fn learned(&self) -> impl Iterator<Item = (String, &Learned)> {
        let critics = self.critics.iter().enumerate().map(|(i, c)| (critic_name(i), c));
        std::iter::once(("actor".to_owned(), &self.actor)).chain(critics)
    }
}

fn critic_name(index: usize) -> String {
    format!("critic{index}")
}

fn read_learned(tensors: &TensorMap, name: &str, learned: &mut Learned) -> Result<(), RlError> {
    let Learned { online, target, adam } = learned;
    let layout = online.clone();
    tensors.read_layers(name, &layout, online.parameters_mut())?;
    tensors.read_layers(&format!("{name}_target"), &layout, target.parameters_mut())?;
    tensors.read_layers(&format!("{name}_adam.first_moment"), &layout, &mut adam.first_moment)?;
    tensors.read_layers(&format!("{name}_adam.second_moment"), &layout, &mut adam.second_moment)?;
    adam.n_steps = tensors.u64(&format!("{name}_adam.n_steps"))?;
    adam.set_learning_rate(tensors.f32s(&format!("{name}_adam.learning_rate"), &[1])?[0]);
    Ok(())
}

fn read_normalizer(
    tensors: &TensorMap,
    name: &str,
    config: crate::NormalizerConfig,
    dim: usize,
) -> Result<RunningNormalizer, RlError> {
    let count = tensors.u64(&format!("{name}.count"))?;
    let sum = tensors.f64s(&format!("{name}.sum"), &[dim])?.to_vec();
    let squares = tensors.f64s(&format!("{name}.sum_of_squares"), &[dim])?.to_vec();
    Ok(RunningNormalizer::from_sums(config, count, sum, squares))
}

fn value_error(name: &str, expected: &'static str, got: impl ToString) -> RlError {
    RlError::TensorValue { name: name.to_owned(), expected, got: got.to_string() }
}
