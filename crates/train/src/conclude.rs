//! The end of a run: choosing its policy, the final evaluation, the products and the summary.

use std::sync::atomic::{AtomicBool, Ordering};

use eigenhand_rl::Policy;
use eigenhand_synergy::Synergy;

use crate::assignment::Assignment;
use crate::error::TrainError;
use crate::evaluation::{Evaluation, EvaluationStream, evaluate};
use crate::products::{Products, write_products};
use crate::progress::Progress;
use crate::summary::{StoppedBy, Summary};
use crate::trainer::Trainer;

impl Trainer {
    /// Trains until all episodes are done or `stop` is set, then evaluates and exports.
    ///
    /// # Errors
    /// The error that stopped the run; the newest checkpoint stays valid.
    pub fn run(mut self, stop: &AtomicBool, progress: &mut dyn Progress) -> Result<Summary, TrainError> {
        self.train(stop, progress)?;
        let evaluations = &self.assignment.config.evaluation;
        let complete = self.counters.episodes >= self.assignment.config.episodes && !stop.load(Ordering::Relaxed);
        if complete {
            if self.finalists.list().len() > 1 {
                progress.note(&format!("comparing the {} best policies", self.finalists.list().len()));
            }
            progress.note(&format!("final evaluation: {} new episodes", evaluations.final_episodes));
        }
        progress.finish();
        self.conclude(complete)
    }

    /// Chooses the policy, evaluates it if the run is `complete`, and writes products and summary.
    fn conclude(mut self, complete: bool) -> Result<Summary, TrainError> {
        let (policy, policy_episode) = self.choose_policy(complete)?;
        let evaluation = if complete {
            let episodes = self.assignment.config.evaluation.final_episodes;
            Some(self.evaluate_policy(&policy, EvaluationStream::Final, episodes)?)
        } else {
            None
        };
        let wall_s = self.wall_s();
        let Trainer { assignment, pool, reward, postures, counters, .. } = self;
        // The export simulates too. Besides replay, the threads' simulations take most of the memory.
        drop(pool);
        let Assignment { config, provenance, hand, task, run } = &assignment;
        let synergy = reward.feedback.synergy();
        let postures = postures.newest();
        let products = Products {
            hand,
            task,
            config,
            provenance,
            policy: &policy,
            policy_episode: Some(policy_episode),
            synergy,
            postures,
        };
        write_products(&products, run.path())?;
        let evaluation = evaluation.as_ref();
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
            success_rate: evaluation.map(Evaluation::success_rate),
            success_rate_per_object: evaluation.map(Evaluation::success_rate_per_object).unwrap_or_default(),
            eval_episodes: evaluation.map_or(0, |e| e.all.episodes),
            eval_successes: evaluation.map(|e| e.all.successes),
            mean_penetration_m: evaluation.map(|e| e.mean_penetration),
            mean_self_penetration_m: evaluation.map(|e| e.mean_self_penetration),
            policy_episode,
            last_evaluation: counters.last_evaluation,
            n_postures: counters.postures,
            contribution: synergy.map(|s| s.contribution().to_vec()).unwrap_or_default(),
            contribution_sum: synergy.map(Synergy::contribution_sum),
            mean_error_rad: synergy.map(|s| s.mean_error(postures)),
            diverged_episodes: counters.diverged,
            buffer_warnings: counters.buffer_warnings,
            eval_warnings: evaluation.map(|e| e.warnings).unwrap_or_default(),
            mujoco_version: provenance.mujoco_version.clone(),
            stopped_by: if complete { StoppedBy::Episodes } else { StoppedBy::Interrupt },
        };
        summary.write(run.path())?;
        Ok(summary)
    }

    /// Chooses the run's policy, and returns it with the number of training episodes before it.
    ///
    /// A complete run compares its finalists on further episodes. An interrupted run takes the finalist with the best
    /// evaluation.
    fn choose_policy(&mut self, complete: bool) -> Result<(Policy, u64), TrainError> {
        let finalists = self.finalists.clone();
        let episodes = self.assignment.config.evaluation.selection_episodes;
        let chosen = finalists.choose(|finalist| {
            if !complete {
                return Ok(finalist.success_rate);
            }
            Ok(self.evaluate_policy(&finalist.policy, EvaluationStream::Selection, episodes)?.success_rate())
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
        evaluate(&mut self.pool, task, policy, config.seed, stream, episodes)
    }
}
