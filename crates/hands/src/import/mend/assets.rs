//! Meshes and materials.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use xmltree::Element;

use crate::error::HandError;
use crate::import::imported::Assets;
use crate::mjcf::{Compiler, Defaults};
use crate::sources;
use crate::xml::{attribute, elements_mut, retain_elements, set};

/// Reads the meshes, gives every file a distinct name, and copies the defaults of an asset's class to the asset.
pub(super) fn assets(
    root: &mut Element,
    defaults: &Defaults,
    compiler: &Compiler,
    file: &Path,
    notes: &mut Vec<String>,
) -> Result<Assets, HandError> {
    let mut kept = Assets::new();
    let mut names: BTreeMap<PathBuf, String> = BTreeMap::new();
    let mut looks = 0;
    for section in elements_mut(root).filter(|e| e.name == "asset") {
        let before = section.children.len();
        retain_elements(section, |e| matches!(e.name.as_str(), "mesh" | "material"));
        looks += before - section.children.len();
        for asset in elements_mut(section) {
            let resolved = defaults.resolve(asset, None, file)?;
            asset.attributes.shift_remove("class");
            asset.attributes.shift_remove("texture");
            for key in ["scale", "emission", "specular", "shininess", "reflectance", "rgba"] {
                if let Some(value) = resolved.text(key) {
                    set(asset, key, value.to_owned());
                }
            }
            let Some(written) = attribute(asset, "file").map(str::to_owned) else { continue };
            if attribute(asset, "name").is_none() {
                let stem = Path::new(&written).file_stem().unwrap_or_default().to_string_lossy().into_owned();
                set(asset, "name", stem);
            }
            let path = compiler.asset_path(&asset.name, &written, file.parent().unwrap_or(Path::new("")));
            if !names.contains_key(&path) {
                let bytes = sources::read_asset(&path, asset, file)?;
                let name = free_name(&written, &kept);
                kept.push((name.clone(), bytes));
                names.insert(path.clone(), name);
            }
            set(asset, "file", names[&path].clone());
        }
    }
    for folder in elements_mut(root).filter(|e| e.name == "compiler") {
        for key in ["meshdir", "texturedir", "assetdir", "strippath"] {
            folder.attributes.shift_remove(key);
        }
    }
    if looks > 0 {
        notes.push(format!("{looks} textures, skins and height fields were removed: they only change the looks"));
    }
    Ok(kept)
}

/// Returns a plain file name, similar to the written one, that differs from all kept names even without regard to case.
fn free_name(written: &str, kept: &[(String, Vec<u8>)]) -> String {
    let path = Path::new(written);
    let plain = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' };
    let stem: String = path.file_stem().unwrap_or_default().to_string_lossy().chars().map(plain).collect();
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let mut name = format!("{stem}.{extension}");
    let mut count = 1;
    while kept.iter().any(|(known, _)| known.eq_ignore_ascii_case(&name)) {
        count += 1;
        name = format!("{stem}_{count}.{extension}");
    }
    name
}
