//! Meshes and materials.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use xmltree::Element;

use crate::error::HandError;
use crate::import::imported::Assets;
use crate::import::mesh::{Changes, MIN_HALF, Mesh, READABLE};
use crate::mjcf::{Compiler, Defaults};
use crate::sources;
use crate::xml::{attribute, elements_mut, retain_elements, set};

/// Kinds of mesh that MuJoCo 2.2.2 reads.
const NATIVE: [&str; 3] = ["stl", "obj", "msh"];

/// Reads and mends the meshes, gives every file a distinct name, and copies the defaults of an asset's class to the
/// asset.
pub(super) fn assets(
    root: &mut Element,
    defaults: &Defaults,
    compiler: &Compiler,
    file: &Path,
    notes: &mut Vec<String>,
) -> Result<Assets, HandError> {
    let mut kept = Assets::new();
    let mut names: BTreeMap<(PathBuf, String), String> = BTreeMap::new();
    let mut changes = Changes::default();
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
            // The thickness of a box that replaces a flat mesh depends on the scale.
            let key = (path, resolved.text("scale").unwrap_or_default().to_owned());
            if let Some(name) = names.get(&key) {
                set(asset, "file", name.clone());
                continue;
            }
            let bytes = sources::read_asset(&key.0, asset, file)?;
            let scale = resolved.numbers("scale")?.unwrap_or_default();
            let (name, bytes) = match mended(&bytes, &key.0, &scale, &mut changes)? {
                Some(stl) => (free_name(&Path::new(&written).with_extension("stl").to_string_lossy(), &kept), stl),
                None => (free_name(&written, &kept), bytes),
            };
            set(asset, "file", name.clone());
            kept.push((name.clone(), bytes));
            names.insert(key, name);
        }
    }
    for folder in elements_mut(root).filter(|e| e.name == "compiler") {
        for key in ["meshdir", "texturedir", "assetdir", "strippath"] {
            folder.attributes.shift_remove(key);
        }
    }
    changes.finish(notes);
    if looks > 0 {
        notes.push(format!("{looks} textures, skins and height fields were removed: they only change the looks"));
    }
    Ok(kept)
}

/// Returns the mesh in `bytes` as an STL that MuJoCo 2.2.2 reads, as the meshes of a URDF are mended; none if it reads
/// the file itself.
fn mended(bytes: &[u8], path: &Path, scale: &[f64], changes: &mut Changes) -> Result<Option<Vec<u8>>, HandError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let base = path.file_name().unwrap_or_default().to_string_lossy();
    let mut mesh = match Mesh::read(bytes, &extension) {
        Ok(mesh) => mesh,
        // MuJoCo has the last word on its own formats.
        Err(_) if NATIVE.contains(&extension.as_str()) => return Ok(None),
        Err(got) => return Err(HandError::model(path, "mesh", READABLE, got)),
    };
    let native = mesh.is_native(bytes, &extension);
    let n_faces = mesh.triangles.len();
    if changes.mend(&mut mesh, &base) {
        let half = |axis: usize| {
            let scale = scale.get(axis).map_or(1.0, |scale| scale.abs());
            if scale > 0.0 { MIN_HALF / scale } else { MIN_HALF }
        };
        return Ok(Some(mesh.boxed(&[half(0), half(1), half(2)].into()).to_stl()));
    }
    if native && mesh.triangles.len() == n_faces {
        return Ok(None);
    }
    if !native {
        changes.converted.push(base.into_owned());
    }
    Ok(Some(mesh.to_stl()))
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
