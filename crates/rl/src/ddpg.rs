//! Deep deterministic policy gradient: two networks, their slow targets, and one update.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use crate::adam::Follow;
use crate::aligned::Aligned;
use crate::config::ACTION_L2_DIMENSIONS;
use crate::net::{InputGradient, MlpScratch, OutputActivation, Rows};
use crate::{
    ActionCost, Adam, AdamConfig, Batch, DdpgConfig, Mlp, Policy, RlError, RunningNormalizer, Which, elementwise,
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
        let adam = Adam::new(AdamConfig::default(), learning_rate, online.parameters().len());
        Self { target: online.clone(), online, adam }
    }

    /// Descends, and lets the target follow when `tau` is given.
    fn step(&mut self, gradient: &[f32], tau: Option<f32>) {
        let follow = tau.map(|tau| Follow { target: self.target.parameters_mut(), tau });
        self.adam.step(self.online.parameters_mut(), gradient, follow);
    }

    fn follow(&mut self, tau: Option<f32>) {
        if let Some(tau) = tau {
            elementwise::polyak(tau, self.online.parameters(), self.target.parameters_mut());
        }
    }
}

/// What one update did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpdateStats {
    /// Mean squared difference of the first critic's values and the targets.
    pub critic_loss: f32,
    /// The actor's loss, `None` when the actor was not updated.
    pub actor_loss: Option<f32>,
    /// Mean value of the batch's actions by the first critic.
    pub q_mean: f32,
    /// Mean target.
    pub target_mean: f32,
    /// Share of targets that were clipped.
    pub clipped_share: f32,
    /// Mean square of the actor's actions, `None` when the actor was not updated.
    pub action_square_mean: Option<f32>,
}

impl UpdateStats {
    /// Returns whether every number is finite; if not, learning has diverged.
    pub fn is_finite(&self) -> bool {
        let always = [self.critic_loss, self.q_mean, self.target_mean];
        always.into_iter().chain(self.actor_loss).chain(self.action_square_mean).all(f32::is_finite)
    }
}

/// The learner: actor, one or two critics, their targets and optimisers, and the normalisers of their inputs.
///
/// The actor reads normalised observation and normalised goal; the critic reads the action after them. An episode's end
/// is a time limit and never a terminal state, so every target looks ahead to the next state's value.
///
/// # Source
/// Lillicrap et al. 2016, algorithm 1, with the losses of OpenAI baselines HER.
#[derive(Clone, Debug)]
pub struct Ddpg {
    pub(crate) config: DdpgConfig,
    pub(crate) actor: Learned,
    /// Slow average of the actor, which nothing is learned from.
    pub(crate) average: Mlp,
    pub(crate) critics: Vec<Learned>,
    pub(crate) observation: RunningNormalizer,
    pub(crate) goal: RunningNormalizer,
    pub(crate) n_updates: u64,
    action_cost: Option<ActionCost>,
    scratch: Scratch,
}

/// Everything an update writes to besides the networks, sized once.
#[derive(Clone, Debug)]
struct Scratch {
    /// Normalised observation, normalised goal and action, batch x (all three); the actor reads the front of each row.
    input: Aligned,
    next_input: Aligned,
    targets: Vec<f32>,
    value_gradient: Vec<f32>,
    action_gradient: Vec<f32>,
    /// For [`ActionCost`], 2 x act_dim.
    deviations: Vec<f32>,
    actor: MlpScratch,
    critic: MlpScratch,
    actor_gradient: Aligned,
    critic_gradient: Aligned,
}

impl Ddpg {
    /// Makes a learner with fresh networks.
    ///
    /// # Errors
    /// [`RlError::Config`] when a constant is out of range or a size is 0.
    pub fn new(
        config: DdpgConfig,
        obs_dim: usize,
        goal_dim: usize,
        act_dim: usize,
        rng: &mut impl Rng,
    ) -> Result<Self, RlError> {
        config.validate()?;
        for (field, n) in [("obs_dim", obs_dim), ("goal_dim", goal_dim), ("act_dim", act_dim)] {
            if n == 0 {
                return Err(RlError::Config { field, expected: "at least 1", got: n.to_string() });
            }
        }
        let state = obs_dim + goal_dim;
        let sizes = |inputs, outputs| -> Vec<usize> {
            std::iter::once(inputs).chain(config.hidden.iter().copied()).chain([outputs]).collect()
        };
        let actor = Mlp::new(&sizes(state, act_dim), OutputActivation::Tanh, rng);
        let n_critics = if config.twin_critics { 2 } else { 1 };
        let critics: Vec<Learned> = (0..n_critics)
            .map(|_| Mlp::new(&sizes(state + act_dim, 1), OutputActivation::Linear, rng))
            .map(|net| if config.critic_layer_norm { net.with_layer_norm() } else { net })
            .map(|net| Learned::new(net, config.critic_lr))
            .collect();
        let batch = config.batch_size;
        let scratch = Scratch {
            input: Aligned::zeros(batch * (state + act_dim)),
            next_input: Aligned::zeros(batch * (state + act_dim)),
            targets: vec![0.0; batch],
            value_gradient: vec![0.0; batch],
            action_gradient: vec![0.0; batch * act_dim],
            deviations: vec![0.0; 2 * act_dim],
            actor: actor.scratch(batch),
            critic: critics[0].online.scratch(batch),
            actor_gradient: Aligned::zeros(actor.parameters().len()),
            critic_gradient: Aligned::zeros(critics[0].online.parameters().len()),
        };
        Ok(Self {
            average: actor.clone(),
            actor: Learned::new(actor, config.actor_lr),
            critics,
            observation: RunningNormalizer::new(config.normalizer, obs_dim),
            goal: RunningNormalizer::new(config.normalizer, goal_dim),
            n_updates: 0,
            action_cost: None,
            scratch,
            config,
        })
    }

