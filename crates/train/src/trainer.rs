//! The training loop.
//!
//! A cycle stores the episodes that the workers simulated meanwhile, hands them the next ones with the
//! present policy, and learns while they run. So rollouts overlap with learning, act with a policy that
//! is one cycle old, and depend on nothing but seed and configuration.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use eigenhand_hands::Hand;
use eigenhand_rl::{Batch, Coordination, Ddpg, ExplorationConfig, Policy, Replay, Which, rng, sample_batch};
use eigenhand_sim::GraspTask;
use eigenhand_sim::ffi::MuJoCo;
use eigenhand_synergy::{ActuationMap, Feedback, JointInfo, PostureDatabase, PostureRecord, Synergy, Unit, newest};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::checkpoint::{Checkpoints, Counters, Finalist, UpdateSums};
use crate::command_cost::{actuation_map, command_cost};
use crate::config::{ActorChoice, HELD_WINDOW, RunConfig};
use crate::evaluation::{Evaluation, EvaluationStream, evaluate};
use crate::metrics::{MetricsFile, MetricsTable, Row};
use crate::progress::{Progress, Status};
use crate::reward::GraspReward;
use crate::rollout::{Behaviour, Episode, EpisodeJob, WorkerPool, episode_shape};
use crate::run_dir::RunDirectory;
use crate::summary::{StoppedBy, Summary};
use crate::tensorboard::EventFile;
use crate::{Provenance, TrainError, export};

/// Name of the posture database in a run directory.
pub const DATABASE: &str = "postures.sqlite";
/// Noise-free training episodes over which recent success is reported.
const RECENT: usize = 50;

/// Builds the grasp task that a configuration describes.
///
/// # Errors
/// [`TrainError::Sim`].
pub fn task_of(config: &RunConfig, hand: &Hand, library: &Arc<MuJoCo>) -> Result<Arc<GraspTask>, TrainError> {
    Ok(Arc::new(GraspTask::new(
        library,
        hand,
        &config.objects,
        config.task.clone(),
        config.physics.clone(),
        config.reward.clone(),
    )?))
}

/// Starts the threads that share the parts of an update.
///
/// # Errors
/// [`TrainError::Io`] when a thread cannot start.
pub(crate) fn learning_threads(count: usize) -> Result<ThreadPool, TrainError> {
    ThreadPoolBuilder::new().num_threads(count).thread_name(|number| format!("learning-{number}")).build().map_err(
        |error| TrainError::Io { what: "start a learning thread".to_owned(), source: std::io::Error::other(error) },
    )
}

/// Returns the posture's joints as the synergy names them.
pub(crate) fn joint_infos(task: &GraspTask) -> Vec<JointInfo> {
    task.posture_joints
        .iter()
        .map(|joint| {
            let (lower, upper) = joint.range.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
            JointInfo {
                name: joint.name.clone(),
                unit: Unit::from_symbol(joint.unit).unwrap_or(Unit::Radian),
                lower,
                upper,
            }
        })
        .collect()
}

/// A run that trains.
pub struct Trainer {
    config: RunConfig,
    provenance: Provenance,
    hand: Hand,
    task: Arc<GraspTask>,
    run: RunDirectory,
    pool: WorkerPool,
    learning: ThreadPool,
    learner: Ddpg,
    replay: Replay,
    batch: Batch,
    reward: GraspReward,
    exploration: ExplorationConfig,
    joints: Vec<JointInfo>,
    actuation: ActuationMap,
    postures: Vec<Vec<f64>>,
    database: PostureDatabase,
    checkpoints: Checkpoints,
    metrics: MetricsFile,
    events: Option<EventFile>,
    counters: Counters,
    finalists: Vec<Finalist>,
    started: Instant,
}

