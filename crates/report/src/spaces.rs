//! Whether the runs of one lambda find the same space of commands.

use eigenhand_synergy::{Compared, Comparison, Explained, Import};
use serde::Serialize;

use crate::run::Run;
use crate::statements::counted;

/// Spaces are nearly, or partly, the same if they express each other's samples by more than this share of the way from random
/// directions to their own.
const NEARLY: f64 = 0.8;
const PARTLY: f64 = 0.4;

/// How far the control synergies of a lambda's runs agree; medians over all ordered pairs of runs.
#[derive(Clone, Debug, Serialize)]
pub struct SharedSpace {
    /// Runs with a control synergy.
    pub n_runs: usize,
    /// Components of each space.
    pub n_components: usize,
    /// Mean squared cosine of the principal angles between two spaces, 0 to 1.
    pub squared_cosine: f64,
    /// The same for random directions: components / actuators.
    pub chance: f64,
    /// Share of the variance of a run's commands in its own space.
    pub own: f64,
    /// Share of the variance of a run's commands in the space of another run.
    pub other: f64,
    /// The conclusion.
    pub statement: String,
}

impl SharedSpace {
    /// Returns none for fewer than two complete runs with a control synergy of as many components, fewer than the hand has
    /// actuators, or for spaces that cannot be compared.
    pub(crate) fn of(lambda: f64, runs: &[&Run]) -> Option<SharedSpace> {
        let complete = runs.iter().filter(|run| run.result().is_some());
        let spaces: Vec<_> = complete.filter_map(|run| run.control.as_ref()).collect();
        let first = &spaces.first()?.file.synergy;
        let (n_components, n_joints) = (first.n_components(), first.n_joints());
        let differs = |import: &&Import| import.file.synergy.n_components() != n_components;
        if n_components == n_joints || spaces.iter().any(differs) {
            return None;
        }
        let (mut cosines, mut own, mut other) = (Vec::new(), Vec::new(), Vec::new());
        for (i, a) in spaces.iter().enumerate() {
            for b in &spaces[..i] {
                let [a, b] = [a, b]
                    .map(|import| Compared { synergy: &import.file.synergy, samples: Some(import.samples.as_slice()) });
                let comparison = Comparison::of(a, b).ok()?;
                let squares = comparison.angles.iter().map(|angle| angle.cos().powi(2));
                cosines.push(squares.sum::<f64>() / comparison.angles.len().max(1) as f64);
                for Explained { own: in_own, other: in_other } in comparison.explained.iter().flatten() {
                    own.push(*in_own.last()?);
                    other.push(*in_other.last()?);
                }
            }
        }
        let mut shared = SharedSpace {
            n_runs: spaces.len(),
            n_components,
            squared_cosine: crate::stats::median(&cosines)?,
            chance: n_components as f64 / n_joints as f64,
            own: crate::stats::median(&own)?,
            other: crate::stats::median(&other)?,
            statement: String::new(),
        };
        shared.statement = shared.sentence(lambda);
        Some(shared)
    }

    fn sentence(&self, lambda: f64) -> String {
        let SharedSpace { n_runs, n_components, chance, own, other, .. } = self;
        let way = (other - chance) / (own - chance).max(f64::MIN_POSITIVE);
        let found = if way > NEARLY {
            "find nearly the same space"
        } else if way > PARTLY {
            "find spaces that are partly the same"
        } else {
            "find different spaces"
        };
        format!(
            "With lambda {lambda}, {n_runs} runs with a control synergy {found}: {} of one run express {:.0} % of the \
             variance of another run's commands, its own express {:.0} %, and random directions {:.0} %.",
            counted(n_components, "component"),
            100.0 * other,
            100.0 * own,
            100.0 * chance,
        )
    }
}

#[cfg(test)]
mod tests {
    use eigenhand_synergy::{Import, JointInfo, Space, Synergy, SynergyFile, Unit};

    use super::*;
    use crate::made_up::complete;

    /// A run whose commands vary in two of four actuators.
    fn run(seed: u64, actuators: [usize; 2]) -> Run {
        let joint = |name: &str| JointInfo { name: name.to_owned(), unit: Unit::Radian, lower: -9.0, upper: 9.0 };
        let samples: Vec<Vec<f64>> = (0..40)
            .map(|i| {
                let mut row = vec![0.0; 4];
                row[actuators[0]] = 3.0 * f64::from(i).sin();
                row[actuators[1]] = 2.0 * f64::from(i * i).cos();
                row
            })
            .collect();
        let synergy = Synergy::fit(&["a", "b", "c", "d"].map(joint), &samples, 2).expect("they vary");
        let file = SynergyFile {
            hand: "claw".to_owned(),
            space: Space::Commands,
            synergy,
            joint_map: None,
            actuation: None,
            recommended: None,
            grasps: Vec::new(),
            provenance: Default::default(),
        };
        Run { control: Some(Import { file, samples }), ..complete(1.0, seed, 0.9, &[], None) }
    }

    #[test]
    fn the_same_and_different_spaces_are_told_apart() {
        let (a, b, c) = (run(1, [0, 1]), run(2, [1, 0]), run(3, [2, 3]));
        let same = SharedSpace::of(1.0, &[&a, &b]).expect("two runs");
        assert!((same.squared_cosine - 1.0).abs() < 1e-9 && (same.other - 1.0).abs() < 1e-9, "{same:?}");
        assert!(
            same.statement.contains("2 runs with a control synergy find nearly the same space: 2 components"),
            "{}",
            same.statement
        );
        let apart = SharedSpace::of(1.0, &[&a, &c]).expect("two runs");
        assert!(apart.squared_cosine < 1e-9 && apart.other < 1e-9 && (apart.own - 1.0).abs() < 1e-9, "{apart:?}");
        assert!(apart.statement.contains("different spaces") && apart.statement.contains("random directions 50 %"));
        assert!(SharedSpace::of(1.0, &[&a]).is_none(), "one run has nothing to be compared with");
        let unfinished = Run { summary: None, ..run(4, [0, 1]) };
        assert!(SharedSpace::of(1.0, &[&a, &unfinished]).is_none(), "only complete runs count");
    }
}
