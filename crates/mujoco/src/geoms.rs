//! Shape, colour, group and mesh of the geoms in a compiled model.

use nalgebra::Vector3;

use crate::bindings as mj;
use crate::model::slice_of;
use crate::{GeomId, Model};

/// Colour that MuJoCo gives a geom without a colour of its own; such a geom is drawn in the colour of its material.
const UNSTATED_COLOUR: [f32; 4] = [0.5, 0.5, 0.5, 1.0];

/// The shape of a geom in its own frame, with its sizes in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GeomShape<'a> {
    /// The plane z = 0, seen from above; a half size of 0 is infinite.
    Plane {
        /// Half sizes along x and y.
        half: [f64; 2],
    },
    /// A ball.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// A cylinder along z with round ends.
    Capsule {
        /// Radius.
        radius: f64,
        /// Half the length of the cylindrical part.
        half_length: f64,
    },
    /// An ellipsoid.
    Ellipsoid {
        /// Half axes.
        half: [f64; 3],
    },
    /// A cylinder along z.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Half of its height.
        half_height: f64,
    },
    /// A box.
    Box {
        /// Half edges.
        half: [f64; 3],
    },
    /// A mesh of triangles.
    Mesh(MeshView<'a>),
    /// A height field, or a shape that only a viewer adds.
    Other,
}

/// The triangles of a mesh, in the frame of the geom that shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshView<'a> {
    /// Coordinates x, y and z of each vertex, in m.
    vertices: &'a [f32],
    /// Indices of the three vertices of each triangle.
    faces: &'a [i32],
    /// The same for the triangles of the convex hull; empty if MuJoCo has not made one.
    hull: &'a [i32],
}

impl<'a> MeshView<'a> {
    /// Lists the vertices.
    pub fn vertices(self) -> impl Iterator<Item = Vector3<f64>> + 'a {
        self.vertices.chunks_exact(3).map(|v| Vector3::new(v[0].into(), v[1].into(), v[2].into()))
    }

    /// Lists the triangles by their corners. Leaves out triangles with the index of a missing vertex.
    pub fn triangles(self) -> impl Iterator<Item = [[f64; 3]; 3]> + 'a {
        self.corners(self.faces)
    }

    /// Lists the triangles of the convex hull, with which the mesh collides. MuJoCo makes none for a mesh that only shows.
    pub fn hull_triangles(self) -> impl Iterator<Item = [[f64; 3]; 3]> + 'a {
        self.corners(self.hull)
    }

    fn corners(self, faces: &'a [i32]) -> impl Iterator<Item = [[f64; 3]; 3]> + 'a {
        let corner = move |index: i32| {
            let first = 3 * usize::try_from(index).ok()?;
            let [x, y, z] = *self.vertices.get(first..first + 3)?.first_chunk::<3>()?;
            Some([x, y, z].map(f64::from))
        };
        faces.chunks_exact(3).filter_map(move |face| Some([corner(face[0])?, corner(face[1])?, corner(face[2])?]))
    }
}

impl Model {
    /// Lists the geoms in the model's order.
    pub fn geoms(&self) -> impl Iterator<Item = GeomId> + use<> {
        (0..self.ngeom()).map(GeomId)
    }

