//! The seven objects of the grasp task (paper, section 3.1).

use eigenhand_hands::xml::numbers;
use nalgebra::{UnitQuaternion, Vector3};

use crate::SimError;

/// A convex primitive, with its size in m.
#[derive(Clone, Copy, Debug, PartialEq)]
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
}

impl Shape {
    /// Returns the shape with its lengths multiplied by `factor`.
    pub fn scaled(self, factor: f64) -> Shape {
        let by = |half: [f64; 3]| half.map(|h| h * factor);
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
        }
    }

    /// Returns MuJoCo's name of the geom type and its `size` attribute.
    pub(crate) fn geom(self) -> (&'static str, String) {
        match self {
            Shape::Sphere { radius } => ("sphere", numbers(&[radius])),
            Shape::Box { half } => ("box", numbers(&half)),
            Shape::Cylinder { radius, half_height } => ("cylinder", numbers(&[radius, half_height])),
            Shape::Capsule { radius, half_length } => ("capsule", numbers(&[radius, half_length])),
            Shape::Ellipsoid { half } => ("ellipsoid", numbers(&half)),
        }
    }

    /// Returns how far the shape reaches below its centre in the given orientation.
    ///
    /// # Units
    /// m.
    pub fn depth_below_centre(self, orientation: &UnitQuaternion<f64>) -> f64 {
        let down = orientation.inverse_transform_vector(&-Vector3::z());
        let across = down.x.hypot(down.y);
        match self {
            Shape::Sphere { radius } => radius,
            Shape::Box { half } => (0..3).map(|i| half[i] * down[i].abs()).sum(),
            Shape::Cylinder { radius, half_height } => radius * across + half_height * down.z.abs(),
            Shape::Capsule { radius, half_length } => radius + half_length * down.z.abs(),
            Shape::Ellipsoid { half } => (0..3).map(|i| (half[i] * down[i]).powi(2)).sum::<f64>().sqrt(),
        }
    }
}

/// An object to grasp.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Name, as `--objects` takes it.
    pub name: &'static str,
    /// Position in the catalogue: the object id of the observation.
    pub id: usize,
    /// Shape and size.
    pub shape: Shape,
    /// Mass in kg.
    pub mass: f64,
}

const MASS: f64 = 0.1;

const CATALOGUE: [(&str, Shape); 7] = [
    ("sphere", Shape::Sphere { radius: 0.035 }),
    ("cube", Shape::Box { half: [0.03, 0.03, 0.03] }),
    ("cylinder", Shape::Cylinder { radius: 0.03, half_height: 0.04 }),
    ("capsule", Shape::Capsule { radius: 0.028, half_length: 0.025 }),
    ("box", Shape::Box { half: [0.025, 0.03, 0.045] }),
    ("ellipsoid", Shape::Ellipsoid { half: [0.03, 0.035, 0.045] }),
    ("disc", Shape::Cylinder { radius: 0.04, half_height: 0.02 }),
];

impl Object {
    /// Lists the names of all objects, in the order of their ids.
    pub fn names() -> impl Iterator<Item = &'static str> {
        CATALOGUE.iter().map(|(name, _)| *name)
    }

    /// Finds an object by name, with its lengths multiplied by `scale`.
    ///
    /// # Errors
    /// [`SimError::UnknownObject`] lists the names that exist.
    pub fn named(name: &str, scale: f64) -> Result<Object, SimError> {
        CATALOGUE
            .iter()
            .enumerate()
            .find(|(_, (known, _))| *known == name)
            .map(|(id, &(name, shape))| Object { name, id, shape: shape.scaled(scale), mass: MASS })
            .ok_or_else(|| SimError::UnknownObject {
                name: name.to_owned(),
                known: Object::names().collect::<Vec<_>>().join(", "),
            })
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

    #[test]
    fn an_unknown_object_is_answered_with_the_names() {
        let message = Object::named("cub", 1.0).expect_err("no such object").to_string();
        assert!(message.contains("\"cub\"") && message.contains("cube, cylinder"), "{message}");
    }
}
