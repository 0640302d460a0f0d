//! From a request to complete settings: the layers, and the hand that they name.

use std::path::Path;

use eigenhand_hands::{Hand, Registry};
use toml::Value;

use super::NewRun;
use crate::action_space::{self, ActionSpace};
use crate::config::{ConfigError, Layers, Preset, RunConfig, parse_settings, read_layer};
use crate::error::TrainError;
use crate::run_dir::{CONFIG, read_config};

/// Resolves a request into complete settings and the hand.
///
/// # Errors
/// The first fault of the configuration or the hand.
pub fn resolve(request: &NewRun) -> Result<(RunConfig, Hand), TrainError> {
    let registry = Registry::discover(&request.hands)?;
    let (mut config, components) = sum_layers(request, &registry)?;
    let hand = registry.get(&config.hand)?;
    let directions = hand.actuators.len();
    if config.synergy.components > directions {
        match components {
            // The default is for hands with more.
            None => config.synergy.components = directions,
            Some(origin) => {
                let reason = format!(
                    "synergy.components = {} is not allowed: for the hand {}, expected at most {directions}, one for each \
                     actuator without the slide",
                    config.synergy.components, hand.manifest.name
                );
                return Err(ConfigError::Value { origin, reason }.into());
            }
        }
    }
    Ok((named_by_path(config, &hand, &registry), hand))
}

/// Names a hand that the registry does not list by its path.
fn named_by_path(mut config: RunConfig, hand: &Hand, registry: &Registry) -> RunConfig {
    if !registry.list().iter().any(|entry| entry.name == config.hand) {
        // Only an absolute path leads to the hand from every working directory.
        let complete = hand.directory.canonicalize().unwrap_or_else(|_| hand.directory.clone());
        config.hand = complete.display().to_string();
    }
    config
}

/// Combines the layers of a request: default, preset, file, assignments, options. Also returns what set the number of
/// components; none for the default.
fn sum_layers(request: &NewRun, registry: &Registry) -> Result<(RunConfig, Option<String>), TrainError> {
    let file = match &request.file {
        Some(path) => Some((path.display().to_string(), read_layer(path)?)),
        None => None,
    };
    let before = request.from.as_deref().map(settings_of).transpose()?;
    let mut written = None;
    for (origin, text) in before.iter().chain(&file) {
        written = preset_in(origin, text)?.or(written);
    }
    let preset = request.preset.or(written).unwrap_or_default();
    let mut layers = Layers::new(preset)?;
    if let Some((origin, text)) = &before {
        layers.add_text(origin, text)?;
    }
    if let Some((origin, text)) = &file {
        layers.add_text(origin, text)?;
    }
    for assignment in &request.assignments {
        layers.add_assignment(assignment)?;
    }
    if layers.origin("from").is_some_and(|origin| origin.starts_with("--set ")) {
        return Err(TrainError::Option {
            option: "--set from".to_owned(),
            reason: "the settings of that run are a layer of their own: choose it with --from".to_owned(),
        });
    }
    if layers.origin("preset").is_some_and(|origin| origin.starts_with("--set ")) {
        return Err(TrainError::Option {
            option: "--set preset".to_owned(),
            reason: "a preset is a layer of its own: choose it with --preset".to_owned(),
        });
    }
    let whole = |n: u64| Value::Integer(i64::try_from(n).unwrap_or(i64::MAX));
    let options = [
        ("preset", Some(Value::String(preset.name().to_owned()))),
        ("hand", request.hand.clone().map(Value::String)),
        ("lambda", request.lambda.map(Value::Float)),
        ("seed", request.seed.map(whole)),
        ("episodes", request.episodes.map(whole)),
        ("workers", request.workers.map(|n| whole(n as u64))),
        ("tensorboard", request.tensorboard.map(Value::Boolean)),
        ("objects", request.objects.clone().map(|names| Value::Array(names.into_iter().map(Value::String).collect()))),
    ];
    for (key, value) in options {
        if let Some(value) = value {
            layers.set(key, value, &format!("--{key}"))?;
        }
    }
    if layers.origin("hand").is_none() && !request.default_hand {
        let names: Vec<&str> = registry.list().iter().map(|entry| entry.name.as_str()).collect();
        let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        return Err(TrainError::NoHand { known });
    }
    let components = layers.origin("synergy.components").map(str::to_owned);
    Ok((layers.resolve()?, components))
}

/// (run) => what it says of itself, and its settings as those of a run that starts with its networks
fn settings_of(run: &Path) -> Result<(String, String), TrainError> {
    // Only an absolute path leads to the run from every working directory.
    let run = run.canonicalize().unwrap_or_else(|_| run.to_owned());
    let mut config = read_config(&run)?;
    if config.action_space == ActionSpace::Synergy {
        config.synergy.file = action_space::kept_in(&run).display().to_string();
    }
    config.from = run.display().to_string();
    Ok((run.join(CONFIG).display().to_string(), config.to_toml()?))
}

