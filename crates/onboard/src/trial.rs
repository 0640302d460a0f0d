//! Scripted grasps, which choose how a hand approaches an object and its place above it, and tell whether it can grasp.
//!
//! In training, a hand moves only up and down, so its place limits the grasps that it can learn. Nothing is learned
//! here: the hand comes down, closes, and raises the object to its goal.

use std::collections::BTreeMap;
use std::sync::Arc;

use eigenhand_sim::{GraspTask, SimError};

mod script;

use script::{Grasp, Job, Scripts};

/// Distance in m between two places that are tried, for objects of scale 1.
const STEP: f64 = 0.02;
/// Places that are tried first, along the fingers (x), and the last one across them (y), in steps from the hand's present
/// place.
const ALONG: [i32; 5] = [0, -2, -4, -6, 2];
const ACROSS: i32 = 2;
/// Number of places along the fingers at which places across them are tried.
const ROWS: usize = 2;
/// Number of grasps of each object at the best places, and number of these places.
const TRIALS: u64 = 2;
const BEST: usize = 3;
/// Weights of a grasp that reaches its goal, and of one that only lifts the object.
const REACHED: f64 = 1.0;
const LIFTED: f64 = 0.25;
/// Weight of the distance by which closing drags the object aside, per m.
const DRAG: f64 = 4.0;
/// What a place must be better by for each step from the middle: of a hand, and of a gripper with two fingertips, whose
/// jaws meet in the middle.
const PER_STEP: f64 = 0.03;
const PER_STEP_OF_TWO: f64 = 0.08;

/// How far a search is: grasps that are done, and grasps in all.
pub type Heard<'a> = dyn Fn(usize, usize) + Sync + 'a;

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

/// Tries grasps along the fingers, then across them at the best place, and returns the best place of all.
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
    heard: &Heard,
) -> Result<Place, SimError> {
    let mut search = Search::new(task, closing, scale, n_fingertips, heard)?;
    search.expect(ALONG.len() + 2 + 2 * ACROSS as usize * ROWS, BEST);
    search.coarse();
    let [along, _] = search.best();
    search.grasp([[along - 1, 0], [along + 1, 0]], 0);
    // The best place along the fingers is not always the best one beside them.
    for [along, _] in search.ranking().into_iter().take(ROWS).collect::<Vec<_>>() {
        search.grasp((1..=ACROSS).flat_map(|across| [[along, -across], [along, across]]), 0);
    }
    for trial in 1..TRIALS {
        search.grasp(search.ranking().into_iter().take(BEST), trial);
    }
    Ok(search.place(search.best_of_most()))
}

/// Tries few grasps, with which the directions of approach of a hand can be compared. See [`best_place`].
///
/// # Errors
/// As [`best_place`].
pub fn promise(
    task: &Arc<GraspTask>,
    closing: &BTreeMap<String, f64>,
    scale: f64,
    n_fingertips: usize,
    heard: &Heard,
) -> Result<Place, SimError> {
    let mut search = Search::new(task, closing, scale, n_fingertips, heard)?;
    search.expect(ALONG.len(), 0);
    search.coarse();
    Ok(search.place(search.best()))
}

/// The grasps of a search, by the place of the objects in steps.
struct Search<'a> {
    scripts: Scripts<'a>,
    step: f64,
    per_step: f64,
    n_scenes: usize,
    tried: BTreeMap<[i32; 2], Vec<Grasp>>,
    heard: &'a Heard<'a>,
    expected: usize,
    done: usize,
}

impl<'a> Search<'a> {
    fn new(
        task: &'a Arc<GraspTask>,
        closing: &BTreeMap<String, f64>,
        scale: f64,
        n_fingertips: usize,
        heard: &'a Heard<'a>,
    ) -> Result<Self, SimError> {
        let per_step = if n_fingertips == 2 { PER_STEP_OF_TWO } else { PER_STEP };
        let (scripts, n_scenes) = (Scripts::new(task, closing)?, task.scenes.len());
        let (step, tried) = (STEP * scale, BTreeMap::new());
        Ok(Search { scripts, step, per_step, n_scenes, tried, heard, expected: 0, done: 0 })
    }

    fn expect(&mut self, n_places: usize, n_more: usize) {
        self.expected = self.n_scenes * (n_places + n_more * (TRIALS as usize - 1));
    }

    fn coarse(&mut self) {
        self.grasp(ALONG.map(|along| [along, 0]), 0);
    }

    /// Grasps every object once at each place, unless that was done.
    fn grasp(&mut self, places: impl IntoIterator<Item = [i32; 2]>, trial: u64) {
        let new: Vec<[i32; 2]> = places
            .into_iter()
            .filter(|place| self.tried.get(place).map_or(0, Vec::len) <= trial as usize * self.n_scenes)
            .collect();
        let jobs: Vec<Job> = new
            .iter()
            .flat_map(|place| (0..self.n_scenes).map(|scene| (*place, scene)))
            .map(|(place, scene)| Job { scene, place: place.map(|i| f64::from(i) * self.step), trial })
            .collect();
        let heard = self.heard;
        let (done, expected) = (self.done, self.expected.max(self.done + jobs.len()));
        let grasps = self.scripts.run(&jobs, &|now| heard(done + now, expected));
        self.done += jobs.len();
        for (place, grasps) in new.into_iter().zip(grasps.chunks(self.n_scenes.max(1))) {
            self.tried.entry(place).or_default().extend_from_slice(grasps);
        }
    }

    /// Returns what a place is worth: half its own grasps, half those of its neighbours along the fingers. Where a
    /// neighbour was not tried, the next place beyond it stands for it, and the place itself if there is none.
    fn merit(&self, place: [i32; 2]) -> f64 {
        let [along, across] = place;
        let worth = |along: i32| self.tried.get(&[along, across]).map(|grasps| Tally::of(grasps).worth());
        let own = worth(along).unwrap_or(0.0);
        let beside = |sign: i32| {
            let next = worth(along + sign);
            next.or_else(|| worth(along + 2 * sign).map(|beyond| (own + beyond) / 2.0)).unwrap_or(own)
        };
        let away = self.per_step * f64::from(along.abs() + across.abs());
        0.5 * own + 0.25 * (beside(-1) + beside(1)) - away
    }

    /// Lists the places that were tried, the best first.
    fn ranking(&self) -> Vec<[i32; 2]> {
        let mut places: Vec<[i32; 2]> = self.tried.keys().copied().collect();
        let distance = |place: &[i32; 2]| place[0].abs() + place[1].abs();
        places.sort_by(|a, b| self.merit(*b).total_cmp(&self.merit(*a)).then(distance(a).cmp(&distance(b))));
        places
    }

    fn best(&self) -> [i32; 2] {
        self.ranking().first().copied().unwrap_or([0, 0])
    }

    /// Returns the best among the places with most grasps.
    fn best_of_most(&self) -> [i32; 2] {
        let count = |place: &[i32; 2]| self.tried.get(place).map_or(0, Vec::len);
        let most = self.tried.keys().map(count).max().unwrap_or(0);
        self.ranking().into_iter().find(|place| count(place) == most).unwrap_or([0, 0])
    }

    fn place(&self, place: [i32; 2]) -> Place {
        let grasps = self.tried.get(&place).map_or_else(Tally::default, |grasps| Tally::of(grasps));
        // The trials moved the objects; the hand must be moved the opposite way.
        Place { shift: place.map(|i| -f64::from(i) * self.step), grasps, merit: self.merit(place) }
    }
}
