//! Statistics of the exploration.

use eigenhand_rl::{ActionDimension, Coordination, Exploration, ExplorationConfig, RlError, rng};

use crate::exploration_config;

const N_STEPS: usize = 40_000;

/// Actions executed over a long episode in which the policy always says `policy`.
fn run(mut exploration: Exploration, policy: &[f32], seed: u64) -> Vec<Vec<f32>> {
    let mut draws = rng::stream(seed, "explore", 0);
    (0..N_STEPS)
        .map(|_| {
            let mut action = policy.to_vec();
            exploration.apply(&mut action, &mut draws);
            assert!(action.iter().all(|a| (-1.0..=1.0).contains(a)));
            action
        })
        .collect()
}

fn noisy(config: &ExplorationConfig, policy: &[f32]) -> Vec<Vec<f32>> {
    let exploration = Exploration::noisy(config, policy.len(), &mut rng::stream(1, "explore", 1));
    run(exploration, policy, 2)
}

/// Independent noise and single random steps, as OpenAI baselines HER has them.
fn baselines() -> ExplorationConfig {
    ExplorationConfig {
        noise_sigma: 0.2,
        noise_correlation: 0.0,
        random_probability: 0.3,
        random_hold_steps: 1.0,
        ..exploration_config()
    }
}

fn held(scales: &[f32]) -> Vec<ActionDimension> {
    scales.iter().map(|&hold_scale| ActionDimension { hold_scale, ..ActionDimension::default() }).collect()
}

fn coordinated(parts: &[Coordination]) -> Vec<ActionDimension> {
    parts.iter().map(|&coordination| ActionDimension { coordination, ..ActionDimension::default() }).collect()
}

fn mean(x: impl ExactSizeIterator<Item = f32>) -> f64 {
    let n = x.len();
    x.map(f64::from).sum::<f64>() / n as f64
}

/// Lengths of the runs of equal values in one dimension.
fn holds(actions: &[Vec<f32>], dimension: usize) -> Vec<usize> {
    actions.chunk_by(|a, b| a[dimension] == b[dimension]).map(<[_]>::len).collect()
}

fn mean_hold(actions: &[Vec<f32>], dimension: usize) -> f64 {
    actions.len() as f64 / holds(actions, dimension).len() as f64
}

#[test]
fn noise_has_the_configured_deviation_and_correlation() {
    let config = ExplorationConfig { random_probability: 0.0, ..exploration_config() };
    let actions = noisy(&config, &[0.2, -0.1]);
    for (d, policy) in [(0, 0.2), (1, -0.1)] {
        let noise: Vec<f32> = actions.iter().map(|a| a[d] - policy).collect();
        let variance = mean(noise.iter().map(|x| x * x));
        let covariance = mean(noise.windows(2).map(|w| w[0] * w[1]));
        assert!(mean(noise.iter().copied()).abs() < 0.01);
        assert!((variance.sqrt() - 0.1).abs() < 0.005, "deviation {}", variance.sqrt());
        assert!((covariance / variance - 0.8).abs() < 0.02, "correlation {}", covariance / variance);
    }
    let product = mean(actions.iter().map(|a| (a[0] - 0.2) * (a[1] + 0.1)));
    assert!(product.abs() < 0.001, "dimensions are independent, covariance {product}");
}

#[test]
fn independent_noise_is_uncorrelated() {
    let config = ExplorationConfig { random_probability: 0.0, ..baselines() };
    let actions = noisy(&config, &[0.0]);
    let variance = mean(actions.iter().map(|a| a[0] * a[0]));
    let covariance = mean(actions.windows(2).map(|w| w[0][0] * w[1][0]));
    assert!((variance.sqrt() - 0.2).abs() < 0.005);
    assert!((covariance / variance).abs() < 0.02);
}

#[test]
fn the_noise_of_the_first_step_has_the_same_deviation() {
    let config = ExplorationConfig { random_probability: 0.0, ..exploration_config() };
    let mut draws = rng::stream(3, "explore", 0);
    let firsts = (0..10_000).map(|_| {
        let mut action = [0.0];
        Exploration::noisy(&config, 1, &mut draws).apply(&mut action, &mut draws);
        action[0] * action[0]
    });
    assert!((mean(firsts).sqrt() - 0.1).abs() < 0.005);
}

