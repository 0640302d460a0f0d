//! Policies, targets and delays.

use eigenhand_rl::{Ddpg, DdpgConfig, Mlp, OutputActivation, Policy, Rows, TensorMap, Which, rng};
use rand_chacha::ChaCha8Rng;

use crate::{SHAPE, assert_close, random_batch, random_episode};

const BATCH: usize = 16;

fn learner(config: DdpgConfig, draws: &mut ChaCha8Rng) -> Ddpg {
    let config = DdpgConfig { hidden: vec![33, 20], batch_size: BATCH, ..config };
    let mut learner = Ddpg::new(config, SHAPE.obs_dim, SHAPE.goal_dim, SHAPE.act_dim, draws).unwrap();
    let episode = random_episode(SHAPE, draws);
    learner.update_normalizers(&episode.observations, &episode.achieved_goals);
    learner
}

fn act(policy: &Policy, observation: &[f32], goal: &[f32]) -> Vec<f32> {
    let mut action = vec![f32::NAN; policy.act_dim()];
    policy.act(observation, goal, &mut policy.scratch(), &mut action);
    action
}

/// Stands for all of a network's parameters where only a change matters.
fn sum_of_weights(tensors: &TensorMap, name: &str) -> f32 {
    let inputs = if name.starts_with("actor") { 7 } else { 10 };
    tensors.f32s(&format!("{name}.0.weight"), &[33, inputs]).unwrap().iter().sum()
}

/// Rebuilds the actor from what the policy exports and runs it as a batch.
#[test]
fn a_single_row_agrees_with_the_batched_network_and_the_export() {
    let mut draws = rng::stream(21, "policy", 0);
    let mut learner = learner(DdpgConfig::default(), &mut draws);
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    for _ in 0..20 {
        learner.update(&batch, &mut draws);
    }
    let policy = learner.policy(Which::Online);
    let tensors = TensorMap::load_bytes(&policy.export_tensors().save_bytes().unwrap()).unwrap();
    let mut net = Mlp::zeros(&[7, 33, 20, 3], OutputActivation::Tanh);
    for (i, layer) in net.layers().to_vec().into_iter().enumerate() {
        let weight = tensors.f32s(&format!("actor.{i}.weight"), &[layer.outputs, layer.inputs]).unwrap();
        net.parameters_mut()[layer.weight()].copy_from_slice(weight);
        let bias = tensors.f32s(&format!("actor.{i}.bias"), &[layer.outputs]).unwrap();
        net.parameters_mut()[layer.bias()].copy_from_slice(bias);
    }
    let scale = |name: &str, x: &[f32]| -> Vec<f32> {
        let mean = tensors.f32s(&format!("{name}.mean"), &[x.len()]).unwrap();
        let std = tensors.f32s(&format!("{name}.std"), &[x.len()]).unwrap();
        x.iter().zip(mean.iter().zip(std)).map(|(x, (m, s))| ((x - m) / s).clamp(-5.0, 5.0)).collect()
    };
    let row = |i: usize| (&batch.observations[i * 5..][..5], &batch.goals[i * 2..][..2]);
    let rows: Vec<f32> =
        (0..BATCH).flat_map(|i| [scale("observation", row(i).0), scale("goal", row(i).1)].concat()).collect();
    let mut scratch = net.scratch(BATCH);
    let batched = net.forward(Rows { data: &rows, stride: 7 }, &mut scratch);
    for (i, expected) in batched.chunks(3).enumerate() {
        for (got, expected) in act(&policy, row(i).0, row(i).1).iter().zip(expected) {
            assert_close("action", f64::from(*got), f64::from(*expected), 2e-6);
        }
    }
    assert!(batched.iter().any(|a| a.abs() > 0.01));
}

#[test]
fn an_imported_policy_acts_as_the_exported_one() {
    let mut draws = rng::stream(27, "policy", 0);
    let policy = learner(DdpgConfig::default(), &mut draws).policy(Which::Online);
    let tensors = TensorMap::load_bytes(&policy.export_tensors().save_bytes().unwrap()).unwrap();
    let normalizer = DdpgConfig::default().normalizer;
    let imported = Policy::import_tensors(&tensors, &normalizer).unwrap();
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    for i in 0..BATCH {
        let (observation, goal) = (&batch.observations[i * 5..][..5], &batch.goals[i * 2..][..2]);
        assert_eq!(act(&imported, observation, goal), act(&policy, observation, goal));
    }
    for (name, _) in tensors.iter() {
        let mut without = tensors.clone();
        without.remove(name);
        assert!(Policy::import_tensors(&without, &normalizer).is_err(), "without {name}");
    }
}

#[test]
fn a_snapshot_does_not_change_and_is_shared_between_threads() {
    let mut draws = rng::stream(22, "policy", 0);
    let mut learner = learner(DdpgConfig::default(), &mut draws);
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    let policy = learner.policy(Which::Online);
    let (observation, goal) = ([0.1, -0.2, 0.3, 0.0, 0.5], [0.2, 0.4]);
    let before = act(&policy, &observation, &goal);
    learner.update(&batch, &mut draws);
    let workers: Vec<_> = (0..3)
        .map(|_| {
            std::thread::spawn({
                let policy = policy.clone();
                move || act(&policy, &observation, &goal)
            })
        })
        .collect();
    for worker in workers {
        assert_eq!(worker.join().unwrap(), before);
    }
    assert_ne!(act(&learner.policy(Which::Online), &observation, &goal), before);
}

