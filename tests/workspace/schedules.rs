//! What changes in the course of training, and how long random actions are held: measured in what a training leaves behind.

use eigenhand_rl::{ActorChoice, Ddpg, Dimensions, EpisodeData, TensorMap};
use eigenhand_train::config::RunConfig;
use eigenhand_train::episode_shape;

use crate::support::{Run, gripper, task, tiny};

/// Keeps the learner as it was before each cycle.
const EVERY_CYCLE: [&str; 2] = ["training.checkpoint_every=2", "training.checkpoints_kept=100"];

/// Reads the learner at a checkpoint.
fn learner(run: &Run, config: &RunConfig, episode: u64) -> Ddpg {
    let task = task(config, &gripper());
    let dimensions = Dimensions::of(episode_shape(&task));
    Ddpg::from_tensors(config.learner.clone(), dimensions, &tensors(run, episode)).unwrap()
}

fn tensors(run: &Run, episode: u64) -> TensorMap {
    TensorMap::load_bytes(&run.bytes(&format!("checkpoints/episode-{episode:08}/learner.safetensors"))).unwrap()
}

/// Reads every episode that a run stored, in order.
fn episodes(run: &Run) -> Vec<EpisodeData> {
    let bytes = run.bytes("checkpoints/replay.bin");
    let (mut rest, mut found) = (bytes.as_slice(), Vec::new());
    while !rest.is_empty() {
        let (episode, after) = EpisodeData::read_prefix(rest).unwrap();
        found.push(episode);
        rest = after;
    }
    found
}

#[test]
fn both_learning_rates_fall_from_the_named_share_of_training_on() {
    const FALLING: [&str; 3] =
        ["training.warmup_episodes=2", "training.decay_start=0.5", "training.final_learning_rate=0.1"];
    let config = tiny(&[&EVERY_CYCLE[..], &FALLING].concat());
    let run = Run::new(gripper());
    run.train(&config);
    // A checkpoint holds the rates of the updates after the cycle before it.
    for (checkpoint, factor) in [(4, 1.0), (14, 1.0), (16, 0.85), (20, 0.55), (24, 0.25)] {
        let learner = tensors(&run, checkpoint);
        for (name, rate) in [("actor", config.learner.actor_lr), ("critic", config.learner.critic_lr)] {
            let found = learner.f32s(&format!("{name}_adam.learning_rate"), &[1]).unwrap()[0];
            assert!((found / rate - factor).abs() < 1e-5, "{name} at {checkpoint}: {found} of {rate}");
        }
    }
}

#[test]
fn a_rate_that_has_fallen_to_nothing_learns_nothing() {
    // The policy handed out has learned after the last checkpoint, where training is done and the rate is the final one.
    let learned_at_last = |changes: &[&str]| {
        let run = Run::new(gripper());
        let config = tiny(&[&["evaluation.finalists=0", "evaluation.actor=online"][..], changes].concat());
        run.train(&config);
        let handed_out = TensorMap::load_bytes(&run.bytes("policy.safetensors")).unwrap();
        let before = tensors(&run, config.episodes);
        (handed_out.get("actor.0.weight").unwrap() != before.get("actor.0.weight").unwrap(), before)
    };
    let (changed, slowing) = learned_at_last(&["training.decay_start=0", "training.final_learning_rate=0"]);
    assert!(!changed, "the last updates have a rate of 0");
    let (changed, constant) = learned_at_last(&["training.decay_start=0", "training.final_learning_rate=1"]);
    assert!(changed);
    assert!(slowing != constant, "the rate falls before the end too");
    let (_, never) = learned_at_last(&["training.decay_start=1", "training.final_learning_rate=0"]);
    assert!(never == constant, "1 is never");
}

/// Returns by how much each episode's actions differ from those of the policy that acted: n_steps x act_dim numbers, none
/// where the action is at the end of its range, which cuts off the noise.
fn deviations(changes: &[&str]) -> Vec<Vec<Option<f32>>> {
    // No updates: the actor stays as it was drawn, and nothing but the noise makes two runs differ.
    const NOISY: [&str; 6] = [
        "training.warmup_episodes=0",
        "training.updates_per_episode=0",
        "exploration.noise_free_share=0",
        "exploration.noise_correlation=0.8",
        "training.noise_decay=[0.25, 0.75]",
        "evaluation.every=1000",
    ];
    let config = tiny(&[&EVERY_CYCLE[..], &NOISY, changes].concat());
    let run = Run::new(gripper());
    run.train(&config);
    let per_cycle = config.training.episodes_per_cycle;
    let of_episode = |(number, episode): (usize, EpisodeData)| {
        // A cycle's episodes are handed out with the learner of the checkpoint that was just written.
        let policy = learner(&run, &config, (number / per_cycle * per_cycle) as u64).policy(ActorChoice::Online);
        let (mut scratch, mut action) = (policy.scratch(), vec![0.0; episode.shape.act_dim]);
        let step = |t: usize| {
            policy.act(episode.observation(t), &episode.desired_goal, &mut scratch, &mut action);
            let taken = &episode.actions[t * action.len()..][..action.len()];
            let free = |(taken, wanted): (&f32, &f32)| (taken.abs() < 1.0).then_some(taken - wanted);
            taken.iter().zip(&action).map(free).collect::<Vec<_>>()
        };
        (0..episode.shape.n_steps).flat_map(step).collect()
    };
    episodes(&run).into_iter().enumerate().map(of_episode).collect()
}

