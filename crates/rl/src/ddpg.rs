//! Deep deterministic policy gradient: two networks, their slow targets, and one update.

use rand::Rng;

use crate::adam::{Adam, Follow};
use crate::config::ACTION_L2_DIMENSIONS;
use crate::matrix::{Aligned, zeros};
use crate::net::{InputGradient, MlpScratch, OutputActivation, Rows};
use crate::numbers::{pull_back, write_actions};
use crate::{
    ActorChoice, Batch, DdpgConfig, EpisodeShape, Mlp, Numbers, Policy, RlError, RunningNormalizer, elementwise,
};

/// A network, the target that follows it, and its optimiser.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Learned {
    pub online: Mlp,
    pub target: Mlp,
    pub adam: Adam,
}

impl Learned {
    fn new(online: Mlp, learning_rate: f32) -> Self {
        let adam = Adam::new(learning_rate, online.parameters().len());
        Self { target: online.clone(), online, adam }
    }

    /// Descends along the gradient. With `tau` the target follows in the same pass.
    fn step(&mut self, gradient: &[f32], tau: Option<f32>) {
        let follow = tau.map(|tau| Follow { target: self.target.parameters_mut(), tau });
        self.adam.step(self.online.parameters_mut(), gradient, follow);
    }
}

/// The logged numbers of one update.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpdateStats {
    /// Mean squared difference of the critic's values and the targets.
    pub critic_loss: f32,
    /// Loss of the actor.
    pub actor_loss: f32,
    /// Mean value that the critic gives the batch's actions.
    pub q_mean: f32,
    /// Mean target.
    pub target_mean: f32,
    /// Share of targets that were clipped.
    pub clipped_share: f32,
    /// Mean square of the actor's actions.
    pub action_square_mean: f32,
}

/// Factor between the largest absolute value that a clipped target can have and values that no critic learns from such
/// targets.
const ABSURD: f32 = 10.0;

impl UpdateStats {
    /// Returns whether every number is finite.
    pub fn is_finite(&self) -> bool {
        let Self { critic_loss, actor_loss, q_mean, target_mean, clipped_share, action_square_mean } = *self;
        [critic_loss, actor_loss, q_mean, target_mean, clipped_share, action_square_mean]
            .into_iter()
            .all(f32::is_finite)
    }

    /// Returns whether learning has diverged: a number is not finite, or the critic's values are far beyond every value
    /// that a clipped target can have. With layer normalisation values can be absurd and yet stay finite.
    pub fn has_diverged(&self, config: &DdpgConfig) -> bool {
        let most = ABSURD * config.least_target().abs();
        let absurd = self.q_mean.abs() > most || self.critic_loss > most * most;
        !self.is_finite() || (config.clip_targets && absurd)
    }
}

/// Sizes of a learner's inputs and outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dimensions {
    /// Numbers in an observation.
    pub obs_dim: usize,
    /// Numbers in a goal.
    pub goal_dim: usize,
    /// Numbers in an action.
    pub act_dim: usize,
    /// Outputs of the actor. If they are not the actions, the learner needs [`Numbers`].
    pub n_outputs: usize,
    /// Whether actor and critic are told through how many numbers the actor acts, see [`Numbers`].
    pub told_numbers: bool,
}

impl Dimensions {
    /// Returns the sizes for episodes of a shape, with an actor whose outputs are the actions.
    pub fn of(shape: EpisodeShape) -> Self {
        let EpisodeShape { obs_dim, goal_dim, act_dim, .. } = shape;
        Self { obs_dim, goal_dim, act_dim, n_outputs: act_dim, told_numbers: false }
    }
}

/// The learner: actor and critic, their targets and optimisers, and the normalisers of their inputs.
///
/// The actor reads the normalised observation and the normalised goal, and perhaps how many [`Numbers`] it has. The critic
/// reads the same and then the action. An episode ends at a time limit and never in a terminal state, so every target
/// includes the value of the next state.
///
/// # Source
/// Lillicrap et al. 2016, algorithm 1, with the losses of OpenAI baselines HER.
#[derive(Clone, Debug)]
pub struct Ddpg {
    pub(crate) config: DdpgConfig,
    pub(crate) actor: Learned,
    /// Slow average of the actor. Nothing is learned from it.
    pub(crate) average: Mlp,
    pub(crate) critic: Learned,
    pub(crate) observation: RunningNormalizer,
    pub(crate) goal: RunningNormalizer,
    pub(crate) n_updates: u64,
    /// The first is the policy's; the rows of a batch take turns. Empty: the actor's outputs are the actions.
    numbers: Vec<Numbers>,
    act_dim: usize,
    told_numbers: bool,
    scratch: Scratch,
}