impl Trainer {
    /// Prepares a new run in a directory that [`RunDirectory::create`] made.
    ///
    /// # Errors
    /// Anything that is wrong with the configuration, the hand or the directory.
    pub fn create(
        config: RunConfig,
        provenance: Provenance,
        hand: Hand,
        task: Arc<GraspTask>,
        run: RunDirectory,
    ) -> Result<Trainer, TrainError> {
        let mut init = rng::stream(config.seed, "init", 0);
        let learner = Ddpg::new(
            config.learner.clone(),
            task.observation_len(),
            GraspTask::GOAL_LEN,
            task.action_len(),
            &mut init,
        )?;
        let checkpoints = Checkpoints::create(run.path(), config.training.checkpoints_kept)?;
        Trainer::assemble(config, provenance, hand, task, run, learner, checkpoints, Counters::default())
    }

    /// Continues the run in a directory from its newest checkpoint, as if it had not stopped.
    ///
    /// # Errors
    /// [`TrainError::Damaged`] when a file of the checkpoint is, besides those of [`create`](Self::create).
    pub fn resume(
        config: RunConfig,
        provenance: Provenance,
        hand: Hand,
        task: Arc<GraspTask>,
        run: RunDirectory,
    ) -> Result<Trainer, TrainError> {
        let (checkpoints, restored) =
            Checkpoints::open(run.path(), config.training.checkpoints_kept, &config.learner.normalizer)?;
        let learner = Ddpg::from_tensors(
            config.learner.clone(),
            task.observation_len(),
            GraspTask::GOAL_LEN,
            task.action_len(),
            &restored.learner,
        )?;
        let counters = restored.counters;
        let mut trainer = Trainer::assemble(config, provenance, hand, task, run, learner, checkpoints, counters)?;
        for episode in restored.episodes {
            trainer.replay.push(episode)?;
        }
        let episodes = trainer.counters.episodes;
        trainer.database.truncate_from_episode(episodes)?;
        trainer.postures = trainer.database.postures()?;
        if trainer.postures.len() as u64 != trainer.counters.postures {
            return Err(TrainError::Damaged {
                path: trainer.run.file(DATABASE),
                reason: format!(
                    "it holds {} postures up to episode {episodes}, but the checkpoint counts {}",
                    trainer.postures.len(),
                    trainer.counters.postures
                ),
                mend: "restore the file as it was, or train again with another --out".to_owned(),
            });
        }
        trainer.refit()?;
        trainer.finalists = restored.finalists;
        Ok(trainer)
    }

    #[allow(clippy::too_many_arguments)]
    fn assemble(
        config: RunConfig,
        provenance: Provenance,
        hand: Hand,
        task: Arc<GraspTask>,
        run: RunDirectory,
        learner: Ddpg,
        checkpoints: Checkpoints,
        counters: Counters,
    ) -> Result<Trainer, TrainError> {
        let shape = episode_shape(&task);
        let joints = joint_infos(&task);
        let mut exploration = config.exploration.clone();
        if exploration.hold_scale.is_empty() && config.training.slide_hold != 1.0 {
            exploration.hold_scale = task
                .actuators
                .iter()
                .map(|name| if *name == hand.manifest.slide.name { config.training.slide_hold } else { 1.0 })
                .collect();
        }
        exploration.coordination = coordination(&hand, &task);
        if !exploration.coordination.is_empty() {
            exploration.start = task.start_action();
        }
        exploration.validate(shape.act_dim)?;
        let metrics = MetricsFile::open(run.path(), counters.episodes)?;
        let events = if config.tensorboard {
            Some(EventFile::create(run.path(), provenance.started_unix_s, &MetricsTable::read(run.path())?.rows())?)
        } else {
            None
        };
        Ok(Trainer {
            pool: WorkerPool::new(&task, config.worker_count())?,
            learning: learning_threads(config.learner_thread_count())?,
            replay: Replay::new(config.training.replay_episodes, shape)?,
            batch: Batch::new(config.learner.batch_size, shape),
            reward: GraspReward {
                config: config.reward.clone(),
                n_joints: joints.len(),
                feedback: Feedback::new(&config.penalty()),
            },
            postures: Vec::new(),
            database: PostureDatabase::open(run.file(DATABASE), &joints)?,
            metrics,
            events,
            exploration,
            joints,
            actuation: actuation_map(&hand, &task),
            counters,
            finalists: Vec::new(),
            started: Instant::now(),
            config,
            provenance,
            hand,
            task,
            run,
            learner,
            checkpoints,
        })
    }

