//! Results in a report: of each run, of the runs of each lambda, and of the differences between lambdas.

use std::collections::BTreeMap;

use eigenhand_synergy::Content;
use eigenhand_train::Stress;
use serde::Serialize;

use crate::few_numbers::FewNumbers;
use crate::spaces::SharedSpace;
use crate::stats::{Contrast, Estimate, Verdict};

/// Success rates for which a report says when a run first reached them.
pub const LEVELS: [f64; 3] = [0.5, 0.7, 0.9];

/// Results in a report, as written to `report.json`.
#[derive(Clone, Debug, Serialize)]
pub struct Analysis {
    /// Version of these keys.
    pub schema: u32,
    /// Name of the hand.
    pub hand: String,
    /// Components of the synergies as configured, if all runs agree.
    pub components: Option<usize>,
    /// Every run, by lambda and seed.
    pub runs: Vec<RunRecord>,
    /// The results over the runs of each lambda.
    pub lambdas: Vec<LambdaRecord>,
    /// Each other lambda compared with the smallest.
    pub differences: Vec<DifferenceRecord>,
    /// Conclusions from the numbers, in words.
    pub statements: Vec<String>,
    /// Limits of these conclusions, in words.
    pub notes: Vec<String>,
}

/// One run.
#[derive(Clone, Debug, Serialize)]
pub struct RunRecord {
    /// Name of its directory.
    pub run: String,
    /// How far training confined the policy to its synergy.
    pub lambda: f64,
    /// Seed.
    pub seed: u64,
    /// `complete`, `interrupted` or `unfinished`.
    pub state: &'static str,
    /// Training episodes so far.
    pub episodes: u64,
    /// Wall time so far in s.
    pub wall_s: Option<f64>,
    /// Success rate of the final evaluation.
    pub success_rate: Option<f64>,
    /// Its 95 % interval (Wilson 1927), over the episodes of that evaluation.
    pub success_interval: Option<[f64; 2]>,
    /// Episodes of that evaluation.
    pub eval_episodes: u64,
    /// Success rate with each object, in that evaluation.
    pub success_rate_per_object: BTreeMap<String, f64>,
    /// Components of the synergies, as configured.
    pub components: usize,
    /// Success rate in that evaluation when 0, 1, 2... numbers command the hand; empty if not measured.
    pub success_with_components: Vec<f64>,
    /// The fewest numbers whose success is within 5 points of all joints.
    pub k_for_95: Option<usize>,
    /// Success rate with objects of no training; none without such objects.
    pub other_objects_success_rate: Option<f64>,
    /// The same when as many numbers as configured command the hand.
    pub other_objects_success_with_components: Option<f64>,
    /// Contribution rate of each component.
    pub contribution: Vec<f64>,
    /// Sum of the contribution rates.
    pub contribution_sum: Option<f64>,
    /// Change of this sum from the first evaluation with enough postures for feedback to the last evaluation.
    pub contribution_change: Option<f64>,
    /// Mean approximation error over the postures that the synergy covers, in rad.
    pub mean_error_rad: Option<f64>,
    /// Postures in the database.
    pub n_postures: u64,
    /// Mean penetration in the final evaluation's successes, in m.
    pub mean_penetration_m: Option<f64>,
    /// The same between two geoms of the hand.
    pub mean_self_penetration_m: Option<f64>,
    /// What that evaluation's grasps hold; none if an earlier version trained the run, or if its success is too low.
    pub content: Option<Content>,
    /// What its grasps endure; none before `eval --stress`.
    pub stress: Option<Stress>,
    /// Training episodes before the run's policy.
    pub policy_episode: Option<u64>,
    /// First evaluation that reached each of [`LEVELS`].
    pub reached: Vec<Option<Reached>>,
}

/// Time of an evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Reached {
    /// Training episodes before it.
    pub episodes: f64,
    /// Wall time before it, in s.
    pub wall_s: f64,
}

/// The runs of one lambda.
#[derive(Clone, Debug, Serialize)]
pub struct LambdaRecord {
    /// How far training confined the policy to its synergy.
    pub lambda: f64,
    /// Number of runs.
    pub n_runs: usize,
    /// Number of complete runs; the fields below cover only these.
    pub n_complete: usize,
    /// Estimates, by the name of the quantity.
    pub quantities: BTreeMap<&'static str, Estimate>,
    /// Success when few numbers command the hand; none if no run measured it.
    pub few_numbers: Option<FewNumbers>,
    /// Numbers of what the grasps hold, by their names in [`Content`].
    pub content: BTreeMap<&'static str, Estimate>,
    /// Contribution rate of each component.
    pub contribution: Vec<Estimate>,
    /// Success rate for each object.
    pub objects: BTreeMap<String, Estimate>,
    /// Times to reach each of [`LEVELS`].
    pub levels: Vec<LevelRecord>,
    /// Whether the runs find the same space; none for fewer than two with a control synergy.
    pub space: Option<SharedSpace>,
}

/// When the runs of a lambda first reached a success rate.
#[derive(Clone, Debug, Serialize)]
pub struct LevelRecord {
    /// The success rate.
    pub success_rate: f64,
    /// Complete runs that reached it.
    pub n_reached: usize,
    /// Median of the training episodes before, if more than half of the runs reached it.
    pub median_episodes: Option<f64>,
    /// Median of the wall time before in s, under the same condition.
    pub median_wall_s: Option<f64>,
}

