//! Policies, targets and divergence.

use eigenhand_rl::{
    ActionMap, ActorChoice, Ddpg, DdpgConfig, Dimensions, Mlp, Numbers, OutputActivation, Policy, Rows, TensorMap, rng,
};
use rand_chacha::ChaCha8Rng;

use crate::{NORMALIZER, SHAPE, assert_close, learner_config, random_batch, random_episode, without};

const BATCH: usize = 16;

fn learner(config: DdpgConfig, draws: &mut ChaCha8Rng) -> Ddpg {
    let config = DdpgConfig { hidden: vec![33, 20], batch_size: BATCH, ..config };
    let mut learner = Ddpg::new(config, Dimensions::of(SHAPE), draws).unwrap();
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
    let mut learner = learner(learner_config(), &mut draws);
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    for _ in 0..20 {
        learner.update(&batch);
    }
    let policy = learner.policy(ActorChoice::Online);
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
    let policy = learner(learner_config(), &mut draws).policy(ActorChoice::Online);
    let tensors = TensorMap::load_bytes(&policy.export_tensors().save_bytes().unwrap()).unwrap();
    let imported = Policy::import_tensors(&tensors, &NORMALIZER).unwrap();
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    for i in 0..BATCH {
        let (observation, goal) = (&batch.observations[i * 5..][..5], &batch.goals[i * 2..][..2]);
        assert_eq!(act(&imported, observation, goal), act(&policy, observation, goal));
    }
    for (name, _) in tensors.iter() {
        assert!(Policy::import_tensors(&without(&tensors, name), &NORMALIZER).is_err(), "without {name}");
    }
}

#[test]
fn a_learner_that_begins_anew_keeps_what_it_knows_of_its_inputs_alone() {
    let mut draws = rng::stream(31, "policy", 0);
    let config = DdpgConfig { hidden: vec![9, 7], batch_size: BATCH, ..learner_config() };
    let mut learner = Ddpg::new(config, Dimensions::of(SHAPE), &mut draws).unwrap();
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    learner.update_normalizers(&batch.observations, &batch.goals);
    learner.update(&batch);
    let same = learner.begin_anew(Dimensions::of(SHAPE), &mut draws).unwrap().to_tensors();
    let before = learner.to_tensors();
    for (name, tensor) in before.iter() {
        let is_of_inputs = name.starts_with("observation.") || name.starts_with("goal.");
        let is_constant = name == "schema" || name.ends_with("learning_rate");
        assert!(is_constant || (same.get(name).unwrap() == tensor) == is_of_inputs, "{name}");
    }
    assert_eq!(same.u64("n_updates").unwrap(), 0);
    let smaller = Dimensions { n_outputs: 2, told_numbers: true, ..Dimensions::of(SHAPE) };
    let policy = learner.begin_anew(smaller, &mut draws).unwrap().policy(ActorChoice::Online);
    assert_eq!(policy.n_outputs(), 2);
}

