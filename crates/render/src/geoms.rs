//! Which geoms of a model are drawn, and how much room they take.

use eigenhand_mujoco::{Data, GeomId, Model};
use nalgebra::Vector3;

use crate::shapes::surface;

/// Highest group that is drawn, as in MuJoCo's viewer.
const LAST_GROUP: i32 = 2;

/// Lists the geoms that a picture shows: groups 0 to 2 as in MuJoCo's viewer, and all groups of a body that has no other;
/// never what is wholly transparent.
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

/// Returns the corners of the box around a geom in its own frame, in the world, in m; nothing for a plane.
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
