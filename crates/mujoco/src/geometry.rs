//! The structure of a model: its tree of bodies, its couplings, and the extent of its geoms.

use nalgebra::Vector3;

use crate::bindings as mj;
use crate::model::slice_of;
use crate::{BodyId, Data, GeomId, GeomShape, JointId, Model};

impl Model {
    /// Lists the bodies, parents before their children; the first is the world.
    pub fn bodies(&self) -> impl Iterator<Item = BodyId> {
        (0..self.nbody()).map(BodyId)
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

    /// Tells whether a joint slides along its axis, instead of turning about it.
    pub fn joint_slides(&self, id: JointId) -> bool {
        self.ints(self.get().jnt_type, self.get().njnt)[id.0] == mj::mjJNT_SLIDE as i32
    }

    /// Returns the parent of a body; the world is its own parent.
    pub fn body_parent(&self, id: BodyId) -> BodyId {
        BodyId(self.ints(self.get().body_parentid, self.get().nbody)[id.0] as usize)
    }

    /// Tells whether a geom takes part in collisions.
    pub fn geom_collides(&self, id: GeomId) -> bool {
        self.geom_contact_bits(id) != (0, 0)
    }

    /// Returns a geom's `contype` and `conaffinity`.
    pub fn geom_contact_bits(&self, id: GeomId) -> (i32, i32) {
        let bits = |all| self.ints(all, self.get().ngeom)[id.0];
        (bits(self.get().geom_contype), bits(self.get().geom_conaffinity))
    }

    /// Lists the joints that follow another joint because of an equality constraint.
    ///
    /// If the equality couples tendons, their joints without an actuator follow.
    pub fn following_joints(&self) -> Vec<JointId> {
        let raw = self.get();
        let (kinds, first, second) =
            (self.ints(raw.eq_type, raw.neq), self.ints(raw.eq_obj1id, raw.neq), self.ints(raw.eq_obj2id, raw.neq));
        let (transmissions, targets) =
            (self.ints(raw.actuator_trntype, raw.nu), self.ints(raw.actuator_trnid, 2 * raw.nu));
        let driven: Vec<i32> = (0..transmissions.len())
            .filter(|&i| transmissions[i] == mj::mjTRN_JOINT as i32)
            .map(|i| targets[2 * i])
            .collect();
        let mut found = Vec::new();
        for i in 0..kinds.len() {
            if kinds[i] == mj::mjEQ_JOINT as i32 && second[i] >= 0 {
                found.push(first[i]);
            } else if kinds[i] == mj::mjEQ_TENDON as i32 {
                let tendons = [first[i], second[i]].into_iter().filter(|&tendon| tendon >= 0);
                let joints = tendons.flat_map(|tendon| self.tendon_joints(tendon));
                found.extend(joints.filter(|joint| !driven.contains(joint)));
            }
        }
        found.into_iter().map(|joint| JointId(joint.max(0) as usize)).collect()
    }

    /// Lists the joints of a fixed tendon; the tendon is their weighted sum.
    fn tendon_joints(&self, tendon: i32) -> Vec<i32> {
        let raw = self.get();
        let tendon = tendon.max(0) as usize;
        let (start, count) =
            (self.ints(raw.tendon_adr, raw.ntendon)[tendon], self.ints(raw.tendon_num, raw.ntendon)[tendon]);
        let (kinds, joints) = (self.ints(raw.wrap_type, raw.nwrap), self.ints(raw.wrap_objid, raw.nwrap));
        (start.max(0) as usize..(start + count).max(0) as usize)
            .filter(|&i| kinds[i] == mj::mjWRAP_JOINT as i32)
            .map(|i| joints[i])
            .collect()
    }

    /// Lists the pairs of bodies that a `connect` or `weld` equality ties together.
    pub fn tied_bodies(&self) -> Vec<(BodyId, BodyId)> {
        let raw = self.get();
        let (kinds, first, second) =
            (self.ints(raw.eq_type, raw.neq), self.ints(raw.eq_obj1id, raw.neq), self.ints(raw.eq_obj2id, raw.neq));
        (0..kinds.len())
            .filter(|&i| kinds[i] == mj::mjEQ_CONNECT as i32 || kinds[i] == mj::mjEQ_WELD as i32)
            .map(|i| (BodyId(first[i].max(0) as usize), BodyId(second[i].max(0) as usize)))
            .collect()
    }
}

impl GeomShape<'_> {
    /// Returns the geom's farthest point (in m) in a direction; both are in the geom's frame.
    ///
    /// A plane or a height field has no farthest point, so the origin of its frame is returned.
    fn farthest_point(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        let unit = direction.try_normalize(1e-12).unwrap_or_else(Vector3::z);
        let along_z = |half: f64| Vector3::z() * half.copysign(unit.z);
        match *self {
            GeomShape::Sphere { radius } => unit * radius,
            GeomShape::Capsule { radius, half_length } => unit * radius + along_z(half_length),
            GeomShape::Cylinder { radius, half_height } => {
                let across = Vector3::new(unit.x, unit.y, 0.0).try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
                across * radius + along_z(half_height)
            }
            GeomShape::Ellipsoid { half } => {
                let half = Vector3::from(half);
                let scaled = half.component_mul(&unit);
                half.component_mul(&scaled) / scaled.norm().max(1e-12)
            }
            GeomShape::Box { half } => Vector3::from(half).zip_map(&unit, f64::copysign),
            GeomShape::Mesh(mesh) => {
                mesh.vertices().max_by(|a, b| a.dot(&unit).total_cmp(&b.dot(&unit))).unwrap_or_else(Vector3::zeros)
            }
            GeomShape::Plane { .. } | GeomShape::Other => Vector3::zeros(),
        }
    }
}

impl Data {
    /// Returns a geom's farthest point in a direction; both are in the world's frame.
    ///
    /// # Units
    /// m.
    pub fn farthest_point(&self, id: GeomId, direction: &Vector3<f64>) -> Vector3<f64> {
        let turn = self.geom_orientation(id);
        let own = self.model().geom_shape(id).farthest_point(&(turn.transpose() * direction));
        self.geom_position(id) + turn * own
    }

    /// Returns the point in the world about which a joint turns, in m.
    pub fn joint_anchor(&self, id: JointId) -> Vector3<f64> {
        // SAFETY: xanchor holds three numbers for each joint.
        let all = unsafe { slice_of(self.get().xanchor, 3 * self.model().joints().count() as i32) };
        Vector3::from_column_slice(&all[3 * id.0..3 * id.0 + 3])
    }

    /// Returns the axis of a joint in the world, of length 1.
    pub fn joint_axis(&self, id: JointId) -> Vector3<f64> {
        // SAFETY: xaxis holds three numbers for each joint.
        let all = unsafe { slice_of(self.get().xaxis, 3 * self.model().joints().count() as i32) };
        Vector3::from_column_slice(&all[3 * id.0..3 * id.0 + 3])
    }
}
