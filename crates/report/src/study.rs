//! A study: variants of training, each compared with the first.

use std::collections::BTreeMap;
use std::path::Path;

use eigenhand_files::cannot;
use eigenhand_train::TrainError;
use eigenhand_train::reproduce::{STUDY, StudyFile, StudyVariant};
use maud::html;
use serde::Serialize;

use crate::ReportError;
use crate::analysis::over;
use crate::figures::{Figure, Group, learning_curves};
use crate::page::{
    common_table, document, drawing, estimate, heading, notes, number, provenance, supported, table as html_table,
    words,
};
use crate::records::{LEVELS, LevelRecord, Quantity, RunRecord};
use crate::run::{Run, read_runs};
use crate::statements::{Words, conclusion, counted, probability};
use crate::stats::{Contrast, Estimate, Verdict};
use crate::tables;

/// Quantities in which variants are compared with the first.
const COMPARED: [Quantity; 2] = [Quantity::SuccessRate, Quantity::OtherObjects];
/// Name of the figure with all variants.
const FIGURE: &str = "learning-curves";

/// The runs of a study.
#[derive(Clone, Debug)]
pub struct Study {
    /// Which runs belong to which variant.
    file: StudyFile,
    /// All runs.
    runs: Vec<Run>,
}

/// Results of a study, as written to `report.json`.
#[derive(Clone, Debug, Serialize)]
pub struct StudyAnalysis {
    /// Version of these keys.
    pub schema: u32,
    /// Name of the hand.
    pub hand: String,
    /// In what the variants differ, as the head of a column.
    pub varies: String,
    /// The variants; the others are compared with the first.
    pub variants: Vec<VariantRecord>,
    /// Each other variant compared with the first.
    pub differences: Vec<StudyDifference>,
    /// Every run, in the order of the variants.
    pub runs: Vec<StudyRun>,
    /// Conclusions from the numbers, in words.
    pub statements: Vec<String>,
    /// Limits of these conclusions, in words.
    pub notes: Vec<String>,
}

/// Results of the runs of a variant.
#[derive(Clone, Debug, Serialize)]
pub struct VariantRecord {
    /// Its name.
    pub name: String,
    /// What it is, in words.
    pub title: String,
    /// Training episodes of each complete run; none if there is no such run.
    pub episodes: Option<u64>,
    /// Runs that the study has.
    pub n_runs: usize,
    /// Complete runs; the fields below cover only these.
    pub n_complete: usize,
    /// Estimates, by the name of the quantity.
    pub quantities: BTreeMap<&'static str, Estimate>,
    /// When the runs first reached certain success rates.
    pub levels: Vec<LevelRecord>,
}

/// Difference between a variant and the first.
#[derive(Clone, Debug, Serialize)]
pub struct StudyDifference {
    /// Name of the variant.
    pub variant: String,
    /// The quantity.
    pub quantity: Quantity,
    /// Number of complete runs of the first variant and of this one.
    pub n_runs: [usize; 2],
    /// Value of the variant minus value of the first.
    #[serde(flatten)]
    pub contrast: Contrast,
    /// Conclusion.
    pub verdict: Verdict,
    /// The same in words.
    pub statement: String,
}

/// A run of a study.
#[derive(Clone, Debug, Serialize)]
pub struct StudyRun {
    /// Name of its variant.
    pub variant: String,
    /// Its results.
    #[serde(flatten)]
    pub run: RunRecord,
}

impl Study {
    /// Tells whether a directory holds a study.
    pub fn is_in(directory: &Path) -> bool {
        directory.join(STUDY).is_file()
    }

    /// Reads the runs of a directory that `reproduce --study` made.
    ///
    /// # Errors
    /// [`ReportError::Train`] for a file that is missing or damaged, and those of [`read_runs`].
    pub fn read(directory: &Path) -> Result<Study, ReportError> {
        let path = directory.join(STUDY);
        let text = std::fs::read_to_string(&path).map_err(cannot("read", &path))?;
        let file: StudyFile = serde_json::from_str(&text).map_err(|error| {
            let mend = "write it again with the command that made the study".to_owned();
            ReportError::Train(TrainError::Damaged { path, reason: error.to_string(), mend })
        })?;
        Ok(Study { file, runs: read_runs(&[directory.to_owned()])? })
    }