/// Everything that an update writes besides the networks. It is allocated once.
#[derive(Clone, Debug)]
struct Scratch {
    /// Rows of normalised observation, normalised goal, perhaps how many numbers there are, and action. The actor reads all
    /// but the action.
    input: Aligned,
    next_input: Aligned,
    targets: Vec<f32>,
    value_gradient: Vec<f32>,
    action_gradient: Vec<f32>,
    /// By the actor's outputs, where these are not the actions.
    output_gradient: Vec<f32>,
    actor: MlpScratch,
    critic: MlpScratch,
    actor_gradient: Aligned,
    critic_gradient: Aligned,
}

impl Ddpg {
    /// Makes a learner with fresh networks.
    ///
    /// # Errors
    /// [`RlError::Config`] if a constant is out of range or a size is 0.
    pub fn new(config: DdpgConfig, dimensions: Dimensions, rng: &mut impl Rng) -> Result<Self, RlError> {
        config.validate()?;
        let Dimensions { obs_dim, goal_dim, act_dim, n_outputs, told_numbers } = dimensions;
        for (field, n) in [("obs_dim", obs_dim), ("goal_dim", goal_dim), ("act_dim", act_dim), ("n_outputs", n_outputs)]
        {
            if n == 0 {
                return Err(RlError::Config { field, expected: "at least 1", got: n.to_string() });
            }
        }
        let state = obs_dim + goal_dim + usize::from(told_numbers);
        let sizes = |inputs, outputs| -> Vec<usize> {
            std::iter::once(inputs).chain(config.hidden.iter().copied()).chain([outputs]).collect()
        };
        let actor = Mlp::new(&sizes(state, n_outputs), OutputActivation::Tanh, rng);
        let mut critic = Mlp::new(&sizes(state + act_dim, 1), OutputActivation::Linear, rng);
        if config.critic_layer_norm {
            critic = critic.with_layer_norm();
        }
        let batch = config.batch_size;
        let scratch = Scratch {
            input: zeros(batch * (state + act_dim)),
            next_input: zeros(batch * (state + act_dim)),
            targets: vec![0.0; batch],
            value_gradient: vec![0.0; batch],
            action_gradient: vec![0.0; batch * act_dim],
            output_gradient: vec![0.0; batch * n_outputs],
            actor: actor.scratch(batch),
            critic: critic.scratch(batch),
            actor_gradient: zeros(actor.parameters().len()),
            critic_gradient: zeros(critic.parameters().len()),
        };
        Ok(Self {
            average: actor.clone(),
            actor: Learned::new(actor, config.actor_lr),
            critic: Learned::new(critic, config.critic_lr),
            observation: RunningNormalizer::new(config.normalizer, obs_dim),
            goal: RunningNormalizer::new(config.normalizer, goal_dim),
            n_updates: 0,
            numbers: Vec::new(),
            act_dim,
            told_numbers,
            scratch,
            config,
        })
    }

