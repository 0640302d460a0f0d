//! The end of a run: choosing its policy, the final evaluation, the products and the summary.

use std::sync::atomic::{AtomicBool, Ordering};

use eigenhand_rl::{ActionMap, Policy};
use eigenhand_sim::GraspTask;
use eigenhand_synergy::{Content, MotionRecord, Synergy};

use crate::assignment::Assignment;
use crate::config::EvaluationConfig;
use crate::control::control_space;
use crate::control_product::ControlProduct;
use crate::digests;
use crate::drive::{Driven, Driver, MOST_COMPONENTS, fewest_components};
use crate::error::TrainError;
use crate::evaluation::{Evaluation, EvaluationStream, evaluate, simulate};
use crate::halt::halted_on;
use crate::metrics::TRUSTED;
use crate::motion::motions;
use crate::products::{Products, remove_drawn, write_products};
use crate::progress::Progress;
use crate::rollout::{Counting, WorkerPool};
use crate::stress::Stress;
use crate::summary::{OtherObjects, StoppedBy, Summary};
use crate::trainer::Trainer;

/// What the end of a run measures.
struct Measured {
    policy: Policy,
    policy_episode: u64,
    motions: Vec<MotionRecord>,
    with_fewer: Vec<(usize, Vec<MotionRecord>)>,
    described: Vec<MotionRecord>,
    evaluation: Option<Evaluation>,
    success_with_components: Vec<f64>,
    other_objects: Option<OtherObjects>,
}

impl Trainer {
    /// Trains until all episodes are done or `stop` is set, then evaluates and exports.
    ///
    /// # Errors
    /// The error that stopped the run; the newest checkpoint stays valid.
    pub fn run(mut self, stop: &AtomicBool, progress: &mut dyn Progress) -> Result<Summary, TrainError> {
        self.train(stop, progress)?;
        let complete = self.counters.episodes >= self.assignment.config.episodes && !stop.load(Ordering::Relaxed);
        progress.finish();
        if !complete {
            let measured = self.measure(false, progress)?;
            return self.write(measured, false);
        }
        let halt = self.pool.halt();
        match halted_on(stop, &halt, || self.measure(true, progress)) {
            Err(TrainError::Stopped) => {
                progress
                    .note("interrupted: everything is saved; the final evaluation begins anew when the run continues");
                let measured = self.measure(false, progress)?;
                self.write(measured, false)
            }
            measured => self.write(measured?, true),
        }
    }

    /// Chooses the policy, and evaluates it if the run is `complete`.
    fn measure(&mut self, complete: bool, progress: &mut dyn Progress) -> Result<Measured, TrainError> {
        self.pool.count_with(progress.counting());
        let (policy, policy_episode) = self.choose_policy(complete, progress)?;
        let motions = self.motions_of(&policy, complete)?;
        let most = self.assignment.config.synergy.components.max(MOST_COMPONENTS);
        // Where the policy acts in the settled space, this is what is exported.
        let settled = self.control.settled_motions().filter(|_| policy.map() == self.map_of_numbers());
        let described = settled.map_or_else(|| motions.clone(), <[_]>::to_vec);
        let acts_in_it = settled.is_some();
        let with_fewer = if acts_in_it && complete { self.motions_with_fewer_numbers(&policy)? } else { Vec::new() };
        let space = control_space(&self.control.actuators.coordinates, &described, most)?;
        let mut evaluation = None;
        let mut success_with_components = Vec::new();
        let mut other_objects = None;
        if complete {
            let EvaluationConfig { final_episodes: episodes, few_numbers, .. } = self.assignment.config.evaluation;
            let driven = if few_numbers { ", and with few numbers" } else { "" };
            progress.note(&format!("final evaluation: {episodes} new episodes with all joints{driven}"));
            let found = self.evaluate_policy(&policy, EvaluationStream::Final, episodes)?;
            progress.note(&format!("with all joints: {:.1} %", 100.0 * found.success_rate()));
            evaluation = Some(found);
            let space = space.as_ref().filter(|_| few_numbers);
            if let Some(space) = space {
                let Assignment { config, task, .. } = &self.assignment;
                let actuators = &self.control.actuators;
                let driver = Driver {
                    task,
                    policy: &policy,
                    actuators,
                    space,
                    numbers: config.synergy.components,
                    free_steps: 0,
                };
                let confined = acts_in_it && self.control.is_confined();
                let (seed, stream) = (config.seed, EvaluationStream::Final);
                let each = |driven: &Driven| progress.note(&driven.to_string());
                success_with_components =
                    driver.measure_each(&mut self.pool, seed, stream, episodes, confined, each)?;
            }
            other_objects = self.evaluate_other_objects(&policy, space, progress.counting())?;
            if let Some(others) = &other_objects {
                progress.note(&format!("with other objects: {:.1} %", 100.0 * others.success_rate));
            }
        }
        Ok(Measured {
            policy,
            policy_episode,
            motions,
            with_fewer,
            described,
            evaluation,
            success_with_components,
            other_objects,
        })
    }