/// Factors on the noise in the course of the training above, by the first episode of a cycle.
fn expected_factor(episode: usize, last: f32) -> f32 {
    let done = (episode / 2 * 2) as f32 / 24.0;
    1.0 - (1.0 - last) * ((done - 0.25) / 0.5).clamp(0.0, 1.0)
}

#[test]
fn the_noise_falls_between_two_shares_of_training_to_its_last_factor() {
    const GAUSSIAN: [&str; 2] = ["exploration.random_probability=0", "exploration.noise_sigma=0.05"];
    let constant = deviations(&[&GAUSSIAN[..], &["training.final_noise=1"]].concat());
    let falling = deviations(&[&GAUSSIAN[..], &["training.final_noise=0.2"]].concat());
    assert_eq!((constant.len(), falling.len()), (24, 24));
    for (episode, (all, less)) in constant.iter().zip(&falling).enumerate() {
        let factor = expected_factor(episode, 0.2);
        let pairs: Vec<(f32, f32)> = all.iter().zip(less).filter_map(|(all, less)| Some(((*all)?, (*less)?))).collect();
        let size = pairs.iter().map(|(all, _)| all.abs()).sum::<f32>() / pairs.len() as f32;
        assert!(pairs.len() > 30 && size > 0.01, "episode {episode}: {} values of {size}", pairs.len());
        for (all, less) in pairs {
            assert!((less - factor * all).abs() < 1e-4, "episode {episode}: {less} is not {factor} of {all}");
        }
    }
}

#[test]
fn random_actions_grow_rarer_in_the_same_proportion() {
    const RANDOM: [&str; 5] = [
        "exploration.noise_sigma=0",
        "exploration.random_probability=0.5",
        "exploration.random_hold_steps=1",
        "task.steps=200",
        "training.final_noise=0.2",
    ];
    let shares: Vec<f32> = deviations(&RANDOM)
        .iter()
        .map(|episode| episode.iter().flatten().filter(|x| x.abs() > 1e-4).count() as f32 / episode.len() as f32)
        .collect();
    let mean = |from: usize, to: usize| shares[from..to].iter().sum::<f32>() / (to - from) as f32;
    assert!((mean(0, 8) - 0.5).abs() < 0.05, "{shares:?}");
    assert!((mean(10, 16) - 0.5 * 0.6).abs() < 0.05, "{shares:?}");
    assert!((mean(18, 24) - 0.5 * 0.2).abs() < 0.03, "{shares:?}");
}

/// Counts the changes of each dimension of the actions in a training of random actions alone: the slide's, the others'.
fn changes(slide_hold: &str) -> (usize, Vec<usize>) {
    let config = tiny(&[
        "training.warmup_episodes=24",
        "exploration.random_hold_steps=4",
        "task.steps=200",
        "evaluation.every=1000",
        slide_hold,
    ]);
    let hand = gripper();
    let (run, task) = (Run::new(hand.clone()), task(&config, &hand));
    run.train(&config);
    let mut counts = vec![0; task.action_len()];
    for episode in episodes(&run) {
        let rows: Vec<&[f32]> = episode.actions.chunks_exact(counts.len()).collect();
        for pair in rows.windows(2) {
            counts.iter_mut().enumerate().for_each(|(d, count)| *count += usize::from(pair[0][d] != pair[1][d]));
        }
    }
    let slide = task.actuators.iter().position(|name| *name == hand.manifest.slide.name).unwrap();
    (counts.remove(slide), counts)
}

#[test]
fn random_actions_of_the_slide_are_held_as_many_times_longer_as_configured() {
    let (slide, others) = changes("training.slide_hold=1");
    assert!(others.iter().all(|count| *count == slide), "all are held together: {slide} {others:?}");
    let expected = 24.0 * 199.0 / 4.0;
    assert!((slide as f64 / expected - 1.0).abs() < 0.1, "{slide} of {expected}");
    let (slide, others) = changes("training.slide_hold=5");
    assert!(!others.is_empty());
    for count in others {
        assert!((count as f64 / expected - 1.0).abs() < 0.1, "{count} of {expected}");
        let ratio = count as f64 / slide as f64;
        assert!((4.0..6.0).contains(&ratio), "the slide changes {slide} times, another {count} times");
    }
}