#[test]
fn targets_follow_at_their_rate_and_period() {
    let mut draws = rng::stream(23, "policy", 0);
    let config = DdpgConfig { tau: 0.25, target_update_every: 2, ..DdpgConfig::default() };
    let mut learner = learner(config, &mut draws);
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    let start = learner.to_tensors();
    for name in ["actor", "critic0"] {
        assert_eq!(sum_of_weights(&start, name), sum_of_weights(&start, &format!("{name}_target")));
    }
    learner.update(&batch, &mut draws);
    let once = learner.to_tensors();
    learner.update(&batch, &mut draws);
    let twice = learner.to_tensors();
    for name in ["actor", "critic0"] {
        let target = format!("{name}_target");
        let [first, last] = [&start, &once].map(|t| sum_of_weights(t, &target));
        assert_eq!(first, last, "{target} waits");
        let expected = first + 0.25 * (sum_of_weights(&twice, name) - first);
        let got = sum_of_weights(&twice, &target);
        assert_ne!(got, first, "{target} moves");
        assert_close(&target, f64::from(got), f64::from(expected), 1e-5);
    }
}

#[test]
fn a_delayed_actor_waits_while_its_target_follows() {
    let mut draws = rng::stream(24, "policy", 0);
    let mut learner = learner(DdpgConfig { actor_delay: 3, ..DdpgConfig::default() }, &mut draws);
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    let start = sum_of_weights(&learner.to_tensors(), "actor");
    for update in 1..=6 {
        let stats = learner.update(&batch, &mut draws);
        assert_eq!(stats.actor_loss.is_some(), update % 3 == 0, "update {update}");
        assert_eq!(sum_of_weights(&learner.to_tensors(), "actor") != start, update >= 3, "update {update}");
    }
    let tensors = learner.to_tensors();
    let (target, online) = (sum_of_weights(&tensors, "actor_target"), sum_of_weights(&tensors, "actor"));
    assert!(target != start && target != online);
}

#[test]
fn target_smoothing_draws_and_changes_targets() {
    let mut draws = rng::stream(25, "policy", 0);
    let plain = learner(DdpgConfig::default(), &mut draws);
    let mut smooth = Ddpg::from_tensors(
        DdpgConfig { target_smoothing: 0.5, ..plain.config().clone() },
        SHAPE.obs_dim,
        SHAPE.goal_dim,
        SHAPE.act_dim,
        &plain.to_tensors(),
    )
    .unwrap();
    let mut plain = plain;
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    let untouched = draws.get_word_pos();
    let without = plain.update(&batch, &mut draws);
    assert_eq!(draws.get_word_pos(), untouched);
    let with = smooth.update(&batch, &mut draws);
    assert_ne!(draws.get_word_pos(), untouched);
    assert_ne!(with.target_mean, without.target_mean);
}

/// A bandit in which the best action is a known function of the observation.
#[test]
fn the_learner_finds_the_best_action() {
    let mut draws = rng::stream(26, "policy", 0);
    let config =
        DdpgConfig { gamma: 0.0, clip_targets: false, action_l2: 0.0, batch_size: 64, ..DdpgConfig::default() };
    let config = DdpgConfig { hidden: vec![32, 32], ..config };
    let mut learner = Ddpg::new(config, SHAPE.obs_dim, SHAPE.goal_dim, SHAPE.act_dim, &mut draws).unwrap();
    let best = |observation: &[f32], goal: &[f32]| [0.5 * observation[0], -0.5 * goal[1], 0.3];
    for _ in 0..1500 {
        let mut batch = random_batch(64, SHAPE, &mut draws);
        for i in 0..batch.len {
            let best = best(&batch.observations[i * 5..][..5], &batch.goals[i * 2..][..2]);
            let miss = batch.actions[i * 3..][..3].iter().zip(best).map(|(a, b)| (a - b) * (a - b));
            batch.rewards[i] = -miss.sum::<f32>();
        }
        assert!(learner.update(&batch, &mut draws).is_finite());
    }
    let policy = learner.policy(Which::Online);
    let test = random_batch(64, SHAPE, &mut draws);
    let mut error = 0.0;
    for i in 0..64 {
        let (observation, goal) = (&test.observations[i * 5..][..5], &test.goals[i * 2..][..2]);
        let action = act(&policy, observation, goal);
        error += action.iter().zip(best(observation, goal)).map(|(a, b)| (a - b).abs()).sum::<f32>() / (64.0 * 3.0);
    }
    assert!(error < 0.1, "mean distance from the best action: {error}");
}

#[test]
fn wrong_constants_are_refused_by_name() {
    let wrong = [
        ("gamma", DdpgConfig { gamma: 1.0, ..DdpgConfig::default() }),
        ("tau", DdpgConfig { tau: 0.0, ..DdpgConfig::default() }),
        ("batch_size", DdpgConfig { batch_size: 0, ..DdpgConfig::default() }),
        ("actor_delay", DdpgConfig { actor_delay: 0, ..DdpgConfig::default() }),
        ("hidden", DdpgConfig { hidden: vec![8, 0], ..DdpgConfig::default() }),
    ];
    for (name, config) in wrong {
        let error = Ddpg::new(config, 1, 1, 1, &mut rng::stream(0, "init", 0)).unwrap_err();
        assert!(error.to_string().contains(&format!("`{name}`")), "{error}");
    }
    assert!(serde_json::from_str::<DdpgConfig>(r#"{"gama": 0.9}"#).is_err());
    let text = serde_json::to_string(&DdpgConfig::default()).unwrap();
    assert_eq!(serde_json::from_str::<DdpgConfig>(&text).unwrap(), DdpgConfig::default());
}