    /// Writes products and summary.
    fn write(self, measured: Measured, complete: bool) -> Result<Summary, TrainError> {
        self.assignment.run.require_in_place()?;
        let wall_s = self.wall_s();
        let Trainer { assignment, pool, reward, postures, counters, control, .. } = self;
        // The export simulates too. Besides replay, the threads' simulations take most of the memory.
        drop(pool);
        let Assignment { config, provenance, hand, task, run, .. } = &assignment;
        let evaluation = measured.evaluation.as_ref();
        let success_rate = evaluation.map(Evaluation::success_rate);
        let synergy = reward.feedback.synergy();
        postures.finish()?;
        let postures = postures.newest();
        let mut product = ControlProduct::of(
            &control.actuators,
            &task.posture_joints,
            &measured.described,
            &measured.motions,
            &measured.with_fewer,
            config.synergy.components,
        )?;
        if let (Some(product), Some(evaluation)) = (&mut product, evaluation) {
            let with_few = &measured.success_with_components;
            product.recommend(with_few, evaluation.success_rate(), evaluation.all.episodes);
        }
        let products = Products {
            hand,
            task,
            config,
            provenance,
            policy: &measured.policy,
            policy_episode: Some(measured.policy_episode),
            control: product,
            synergy,
            postures,
        };
        Stress::remove(run.path())?;
        remove_drawn(run.path())?;
        digests::remove(run.path())?;
        write_products(&products, run.path())?;
        digests::write(run.path())?;
        // Below this success, the postures say little about what the policy can do.
        let trusted = synergy.filter(|_| success_rate.or(counters.last_evaluation).is_some_and(|s| s >= TRUSTED));
        let summary = Summary {
            schema: 1,
            hand: hand.manifest.name.clone(),
            preset: config.preset.name().to_owned(),
            lambda: config.lambda,
            seed: config.seed,
            episodes: counters.episodes,
            env_steps: counters.env_steps,
            updates: counters.updates,
            wall_s,
            success_rate,
            success_rate_per_object: evaluation.map(Evaluation::success_rate_per_object).unwrap_or_default(),
            eval_episodes: evaluation.map_or(0, |e| e.all.episodes),
            eval_successes: evaluation.map(|e| e.all.successes),
            components: config.synergy.components,
            k_for_95: success_rate.and_then(|all| fewest_components(&measured.success_with_components, all)),
            success_with_components: measured.success_with_components,
            other_objects: measured.other_objects,
            mean_penetration_m: evaluation.map(|e| e.mean_penetration),
            mean_self_penetration_m: evaluation.and_then(|e| e.mean_self_penetration),
            policy_episode: measured.policy_episode,
            last_evaluation: counters.last_evaluation,
            n_postures: counters.postures,
            contribution: trusted.map(|s| s.contribution().to_vec()).unwrap_or_default(),
            contribution_sum: trusted.map(Synergy::contribution_sum),
            mean_error_rad: trusted.map(|s| s.mean_error(postures)),
            content: trusted.and(evaluation).map(|e| content(e, task, config.synergy.components)).transpose()?,
            diverged_episodes: counters.diverged,
            buffer_warnings: counters.buffer_warnings,
            eval_warnings: evaluation.map(|e| e.warnings).unwrap_or_default(),
            mujoco_version: provenance.mujoco_version.clone(),
            stopped_by: if complete { StoppedBy::Episodes } else { StoppedBy::Interrupt },
        };
        summary.write(run.path())?;
        Ok(summary)
    }

    /// Evaluates a policy on `evaluation.other_objects`; none if there are none.
    fn evaluate_other_objects(
        &self,
        policy: &Policy,
        space: Option<&Synergy>,
        counting: Option<Counting>,
    ) -> Result<Option<OtherObjects>, TrainError> {
        let Assignment { config, other_task, .. } = &self.assignment;
        let Some(task) = other_task else { return Ok(None) };
        let mut pool = WorkerPool::halted_by(self.pool.halt(), task, config.worker_count())?;
        pool.count_with(counting);
        let (seed, stream, episodes) = (config.seed, EvaluationStream::Final, config.evaluation.final_episodes);
        let found = evaluate(&mut pool, task, policy, seed, stream, 0..episodes)?;
        let with_components = space.map(|space| {
            let driver = Driver {
                task,
                policy,
                actuators: &self.control.actuators,
                space,
                numbers: config.synergy.components,
                free_steps: 0,
            };
            driver.measure(&mut pool, config.synergy.components, seed, stream, episodes, false)
        });
        Ok(Some(OtherObjects {
            episodes: found.all.episodes,
            success_rate: found.success_rate(),
            success_rate_per_object: found.success_rate_per_object(),
            success_with_components: with_components.transpose()?.map(|driven| driven.success_rate),
        }))
    }

