//! Gradients against finite differences of a network written out in double precision.

use eigenhand_rl::{
    ACTION_L2_DIMENSIONS, Ddpg, DdpgConfig, Dimensions, EpisodeShape, InputGradient, LayerShape, Mlp, OutputActivation,
    Rows, RunningNormalizer, TensorMap, rng,
};
use rand::RngExt;

use crate::{NORMALIZER, assert_close, learner_config, random_batch, random_episode};

/// Half the distance of the two points of a difference quotient.
const H: f64 = 1e-6;

/// The forward pass of one row, from the definition.
fn forward(layers: &[LayerShape], parameters: &[f64], x: &[f64], tanh: bool, layer_norm: bool) -> Vec<f64> {
    let mut x = x.to_vec();
    for (i, layer) in layers.iter().enumerate() {
        let (weight, bias) = (&parameters[layer.weight()], &parameters[layer.bias()]);
        let sums = weight.chunks(layer.inputs).zip(bias);
        x = sums.map(|(row, b)| b + row.iter().zip(&x).map(|(w, x)| w * x).sum::<f64>()).collect();
        if i + 1 < layers.len() {
            if layer_norm {
                let n = x.len() as f64;
                let mean = x.iter().sum::<f64>() / n;
                let variance = x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
                x.iter_mut().for_each(|x| *x = (*x - mean) / (variance + 1e-5).sqrt());
            }
            x.iter_mut().for_each(|x| *x = x.max(0.0));
        } else if tanh {
            x.iter_mut().for_each(|x| *x = x.tanh());
        }
    }
    x
}

fn differentiate(f: impl Fn(&[f64]) -> f64, at: &[f64]) -> Vec<f64> {
    let mut point = at.to_vec();
    (0..at.len())
        .map(|i| {
            point[i] = at[i] + H;
            let above = f(&point);
            point[i] = at[i] - H;
            let below = f(&point);
            point[i] = at[i];
            (above - below) / (2.0 * H)
        })
        .collect()
}

fn doubles(x: &[f32]) -> Vec<f64> {
    x.iter().copied().map(f64::from).collect()
}

fn assert_all_close(what: &str, got: &[f32], expected: &[f64], tolerance: f64) {
    assert_eq!(got.len(), expected.len(), "{what}");
    assert!(expected.iter().any(|x| x.abs() > 10.0 * tolerance), "{what}: the gradient is too small to test");
    for (i, (got, expected)) in got.iter().zip(expected).enumerate() {
        assert_close(&format!("{what}[{i}]"), f64::from(*got), *expected, tolerance);
    }
}

fn check_network(output: OutputActivation, layer_norm: bool) {
    const BATCH: usize = 5;
    const STRIDE: usize = 7;
    let mut draws = rng::stream(11, "gradients", 0);
    let mut net = Mlp::new(&[4, 8, 6, 3], output, &mut draws);
    net.parameters_mut().iter_mut().for_each(|p| *p += draws.random_range(-0.1..0.1));
    if layer_norm {
        net = net.with_layer_norm();
    }
    let x: Vec<f32> = (0..BATCH * STRIDE).map(|_| draws.random_range(-1.0..1.0)).collect();
    let output_gradient: Vec<f32> = (0..BATCH * 3).map(|_| draws.random_range(-1.0..1.0)).collect();
    let tanh = output == OutputActivation::Tanh;
    let layers = net.layers().to_vec();
    // The sum of the outputs, each times the gradient given for it.
    let loss = |parameters: &[f64], x: &[f64]| -> f64 {
        let outputs = x.chunks(STRIDE).flat_map(|row| forward(&layers, parameters, &row[..4], tanh, layer_norm));
        outputs.zip(&output_gradient).map(|(y, g)| y * f64::from(*g)).sum()
    };

    let mut scratch = net.scratch(BATCH);
    let rows = Rows { data: &x, stride: STRIDE };
    net.forward(rows, &mut scratch);
    let (parameters, inputs) = (doubles(net.parameters()), doubles(&x));
    for (row, got) in inputs.chunks(STRIDE).zip(scratch.output().chunks(3)) {
        for (got, expected) in got.iter().zip(forward(&layers, &parameters, &row[..4], tanh, layer_norm)) {
            assert_close("output", f64::from(*got), expected, 1e-6);
        }
    }

    let mut by_parameters = vec![f32::NAN; parameters.len()];
    let mut by_inputs = vec![f32::NAN; BATCH * 2];
    let wanted = InputGradient { first: 1, out: &mut by_inputs };
    net.backward(rows, &output_gradient, &mut scratch, Some(&mut by_parameters), Some(wanted));
    assert_all_close("parameters", &by_parameters, &differentiate(|p| loss(p, &inputs), &parameters), 1e-5);
    let all_inputs = differentiate(|x| loss(&parameters, x), &inputs);
    let expected: Vec<f64> = all_inputs.chunks(STRIDE).flat_map(|row| row[1..3].to_vec()).collect();
    assert_all_close("inputs", &by_inputs, &expected, 1e-5);

    let mut alone = vec![f32::NAN; BATCH * 2];
    net.backward(rows, &output_gradient, &mut scratch, None, Some(InputGradient { first: 1, out: &mut alone }));
    assert_eq!(alone, by_inputs, "the input gradient alone");
}

#[test]
fn linear_network() {
    check_network(OutputActivation::Linear, false);
}

