//! Success when few numbers command the hand.

use serde::Serialize;

use crate::analysis::over;
use crate::records::RunRecord;
use crate::statements::counted;
use crate::stats::Estimate;

/// Success with few numbers may be this much below that with all joints where they are enough.
const NEARLY: f64 = 0.05;

/// Success when few numbers command the hand, over the complete runs of a lambda that measured it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FewNumbers {
    /// Number of these runs; the fields below cover only these.
    pub n_runs: usize,
    /// Success rate with 0, 1, 2... numbers.
    pub success: Vec<Estimate>,
    /// Success rate of the same episodes with all joints.
    pub all_joints: Estimate,
    /// The fewest numbers that are within 5 points of all joints in more than half of the runs.
    pub k_for_95: Option<usize>,
    /// Runs in which so many numbers are within 5 points, or any number of them if `k_for_95` is none.
    pub n_within: usize,
    /// The same in words.
    pub statement: String,
}

impl FewNumbers {
    /// Joins the runs of a lambda, which are the group `i` of `groups`.
    pub(crate) fn of(lambda: f64, i: usize, groups: &[Vec<&RunRecord>]) -> Option<FewNumbers> {
        let is_measured = |run: &RunRecord| !run.success_with_components.is_empty();
        let runs: Vec<&RunRecord> = groups.get(i)?.iter().filter(|run| is_measured(run)).copied().collect();
        let most = runs.iter().map(|run| run.success_with_components.len()).max()?;
        let with = |k: usize| over(groups, |run| run.success_with_components.get(k).copied()).estimate(i);
        let enough = |k: usize| runs.iter().filter(|run| run.k_for_95.is_some_and(|fewest| fewest <= k)).count();
        let k_for_95 = (1..most).find(|k| 2 * enough(*k) > runs.len());
        let mut found = FewNumbers {
            n_runs: runs.len(),
            success: (0..most).map_while(with).collect(),
            all_joints: over(groups, |run| run.success_rate.filter(|_| is_measured(run))).estimate(i)?,
            k_for_95,
            n_within: enough(k_for_95.unwrap_or(most)),
            statement: String::new(),
        };
        let configured = runs[0].components;
        let agree = runs.iter().all(|run| run.components == configured);
        found.statement = found.sentence(lambda, agree.then_some(configured));
        Some(found)
    }

    /// `With 5 numbers, the hand of lambda 1 grasps in 96.0 % of the episodes...`
    fn sentence(&self, lambda: f64, components: Option<usize>) -> String {
        let percent = |estimate: &Estimate| format!("{:.1} %", 100.0 * estimate.median);
        let runs = match self.n_runs {
            1 => "one run".to_owned(),
            n => format!("median of {n} runs"),
        };
        let most = self.success.len().saturating_sub(1);
        let all = percent(&self.all_joints);
        let success = match components.map(|k| k.min(most)).filter(|k| *k > 0) {
            Some(k) => format!(
                "With {}, the hand of lambda {lambda} grasps in {} of the episodes ({runs}), with all joints in {all}",
                counted(k, "number"),
                percent(&self.success[k])
            ),
            None => format!("With all joints, the hand of lambda {lambda} grasps in {all} of the episodes ({runs})"),
        };
        let enough = match self.k_for_95 {
            // Anything is within 5 points of so little.
            _ if self.all_joints.median <= NEARLY => String::new(),
            Some(k) => {
                let are = if k == 1 { "is" } else { "are" };
                let of = match (self.n_within, self.n_runs) {
                    (_, 1) => String::new(),
                    (n, all) if n == all => format!(" in all {all} runs"),
                    (n, all) => format!(" in {n} of {all} runs"),
                };
                format!("; {} {are} enough to be within 5 points{of}", counted(k, "number"))
            }
            None if most > 0 => match (self.n_within, self.n_runs) {
                (0, 1) => format!("; even {most} are not enough to be within 5 points"),
                (0, _) => format!("; even {most} are not enough to be within 5 points in any run"),
                (n, all) => format!("; up to {most} are enough to be within 5 points in only {n} of {all} runs"),
            },
            None => String::new(),
        };
        let constant =
            self.success.first().map_or_else(String::new, |none| format!(" A constant command: {}.", percent(none)));
        format!("{success}{enough}.{constant}")
    }
}

