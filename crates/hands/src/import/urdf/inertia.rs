//! Masses and inertias of the links; impossible ones are mended.

use nalgebra::{Isometry3, Matrix3, SymmetricEigen, Translation3, UnitQuaternion, Vector3};

use super::finite::HUGE;
use super::geometry::Geom;
use super::source::Source;
use crate::notes::note;

/// Mass that counts as zero (kg).
const NO_MASS: f64 = 1e-9;
/// Smallest principal moment that is kept (kg m2): MuJoCo refuses less than 1e-15.
const MIN_MOMENT: f64 = 1e-13;
/// A zero moment becomes this part of the largest one, as for a rod.
const ROD: f64 = 1e-3;
/// Margin of the triangle inequality against rounding, as a part of the largest moment.
const MARGIN: f64 = 1e-6;
/// Violation of the triangle inequality that counts as rounding in the file, as a part of the largest moment.
const ROUNDING: f64 = 1e-3;

/// Density assumed for a link without mass in the file (kg/m3), and the filled part of its bounding box.
const DENSITY: f64 = 1000.0;
const FILLED: f64 = 0.5;
/// Bounds of such a mass (kg), least side of that box (m), and the mass and radius of a link without geometry.
const MASSES: (f64, f64) = (0.005, 0.5);
const MIN_SIDE: f64 = 0.002;
const DEFAULT_MASS: f64 = 0.01;
const DEFAULT_RADIUS: f64 = 0.01;

/// Mass, and principal moments in the frame of `pose` within the link.
#[derive(Debug, Clone)]
pub(super) struct Inertial {
    pub(super) mass: f64,
    pub(super) pose: Isometry3<f64>,
    pub(super) moments: Vector3<f64>,
}

/// Reads the inertials of all links, in the order of the file.
///
/// A link without a usable inertial stays without. If a whole rigid group has none, the link that carries the group
/// gets one, because MuJoCo requires moving bodies to have mass.
pub(super) fn read(
    source: &Source,
    geoms: &[Vec<Geom>],
    groups: &[usize],
    notes: &mut Vec<String>,
) -> Vec<Option<Inertial>> {
    let links = &source.robot.links;
    let (mut raised, mut unusable, mut made) = (Vec::new(), Vec::new(), Vec::new());
    let mut inertials: Vec<Option<Inertial>> = Vec::with_capacity(links.len());
    for (link, stated) in links.iter().zip(&source.has_inertial) {
        let read = if *stated { physical(&link.inertial) } else { None };
        // A mass of zero marks a link as a mere frame.
        if *stated && read.is_none() && link.inertial.mass.value != 0.0 {
            unusable.push(link.name.as_str());
        }
        if matches!(read, Some((_, true))) {
            raised.push(link.name.as_str());
        }
        inertials.push(read.map(|(inertial, _)| inertial));
    }
    let mut has_mass = vec![false; links.len()];
    for (i, inertial) in inertials.iter().enumerate() {
        has_mass[groups[i]] |= inertial.is_some();
    }
    for i in (0..links.len()).filter(|&i| groups[i] == i && !has_mass[i]) {
        let inertial = from_geometry(&geoms[i]);
        made.push(format!("{} ({:.3} kg)", links[i].name, inertial.mass));
        inertials[i] = Some(inertial);
    }
    note(notes, "impossible inertias were raised to the nearest possible ones, at the links", &raised);
    note(notes, "inertias without a positive mass or a finite tensor were removed, at the links", &unusable);
    note(notes, "moving links without inertia got one computed from their size", &made);
    inertials
}