/// What a policy is told is one more input, and its export adds the weights of that input to the first biases.
#[test]
fn a_policy_that_has_fewer_numbers_is_told_so() {
    let mut draws = rng::stream(28, "policy", 0);
    let config = DdpgConfig { hidden: vec![33, 20], batch_size: BATCH, ..learner_config() };
    let mut learner =
        Ddpg::new(config, Dimensions { told_numbers: true, ..Dimensions::of(SHAPE) }, &mut draws).unwrap();
    let map = |scale: f32| {
        let matrix = (0..9).map(|i| if i % 4 == 0 { scale } else { 0.0 }).collect();
        ActionMap::new(matrix, vec![0.1; 3], 3).unwrap()
    };
    let turns = [(1.0, None), (0.5, Some(1)), (1.0, None), (0.7, Some(2))];
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    let last_column = |learner: &Ddpg| -> Vec<f32> {
        let tensors = learner.to_tensors();
        let weight = |name: &str, inputs: usize, column: usize| -> Vec<f32> {
            let rows = tensors.f32s(name, &[33, inputs]).unwrap().chunks(inputs);
            rows.map(|row| row[column]).collect()
        };
        [weight("actor.0.weight", 8, 7), weight("critic.0.weight", 11, 7)].concat()
    };
    let untaught = last_column(&learner);
    learner.set_numbers(vec![Numbers { map: map(1.0), fewer: None }]);
    learner.update(&batch);
    assert_eq!(last_column(&learner), untaught, "all rows have all numbers");
    assert!(learner.policy(ActorChoice::Online).export_tensors().get("numbers.weight").is_err());
    learner.set_numbers(turns.map(|(scale, fewer)| Numbers { map: map(scale), fewer }).to_vec());
    (0..20).for_each(|_| _ = learner.update(&batch));
    assert!(last_column(&learner).iter().zip(&untaught).all(|(now, before)| now != before));
    let mut net = Mlp::zeros(&[8, 33, 20, 3], OutputActivation::Tanh);
    let tensors = learner.to_tensors();
    for (i, layer) in net.layers().to_vec().into_iter().enumerate() {
        let weight = tensors.f32s(&format!("actor.{i}.weight"), &[layer.outputs, layer.inputs]).unwrap();
        net.parameters_mut()[layer.weight()].copy_from_slice(weight);
        let bias = tensors.f32s(&format!("actor.{i}.bias"), &[layer.outputs]).unwrap();
        net.parameters_mut()[layer.bias()].copy_from_slice(bias);
    }
    let policy = learner.policy(ActorChoice::Online);
    let exported = TensorMap::load_bytes(&policy.export_tensors().save_bytes().unwrap()).unwrap();
    let imported = Policy::import_tensors(&exported, &NORMALIZER).unwrap();
    let (observation, goal) = ([0.1, -0.2, 0.3, 0.0, 0.5], [0.2, 0.4]);
    let normalised: Vec<f32> = observation.iter().chain(&goal).copied().collect();
    let mut actions = Vec::new();
    for (told, policy) in [
        (0.0, imported.clone()),
        (1.0, imported.with_fewer_numbers(1)),
        (0.5, imported.with_fewer_numbers(2)),
        (0.5, policy.with_fewer_numbers(2)),
    ] {
        let row = [&normalised[..], &[told]].concat();
        let mut scratch = net.scratch(1);
        let output = net.forward(Rows { data: &row, stride: 8 }, &mut scratch);
        let action = act(&policy, &observation, &goal);
        for (got, output) in action.iter().zip(output) {
            assert_close("action", f64::from(*got), f64::from(output + 0.1).clamp(-1.0, 1.0), 2e-6);
        }
        actions.push(action);
    }
    assert!(actions[0] != actions[1] && actions[1] != actions[2], "{actions:?}");
}

#[test]
fn a_snapshot_does_not_change_and_is_shared_between_threads() {
    let mut draws = rng::stream(22, "policy", 0);
    let mut learner = learner(learner_config(), &mut draws);
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    let policy = learner.policy(ActorChoice::Online);
    let (observation, goal) = ([0.1, -0.2, 0.3, 0.0, 0.5], [0.2, 0.4]);
    let before = act(&policy, &observation, &goal);
    learner.update(&batch);
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
    assert_ne!(act(&learner.policy(ActorChoice::Online), &observation, &goal), before);
}

