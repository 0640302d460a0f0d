//! Confinement to the control synergy, the motions to which it is fitted, and how well its numbers drive a hand.

use std::sync::atomic::AtomicBool;

use eigenhand_hands::{Hand, SearchPath};
use eigenhand_rl::{Policy, TensorMap};
use eigenhand_synergy::{PostureDatabase, PostureRecord, Source};
use eigenhand_train::{FinishedRun, Freedom};
use tempfile::TempDir;

use crate::gripper::{ANEW, LONGER, TURN, VANE};
use crate::support::{Run, StopAfter, gripper_with, tiny, write_gripper};
use crate::training::assert_same;

/// The same with a single component and no other feedback.
const CONFINED: [&str; 5] = [LONGER[0], LONGER[1], LONGER[2], "synergy.penalty=none", "synergy.components=1"];

/// Returns the gripper with the vane.
pub fn gripper_with_vane() -> Hand {
    gripper_with(VANE, TURN)
}

#[test]
fn confinement_survives_a_stop_and_any_number_of_workers() {
    let whole = Run::new(gripper_with_vane());
    let summary = whole.train(&tiny(&CONFINED));
    let stopped = |settings: &[&str], episodes| {
        let run = Run::new(gripper_with_vane());
        let stop = AtomicBool::new(false);
        run.start(&tiny(settings), &stop, &mut StopAfter { episodes, stop: &stop });
        run
    };
    // The first stop is before the space is settled, the second after.
    let is_settled = |run: &Run| {
        let (_, newest) = run.snapshot().into_iter().rfind(|(path, _)| path.ends_with("state.toml")).unwrap();
        String::from_utf8(newest).unwrap().contains("settled_at")
    };
    for (episodes, settled) in [(40, false), (80, true)] {
        let run = stopped(&CONFINED, episodes);
        assert_eq!(is_settled(&run), settled, "after {episodes} episodes");
        assert_same((&whole, summary.clone()), (&run, run.resume_to_the_end()));
    }
    // With two components, every other episode has one number.
    let nested = [&LONGER[..], &["synergy.components=2", "synergy.settle=0.4", "synergy.motions=4"]].concat();
    let both = Run::new(gripper_with_vane());
    let summary_of_both = both.train(&tiny(&nested));
    let run = stopped(&nested, 80);
    assert!(is_settled(&run));
    assert_same((&both, summary_of_both), (&run, run.resume_to_the_end()));
    let again = Run::new(gripper_with_vane());
    let same = again.train(&tiny(&[&CONFINED[..], &["workers=3"]].concat()));
    assert_same((&whole, summary), (&again, same));
}

#[test]
fn a_policy_ends_as_far_inside_its_synergy_as_lambda_says() {
    // Share of the commands outside the one component that the policy's map lets through: the trace of its last columns, from
    // the free actions of the hand's two actuators to their own.
    let share = |changes: &[&str]| {
        let run = Run::new(gripper_with_vane());
        let config = tiny(&[&CONFINED[..], changes].concat());
        run.train(&config);
        let tensors = TensorMap::load_bytes(&run.bytes("policy.safetensors")).unwrap();
        let policy = Policy::import_tensors(&tensors, &config.learner.normalizer).unwrap();
        policy.map().map_or(1.0, |map| {
            assert_eq!(map.n_actions(), 3);
            let at = |row: usize, column: usize| f64::from(map.matrix()[map.n_outputs() * row + column]);
            match map.n_outputs() {
                2 => 0.0,
                4 => at(1, 2) + at(2, 3),
                n => panic!("{n} outputs"),
            }
        })
    };
    for (changes, expected) in [
        (["lambda=1", "synergy.settle=0.5"], 0.0),
        (["lambda=0.75", "synergy.settle=0.5"], 0.25),
        (["lambda=0", "synergy.settle=0.5"], 1.0),
        (["lambda=1", "synergy.settle=1"], 1.0),
    ] {
        let found = share(&changes);
        assert!((found - expected).abs() < 1e-5, "{changes:?}: {found}");
    }
}