    /// Returns the motions of the run's policy in episodes of their own. If the run is not complete, or the policy fails in
    /// all of these episodes, they are those of the newest training episodes.
    fn motions_of(&mut self, policy: &Policy, complete: bool) -> Result<Vec<MotionRecord>, TrainError> {
        let newest = self.control.newest(self.counters.episodes).to_vec();
        if !complete {
            return Ok(newest);
        }
        let Assignment { config, task, .. } = &self.assignment;
        let (seed, episodes) = (config.seed, 0..config.evaluation.selection_episodes);
        let found = simulate(&mut self.pool, task, policy, seed, EvaluationStream::Motion, episodes, None)?;
        let own = motions(&found, &self.control.actuators, task);
        Ok(if own.is_empty() { newest } else { own })
    }

    /// Returns the map from the outputs of the learner's policy to actions; none if the outputs are the actions.
    fn map_of_numbers(&self) -> Option<&ActionMap> {
        self.learner.numbers().first().map(|numbers| &numbers.map)
    }

    /// Returns the motions of a policy that has only the first numbers of the frozen space, for each number of them.
    fn motions_with_fewer_numbers(&mut self, policy: &Policy) -> Result<Vec<(usize, Vec<MotionRecord>)>, TrainError> {
        let numbers = self.learner.numbers().to_vec();
        let Assignment { config, task, .. } = &self.assignment;
        let mut found = Vec::new();
        for numbers in &numbers {
            let Some(k) = numbers.fewer else { continue };
            let (stream, episodes) = (EvaluationStream::Motion, 0..config.evaluation.episodes);
            let episodes =
                simulate(&mut self.pool, task, &policy.in_turn(numbers), config.seed, stream, episodes, None)?;
            found.push((k, motions(&episodes, &self.control.actuators, task)));
        }
        Ok(found)
    }

    /// Chooses the run's policy, and returns it with the number of training episodes before it.
    ///
    /// A complete run compares its finalists on further episodes. An interrupted run takes the finalist with the best
    /// evaluation.
    fn choose_policy(&mut self, complete: bool, progress: &mut dyn Progress) -> Result<(Policy, u64), TrainError> {
        let finalists = self.finalists.clone();
        let episodes = self.assignment.config.evaluation.selection_episodes;
        if complete && finalists.list().len() > 1 {
            progress.note(&format!("comparing the {} best policies", finalists.list().len()));
        }
        let chosen = finalists.choose(|finalist| {
            if !complete {
                return Ok(finalist.success_rate);
            }
            let found = self.evaluate_policy(&finalist.policy, EvaluationStream::Selection, episodes)?;
            let rate = found.success_rate();
            let (after, percent) = (finalist.episode, 100.0 * rate);
            progress.note(&format!("policy after episode {after}: success {percent:.1} % of {episodes} episodes"));
            Ok(rate)
        })?;
        Ok(match chosen {
            Some(finalist) => (finalist.policy.clone(), finalist.episode),
            None => (self.learner.policy(self.assignment.config.evaluation.actor), self.counters.episodes),
        })
    }

    /// Evaluates a policy on the task.
    pub(crate) fn evaluate_policy(
        &mut self,
        policy: &Policy,
        stream: EvaluationStream,
        episodes: u64,
    ) -> Result<Evaluation, TrainError> {
        let Assignment { config, task, .. } = &self.assignment;
        evaluate(&mut self.pool, task, policy, config.seed, stream, 0..episodes)
    }
}

/// Analyses the postures of an evaluation's successes, without the slide.
fn content(evaluation: &Evaluation, task: &GraspTask, components: usize) -> Result<Content, TrainError> {
    let grasps: Vec<_> =
        evaluation.grasps.iter().map(|grasp| (grasp.object.as_str(), grasp.posture.as_slice())).collect();
    let slide = &task.actuators[task.slide_action()];
    let of_the_hand = |&i: &usize| task.posture_joints[i].name != *slide;
    let joints: Vec<usize> = (0..task.posture_joints.len()).filter(of_the_hand).collect();
    Ok(Content::new(&grasps, &joints, components)?)
}
