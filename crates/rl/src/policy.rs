//! A frozen actor with its normalisers, to collect episodes with.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::tensors::{Tensor, TensorMap};
use crate::{ActionMap, Mlp, NormalizerConfig, Numbers, OutputActivation, RlError, RunningNormalizer};

/// The choice among the learner's actors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ActorChoice {
    /// The actor that is trained.
    Online,
    /// Its target network, from which the critic's targets are computed.
    Target,
    /// Its average over many updates, which changes more slowly than the other two.
    Average,
}

/// A copy of an actor at one moment. Its clones share their weights.
#[derive(Clone, Debug)]
pub struct Policy {
    parts: Arc<Parts>,
}

#[derive(Debug)]
struct Parts {
    actor: Mlp,
    /// With what weights the units of the first layer read how many [`Numbers`](crate::Numbers) the policy has; empty for a
    /// policy that is not told.
    told: Vec<f32>,
    observation: RunningNormalizer,
    goal: RunningNormalizer,
    /// None: the outputs are the actions.
    map: Option<ActionMap>,
}

/// Buffers for the calls of [`Policy::act`] on one thread.
#[derive(Clone, Debug)]
pub struct PolicyScratch {
    input: Vec<f32>,
    hidden: [Vec<f32>; 2],
    output: Vec<f32>,
}

const TOLD: &str = "numbers.weight";
const MAP_MATRIX: &str = "action.matrix";
const MAP_OFFSET: &str = "action.offset";

impl Policy {
    pub(crate) fn new(
        actor: Mlp,
        told: Vec<f32>,
        observation: RunningNormalizer,
        goal: RunningNormalizer,
        map: Option<ActionMap>,
    ) -> Self {
        Self { parts: Arc::new(Parts { actor, told, observation, goal, map }) }
    }

    /// Returns this policy, but told that only the first `k` of its numbers are used. A policy that was not trained with
    /// fewer numbers stays as it is.
    pub fn with_fewer_numbers(&self, k: usize) -> Policy {
        self.told(k, self.map().cloned())
    }

    /// Returns this policy as it acts in the turn of `numbers`: if they are fewer, it is told so and acts through their map.
    ///
    /// # Panics
    /// If the map does not have the policy's outputs and actions.
    pub fn in_turn(&self, numbers: &Numbers) -> Policy {
        let Some(k) = numbers.fewer else { return self.clone() };
        let (found, expected) =
            ((numbers.map.n_outputs(), numbers.map.n_actions()), (self.n_outputs(), self.act_dim()));
        assert_eq!(found, expected, "outputs and actions of the map");
        self.told(k, Some(numbers.map.clone()))
    }

    /// Returns this policy, told that it has the first `k` numbers, with a map.
    fn told(&self, k: usize, map: Option<ActionMap>) -> Policy {
        let Parts { actor, told, observation, goal, .. } = &*self.parts;
        let share = Numbers::told(Some(k));
        let mut actor = actor.clone();
        let bias = actor.layers()[0].bias();
        actor.parameters_mut()[bias].iter_mut().zip(told).for_each(|(b, weight)| *b += weight * share);
        Policy::new(actor, Vec::new(), observation.clone(), goal.clone(), map)
    }

    /// Allocates buffers for [`act`](Self::act). They fit every policy of the same learner.
    pub fn scratch(&self) -> PolicyScratch {
        let actor = &self.parts.actor;
        let widest = actor.layers().iter().map(|l| l.outputs).max().unwrap_or(0);
        PolicyScratch {
            input: vec![0.0; actor.inputs()],
            hidden: [vec![0.0; widest], vec![0.0; widest]],
            output: vec![0.0; actor.outputs()],
        }
    }

    /// `(observation, goal) => action in [-1, 1]`, without exploration.
    ///
    /// # Panics
    /// If a length is not the learner's.
    pub fn act(&self, observation: &[f32], goal: &[f32], scratch: &mut PolicyScratch, action: &mut [f32]) {
        self.act_through(observation, goal, scratch, action, |_| {});
        action.iter_mut().for_each(|a| *a = a.clamp(-1.0, 1.0));
    }

    /// The same, but `explore` may change the actor's outputs before they are mapped to actions, and the actions are not
    /// clamped: those of a policy with an [`ActionMap`] can lie outside [-1, 1].
    ///
    /// # Panics
    /// If a length is not the learner's.
    pub fn act_through(
        &self,
        observation: &[f32],
        goal: &[f32],
        scratch: &mut PolicyScratch,
        action: &mut [f32],
        explore: impl FnOnce(&mut [f32]),
    ) {
        let Parts { actor, observation: observations, goal: goals, map, .. } = &*self.parts;
        let PolicyScratch { input, hidden: [a, b], output } = scratch;
        let (obs_in, goal_in) = input.split_at_mut(observations.dim());
        observations.normalize(observation, obs_in);
        goals.normalize(goal, goal_in);
        actor.forward_row(input, [a, b], output);
        explore(output);
        match map {
            Some(map) => map.apply(output, action),
            None => action.copy_from_slice(output),
        }
    }

