//! The training loop.
//!
//! In each cycle, the trainer stores the episodes that the workers have simulated, submits the next episodes with the
//! current policy, and learns while they run. So rollouts overlap with learning, and their policy is one cycle old.
//! Their results depend only on the seed and the configuration.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use eigenhand_rl::{ActorChoice, Batch, Ddpg, ExplorationConfig, Policy, Replay, rng, sample_batch};
use eigenhand_sim::GraspTask;
use eigenhand_synergy::Synergy;
use rayon::ThreadPool;

use crate::action_space::Outputs;
use crate::actuators::HandActuators;
use crate::assignment::Assignment;
use crate::checkpoint::{Checkpoints, Restored};
use crate::config::{EvaluationConfig, RunConfig, SynergyConfig};
use crate::control::Control;
use crate::counters::{Counters, UpdateSums};
use crate::drive::Driver;
use crate::error::TrainError;
use crate::evaluation::EvaluationStream;
use crate::exploration::exploration_of;
use crate::feedback::GraspReward;
use crate::finalists::{Finalist, Finalists};
use crate::journal::Journal;
use crate::metrics::{MetricsRow, TRUSTED};
use crate::motion::motions;
use crate::postures::Postures;
use crate::progress::{Progress, Status};
use crate::rollout::{Behaviour, Episode, EpisodeJob, WorkerPool, episode_shape};
use crate::schedule::turn;
use crate::threads::learning_threads;

/// A training run.
pub struct Trainer {
    pub(crate) assignment: Assignment,
    pub(crate) pool: WorkerPool,
    learning: ThreadPool,
    pub(crate) learner: Ddpg,
    pub(crate) replay: Replay,
    batch: Batch,
    pub(crate) reward: GraspReward,
    exploration: ExplorationConfig,
    pub(crate) postures: Postures,
    pub(crate) control: Control,
    checkpoints: Checkpoints,
    journal: Journal,
    pub(crate) counters: Counters,
    pub(crate) finalists: Finalists,
    /// Wall time of the run before this process resumed it, in s.
    wall_before: f64,
    started: Instant,
}

impl Trainer {
    /// Prepares a new run in a directory that [`RunDirectory::create`](crate::RunDirectory::create) made.
    ///
    /// # Errors
    /// The first fault of the configuration, the hand or the directory.
    pub fn create(assignment: Assignment) -> Result<Trainer, TrainError> {
        let Assignment { config, hand, task, run, .. } = &assignment;
        let control = Control::new(config, HandActuators::of(hand, task));
        let postures = Postures::open(run, config, task, &control.actuators)?;
        let outputs = outputs(&assignment, &control)?;
        let mut random = rng::stream(config.seed, "init", 0);
        let learner = Ddpg::new(config.learner.clone(), assignment.dimensions(outputs.as_ref()), &mut random)?;
        let checkpoints = Checkpoints::create(run.path(), config.training.checkpoints_kept)?;
        Trainer::assemble(assignment, learner, outputs, postures, control, checkpoints, Counters::default())
    }

    /// Continues the run in a directory from its newest checkpoint, as if it had not stopped.
    ///
    /// # Errors
    /// [`TrainError::Damaged`] for a damaged file of the checkpoint, and the errors of [`create`](Self::create).
    pub fn resume(assignment: Assignment) -> Result<Trainer, TrainError> {
        let Assignment { config, hand, task, run, .. } = &assignment;
        let (checkpoints, restored) =
            Checkpoints::open(run.path(), config.training.checkpoints_kept, &config.learner.normalizer)?;
        let Restored { counters, learner, finalists, episodes } = restored;
        let mut control = Control::new(config, HandActuators::of(hand, task));
        let mut postures = Postures::open(run, config, task, &control.actuators)?;
        control.add(postures.restore(run, counters.episodes, counters.postures)?);
        counters.settled_at.map_or(Ok(()), |episode| control.settle(episode))?;
        let outputs = outputs(&assignment, &control)?;
        let learner = Ddpg::from_tensors(config.learner.clone(), assignment.dimensions(outputs.as_ref()), &learner)?;
        let mut trainer = Trainer::assemble(assignment, learner, outputs, postures, control, checkpoints, counters)?;
        episodes.into_iter().try_for_each(|episode| trainer.replay.push(episode))?;
        trainer.finalists = Finalists::new(finalists);
        trainer.refit()?;
        Ok(trainer)
    }

