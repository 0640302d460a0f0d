//! Made-up runs for tests.

use std::collections::BTreeMap;

use eigenhand_synergy::Content;
use eigenhand_train::{MetricsRow, Provenance, StoppedBy, Summary};

use crate::Run;

/// Makes a complete run; `with_components` is its success with 0, 1, 2... numbers.
pub fn complete(lambda: f64, seed: u64, success: f64, with_components: &[f64], k_for_95: Option<usize>) -> Run {
    let mut run = interrupted(lambda, seed);
    let summary = run.summary.as_mut().expect("a made-up summary");
    summary.stopped_by = StoppedBy::Episodes;
    summary.success_rate = Some(success);
    summary.eval_episodes = 1000;
    summary.eval_successes = Some((1000.0 * success) as u64);
    summary.success_with_components = with_components.to_vec();
    summary.k_for_95 = k_for_95;
    summary.content = Some(Content {
        n_postures: 900,
        n_objects: 7,
        n_joints: 22,
        n_components: 5,
        total_variance: 0.5 + 0.1 * seed as f64,
        between_objects: Some(0.4),
        between_objects_adjusted: Some(0.39),
        participation_ratio: Some(3.2),
        n_named_objects: 7,
        naming_accuracy: Some(0.8),
        naming_chance: Some(1.0 / 7.0),
        held_out_contribution: Some(0.91),
    });
    run
}

/// Makes a complete run whose summary an earlier version wrote.
pub fn without_few_numbers(lambda: f64, seed: u64) -> Run {
    let mut run = complete(lambda, seed, 0.9, &[], None);
    run.is_earlier = true;
    if let Some(summary) = &mut run.summary {
        summary.content = None;
    }
    run.metrics.iter_mut().for_each(|row| row.success_with_components = None);
    run
}

/// Makes an interrupted run.
pub fn interrupted(lambda: f64, seed: u64) -> Run {
    let row = |i: u64| {
        let (gain, shift) = (1.0 - (-0.4 * i as f64).exp(), 0.01 * seed as f64);
        MetricsRow {
            episode: 100 * i,
            wall_s: Some(60.0 * i as f64),
            success_rate: Some((0.98 - shift) * gain),
            success_with_components: (i > 2).then_some((0.6 + 0.3 * lambda - 2.0 * shift) * gain),
            ..MetricsRow::default()
        }
    };
    Run {
        path: format!("l{lambda}-s{seed}").into(),
        name: format!("l{lambda}-s{seed}"),
        lambda,
        seed,
        episodes: 1200,
        components: 5,
        start_after: 10,
        settings: BTreeMap::new(),
        provenance: Provenance {
            schema: 1,
            hand: "claw".to_owned(),
            hand_digest: String::new(),
            hand_directory: String::new(),
            eigenhand_version: String::new(),
            git_revision: String::new(),
            mujoco_version: String::new(),
            mujoco_library: String::new(),
            host: String::new(),
            processors: 2,
            platform: String::new(),
            started_unix_s: 0,
        },
        summary: Some(Summary {
            schema: 1,
            hand: "claw".to_owned(),
            preset: "default".to_owned(),
            lambda,
            seed,
            episodes: 1200,
            env_steps: 0,
            updates: 0,
            wall_s: 720.0,
            success_rate: None,
            success_rate_per_object: BTreeMap::new(),
            eval_episodes: 0,
            eval_successes: None,
            components: 5,
            success_with_components: Vec::new(),
            other_objects: None,
            k_for_95: None,
            mean_penetration_m: None,
            mean_self_penetration_m: None,
            policy_episode: 1200,
            last_evaluation: None,
            n_postures: 0,
            contribution: Vec::new(),
            contribution_sum: None,
            mean_error_rad: None,
            content: None,
            diverged_episodes: 0,
            buffer_warnings: 0,
            eval_warnings: Default::default(),
            mujoco_version: String::new(),
            stopped_by: StoppedBy::Interrupt,
        }),
        is_earlier: false,
        stress: None,
        metrics: (1..=12).map(row).collect(),
        control: None,
        control_error: None,
        end_variance: Vec::new(),
        picture: None,
        explorer: None,
        errors: Vec::new(),
    }
}
