//! An episode that tries to grasp: the hand opens, comes down, closes and rises.

use std::ops::RangeInclusive;

use rand::{Rng, RngExt};

use super::config::{ActionDimension, Coordination, SPREAD};

/// Steps of opening.
const OPEN: RangeInclusive<u32> = 5..=15;
/// Steps of coming down.
const DOWN: RangeInclusive<u32> = 12..=25;
/// Steps of closing.
const CLOSE: RangeInclusive<u32> = 5..=20;
/// Steps from closed to rising.
const HOLD: u32 = 5;
/// Share of its way that the hand closes.
const SHARE: RangeInclusive<f32> = 0.7..=1.0;
/// Last action of the dimension that carries the hand.
const RAISED: RangeInclusive<f32> = -0.3..=0.7;

/// One attempt. It draws its own times and actions.
#[derive(Clone, Debug)]
pub(super) struct Attempt {
    step: u32,
    opened: u32,
    closes: u32,
    closed: u32,
    dimensions: Vec<Course>,
}

/// The course of one dimension, from its first action to its last.
#[derive(Clone, Copy, Debug)]
struct Course {
    /// Action while the hand opens.
    start: f32,
    first: f32,
    last: f32,
    /// Whether it carries the hand. Then it jumps to its last action when the hand rises.
    carries: bool,
}

impl Attempt {
    pub fn new(dimensions: &[ActionDimension], rng: &mut impl Rng) -> Self {
        let opened = rng.random_range(OPEN);
        let closes = opened + rng.random_range(DOWN);
        let closed = closes + rng.random_range(CLOSE);
        let share = rng.random_range(SHARE);
        let raised = rng.random_range(RAISED);
        let course = |dimension: &ActionDimension| {
            let open = (dimension.start + SPREAD * rng.random_range(-1.0..=1.0)).clamp(-1.0, 1.0);
            match dimension.coordination {
                Coordination::Free => Course { start: open, first: open, last: open, carries: false },
                Coordination::Together(sign) => {
                    Course { start: open, first: open, last: open + share * (sign - open), carries: false }
                }
                Coordination::Ends => Course { start: dimension.start, first: -1.0, last: raised, carries: true },
            }
        };
        Self { step: 0, opened, closes, closed, dimensions: dimensions.iter().map(course).collect() }
    }

    /// Writes the action of the next step.
    pub fn act(&mut self, action: &mut [f32]) {
        let share = (self.step.saturating_sub(self.closes) as f32 / (self.closed - self.closes) as f32).min(1.0);
        let rises = if self.step >= self.closed + HOLD { 1.0 } else { 0.0 };
        for (action, Course { start, first, last, carries }) in action.iter_mut().zip(&self.dimensions) {
            let done = if *carries { rises } else { share };
            *action = if self.step < self.opened { *start } else { first + done * (last - first) };
        }
        self.step += 1;
    }
}