    /// Returns a geom's shape.
    pub fn geom_shape(&self, id: GeomId) -> GeomShape<'_> {
        let size = self.numbers(self.get().geom_size, 3 * self.get().ngeom);
        let [a, b, c] = std::array::from_fn(|i| size[3 * id.0 + i]);
        match self.ints(self.get().geom_type, self.get().ngeom)[id.0] as mj::mjtGeom_ {
            mj::mjGEOM_PLANE => GeomShape::Plane { half: [a, b] },
            mj::mjGEOM_SPHERE => GeomShape::Sphere { radius: a },
            mj::mjGEOM_CAPSULE => GeomShape::Capsule { radius: a, half_length: b },
            mj::mjGEOM_ELLIPSOID => GeomShape::Ellipsoid { half: [a, b, c] },
            mj::mjGEOM_CYLINDER => GeomShape::Cylinder { radius: a, half_height: b },
            mj::mjGEOM_BOX => GeomShape::Box { half: [a, b, c] },
            mj::mjGEOM_MESH => self.mesh(id).map_or(GeomShape::Other, GeomShape::Mesh),
            _ => GeomShape::Other,
        }
    }

    /// Returns a geom's colour as red, green, blue and opacity in [0, 1]: its own, or else its material's.
    pub fn geom_colour(&self, id: GeomId) -> [f32; 4] {
        let own = four(self.floats(self.get().geom_rgba, 4 * self.get().ngeom), id.0);
        let material = self.ints(self.get().geom_matid, self.get().ngeom)[id.0];
        match usize::try_from(material) {
            Ok(material) if own == UNSTATED_COLOUR => {
                four(self.floats(self.get().mat_rgba, 4 * self.get().nmat), material)
            }
            _ => own,
        }
    }

    /// Returns a geom's group. Viewers show or hide geoms by group.
    pub fn geom_group(&self, id: GeomId) -> i32 {
        self.ints(self.get().geom_group, self.get().ngeom)[id.0]
    }

    fn mesh(&self, id: GeomId) -> Option<MeshView<'_>> {
        let raw = self.get();
        let mesh = usize::try_from(self.ints(raw.geom_dataid, raw.ngeom)[id.0]).ok()?;
        let part = |addresses: *const i32, counts: *const i32| {
            let first = *self.ints(addresses, raw.nmesh).get(mesh)? as usize;
            let count = *self.ints(counts, raw.nmesh).get(mesh)? as usize;
            Some(3 * first..3 * (first + count))
        };
        Some(MeshView {
            vertices: self.floats(raw.mesh_vert, 3 * raw.nmeshvert).get(part(raw.mesh_vertadr, raw.mesh_vertnum)?)?,
            faces: self.ints(raw.mesh_face, 3 * raw.nmeshface).get(part(raw.mesh_faceadr, raw.mesh_facenum)?)?,
            hull: self.hull(mesh).unwrap_or_default(),
        })
    }

    /// Reads the faces of a mesh's convex hull from its graph, which MuJoCo documents with `mjModel.mesh_graph`: the numbers
    /// of vertices and faces, then two numbers for each vertex, one for each of its edges, and three for each face.
    fn hull(&self, mesh: usize) -> Option<&[i32]> {
        let raw = self.get();
        let first = usize::try_from(*self.ints(raw.mesh_graphadr, raw.nmesh).get(mesh)?).ok()?;
        let graph = self.ints(raw.mesh_graph, raw.nmeshgraph).get(first..)?;
        let (vertices, faces) = (usize::try_from(*graph.first()?).ok()?, usize::try_from(*graph.get(1)?).ok()?);
        let start = 2 + 2 * vertices + (vertices + 3 * faces);
        graph.get(start..start + 3 * faces)
    }

    /// Returns the part of `mesh_vert` that holds a geom's mesh; empty for a geom without one.
    pub(crate) fn mesh_range(&self, id: GeomId) -> std::ops::Range<usize> {
        let raw = self.get();
        let mesh = match self.geom_shape(id) {
            GeomShape::Mesh(_) => usize::try_from(self.ints(raw.geom_dataid, raw.ngeom)[id.0]).ok(),
            _ => None,
        };
        mesh.map_or(0..0, |mesh| {
            let first = self.ints(raw.mesh_vertadr, raw.nmesh)[mesh] as usize;
            3 * first..3 * (first + self.ints(raw.mesh_vertnum, raw.nmesh)[mesh] as usize)
        })
    }

    fn floats(&self, first: *const f32, count: i32) -> &[f32] {
        // SAFETY: callers pass an array of this model with its own length.
        unsafe { slice_of(first, count) }
    }
}

fn four(values: &[f32], index: usize) -> [f32; 4] {
    std::array::from_fn(|i| values[4 * index + i])
}
