//! Few numbers in place of all actions: the maps through which an actor acts in turn, and what it is told of them.

use crate::ActionMap;

/// A space of actions with few dimensions.
#[derive(Clone, Debug, PartialEq)]
pub struct Numbers {
    /// The map from the actor's outputs to its actions.
    pub map: ActionMap,
    /// Its dimensions, if they are fewer than the policy has at the end.
    pub fewer: Option<usize>,
}

impl Numbers {
    /// (fewer dimensions) => what the networks are told: 0 if there are no fewer
    pub(crate) fn told(fewer: Option<usize>) -> f32 {
        fewer.map_or(0.0, |k| 1.0 / k.max(1) as f32)
    }
}

/// (rows of inputs, the actor's outputs) => the actions in the last part of each row
pub(crate) fn write_actions(input: &mut [f32], stride: usize, outputs: &[f32], act_dim: usize, numbers: &[Numbers]) {
    let actions = input.chunks_exact_mut(stride).map(|row| &mut row[stride - act_dim..]);
    let Some(first) = numbers.first() else {
        actions.zip(outputs.chunks_exact(act_dim)).for_each(|(action, output)| action.copy_from_slice(output));
        return;
    };
    let outputs = outputs.chunks_exact(first.map.n_outputs());
    for ((action, output), Numbers { map, .. }) in actions.zip(outputs).zip(numbers.iter().cycle()) {
        map.apply(output, action);
        action.iter_mut().for_each(|a| *a = a.clamp(-1.0, 1.0));
    }
}

/// (rows of inputs with the clamped actions, gradient by them) => gradient by the actor's outputs
///
/// A clamped action does not change with the outputs, so its gradient is left out.
pub(crate) fn pull_back(
    numbers: &[Numbers],
    input: &[f32],
    stride: usize,
    by_action: &mut [f32],
    by_output: &mut [f32],
) {
    let (act_dim, n_outputs) = (numbers[0].map.n_actions(), numbers[0].map.n_outputs());
    let rows = input.chunks_exact(stride).zip(by_action.chunks_exact_mut(act_dim)).zip(numbers.iter().cycle());
    for (((row, by_action), Numbers { map, .. }), by_output) in rows.zip(by_output.chunks_exact_mut(n_outputs)) {
        for (gradient, action) in by_action.iter_mut().zip(&row[stride - act_dim..]) {
            *gradient = if action.abs() < 1.0 { *gradient } else { 0.0 };
        }
        map.pull_back(by_action, by_output);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_take_turns_with_the_maps() {
        let through = |matrix: [f32; 2], offset: f32| Numbers {
            map: ActionMap::new(matrix.to_vec(), vec![offset], 2).unwrap(),
            fewer: None,
        };
        let maps = [through([1.0, 2.0], 0.0), through([0.5, 0.0], 0.25)];
        // Rows of one state and one action.
        let mut rows = [9.0, 0.0, 9.0, 0.0, 9.0, 0.0];
        write_actions(&mut rows, 2, &[0.1, 0.2, 0.1, 0.2, 1.0, 1.0], 1, &maps);
        assert_eq!(rows, [9.0, 0.5, 9.0, 0.3, 9.0, 1.0]);
        let mut by_output = [7.0; 6];
        pull_back(&maps, &rows, 2, &mut [1.0, 1.0, 1.0], &mut by_output);
        assert_eq!(by_output, [1.0, 2.0, 0.5, 0.0, 0.0, 0.0], "a clamped action has no gradient");
    }
}