/// Difference of a quantity between two lambdas.
#[derive(Clone, Debug, Serialize)]
pub struct DifferenceRecord {
    /// The quantity.
    pub quantity: Quantity,
    /// The smallest lambda.
    pub baseline: f64,
    /// The other lambda.
    pub lambda: f64,
    /// Number of complete runs of both.
    pub n_runs: [usize; 2],
    /// Value at the other lambda minus value at the smallest.
    #[serde(flatten)]
    pub contrast: Contrast,
    /// Conclusion.
    pub verdict: Verdict,
    /// The same in words.
    pub statement: String,
}

/// A quantity that is estimated over the complete runs of a lambda.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(into = "&'static str")]
pub enum Quantity {
    /// Success rate of the final evaluation.
    SuccessRate,
    /// Success rate with the objects of no training.
    OtherObjects,
    /// Success rate of the same episodes when as many numbers as configured command the hand.
    SuccessWithComponents,
    /// The same with one number.
    SuccessWithOne,
    /// The same with two numbers.
    SuccessWithTwo,
    /// Sum of the contribution rates.
    ContributionSum,
    /// Change of that sum along training.
    ContributionChange,
    /// Mean approximation error over the postures that the synergy covers.
    MeanErrorRad,
    /// Postures in the database.
    NPostures,
    /// Mean penetration.
    MeanPenetrationM,
    /// Mean penetration between geoms of the hand.
    MeanSelfPenetrationM,
    /// Wall time.
    WallS,
}

impl Quantity {
    /// Quantities that are estimated for each lambda; the success with each number is in [`FewNumbers`].
    pub const ALL: [Quantity; 10] = [
        Quantity::SuccessRate,
        Quantity::SuccessWithComponents,
        Quantity::OtherObjects,
        Quantity::ContributionSum,
        Quantity::ContributionChange,
        Quantity::MeanErrorRad,
        Quantity::NPostures,
        Quantity::MeanPenetrationM,
        Quantity::MeanSelfPenetrationM,
        Quantity::WallS,
    ];
    /// Quantities in which lambdas are compared.
    pub const COMPARED: [Quantity; 7] = [
        Quantity::SuccessRate,
        Quantity::SuccessWithComponents,
        Quantity::SuccessWithOne,
        Quantity::SuccessWithTwo,
        Quantity::ContributionSum,
        Quantity::ContributionChange,
        Quantity::MeanErrorRad,
    ];

    /// Returns the name in files.
    pub fn key(self) -> &'static str {
        match self {
            Quantity::SuccessRate => "success_rate",
            Quantity::OtherObjects => "other_objects_success_rate",
            Quantity::SuccessWithComponents => "success_with_components",
            Quantity::SuccessWithOne => "success_with_1",
            Quantity::SuccessWithTwo => "success_with_2",
            Quantity::ContributionSum => "contribution_sum",
            Quantity::ContributionChange => "contribution_change",
            Quantity::MeanErrorRad => "mean_error_rad",
            Quantity::NPostures => "n_postures",
            Quantity::MeanPenetrationM => "mean_penetration_m",
            Quantity::MeanSelfPenetrationM => "mean_self_penetration_m",
            Quantity::WallS => "wall_s",
        }
    }

    /// Tells whether the quantity is success with the configured components under another name.
    pub fn is_repeated(self, components: Option<usize>) -> bool {
        match self {
            Quantity::SuccessWithOne => components == Some(1),
            Quantity::SuccessWithTwo => components == Some(2),
            _ => false,
        }
    }

    /// Returns a run's value.
    pub fn of(self, run: &RunRecord) -> Option<f64> {
        let with = |k: usize| run.success_with_components.get(k).copied();
        match self {
            Quantity::SuccessRate => run.success_rate,
            Quantity::OtherObjects => run.other_objects_success_rate,
            Quantity::SuccessWithComponents => with(run.components),
            Quantity::SuccessWithOne => with(1),
            Quantity::SuccessWithTwo => with(2),
            Quantity::ContributionSum => run.contribution_sum,
            Quantity::ContributionChange => run.contribution_change,
            Quantity::MeanErrorRad => run.mean_error_rad,
            Quantity::NPostures => Some(run.n_postures as f64),
            Quantity::MeanPenetrationM => run.mean_penetration_m,
            Quantity::MeanSelfPenetrationM => run.mean_self_penetration_m,
            Quantity::WallS => run.wall_s,
        }
    }
}

impl From<Quantity> for &'static str {
    fn from(quantity: Quantity) -> &'static str {
        quantity.key()
    }
}

impl Analysis {
    /// Returns the names of the objects that the runs evaluated.
    pub fn objects(&self) -> Vec<String> {
        objects(&self.runs)
    }
}

impl RunRecord {
    /// Tells whether the run was trained and evaluated to its end.
    pub fn is_complete(&self) -> bool {
        self.state == "complete"
    }
}

/// Returns the names of the objects that runs evaluated.
pub(crate) fn objects(runs: &[RunRecord]) -> Vec<String> {
    let mut objects: Vec<String> = runs.iter().flat_map(|run| run.success_rate_per_object.keys().cloned()).collect();
    objects.sort();
    objects.dedup();
    objects
}
