//! The training loop.
//!
//! In each cycle, the trainer stores the episodes that the workers have simulated, submits the next episodes with the
//! current policy, and learns while they run. So rollouts overlap with learning, and their policy is one cycle old.
//! Their results depend only on the seed and the configuration.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use eigenhand_files::sync_directory;
use eigenhand_rl::{ActorChoice, Batch, Ddpg, ExplorationConfig, Policy, Replay, rng, sample_batch};
use eigenhand_sim::GraspTask;
use eigenhand_synergy::Synergy;
use rayon::ThreadPool;

use crate::action_space::Outputs;
use crate::actuators::HandActuators;
use crate::assignment::{Assignment, dimensions};
use crate::checkpoint::{Checkpoints, Opened, Restored};
use crate::config::{RunConfig, SynergyConfig};
use crate::control::Control;
use crate::counters::Counters;
use crate::divergence::Divergence;
use crate::error::TrainError;
use crate::exploration::exploration_of;
use crate::feedback::GraspReward;
use crate::finalists::Finalists;
use crate::journal::Journal;
use crate::metrics::{MetricsFile, TRUSTED};
use crate::motion::motions;
use crate::postures::Postures;
use crate::progress::{Progress, Status};
use crate::rollout::{Behaviour, Episode, EpisodeJob, WorkerPool, episode_shape};
use crate::schedule::turn;
use crate::speed::Speed;
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
    pub(crate) journal: Journal,
    pub(crate) counters: Counters,
    pub(crate) finalists: Finalists,
    divergence: Divergence,
    /// What was found when the run was opened.
    notes: Vec<String>,
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
        let Assignment { config, hand, task, run, start, .. } = &assignment;
        let mut control = Control::new(config, HandActuators::of(hand, task));
        let mut counters = Counters::default();
        if let Some(start) = start {
            control.settle_on(0, start.motions.clone())?;
            counters.settled_at = control.settled_at();
        }
        let postures = Postures::open(run, config, task, &control.actuators)?;
        let outputs = outputs(&assignment, &control)?;
        let mut random = rng::stream(config.seed, "init", 0);
        let learner = match start.as_ref().and_then(|start| start.learner.clone()) {
            None => Ddpg::new(config.learner.clone(), dimensions(task, outputs.as_ref()), &mut random)?,
            Some(learner) => learner,
        };
        let checkpoints = Checkpoints::create(run.path(), config.training.checkpoints_kept)?;
        Trainer::assemble(assignment, learner, outputs, postures, control, checkpoints, counters)
    }

    /// Continues the run in a directory from its newest checkpoint, as if it had not stopped.
    ///
    /// # Errors
    /// [`TrainError::Damaged`] for a damaged file of the checkpoint, and the errors of [`create`](Self::create).
    pub fn resume(assignment: Assignment) -> Result<Trainer, TrainError> {
        let Assignment { config, hand, task, run, start, .. } = &assignment;
        let (kept, normalizer) = (config.training.checkpoints_kept, &config.learner.normalizer);
        let agrees = |counters: &Counters| {
            Postures::check(run, counters)?;
            Journal::lost(run, counters)
        };
        let Opened { checkpoints, restored, notes } = Checkpoints::open(run.path(), kept, normalizer, agrees)?;
        let Restored { mut counters, learner, finalists, episodes } = restored;
        counters.metrics_rows = MetricsFile::rows_up_to(run.path(), counters.episodes)?;
        let mut control = Control::new(config, HandActuators::of(hand, task));
        let mut postures = Postures::open(run, config, task, &control.actuators)?;
        control.add(postures.restore(counters.episodes)?);
        match (counters.settled_at, start) {
            (Some(0), Some(start)) => control.settle_on(0, start.motions.clone())?,
            (Some(episode), _) => control.settle(episode)?,
            (None, _) => {}
        }
        let outputs = outputs(&assignment, &control)?;
        let learner = Ddpg::from_tensors(config.learner.clone(), dimensions(task, outputs.as_ref()), &learner)?;
        let mut trainer = Trainer::assemble(assignment, learner, outputs, postures, control, checkpoints, counters)?;
        episodes.into_iter().try_for_each(|episode| trainer.replay.push(episode))?;
        trainer.finalists = Finalists::new(finalists);
        trainer.refit()?;
        trainer.notes = notes;
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
            divergence: Divergence::default(),
            notes: Vec::new(),
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
        self.notes.drain(..).for_each(|note| progress.warn(&note));
        let mut saved_at = self.counters.episodes;
        progress.update(&self.status(0.0));
        let begins = self.counters.episodes == 0;
        if begins && self.assignment.start.is_some() && self.counters.last_evaluation.is_none() {
            // What the networks can do already; if the training makes nothing better of them, they are the result.
            self.counters.evaluation_due = true;
        }
        if self.counters.evaluation_due {
            self.evaluate_unless(stop, progress)?;
        }
        if begins || self.counters.evaluation_due {
            // With this checkpoint, a run that is killed early can be resumed too.
            self.save()?;
        }
        if self.counters.evaluation_due {
            progress.note("interrupted: everything is saved");
            return Ok(());
        }
        let mut submitted = self.submit(self.counters.episodes)?;
        // A checkpoint holds a cycle's episodes but not yet the updates for them, so a resumed run starts with these.
        self.learn()?;
        let RunConfig { training, evaluation, episodes: total, .. } = &self.assignment.config;
        let mut speed = Speed::default();
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
                self.evaluate_unless(stop, progress)?;
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
            let steps = self.counters.env_steps - first_step;
            progress.update(&self.status(speed.after(steps as f64, cycle_started.elapsed().as_secs_f64())));
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
            // Networks that are trained already need no random actions to begin with.
            if index < training.warmup_episodes && config.from.is_empty() {
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
        let mut diverges = Ok(());
        for episode in episodes {
            self.counters.count(&episode, config.training.updates_per_episode);
            if diverges.is_ok() {
                diverges = self.divergence.add(&episode, &self.assignment);
            }
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
        if diverges.is_err() {
            self.save()?;
        }
        diverges
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
            let mut random = rng::stream(config.seed, "init", 1);
            self.learner = self.learner.begin_anew(dimensions(task, Some(&outputs)), &mut random)?;
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

    fn status(&self, steps_per_s: f64) -> Status {
        let trusted = self.counters.last_evaluation.is_some_and(|success| success >= TRUSTED);
        let contribution_sum = self.reward.feedback.synergy().filter(|_| trusted).map(Synergy::contribution_sum);
        self.counters.status(self.assignment.config.episodes, contribution_sum, steps_per_s)
    }

    /// Writes a checkpoint. The disk has everything that it counts before it has the checkpoint.
    fn save(&mut self) -> Result<(), TrainError> {
        self.assignment.run.require_in_place()?;
        self.postures.sync()?;
        self.counters.postures_sha256 = self.postures.sha256()?;
        self.journal.sync()?;
        sync_directory(self.assignment.run.path())?;
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
