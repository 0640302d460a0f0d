//! The search for the best place of a hand, by the places of the objects in steps.

use std::collections::BTreeMap;

use super::script::{Grasp, Job};
use super::{OnGrasp, Tally};

/// The grid along the fingers (x) and across them (y), in steps from the hand's present place. Along the fingers it
/// reaches farther towards the palm.
const ALONG: [i32; 5] = [0, -2, -4, -6, 2];
const ACROSS: [i32; 3] = [0, -2, 2];
/// Of so many objects, one is grasped at every place of the grid.
const EVERY: usize = 2;
/// Number of the best places beside which places are tried, in each direction of both axes: of the grid, and once more.
const REFINED: [usize; 2] = [2, 1];
const BESIDE: [[i32; 2]; 4] = [[-1, 0], [1, 0], [0, -1], [0, 1]];
/// Number of places at which every object is grasped once, and of those at which it is grasped again.
const ONCE: usize = 4;
const AGAIN: usize = 3;
const TRIALS: usize = 2;

/// The grasps of a search. `run` carries grasps out and tells how many are done.
pub(super) struct Places<'a, F> {
    /// The object of each grasp at a place, in order. Places are compared by the same grasps.
    order: Vec<usize>,
    n_scenes: usize,
    per_step: f64,
    run: F,
    tried: BTreeMap<[i32; 2], Vec<Grasp>>,
    on_grasp: &'a OnGrasp<'a>,
    expected: usize,
    done: usize,
}

impl<F> Places<'_, F> {
    /// Returns the grasps at a place.
    pub(super) fn grasps(&self, place: [i32; 2]) -> &[Grasp] {
        self.tried.get(&place).map_or(&[], Vec::as_slice)
    }

    /// Returns what a place is worth by the first grasps: half its own, half those of its neighbours. Where a neighbour
    /// was not tried, the next place beyond it stands for it, and the place itself if there is none.
    pub(super) fn merit(&self, place: [i32; 2], n_grasps: usize) -> f64 {
        let worth = |by: [i32; 2]| {
            let grasps = self.grasps([place[0] + by[0], place[1] + by[1]]);
            (!grasps.is_empty()).then(|| Tally::of(&grasps[..n_grasps.min(grasps.len())]).worth())
        };
        let own = worth([0, 0]).unwrap_or(0.0);
        let beside = |by: [i32; 2]| {
            worth(by).or_else(|| worth(by.map(|i| 2 * i)).map(|beyond| (own + beyond) / 2.0)).unwrap_or(own)
        };
        let neighbours = BESIDE.map(beside).iter().sum::<f64>() / BESIDE.len() as f64;
        (own + neighbours) / 2.0 - self.per_step * f64::from(distance(place))
    }

    /// Lists the places with at least so many grasps, the best by these first.
    fn ranking(&self, n_grasps: usize) -> Vec<[i32; 2]> {
        let tried = self.tried.iter().filter(|(_, grasps)| grasps.len() >= n_grasps);
        let mut places: Vec<([i32; 2], f64)> = tried.map(|(&place, _)| (place, self.merit(place, n_grasps))).collect();
        places.sort_by(|(a, x), (b, y)| y.total_cmp(x).then(distance(*a).cmp(&distance(*b))));
        places.into_iter().map(|(place, _)| place).collect()
    }
}

impl<'a, F: FnMut(&[Job], &(dyn Fn(usize) + Sync)) -> Vec<Grasp>> Places<'a, F> {
    pub(super) fn new(n_scenes: usize, per_step: f64, run: F, on_grasp: &'a OnGrasp<'a>) -> Self {
        let all = 0..n_scenes;
        let first = all.clone().step_by(EVERY);
        let others = all.clone().filter(|scene| scene % EVERY != 0);
        let order = first.chain(others).chain((1..TRIALS).flat_map(|_| all.clone())).collect();
        Places { order, n_scenes, per_step, run, tried: BTreeMap::new(), on_grasp, expected: 0, done: 0 }
    }

