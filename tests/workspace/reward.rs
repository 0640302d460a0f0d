//! Rewards of real episodes: with their own goals, as replay computes them, and with hindsight goals.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use eigenhand_hands::Hand;
use eigenhand_rl::{Batch, EpisodeData, GoalChoice, HerConfig, Replay, RewardFn, rng, sample_batch};
use eigenhand_sim::{FAILURE, GraspEnv, GraspTask, SUCCESS, StepFacts};
use eigenhand_synergy::{JointInfo, Synergy, Unit};
use eigenhand_train::feedback::{Feedback, GraspReward, Penalty};
use eigenhand_train::{Behaviour, Episode, episode_shape, run_episode};
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
            .map(|index| run_episode(&mut env, &mut scratch, &job(&policy, &behaviour, index)).unwrap())
            .collect();
        Episodes { task, episodes }
    })
}

/// Returns the reward of a task; if `active`, it uses a synergy of random postures.
fn reward(task: &GraspTask, active: bool) -> GraspReward {
    let mut feedback = Feedback::new(1.0, Penalty::Literal, 100);
    if active {
        let joints: Vec<JointInfo> = task
            .posture_joints
            .iter()
            .map(|joint| JointInfo { name: joint.name.clone(), unit: Unit::Radian, lower: -9.0, upper: 9.0 })
            .collect();
        let mut random = rng::stream(1, "postures", 0);
        let postures: Vec<Vec<f64>> =
            (0..150).map(|_| joints.iter().map(|_| random.random_range(-0.1..0.1)).collect()).collect();
        feedback.follow(Some(Synergy::fit(&joints, &postures, 2).unwrap()));
    }
    GraspReward { config: task.reward.clone(), n_joints: task.posture_joints.len(), feedback }
}

/// Returns the rewards of an episode's steps with the episode's own goal.
fn rewards(reward: &GraspReward, data: &EpisodeData) -> Vec<f32> {
    let of = |t: usize| {
        reward.reward(data.achieved_goal(t + 1), &data.desired_goal, data.observation(t + 1), data.facts_at(t))
    };
    (0..data.shape.n_steps).map(of).collect()
}

/// Returns a replay of episodes, and the number of their successful steps.
fn replay(task: &GraspTask, episodes: &[Episode], reward: &GraspReward) -> (Replay, usize) {
    let mut replay = Replay::new(episodes.len(), episode_shape(task)).unwrap();
    let mut successes = 0;
    for episode in episodes {
        let rewards = rewards(reward, &episode.data);
        successes += rewards.iter().filter(|r| **r > FAILURE).count();
        replay.push(episode.data.clone()).unwrap();
    }
    (replay, successes)
}

#[test]
fn replay_computes_the_reward_of_the_step() {
    let Episodes { task, episodes } = random_episodes();
    for active in [false, true] {
        let reward = reward(task, active);
        let (replay, successes) = replay(task, episodes, &reward);
        assert!(successes >= 10, "only {successes} steps of {EPISODES} episodes succeed");
        let mut batch = Batch::new(4000, replay.shape());
        let own_goals = HerConfig { relabel_per_real: 0.0 };
        sample_batch(&replay, &own_goals, &mut rng::stream(2, "replay", 0), &reward, &mut batch).unwrap();
        let mut kinds: HashMap<u32, usize> = HashMap::new();
        let expected: Vec<Vec<f32>> = replay.episodes().iter().map(|data| rewards(&reward, data)).collect();
        for (origin, computed) in batch.origins.iter().zip(&batch.rewards) {
            assert_eq!(origin.goal, GoalChoice::Original);
            assert_eq!(expected[origin.episode][origin.t].to_bits(), computed.to_bits(), "{origin:?}");
            *kinds.entry(computed.to_bits()).or_default() += 1;
        }
        // Without a synergy there are two different rewards; with a synergy, every success has its own.
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
        let data = &episode.data;
        for (t, got) in rewards(&reward, data).into_iter().enumerate() {
            let facts = StepFacts::from_slice(data.facts_at(t));
            let expected = if task.reward.succeeds(data.achieved_goal(t + 1), &data.desired_goal, facts) {
                checked += 1;
                let posture: Vec<f64> = data.observation(t + 1)[..n].iter().map(|q| f64::from(*q)).collect();
                -reward.feedback.synergy().unwrap().error(&posture)
            } else {
                -1.0
            };
            assert!((f64::from(got) - expected).abs() < 1e-6, "{got} {expected}");
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
        let rewards = rewards(&reward, &episode.data);
        let expected = rewards[rewards.len() - last..].iter().all(|r| *r == SUCCESS);
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
    let relabelled = batch.origins.iter().filter(|origin| origin.goal != GoalChoice::Original).count();
    assert!(relabelled > 3960, "{relabelled}");
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
                let job = job(&policy, &Behaviour::Greedy, index);
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
            assert!(
                !StepFacts::from_slice(episode.facts_at(origin.t)).touches_hand,
                "the hand must not touch the object"
            );
            let goal = &batch.goals[3 * i..3 * i + 3];
            let squared: f32 =
                episode.achieved_goal(origin.t + 1).iter().zip(goal).map(|(a, d)| (a - d) * (a - d)).sum();
            at_goal += usize::from(f64::from(squared).sqrt() < task.reward.success_distance);
            assert_eq!(batch.rewards[i], -1.0, "{origin:?}");
        }
        // By distance alone, all of these steps would succeed.
        assert!(at_goal > 900, "{}: {at_goal}", hand.manifest.name);
    }
}