    /// Returns a learner with fresh networks of other sizes, which keeps the configuration and the statistics of the inputs.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn begin_anew(&self, dimensions: Dimensions, rng: &mut impl Rng) -> Result<Self, RlError> {
        let (observation, goal) = (self.observation.clone(), self.goal.clone());
        Ok(Self { observation, goal, ..Self::new(self.config.clone(), dimensions, rng)? })
    }

    /// Returns the learner as at its start but for its networks and the statistics of its inputs: for the same networks in
    /// another task.
    pub fn with_fresh_optimisers(mut self) -> Self {
        let fresh = |learned: &Learned, rate| Adam::new(rate, learned.online.parameters().len());
        self.actor.adam = fresh(&self.actor, self.config.actor_lr);
        self.critic.adam = fresh(&self.critic, self.config.critic_lr);
        self.n_updates = 0;
        self
    }

    /// Adds rows to the statistics of the inputs.
    ///
    /// # Shapes
    /// `observations`: rows of obs_dim. `goals`: rows of goal_dim. The two may differ in their number of rows.
    ///
    /// # Panics
    /// If a slice does not hold whole rows.
    pub fn update_normalizers(&mut self, observations: &[f32], goals: &[f32]) {
        self.observation.update(observations);
        self.goal.update(goals);
    }

    /// Learns once from a batch. The critic descends towards its targets, then the actor ascends the critic's value. Each
    /// target network follows its network, and the averaged actor follows the actor.
    ///
    /// The threads of the rayon pool in which it is called (`rayon::ThreadPool::install`, or the global one) share the
    /// matrix products. The result does not depend on their number.
    ///
    /// # Panics
    /// If the batch has other sizes than the configuration and [`new`](Self::new) were given.
    pub fn update(&mut self, batch: &Batch) -> UpdateStats {
        self.n_updates += 1;
        let tau = self.n_updates.is_multiple_of(self.config.target_update_every).then_some(self.config.tau);
        self.fill_inputs(batch);
        let (target_mean, clipped_share) = self.compute_targets(&batch.rewards);
        let (critic_loss, q_mean) = self.update_critic(tau);
        let (actor_loss, action_square_mean) = self.update_actor(tau);
        let share = self.config.average_share(self.n_updates);
        elementwise::polyak(share, self.actor.online.parameters(), self.average.parameters_mut());
        UpdateStats { critic_loss, actor_loss, q_mean, target_mean, clipped_share, action_square_mean }
    }

    /// Copies an actor and the normalisers, to collect episodes with them.
    pub fn policy(&self, choice: ActorChoice) -> Policy {
        let actor = match choice {
            ActorChoice::Online => &self.actor.online,
            ActorChoice::Target => &self.actor.target,
            ActorChoice::Average => &self.average,
        };
        let map = self.numbers.first().map(|numbers| numbers.map.clone());
        let (actor, told) = if self.told_numbers { actor.without_last_input() } else { (actor.clone(), Vec::new()) };
        // Before there are fewer numbers, these weights are those of the first network.
        let told = if self.numbers.iter().any(|numbers| numbers.fewer.is_some()) { told } else { Vec::new() };
        Policy::new(actor, told, self.observation.clone(), self.goal.clone(), map)
    }

    /// Sets the learning rates of the following updates.
    pub fn set_learning_rates(&mut self, actor: f32, critic: f32) {
        self.actor.adam.set_learning_rate(actor);
        self.critic.adam.set_learning_rate(critic);
    }

    /// Sets the maps from the actor's outputs to actions, for the following updates and policies; without a map, the outputs
    /// are the actions. The first is that of [`policy`](Self::policy). The rows of a batch take turns with all of them:
    /// the actor learns to act through each. A checkpoint does not hold the maps.
    ///
    /// # Panics
    /// If a map has other sizes than the learner.
    pub fn set_numbers(&mut self, numbers: Vec<Numbers>) {
        let outputs = self.actor.online.outputs();
        let fits = |of: &Numbers| (of.map.n_outputs(), of.map.n_actions()) == (outputs, self.act_dim);
        let fit = if numbers.is_empty() { outputs == self.act_dim } else { numbers.iter().all(fits) };
        assert!(fit, "a map has other sizes");
        self.numbers = numbers;
    }

    /// Returns what [`set_numbers`](Self::set_numbers) set.
    pub fn numbers(&self) -> &[Numbers] {
        &self.numbers
    }

    fn act_dim(&self) -> usize {
        self.act_dim
    }

    fn fill_inputs(&mut self, batch: &Batch) {
        let (obs_dim, goal_dim, act_dim) = (self.observation.dim(), self.goal.dim(), self.act_dim());
        let state = obs_dim + goal_dim + usize::from(self.told_numbers);
        let n = self.config.batch_size;
        assert_eq!(batch.len, n, "the batch is not of the configured size");
        let lengths = [batch.observations.len(), batch.next_observations.len(), batch.goals.len(), batch.actions.len()];
        assert_eq!(lengths, [n * obs_dim, n * obs_dim, n * goal_dim, n * act_dim], "the batch has other dimensions");
        let Scratch { input, next_input, .. } = &mut self.scratch;
        let rows = input.chunks_exact_mut(state + act_dim).zip(next_input.chunks_exact_mut(state + act_dim));
        for (i, (row, next)) in rows.enumerate() {
            let goal = &batch.goals[i * goal_dim..][..goal_dim];
            self.observation.normalize(&batch.observations[i * obs_dim..][..obs_dim], &mut row[..obs_dim]);
            self.observation.normalize(&batch.next_observations[i * obs_dim..][..obs_dim], &mut next[..obs_dim]);
            self.goal.normalize(goal, &mut row[obs_dim..obs_dim + goal_dim]);
            if self.told_numbers {
                let fewer = i.checked_rem(self.numbers.len()).and_then(|turn| self.numbers[turn].fewer);
                row[state - 1] = Numbers::told(fewer);
            }
            next[obs_dim..state].copy_from_slice(&row[obs_dim..state]);
            row[state..].copy_from_slice(&batch.actions[i * act_dim..][..act_dim]);
        }
    }

    /// Fills `targets`. Returns their mean and the share that was clipped.
    fn compute_targets(&mut self, rewards: &[f32]) -> (f32, f32) {
        let act_dim = self.act_dim();
        let Scratch { next_input, targets, actor, critic, .. } = &mut self.scratch;
        let stride = next_input.len() / targets.len();
        let outputs = self.actor.target.forward(Rows { data: next_input, stride }, actor);
        write_actions(next_input, stride, outputs, act_dim, &self.numbers);
        let values = self.critic.target.forward(Rows { data: next_input, stride }, critic);
        let least = self.config.least_target();
        let (mut sum, mut n_clipped) = (0.0, 0u32);
        for ((target, value), reward) in targets.iter_mut().zip(values).zip(rewards) {
            *target = reward + self.config.gamma * value;
            if self.config.clip_targets {
                let clipped = target.clamp(least, 0.0);
                n_clipped += u32::from(clipped != *target);
                *target = clipped;
            }
            sum += *target;
        }
        let n = targets.len() as f32;
        (sum / n, n_clipped as f32 / n)
    }

    /// Returns the loss and the mean value.
    fn update_critic(&mut self, tau: Option<f32>) -> (f32, f32) {
        let Scratch { input, targets, value_gradient, critic: scratch, critic_gradient, .. } = &mut self.scratch;
        let n = targets.len() as f32;
        let x = Rows { data: input, stride: input.len() / targets.len() };
        let values = self.critic.online.forward(x, scratch);
        let (mut loss, mut sum) = (0.0, 0.0);
        for ((gradient, value), target) in value_gradient.iter_mut().zip(values).zip(targets.iter()) {
            let difference = value - target;
            *gradient = 2.0 * difference / n;
            loss += difference * difference;
            sum += value;
        }
        self.critic.online.backward(x, value_gradient, scratch, Some(critic_gradient), None);
        self.critic.step(critic_gradient, tau);
        (loss / n, sum / n)
    }

    /// Returns the loss and the mean square of the actions.
    fn update_actor(&mut self, tau: Option<f32>) -> (f32, f32) {
        let act_dim = self.act_dim();
        let Scratch { input, value_gradient, action_gradient, output_gradient, actor, critic, actor_gradient, .. } =
            &mut self.scratch;
        let n = value_gradient.len();
        let stride = input.len() / n;
        let actions = self.actor.online.forward(Rows { data: input, stride }, actor);
        write_actions(input, stride, actions, act_dim, &self.numbers);
        let square_mean = elementwise::dot(actions, actions) / actions.len() as f32;
        let l2 = action_l2(&self.config, actions.len() / n);

        let x = Rows { data: input, stride };
        let value_mean = self.critic.online.forward(x, critic).iter().sum::<f32>() / n as f32;
        value_gradient.fill(-1.0 / n as f32);
        let wanted = InputGradient { first: stride - act_dim, out: action_gradient };
        self.critic.online.backward(x, value_gradient, critic, None, Some(wanted));

        let by_output = if self.numbers.is_empty() {
            &mut *action_gradient
        } else {
            pull_back(&self.numbers, input, stride, action_gradient, output_gradient);
            &mut *output_gradient
        };
        let slope = 2.0 * l2 / by_output.len() as f32;
        by_output.iter_mut().zip(actor.output()).for_each(|(g, a)| *g += slope * a);
        self.actor.online.backward(x, by_output, actor, Some(actor_gradient), None);
        self.actor.step(actor_gradient, tau);
        (l2 * square_mean - value_mean, square_mean)
    }
}

/// Returns the factor on the mean square of the actions. With few actions, each is a larger part of that mean than in the
/// hand for which the factor was chosen. It would then outweigh the value, which says little at first.
fn action_l2(config: &DdpgConfig, act_dim: usize) -> f32 {
    config.action_l2 * (act_dim as f32 / ACTION_L2_DIMENSIONS).min(1.0)
}
