//! A mesh as triangles: scaled, measured and simplified.

use std::collections::{HashMap, HashSet};

use nalgebra::Vector3;

/// Most faces that MuJoCo 2.2.2 reads from a mesh.
pub(in crate::import) const MAX_FACES: usize = 200_000;

/// Thickness, as a part of its size, below which a mesh counts as flat: its convex hull would fail.
const FLAT: f64 = 1e-4;

pub(super) type Point = Vector3<f64>;

/// Triangles with their corners counter-clockwise, seen from outside.
#[derive(Debug, Clone, Default)]
pub(in crate::import) struct Mesh {
    pub(in crate::import) triangles: Vec<[Point; 3]>,
    /// An assumption made in reading.
    pub(in crate::import) note: Option<String>,
}

impl Mesh {
    /// Stretches the mesh along its axes; a negative scale mirrors it and turns its faces over.
    pub(in crate::import) fn scale(&mut self, scale: &Point) {
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

    pub(super) fn points(&self) -> impl Iterator<Item = &Point> {
        self.triangles.iter().flatten()
    }

    /// Returns the lower and the upper corner of the box that holds the mesh.
    pub(in crate::import) fn bounds(&self) -> (Point, Point) {
        let start = (Point::repeat(f64::INFINITY), Point::repeat(f64::NEG_INFINITY));
        self.points().fold(start, |(low, high), p| (low.inf(p), high.sup(p)))
    }

    /// Returns true if the vertices lie in one plane, so that there is no convex hull.
    pub(in crate::import) fn is_flat(&self) -> bool {
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

    /// Returns true if no two triangles run through an edge in the same direction.
    pub(super) fn is_oriented(&self) -> bool {
        let key = |p: &Point| p.map(|x| (x as f32).to_bits());
        let mut seen = HashSet::new();
        self.triangles.iter().all(|triangle| {
            let corners = triangle.map(|p| <[u32; 3]>::from(key(&p)));
            let edges = [(0, 1), (1, 2), (2, 0)].map(|(from, to)| (corners[from], corners[to]));
            edges.iter().all(|edge| edge.0 == edge.1 || seen.insert(*edge))
        })
    }

    /// Returns a box around the mesh whose sides are at least twice `half` long.
    pub(in crate::import) fn boxed(&self, half: &Point) -> Self {
        let (low, high) = self.bounds();
        let (middle, half) = ((low + high) / 2.0, ((high - low) / 2.0).sup(half));
        let corner =
            |i: usize| middle + Point::from_fn(|axis, _| if i >> axis & 1 == 1 { half[axis] } else { -half[axis] });
        // Each face once, its corners counter-clockwise seen from outside; bit 0 of a corner is x, bit 1 y, bit 2 z.
        const FACES: [[usize; 4]; 6] =
            [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let mut triangles = Vec::with_capacity(2 * FACES.len());
        for face in FACES {
            push_fan(&mut triangles, &face.map(corner));
        }
        Self { triangles, note: None }
    }

    /// Merges vertices on ever coarser grids until at most `faces` are left; returns true if any were merged.
    pub(in crate::import) fn simplify(&mut self, faces: usize) -> bool {
        let mut cells = 512.0;
        let simplified = self.triangles.len() > faces;
        let (low, high) = self.bounds();
        while self.triangles.len() > faces {
            let cell = (high - low).max() / cells;
            self.merge_vertices(&low, cell);
            cells /= 2.0;
        }
        simplified
    }

    fn merge_vertices(&mut self, low: &Point, cell: f64) {
        let key = |p: &Point| ((p - low) / cell).map(|x| x.floor() as i64);
        let mut first: HashMap<[i64; 3], Point> = HashMap::new();
        let mut seen = HashSet::new();
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
}

/// Appends the triangles of a convex polygon.
pub(super) fn push_fan(triangles: &mut Vec<[Point; 3]>, corners: &[Point]) {
    if let [first, rest @ ..] = corners {
        triangles.extend(rest.windows(2).map(|edge| [*first, edge[0], edge[1]]));
    }
}