    /// Searches the grid, then beside its best places, and returns the best place of those with most grasps.
    pub(super) fn best_place(&mut self) -> [i32; 2] {
        let (few, once, again) = (self.n_scenes.div_ceil(EVERY), self.n_scenes, self.order.len());
        let n_places = ALONG.len() * ACROSS.len() + REFINED.iter().sum::<usize>() * BESIDE.len();
        self.expected = n_places * few + ONCE * (once - few) + AGAIN * (again - once);
        self.grasp(ACROSS.iter().flat_map(|&across| ALONG.map(|along| [along, across])), few);
        for n_best in REFINED {
            let best = self.ranking(few).into_iter().take(n_best);
            self.grasp(best.flat_map(|[along, across]| BESIDE.map(|[x, y]| [along + x, across + y])), few);
        }
        self.grasp(self.ranking(few).into_iter().take(ONCE), once);
        self.grasp(self.ranking(once).into_iter().take(AGAIN), again);
        self.ranking(again).first().copied().unwrap_or([0, 0])
    }

    /// Grasps every object once at the places along the fingers, and returns the best of them.
    pub(super) fn most_promising(&mut self) -> [i32; 2] {
        self.expected = ALONG.len() * self.n_scenes;
        self.grasp(ALONG.map(|along| [along, 0]), self.n_scenes);
        self.ranking(self.n_scenes).first().copied().unwrap_or([0, 0])
    }

    /// Grasps at each place until there are so many grasps.
    fn grasp(&mut self, places: impl IntoIterator<Item = [i32; 2]>, n_grasps: usize) {
        let mut jobs = Vec::new();
        for place in places {
            let from = self.grasps(place).len();
            // A place that is listed twice is entered once.
            if jobs.iter().any(|job: &Job| job.place == place) {
                continue;
            }
            let new = self.order.iter().enumerate().take(n_grasps).skip(from);
            jobs.extend(new.map(|(draw, &scene)| Job { scene, place, draw: draw as u64 }));
        }
        let (on_grasp, done) = (self.on_grasp, self.done);
        let expected = self.expected.max(done + jobs.len());
        let grasps = (self.run)(&jobs, &|now| on_grasp(done + now, expected));
        self.done += jobs.len();
        for (job, grasp) in jobs.iter().zip(grasps) {
            self.tried.entry(job.place).or_default().push(grasp);
        }
    }
}

fn distance(place: [i32; 2]) -> i32 {
    place[0].abs() + place[1].abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    const N_OBJECTS: usize = 7;

    /// Searches for a hand that reaches the goal within two steps of a place, more surely the nearer it is.
    fn found(good: [i32; 2]) -> ([i32; 2], usize) {
        let mut n_grasps = 0;
        let run = |jobs: &[Job], _: &(dyn Fn(usize) + Sync)| {
            n_grasps += jobs.len();
            let grasp = |job: &Job| {
                let away = distance([job.place[0] - good[0], job.place[1] - good[1]]);
                let reached = away < 3 && job.draw % 4 >= away as u64;
                Grasp { lifted: reached, reached, ..Grasp::default() }
            };
            jobs.iter().map(grasp).collect()
        };
        let on_grasp = |_: usize, _: usize| {};
        let place = Places::new(N_OBJECTS, 0.02, run, &on_grasp).best_place();
        (place, n_grasps)
    }

    /// No place in the same row or column as the middle tells of it.
    #[test]
    fn a_good_place_aside_of_both_axes_is_found() {
        for good in [[0, 0], [-4, 2], [-3, -2], [2, 2], [-2, 1]] {
            let (place, n_grasps) = found(good);
            assert_eq!(place, good);
            assert!(n_grasps < 140, "{n_grasps}");
        }
    }

    #[test]
    fn places_are_compared_by_the_same_grasps() {
        let seen = std::cell::RefCell::new(BTreeMap::<[i32; 2], Vec<(usize, u64)>>::new());
        let run = |jobs: &[Job], _: &(dyn Fn(usize) + Sync)| {
            for job in jobs {
                seen.borrow_mut().entry(job.place).or_default().push((job.scene, job.draw));
            }
            vec![Grasp::default(); jobs.len()]
        };
        let on_grasp = |_: usize, _: usize| {};
        let place = Places::new(N_OBJECTS, 0.02, run, &on_grasp).best_place();
        assert_eq!(place, [0, 0], "a hand that lifts nothing stays in its place");
        let seen = seen.into_inner();
        let longest = seen.values().max_by_key(|grasps| grasps.len()).unwrap();
        assert_eq!(longest.len(), TRIALS * N_OBJECTS);
        assert!(seen.values().all(|grasps| longest.starts_with(grasps)), "{seen:?}");
        let mut objects: Vec<usize> = longest.iter().map(|(scene, _)| *scene).collect();
        objects.sort_unstable();
        assert_eq!(objects, [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6]);
    }
}