    fn assemble(
        assignment: Assignment,
        mut learner: Ddpg,
        outputs: Option<Outputs>,
        postures: Postures,
        control: Control,
        checkpoints: Checkpoints,
        counters: Counters,
    ) -> Result<Trainer, TrainError> {
        let Assignment { config, provenance, hand, task, run, .. } = &assignment;
        let shape = episode_shape(task);
        let exploration = exploration_of(config, hand, task, outputs.as_ref())?;
        learner.set_numbers(outputs.map(|outputs| outputs.numbers).unwrap_or_default());
        Ok(Trainer {
            pool: WorkerPool::new(task, config.worker_count())?,
            learning: learning_threads(config.learner_thread_count())?,
            replay: Replay::new(config.training.replay_episodes, shape)?,
            batch: Batch::new(config.learner.batch_size, shape),
            reward: GraspReward {
                config: config.reward.clone(),
                n_joints: postures.joints().len(),
                feedback: config.feedback(),
            },
            postures,
            control,
            journal: Journal::open(run, config, provenance, counters.episodes)?,
            exploration,
            wall_before: counters.wall_s,
            counters,
            finalists: Finalists::default(),
            started: Instant::now(),
            assignment,
            learner,
            checkpoints,
        })
    }

    /// Trains until all episodes are done or `stop` is set.
    ///
    /// # Errors
    /// The error that stopped the run; the newest checkpoint stays valid.
    pub(crate) fn train(&mut self, stop: &AtomicBool, progress: &mut dyn Progress) -> Result<(), TrainError> {
        self.started = Instant::now();
        let mut saved_at = self.counters.episodes;
        progress.update(&self.status(0.0));
        if self.counters.episodes == 0 {
            // With this checkpoint, a run that is killed early can be resumed too.
            self.save()?;
        }
        let mut submitted = self.submit(self.counters.episodes)?;
        // A checkpoint holds a cycle's episodes but not yet the updates for them, so a resumed run starts with these.
        self.learn()?;
        let RunConfig { training, evaluation, episodes: total, .. } = &self.assignment.config;
        let (total, evaluate_every, save_every) = (*total, evaluation.every, training.checkpoint_every);
        while self.counters.episodes < total {
            let (cycle_started, first_step) = (Instant::now(), self.counters.env_steps);
            let episodes = self.pool.collect()?;
            let previous = self.counters.episodes;
            self.store(episodes)?;
            self.settle(previous, progress)?;
            self.counters.wall_s = self.wall_s();
            let done = self.counters.episodes;
            let crossed = |every: u64| previous / every != done / every || done == total;
            if crossed(evaluate_every) {
                self.evaluate(progress)?;
            }
            let interrupted = stop.load(Ordering::Relaxed);
            if crossed(save_every) || interrupted {
                self.save()?;
                saved_at = done;
            }
            if interrupted {
                progress.note("interrupted: everything is saved");
                break;
            }
            submitted = self.submit(submitted)?;
            self.learn()?;
            let seconds = cycle_started.elapsed().as_secs_f64();
            progress.update(&self.status((self.counters.env_steps - first_step) as f64 / seconds));
        }
        if saved_at != self.counters.episodes {
            self.save()?;
        }
        Ok(())
    }

    /// Submits the next cycle's episodes to the workers.
    fn submit(&mut self, first: u64) -> Result<u64, TrainError> {
        let config = &self.assignment.config;
        let training = &config.training;
        let policy = self.learner.policy(ActorChoice::Online);
        let mut exploration = self.exploration.clone();
        exploration.scale_noise(training.noise_factor(self.done(first)) as f32);
        let closes = exploration.is_coordinated();
        let exploration = Arc::new(exploration);
        let held_steps = self.counters.mean_held_steps();
        let last = (first + training.episodes_per_cycle as u64).min(config.episodes);
        let turns: Vec<(Policy, bool)> = match self.learner.numbers() {
            [] => vec![(policy, false)],
            numbers => numbers.iter().map(|numbers| (policy.in_turn(numbers), numbers.fewer.is_some())).collect(),
        };
        let attempts = closes && training.has_attempts(held_steps);
        let behaviour = |index: u64| {
            let exploration = Arc::clone(&exploration);
            if index < training.warmup_episodes {
                Behaviour::Warmup(exploration)
            } else if closes && training.attempts(index, held_steps) {
                Behaviour::Attempt(exploration)
            } else {
                Behaviour::Explore(exploration)
            }
        };
        let jobs = (first..last).map(|index| {
            let behaviour = behaviour(index);
            // Scripted grasps and random actions have all numbers.
            let acts = matches!(behaviour, Behaviour::Explore(_));
            let (policy, fewer_numbers) = turns[if acts { turn(index, attempts, turns.len()) } else { 0 }].clone();
            EpisodeJob {
                seed: config.seed,
                stream: "train",
                index,
                scene: None,
                policy,
                behaviour,
                fewer_numbers,
                confinement: None,
                disturbance: None,
            }
        });
        self.pool.submit(jobs)?;
        Ok(last)
    }