#[test]
fn targets_follow_at_their_rate_and_period() {
    let mut draws = rng::stream(23, "policy", 0);
    let config = DdpgConfig { tau: 0.25, target_update_every: 2, ..learner_config() };
    let mut learner = learner(config, &mut draws);
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    let start = learner.to_tensors();
    for name in ["actor", "critic"] {
        assert_eq!(sum_of_weights(&start, name), sum_of_weights(&start, &format!("{name}_target")));
    }
    learner.update(&batch);
    let once = learner.to_tensors();
    learner.update(&batch);
    let twice = learner.to_tensors();
    for name in ["actor", "critic"] {
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
fn the_averaged_actor_is_the_mean_of_all_actors_at_first() {
    let mut draws = rng::stream(24, "policy", 0);
    let mut learner = learner(DdpgConfig { average_updates: 3, ..learner_config() }, &mut draws);
    let batch = random_batch(BATCH, SHAPE, &mut draws);
    let bias = |policy: Policy| -> Vec<f32> { policy.export_tensors().f32s("actor.2.bias", &[3]).unwrap().to_vec() };
    let mut actors = Vec::new();
    for _ in 0..3 {
        learner.update(&batch);
        actors.push(bias(learner.policy(ActorChoice::Online)));
    }
    for (i, got) in bias(learner.policy(ActorChoice::Average)).into_iter().enumerate() {
        let mean = actors.iter().map(|actor| f64::from(actor[i])).sum::<f64>() / 3.0;
        assert_close("average", f64::from(got), mean, 1e-6);
    }
    let (last, average) = (&actors[2], bias(learner.policy(ActorChoice::Average)));
    learner.update(&batch);
    for (i, got) in bias(learner.policy(ActorChoice::Average)).into_iter().enumerate() {
        let online = bias(learner.policy(ActorChoice::Online))[i];
        let expected = average[i] + (online - average[i]) / 3.0;
        assert_close("average", f64::from(got), f64::from(expected), 1e-6);
        assert_ne!(got, last[i]);
    }
    assert_ne!(bias(learner.policy(ActorChoice::Target)), bias(learner.policy(ActorChoice::Online)));
}

#[test]
fn a_learner_that_diverges_says_so() {
    let mut draws = rng::stream(25, "policy", 0);
    for (actor_lr, critic_lr) in [(1e-3, 1e30), (1e38, 1e-3)] {
        let mut learner = learner(DdpgConfig { actor_lr, critic_lr, ..learner_config() }, &mut draws);
        let finite: Vec<bool> =
            (0..10).map(|_| learner.update(&random_batch(BATCH, SHAPE, &mut draws)).is_finite()).collect();
        assert!(finite[0] && !finite[9], "rates {actor_lr} and {critic_lr}: {finite:?}");
    }
}

/// A bandit in which the best action is a known function of the observation.
#[test]
fn the_learner_finds_the_best_action() {
    let mut draws = rng::stream(26, "policy", 0);
    let config = DdpgConfig { gamma: 0.0, clip_targets: false, action_l2: 0.0, batch_size: 64, ..learner_config() };
    let config = DdpgConfig { hidden: vec![32, 32], ..config };
    let mut learner = Ddpg::new(config, Dimensions::of(SHAPE), &mut draws).unwrap();
    let best = |observation: &[f32], goal: &[f32]| [0.5 * observation[0], -0.5 * goal[1], 0.3];
    for _ in 0..1500 {
        let mut batch = random_batch(64, SHAPE, &mut draws);
        for i in 0..batch.len {
            let best = best(&batch.observations[i * 5..][..5], &batch.goals[i * 2..][..2]);
            let miss = batch.actions[i * 3..][..3].iter().zip(best).map(|(a, b)| (a - b) * (a - b));
            batch.rewards[i] = -miss.sum::<f32>();
        }
        assert!(learner.update(&batch).is_finite());
    }
    let policy = learner.policy(ActorChoice::Online);
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
        ("gamma", DdpgConfig { gamma: 1.0, ..learner_config() }),
        ("tau", DdpgConfig { tau: 0.0, ..learner_config() }),
        ("batch_size", DdpgConfig { batch_size: 0, ..learner_config() }),
        ("hidden", DdpgConfig { hidden: vec![8, 0], ..learner_config() }),
    ];
    for (name, config) in wrong {
        let error = Ddpg::new(
            config,
            Dimensions { obs_dim: 1, goal_dim: 1, act_dim: 1, n_outputs: 1, told_numbers: false },
            &mut rng::stream(0, "init", 0),
        )
        .unwrap_err();
        assert!(error.to_string().contains(&format!("`{name}`")), "{error}");
    }
    let text = serde_json::to_string(&learner_config()).unwrap();
    assert_eq!(serde_json::from_str::<DdpgConfig>(&text).unwrap(), learner_config());
    let refusal = |text: String| serde_json::from_str::<DdpgConfig>(&text).unwrap_err().to_string();
    assert!(refusal(text.replace("gamma", "gama")).contains("unknown field `gama`"));
    assert!(refusal(text.replace(r#""clip_targets":true,"#, "")).contains("missing field `clip_targets`"));
}
