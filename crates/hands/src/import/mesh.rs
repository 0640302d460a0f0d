//! Triangles from STL, OBJ and COLLADA files, and STL that MuJoCo 2.2.2 takes.

use std::collections::HashMap;

use nalgebra::Vector3;

mod collada;
mod obj;
mod stl;

/// Most faces that MuJoCo 2.2.2 reads from a mesh.
const MAX_FACES: usize = 200_000;

/// Part of a mesh's size below which its thickness is none: its convex hull would fail.
const FLAT: f64 = 1e-4;

type Point = Vector3<f64>;

/// Triangles with their corners counter-clockwise, seen from outside.
#[derive(Debug, Clone, Default)]
pub(super) struct Mesh {
    pub(super) triangles: Vec<[Point; 3]>,
    /// What was assumed in reading, if anything.
    pub(super) note: Option<String>,
}

impl Mesh {
    /// Reads a file of the kind that `extension` names.
    ///
    /// # Errors
    /// In words that follow "expected ..., got".
    pub(super) fn read(bytes: &[u8], extension: &str) -> Result<Self, String> {
        let mesh = match extension.to_lowercase().as_str() {
            "stl" => stl::read(bytes)?,
            "obj" => obj::read(bytes)?,
            "dae" => collada::read(bytes)?,
            other => return Err(format!("a file of kind `{other}`")),
        };
        if mesh.triangles.is_empty() {
            return Err("a file without faces".to_owned());
        }
        if !mesh.points().all(|p| p.iter().all(|x| x.abs() < 1e9)) {
            return Err("a vertex that is not finite".to_owned());
        }
        Ok(mesh)
    }

    /// Stretches the mesh along its axes; a negative scale mirrors it and turns its faces over.
    pub(super) fn scale(&mut self, scale: &Point) {
        let mirrored = scale.product() < 0.0;
        for triangle in &mut self.triangles {
            for corner in triangle.iter_mut() {
                corner.component_mul_assign(scale);
            }
            if mirrored {
                triangle.swap(1, 2);
            }
        }
    }

    fn points(&self) -> impl Iterator<Item = &Point> {
        self.triangles.iter().flatten()
    }

    /// Returns the lower and the upper corner of the box that holds the mesh.
    pub(super) fn bounds(&self) -> (Point, Point) {
        let start = (Point::repeat(f64::INFINITY), Point::repeat(f64::NEG_INFINITY));
        self.points().fold(start, |(low, high), p| (low.inf(p), high.sup(p)))
    }

    /// Returns true where the vertices lie in one plane, so that there is no convex hull.
    pub(super) fn is_flat(&self) -> bool {
        let Some(a) = self.points().next() else { return true };
        let farthest = |distance: &dyn Fn(&Point) -> f64| {
            self.points().map(|p| (distance(p), *p)).max_by(|x, y| x.0.total_cmp(&y.0)).unwrap_or((0.0, *a))
        };
        let (size, b) = farthest(&|p| (p - a).norm());
        let Some(along) = (b - a).try_normalize(f64::MIN_POSITIVE) else { return true };
        let (_, c) = farthest(&|p| (p - a).cross(&along).norm());
        let Some(normal) = along.cross(&(c - a)).try_normalize(f64::MIN_POSITIVE) else { return true };
        let (thickness, _) = farthest(&|p| (p - a).dot(&normal).abs());
        thickness <= FLAT * size
    }

    /// Merges vertices on ever coarser grids until MuJoCo takes the mesh; returns true where that was needed.
    pub(super) fn simplify(&mut self) -> bool {
        let mut cells = 512.0;
        let simplified = self.triangles.len() > MAX_FACES;
        let (low, high) = self.bounds();
        while self.triangles.len() > MAX_FACES {
            let cell = (high - low).max() / cells;
            self.merge_vertices(&low, cell);
            cells /= 2.0;
        }
        simplified
    }

    fn merge_vertices(&mut self, low: &Point, cell: f64) {
        let key = |p: &Point| ((p - low) / cell).map(|x| x.floor() as i64);
        let mut first: HashMap<[i64; 3], Point> = HashMap::new();
        let mut seen = std::collections::HashSet::new();
        let mut kept = Vec::new();
        for triangle in &self.triangles {
            let keys = triangle.map(|p| <[i64; 3]>::from(key(&p)));
            let merged = [0, 1, 2].map(|i| *first.entry(keys[i]).or_insert(triangle[i]));
            let distinct = keys[0] != keys[1] && keys[1] != keys[2] && keys[2] != keys[0];
            if distinct && seen.insert(keys) {
                kept.push(merged);
            }
        }
        self.triangles = kept;
    }

    /// Returns the mesh as a binary STL.
    pub(super) fn to_stl(&self) -> Vec<u8> {
        stl::write(&self.triangles)
    }
}

/// Appends the triangles of a polygon that has no dent.
fn push_fan(triangles: &mut Vec<[Point; 3]>, corners: &[Point]) {
    if let [first, rest @ ..] = corners {
        triangles.extend(rest.windows(2).map(|edge| [*first, edge[0], edge[1]]));
    }
}