#[cfg(test)]
mod tests {
    use crate::analyse;
    use crate::made_up::{complete, interrupted, without_few_numbers};

    #[test]
    fn a_sentence_says_how_many_numbers_are_enough() {
        let curve = [0.1, 0.6, 0.93, 0.94, 0.95, 0.96];
        let late = [0.14, 0.3, 0.4, 0.5, 0.93, 0.97];
        let runs = [
            complete(0.0, 1, 0.9, &late, None),
            complete(1.0, 1, 0.97, &curve, Some(2)),
            complete(1.0, 2, 0.98, &curve, Some(2)),
            complete(1.0, 3, 0.95, &late, Some(4)),
            without_few_numbers(1.0, 4),
            interrupted(1.0, 5),
        ];
        let analysis = analyse(&runs);
        let expected = [
            "With 5 numbers, the hand of lambda 0 grasps in 97.0 % of the episodes (one run), with all joints in 90.0 %; \
             even 5 are not enough to be within 5 points. A constant command: 14.0 %.",
            "With 5 numbers, the hand of lambda 1 grasps in 96.0 % of the episodes (median of 3 runs), with all joints in \
             97.0 %; 2 numbers are enough to be within 5 points in 2 of 3 runs. A constant command: 10.0 %.",
        ];
        assert_eq!(analysis.statements[..2], expected);
        let found = analysis.lambdas[1].few_numbers.as_ref().expect("measured");
        assert_eq!((found.n_runs, found.k_for_95, found.n_within), (3, Some(2), 2));
        assert_eq!((found.success.len(), found.success[2].min, found.success[2].max), (6, 0.4, 0.93));
        let notes = &analysis.notes;
        for start in ["l1-s4 was trained by an earlier version", "l1-s5 is not finished"] {
            assert!(notes.iter().any(|note| note.starts_with(start)), "{notes:?} does not say {start}");
        }
        assert_eq!(notes.len(), 2);
    }

    #[test]
    fn lambdas_are_compared_with_few_numbers() {
        let of = |lambda: f64, with_two: f64| {
            move |seed: u64| {
                let shift = 0.001 * seed as f64;
                complete(lambda, seed, 0.95, &[0.1, 0.5 + shift, with_two + shift, 0.9, 0.9, 0.9 - shift], Some(3))
            }
        };
        let runs: Vec<_> = (1..=5).map(of(0.0, 0.6)).chain((1..=5).map(of(1.0, 0.9))).collect();
        let analysis = analyse(&runs);
        let verdict = |key: &str| {
            let found = analysis.differences.iter().find(|d| d.quantity.key() == key).expect("compared");
            (format!("{:?}", found.verdict), found.statement.clone())
        };
        assert_eq!(verdict("success_with_2").0, "Greater");
        assert_eq!(verdict("success_with_1").0, "Open");
        let (_, configured) = verdict("success_with_components");
        assert!(configured.contains("success with 5 numbers differs by 0.0 percentage points"), "{configured}");
    }

    #[test]
    fn a_comparison_occurs_once() {
        let mut runs: Vec<_> = [0.0, 1.0].map(|lambda| complete(lambda, 1, 0.9, &[0.1, 0.5, 0.9], Some(2))).into();
        runs.iter_mut().for_each(|run| run.components = 2);
        let keys: Vec<&str> = analyse(&runs).differences.iter().map(|d| d.quantity.key()).collect();
        assert!(keys.contains(&"success_with_components") && keys.contains(&"success_with_1"), "{keys:?}");
        assert!(!keys.contains(&"success_with_2"), "{keys:?}");
    }
}
