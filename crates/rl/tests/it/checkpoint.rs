//! Checkpoints: they hold the whole learner.

use eigenhand_rl::{Ddpg, DdpgConfig, Dimensions, RlError, Tensor, TensorMap, rng};

use crate::{SHAPE, learner_config, random_batch, random_episode, without};

const BATCH: usize = 16;
fn config() -> DdpgConfig {
    DdpgConfig { hidden: vec![16, 16], batch_size: BATCH, ..learner_config() }
}

fn trained() -> Ddpg {
    let mut draws = rng::stream(31, "checkpoint", 0);
    let mut learner = Ddpg::new(config(), Dimensions::of(SHAPE), &mut draws).unwrap();
    for _ in 0..5 {
        let episode = random_episode(SHAPE, &mut draws);
        learner.update_normalizers(&episode.observations, &episode.achieved_goals);
        learner.update(&random_batch(BATCH, SHAPE, &mut draws));
    }
    learner.set_learning_rates(2e-4, 3e-4);
    learner
}

fn load(tensors: &TensorMap) -> Result<Ddpg, RlError> {
    Ddpg::from_tensors(config(), Dimensions::of(SHAPE), tensors)
}

#[test]
fn a_restored_learner_goes_on_identically() {
    let mut learner = trained();
    let mut restored = load(&TensorMap::load_bytes(&learner.to_tensors().save_bytes().unwrap()).unwrap()).unwrap();
    assert_eq!(restored.to_tensors(), learner.to_tensors());
    assert_eq!(restored.to_tensors().u64("n_updates").unwrap(), 5);
    for i in 0..4 {
        let batch = random_batch(BATCH, SHAPE, &mut rng::stream(32, "batch", i));
        let stats = [&mut learner, &mut restored].map(|l| {
            let episode = random_episode(SHAPE, &mut rng::stream(33, "episode", i));
            l.update_normalizers(&episode.observations, &episode.achieved_goals);
            l.update(&batch)
        });
        assert_eq!(stats[0], stats[1], "update {i}");
    }
    assert_eq!(restored.to_tensors(), learner.to_tensors());
}

#[test]
fn every_tensor_is_needed_and_its_shape_checked() {
    let tensors = trained().to_tensors();
    for (name, tensor) in tensors.iter() {
        match load(&without(&tensors, name)) {
            Err(RlError::TensorMissing { name: missing }) => assert_eq!(missing, name),
            other => panic!("without {name}: {other:?}"),
        }
        let mut reshaped = tensors.clone();
        let shape: Vec<usize> = tensor.shape.iter().map(|n| n + 1).collect();
        reshaped.insert(name, Tensor { shape: shape.clone(), data: tensor.data.clone() });
        match load(&reshaped) {
            Err(RlError::TensorShape { name: wrong, expected, got }) => {
                assert_eq!((wrong.as_str(), expected, got), (name, tensor.shape.clone(), shape));
            }
            other => panic!("{name} reshaped: {other:?}"),
        }
    }
}

#[test]
fn other_tensors_types_and_schemas_are_refused() {
    let tensors = trained().to_tensors();
    let mut more = tensors.clone();
    more.insert("critic1.0.bias", Tensor::f32(vec![1], vec![0.0]));
    assert!(matches!(load(&more), Err(RlError::TensorUnexpected { name }) if name == "critic1.0.bias"));
    let mut retyped = tensors.clone();
    retyped.insert("actor.0.bias", Tensor::f64(vec![0.0; 16]));
    assert!(matches!(load(&retyped), Err(RlError::TensorType { name, expected: "F32", .. }) if name == "actor.0.bias"));
    let mut newer = tensors.clone();
    newer.insert("schema", Tensor::u64(3));
    assert!(matches!(load(&newer), Err(RlError::TensorValue { name, .. }) if name == "schema"));
    let mut broken = tensors;
    broken.insert("actor.0.bias", Tensor::f32(vec![16], vec![f32::NAN; 16]));
    assert!(matches!(load(&broken), Err(RlError::TensorValue { name, .. }) if name == "actor.0.bias"));
}

#[test]
fn a_shape_mismatch_says_what_was_expected() {
    let tensors = trained().to_tensors();
    let wider = Dimensions { obs_dim: SHAPE.obs_dim + 1, ..Dimensions::of(SHAPE) };
    let error = Ddpg::from_tensors(config(), wider, &tensors).unwrap_err().to_string();
    assert!(error.contains("`actor.0.weight`") && error.contains("[16, 8]") && error.contains("[16, 7]"), "{error}");
}

#[test]
fn cut_bytes_are_an_error() {
    let bytes = trained().to_tensors().save_bytes().unwrap();
    for len in [0, 7, 8, 100, bytes.len() - 1] {
        assert!(matches!(TensorMap::load_bytes(&bytes[..len]), Err(RlError::Format(_))), "{len}");
    }
}
