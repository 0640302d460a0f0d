//! Rewards of real episodes: as they are stored, recomputed by replay, and in hindsight.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use eigenhand_hands::Hand;
use eigenhand_rl::{Batch, GoalChoice, HerConfig, Replay, rng, sample_batch};
use eigenhand_sim::{GraspEnv, GraspTask, StepFacts};
use eigenhand_synergy::{Feedback, JointInfo, PenaltyForm, Synergy, Unit};
use eigenhand_train::{Behaviour, Episode, GraspReward, episode_shape, run_episode};
use rand::RngExt;

use crate::support::{constant_policy, gripper, job, registry, task, tiny};

const EPISODES: u64 = 60;

struct Episodes {
    task: Arc<GraspTask>,
    episodes: Vec<Episode>,
}

/// Episodes of random actions, some of which lift the object.
fn random_episodes() -> &'static Episodes {
    static EPISODES_ONCE: OnceLock<Episodes> = OnceLock::new();
    EPISODES_ONCE.get_or_init(|| {
        let config = tiny(&[]);
        let task = task(&config, &gripper());
        let mut env = GraspEnv::new(&task).unwrap();
        let policy = constant_policy(&task, &vec![0.0; task.action_len()]);
        let behaviour = Behaviour::Warmup(Arc::new(config.exploration.clone()));
        let mut scratch = policy.scratch();
        let episodes = (0..EPISODES)
            .map(|index| run_episode(&mut env, &mut scratch, &job(&task, &policy, &behaviour, index)).unwrap())
            .collect();
        Episodes { task, episodes }
    })
}

/// The reward of a task, with the synergy of random postures when `active`.
fn reward(task: &GraspTask, active: bool) -> GraspReward {
    let mut config = tiny(&["synergy.start_after=100", "synergy.window=0"]);
    config.synergy.penalty = PenaltyForm::Saturating { cap: 0.5 };
    let mut feedback = Feedback::new(&config.penalty());
    if active {
        let joints: Vec<JointInfo> = task
            .posture_joints
            .iter()
            .map(|joint| JointInfo { name: joint.name.clone(), unit: Unit::Radian, lower: -9.0, upper: 9.0 })
            .collect();
        let mut random = rng::stream(1, "postures", 0);
        let postures: Vec<Vec<f64>> =
            (0..150).map(|_| joints.iter().map(|_| random.random_range(-0.1..0.1)).collect()).collect();
        feedback.synergy = Some(Arc::new(Synergy::fit(&joints, &postures, 2).unwrap()));
        assert!(feedback.active().is_some());
    }
    GraspReward { config: task.reward.clone(), n_joints: task.posture_joints.len(), feedback }
}

/// A replay of judged episodes, and how often the rewards succeed.
fn replay(task: &GraspTask, episodes: &[Episode], reward: &GraspReward) -> (Replay, usize) {
    let mut replay = Replay::new(episodes.len(), episode_shape(task)).unwrap();
    let mut successes = 0;
    for episode in episodes {
        let mut data = episode.data.clone();
        reward.judge(&mut data);
        successes += data.rewards.iter().filter(|r| **r > task.reward.failure as f32).count();
        replay.push(data).unwrap();
    }
    (replay, successes)
}

#[test]
fn the_stored_reward_is_the_recomputed_one() {
    let Episodes { task, episodes } = random_episodes();
    for active in [false, true] {
        let reward = reward(task, active);
        let (replay, successes) = replay(task, episodes, &reward);
        assert!(successes >= 10, "only {successes} steps of {EPISODES} episodes succeed");
        let mut batch = Batch::new(4000, replay.shape());
        let own_goals = HerConfig { relabel_per_real: 0.0 };
        sample_batch(&replay, &own_goals, &mut rng::stream(2, "replay", 0), &reward, &mut batch).unwrap();
        let mut kinds: HashMap<u32, usize> = HashMap::new();
        for (origin, recomputed) in batch.origins.iter().zip(&batch.rewards) {
            assert_eq!(origin.goal, GoalChoice::Original);
            let stored = replay.episodes()[origin.episode].rewards[origin.t];
            assert_eq!(stored.to_bits(), recomputed.to_bits(), "{origin:?}");
            *kinds.entry(recomputed.to_bits()).or_default() += 1;
        }
        // Without a synergy there are two rewards; with one, every success has its own.
        if active {
            assert!(kinds.len() > 5, "{kinds:?}");
        } else {
            assert_eq!(kinds.len(), 2, "{kinds:?}");
        }
    }
}

