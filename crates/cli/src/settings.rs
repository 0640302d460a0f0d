//! Options on the settings of runs.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use eigenhand_train::config::Preset;
use eigenhand_train::request::NewRun;

use crate::numbers::{LARGEST, whole};
use crate::search_path;

/// Options that all commands share that make runs.
#[derive(clap::Args, Clone)]
pub struct SettingsArgs {
    /// Settings to start from [default: default, or the preset in the configuration file]
    #[arg(long, value_name = "NAME", value_parser = preset_parser())]
    pub preset: Option<Preset>,
    /// Training episodes of a run, in all
    #[arg(long, value_name = "N", value_parser = whole::<u64>(1..=LARGEST))]
    pub episodes: Option<u64>,
    /// Objects to grasp, separated by commas: objects (cube), sets (varied), directories or files
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub objects: Option<Vec<String>>,
    /// TOML file with settings; docs/configuration.md lists them
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Changes one setting, such as learner.gamma=0.95; can be given several times
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
    /// Additional directory of hands; can be given several times
    #[arg(long, value_name = "DIR")]
    pub plugins: Vec<PathBuf>,
    /// Trains a hand that fails the hand contract, too
    #[arg(long)]
    pub force: bool,
}

impl SettingsArgs {
    /// Returns command-line arguments with the same meaning.
    pub fn arguments(&self) -> Vec<OsString> {
        let SettingsArgs { preset, episodes, objects, config, assignments, plugins, force } = self;
        let mut arguments: Vec<OsString> = Vec::new();
        let mut option = |name: &str, value: OsString| arguments.extend([name.into(), value]);
        if let Some(preset) = preset {
            option("--preset", preset.name().into());
        }
        if let Some(episodes) = episodes {
            option("--episodes", episodes.to_string().into());
        }
        if let Some(objects) = objects {
            option("--objects", objects.join(",").into());
        }
        if let Some(file) = config {
            option("--config", file.into());
        }
        assignments.iter().for_each(|assignment| option("--set", assignment.into()));
        plugins.iter().for_each(|directory| option("--plugins", directory.into()));
        if *force {
            arguments.push("--force".into());
        }
        arguments
    }

    /// Returns a request for a new run with only these settings.
    pub fn new_run(&self) -> NewRun {
        NewRun {
            preset: self.preset,
            file: self.config.clone(),
            assignments: self.assignments.clone(),
            episodes: self.episodes,
            objects: self.objects.clone(),
            force: self.force,
            hands: search_path(&self.plugins),
            ..NewRun::default()
        }
    }
}

/// Reads the name of a preset, and describes each preset in `--help`.
fn preset_parser() -> impl TypedValueParser<Value = Preset> {
    let values = Preset::ALL.map(|preset| PossibleValue::new(preset.name()).help(preset.meaning()));
    // The possible values are the presets' names.
    PossibleValuesParser::new(values)
        .map(|name| Preset::ALL.into_iter().find(|preset| preset.name() == name).unwrap_or_default())
}