    /// Takes rows into the statistics of the inputs.
    ///
    /// # Shapes
    /// `observations`: rows of obs_dim. `goals`: rows of goal_dim; the numbers of rows need not be equal.
    ///
    /// # Panics
    /// When a slice does not hold whole rows.
    pub fn update_normalizers(&mut self, observations: &[f32], goals: &[f32]) {
        self.observation.update(observations);
        self.goal.update(goals);
    }

    /// Learns once from a batch: the critics towards their targets, then the actor along the first critic, then the
    /// targets. `rng` is drawn from only when `target_smoothing` is above 0.
    ///
    /// The threads of the pool that it is called in (`rayon::ThreadPool::install`, or the global one) share the matrix
    /// products. The result does not depend on their number.
    ///
    /// # Panics
    /// When the batch has other sizes than the configuration and [`new`](Self::new) were given.
    pub fn update(&mut self, batch: &Batch, rng: &mut impl Rng) -> UpdateStats {
        let n_updates = self.n_updates + 1;
        let tau = n_updates.is_multiple_of(self.config.target_update_every).then_some(self.config.tau);
        let update_actor = n_updates.is_multiple_of(self.config.actor_delay);

        self.fill_inputs(batch);
        let (target_mean, clipped_share) = self.compute_targets(batch, rng);
        let (critic_loss, q_mean) = self.update_critics(tau);
        let (actor_loss, action_square_mean) = if update_actor {
            let (loss, square) = self.update_actor(tau, &batch.rewards);
            (Some(loss), Some(square))
        } else {
            self.actor.follow(tau);
            (None, None)
        };
        let share = self.config.average_share(n_updates);
        elementwise::polyak(share, self.actor.online.parameters(), self.average.parameters_mut());
        self.n_updates = n_updates;
        UpdateStats { critic_loss, actor_loss, q_mean, target_mean, clipped_share, action_square_mean }
    }

    /// Takes a snapshot for collecting episodes.
    pub fn policy(&self, which: Which) -> Policy {
        let actor = match which {
            Which::Online => &self.actor.online,
            Which::Target => &self.actor.target,
            Which::Average => &self.average,
        };
        Policy::new(actor.clone(), self.observation.clone(), self.goal.clone())
    }

    /// Sets the learning rates of the updates to come.
    pub fn set_learning_rates(&mut self, actor: f32, critic: f32) {
        self.actor.adam.set_learning_rate(actor);
        for c in &mut self.critics {
            c.adam.set_learning_rate(critic);
        }
    }

    /// Sets what the actor's actions cost besides `action_l2` in the updates to come. It is not part of a checkpoint.
    ///
    /// # Panics
    /// When it is a cost of actions of another size.
    pub fn set_action_cost(&mut self, cost: Option<ActionCost>) {
        assert!(cost.as_ref().is_none_or(|cost| cost.act_dim() == self.act_dim()), "the cost is of other actions");
        self.action_cost = cost;
    }

    /// Returns the number of updates so far.
    pub fn n_updates(&self) -> u64 {
        self.n_updates
    }

    /// Returns the constants.
    pub fn config(&self) -> &DdpgConfig {
        &self.config
    }

    /// Returns the statistics of the observations.
    pub fn observation_normalizer(&self) -> &RunningNormalizer {
        &self.observation
    }

    /// Returns the statistics of the goals.
    pub fn goal_normalizer(&self) -> &RunningNormalizer {
        &self.goal
    }

    /// Returns the number of values in an observation.
    pub fn obs_dim(&self) -> usize {
        self.observation.dim()
    }

    /// Returns the number of values in a goal.
    pub fn goal_dim(&self) -> usize {
        self.goal.dim()
    }

    /// Returns the number of values in an action.
    pub fn act_dim(&self) -> usize {
        self.actor.online.outputs()
    }

