//! The hand's surfaces as triangles, part by part, and how its joints move the parts.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use eigenhand_hands::Hand;
use eigenhand_mujoco::{BodyId, Data, GeomId, Model};
use eigenhand_render::{drawn_geoms, surface};
use nalgebra::Vector3;
use serde::Serialize;

use crate::error::ExploreError;

/// Steps of a coordinate between the smallest and the largest of a surface.
const STEPS: f64 = 65535.0;

/// A body of the hand.
///
/// Its motion is told by the joints' axes where they are in the reference posture (product of exponentials): the motion of a
/// part is that of its parent, then a turn or a shift for each of its joints.
///
/// # Source
/// R. W. Brockett, Robotic manipulators and the product of exponentials formula (1984).
#[derive(Debug, Serialize)]
pub(crate) struct Part {
    /// Index of the part that carries it, always smaller than its own; none for a part that stands still.
    parent: Option<usize>,
    joints: Vec<Screw>,
}

/// A joint in the reference posture, in the world's frame.
#[derive(Debug, Serialize)]
struct Screw {
    /// Index of the joint in the page's list.
    joint: usize,
    slides: bool,
    axis: [f64; 3],
    anchor: [f64; 3],
    /// Position in the reference posture, in rad or m.
    reference: f64,
}

/// The triangles of a geom in the reference posture.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Surface {
    part: usize,
    /// Red, green and blue, 0 to 1.
    colour: [f32; 3],
    low: [f64; 3],
    /// Length of a step along each axis, in m.
    step: [f64; 3],
    /// Corners of the triangles as steps from `low`: unsigned 16-bit numbers, little endian, in base64.
    corners: String,
}

/// A fingertip in the reference posture.
#[derive(Debug, Serialize)]
pub(crate) struct Tip {
    name: String,
    part: usize,
    at: [f64; 3],
}

/// Lists the parts of the hand below `root`. A joint that `joints` does not name stays where it is, and so does `slide`.
pub(crate) fn parts(data: &Data, root: BodyId, joints: &[String], slide: &str) -> (Vec<BodyId>, Vec<Part>) {
    let model = data.model();
    let mut bodies: Vec<BodyId> = Vec::new();
    let mut parts = Vec::new();
    for body in model.bodies() {
        let parent = bodies.iter().position(|known| *known == model.body_parent(body));
        if body != root && parent.is_none() {
            continue;
        }
        let own = model.joints().filter(|&joint| model.joint_body(joint) == body);
        let screw = |joint| {
            let name = model.joint_name(joint);
            let index = joints.iter().position(|known| *known == name).filter(|_| name != slide)?;
            Some(Screw {
                joint: index,
                slides: model.joint_slides(joint),
                axis: data.joint_axis(joint).into(),
                anchor: data.joint_anchor(joint).into(),
                reference: data.qpos()[model.qpos_address(joint)],
            })
        };
        parts.push(Part { parent, joints: own.filter_map(screw).collect() });
        bodies.push(body);
    }
    (bodies, parts)
}

/// Lists the surfaces of the parts that a picture shows.
pub(crate) fn surfaces(data: &Data, bodies: &[BodyId]) -> Vec<Surface> {
    let model: &Model = data.model();
    let mut found = Vec::new();
    for geom in drawn_geoms(model) {
        let Some(part) = bodies.iter().position(|body| *body == model.geom_body(geom)) else { continue };
        found.extend(packed(data, geom, part));
    }
    found
}

/// Returns the surface of a geom of a part; none for a geom without one.
pub(crate) fn packed(data: &Data, geom: GeomId, part: usize) -> Option<Surface> {
    let corners: Vec<Vector3<f64>> = surface(data, geom).iter().flatten().map(|point| point.position).collect();
    let first = *corners.first()?;
    let low = corners.iter().fold(first, |low, p| low.inf(p));
    let high = corners.iter().fold(first, |high, p| high.sup(p));
    let step = (high - low) / STEPS;
    let steps = |p: &Vector3<f64>, axis: usize| {
        if step[axis] > 0.0 { ((p[axis] - low[axis]) / step[axis]).round() as u16 } else { 0 }
    };
    let bytes: Vec<u8> =
        corners.iter().flat_map(|p| [0, 1, 2].map(|axis| steps(p, axis))).flat_map(u16::to_le_bytes).collect();
    let [red, green, blue, _] = data.model().geom_colour(geom);
    Some(Surface {
        part,
        colour: [red, green, blue],
        low: low.into(),
        step: step.into(),
        corners: BASE64_STANDARD.encode(bytes),
    })
}

/// Lists the fingertips with the parts that carry them.
pub(crate) fn tips(hand: &Hand, data: &Data, bodies: &[BodyId]) -> Result<Vec<Tip>, ExploreError> {
    let model = data.model();
    let places = eigenhand_sim::fingertip_positions(hand, data)?;
    let mut found = Vec::new();
    for (tip, at) in hand.fingertips.iter().zip(places) {
        let body = match tip.kind {
            eigenhand_hands::FrameKind::Body => model.body(&tip.name)?,
            eigenhand_hands::FrameKind::Site => model.site_body(model.site(&tip.name)?),
        };
        if let Some(part) = bodies.iter().position(|known| *known == body) {
            found.push(Tip { name: tip.name.clone(), part, at: at.into() });
        }
    }
    Ok(found)
}