    /// Returns the runs of a variant that exist.
    fn runs_of(&self, variant: usize) -> Vec<&Run> {
        let names = &self.file.variants[variant].runs;
        names.iter().filter_map(|name| self.runs.iter().find(|run| run.name == *name)).collect()
    }
}

/// Computes all numbers and sentences of a study.
pub(crate) fn analyse(study: &Study) -> StudyAnalysis {
    let variants = &study.file.variants;
    let records: Vec<Vec<RunRecord>> =
        (0..variants.len()).map(|i| study.runs_of(i).into_iter().map(RunRecord::of).collect()).collect();
    let groups: Vec<Vec<&RunRecord>> =
        records.iter().map(|runs| runs.iter().filter(|run| run.is_complete()).collect()).collect();
    let bootstraps = COMPARED.map(|quantity| (quantity, over(&groups, |run| quantity.of(run))));
    let record = |(i, variant): (usize, &StudyVariant)| VariantRecord {
        name: variant.name.clone(),
        title: variant.title.clone(),
        episodes: groups[i].first().map(|run| run.episodes),
        n_runs: variant.runs.len(),
        n_complete: groups[i].len(),
        quantities: bootstraps.iter().filter_map(|(q, b)| Some((q.key(), b.estimate(i)?))).collect(),
        levels: (0..LEVELS.len()).map(|level| LevelRecord::of(&groups[i], level)).collect(),
    };
    let mut differences = Vec::new();
    for (quantity, bootstrap) in &bootstraps {
        for i in 1..variants.len() {
            let Some(contrast) = bootstrap.contrast(0, i) else { continue };
            let n_runs = [groups[0].len(), groups[i].len()];
            let sides = [&variants[0], &variants[i]].map(|variant| format!("\u{201c}{}\u{201d}", variant.title));
            differences.push(StudyDifference {
                variant: variants[i].name.clone(),
                quantity: *quantity,
                n_runs,
                contrast,
                verdict: contrast.verdict(),
                statement: conclusion(&Words::of(*quantity, None), &sides, n_runs, &contrast),
            });
        }
    }
    let summary: Vec<VariantRecord> = variants.iter().enumerate().map(record).collect();
    let missing: usize = summary.iter().map(|variant| variant.n_runs - variant.n_complete).sum();
    let all: usize = summary.iter().map(|variant| variant.n_runs).sum();
    let mut episodes: Vec<u64> = summary.iter().filter_map(|variant| variant.episodes).collect();
    episodes.sort_unstable();
    let lengths = episodes.first().zip(episodes.last()).filter(|(least, most)| least < most).map(|(least, most)| {
        format!(
            "The runs have from {least} to {most} training episodes: final success is compared after different lengths."
        )
    });
    StudyAnalysis {
        schema: 1,
        varies: study.file.varies.clone(),
        hand: study.runs.first().map(|run| run.provenance.hand.clone()).unwrap_or_default(),
        statements: differences.iter().map(|difference| difference.statement.clone()).collect(),
        differences,
        runs: variants
            .iter()
            .zip(records)
            .flat_map(|(variant, runs)| runs.into_iter().map(|run| StudyRun { variant: variant.name.clone(), run }))
            .collect(),
        variants: summary,
        notes: (missing > 0)
            .then(|| format!("{missing} of {} are not complete: their results are missing.", counted(all, "run")))
            .into_iter()
            .chain(lengths)
            .chain(distances(&study.runs))
            .collect(),
    }
}

/// (runs) => a note if they were not evaluated equally often
fn distances(runs: &[Run]) -> Option<String> {
    let mut every: Vec<u64> =
        runs.iter().filter_map(|run| run.settings.get("evaluation.every")?.parse().ok()).collect();
    every.sort_unstable();
    let (least, most) = every.first().zip(every.last()).filter(|(least, most)| least < most)?;
    Some(format!(
        "Some runs were evaluated every {least} episodes, others every {most}: when a run first reached a success is known to so \
         many episodes."
    ))
}

