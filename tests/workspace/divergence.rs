//! A learner that diverges: it is noticed at once, and the run keeps what it had learned before.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use eigenhand_train::{Silent, StoppedBy, TrainError};

use crate::support::{Run, StopAfter, gripper, tiny};

/// A learning rate with which the critic's values leave the range of single precision within a few updates.
const ABSURD: f32 = 1e30;
/// Keeps the rates as they are configured, a tenth of which the error suggests.
const CONSTANT: &str = "training.decay_start=1";
/// Updates within which it is noticed.
const AT_ONCE: u64 = 3;

/// Reads every file below the checkpoints' directories; the replay's log is not one of them.
fn checkpoints(run: &Run) -> BTreeMap<PathBuf, Vec<u8>> {
    run.snapshot().into_iter().filter(|(path, _)| path.display().to_string().contains("/episode-")).collect()
}

/// Asserts that an error names what diverged, and what to try next.
fn assert_named(error: &TrainError, first: u64) {
    let TrainError::LearnerDiverged { update, critic_loss, actor_loss, q_mean, .. } = *error else { panic!("{error}") };
    assert!((first..first + AT_ONCE).contains(&update), "noticed at update {update}, absurd from {first} on");
    let finite = [critic_loss, actor_loss, q_mean].iter().all(|value| value.is_finite());
    assert!(!finite || q_mean.abs() > 1e3 || critic_loss > 1e6, "{error}");
    let message = error.to_string();
    let named = [
        format!("update {update}"),
        format!("critic loss {critic_loss}"),
        "learner.actor_lr=1e-4 --set learner.critic_lr=1e29".to_owned(),
    ];
    for part in named {
        assert!(message.contains(&part), "{message:?} does not say {part:?}");
    }
    assert!(!error.is_usage(), "a failure, not a wrong command line");
}

#[test]
fn a_learner_that_diverges_from_the_start_ends_the_run() {
    for learner in
        [&["learner.critic_layer_norm=true"][..], &["learner.critic_layer_norm=false", "learner.clip_targets=false"]]
    {
        let run = Run::new(gripper());
        let rate = format!("learner.critic_lr={ABSURD:e}");
        let config = tiny(&[&["training.checkpoint_every=6", CONSTANT, &rate][..], learner].concat());
        let error = run.try_start(&config, &AtomicBool::new(false), &mut Silent).expect_err("it diverges");
        assert_named(&error, 1);
        // Updates begin after 16 episodes.
        let (last, next) = (run.file("checkpoints/episode-00000012"), run.file("checkpoints/episode-00000018"));
        assert!(last.is_dir() && !next.exists(), "{learner:?}: a checkpoint holds a learner that diverged");
        assert!(!run.file("policy.safetensors").exists() && !run.file("summary.json").exists());
        // The last checkpoint gives a policy, with an evaluation and an export.
        let finished = run.resume_with(|config| config.episodes = 12).unwrap();
        let summary = finished.run(&AtomicBool::new(false), &mut Silent).unwrap();
        assert_eq!((summary.episodes, summary.updates, summary.stopped_by), (12, 0, StoppedBy::Episodes));
        assert!(summary.success_rate.is_some() && run.file("policy.safetensors").is_file());
    }
}

#[test]
fn a_learner_that_diverges_later_leaves_the_last_checkpoint_as_it_was() {
    let run = Run::new(gripper());
    let stop = AtomicBool::new(false);
    let stopped = run.start(&tiny(&[CONSTANT]), &stop, &mut StopAfter { episodes: 20, stop: &stop });
    assert!(stopped.updates >= 40, "{}", stopped.updates);
    let before = checkpoints(&run);
    let diverging = run.resume_with(|config| config.learner.critic_lr = ABSURD).unwrap();
    let error = diverging.run(&AtomicBool::new(false), &mut Silent).expect_err("it diverges");
    assert_named(&error, stopped.updates + 1);
    assert!(checkpoints(&run) == before, "the checkpoints have changed");
    let summary = run.resume_to_the_end();
    assert_eq!((summary.episodes, summary.updates), (24, 60));
    assert!(summary.success_rate.is_some());
}

#[test]
fn absurd_values_that_stay_finite_are_noticed() {
    for rate in ["learner.critic_lr=1e3", "learner.critic_lr=1e8"] {
        let run = Run::new(gripper());
        let config = tiny(&["learner.critic_layer_norm=true", rate]);
        let error = run.try_start(&config, &AtomicBool::new(false), &mut Silent).expect_err("it diverges");
        let TrainError::LearnerDiverged { critic_loss, q_mean, .. } = error else { panic!("{error}") };
        assert!(critic_loss.is_finite() && q_mean.is_finite(), "{rate}: {error}");
    }
}
