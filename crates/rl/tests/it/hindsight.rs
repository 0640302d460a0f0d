//! Relabelling and sampling.

use eigenhand_rl::{Batch, GoalChoice, HerConfig, Replay, RewardFn, RlError, choose_goal, rng, sample_batch};
use proptest::prelude::*;

use crate::{HER, SHAPE, random_episode};

/// A reward that depends on each of its arguments.
struct Mixed;

impl RewardFn for Mixed {
    fn reward(&self, achieved: &[f32], desired: &[f32], next_observation: &[f32], facts: &[f32]) -> f32 {
        let distance: f32 = achieved.iter().zip(desired).map(|(a, d)| (a - d) * (a - d)).sum();
        -distance + 10.0 * next_observation[0] + 100.0 * facts[0]
    }
}

fn replay(n_episodes: usize, seed: u64) -> Replay {
    let mut replay = Replay::new(n_episodes, SHAPE).unwrap();
    let mut draws = rng::stream(seed, "episodes", 0);
    for _ in 0..n_episodes {
        replay.push(random_episode(SHAPE, &mut draws)).unwrap();
    }
    replay
}

proptest! {
    #[test]
    fn future_goals_lie_after_the_step(n_steps in 1usize..200, at in 0.0f64..1.0, p in 0.0f32..=1.0, seed: u64) {
        let t = (at * n_steps as f64) as usize;
        let mut draws = rng::stream(seed, "goals", 0);
        for _ in 0..50 {
            if let GoalChoice::Achieved(future) = choose_goal(n_steps, t, p, &mut draws) {
                prop_assert!(future > t && future <= n_steps, "{future} from {t} of {n_steps}");
            }
        }
        prop_assert_eq!(choose_goal(n_steps, t, 0.0, &mut draws), GoalChoice::Original);
        prop_assert_ne!(choose_goal(n_steps, t, 1.0, &mut draws), GoalChoice::Original);
    }

    #[test]
    fn every_transition_is_its_episodes(n_episodes in 1usize..6, k in 0.0f32..10.0, seed: u64) {
        let replay = replay(n_episodes, seed);
        let mut batch = Batch::new(64, SHAPE);
        let her = HerConfig { relabel_per_real: k };
        sample_batch(&replay, &her, &mut rng::stream(seed, "replay", 0), &Mixed, &mut batch).unwrap();
        for (i, origin) in batch.origins.iter().enumerate() {
            let episode = &replay.episodes()[origin.episode];
            let t = origin.t;
            let goal = match origin.goal {
                GoalChoice::Original => &episode.desired_goal,
                GoalChoice::Achieved(future) => episode.achieved_goal(future),
            };
            prop_assert_eq!(&batch.goals[i * SHAPE.goal_dim..][..SHAPE.goal_dim], goal);
            prop_assert_eq!(&batch.observations[i * SHAPE.obs_dim..][..SHAPE.obs_dim], episode.observation(t));
            let next = episode.observation(t + 1);
            prop_assert_eq!(&batch.next_observations[i * SHAPE.obs_dim..][..SHAPE.obs_dim], next);
            prop_assert_eq!(&batch.actions[i * SHAPE.act_dim..][..SHAPE.act_dim], episode.action(t));
            let reward = Mixed.reward(episode.achieved_goal(t + 1), goal, next, episode.facts_at(t));
            prop_assert_eq!(batch.rewards[i], reward);
            if origin.goal == GoalChoice::Achieved(t + 1) {
                let best = 10.0 * next[0] + 100.0 * episode.facts_at(t)[0];
                prop_assert_eq!(batch.rewards[i], best, "a step reaches the goal it achieved");
            }
        }
    }
}

#[test]
fn shares_are_as_configured_and_draws_uniform() {
    let replay = replay(4, 3);
    let mut batch = Batch::new(40_000, SHAPE);
    sample_batch(&replay, &HER, &mut rng::stream(1, "replay", 0), &Mixed, &mut batch).unwrap();
    let share = |f: &dyn Fn(&eigenhand_rl::Origin) -> bool| {
        batch.origins.iter().filter(|o| f(o)).count() as f32 / batch.len as f32
    };
    let relabelled = share(&|o| o.goal != GoalChoice::Original);
    assert!((relabelled - 0.8).abs() < 0.01, "{relabelled}");
    for episode in 0..4 {
        assert!((share(&|o| o.episode == episode) - 0.25).abs() < 0.01);
    }
    for t in 0..SHAPE.n_steps {
        assert!((share(&|o| o.t == t) - 0.1).abs() < 0.01);
    }
    // From the first step, each of the ten later indices is as likely.
    let first: Vec<_> = batch.origins.iter().filter(|o| o.t == 0 && o.goal != GoalChoice::Original).collect();
    for future in 1..=SHAPE.n_steps {
        let n = first.iter().filter(|o| o.goal == GoalChoice::Achieved(future)).count();
        assert!((n as f32 / first.len() as f32 - 0.1).abs() < 0.03, "index {future}: {n} of {}", first.len());
    }
}

#[test]
fn an_empty_replay_is_an_error() {
    let replay = Replay::new(1, SHAPE).unwrap();
    let mut batch = Batch::new(1, SHAPE);
    let result = sample_batch(&replay, &HER, &mut rng::stream(0, "replay", 0), &Mixed, &mut batch);
    assert!(matches!(result, Err(RlError::EmptyReplay)));
}

#[test]
fn a_negative_share_is_refused() {
    let error = HerConfig { relabel_per_real: -1.0 }.validate().unwrap_err();
    assert!(error.to_string().contains("relabel_per_real"), "{error}");
}