/// Returns a possible inertial, and true if it differs from the file by more than rounding.
fn physical(inertial: &urdf_rs::Inertial) -> Option<(Inertial, bool)> {
    let mass = inertial.mass.value;
    let t = &inertial.inertia;
    let tensor = Matrix3::new(t.ixx, t.ixy, t.ixz, t.ixy, t.iyy, t.iyz, t.ixz, t.iyz, t.izz);
    let [x, y, z] = inertial.origin.xyz.0;
    let [roll, pitch, yaw] = inertial.origin.rpy.0;
    let others = [mass, x, y, z, roll, pitch, yaw];
    if !tensor.iter().chain(&others).all(|v| v.abs() < HUGE) || mass <= NO_MASS {
        return None;
    }
    // The principal axes are computed here: MuJoCo finds those of small tensors with an absolute tolerance.
    let scale = tensor.abs().max();
    let (moments, axes) = if scale < MIN_MOMENT {
        (Vector3::zeros(), UnitQuaternion::identity())
    } else {
        principal(&(tensor / scale)).map(|(moments, axes)| (moments * scale, axes))?
    };
    let (moments, changed) = possible(&moments, mass);
    let origin = Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw));
    Some((Inertial { mass, pose: origin * axes, moments }, changed))
}

/// (tensor) => (principal moments, axes)
fn principal(tensor: &Matrix3<f64>) -> Option<(Vector3<f64>, UnitQuaternion<f64>)> {
    const ITERATIONS: usize = 1000;
    if (tensor - Matrix3::from_diagonal(&tensor.diagonal())).iter().all(|x| *x == 0.0) {
        return Some((tensor.diagonal(), UnitQuaternion::identity()));
    }
    let eigen = SymmetricEigen::try_new(*tensor, f64::EPSILON, ITERATIONS)?;
    let mut axes = eigen.eigenvectors;
    if axes.determinant() < 0.0 {
        axes.column_mut(2).neg_mut();
    }
    Some((eigen.eigenvalues, UnitQuaternion::from_matrix(&axes)))
}

/// (moments, mass) => (possible moments, whether they differ by more than rounding)
fn possible(moments: &Vector3<f64>, mass: f64) -> (Vector3<f64>, bool) {
    let largest = moments.max();
    if largest < MIN_MOMENT {
        return (ball(mass, DEFAULT_RADIUS), true);
    }
    let floor = (ROD * largest).max(MIN_MOMENT);
    let mut raised = moments.map(|m| if m < MIN_MOMENT { floor } else { m });
    let mut changed = raised != *moments;
    let at = raised.imax();
    let lacking = largest * (1.0 + MARGIN) - (raised.sum() - largest);
    if lacking > 0.0 {
        changed |= lacking > ROUNDING * largest;
        for i in (0..3).filter(|&i| i != at) {
            raised[i] += lacking / 2.0;
        }
    }
    (raised, changed)
}

fn ball(mass: f64, radius: f64) -> Vector3<f64> {
    Vector3::repeat(0.4 * mass * radius * radius)
}

fn from_geometry(geoms: &[Geom]) -> Inertial {
    let corners = geoms.iter().flat_map(|geom| {
        let (low, high) = geom.bounds;
        (0..8).map(move |i| {
            let corner = Vector3::from_fn(|axis, _| if i >> axis & 1 == 0 { low[axis] } else { high[axis] });
            geom.pose.transform_point(&corner.into()).coords
        })
    });
    let bounds = corners.fold(None, |bounds: Option<(Vector3<f64>, Vector3<f64>)>, p| {
        Some(bounds.map_or((p, p), |(low, high)| (low.inf(&p), high.sup(&p))))
    });
    let Some((low, high)) = bounds else {
        let moments = ball(DEFAULT_MASS, DEFAULT_RADIUS);
        return Inertial { mass: DEFAULT_MASS, pose: Isometry3::identity(), moments };
    };
    let size = (high - low).map(|side| side.max(MIN_SIDE));
    let mass = (DENSITY * FILLED * size.product()).clamp(MASSES.0, MASSES.1);
    let squares = size.component_mul(&size);
    let moments = squares.map(|own| mass / 12.0 * (squares.sum() - own));
    let moments = possible(&moments, mass).0;
    Inertial { mass, pose: Translation3::from((low + high) / 2.0).into(), moments }
}