/// Draws success along training, with a curve for each variant.
pub(crate) fn figures(study: &Study) -> Result<Vec<Figure>, ReportError> {
    let groups: Vec<Group<'_>> = study
        .file
        .variants
        .iter()
        .enumerate()
        .map(|(i, variant)| {
            let runs = study.runs_of(i);
            Group { key: variant.name.clone(), label: variant.title.clone(), runs }
        })
        .collect();
    Ok(learning_curves(FIGURE, "Success along training", &groups)?.into_iter().collect())
}

/// Writes one row for each run.
pub(crate) fn table(analysis: &StudyAnalysis) -> Result<Vec<u8>, ReportError> {
    let mut header: Vec<String> = ["variant", "seed", "run", "state", "episodes", "wall_s"].map(str::to_owned).into();
    header.extend(COMPARED.map(|quantity| quantity.key().to_owned()));
    header.extend(LEVELS.map(|level| format!("episodes_to_{:.0}_percent", 100.0 * level)));
    let text = |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
    let row = |StudyRun { variant, run }: &StudyRun| {
        let mut row = vec![variant.clone(), run.seed.to_string(), run.run.clone(), run.state.to_owned()];
        row.extend([run.episodes.to_string(), text(run.wall_s)]);
        row.extend(COMPARED.map(|quantity| text(quantity.of(run))));
        row.extend(run.reached.iter().map(|reached| text(reached.map(|r| r.episodes))));
        row
    };
    tables::write(tables::RUNS, &header, analysis.runs.iter().map(row))
}

/// Renders the page.
pub(crate) fn render(study: &Study, analysis: &StudyAnalysis, figures: &[Figure]) -> String {
    let mut header =
        words(&[&analysis.varies, "runs", "training episodes", "success (%)", "success with other objects (%)"]);
    header.extend(LEVELS.map(|level| format!("episodes to {:.0} %", 100.0 * level)));
    let row = |variant: &VariantRecord| {
        let episodes = variant.episodes.map_or_else(|| "-".to_owned(), |episodes| episodes.to_string());
        let mut row = vec![variant.title.clone(), variant.n_complete.to_string(), episodes];
        row.extend(COMPARED.map(|quantity| estimate(variant.quantities.get(quantity.key()), 100.0, 1)));
        row.extend(variant.levels.iter().map(|level| match level.median_episodes {
            Some(episodes) => number(Some(episodes), 1.0, 0),
            None => format!("{} of {}", level.n_reached, variant.n_complete),
        }));
        row
    };
    let rows: Vec<Vec<String>> = analysis.variants.iter().map(row).collect();
    let compared = |difference: &StudyDifference| {
        let points = |value: f64| format!("{:+.1}", 100.0 * value);
        let contrast = &difference.contrast;
        let title = analysis.variants.iter().find(|v| v.name == difference.variant).map(|v| v.title.clone());
        vec![
            title.unwrap_or_default(),
            if difference.quantity == Quantity::SuccessRate { "objects of training" } else { "other objects" }
                .to_owned(),
            points(contrast.difference),
            contrast
                .interval
                .map_or_else(|| "-".to_owned(), |[low, high]| format!("{} to {}", points(low), points(high))),
            probability(contrast.permutation.p),
            probability(contrast.permutation.least_p),
            supported(difference.verdict).to_owned(),
        ]
    };
    let differences: Vec<Vec<String>> = analysis.differences.iter().map(compared).collect();
    let first = analysis.variants.first().map(|variant| variant.title.as_str()).unwrap_or_default();
    let title = format!("Hand {}: {}", analysis.hand, study.file.subject);
    document(
        &title,
        &html! {
            p.soft {
                (counted(analysis.runs.len(), "run")) ". Numbers: runs.csv, report.json, and a CSV beside the figure."
            }
            (notes(&analysis.notes))
            (heading("Results"))
            @for figure in figures { (drawing(figure)) }
            (html_table("What each policy reaches", &header, &rows))
            p.soft {
                "Interquartile mean over the complete runs, with its 95 % bootstrap interval in brackets. Episodes to a "
                "success: median of the first evaluation during training that reached it; if half of the runs or more "
                "never did, how many did."
            }
            (heading(&format!("Compared with \u{201c}{first}\u{201d}")))
            (html_table(
                "Differences in success",
                &words(&[&analysis.varies, "success with", "points", "95 % interval", "p", "least p", "supported"]),
                &differences,
            ))
            ul { @for statement in &analysis.statements { li { (statement) } } }
            (heading("How it was made"))
            (provenance(&study.runs))
            @if let Some(run) = study.runs.first() {
                details { summary { "Settings of " (run.name) } (common_table(&run.settings)) }
            }
        },
    )
}