#[test]
fn tanh_network() {
    check_network(OutputActivation::Tanh, false);
}

#[test]
fn network_with_layer_normalisation() {
    check_network(OutputActivation::Linear, true);
}

/// All parameters of a network in a checkpoint, in the order of [`LayerShape`].
fn flat(tensors: &TensorMap, prefix: &str, layers: &[LayerShape]) -> Vec<f32> {
    let read = |name: String, shape: &[usize]| tensors.f32s(&name, shape).unwrap().to_vec();
    let layer = |(i, l): (usize, &LayerShape)| {
        let mut values = read(format!("{prefix}.{i}.weight"), &[l.outputs, l.inputs]);
        values.extend(read(format!("{prefix}.{i}.bias"), &[l.outputs]));
        values
    };
    layers.iter().enumerate().flat_map(layer).collect()
}

/// The first moment after the first step is the gradient times one minus its decay.
fn first_gradient(tensors: &TensorMap, name: &str, layers: &[LayerShape]) -> Vec<f32> {
    let moments = flat(tensors, &format!("{name}_adam.first_moment"), layers);
    moments.iter().map(|m| m / 0.1).collect()
}

#[test]
fn losses_of_actor_and_critic() {
    check_losses(false);
}

#[test]
fn losses_with_a_normalised_critic() {
    check_losses(true);
}

fn check_losses(critic_layer_norm: bool) {
    const BATCH: usize = 6;
    let shape = EpisodeShape { n_steps: 10, obs_dim: 4, goal_dim: 2, act_dim: 3, fact_dim: 0 };
    let mut draws = rng::stream(12, "gradients", 0);
    let config = DdpgConfig {
        hidden: vec![8, 8],
        batch_size: BATCH,
        critic_lr: 0.05,
        clip_targets: false,
        action_l2: 0.8,
        critic_layer_norm,
        ..learner_config()
    };
    let (gamma, action_l2) = (f64::from(config.gamma), f64::from(config.action_l2));
    let mut learner = Ddpg::new(
        config,
        Dimensions { obs_dim: 4, goal_dim: 2, act_dim: 3, n_outputs: 3, told_numbers: false },
        &mut draws,
    )
    .unwrap();
    let episode = random_episode(shape, &mut draws);
    learner.update_normalizers(&episode.observations, &episode.achieved_goals);
    let [mut observations, mut goals] = [4, 2].map(|dim| RunningNormalizer::new(NORMALIZER, dim));
    observations.update(&episode.observations);
    goals.update(&episode.achieved_goals);
    let batch = random_batch(BATCH, shape, &mut draws);
    let before = learner.to_tensors();
    let stats = learner.update(&batch);
    let after = learner.to_tensors();

    let actor_layers = Mlp::zeros(&[6, 8, 8, 3], OutputActivation::Tanh).layers().to_vec();
    let critic_layers = Mlp::zeros(&[9, 8, 8, 1], OutputActivation::Linear).layers().to_vec();
    let state = |rows: &[f32], i: usize| -> Vec<f64> {
        let (mut obs, mut goal) = ([0.0; 4], [0.0; 2]);
        observations.normalize(&rows[i * 4..][..4], &mut obs);
        goals.normalize(&batch.goals[i * 2..][..2], &mut goal);
        doubles(&[obs.as_slice(), &goal].concat())
    };
    let act = |actor: &[f64], s: &[f64]| forward(&actor_layers, actor, s, true, false);
    let value = |critic: &[f64], s: &[f64], a: &[f64]| {
        forward(&critic_layers, critic, &[s, a].concat(), false, critic_layer_norm)[0]
    };

    let actor = doubles(&flat(&before, "actor", &actor_layers));
    let critic = doubles(&flat(&before, "critic", &critic_layers));
    let targets: Vec<f64> = (0..BATCH)
        .map(|i| {
            let next = state(&batch.next_observations, i);
            f64::from(batch.rewards[i]) + gamma * value(&critic, &next, &act(&actor, &next))
        })
        .collect();
    let critic_loss = |critic: &[f64]| -> f64 {
        let square = |i: usize| {
            let action = doubles(&batch.actions[i * 3..][..3]);
            (value(critic, &state(&batch.observations, i), &action) - targets[i]).powi(2)
        };
        (0..BATCH).map(square).sum::<f64>() / BATCH as f64
    };
    assert_close("critic loss", f64::from(stats.critic_loss), critic_loss(&critic), 1e-5);
    let got = first_gradient(&after, "critic", &critic_layers);
    assert_all_close("critic", &got, &differentiate(critic_loss, &critic), 2e-5);

    let critic = doubles(&flat(&after, "critic", &critic_layers));
    let actor_loss = |actor: &[f64]| -> f64 {
        let term = |i: usize| {
            let s = state(&batch.observations, i);
            let a = act(actor, &s);
            action_l2 * a.iter().map(|a| a * a).sum::<f64>() / f64::from(ACTION_L2_DIMENSIONS) - value(&critic, &s, &a)
        };
        (0..BATCH).map(term).sum::<f64>() / BATCH as f64
    };
    assert_close("actor loss", f64::from(stats.actor_loss), actor_loss(&actor), 1e-5);
    let got = first_gradient(&after, "actor", &actor_layers);
    assert_all_close("actor", &got, &differentiate(actor_loss, &actor), 2e-5);
}