#[test]
fn baselines_random_steps_have_their_share() {
    let config = ExplorationConfig { noise_sigma: 0.0, ..baselines() };
    let actions = noisy(&config, &[0.5, 0.5]);
    let random = actions.iter().filter(|a| a[0] != 0.5).count() as f32 / N_STEPS as f32;
    assert!((random - 0.3).abs() < 0.01, "share {random}");
    assert!(actions.iter().all(|a| (a[0] == 0.5) == (a[1] == 0.5)), "dimensions are replaced together");
    assert!((mean_hold(&actions, 0) - 1.0 / (1.0 - 0.7 * 0.7)).abs() < 0.05, "{}", mean_hold(&actions, 0));
}

#[test]
fn random_actions_are_held_and_cover_the_range() {
    let config = ExplorationConfig { noise_sigma: 0.0, ..exploration_config() };
    let actions = noisy(&config, &[2.0 / 3.0]);
    let runs: Vec<&[Vec<f32>]> = actions.chunk_by(|a, b| a[0] == b[0]).collect();
    let random: Vec<_> = runs.iter().filter(|run| run[0][0] != 2.0 / 3.0).collect();
    let length = random.iter().map(|run| run.len()).sum::<usize>() as f64 / random.len() as f64;
    assert!((length - 5.0).abs() < 0.25, "mean hold {length}");
    // A hold of mean length h is followed by (1 - p) / p steps of the policy on average.
    let share = random.iter().map(|run| run.len()).sum::<usize>() as f64 / N_STEPS as f64;
    assert!((share - 5.0 / (5.0 + 9.0)).abs() < 0.02, "share {share}");
    let square = mean(random.iter().map(|run| run[0][0] * run[0][0]));
    assert!((square - 1.0 / 3.0).abs() < 0.02, "mean square {square}");
}

#[test]
fn warmup_ignores_the_policy_and_holds_each_group_as_scaled() {
    let config = ExplorationConfig { dimensions: held(&[1.0, 3.0, 1.0]), ..exploration_config() };
    let exploration = Exploration::warmup(&config, 3);
    let actions = run(exploration, &[f32::NAN; 3], 5);
    assert!((mean_hold(&actions, 0) - 5.0).abs() < 0.25, "{}", mean_hold(&actions, 0));
    assert!((mean_hold(&actions, 1) - 15.0).abs() < 1.0, "{}", mean_hold(&actions, 1));
    assert_eq!(holds(&actions, 0), holds(&actions, 2), "equal scales are drawn together");
    assert!(actions.iter().all(|a| a[0] != a[2]), "but not to the same value");
    assert_ne!(holds(&actions, 0), holds(&actions, 1));
}

#[test]
fn longer_holds_start_more_seldom() {
    let config = ExplorationConfig { noise_sigma: 0.0, dimensions: held(&[1.0, 4.0]), ..exploration_config() };
    let actions = noisy(&config, &[0.25, 0.25]);
    let share = |d: usize| actions.iter().filter(|a| a[d] != 0.25).count() as f64 / N_STEPS as f64;
    assert!((share(0) - 5.0 / 14.0).abs() < 0.03, "{}", share(0));
    assert!((share(1) - 20.0 / (20.0 + 39.0)).abs() < 0.04, "{}", share(1));
}

#[test]
fn coordinated_actions_close_together_and_go_to_ends() {
    use Coordination::{Ends, Free, Together};
    let dimensions = coordinated(&[Together(1.0), Together(-1.0), Ends, Free]);
    let with = |coordinated_probability, dimensions| {
        let config = ExplorationConfig { coordinated_probability, dimensions, ..exploration_config() };
        run(Exploration::warmup(&config, 4), &[0.0; 4], 5)
    };
    let actions = with(1.0, dimensions.clone());
    assert!(actions.iter().all(|a| a[2].abs() == 1.0));
    // Each of the two may be off the shared value by 0.15, and is held inside the range.
    assert!(actions.iter().all(|a| (a[0] + a[1]).abs() <= 0.3 + 1e-6), "the second closes the other way");
    let correlation =
        |a: &[Vec<f32>], d: usize| mean(a.iter().map(|a| a[0] * a[d])) / mean(a.iter().map(|a| a[0] * a[0]));
    assert!(correlation(&actions, 1) < -0.9 && correlation(&actions, 3).abs() < 0.05);
    assert!(mean(actions.iter().map(|a| a[2])).abs() < 0.05, "both ends are as frequent");
    assert!((mean_hold(&actions, 0) - 15.0).abs() < 1.0, "three times as long: {}", mean_hold(&actions, 0));
    // Half of the actions, and three quarters of the time.
    let half = with(0.5, dimensions.clone());
    let at_ends = half.iter().filter(|a| a[2].abs() == 1.0).count() as f64 / N_STEPS as f64;
    assert!((at_ends - 0.75).abs() < 0.02, "{at_ends}");
    // Without a coordination nothing is drawn for it.
    assert_eq!(with(1.0, Vec::new()), with(0.0, Vec::new()));
    assert_eq!(with(1.0, held(&[1.0; 4])), with(1.0, Vec::new()));
}

