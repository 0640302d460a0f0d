//! The settings with which the runs were made, the programs and the machines.

use eigenhand_train::config::Settings;
use maud::{Markup, html};

use super::{table, words};
use crate::run::Run;
use crate::statements::differing_settings;

/// Settings and programs of the runs.
pub fn section(runs: &[Run]) -> Markup {
    let differing = differing_settings(runs);
    let common: Vec<(&String, &String)> = runs.first().map_or_else(Vec::new, |run| {
        let of_all =
            |key: &String| !differing.contains_key(key) && !["lambda", "seed", "workers"].contains(&key.as_str());
        run.settings.iter().filter(|(key, _)| of_all(key)).collect()
    });
    let header: Vec<String> =
        std::iter::once("setting".to_owned()).chain(runs.iter().map(|run| run.name.clone())).collect();
    let rows: Vec<Vec<String>> =
        differing.into_iter().map(|(key, values)| std::iter::once(key).chain(values).collect()).collect();
    html! {
        @if !rows.is_empty() {
            (table("Settings in which the runs differ", &header, &rows))
        }
        (provenance(runs))
        details {
            summary { (common.len()) " settings that all runs share" }
            (common_table(&common.into_iter().map(|(k, v)| (k.clone(), v.clone())).collect()))
        }
    }
}

pub(crate) fn common_table(settings: &Settings) -> Markup {
    html! {
        div.scroll {
            table {
                caption { "Settings" }
                tbody {
                    @for (key, value) in settings {
                        tr { th scope="row" { code { (key) } } td.word { code { (value) } } }
                    }
                }
            }
        }
    }
}

/// One row for all runs with the same versions, machine and hand.
pub(crate) fn provenance(runs: &[Run]) -> Markup {
    let header = words(&["runs", "program", "revision", "MuJoCo", "platform", "processors", "hand's digest"]);
    let start = |text: &str| text.chars().take(12).collect::<String>();
    let mut rows: Vec<Vec<String>> = Vec::new();
    for run in runs {
        let made = &run.provenance;
        let with = vec![
            made.eigenhand_version.clone(),
            format!("{}{}", start(&made.git_revision), if made.git_revision.ends_with('+') { "+" } else { "" }),
            made.mujoco_version.clone(),
            made.platform.clone(),
            made.processors.to_string(),
            start(&made.hand_digest),
        ];
        match rows.iter_mut().find(|row| row[1..] == with[..]) {
            Some(row) => row[0].push_str(&format!(", {}", run.name)),
            None => rows.push(std::iter::once(run.name.clone()).chain(with).collect()),
        }
    }
    table("Programs and machines", &header, &rows)
}