    fn fill_inputs(&mut self, batch: &Batch) {
        let (obs_dim, goal_dim, act_dim) = (self.obs_dim(), self.goal_dim(), self.act_dim());
        let state = obs_dim + goal_dim;
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
            self.goal.normalize(goal, &mut row[obs_dim..state]);
            next[obs_dim..state].copy_from_slice(&row[obs_dim..state]);
            row[state..].copy_from_slice(&batch.actions[i * act_dim..][..act_dim]);
        }
    }

    /// Fills `targets`; returns their mean and the share that was clipped.
    fn compute_targets(&mut self, batch: &Batch, rng: &mut impl Rng) -> (f32, f32) {
        let act_dim = self.act_dim();
        let Scratch { next_input, targets, actor, critic, .. } = &mut self.scratch;
        let stride = next_input.len() / targets.len();
        let actions = self.actor.target.forward(Rows { data: next_input, stride }, actor);
        write_actions(next_input, stride, actions, act_dim);
        if self.config.target_smoothing > 0.0 {
            let clip = self.config.target_smoothing_clip;
            for row in next_input.chunks_exact_mut(stride) {
                for a in &mut row[stride - act_dim..] {
                    let noise = self.config.target_smoothing * rng.sample::<f32, _>(StandardNormal);
                    *a = (*a + noise.clamp(-clip, clip)).clamp(-1.0, 1.0);
                }
            }
        }
        for (i, c) in self.critics.iter().enumerate() {
            let values = c.target.forward(Rows { data: next_input, stride }, critic);
            if i == 0 {
                targets.copy_from_slice(values);
            } else {
                targets.iter_mut().zip(values).for_each(|(t, v)| *t = if *v > *t { *t } else { *v });
            }
        }
        let least = self.config.least_target();
        let (mut sum, mut n_clipped) = (0.0, 0u32);
        for (target, reward) in targets.iter_mut().zip(&batch.rewards) {
            *target = reward + self.config.gamma * *target;
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

    /// Returns loss and mean value of the first critic.
    fn update_critics(&mut self, tau: Option<f32>) -> (f32, f32) {
        let Scratch { input, targets, value_gradient, critic: scratch, critic_gradient, .. } = &mut self.scratch;
        let n = targets.len() as f32;
        let x = Rows { data: input, stride: input.len() / targets.len() };
        let mut first = None;
        for critic in &mut self.critics {
            let values = critic.online.forward(x, scratch);
            let (mut loss, mut sum) = (0.0, 0.0);
            for ((gradient, value), target) in value_gradient.iter_mut().zip(values).zip(targets.iter()) {
                let difference = value - target;
                *gradient = 2.0 * difference / n;
                loss += difference * difference;
                sum += value;
            }
            first.get_or_insert((loss / n, sum / n));
            critic.online.backward(x, value_gradient, scratch, Some(critic_gradient), None);
            critic.step(critic_gradient, tau);
        }
        first.unwrap_or((0.0, 0.0))
    }

    /// Returns the loss and the mean square of the actions.
    fn update_actor(&mut self, tau: Option<f32>, rewards: &[f32]) -> (f32, f32) {
        let act_dim = self.act_dim();
        let Scratch { input, value_gradient, action_gradient, deviations, actor, critic, actor_gradient, .. } =
            &mut self.scratch;
        let n = value_gradient.len();
        let stride = input.len() / n;
        let actions = self.actor.online.forward(Rows { data: input, stride }, actor);
        write_actions(input, stride, actions, act_dim);
        let square_mean = elementwise::dot(actions, actions) / actions.len() as f32;
        let l2 = action_l2(&self.config, act_dim);

        let x = Rows { data: input, stride };
        let value_mean = self.critics[0].online.forward(x, critic).iter().sum::<f32>() / n as f32;
        value_gradient.fill(-1.0 / n as f32);
        let wanted = InputGradient { first: stride - act_dim, out: action_gradient };
        self.critics[0].online.backward(x, value_gradient, critic, None, Some(wanted));

        let slope = 2.0 * l2 / (n * act_dim) as f32;
        action_gradient.iter_mut().zip(actor.output()).for_each(|(g, a)| *g += slope * a);
        let cost = self
            .action_cost
            .as_ref()
            .map(|cost| cost.add_gradient(rewards, actor.output(), action_gradient, deviations));
        self.actor.online.backward(x, action_gradient, actor, Some(actor_gradient), None);
        self.actor.step(actor_gradient, tau);
        (l2 * square_mean - value_mean + cost.unwrap_or(0.0), square_mean)
    }
}

/// The factor on the mean square of the actions. Where there are few, each would count for more of that mean than where the
/// factor comes from, and would outweigh what little the value says at first.
fn action_l2(config: &DdpgConfig, act_dim: usize) -> f32 {
    config.action_l2 * (act_dim as f32 / ACTION_L2_DIMENSIONS).min(1.0)
}

fn write_actions(input: &mut [f32], stride: usize, actions: &[f32], act_dim: usize) {
    for (row, action) in input.chunks_exact_mut(stride).zip(actions.chunks_exact(act_dim)) {
        row[stride - act_dim..].copy_from_slice(action);
    }
}