    /// Returns the map from the actor's outputs to actions; none if they are the actions.
    pub fn map(&self) -> Option<&ActionMap> {
        self.parts.map.as_ref()
    }

    /// Returns the number of values in an observation.
    pub fn obs_dim(&self) -> usize {
        self.parts.observation.dim()
    }

    /// Returns the number of values in a goal.
    pub fn goal_dim(&self) -> usize {
        self.parts.goal.dim()
    }

    /// Returns the number of values in an action.
    pub fn act_dim(&self) -> usize {
        self.map().map_or(self.parts.actor.outputs(), ActionMap::n_actions)
    }

    /// Returns the number of the actor's outputs, which are the actions if there is no [`map`](Self::map).
    pub fn n_outputs(&self) -> usize {
        self.parts.actor.outputs()
    }

    /// Exports the tensors with which another program can run the policy: `actor.{i}.weight` (outputs x inputs, row-major),
    /// `actor.{i}.bias`, `mean` and `std` of `observation` and `goal`; `action.matrix` and `action.offset` of the
    /// [`ActionMap`], if there is one; and `numbers.weight`, if the policy was trained with fewer numbers too: with the first
    /// `k` of them, `numbers.weight / k` is added to `actor.0.bias`. The limits at which inputs are clipped are in
    /// [`NormalizerConfig`].
    pub fn export_tensors(&self) -> TensorMap {
        let Parts { actor, told, observation, goal, map } = &*self.parts;
        let mut tensors = TensorMap::default();
        tensors.insert_network("actor", actor);
        if !told.is_empty() {
            tensors.insert(TOLD, Tensor::f32(vec![told.len()], told.clone()));
        }
        for (name, normalizer) in [("observation", observation), ("goal", goal)] {
            tensors.insert(format!("{name}.mean"), Tensor::f32(vec![normalizer.dim()], normalizer.mean().to_vec()));
            tensors.insert(format!("{name}.std"), Tensor::f32(vec![normalizer.dim()], normalizer.std().to_vec()));
        }
        if let Some(map) = map {
            let shape = vec![map.n_actions(), map.n_outputs()];
            tensors.insert(MAP_MATRIX, Tensor::f32(shape, map.matrix().to_vec()));
            tensors.insert(MAP_OFFSET, Tensor::f32(vec![map.n_actions()], map.offset().to_vec()));
        }
        tensors
    }

    /// Reads the tensors that [`export_tensors`](Self::export_tensors) wrote. `config` holds the limits at which inputs are
    /// clipped.
    ///
    /// # Errors
    /// [`RlError`] names a tensor that is missing, is not expected, or has another shape.
    pub fn import_tensors(tensors: &TensorMap, config: &NormalizerConfig) -> Result<Self, RlError> {
        let normalizer = |name: &str| -> Result<RunningNormalizer, RlError> {
            let dim = tensors.get(&format!("{name}.mean"))?.shape.iter().product();
            let mean = tensors.f32s(&format!("{name}.mean"), &[dim])?.to_vec();
            let std = tensors.f32s(&format!("{name}.std"), &[dim])?.to_vec();
            Ok(RunningNormalizer::frozen(*config, mean, std))
        };
        let (observation, goal) = (normalizer("observation")?, normalizer("goal")?);
        let mut sizes = vec![observation.dim() + goal.dim()];
        let n_layers =
            tensors.iter().filter(|(name, _)| name.starts_with("actor.") && name.ends_with(".weight")).count();
        for i in 0..n_layers.max(1) {
            sizes.push(tensors.get(&format!("actor.{i}.bias"))?.shape.iter().product());
        }
        if sizes.contains(&0) {
            let (name, expected) = ("actor".to_owned(), "layers of at least one unit");
            return Err(RlError::TensorValue { name, expected, got: format!("{sizes:?}") });
        }
        let mut actor = Mlp::zeros(&sizes, OutputActivation::Tanh);
        tensors.read_network("actor", &mut actor)?;
        let told = match tensors.get(TOLD) {
            Err(_) => Vec::new(),
            Ok(_) => tensors.f32s(TOLD, &[sizes[1]])?.to_vec(),
        };
        let map = match tensors.get(MAP_MATRIX) {
            Err(_) => None,
            Ok(matrix) => {
                let n_outputs = actor.outputs();
                let n_actions = matrix.shape.first().copied().unwrap_or(0);
                let matrix = tensors.f32s(MAP_MATRIX, &[n_actions, n_outputs])?.to_vec();
                let offset = tensors.f32s(MAP_OFFSET, &[n_actions])?.to_vec();
                Some(ActionMap::new(matrix, offset, n_outputs)?)
            }
        };
        let policy = Self::new(actor, told, observation, goal, map);
        let written = policy.export_tensors();
        match tensors.iter().find(|(name, _)| written.get(name).is_err()) {
            Some((name, _)) => Err(RlError::TensorUnexpected { name: name.to_owned() }),
            None => Ok(policy),
        }
    }
}