#[cfg(test)]
mod tests {
    use eigenhand_train::OtherObjects;

    use super::*;
    use crate::made_up::complete;

    fn study() -> Study {
        let run = |variant: &str, seed: u64, success: f64| {
            let mut run = complete(1.0, seed, success, &[0.1, 0.9], Some(1));
            run.name = format!("{variant}-s{seed}");
            run.summary.as_mut().expect("a summary").other_objects = Some(OtherObjects {
                episodes: 100,
                success_rate: success - 0.2,
                success_rate_per_object: BTreeMap::new(),
                success_with_components: None,
            });
            run
        };
        let of =
            |name: &'static str, success: f64| (1..=4).map(move |seed| run(name, seed, success + 0.001 * seed as f64));
        let variant = |name: &str, title: &str| StudyVariant {
            name: name.to_owned(),
            title: title.to_owned(),
            runs: (1..=5).map(|seed| format!("{name}-s{seed}")).collect(),
        };
        let variants = vec![variant("joints", "every joint"), variant("few", "5 numbers")];
        let (varies, subject) = ("the policy commands".to_owned(), "spaces".to_owned());
        Study {
            file: StudyFile { schema: 1, varies, subject, variants },
            runs: of("joints", 0.6).chain(of("few", 0.9)).collect(),
        }
    }

    #[test]
    fn each_variant_is_compared_with_the_first() {
        let analysis = analyse(&study());
        assert_eq!(analysis.variants.iter().map(|v| (v.n_runs, v.n_complete)).collect::<Vec<_>>(), [(5, 4), (5, 4)]);
        assert_eq!(analysis.differences.len(), 2);
        for (difference, words) in analysis.differences.iter().zip(["final success", "success with other objects"]) {
            assert_eq!((difference.verdict, difference.n_runs), (Verdict::Greater, [4, 4]));
            let expected = format!("to \u{201c}5 numbers\u{201d} (4 runs), {words} differs by +30.0 percentage points");
            assert!(difference.statement.contains(&expected), "{}", difference.statement);
        }
        assert_eq!(analysis.notes, ["2 of 10 runs are not complete: their results are missing."]);
        assert_eq!(analysis.runs.iter().filter(|run| run.variant == "few").count(), 4);
        let mut unlike = study();
        for (i, run) in unlike.runs.iter_mut().enumerate() {
            run.settings.insert("evaluation.every".to_owned(), if i == 0 { "200" } else { "100" }.to_owned());
        }
        let notes = analyse(&unlike).notes;
        assert!(notes.iter().any(|note| note.contains("every 100 episodes, others every 200")), "{notes:?}");
    }

    #[test]
    fn the_page_has_the_curves_and_the_table_a_row_for_each_run() {
        let study = study();
        let analysis = analyse(&study);
        let figures = figures(&study).expect("drawn");
        assert!(figures[0].svg.contains("every joint") && figures[0].svg.contains("5 numbers"));
        let curve = String::from_utf8(figures[0].csv.clone()).expect("text");
        assert!(curve.starts_with("variant,episode,median,min,max,n_runs\njoints,100,"), "{curve}");
        let page = render(&study, &analysis, &figures);
        assert!(page.contains("Compared with") && page.contains("<svg"));
        let csv = String::from_utf8(table(&analysis).expect("written")).expect("text");
        let rows: Vec<&str> = csv.lines().collect();
        assert_eq!(rows.len(), 9);
        assert!(rows[0].starts_with("variant,seed,run,state,episodes,wall_s,success_rate,other_objects_success_rate,"));
        assert!(rows[8].starts_with("few,4,few-s4,complete,"), "{}", rows[8]);
    }
}
