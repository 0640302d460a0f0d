//! The range of every setting.

use eigenhand_rl::RlError;
use eigenhand_sim::SimError;

use super::error::InvalidSetting;
use super::{RunConfig, SCHEMA};
use crate::action_space::ActionSpace;

/// Largest weight of the feedback; its square does not overflow in single precision.
const LARGEST_WEIGHT: f64 = 1e6;

/// Most episodes of one evaluation: their data are kept until it ends.
pub const MOST_EVALUATED: u64 = 10_000;
/// Most episodes of a cycle, and of the replay.
const MOST_IN_CYCLE: u64 = 1_000;
const MOST_IN_REPLAY: u64 = 100_000;

type Outcome = Result<(), InvalidSetting>;

impl RunConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// The first key that is out of range, with the expected range.
    pub fn validate(&self) -> Result<(), InvalidSetting> {
        expect(self.schema == SCHEMA, "schema", SCHEMA, self.schema)?;
        weight("lambda", self.lambda)?;
        expect(!self.objects.is_empty(), "objects", "at least one object", "[]")?;
        expect(self.workers <= 1024, "workers", "at most 1024", self.workers)?;
        positive("episodes", self.episodes)?;
        self.validate_training()?;
        self.validate_evaluation()?;
        self.validate_synergy()?;
        self.learner.normalizer.validate().map_err(|error| of_learner("learner.normalizer", error))?;
        self.learner.validate().map_err(|error| of_learner("learner", error))?;
        self.her.validate().map_err(|error| of_learner("her", error))?;
        self.exploration.validate(0).map_err(|error| of_learner("exploration", error))?;
        self.task.validate().map_err(of_task)?;
        self.physics.validate().map_err(of_task)?;
        self.reward.validate().map_err(of_task)
    }

    fn validate_training(&self) -> Outcome {
        let t = &self.training;
        at_most("training.episodes_per_cycle", t.episodes_per_cycle as u64, MOST_IN_CYCLE)?;
        at_most("training.replay_episodes", t.replay_episodes as u64, MOST_IN_REPLAY)?;
        positive("training.checkpoint_every", t.checkpoint_every)?;
        positive("training.checkpoints_kept", t.checkpoints_kept as u64)?;
        let updates = (0.0..=1e6).contains(&t.updates_per_episode);
        expect(updates, "training.updates_per_episode", "a number from 0 to 1e6", t.updates_per_episode)?;
        let steps = t.least_held_steps >= 0.0 && t.least_held_steps.is_finite();
        expect(steps, "training.least_held_steps", "a number of at least 0", t.least_held_steps)?;
        let hold = t.slide_hold >= 1.0 && t.slide_hold.is_finite();
        expect(hold, "training.slide_hold", "a number of at least 1", t.slide_hold)?;
        share("training.decay_start", t.decay_start)?;
        share("training.final_learning_rate", t.final_learning_rate)?;
        share("training.final_noise", t.final_noise)?;
        let [from, to] = t.noise_decay;
        let rising = (0.0..=1.0).contains(&from) && (from..=1.0).contains(&to);
        let expected = "two numbers from 0 to 1 in ascending order";
        expect(rising, "training.noise_decay", expected, format!("{:?}", t.noise_decay))
    }

    fn validate_evaluation(&self) -> Outcome {
        let e = &self.evaluation;
        positive("evaluation.every", e.every)?;
        at_most("evaluation.episodes", e.episodes, MOST_EVALUATED)?;
        expect(e.finalists <= 100, "evaluation.finalists", "at most 100", e.finalists)?;
        at_most("evaluation.selection_episodes", e.selection_episodes, MOST_EVALUATED)?;
        at_most("evaluation.final_episodes", e.final_episodes, MOST_EVALUATED)
    }

    fn validate_synergy(&self) -> Outcome {
        let s = &self.synergy;
        positive("synergy.components", s.components as u64)?;
        let least = s.components.max(s.start_after);
        let covers = s.window == 0 || s.window > least;
        let needed = format!("0 or a number above {least} (the larger of synergy.components and synergy.start_after)");
        expect(covers, "synergy.window", needed, s.window)
            .map_err(|error| related(error, &["synergy.components", "synergy.start_after"]))?;
        let named = (self.action_space == ActionSpace::Synergy) != s.file.is_empty();
        expect(named, "synergy.file", "a synergy exactly where action_space = synergy", format!("{:?}", s.file))
            .map_err(|error| related(error, &["action_space"]))?;
        positive("synergy.motions", s.motions as u64)?;
        share("synergy.settle", s.settle)
    }
}

