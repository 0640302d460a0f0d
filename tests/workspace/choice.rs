//! Which of its policies a run hands out, and which of the learner's actors it is.

use eigenhand_hands::SearchPath;
use eigenhand_rl::{Policy, TensorMap};
use eigenhand_train::config::RunConfig;
use eigenhand_train::{EvaluationStream, FinishedRun, WorkerPool, evaluate};
use tempfile::TempDir;
use toml::Table;

use crate::support::{Run, gripper, task, tiny, write_gripper};

/// Each choice of an actor, with the learner's network that it is.
const ACTORS: [(&str, &str); 3] = [("online", "actor"), ("target", "actor_target"), ("average", "actor_average")];

/// Settings under which the policies of a run differ in what they achieve, and the best at first is not the best at last.
const SEVERAL: [&str; 5] = [
    "evaluation.every=4",
    "evaluation.episodes=4",
    "evaluation.finalists=4",
    "evaluation.selection_episodes=30",
    "training.updates_per_episode=10",
];

/// Reads the tensors of a file of a run.
fn tensors(run: &Run, name: &str) -> TensorMap {
    TensorMap::load_bytes(&run.bytes(name)).unwrap()
}

/// Lists the weights and biases of a network, layer by layer.
fn network(tensors: &TensorMap, name: &str) -> Vec<(String, Vec<f32>)> {
    let layers = 0..tensors.iter().filter(|(key, _)| key.starts_with("actor.") && key.ends_with(".bias")).count();
    let parts = layers.flat_map(|layer| ["weight", "bias"].map(|part| format!("{layer}.{part}")));
    let found = parts.map(|part| {
        let key = format!("{name}.{part}");
        let shape = tensors.get(&key).unwrap_or_else(|error| panic!("{error}")).shape.clone();
        let values = tensors.f32s(&key, &shape).unwrap().to_vec();
        (part, values)
    });
    let found: Vec<_> = found.collect();
    assert!(found.len() > 2, "{name} has {} tensors", found.len());
    found
}

/// Returns the number of training episodes before the policy, as `policy.toml` tells it.
fn episode_in_policy_toml(run: &Run) -> i64 {
    let record: Table = String::from_utf8(run.bytes("policy.toml")).unwrap().parse().unwrap();
    record["policy_episode"].as_integer().unwrap()
}

/// The finalists of a run's last checkpoint: training episodes before each, its first success rate, the file of its policy.
fn finalists(run: &Run, episodes: u64) -> Vec<(u64, f64, String)> {
    let checkpoint = format!("checkpoints/episode-{episodes:08}");
    let state: Table = String::from_utf8(run.bytes(&format!("{checkpoint}/state.toml"))).unwrap().parse().unwrap();
    let read = |record: &toml::Value| {
        let episode = record["episode"].as_integer().unwrap() as u64;
        let file = format!("{checkpoint}/policy-{episode:08}.safetensors");
        (episode, record["success_rate"].as_float().unwrap(), file)
    };
    state["finalists"].as_array().unwrap().iter().map(read).collect()
}

/// Measures the success rate of a policy on the episodes by which finalists are compared.
fn second_look(run: &Run, config: &RunConfig, file: &str) -> f64 {
    let task = task(config, &gripper());
    let policy = Policy::import_tensors(&tensors(run, file), &config.learner.normalizer).unwrap();
    let mut pool = WorkerPool::new(&task, 1).unwrap();
    let episodes = config.evaluation.selection_episodes;
    evaluate(&mut pool, &task, &policy, config.seed, EvaluationStream::Selection, 0..episodes).unwrap().success_rate()
}

