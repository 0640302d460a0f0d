//! Reading of a hand's directory: the manifest, the model, and the check that every name resolves.

use std::path::Path;

use crate::additions;
use crate::error::HandError;
use crate::hand::Hand;
use crate::import;
use crate::manifest::{HandManifest, MANIFEST_FILE, ModelFormat};
use crate::model::Contents;
use crate::resolve;
use crate::sources;
use crate::sources::read_text;

impl Hand {
    /// Reads and checks the hand in `directory`, which holds a manifest. Only [`Registry::get`](crate::Registry::get)
    /// loads compiled plugins, because it knows the directories whose libraries the user allowed.
    ///
    /// # Errors
    /// Names the file, the key and the expected value: see [`HandError`].
    pub fn load(directory: impl AsRef<Path>) -> Result<Self, HandError> {
        let directory = directory.as_ref();
        let manifest_path = directory.join(MANIFEST_FILE);
        if directory.is_dir() && !manifest_path.is_file() {
            return Err(HandError::NoManifest { path: directory.to_path_buf(), expected: MANIFEST_FILE });
        }
        let text = read_text(&manifest_path)?;
        let manifest = HandManifest::parse(&text, &manifest_path)?;
        let model_path = directory.join(&manifest.model);
        let mut notes = Vec::new();
        let (mut sources, assets) = match manifest.format {
            ModelFormat::Mjcf => {
                (sources::read(directory, &manifest_path, &text, &manifest.model, &mut notes)?, Vec::new())
            }
            ModelFormat::Urdf => import::read_urdf(directory, &manifest_path, &text, &manifest, &mut notes)?,
        };
        additions::apply(&mut sources.model, &manifest, &manifest_path)?;
        let contents = Contents::read(&sources.model, &model_path)?;
        let fingertips = resolve::frames(&manifest, &contents, &manifest_path)?;
        let posture = resolve::posture(&manifest, &contents, &manifest_path)?;
        resolve::check_open_posture(&manifest, &contents, &manifest_path)?;
        resolve::check_closing(&manifest, &contents, &manifest_path)?;
        Ok(Self {
            directory: directory.to_path_buf(),
            model_directory: model_path.parent().unwrap_or(directory).to_path_buf(),
            compiler: contents.compiler,
            assets,
            notes,
            files: sources.files,
            digest: sources.digest,
            model: sources.model,
            joints: contents.joints,
            posture,
            actuators: contents.actuators,
            couplings: contents.couplings,
            fingertips,
            manifest,
        })
    }
}
