//! The geoms that a picture shows, and their bounding boxes.

use eigenhand_mujoco::{Data, GeomId, Model};
use nalgebra::Vector3;

use crate::shapes::surface;

/// Highest group that is drawn, as in MuJoCo's viewer.
const LAST_GROUP: i32 = 2;

/// Lists the geoms that a picture shows.
///
/// As in MuJoCo's viewer, these are the geoms of groups 0 to 2. A body without such geoms is shown by its other geoms.
/// Geoms that are fully transparent are never shown.
pub fn drawn_geoms(model: &Model) -> Vec<GeomId> {
    let visible = |geom: GeomId| model.geom_colour(geom)[3] > 0.0;
    let mut has_front = vec![false; model.nbody()];
    for geom in model.geoms().filter(|&geom| visible(geom) && model.geom_group(geom) <= LAST_GROUP) {
        has_front[model.geom_body(geom).index()] = true;
    }
    model
        .geoms()
        .filter(|&geom| visible(geom))
        .filter(|&geom| model.geom_group(geom) <= LAST_GROUP || !has_front[model.geom_body(geom).index()])
        .collect()
}

/// Returns the corners of a geom's bounding box; a plane has none.
///
/// The box is aligned with the geom's frame. Its corners are in the world's frame, in m.
pub fn bounding_corners(data: &Data, geom: GeomId) -> Vec<[f64; 3]> {
    let (position, turn) = (data.geom_position(geom), data.geom_orientation(geom));
    let own: Vec<Vector3<f64>> =
        surface(data, geom).iter().flatten().map(|point| turn.transpose() * (point.position - position)).collect();
    let Some(&first) = own.first() else { return Vec::new() };
    let low = own.iter().fold(first, |low, point| low.inf(point));
    let high = own.iter().fold(first, |high, point| high.sup(point));
    (0..8)
        .map(|corner| {
            let place = Vector3::from_fn(|axis, _| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] });
            (position + turn * place).into()
        })
        .collect()
}
