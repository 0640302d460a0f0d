//! Convex shapes.

use std::sync::Arc;

use eigenhand_hands::xml::numbers;
use nalgebra::{UnitQuaternion, Vector3};

use super::mesh::ConvexMesh;

/// A convex shape about its centre of mass, with its size in m.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// A box.
    Box {
        /// Half edges along x, y, z.
        half: [f64; 3],
    },
    /// A cylinder along z.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Half of its height.
        half_height: f64,
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
        /// Half axes along x, y, z.
        half: [f64; 3],
    },
    /// A convex mesh.
    Mesh(Arc<ConvexMesh>),
}

impl Shape {
    /// Returns the shape with its lengths multiplied by `factor`.
    pub fn scaled(&self, factor: f64) -> Shape {
        let by = |half: &[f64; 3]| half.map(|h| h * factor);
        match self {
            Shape::Sphere { radius } => Shape::Sphere { radius: radius * factor },
            Shape::Box { half } => Shape::Box { half: by(half) },
            Shape::Cylinder { radius, half_height } => {
                Shape::Cylinder { radius: radius * factor, half_height: half_height * factor }
            }
            Shape::Capsule { radius, half_length } => {
                Shape::Capsule { radius: radius * factor, half_length: half_length * factor }
            }
            Shape::Ellipsoid { half } => Shape::Ellipsoid { half: by(half) },
            Shape::Mesh(mesh) => Shape::Mesh(Arc::new(mesh.scaled(factor))),
        }
    }

    /// Returns MuJoCo's name of the geom type and its `size` attribute; a mesh has none.
    pub(crate) fn geom(&self) -> (&'static str, Option<String>) {
        match self {
            Shape::Sphere { radius } => ("sphere", Some(numbers(&[*radius]))),
            Shape::Box { half } => ("box", Some(numbers(half))),
            Shape::Cylinder { radius, half_height } => ("cylinder", Some(numbers(&[*radius, *half_height]))),
            Shape::Capsule { radius, half_length } => ("capsule", Some(numbers(&[*radius, *half_length]))),
            Shape::Ellipsoid { half } => ("ellipsoid", Some(numbers(half))),
            Shape::Mesh(_) => ("mesh", None),
        }
    }

    /// Returns how far the shape reaches below its centre in the given orientation.
    ///
    /// # Units
    /// m.
    pub fn depth_below_centre(&self, orientation: &UnitQuaternion<f64>) -> f64 {
        let down = orientation.inverse_transform_vector(&-Vector3::z());
        let across = down.x.hypot(down.y);
        match self {
            Shape::Sphere { radius } => *radius,
            Shape::Box { half } => (0..3).map(|i| half[i] * down[i].abs()).sum(),
            Shape::Cylinder { radius, half_height } => radius * across + half_height * down.z.abs(),
            Shape::Capsule { radius, half_length } => radius + half_length * down.z.abs(),
            Shape::Ellipsoid { half } => (0..3).map(|i| (half[i] * down[i]).powi(2)).sum::<f64>().sqrt(),
            Shape::Mesh(mesh) => mesh.extent(&down),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_follows_the_orientation() {
        let lying = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
        let cylinder = Shape::Cylinder { radius: 0.03, half_height: 0.04 };
        assert!((cylinder.depth_below_centre(&UnitQuaternion::identity()) - 0.04).abs() < 1e-12);
        assert!((cylinder.depth_below_centre(&lying) - 0.03).abs() < 1e-12);
        let ellipsoid = Shape::Ellipsoid { half: [0.03, 0.035, 0.045] };
        assert!((ellipsoid.depth_below_centre(&lying) - 0.035).abs() < 1e-12);
        let corner = UnitQuaternion::from_euler_angles(std::f64::consts::FRAC_PI_4, 0.0, 0.0);
        let cube = Shape::Box { half: [0.03; 3] };
        assert!((cube.depth_below_centre(&corner) - 0.03 * 2f64.sqrt()).abs() < 1e-12);
    }
}
