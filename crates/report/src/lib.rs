//! A report on finished and unfinished runs: statistics across seeds for each lambda or each variant of a study, figures
//! with their numbers, and one self-contained HTML page.
#![forbid(unsafe_code)]

mod analysis;
mod content;
mod curves;
mod error;
mod few_numbers;
mod figures;
#[cfg(test)]
mod made_up;
mod page;
mod permutation;
mod records;
mod run;
mod spaces;
mod statements;
mod stats;
mod study;
mod tables;
mod write;

pub use analysis::analyse;
pub use curves::{Band, BandPoint};
pub use error::ReportError;
pub use few_numbers::FewNumbers;
pub use permutation::Permutation;
pub use records::{Analysis, DifferenceRecord, LEVELS, LambdaRecord, LevelRecord, Quantity, Reached, RunRecord};
pub use run::{Run, read_runs};
pub use spaces::SharedSpace;
pub use statements::counted;
pub use stats::{Bootstrap, Contrast, Estimate, Verdict, interquartile_mean, median, quantile};
pub use study::{Study, StudyAnalysis, StudyDifference, StudyRun, VariantRecord};
pub use write::{Report, StudyReport, write, write_study};