#[test]
fn a_confined_policy_has_the_frozen_space_and_learns_with_fewer_numbers() {
    let run = Run::new(gripper_with_vane());
    let settings = ["lambda=1", "synergy.components=2", "synergy.settle=0.3", "synergy.motions=4"];
    let config = tiny(&[&LONGER[..], &settings, &ANEW].concat());
    run.train(&config);
    let database = PostureDatabase::open_existing(run.file("postures.sqlite")).unwrap();
    let (postures, motions) = (database.load().unwrap(), database.motions().unwrap());
    let by_episode: Vec<_> = motions.chunk_by(|a, b| a.episode == b.episode).collect();
    // The schedule of docs/algorithms.md.
    let ready = |episode: u64| {
        let known = by_episode.iter().filter(|motion| motion[0].episode < episode).count();
        episode as f64 >= 0.3 * config.episodes as f64 && known >= 4
    };
    let settled = (0..config.episodes).step_by(config.training.episodes_per_cycle).find(|e| ready(*e)).unwrap();
    let frozen: Vec<_> = by_episode.iter().filter(|motion| motion[0].episode < settled).collect();
    let samples: Vec<&Vec<f64>> =
        frozen[frozen.len() - 4..].iter().flat_map(|motion| motion.iter().map(|step| &step.command)).collect();
    let file = eigenhand_synergy::import(run.file("synergy")).unwrap().file;
    let synergy = &file.synergy;
    assert_eq!(synergy.n_postures(), samples.len());
    for (i, mean) in synergy.mean().iter().enumerate() {
        let expected = samples.iter().map(|command| command[i]).sum::<f64>() / samples.len() as f64;
        assert!((mean - expected).abs() < 1e-12, "{mean} {expected}");
    }
    // The policy shows grasps with each number, and the ranges include those with all of them.
    let numbers: Vec<usize> = file.grasps.iter().map(|grasp| grasp.numbers).collect();
    assert!(numbers.is_sorted() && numbers.contains(&1) && numbers.contains(&2), "{numbers:?}");
    for grasp in file.grasps.iter().filter(|grasp| grasp.numbers == 2) {
        for (i, z) in grasp.held.z.iter().enumerate() {
            assert!((synergy.coefficient_min()[i]..=synergy.coefficient_max()[i]).contains(z), "{grasp:?}");
        }
    }
    // Every other episode has one number instead of two, which the policy is told.
    let confined = postures.iter().filter(|p| p.episode >= settled);
    let [even, odd]: [Vec<_>; 2] = [0, 1].map(|rest| confined.clone().filter(|p| p.episode % 2 == rest).collect());
    assert!(even.iter().any(|p| p.source == Source::Policy) && !odd.is_empty());
    assert!(odd.iter().all(|p| p.source == Source::Noise));
    let tensors = TensorMap::load_bytes(&run.bytes("policy.safetensors")).unwrap();
    let told = tensors.f32s("numbers.weight", &[config.learner.hidden[0]]).unwrap();
    assert!(told.iter().any(|weight| *weight != 0.0));
}

#[test]
fn a_motion_has_ten_steps_of_the_approach_and_ten_of_the_hold() {
    let run = Run::new(gripper_with_vane());
    let config = tiny(&LONGER);
    run.train(&config);
    let database = PostureDatabase::open_existing(run.file("postures.sqlite")).unwrap();
    let (postures, motions) = (database.load().unwrap(), database.motions().unwrap());
    let scripted = |p: &PostureRecord| p.source == Source::Script;
    assert!(postures.iter().any(scripted), "the test needs scripted successes");
    assert!(postures.iter().all(|p| scripted(p) == (p.episode < config.training.warmup_episodes)));
    let by_the_policy: Vec<u64> = postures.iter().filter(|p| p.source == Source::Policy).map(|p| p.episode).collect();
    let episodes: Vec<u64> = motions.chunk_by(|a, b| a.episode == b.episode).map(|motion| motion[0].episode).collect();
    assert_eq!(episodes, by_the_policy, "one motion for each success without noise");
    for motion in motions.chunk_by(|a, b| a.episode == b.episode) {
        assert_eq!(motion.iter().map(|step| step.held).collect::<Vec<_>>(), [[false; 10], [true; 10]].concat());
        assert!(motion.is_sorted_by_key(|step| step.step));
        assert!(motion[19].step < config.task.steps as u32);
    }
}