#[test]
fn the_finalist_that_does_best_at_the_second_look_is_handed_out() {
    let mut overruled = 0;
    for seed in [1, 4, 6] {
        let config = tiny(&[&SEVERAL[..], &[&format!("seed={seed}")]].concat());
        let run = Run::new(gripper());
        let summary = run.train(&config);
        let found = finalists(&run, config.episodes);
        assert_eq!(found.len(), config.evaluation.finalists);
        assert!(found.is_sorted_by(|a, b| a.1 >= b.1), "the best first: {found:?}");
        let again: Vec<f64> = found.iter().map(|(_, _, file)| second_look(&run, &config, file)).collect();
        let best = again.iter().copied().fold(0.0, f64::max);
        let chosen = again.iter().position(|rate| *rate == best).unwrap();
        overruled += usize::from(chosen > 0);
        let (episode, _, file) = &found[chosen];
        assert_eq!(summary.policy_episode, *episode, "seed {seed}: {found:?} {again:?}");
        assert_eq!(episode_in_policy_toml(&run), *episode as i64);
        assert!(run.bytes("policy.safetensors") == run.bytes(file), "seed {seed}: {file}");
        assert!(export_of(&run) == run.bytes(file), "seed {seed}: the export holds another policy");
    }
    assert!(overruled > 0, "the test needs a run whose best evaluation is not confirmed");
}

/// Exports a run as the command does, and returns the bytes of the policy.
fn export_of(run: &Run) -> Vec<u8> {
    let place = TempDir::new().unwrap();
    let hand = place.path().join("plugins/gripper");
    std::fs::create_dir_all(&hand).unwrap();
    write_gripper(&hand, "", "");
    let mut hands = SearchPath::new();
    hands.push(place.path().join("plugins"), "the test");
    let out = place.path().join("export");
    FinishedRun::open(&run.path, &hands, &[]).unwrap().export(&out).unwrap();
    std::fs::read(out.join("policy.safetensors")).unwrap()
}

#[test]
fn the_named_actor_is_handed_out() {
    for (choice, name) in ACTORS {
        let run = Run::new(gripper());
        let actor = format!("evaluation.actor={choice}");
        // The one evaluation is that of the last checkpoint, so the one finalist is that checkpoint's.
        let config = tiny(&["evaluation.every=1000", "evaluation.finalists=1", &actor]);
        let summary = run.train(&config);
        assert_eq!(summary.policy_episode, config.episodes);
        let learner = tensors(&run, &format!("checkpoints/episode-{:08}/learner.safetensors", config.episodes));
        let handed_out = network(&tensors(&run, "policy.safetensors"), "actor");
        for (_, network_name) in ACTORS {
            let same = handed_out == network(&learner, network_name);
            assert_eq!(same, network_name == name, "evaluation.actor={choice}: {network_name}");
        }
    }
}

#[test]
fn without_finalists_the_last_policy_is_handed_out() {
    // A constant rate and a policy that stays in joint space, so that a longer run learns the same up to the shorter one's end.
    const CONSTANT: [&str; 5] = [
        "evaluation.finalists=0",
        "training.decay_start=1",
        "training.final_learning_rate=1",
        "training.noise_decay=[1, 1]",
        "synergy.settle=1",
    ];
    for (choice, name) in ACTORS {
        let actor = format!("evaluation.actor={choice}");
        let config = tiny(&[&CONSTANT[..], &[&actor]].concat());
        let run = Run::new(gripper());
        let summary = run.train(&config);
        assert_eq!((summary.policy_episode, episode_in_policy_toml(&run)), (24, 24));
        let longer = Run::new(gripper());
        longer.train(&tiny(&[&CONSTANT[..], &["episodes=26", "training.checkpoint_every=2"]].concat()));
        let handed_out = network(&tensors(&run, "policy.safetensors"), "actor");
        // Checkpoints are written before what is learned after their episodes: the policy is newer than the run's last.
        let [last, next] = [(&run, 24), (&longer, 26)].map(|(run, episode)| {
            network(&tensors(run, &format!("checkpoints/episode-{episode:08}/learner.safetensors")), name)
        });
        assert!(handed_out == next, "{choice}: not what was learned last");
        assert!(handed_out != last, "{choice}: nothing was learned after the last checkpoint");
    }
}