fn expect(good: bool, key: &str, expected: impl ToString, got: impl ToString) -> Outcome {
    if good {
        return Ok(());
    }
    let (expected, got) = (expected.to_string(), got.to_string());
    Err(InvalidSetting { key: key.to_owned(), related: &[], expected, got })
}

fn related(error: InvalidSetting, keys: &'static [&'static str]) -> InvalidSetting {
    InvalidSetting { related: keys, ..error }
}

fn share(key: &str, got: f64) -> Outcome {
    expect((0.0..=1.0).contains(&got), key, "a number from 0 to 1", got)
}

fn positive(key: &str, got: u64) -> Outcome {
    expect(got > 0, key, "a whole number above 0", got)
}

fn at_most(key: &str, got: u64, most: u64) -> Outcome {
    expect((1..=most).contains(&got), key, format!("a whole number from 1 to {most}"), got)
}

fn weight(key: &str, got: f64) -> Outcome {
    expect((0.0..=LARGEST_WEIGHT).contains(&got), key, "a number from 0 to 1e6", got)
}

/// Turns an error of the learner into one with the whole dotted key.
fn of_learner(section: &str, error: RlError) -> InvalidSetting {
    match error {
        RlError::Config { field, expected, got } => {
            InvalidSetting { key: format!("{section}.{field}"), related: &[], expected: expected.to_owned(), got }
        }
        other => InvalidSetting {
            key: section.to_owned(),
            related: &[],
            expected: other.to_string(),
            got: "contradictory settings".to_owned(),
        },
    }
}

fn of_task(error: SimError) -> InvalidSetting {
    match error {
        SimError::Setting { name, expected, got } => {
            InvalidSetting { key: name.to_owned(), related: &[], expected: expected.to_owned(), got }
        }
        other => InvalidSetting {
            key: "task".to_owned(),
            related: &[],
            expected: other.to_string(),
            got: "contradictory settings".to_owned(),
        },
    }
}

#[cfg(test)]
mod tests {
    use crate::config::{Layers, Preset};

    fn default() -> Layers {
        Layers::new(Preset::Default).expect("compiled in")
    }

    #[test]
    fn values_are_checked() {
        for (assignment, part) in [
            ("learner.hidden=[200000, 200000]", "at most 8 widths from 1 to 4096"),
            ("learner.hidden=[1, 1, 1, 1, 1, 1, 1, 1, 1]", "at most 8 widths"),
            ("learner.batch_size=4000000000", "from 1 to 65536"),
            ("evaluation.final_episodes=10001", "from 1 to 10000"),
            ("training.replay_episodes=100001", "from 1 to 100000"),
            ("training.episodes_per_cycle=1001", "from 1 to 1000"),
            ("lambda=-1", "lambda = -1"),
            ("objects=[]", "objects"),
            ("task.goal_height=[0.2, 0.1]", "task.goal_height"),
            ("physics.timestep=0", "physics.timestep"),
            ("learner.gamma=2", "gamma"),
            ("lambda=1e300", "lambda"),
            ("synergy.motions=0", "synergy.motions"),
            ("synergy.settle=1.5", "synergy.settle"),
            ("synergy.window=100", "synergy.window"),
            ("training.noise_decay=[0.9, 0.6]", "training.noise_decay"),
            ("training.final_noise=2", "training.final_noise"),
        ] {
            let mut layers = default();
            layers.add_assignment(assignment).expect("known");
            let message = layers.resolve().expect_err(assignment).to_string();
            assert!(message.contains(part), "{message}");
        }
        let message = default().add_assignment("seed=abc").expect_err("not a number").to_string();
        assert!(message.contains("--set seed=abc") && message.contains("a whole number"), "{message}");
    }
}
