//! The learner's state as named tensors.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::ddpg::Learned;
use crate::tensors::{Tensor, TensorMap};
use crate::{Ddpg, DdpgConfig, Dimensions, RlError, RunningNormalizer};

const SCHEMA: u64 = 2;

impl Ddpg {
    /// Returns networks, targets, optimisers and normalisers as named tensors. They do not hold the configuration.
    pub fn to_tensors(&self) -> TensorMap {
        let mut tensors = TensorMap::default();
        tensors.insert("schema", Tensor::u64(SCHEMA));
        tensors.insert("n_updates", Tensor::u64(self.n_updates));
        for (name, learned) in [("actor", &self.actor), ("critic", &self.critic)] {
            tensors.insert_network(name, &learned.online);
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

    /// Rebuilds a learner from its tensors and from the configuration and sizes with which it was made.
    ///
    /// # Errors
    /// As [`new`](Self::new). Also an error that names a tensor if it is missing, is not expected, has another shape or
    /// type, or holds a value that no learner has.
    pub fn from_tensors(config: DdpgConfig, dimensions: Dimensions, tensors: &TensorMap) -> Result<Self, RlError> {
        let schema = tensors.u64("schema")?;
        if schema != SCHEMA {
            let (name, expected) = ("schema".to_owned(), "the schema of this version");
            return Err(RlError::TensorValue { name, expected, got: schema.to_string() });
        }
        // The lines below overwrite all weights that are drawn here.
        let mut learner = Self::new(config, dimensions, &mut ChaCha8Rng::seed_from_u64(0))?;
        let normalizer = learner.config.normalizer;
        read_learned(tensors, "actor", &mut learner.actor)?;
        read_learned(tensors, "critic", &mut learner.critic)?;
        tensors.read_network("actor_average", &mut learner.average)?;
        learner.n_updates = tensors.u64("n_updates")?;
        learner.observation = read_normalizer(tensors, "observation", normalizer, dimensions.obs_dim)?;
        learner.goal = read_normalizer(tensors, "goal", normalizer, dimensions.goal_dim)?;
        let expected = learner.to_tensors();
        match tensors.iter().find(|(name, _)| expected.get(name).is_err()) {
            Some((name, _)) => Err(RlError::TensorUnexpected { name: name.to_owned() }),
            None => Ok(learner),
        }
    }
}

fn read_learned(tensors: &TensorMap, name: &str, learned: &mut Learned) -> Result<(), RlError> {
    let Learned { online, target, adam } = learned;
    tensors.read_network(name, online)?;
    tensors.read_network(&format!("{name}_target"), target)?;
    tensors.read_layers(&format!("{name}_adam.first_moment"), online.layers(), &mut adam.first_moment)?;
    tensors.read_layers(&format!("{name}_adam.second_moment"), online.layers(), &mut adam.second_moment)?;
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
