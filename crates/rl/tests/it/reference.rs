//! One whole update against numbers that `tests/data/generate_update.py` computed with NumPy.

use eigenhand_rl::{
    ACTION_L2_DIMENSIONS, ActionMap, Batch, Ddpg, DdpgConfig, Dimensions, EpisodeShape, NormalizerConfig, Numbers,
    TensorData, TensorMap,
};

use crate::{assert_close, learner_config};

const SHAPE: EpisodeShape = EpisodeShape { n_steps: 1, obs_dim: 4, goal_dim: 2, act_dim: 3, fact_dim: 0 };
const BATCH: usize = 6;

fn config(critic_layer_norm: bool) -> DdpgConfig {
    DdpgConfig {
        hidden: vec![8, 8],
        gamma: 0.9,
        tau: 0.05,
        average_updates: 3,
        critic_layer_norm,
        // The reference takes the mean.
        action_l2: 0.7 * ACTION_L2_DIMENSIONS / SHAPE.act_dim as f32,
        batch_size: BATCH,
        normalizer: NormalizerConfig { epsilon: 0.01, norm_clip: 1.5, raw_clip: 3.0 },
        ..learner_config()
    }
}

fn part(all: &TensorMap, prefix: &str) -> TensorMap {
    let mut out = TensorMap::default();
    for (name, tensor) in all.iter() {
        if let Some(name) = name.strip_prefix(prefix) {
            out.insert(name, tensor.clone());
        }
    }
    out
}

fn check_update(bytes: &[u8], critic_layer_norm: bool, with_map: bool) {
    let fixture = TensorMap::load_bytes(bytes).unwrap();
    let [obs, goal, act] = [SHAPE.obs_dim, SHAPE.goal_dim, SHAPE.act_dim];
    let before = part(&fixture, "before.");
    let mut learner = Ddpg::from_tensors(config(critic_layer_norm), Dimensions::of(SHAPE), &before).unwrap();
    let mut batch = Batch::new(BATCH, SHAPE);
    batch.observations.copy_from_slice(fixture.f32s("batch.observations", &[BATCH, obs]).unwrap());
    batch.goals.copy_from_slice(fixture.f32s("batch.goals", &[BATCH, goal]).unwrap());
    batch.actions.copy_from_slice(fixture.f32s("batch.actions", &[BATCH, act]).unwrap());
    batch.rewards.copy_from_slice(fixture.f32s("batch.rewards", &[BATCH]).unwrap());
    batch.next_observations.copy_from_slice(fixture.f32s("batch.next_observations", &[BATCH, obs]).unwrap());
    if with_map {
        let matrix = fixture.f32s("map.matrix", &[act, act]).unwrap().to_vec();
        let offset = fixture.f32s("map.offset", &[act]).unwrap().to_vec();
        learner.set_numbers(vec![Numbers { map: ActionMap::new(matrix, offset, act).unwrap(), fewer: None }]);
    }

    let stats = learner.update(&batch);

    for (name, got) in [
        ("critic_loss", stats.critic_loss),
        ("actor_loss", stats.actor_loss),
        ("q_mean", stats.q_mean),
        ("target_mean", stats.target_mean),
        ("clipped_share", stats.clipped_share),
        ("action_square_mean", stats.action_square_mean),
    ] {
        let expected = fixture.f64s(&format!("stats.{name}"), &[1]).unwrap()[0];
        assert_close(name, f64::from(got), expected, 1e-5);
    }
    let (after, expected) = (learner.to_tensors(), part(&fixture, "after."));
    assert_eq!(after.iter().count(), expected.iter().count());
    for (name, tensor) in expected.iter() {
        let got = after.get(name).unwrap();
        assert_eq!(got.shape, tensor.shape, "{name}");
        let (TensorData::F32(got), TensorData::F32(tensor)) = (&got.data, &tensor.data) else {
            assert_eq!(got.data, tensor.data, "{name}");
            continue;
        };
        for (got, expected) in got.iter().zip(tensor) {
            assert_close(name, f64::from(*got), f64::from(*expected), 2e-6);
        }
    }
}

#[test]
fn the_default_learner() {
    check_update(include_bytes!("../data/update_default.safetensors"), true, true);
}

#[test]
fn without_layer_normalisation_and_map() {
    check_update(include_bytes!("../data/update_plain.safetensors"), false, false);
}