#[test]
fn the_penalty_is_that_of_the_posture_after_the_step() {
    let Episodes { task, episodes } = random_episodes();
    let reward = reward(task, true);
    let n = task.posture_joints.len();
    let mut checked = 0;
    for episode in episodes {
        let mut data = episode.data.clone();
        reward.judge(&mut data);
        for t in 0..data.shape.n_steps {
            let facts = StepFacts::from_slice(data.facts_at(t));
            let expected = if task.reward.succeeds(data.achieved_goal(t + 1), &data.desired_goal, facts) {
                checked += 1;
                let posture: Vec<f64> = data.observation(t + 1)[..n].iter().map(|q| f64::from(*q)).collect();
                let error = reward.feedback.active().unwrap().error(&posture);
                -0.5 * (1.0 - (-error / 0.5).exp())
            } else {
                -1.0
            };
            assert!((f64::from(data.rewards[t]) - expected).abs() < 1e-6, "{} {expected}", data.rewards[t]);
        }
    }
    assert!(checked >= 10);
}

#[test]
fn an_episode_succeeds_when_its_last_steps_do() {
    let Episodes { task, episodes } = random_episodes();
    let reward = reward(task, false);
    let last = task.config.final_steps;
    for episode in episodes {
        let mut data = episode.data.clone();
        reward.judge(&mut data);
        let expected = data.rewards[data.shape.n_steps - last..].iter().all(|r| *r == task.reward.success as f32);
        assert_eq!(episode.success, expected);
    }
    assert!(episodes.iter().any(|e| e.success) && episodes.iter().any(|e| !e.success));
}

#[test]
fn hindsight_on_lifted_objects_succeeds() {
    let Episodes { task, episodes } = random_episodes();
    let reward = reward(task, false);
    let (replay, _) = replay(task, episodes, &reward);
    let mut batch = Batch::new(4000, replay.shape());
    let always = HerConfig { relabel_per_real: 1e6 };
    sample_batch(&replay, &always, &mut rng::stream(3, "replay", 0), &reward, &mut batch).unwrap();
    assert!(batch.relabelled_share() > 0.99);
    let successes = batch.rewards.iter().filter(|r| **r == 0.0).count();
    assert!(successes > 20, "{successes}");
}

#[test]
fn a_relabelled_goal_on_an_untouched_object_earns_no_success() {
    let hands: Vec<Hand> = registry().list().iter().map(|e| e.hand.as_ref().unwrap().clone()).collect();
    for hand in hands.into_iter().chain([gripper()]) {
        let config = tiny(&["objects=[\"cube\", \"cylinder\"]", "task.orientation=any", "task.settle_time=0.4"]);
        let task = task(&config, &hand);
        // The open hand rises at once.
        let action: Vec<f32> = (0..task.action_len())
            .map(|i| {
                let (low, high) = task.control_ranges[i];
                let slide = task.actuators[i] == hand.manifest.slide.name;
                if slide { 1.0 } else { (2.0 * (task.start_controls()[i] - low) / (high - low) - 1.0) as f32 }
            })
            .collect();
        let policy = constant_policy(&task, &action);
        let mut env = GraspEnv::new(&task).unwrap();
        let episodes: Vec<Episode> = (0..6)
            .map(|index| {
                let job = job(&task, &policy, &Behaviour::Greedy, index);
                run_episode(&mut env, &mut policy.scratch(), &job).unwrap()
            })
            .collect();
        let reward = reward(&task, false);
        let (replay, successes) = replay(&task, &episodes, &reward);
        assert_eq!(successes, 0);
        let mut batch = Batch::new(1000, replay.shape());
        let always = HerConfig { relabel_per_real: 1e6 };
        sample_batch(&replay, &always, &mut rng::stream(4, "replay", 0), &reward, &mut batch).unwrap();
        let mut at_goal = 0;
        for (i, origin) in batch.origins.iter().enumerate() {
            let episode = &replay.episodes()[origin.episode];
            assert!(!StepFacts::from_slice(episode.facts_at(origin.t)).touches_hand, "the hand was to stay away");
            let goal = &batch.goals[3 * i..3 * i + 3];
            let squared: f32 =
                episode.achieved_goal(origin.t + 1).iter().zip(goal).map(|(a, d)| (a - d) * (a - d)).sum();
            at_goal += usize::from(f64::from(squared).sqrt() < task.reward.success_distance);
            assert_eq!(batch.rewards[i], -1.0, "{origin:?}");
        }
        // Nearness alone would have called all of these successes.
        assert!(at_goal > 900, "{}: {at_goal}", hand.manifest.name);
    }
}
