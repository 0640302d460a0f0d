//! The evaluations during training.

use std::sync::atomic::AtomicBool;

use eigenhand_rl::Policy;

use crate::assignment::Assignment;
use crate::config::EvaluationConfig;
use crate::counters::UpdateSums;
use crate::drive::Driver;
use crate::error::TrainError;
use crate::evaluation::EvaluationStream;
use crate::finalists::Finalist;
use crate::halt::halted_on;
use crate::metrics::MetricsRow;
use crate::progress::Progress;
use crate::trainer::Trainer;

impl Trainer {
    /// Evaluates the policy. If `stop` is set meanwhile, it leaves that at once, and the run does it when it goes on.
    pub(crate) fn evaluate_unless(&mut self, stop: &AtomicBool, progress: &mut dyn Progress) -> Result<(), TrainError> {
        let halt = self.pool.halt();
        let outcome = halted_on(stop, &halt, || self.evaluate(progress));
        self.counters.evaluation_due = matches!(outcome, Err(TrainError::Stopped));
        if self.counters.evaluation_due { Ok(()) } else { outcome }
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
        self.counters.metrics_rows += 1;
        let driven = driven.map_or_else(String::new, |(k, rate)| {
            let plural = if k == 1 { "" } else { "s" };
            format!(", with {k} number{plural} {:.1} %", 100.0 * rate)
        });
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
}