/// Returns the preset that a configuration file names, if it names one.
fn preset_in(origin: &str, text: &str) -> Result<Option<Preset>, ConfigError> {
    let Some(name) = parse_settings(origin, text)?.remove("preset") else { return Ok(None) };
    match Preset::ALL.into_iter().find(|preset| name.trim_matches(['"', '\'']) == preset.name()) {
        Some(preset) => Ok(Some(preset)),
        None => {
            let known = Preset::ALL.map(Preset::name).join(", ");
            let reason = format!("preset = {name} is not allowed: expected one of {known}");
            Err(ConfigError::Value { origin: origin.to_owned(), reason })
        }
    }
}

#[cfg(test)]
mod tests {
    use eigenhand_hands::SearchPath;

    use super::*;

    fn request() -> NewRun {
        NewRun { hand: Some("some-hand".to_owned()), ..NewRun::default() }
    }

    fn resolved(request: &NewRun) -> Result<RunConfig, TrainError> {
        Ok(sum_layers(request, &Registry::discover(&SearchPath::from_environment(&[]))?)?.0)
    }

    /// A file that lives as long as the test.
    fn file(text: &str) -> tempfile::NamedTempFile {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("writable");
        file
    }

    fn with_file(file: &tempfile::NamedTempFile) -> NewRun {
        NewRun { file: Some(file.path().to_owned()), ..request() }
    }

    #[test]
    fn each_layer_overrides_the_one_before() {
        let file = file("lambda = 2.0\nseed = 5\nepisodes = 10\n[learner]\ngamma = 0.9\n");
        let quick = resolved(&NewRun { preset: Some(Preset::Quick), ..request() }).expect("valid");
        let config = resolved(&NewRun {
            preset: Some(Preset::Quick),
            assignments: vec!["seed=6".to_owned(), "episodes=11".to_owned()],
            episodes: Some(12),
            ..with_file(&file)
        })
        .expect("valid");
        assert_eq!(config.objects, quick.objects, "from the preset");
        assert_eq!((config.lambda, config.learner.gamma), (2.0, 0.9), "from the file");
        assert_eq!(config.seed, 6, "from --set");
        assert_eq!(config.episodes, 12, "from the option");
        assert_eq!(config.hand, "some-hand");
    }

    #[test]
    fn a_preset_in_the_file_brings_its_settings() {
        let file = file("preset = \"quick\"\n");
        let quick = resolved(&NewRun { preset: Some(Preset::Quick), ..request() }).expect("valid");
        assert_eq!(resolved(&with_file(&file)).expect("valid"), quick);
        let paper = resolved(&NewRun { preset: Some(Preset::Paper), ..with_file(&file) }).expect("valid");
        let expected = resolved(&NewRun { preset: Some(Preset::Paper), ..request() }).expect("valid");
        assert_eq!(paper, expected, "the option is above the file");
    }

    #[test]
    fn a_hand_has_to_be_named_somewhere() {
        let error = resolved(&NewRun::default()).expect_err("no hand");
        assert!(error.is_usage() && error.to_string().contains("--hand"), "{error}");
        let file = file("hand = \"from-file\"\n");
        let named = resolved(&NewRun { hand: None, ..with_file(&file) }).expect("named in the file");
        assert_eq!(named.hand, "from-file");
        let assigned = NewRun { assignments: vec!["hand = assigned".to_owned()], ..NewRun::default() };
        assert_eq!(resolved(&assigned).expect("named with --set").hand, "assigned");
    }

    #[test]
    fn wrong_requests_say_where_they_are_wrong() {
        let assigning = |text: &str| NewRun { assignments: vec![text.to_owned()], ..request() };
        let bad_preset = file("preset = \"quik\"\n");
        let bad_key = file("[learner]\ngama = 0.9\n");
        let no_toml = file("= 3\n");
        let nowhere = tempfile::tempdir().expect("a directory");
        let cases = [
            (assigning("preset=quick"), "--preset"),
            (assigning("learner.gama=0.9"), "did you mean \"learner.gamma\""),
            (assigning("nonsense"), "key=value"),
            (NewRun { lambda: Some(-1.0), ..request() }, "lambda = -1"),
            (NewRun { objects: Some(Vec::new()), ..request() }, "objects"),
            (with_file(&bad_preset), "expected one of default, quick, paper"),
            (with_file(&bad_key), "did you mean \"learner.gamma\""),
            (with_file(&no_toml), "line 1"),
            (NewRun { file: Some(nowhere.path().join("run.toml")), ..request() }, "run.toml"),
        ];
        for (request, part) in cases {
            let error = resolved(&request).expect_err(part);
            assert!(error.is_usage(), "{error}");
            assert!(error.to_string().contains(part), "{error} does not say {part}");
        }
    }
}