    /// Adds a cycle's episodes to replay, normalisers, posture database and synergy.
    fn store(&mut self, episodes: Vec<Episode>) -> Result<(), TrainError> {
        let Assignment { config, task, .. } = &self.assignment;
        let motions = motions(&episodes, &self.control.actuators, task);
        let stored = self.postures.store(&episodes, task, &motions)?;
        self.control.add(motions);
        for episode in episodes {
            self.counters.count(&episode, config.training.updates_per_episode);
            if episode.diverged {
                tracing::warn!(episode = episode.index, "the simulation diverged; the episode is discarded");
                continue;
            }
            self.learner.update_normalizers(&episode.data.observations, &episode.data.achieved_goals);
            self.learner.update_normalizers(&[], &episode.data.desired_goal);
            self.checkpoints.append(&episode.data)?;
            self.replay.push(episode.data)?;
        }
        self.counters.postures += stored;
        if stored > 0 {
            self.refit()?;
        }
        Ok(())
    }

    /// Computes the synergy of the postures so far, and updates its feedback into the reward.
    fn refit(&mut self) -> Result<(), TrainError> {
        self.reward.feedback.follow(self.postures.fit()?);
        Ok(())
    }

    /// Settles the control synergy when it is time, and begins anew with a policy that acts in it. Replay and the
    /// statistics of the inputs stay. Says so, and also if it has become too late.
    fn settle(&mut self, previous: u64, progress: &mut dyn Progress) -> Result<(), TrainError> {
        let episode = self.counters.episodes;
        let SynergyConfig { motions, .. } = self.assignment.config.synergy;
        if self.control.is_due(episode) {
            self.control.settle(episode)?;
            self.counters.settled_at = self.control.settled_at();
            let Some(outputs) = outputs(&self.assignment, &self.control)? else { return Ok(()) };
            let Assignment { config, hand, task, .. } = &self.assignment;
            let (dimensions, mut random) =
                (self.assignment.dimensions(Some(&outputs)), rng::stream(config.seed, "init", 1));
            self.learner = self.learner.begin_anew(dimensions, &mut random)?;
            self.exploration = exploration_of(config, hand, task, Some(&outputs))?;
            self.learner.set_numbers(outputs.numbers);
            progress.note(&format!(
                "episode {episode}: the control synergy is settled, and the policy begins anew in its numbers"
            ));
        } else if self.control.is_too_late(previous, episode) {
            progress.note(&format!(
                "episode {episode}: the policy keeps all joints, because fewer than {motions} noise-free episodes have \
                 succeeded, and the rest of the training is too short to begin anew; a longer training can do so \
                 (--episodes)"
            ));
        }
        Ok(())
    }

    /// Makes all updates that the episodes so far allow.
    fn learn(&mut self) -> Result<(), TrainError> {
        let config = &self.assignment.config;
        if self.counters.episodes < config.training.warmup_episodes || self.replay.is_empty() {
            return Ok(());
        }
        let rates = config.training.learning_rates(self.done(self.counters.episodes), &config.learner);
        self.learner.set_learning_rates(rates[0], rates[1]);
        let Self { learning, learner, replay, batch, reward, counters, .. } = self;
        learning.install(|| {
            while counters.updates_owed >= 1.0 {
                counters.updates_owed -= 1.0;
                let mut random = rng::stream(config.seed, "replay", counters.updates);
                sample_batch(replay, &config.her, &mut random, reward, batch)?;
                let stats = learner.update(batch);
                counters.updates += 1;
                if stats.has_diverged(&config.learner) {
                    return Err(TrainError::diverged(counters.updates, &stats, &config.learner));
                }
                counters.sums.add(&stats);
            }
            Ok(())
        })
    }

