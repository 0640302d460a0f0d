//! The surfaces of geoms as triangles.

use std::f64::consts::{PI, TAU};

use eigenhand_mujoco::{Data, GeomId, GeomShape};
use nalgebra::Vector3;

/// Number of sides of a round shape: at a radius of 100 pixels, the error of its outline is half a pixel.
const SIDES: usize = 32;
/// Number of rings of a round end, from its pole to its equator.
const RINGS: usize = 8;

/// A point of a surface with its normal, whose length need not be 1.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Place in m.
    pub position: Vector3<f64>,
    /// Outward direction.
    pub normal: Vector3<f64>,
}

/// A triangle by its corners, counter-clockwise seen from outside.
pub type Triangle = [SurfacePoint; 3];

/// Returns a geom's surface in the world; a plane and a height field have none.
pub fn surface(data: &Data, geom: GeomId) -> Vec<Triangle> {
    let mut triangles = match data.model().geom_shape(geom) {
        GeomShape::Sphere { radius } => ellipsoid([radius; 3]),
        GeomShape::Ellipsoid { half } => ellipsoid(half),
        GeomShape::Capsule { radius, half_length } => capsule(radius, half_length),
        GeomShape::Cylinder { radius, half_height } => cylinder(radius, half_height),
        GeomShape::Box { half } => cuboid(half),
        GeomShape::Mesh(mesh) => mesh.triangles().map(|corners| flat(corners.map(Vector3::from))).collect(),
        GeomShape::Plane { .. } | GeomShape::Other => Vec::new(),
    };
    let (position, turn) = (data.geom_position(geom), data.geom_orientation(geom));
    for point in triangles.iter_mut().flatten() {
        *point = SurfacePoint { position: position + turn * point.position, normal: turn * point.normal };
    }
    triangles
}

fn flat(corners: [Vector3<f64>; 3]) -> Triangle {
    let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
    corners.map(|position| SurfacePoint { position, normal })
}

/// Returns the triangles between consecutive rows of points. Each row is closed; at a pole, all points of a row
/// coincide.
fn rows(rows: &[Vec<SurfacePoint>]) -> Vec<Triangle> {
    let mut triangles = Vec::new();
    for pair in rows.windows(2) {
        for side in 0..SIDES {
            let next = (side + 1) % SIDES;
            let [a, b, c, d] = [pair[0][side], pair[0][next], pair[1][next], pair[1][side]];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    triangles
}

fn ring(point: impl Fn(Vector3<f64>) -> SurfacePoint, polar: f64) -> Vec<SurfacePoint> {
    let (across, along) = polar.sin_cos();
    (0..SIDES)
        .map(|side| {
            let (y, x) = (TAU * side as f64 / SIDES as f64).sin_cos();
            point(Vector3::new(across * x, across * y, along))
        })
        .collect()
}

fn ellipsoid(half: [f64; 3]) -> Vec<Triangle> {
    let half = Vector3::from(half);
    let point = |unit: Vector3<f64>| SurfacePoint {
        position: unit.component_mul(&half),
        // The gradient of the ellipsoid's equation.
        normal: unit.component_div(&half),
    };
    let all: Vec<_> = (0..=2 * RINGS).map(|i| ring(point, PI * i as f64 / (2 * RINGS) as f64)).collect();
    rows(&all)
}

fn capsule(radius: f64, half_length: f64) -> Vec<Triangle> {
    let end = |centre: f64| {
        move |unit: Vector3<f64>| SurfacePoint {
            position: radius * unit + Vector3::new(0.0, 0.0, centre),
            normal: unit,
        }
    };
    let angle = |i: usize| PI * i as f64 / (2 * RINGS) as f64;
    let upper = (0..=RINGS).map(|i| ring(end(half_length), angle(i)));
    let lower = (RINGS..=2 * RINGS).map(|i| ring(end(-half_length), angle(i)));
    rows(&upper.chain(lower).collect::<Vec<_>>())
}

fn cylinder(radius: f64, half_height: f64) -> Vec<Triangle> {
    let at = |z: f64, scale: f64, normal: Option<f64>| {
        ring(
            move |unit: Vector3<f64>| SurfacePoint {
                position: Vector3::new(scale * unit.x, scale * unit.y, z),
                normal: normal.map_or(unit, |z| Vector3::new(0.0, 0.0, z)),
            },
            PI / 2.0,
        )
    };
    let mut triangles = rows(&[at(half_height, radius, None), at(-half_height, radius, None)]);
    for side in [1.0, -1.0] {
        triangles.extend(rows(&[at(side * half_height, 0.0, Some(side)), at(side * half_height, radius, Some(side))]));
    }
    triangles
}

fn cuboid(half: [f64; 3]) -> Vec<Triangle> {
    let half = Vector3::from(half);
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for side in [1.0, -1.0] {
            let corner = |u: f64, v: f64| {
                let mut corner = Vector3::zeros();
                corner[axis] = side;
                corner[(axis + 1) % 3] = u;
                corner[(axis + 2) % 3] = v;
                corner.component_mul(&half)
            };
            let [a, b, c, d] = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            triangles.extend([flat([a, b, c]), flat([a, c, d])]);
        }
    }
    triangles
}
