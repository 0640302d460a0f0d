//! Scripted grasps, which choose how a hand approaches an object and its place above it, and tell whether it can grasp.
//!
//! In training, a hand moves only up and down, so its place limits the grasps that it can learn. Nothing is learned
//! here: the hand comes down, closes, and raises the object to its goal.

use std::collections::BTreeMap;
use std::sync::Arc;

use eigenhand_sim::{GraspTask, SimError};

mod script;
mod search;

use script::{Grasp, Job, Scripts};
pub use script::{Lifted, lift};
use search::Places;

/// Distance in m between two places that are tried, for objects of scale 1.
const STEP: f64 = 0.02;
/// Weights of a grasp that reaches its goal, and of one that only lifts the object.
const REACHED: f64 = 1.0;
const LIFTED: f64 = 0.25;
/// Weight of the distance by which closing drags the object aside, per m.
const DRAG: f64 = 4.0;
/// What a place must be better by for each step from the middle: of a hand, and of a gripper with two fingertips, whose
/// jaws meet in the middle.
const PER_STEP: f64 = 0.02;
const PER_STEP_OF_TWO: f64 = 0.08;

/// Receives how far a search is: grasps that are done, and grasps in all. Several threads call it.
pub type OnGrasp<'a> = dyn Fn(usize, usize) + Sync + 'a;

/// The best place of a hand, and the grasps there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Distance in m by which the hand must be moved along x and y.
    pub shift: [f64; 2],
    /// The grasps at this place.
    pub grasps: Tally,
    /// What the place is worth: about the share of grasps that reach their goal there and beside it.
    pub merit: f64,
}

/// What became of some scripted grasps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// Number of grasps.
    pub tried: u32,
    /// Grasps after which the hand holds the object above the plane.
    pub lifted: u32,
    /// Grasps that succeed as episodes of training do: the object is held at its goal.
    pub reached: u32,
    /// Grasps after which the closed hand does not touch the object.
    pub missed: u32,
    /// Mean distance in m by which lifted objects were dragged aside.
    pub drag: f64,
    /// Median height in m above rest to which the top of the slide lifts the objects; none if nothing was lifted.
    pub height: Option<f64>,
}

impl Tally {
    fn of(grasps: &[Grasp]) -> Tally {
        let lifted: Vec<&Grasp> = grasps.iter().filter(|grasp| grasp.lifted).collect();
        let mut heights: Vec<f64> = lifted.iter().map(|grasp| grasp.height).collect();
        heights.sort_by(f64::total_cmp);
        let count = |which: fn(&Grasp) -> bool| grasps.iter().filter(|grasp| which(grasp)).count() as u32;
        Tally {
            tried: grasps.len() as u32,
            lifted: lifted.len() as u32,
            reached: count(|grasp| grasp.reached),
            missed: count(|grasp| grasp.missed),
            drag: lifted.iter().map(|grasp| grasp.drag).sum::<f64>() / lifted.len().max(1) as f64,
            height: heights.get(heights.len() / 2).copied(),
        }
    }

    /// Returns what a place with these grasps is worth, without its neighbours.
    fn worth(&self) -> f64 {
        let share = |count: u32| f64::from(count) / f64::from(self.tried.max(1));
        REACHED * share(self.reached) + LIFTED * share(self.lifted) - DRAG * self.drag * share(self.lifted)
    }
}

/// How thoroughly the places of a hand are searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Search {
    /// Few grasps at places along the fingers, with which the directions of approach of a hand can be compared.
    Quick,
    /// Few grasps at places on a grid, along the fingers and across them, and more at the best of these and beside them.
    Whole,
}

/// Searches the place of a hand by scripted grasps, and returns the best one.
///
/// The grasps at neighbouring places count too, because objects do not lie exactly where the hand expects them.
/// `closing` is 1 for an actuator that closes the hand at the upper end of its range, and -1 for one that closes it at
/// the lower end. `scale` is the factor on the objects' lengths.
///
/// # Errors
/// As [`GraspEnv::new`](eigenhand_sim::GraspEnv::new).
pub fn best_place(
    task: &Arc<GraspTask>,
    closing: &BTreeMap<String, f64>,
    scale: f64,
    n_fingertips: usize,
    search: Search,
    on_grasp: &OnGrasp,
) -> Result<Place, SimError> {
    let mut scripts = Scripts::new(task, closing, STEP * scale)?;
    let run = |jobs: &[Job], done: &(dyn Fn(usize) + Sync)| scripts.run(jobs, done);
    let mut places = Places::new(task.scenes.len(), per_step(n_fingertips), run, on_grasp);
    let best = match search {
        Search::Quick => places.most_promising(),
        Search::Whole => places.best_place(),
    };
    Ok(place(&places, best, scale))
}

fn per_step(n_fingertips: usize) -> f64 {
    if n_fingertips == 2 { PER_STEP_OF_TWO } else { PER_STEP }
}

fn place<F>(places: &Places<F>, steps: [i32; 2], scale: f64) -> Place {
    let grasps = places.grasps(steps);
    // The trials moved the objects; the hand must be moved the opposite way.
    Place {
        shift: steps.map(|i| -f64::from(i) * STEP * scale),
        grasps: Tally::of(grasps),
        merit: places.merit(steps, grasps.len()),
    }
}
