//! Threads that share an update.

use eigenhand_rl::{Ddpg, DdpgConfig, Dimensions, TensorMap, rng};

use crate::{SHAPE, learner_config, random_batch, random_episode};

/// Learns with networks whose products are large enough to be divided.
fn learned(config: &DdpgConfig) -> TensorMap {
    let mut draws = rng::stream(41, "threads", 0);
    let mut learner = Ddpg::new(config.clone(), Dimensions::of(SHAPE), &mut draws).unwrap();
    let episode = random_episode(SHAPE, &mut draws);
    learner.update_normalizers(&episode.observations, &episode.achieved_goals);
    for _ in 0..4 {
        learner.update(&random_batch(config.batch_size, SHAPE, &mut draws));
    }
    learner.to_tensors()
}

#[test]
fn the_number_of_threads_changes_no_digit() {
    for critic_layer_norm in [false, true] {
        let config = DdpgConfig { hidden: vec![128, 128], critic_layer_norm, ..learner_config() };
        assert_eq!(config.most_threads(), 4);
        let [one, two, four] = [1, 2, 4].map(|n_threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| learned(&config))
        });
        assert!(one == two && one == four);
    }
}
