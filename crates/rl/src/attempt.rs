//! An episode that tries to grasp: come down with the hand open, close it, rise.

use rand::{Rng, RngExt};

use crate::explore::{Coordination, ExplorationConfig, SPREAD};

/// Steps of coming down, and of closing.
const DOWN: std::ops::RangeInclusive<u32> = 12..=25;
const CLOSE: std::ops::RangeInclusive<u32> = 5..=20;
/// Steps between closed and rising.
const HOLD: u32 = 5;
/// How far the hand closes, as a share of what it can, and the actions of what carries it at the end.
const SHARE: std::ops::RangeInclusive<f32> = 0.7..=1.0;
const RAISED: std::ops::RangeInclusive<f32> = -0.3..=0.7;

/// One attempt, with times and ends of its own.
#[derive(Clone, Debug)]
pub(crate) struct Attempt {
    step: u32,
    closes: u32,
    closed: u32,
    /// First and last action of each dimension; that of what carries the hand changes at once, when it rises.
    ends: Vec<[f32; 2]>,
    carries: Vec<bool>,
}

impl Attempt {
    pub(crate) fn new(config: &ExplorationConfig, rng: &mut impl Rng) -> Self {
        let closes = rng.random_range(DOWN);
        let closed = closes + rng.random_range(CLOSE);
        let share = rng.random_range(SHARE);
        let raised = rng.random_range(RAISED);
        let ends = config
            .coordination
            .iter()
            .zip(&config.start)
            .map(|(part, start)| {
                let open = (start + SPREAD * rng.random_range(-1.0..=1.0)).clamp(-1.0, 1.0);
                match part {
                    Coordination::Free => [open, open],
                    Coordination::Together(sign) => [open, open + share * (sign - open)],
                    Coordination::Ends => [-1.0, raised],
                }
            })
            .collect();
        let carries = config.coordination.iter().map(|part| *part == Coordination::Ends).collect();
        Attempt { step: 0, closes, closed, ends, carries }
    }

    /// Writes the next step's action.
    pub(crate) fn act(&mut self, action: &mut [f32]) {
        let share = (self.step.saturating_sub(self.closes) as f32 / (self.closed - self.closes) as f32).min(1.0);
        let rises = if self.step >= self.closed + HOLD { 1.0 } else { 0.0 };
        for ((action, [first, last]), carries) in action.iter_mut().zip(&self.ends).zip(&self.carries) {
            *action = first + if *carries { rises } else { share } * (last - first);
        }
        self.step += 1;
    }
}
