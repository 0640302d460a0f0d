//! The file of an object. `docs/objects.md` explains it key by key.

use std::path::Path;
use std::sync::Arc;

use serde::Deserialize;

use super::mesh::ConvexMesh;
use super::shape::Shape;
use crate::SimError;

/// The schema that this program reads.
const SCHEMA: i64 = 1;

/// The contents of an object's file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ObjectManifest {
    /// Version of the file's format.
    schema: i64,
    /// Number in the observation; absent: the file's place in its directory.
    #[serde(default)]
    pub(super) id: Option<usize>,
    /// Mass in kg.
    pub(super) mass: f64,
    /// Sliding friction, instead of `physics.friction`.
    #[serde(default)]
    pub(super) friction: Option<f64>,
    shape: ShapeManifest,
}

/// The table `shape`, with lengths in m.
#[derive(Debug, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
enum ShapeManifest {
    Sphere { radius: f64 },
    Box { half: [f64; 3] },
    Cylinder { radius: f64, half_height: f64 },
    Capsule { radius: f64, half_length: f64 },
    Ellipsoid { half: [f64; 3] },
    Mesh { file: String, scale: Option<f64> },
}

impl ObjectManifest {
    /// Reads and checks the file in `text`; errors name it as `path`.
    pub(super) fn parse(text: &str, path: &Path) -> Result<ObjectManifest, SimError> {
        let wrong = |reason: String| SimError::ObjectFile { path: path.to_owned(), reason };
        let manifest: ObjectManifest =
            toml::from_str(text).map_err(|error| wrong(error.to_string().trim_end().to_owned()))?;
        let expect = |good: bool, key: &str, expected: &str, got: String| {
            if good { Ok(()) } else { Err(wrong(format!("{key} = {got} is not allowed: expected {expected}"))) }
        };
        expect(manifest.schema == SCHEMA, "schema", &SCHEMA.to_string(), manifest.schema.to_string())?;
        let positive = |number: f64| number > 0.0 && number.is_finite();
        let mass = manifest.mass;
        expect(positive(mass), "mass", "a positive number of kg", mass.to_string())?;
        if let Some(friction) = manifest.friction {
            let good = friction >= 0.0 && friction.is_finite();
            expect(good, "friction", "a number that is not negative", friction.to_string())?;
        }
        let lengths = manifest.shape.lengths();
        for (key, length) in lengths {
            expect(positive(length), &format!("shape.{key}"), "positive lengths in m", length.to_string())?;
        }
        Ok(manifest)
    }

    /// Returns the shape; `read` reads a file beside this one.
    pub(super) fn shape(
        &self,
        path: &Path,
        read: impl Fn(&Path) -> Result<Vec<u8>, SimError>,
    ) -> Result<Shape, SimError> {
        Ok(match &self.shape {
            ShapeManifest::Sphere { radius } => Shape::Sphere { radius: *radius },
            ShapeManifest::Box { half } => Shape::Box { half: *half },
            ShapeManifest::Cylinder { radius, half_height } => {
                Shape::Cylinder { radius: *radius, half_height: *half_height }
            }
            ShapeManifest::Capsule { radius, half_length } => {
                Shape::Capsule { radius: *radius, half_length: *half_length }
            }
            ShapeManifest::Ellipsoid { half } => Shape::Ellipsoid { half: *half },
            ShapeManifest::Mesh { file, scale } => {
                let place = path.with_file_name(file);
                let extension = place.extension().unwrap_or_default().to_string_lossy();
                let mesh = ConvexMesh::parse(&extension, &read(&place)?)
                    .map_err(|reason| SimError::ObjectFile { path: place.clone(), reason })?;
                Shape::Mesh(Arc::new(mesh.scaled(scale.unwrap_or(1.0))))
            }
        })
    }
}

impl ShapeManifest {
    /// Lists every length with its key.
    fn lengths(&self) -> Vec<(&'static str, f64)> {
        match *self {
            ShapeManifest::Sphere { radius } => vec![("radius", radius)],
            ShapeManifest::Box { half } | ShapeManifest::Ellipsoid { half } => half.map(|h| ("half", h)).to_vec(),
            ShapeManifest::Cylinder { radius, half_height } => vec![("radius", radius), ("half_height", half_height)],
            ShapeManifest::Capsule { radius, half_length } => vec![("radius", radius), ("half_length", half_length)],
            ShapeManifest::Mesh { scale, .. } => vec![("scale", scale.unwrap_or(1.0))],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_file_is_answered_with_file_key_and_expectation() {
        let sound = "schema = 1\nmass = 0.1\n[shape]\nkind = \"sphere\"\nradius = 0.03\n";
        let parse = |text: &str| ObjectManifest::parse(text, Path::new("set/ball.toml"));
        assert!(parse(sound).is_ok());
        for (from, to, parts) in [
            ("mass = 0.1", "mass = -1", ["mass = -1", "a positive number of kg"]),
            ("mass = 0.1\n", "", ["missing field", "mass"]),
            ("mass", "weight", ["weight", "mass"]),
            ("radius = 0.03", "radius = 0", ["shape.radius", "positive"]),
            ("radius", "radus", ["radus", "radius"]),
            ("sphere", "ball", ["ball", "sphere"]),
            ("schema = 1", "schema = 2", ["schema = 2", "expected 1"]),
        ] {
            let message = parse(&sound.replacen(from, to, 1)).expect_err(to).to_string();
            assert!(message.starts_with("set/ball.toml: "), "{message}");
            assert!(parts.iter().all(|part| message.contains(part)), "{message}");
        }
    }
}