/// Opens a run of the gripper with the vane, whose files are written into `place`.
fn open(run: &Run, place: &TempDir) -> FinishedRun {
    let hand = place.path().join("plugins/gripper");
    std::fs::create_dir_all(&hand).unwrap();
    write_gripper(&hand, VANE, TURN);
    let mut hands = SearchPath::new();
    hands.push(place.path().join("plugins"), "the test");
    FinishedRun::open(&run.path, &hands, &[]).unwrap()
}

#[test]
fn the_space_that_is_measured_is_the_exported_one() {
    for lambda in ["lambda=0", "lambda=0.5", "lambda=1"] {
        let run = Run::new(gripper_with_vane());
        run.train(&tiny(&[&LONGER[..], &[lambda, "synergy.components=2", "synergy.settle=0.3"]].concat()));
        let place = TempDir::new().unwrap();
        let found = open(&run, &place).drive(0..=2, &Freedom::default(), 4, 3, 1, |_| {}).unwrap();
        let contribution = eigenhand_synergy::import(run.file("synergy")).unwrap().file.synergy.contribution().to_vec();
        let shares: Vec<f64> = found.rows.iter().map(|row| row.variance_share).collect();
        assert_eq!(shares, [0.0, contribution[0], contribution[0] + contribution[1]], "{lambda}");
    }
}

#[test]
fn driving_with_as_many_numbers_as_actuators_is_the_policy_and_with_fewer_it_is_not() {
    let run = Run::new(gripper_with_vane());
    let summary =
        run.train(&tiny(&[&LONGER[..], &["episodes=60", "lambda=0", "evaluation.selection_episodes=40"]].concat()));
    let place = TempDir::new().unwrap();
    let finished = open(&run, &place);
    let drive = |free: &Freedom| finished.drive(0..=2 - free.actuators.len(), free, 20, 3, 1, |_| {});
    let found = drive(&Freedom::default()).unwrap();
    let rates: Vec<f64> = found.rows.iter().map(|row| row.success_rate).collect();
    let shares: Vec<f64> = found.rows.iter().map(|row| row.variance_share).collect();
    assert_eq!((rates.len(), rates[2]), (3, found.success_rate), "two numbers for two actuators");
    assert!(found.success_rate > 0.0 && rates[0] != found.success_rate, "{rates:?}");
    assert!(shares[0] == 0.0 && shares[1] < 1.0 && (shares[2] - 1.0).abs() < 1e-12, "{shares:?}");
    let random: Vec<bool> = found.rows.iter().map(|row| row.random_success_rate.is_some()).collect();
    assert_eq!(random, [false, true, false]);
    let always = drive(&Freedom { steps: 1000, actuators: Vec::new() }).unwrap();
    assert!(always.rows.iter().all(|row| row.success_rate == found.success_rate), "no step is projected");
    let without_vane = drive(&Freedom { steps: 0, actuators: vec!["turn".to_owned()] }).unwrap();
    let error = finished.drive(0..=3, &Freedom::default(), 1, 3, 1, |_| {}).unwrap_err().to_string();
    assert!(error.contains("--components 0..3") && error.contains("expected at most 2"), "{error}");
    assert_eq!(without_vane.rows.len(), 2, "one number for the actuator that is left");
    assert_eq!(summary.success_with_components.len(), 3);
    assert_eq!(summary.success_with_components[2], summary.success_rate.unwrap());
    assert_eq!(summary.content.unwrap().n_joints, 3, "the slide does not count");
}