    /// (episode) => the share of training before it
    fn done(&self, episode: u64) -> f64 {
        episode as f64 / self.assignment.config.episodes as f64
    }

    fn evaluate(&mut self, progress: &mut dyn Progress) -> Result<(), TrainError> {
        let EvaluationConfig { actor, episodes, finalists, .. } = self.assignment.config.evaluation;
        let policy = self.learner.policy(actor);
        let evaluation = self.evaluate_policy(&policy, EvaluationStream::Periodic, episodes)?;
        let success_rate = evaluation.success_rate();
        let driven = self.success_with_components(&policy, success_rate)?;
        self.counters.last_evaluation = Some(success_rate);
        if let Some(settled_at) = self.counters.settled_at {
            // Policies that do not act in the settled space do not compete.
            self.finalists.retain(|finalist| finalist.episode >= settled_at);
        }
        let finalist = Finalist { success_rate, episode: self.counters.episodes, policy };
        self.finalists.enter(finalist, finalists);
        let components = self.assignment.config.synergy.components.min(self.postures.joints().len());
        let row = MetricsRow::of(
            &self.counters,
            &evaluation,
            driven.map(|(_, rate)| rate),
            self.reward.feedback.synergy(),
            components,
        );
        self.journal.append(&row)?;
        let driven = driven.map_or_else(String::new, |(k, rate)| format!(", with {k} numbers {:.1} %", 100.0 * rate));
        progress.note(&format!("episode {}: {evaluation}{driven}", self.counters.episodes));
        self.counters.sums = UpdateSums::default();
        Ok(())
    }

    /// Measures the success of a policy with as many components as the control synergy has. Returns both numbers; none
    /// while there is no such synergy.
    fn success_with_components(
        &mut self,
        policy: &Policy,
        success_rate: f64,
    ) -> Result<Option<(usize, f64)>, TrainError> {
        let episode = self.counters.episodes;
        let Some(space) = self.control.space(episode)? else { return Ok(None) };
        let Assignment { config, task, .. } = &self.assignment;
        if self.control.is_confined() {
            // The projection changes nothing.
            return Ok(Some((space.n_components(), success_rate)));
        }
        let driver = Driver {
            task,
            policy,
            actuators: &self.control.actuators,
            space: &space,
            numbers: config.synergy.components,

            free_steps: 0,
        };
        let (stream, k) = (EvaluationStream::Periodic, space.n_components());
        let driven = driver.measure(&mut self.pool, k, config.seed, stream, config.evaluation.episodes, false)?;
        Ok(Some((k, driven.success_rate)))
    }

    fn status(&self, steps_per_s: f64) -> Status {
        let trusted = self.counters.last_evaluation.is_some_and(|success| success >= TRUSTED);
        let contribution_sum = self.reward.feedback.synergy().filter(|_| trusted).map(Synergy::contribution_sum);
        self.counters.status(self.assignment.config.episodes, contribution_sum, steps_per_s)
    }

    fn save(&mut self) -> Result<(), TrainError> {
        self.checkpoints.save(&self.counters, &self.learner.to_tensors(), self.finalists.list())
    }

    /// Returns the task.
    pub fn task(&self) -> &GraspTask {
        &self.assignment.task
    }

    /// Returns the replay, for benchmarks that fill it.
    pub fn replay_mut(&mut self) -> &mut Replay {
        &mut self.replay
    }

    /// Returns the wall time of the run so far, in s.
    pub(crate) fn wall_s(&self) -> f64 {
        self.wall_before + self.started.elapsed().as_secs_f64()
    }
}

/// Returns the outputs of a policy that acts in a synergy: the settled control synergy, or one that was made before. None
/// if the policy commands every actuator.
fn outputs(assignment: &Assignment, control: &Control) -> Result<Option<Outputs>, TrainError> {
    let Assignment { config, hand, task, space, .. } = assignment;
    let settled = control.outputs(config, hand, task)?;
    Ok(settled.or_else(|| space.as_ref().map(|space| space.outputs.clone())))
}