#[test]
fn an_attempt_opens_comes_down_closes_and_rises() {
    use Coordination::{Ends, Free, Together};
    let start = [-0.6, 0.5, 0.1, 0.3];
    let mut dimensions = coordinated(&[Together(1.0), Together(-1.0), Ends, Free]);
    dimensions.iter_mut().zip(start).for_each(|(dimension, start)| dimension.start = start);
    let config = ExplorationConfig { dimensions, ..exploration_config() };
    config.validate(4).unwrap();
    let mut closed_by = Vec::new();
    for episode in 0..200 {
        let mut rng = rng::stream(4, "explore", episode);
        let mut attempt = Exploration::attempt(&config, &mut rng);
        let actions: Vec<Vec<f32>> = (0..100)
            .map(|_| {
                let mut action = vec![f32::NAN; 4];
                attempt.apply(&mut action, &mut rng);
                action
            })
            .collect();
        let comes = actions.iter().position(|a| a[2] == -1.0).unwrap();
        assert!((5..=15).contains(&comes) && actions[..comes].iter().all(|a| a[2] == 0.1), "it opens at its start");
        let rises = comes + actions[comes..].iter().position(|a| a[2] != -1.0).unwrap();
        assert!((12 + 5 + 5..=25 + 20 + 5).contains(&(rises - comes)), "{rises}");
        let last = &actions[99];
        assert!(actions[rises..].iter().all(|a| a == last) && (-0.3..=0.7).contains(&last[2]), "it stays up");
        assert_eq!(actions[rises - 5][..2], last[..2], "it is closed before it rises");
        for (d, start) in start.iter().enumerate().filter(|(d, _)| *d != 2) {
            assert!((actions[0][d] - start).abs() <= 0.15 + 1e-6, "it begins open");
        }
        let fingers = |a: &[f32]| [a[0], a[1], a[3]];
        assert!(actions[..comes + 12].iter().all(|a| fingers(a) == fingers(&actions[0])), "and comes down so");
        assert!(actions.windows(2).all(|a| a[0][0] <= a[1][0] && a[0][1] >= a[1][1] && a[0][3] == a[1][3]));
        closed_by.push((last[0] - actions[0][0]) / (1.0 - actions[0][0]));
    }
    let (least, most) = closed_by.iter().fold((1.0_f32, 0.0_f32), |(low, high), &s| (low.min(s), high.max(s)));
    assert!((0.7..0.75).contains(&least) && (0.95..=1.0 + 1e-6).contains(&most), "{least} to {most}");
}

#[test]
fn none_changes_nothing() {
    assert!(run(Exploration::none(), &[0.25, -1.0], 6).iter().all(|a| a == &[0.25, -1.0]));
}

#[test]
fn wrong_values_are_refused_by_name() {
    let wrong: [(&str, ExplorationConfig); 5] = [
        ("hold_scale", ExplorationConfig { dimensions: held(&[1.0, 0.5]), ..exploration_config() }),
        ("noise_correlation", ExplorationConfig { noise_correlation: 1.0, ..exploration_config() }),
        ("random_probability", ExplorationConfig { random_probability: 1.5, ..exploration_config() }),
        ("random_hold_steps", ExplorationConfig { random_hold_steps: 0.5, ..exploration_config() }),
        ("noise_sigma", ExplorationConfig { noise_sigma: f32::NAN, ..exploration_config() }),
    ];
    for (name, config) in wrong {
        match config.validate(2) {
            Err(RlError::Config { field, .. }) => assert_eq!(field, name),
            other => panic!("{name}: {other:?}"),
        }
    }
    let config = ExplorationConfig { dimensions: held(&[1.0; 3]), ..exploration_config() };
    assert!(matches!(config.validate(2), Err(RlError::Length { name: "dimensions", expected: 2, got: 3 })));
    assert!(config.validate(3).is_ok());
    let text = serde_json::to_string(&exploration_config()).unwrap();
    assert_eq!(serde_json::from_str::<ExplorationConfig>(&text).unwrap(), exploration_config());
    let other = text.replace("noise_sigma", "noise_sigmas");
    let error = serde_json::from_str::<ExplorationConfig>(&other).unwrap_err().to_string();
    assert!(error.contains("unknown field `noise_sigmas`"), "{error}");
}
