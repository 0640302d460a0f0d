//! Finds and reads the mesh files of a URDF, and makes them assets of the model.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use crate::error::HandError;
use crate::import::imported::{Assets, ImportOptions};
use crate::import::mesh::{Changes, MAX_FACES, MIN_HALF, Mesh, READABLE};
use crate::manifest::MANIFEST_FILE;
use crate::sources;
use crate::sources::read_text;

/// The result of reading a mesh.
#[derive(Debug, Clone)]
pub(super) enum Shape {
    /// An asset, and the corners of its bounding box.
    Asset { file: String, bounds: (Vector3<f64>, Vector3<f64>) },
    /// A box in the mesh's frame, for a mesh that has no volume.
    Box { centre: Vector3<f64>, half: Vector3<f64> },
}

/// Meshes read so far.
pub(super) struct Meshes<'a> {
    file: &'a Path,
    options: &'a ImportOptions,
    /// The directory that must hold all meshes; none if they may lie anywhere.
    within: Option<&'a Path>,
    /// Results by file and by the bits of the scale.
    shapes: HashMap<(PathBuf, [u64; 3]), Option<Shape>>,
    assets: Assets,
    names: BTreeSet<String>,
    changes: Changes,
}

impl<'a> Meshes<'a> {
    pub(super) fn new(file: &'a Path, options: &'a ImportOptions, within: Option<&'a Path>) -> Self {
        Self {
            file,
            options,
            within,
            shapes: HashMap::new(),
            assets: Vec::new(),
            names: BTreeSet::new(),
            changes: Changes::default(),
        }
    }

    /// Reads a mesh of `link`, and calls its file `stem`; none if its scale is zero. A mesh that was not read before keeps at
    /// most `faces`.
    pub(super) fn shape(
        &mut self,
        name: &str,
        scale: &Vector3<f64>,
        link: &str,
        stem: &str,
        faces: usize,
    ) -> Result<Option<Shape>, HandError> {
        if scale.iter().all(|x| *x == 0.0) {
            return Ok(None);
        }
        let path = self.find(name, link)?;
        let canonical = path.canonicalize().map_err(HandError::io(&path))?;
        if let Some(directory) = self.within {
            let inside = directory.canonicalize().map_err(HandError::io(directory))?;
            if !canonical.starts_with(inside) {
                return Err(HandError::Escape {
                    file: self.file.to_path_buf(),
                    key: format!("link `{link}` <mesh filename>"),
                    got: name.to_owned(),
                    directory: directory.to_path_buf(),
                });
            }
        }
        let key = (canonical, <[f64; 3]>::from(*scale).map(f64::to_bits));
        if let Some(shape) = self.shapes.get(&key) {
            return Ok(shape.clone());
        }
        let mut mesh = read(&path, link)?;
        mesh.scale(scale);
        if faces < MAX_FACES {
            mesh.simplify(faces);
        }
        let shape = self.add(mesh, name, stem);
        self.shapes.insert(key, shape.clone());
        Ok(shape)
    }

    fn add(&mut self, mut mesh: Mesh, name: &str, stem: &str) -> Option<Shape> {
        let base = name.rsplit(['/', '\\']).next().unwrap_or(name);
        let is_flat = self.changes.mend(&mut mesh, base);
        let (low, high) = mesh.bounds();
        if is_flat {
            let half = ((high - low) / 2.0).map(|x| x.max(MIN_HALF));
            return Some(Shape::Box { centre: (low + high) / 2.0, half });
        }
        let file = self.name(stem);
        self.assets.push((file.clone(), mesh.to_stl()));
        Some(Shape::Asset { file, bounds: (low, high) })
    }

    /// Makes a distinct file name for an asset, also on file systems that ignore case.
    fn name(&mut self, stem: &str) -> String {
        let safe = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
        let stem: String = stem.chars().map(safe).collect();
        let mut name = format!("{stem}.stl");
        let mut count = 1;
        while !self.names.insert(name.to_lowercase()) {
            count += 1;
            name = format!("{stem}_{count}.stl");
        }
        name
    }

    fn find(&self, name: &str, link: &str) -> Result<PathBuf, HandError> {
        let name = name.trim().replace('\\', "/");
        let package = ["package://", "model://"].iter().find_map(|scheme| name.strip_prefix(scheme));
        let missing = |way_out: String| HandError::MissingMesh {
            file: self.file.to_path_buf(),
            link: link.to_owned(),
            got: name.clone(),
            way_out,
        };
        let directory = self.file.parent().unwrap_or(Path::new(""));
        // Relative paths have no ancestors by themselves.
        let absolute = directory.canonicalize().unwrap_or_else(|_| directory.to_path_buf());
        let above = |path: &str| absolute.ancestors().map(|a| a.join(path)).find(|p| p.is_file());
        let Some(rest) = package else {
            let path = name.strip_prefix("file://").unwrap_or(&name);
            let direct = directory.join(path);
            let found = if direct.is_file() { Some(direct.clone()) } else { above(path) };
            let way_out = || match name.contains("://") && !name.starts_with("file://") {
                true => "download it, and name the downloaded file in the URDF".to_owned(),
                false => format!("put it at {}", direct.display()),
            };
            return found.ok_or_else(|| missing(way_out()));
        };
        let (package, path) = rest.split_once('/').unwrap_or((rest, ""));
        let setting = match self.within {
            Some(_) => format!("`packages = {{ {package} = \"DIR\" }}` in {MANIFEST_FILE}"),
            None => format!("--package {package}=DIR"),
        };
        if let Some(directory) = self.options.packages.get(package) {
            let path = directory.join(path);
            return if path.is_file() {
                Ok(path)
            } else {
                Err(missing(format!("there is no such file at {}, where {setting} points", path.display())))
            };
        }
        if let Some(found) = above(&format!("{package}/{path}")).or_else(|| above(path)) {
            return Ok(found);
        }
        let known = absolute.ancestors().map(|a| a.join(package)).find(|p| p.is_dir()).or_else(|| {
            absolute.ancestors().find(|a| a.ends_with(package) || is_package(a, package)).map(Path::to_path_buf)
        });
        Err(missing(match known {
            Some(known) => format!(
                "its package lies at {}, but the file is not in it: fetch or build the package as its maker says, or \
                 correct the name in the URDF; if the package lies elsewhere, name it: {setting}",
                known.display()
            ),
            None => format!("name the package's directory: {setting}"),
        }))
    }

    /// Returns the number of assets so far.
    pub(super) fn count(&self) -> usize {
        self.assets.len()
    }

    /// Returns the assets and adds notes about changed meshes.
    pub(super) fn finish(self, notes: &mut Vec<String>) -> Assets {
        self.changes.finish(notes);
        self.assets
    }
}

fn read(path: &Path, link: &str) -> Result<Mesh, HandError> {
    let bytes = sources::read_file(path)?;
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    Mesh::read(&bytes, extension).map_err(|got| HandError::model(path, format!("mesh of link `{link}`"), READABLE, got))
}

/// Returns true if a directory holds the manifest of a ROS package with this name.
fn is_package(directory: &Path, name: &str) -> bool {
    read_text(&directory.join("package.xml"))
        .is_ok_and(|text| text.split_whitespace().collect::<String>().contains(&format!("<name>{name}</name>")))
}
