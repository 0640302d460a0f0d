//! The box that stands for an object's shape in the observation.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use eigenhand_mujoco::{BodyId, Model};

/// The box that has a body's mass and inertia.
pub(crate) struct InertiaBox {
    /// Half sizes in m along the principal axes.
    pub half_sizes: Vector3<f64>,
    /// Orientation of the principal axes in the body.
    pub axes: UnitQuaternion<f64>,
}

impl InertiaBox {
    /// Returns the box of a body. A box with half sizes h has the moment `m (h2^2 + h3^2) / 3` about its first axis.
    pub fn of(model: &Model, body: BodyId) -> InertiaBox {
        let [a, b, c] = model.principal_inertia(body);
        let per_mass = 1.5 / model.body_mass(body);
        let half = |others: f64, own: f64| (per_mass * (others - own)).max(0.0).sqrt();
        let [w, x, y, z] = model.principal_axes(body);
        InertiaBox {
            half_sizes: Vector3::new(half(b + c, a), half(a + c, b), half(a + b, c)),
            axes: UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)),
        }
    }
}
