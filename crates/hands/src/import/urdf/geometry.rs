//! Geometry of the links: what collides, and what only shows.

use std::path::Path;

use nalgebra::{Isometry3, Translation3, Vector3};
use urdf_rs::{Geometry, Robot};

use super::finite::{finite, pose};
use super::meshes::{Meshes, Shape};
use crate::error::HandError;
use crate::import::imported::Assets;
use crate::import::mesh::MAX_FACES;
use crate::notes::note;

/// Most faces of a mesh that is only seen.
const VISUAL_FACES: usize = 20_000;

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

/// A geom that touches nothing and weighs nothing.
#[derive(Debug, Clone)]
pub(super) struct Visual {
    pub(super) geom: Geom,
    /// Red, green, blue and opacity from 0 to 1; none if the file states no colour.
    pub(super) colour: Option<[f64; 4]>,
}

/// The geoms of all links, each in the order of the file.
pub(super) struct Geoms {
    /// What collides.
    pub(super) solid: Vec<Vec<Geom>>,
    /// What pictures show in place of what collides.
    pub(super) visual: Vec<Vec<Visual>>,
    /// Files of the meshes.
    pub(super) assets: Assets,
    /// How many of these, the last ones, only pictures show.
    pub(super) looks: usize,
}

/// Where a geom is described.
struct Place<'a> {
    file: &'a Path,
    link: &'a str,
    /// `collision` or `visual`.
    element: &'a str,
    /// Position among the link's elements of this kind.
    index: usize,
}

/// Reads the geometry of all links. Visual geometry that cannot be read is left out, because it changes only pictures.
pub(super) fn read(
    robot: &Robot,
    file: &Path,
    mut meshes: Meshes<'_>,
    notes: &mut Vec<String>,
) -> Result<Geoms, HandError> {
    let (mut empty, mut unseen) = (Vec::new(), Vec::new());
    let mut solid = Vec::with_capacity(robot.links.len());
    for link in &robot.links {
        let mut of_link = Vec::new();
        for (index, collision) in link.collision.iter().enumerate() {
            let place = Place { file, link: &link.name, element: "collision", index };
            match place.geom(&collision.geometry, &collision.origin, &mut meshes, MAX_FACES)? {
                Some(geom) => of_link.push(geom),
                None => empty.push(link.name.as_str()),
            }
        }
        solid.push(of_link);
    }
    let touching = meshes.count();
    let mut visual = Vec::with_capacity(robot.links.len());
    for link in &robot.links {
        let mut of_link = Vec::new();
        for (index, visual) in link.visual.iter().enumerate() {
            let place = Place { file, link: &link.name, element: "visual", index };
            let colour = visual.material.as_ref().and_then(|material| material.color.as_ref()).map(|c| c.rgba.0);
            match place.geom(&visual.geometry, &visual.origin, &mut meshes, VISUAL_FACES) {
                Ok(geom) => of_link.extend(geom.map(|geom| Visual { geom, colour })),
                Err(_) => unseen.push(link.name.as_str()),
            }
        }
        visual.push(of_link);
    }
    note(notes, "collision geometry of size zero was removed, at the links", &empty);
    note(notes, "visual geometry that is missing or cannot be read was left out, at the links", &unseen);
    let assets = meshes.finish(notes);
    Ok(Geoms { solid, visual, looks: assets.len() - touching, assets })
}

impl Place<'_> {
    /// Reads a geom; none if its size is zero.
    fn geom(
        &self,
        geometry: &Geometry,
        origin: &urdf_rs::Pose,
        meshes: &mut Meshes<'_>,
        faces: usize,
    ) -> Result<Option<Geom>, HandError> {
        let place = format!("link `{}` <{}>", self.link, self.element);
        let at = pose(origin, &place, self.file)?;
        let Geometry::Mesh { filename, scale } = geometry else {
            return primitive_geom(geometry, &at, &place, self.file);
        };
        let scale = finite(&scale.map_or([1.0; 3], |s| s.0), &format!("{place} <mesh scale>"), self.file)?;
        let kind = if self.element == "visual" { "_visual" } else { "" };
        let stem = format!("{}{kind}_{}", self.link, self.index);
        Ok(meshes.shape(filename, &scale.into(), self.link, &stem, faces)?.map(|shape| mesh_geom(shape, &at)))
    }
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