    /// Trains until all episodes are done or `stop` is set, then evaluates and exports.
    ///
    /// # Errors
    /// What stopped the run; the newest checkpoint stays valid.
    pub fn run(mut self, stop: &AtomicBool, progress: &mut dyn Progress) -> Result<Summary, TrainError> {
        let before = self.counters.wall_s;
        self.started = Instant::now();
        let mut saved_at = self.counters.episodes;
        progress.update(&self.status(0.0));
        if self.counters.episodes == 0 {
            // So that a run that is killed early can be resumed too.
            self.save()?;
        }
        let mut submitted = self.counters.episodes;
        submitted = self.submit(submitted)?;
        // A checkpoint is taken between a cycle's episodes and what is learned after them.
        self.learn()?;
        while self.counters.episodes < self.config.episodes {
            let (cycle_started, first_step) = (Instant::now(), self.counters.env_steps);
            let episodes = self.pool.collect()?;
            let previous = self.counters.episodes;
            self.store(episodes)?;
            self.counters.wall_s = before + self.started.elapsed().as_secs_f64();
            let done = self.counters.episodes;
            let total = self.config.episodes;
            let crossed = |every: u64| previous / every != done / every || done == total;
            if crossed(self.config.evaluation.every) {
                self.evaluate_periodically(progress)?;
            }
            let interrupted = stop.load(Ordering::Relaxed);
            if crossed(self.config.training.checkpoint_every) || interrupted {
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
        if !stop.load(Ordering::Relaxed) {
            if self.finalists.len() > 1 {
                progress.note(&format!("comparing the {} best policies", self.finalists.len()));
            }
            progress.note(&format!("final evaluation: {} fresh episodes", self.config.evaluation.final_episodes));
        }
        progress.finish();
        self.finish(stop, before)
    }

    /// Hands the next cycle's episodes to the workers.
    fn submit(&mut self, first: u64) -> Result<u64, TrainError> {
        let policy = self.learner.policy(which(self.config.training.rollout_actor));
        let mut exploration = self.exploration.clone();
        exploration.scale_noise(self.config.training.noise_factor(self.done(first)) as f32);
        let exploration = Arc::new(exploration);
        let last = (first + self.config.training.episodes_per_cycle as u64).min(self.config.episodes);
        let (training, held_steps) = (&self.config.training, self.counters.mean_held_steps());
        let closes = !exploration.coordination.is_empty();
        let jobs: Vec<EpisodeJob> = (first..last)
            .map(|index| EpisodeJob {
                seed: self.config.seed,
                stream: "train",
                index,
                scene: None,
                goal_height: self.config.task.training_goal_height,
                policy: policy.clone(),
                behaviour: if index < training.warmup_episodes {
                    Behaviour::Warmup(Arc::clone(&exploration))
                } else if closes && training.attempts(index, held_steps) {
                    Behaviour::Attempt(Arc::clone(&exploration))
                } else {
                    Behaviour::Explore(Arc::clone(&exploration))
                },
            })
            .collect();
        self.pool.submit(jobs)?;
        Ok(last)
    }

    /// Takes a cycle's episodes into replay, normalisers, posture database and synergy.
    fn store(&mut self, episodes: Vec<Episode>) -> Result<(), TrainError> {
        let mut postures = Vec::new();
        for mut episode in episodes {
            self.counters.episodes += 1;
            self.counters.count_warnings(episode.warnings);
            if episode.diverged {
                self.counters.diverged += 1;
                tracing::warn!(episode = episode.index, "the simulation diverged; the episode is discarded");
                continue;
            }
            self.counters.env_steps += episode.data.shape.n_steps as u64;
            push_newest(&mut self.counters.held_steps, episode.held_steps, HELD_WINDOW);
            self.counters.updates_owed += self.config.training.updates_per_episode;
            if episode.greedy {
                push_newest(&mut self.counters.recent, episode.success, RECENT);
            }
            self.reward.judge(&mut episode.data);
            self.learner.update_normalizers(&episode.data.observations, &episode.data.achieved_goals);
            self.learner.update_normalizers(&[], &episode.data.desired_goal);
            self.checkpoints.append(&episode.data)?;
            if episode.success {
                let goal = &episode.data.desired_goal;
                postures.push(PostureRecord {
                    posture: episode.posture,
                    object: self.task.scenes[episode.scene].object.name.to_owned(),
                    episode: episode.index,
                    lambda: self.config.lambda,
                    seed: self.config.seed,
                    goal: [f64::from(goal[0]), f64::from(goal[1]), f64::from(goal[2])],
                    step: episode.data.shape.n_steps as u32,
                });
            }
            self.replay.push(episode.data)?;
        }
        if postures.is_empty() {
            return Ok(());
        }
        self.database.insert_all(&postures)?;
        self.counters.postures += postures.len() as u64;
        self.postures.extend(postures.into_iter().map(|record| record.posture));
        self.refit()
    }

    /// Computes the synergy of the postures so far, and what follows from it for reward and actor.
    fn refit(&mut self) -> Result<(), TrainError> {
        let config = &self.config.synergy;
        let synergy = Synergy::fit_newest(&self.joints, &self.postures, config.components, config.window)?;
        self.reward.feedback.synergy = synergy.map(Arc::new);
        let (weight, failure) = (self.config.lambda * self.config.synergy.command_weight, self.config.reward.failure);
        let active = self.reward.feedback.active().filter(|_| weight > 0.0);
        let cost = active.map(|synergy| command_cost(synergy, &self.actuation, weight, failure));
        self.learner.set_action_cost(cost);
        Ok(())
    }

    /// Learns as many minibatches as the episodes so far allow.
    fn learn(&mut self) -> Result<(), TrainError> {
        if self.counters.episodes < self.config.training.warmup_episodes || self.replay.is_empty() {
            return Ok(());
        }
        self.set_learning_rates();
        let Self { learning, learner, replay, batch, reward, counters, config, .. } = self;
        learning.install(|| {
            while counters.updates_owed >= 1.0 {
                counters.updates_owed -= 1.0;
                let mut random = rng::stream(config.seed, "replay", counters.updates);
                sample_batch(replay, &config.her, &mut random, reward, batch)?;
                let stats = learner.update(batch, &mut random);
                counters.sums.add(&stats);
                counters.updates += 1;
            }
            Ok(())
        })
    }

    fn set_learning_rates(&mut self) {
        let factor = self.config.training.learning_rate_factor(self.done(self.counters.episodes)) as f32;
        let learner = &self.config.learner;
        self.learner.set_learning_rates(factor * learner.actor_lr, factor * learner.critic_lr);
    }

    /// (episode) => the share of training before it
    fn done(&self, episode: u64) -> f64 {
        episode as f64 / self.config.episodes as f64
    }

    fn evaluate_periodically(&mut self, progress: &mut dyn Progress) -> Result<(), TrainError> {
        let policy = self.learner.policy(which(self.config.evaluation.actor));
        let evaluation = evaluate(
            &mut self.pool,
            &self.task,
            &policy,
            self.config.seed,
            EvaluationStream::Periodic,
            self.config.evaluation.episodes,
        )?;
        let rate = evaluation.success_rate;
        self.counters.last_evaluation = Some(rate);
        // Of equals the later is the better.
        let place = self.finalists.partition_point(|finalist| finalist.success_rate > rate);
        self.finalists.insert(place, Finalist { success_rate: rate, episode: self.counters.episodes, policy });
        self.finalists.truncate(self.config.evaluation.finalists);
        let row = self.metrics_row(&evaluation)?;
        self.metrics.append(&row)?;
        if let Some(events) = &mut self.events {
            events.append(&row)?;
        }
        let per_object: Vec<String> = evaluation
            .success_rate_per_object
            .iter()
            .map(|(object, rate)| format!("{object} {:.0} %", 100.0 * rate))
            .collect();
        progress.note(&format!(
            "episode {}: evaluated success {:.1} % ({})",
            self.counters.episodes,
            100.0 * rate,
            per_object.join(", ")
        ));
        self.counters.sums = UpdateSums::default();
        Ok(())
    }

    fn metrics_row(&self, evaluation: &Evaluation) -> Result<Row, TrainError> {
        let c = &self.counters;
        let mut row: Row = Vec::new();
        let mut put = |name: &str, value: f64| row.push((name.to_owned(), value));
        put("episode", c.episodes as f64);
        put("env_steps", c.env_steps as f64);
        put("updates", c.updates as f64);
        put("wall_s", c.wall_s);
        put("success_rate", evaluation.success_rate);
        for (object, rate) in &evaluation.success_rate_per_object {
            put(&format!("success_rate_{object}"), *rate);
        }
        put("mean_final_distance_m", evaluation.mean_final_distance);
        put("mean_penetration_m", evaluation.mean_penetration);
        put("train_success_rate", self.recent_success().unwrap_or(f64::NAN));
        put("n_postures", c.postures as f64);
        let synergy = self.reward.feedback.synergy.as_deref();
        for i in 0..self.config.synergy.components.min(self.joints.len()) {
            put(&format!("contribution_{}", i + 1), synergy.map_or(f64::NAN, |s| s.contribution()[i]));
        }
        put("contribution_sum", synergy.map_or(f64::NAN, Synergy::contribution_sum));
        let error = match synergy {
            Some(synergy) if !evaluation.postures.is_empty() => synergy.mean_error(&evaluation.postures),
            _ => f64::NAN,
        };
        put("mean_error_rad", error);
        let sums = &c.sums;
        // Nothing learned is nothing divided by nothing, which leaves the field empty.
        let mean = |sum: f64| sum / sums.count as f64;
        put("critic_loss", mean(sums.critic_loss));
        put("actor_loss", mean(sums.actor_loss));
        put("q_mean", mean(sums.q));
        put("target_mean", mean(sums.target));
        put("clipped_share", mean(sums.clipped));
        put("diverged", c.diverged as f64);
        put("buffer_warnings", c.buffer_warnings as f64);
        Ok(row)
    }

    fn recent_success(&self) -> Option<f64> {
        let good = self.counters.recent.iter().filter(|success| **success).count();
        (!self.counters.recent.is_empty()).then(|| good as f64 / self.counters.recent.len() as f64)
    }

    fn status(&self, steps_per_s: f64) -> Status {
        Status {
            episodes: self.counters.episodes,
            total: self.config.episodes,
            recent_success: self.recent_success(),
            evaluated: self.counters.last_evaluation,
            postures: self.counters.postures,
            contribution_sum: self.reward.feedback.synergy.as_deref().map(Synergy::contribution_sum),
            steps_per_s,
            diverged: self.counters.diverged,
        }
    }

    fn save(&mut self) -> Result<(), TrainError> {
        self.checkpoints.save(&self.counters, &self.learner.to_tensors(), &self.finalists)
    }

    /// Chooses the policy that the run hands out, and tells the number of training episodes before it.
    ///
    /// The best of many noisy evaluations is partly luck, so the finalists are compared on episodes of their own.
    fn choose_policy(&mut self, compare: bool) -> Result<(Policy, u64), TrainError> {
        let episodes = self.config.evaluation.selection_episodes;
        let mut chosen: Option<(f64, &Finalist)> = None;
        for finalist in &self.finalists {
            let rate = if compare && self.finalists.len() > 1 {
                let stream = EvaluationStream::Selection;
                evaluate(&mut self.pool, &self.task, &finalist.policy, self.config.seed, stream, episodes)?.success_rate
            } else {
                finalist.success_rate
            };
            tracing::info!("finalist of episode {}: success {:.1} %", finalist.episode, 100.0 * rate);
            if chosen.is_none_or(|(best, _)| rate > best) {
                chosen = Some((rate, finalist));
            }
        }
        Ok(match chosen {
            Some((_, finalist)) => (finalist.policy.clone(), finalist.episode),
            None => (self.learner.policy(which(self.config.evaluation.actor)), self.counters.episodes),
        })
    }

    fn finish(mut self, stop: &AtomicBool, before: f64) -> Result<Summary, TrainError> {
        let complete = self.counters.episodes >= self.config.episodes && !stop.load(Ordering::Relaxed);
        let (policy, policy_episode) = self.choose_policy(complete)?;
        let evaluation = if complete {
            let episodes = self.config.evaluation.final_episodes;
            let stream = EvaluationStream::Final;
            Some(evaluate(&mut self.pool, &self.task, &policy, self.config.seed, stream, episodes)?)
        } else {
            None
        };
        // The export simulates too, and the threads' simulations are most of what is not replay.
        drop(self.pool);
        let synergy = self.reward.feedback.synergy.as_deref();
        let postures = newest(&self.postures, self.config.synergy.window);
        export::write_products(
            &export::Products {
                hand: &self.hand,
                task: &self.task,
                config: &self.config,
                provenance: &self.provenance,
                policy: &policy,
                policy_episode: Some(policy_episode),
                synergy,
                postures,
            },
            self.run.path(),
        )?;
        let summary = Summary {
            schema: 1,
            hand: self.hand.manifest.name.clone(),
            preset: self.config.preset.name().to_owned(),
            lambda: self.config.lambda,
            seed: self.config.seed,
            episodes: self.counters.episodes,
            env_steps: self.counters.env_steps,
            updates: self.counters.updates,
            wall_s: before + self.started.elapsed().as_secs_f64(),
            success_rate: evaluation.as_ref().map(|e| e.success_rate),
            success_rate_per_object: evaluation.as_ref().map(|e| e.success_rate_per_object.clone()).unwrap_or_default(),
            eval_episodes: evaluation.as_ref().map_or(0, |e| e.episodes),
            mean_penetration_m: evaluation.as_ref().map(|e| e.mean_penetration),
            policy_episode,
            last_evaluation: self.counters.last_evaluation,
            n_postures: self.counters.postures,
            contribution: synergy.map(|s| s.contribution().to_vec()).unwrap_or_default(),
            contribution_sum: synergy.map(Synergy::contribution_sum),
            mean_error_rad: synergy.map(|s| s.mean_error(postures)),
            diverged_episodes: self.counters.diverged,
            buffer_warnings: self.counters.buffer_warnings,
            eval_warnings: evaluation.as_ref().map(|e| e.warnings).unwrap_or_default(),
            mujoco_version: self.provenance.mujoco_version.clone(),
            stopped_by: if complete { StoppedBy::Episodes } else { StoppedBy::Interrupt },
        };
        summary.write(self.run.path())?;
        Ok(summary)
    }

    /// Returns the run directory.
    pub fn directory(&self) -> &Path {
        self.run.path()
    }

    /// Returns the task.
    pub fn task(&self) -> &GraspTask {
        &self.task
    }

    /// Returns the replay, which measurements fill.
    pub(crate) fn replay_mut(&mut self) -> &mut Replay {
        &mut self.replay
    }

    /// Returns the number of training episodes so far.
    pub fn episodes(&self) -> u64 {
        self.counters.episodes
    }
}

/// Appends to the newest `length` values.
fn push_newest<T>(values: &mut VecDeque<T>, value: T, length: usize) {
    values.push_back(value);
    while values.len() > length {
        values.pop_front();
    }
}

fn which(choice: ActorChoice) -> Which {
    match choice {
        ActorChoice::Online => Which::Online,
        ActorChoice::Target => Which::Target,
        ActorChoice::Average => Which::Average,
    }
}

/// What each actuator does in a coordinated random action: the hand closes or opens, the slide goes down or up.
fn coordination(hand: &Hand, task: &GraspTask) -> Vec<Coordination> {
    let closing = &hand.manifest.closing;
    if closing.is_empty() {
        return Vec::new();
    }
    let of = |name: &String| match closing.get(name) {
        Some(&sign) => Coordination::Together(sign as f32),
        None if *name == hand.manifest.slide.name => Coordination::Ends,
        None => Coordination::Free,
    };
    task.actuators.iter().map(of).collect()
}
