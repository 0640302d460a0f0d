//! How a model is put together: its tree of bodies, and the extent of its geoms.

use nalgebra::{Matrix3, Vector3};

use super::bindings as mj;
use super::model::slice_of;
use super::{BodyId, Data, GeomId, JointId, Model};

impl Model {
    /// Lists the bodies, parents before their children; the first is the world.
    pub fn bodies(&self) -> impl Iterator<Item = BodyId> {
        (0..self.nbody()).map(BodyId)
    }

    /// Lists the geoms.
    pub fn geoms(&self) -> impl Iterator<Item = GeomId> {
        (0..self.ngeom()).map(GeomId)
    }

    /// Lists the joints.
    pub fn joints(&self) -> impl Iterator<Item = JointId> {
        (0..self.get().njnt as usize).map(JointId)
    }

    /// Returns a joint's name, empty when it has none.
    pub fn joint_name(&self, id: JointId) -> String {
        self.name(mj::mjOBJ_JOINT, id.0)
    }

    /// Returns the body that a joint moves.
    pub fn joint_body(&self, id: JointId) -> BodyId {
        BodyId(self.ints(self.get().jnt_bodyid, self.get().njnt)[id.0] as usize)
    }

    /// Tells whether a joint moves along an axis, instead of turning.
    pub fn joint_slides(&self, id: JointId) -> bool {
        self.ints(self.get().jnt_type, self.get().njnt)[id.0] == mj::mjJNT_SLIDE as i32
    }

    /// Returns the parent of a body; the world is its own.
    pub fn body_parent(&self, id: BodyId) -> BodyId {
        BodyId(self.ints(self.get().body_parentid, self.get().nbody)[id.0] as usize)
    }

    /// Tells whether a geom takes part in collisions.
    pub fn geom_collides(&self, id: GeomId) -> bool {
        let bits = |all| self.ints(all, self.get().ngeom)[id.0];
        bits(self.get().geom_contype) != 0 || bits(self.get().geom_conaffinity) != 0
    }

    /// Lists the pairs of bodies that an active equality ties together at a point or in a pose.
    pub fn tied_bodies(&self) -> Vec<(BodyId, BodyId)> {
        let raw = self.get();
        let (kinds, first, second) =
            (self.ints(raw.eq_type, raw.neq), self.ints(raw.eq_obj1id, raw.neq), self.ints(raw.eq_obj2id, raw.neq));
        (0..kinds.len())
            .filter(|&i| kinds[i] == mj::mjEQ_CONNECT as i32 || kinds[i] == mj::mjEQ_WELD as i32)
            .map(|i| (BodyId(first[i].max(0) as usize), BodyId(second[i].max(0) as usize)))
            .collect()
    }

    /// Returns the point of a geom that lies farthest in a direction, both in the geom's frame.
    ///
    /// # Units
    /// m. A plane or height field has no farthest point; its own origin is returned.
    fn support(&self, id: GeomId, direction: &Vector3<f64>) -> Vector3<f64> {
        let raw = self.get();
        let size = &self.numbers(raw.geom_size, 3 * raw.ngeom)[3 * id.0..3 * id.0 + 3];
        let unit = direction.try_normalize(1e-12).unwrap_or_else(Vector3::z);
        let sign = |v: f64| if v < 0.0 { -1.0 } else { 1.0 };
        match self.ints(raw.geom_type, raw.ngeom)[id.0] as u32 {
            mj::mjGEOM_SPHERE => unit * size[0],
            mj::mjGEOM_CAPSULE => unit * size[0] + Vector3::z() * (sign(unit.z) * size[1]),
            mj::mjGEOM_CYLINDER => {
                let across = Vector3::new(unit.x, unit.y, 0.0).try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
                across * size[0] + Vector3::z() * (sign(unit.z) * size[1])
            }
            mj::mjGEOM_ELLIPSOID => {
                let half = Vector3::new(size[0], size[1], size[2]);
                let scaled = half.component_mul(&unit);
                half.component_mul(&scaled) / scaled.norm().max(1e-12)
            }
            mj::mjGEOM_BOX => Vector3::new(sign(unit.x) * size[0], sign(unit.y) * size[1], sign(unit.z) * size[2]),
            mj::mjGEOM_MESH => self.farthest_vertex(id, &unit),
            _ => Vector3::zeros(),
        }
    }

    fn farthest_vertex(&self, id: GeomId, unit: &Vector3<f64>) -> Vector3<f64> {
        let raw = self.get();
        let Ok(mesh) = usize::try_from(self.ints(raw.geom_dataid, raw.ngeom)[id.0]) else {
            return Vector3::zeros();
        };
        let first = self.ints(raw.mesh_vertadr, raw.nmesh)[mesh] as usize;
        let count = self.ints(raw.mesh_vertnum, raw.nmesh)[mesh] as usize;
        // SAFETY: mesh_vert holds three numbers for each of nmeshvert vertices.
        let all: &[f32] = unsafe { slice_of(raw.mesh_vert, 3 * raw.nmeshvert) };
        all[3 * first..3 * (first + count)]
            .chunks_exact(3)
            .map(|v| Vector3::new(f64::from(v[0]), f64::from(v[1]), f64::from(v[2])))
            .max_by(|a, b| a.dot(unit).total_cmp(&b.dot(unit)))
            .unwrap_or_else(Vector3::zeros)
    }
}

impl Data {
    /// Returns the point of a geom that lies farthest in a direction, both in the world.
    ///
    /// # Units
    /// m.
    pub fn farthest_point(&self, id: GeomId, direction: &Vector3<f64>) -> Vector3<f64> {
        let (raw, n) = (self.get(), self.model().ngeom() as i32);
        // SAFETY: geom_xpos holds three and geom_xmat nine numbers a geom.
        let (places, turns) = unsafe { (slice_of(raw.geom_xpos, 3 * n), slice_of(raw.geom_xmat, 9 * n)) };
        let place = Vector3::from_column_slice(&places[3 * id.0..3 * id.0 + 3]);
        let turn = Matrix3::from_row_slice(&turns[9 * id.0..9 * id.0 + 9]);
        place + turn * self.model().support(id, &(turn.transpose() * direction))
    }

    /// Returns the centre of a geom in the world, in m.
    pub fn geom_position(&self, id: GeomId) -> Vector3<f64> {
        // SAFETY: geom_xpos holds three numbers a geom.
        let all = unsafe { slice_of(self.get().geom_xpos, 3 * self.model().ngeom() as i32) };
        Vector3::from_column_slice(&all[3 * id.0..3 * id.0 + 3])
    }

    /// Returns the point in the world about which a joint turns, in m.
    pub fn joint_anchor(&self, id: JointId) -> Vector3<f64> {
        // SAFETY: xanchor holds three numbers a joint.
        let all = unsafe { slice_of(self.get().xanchor, 3 * self.model().joints().count() as i32) };
        Vector3::from_column_slice(&all[3 * id.0..3 * id.0 + 3])
    }
}
