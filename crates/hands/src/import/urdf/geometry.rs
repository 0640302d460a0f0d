//! Collision geometry of the links.

use std::path::Path;

use nalgebra::{Isometry3, Translation3, Vector3};
use urdf_rs::{Geometry, Robot};

use super::finite::{finite, pose};
use super::meshes::{Meshes, Shape};
use crate::error::HandError;
use crate::import::imported::Assets;
use crate::notes::note;

/// A geom in the terms of MJCF.
#[derive(Debug, Clone)]
pub(super) struct Geom {
    /// Value of `type`.
    pub(super) kind: &'static str,
    /// Half sizes, as the type defines them; empty for a mesh.
    pub(super) size: Vec<f64>,
    /// File of a mesh.
    pub(super) mesh: Option<String>,
    /// In the link's frame.
    pub(super) pose: Isometry3<f64>,
    /// Corners of the geom's bounding box, in its own frame.
    pub(super) bounds: (Vector3<f64>, Vector3<f64>),
}

/// Reads the geoms of all links, in the order of the file, and their meshes.
pub(super) fn read(
    robot: &Robot,
    file: &Path,
    mut meshes: Meshes<'_>,
    notes: &mut Vec<String>,
) -> Result<(Vec<Vec<Geom>>, Assets), HandError> {
    let mut empty = Vec::new();
    let mut geoms = Vec::with_capacity(robot.links.len());
    for link in &robot.links {
        let mut of_link = Vec::new();
        for (i, collision) in link.collision.iter().enumerate() {
            let place = format!("link `{}` <collision>", link.name);
            let at = pose(&collision.origin, &place, file)?;
            let geom = match &collision.geometry {
                Geometry::Mesh { filename, scale } => {
                    let scale = finite(&scale.map_or([1.0; 3], |s| s.0), &format!("{place} <mesh scale>"), file)?;
                    meshes.shape(filename, &scale.into(), &link.name, i)?.map(|shape| mesh_geom(shape, &at))
                }
                primitive => primitive_geom(primitive, &at, &place, file)?,
            };
            match geom {
                Some(geom) => of_link.push(geom),
                None => empty.push(link.name.as_str()),
            }
        }
        geoms.push(of_link);
    }
    note(notes, "collision geometry of size zero was removed, at the links", &empty);
    Ok((geoms, meshes.finish(notes)))
}

fn mesh_geom(shape: Shape, at: &Isometry3<f64>) -> Geom {
    match shape {
        Shape::Asset { file, bounds } => Geom { kind: "mesh", size: Vec::new(), mesh: Some(file), pose: *at, bounds },
        Shape::Box { centre, half } => Geom {
            kind: "box",
            size: half.iter().copied().collect(),
            mesh: None,
            pose: at * Translation3::from(centre),
            bounds: (-half, half),
        },
    }
}

/// Converts a primitive; none if one of its sizes is zero.
fn primitive_geom(
    geometry: &Geometry,
    at: &Isometry3<f64>,
    place: &str,
    file: &Path,
) -> Result<Option<Geom>, HandError> {
    let (kind, size, half) = match *geometry {
        Geometry::Box { size } => {
            let half = Vector3::from(finite(&size.0, &format!("{place} <box>"), file)?) / 2.0;
            ("box", half.iter().copied().collect(), half)
        }
        Geometry::Cylinder { radius, length } => {
            let [radius, length] = finite(&[radius, length], &format!("{place} <cylinder>"), file)?;
            ("cylinder", vec![radius, length / 2.0], Vector3::new(radius, radius, length / 2.0))
        }
        Geometry::Capsule { radius, length } => {
            let [radius, length] = finite(&[radius, length], &format!("{place} <capsule>"), file)?;
            ("capsule", vec![radius, length / 2.0], Vector3::new(radius, radius, length / 2.0 + radius))
        }
        Geometry::Sphere { radius } => {
            let [radius] = finite(&[radius], &format!("{place} <sphere>"), file)?;
            ("sphere", vec![radius], Vector3::repeat(radius))
        }
        // Meshes are read elsewhere.
        Geometry::Mesh { .. } => return Ok(None),
    };
    let solid = size.iter().all(|x| *x > 0.0);
    Ok(solid.then_some(Geom { kind, size, mesh: None, pose: *at, bounds: (-half, half) }))
}
