//! Free space beside a mesh that its convex hull fills, so that no object can go there.

use eigenhand_mujoco::{GeomShape, MeshView};
use nalgebra::Vector3;

use super::{Patient, said};

/// Points on a hull that are looked at, in all.
const POINTS: f64 = 300.0;
/// Depth in m of the space between hull and mesh that counts as filled.
const DEEP: f64 = 0.008;
/// Area in m^2 of the hull above filled space that is worth a look: less is a hole for a screw.
const AREA: f64 = 4e-4;

impl Patient<'_> {
    /// Names the bodies of the hand with a mesh whose hull fills much space.
    pub(super) fn filled_meshes(&self) -> Option<String> {
        let model = self.model();
        let mut filled: Vec<String> = Vec::new();
        for geom in model.geoms().filter(|geom| self.scene.is_hand()[geom.index()] && model.geom_collides(*geom)) {
            let GeomShape::Mesh(mesh) = model.geom_shape(geom) else { continue };
            let (area, depth) = filled_space(mesh);
            if area > AREA {
                let body = model.body_name(model.geom_body(geom));
                filled.push(format!("{body} ({:.0} cm^2, up to {:.0} mm deep)", 1e4 * area, 1000.0 * depth));
            }
        }
        said(&filled, |bodies| {
            format!(
                "MuJoCo collides meshes as their convex hulls, which here fill free space where an object could be: {bodies}; \
                 divide these meshes into convex parts, as CoACD and V-HACD do"
            )
        })
    }
}

/// Returns the area of the hull above filled space (m^2), and the depth of the deepest such space (m).
fn filled_space(mesh: MeshView<'_>) -> (f64, f64) {
    let faces: Vec<[Vector3<f64>; 3]> = mesh.triangles().map(|face| face.map(Vector3::from)).collect();
    let hull: Vec<[Vector3<f64>; 3]> = mesh.hull_triangles().map(|face| face.map(Vector3::from)).collect();
    let points = || hull.iter().flatten();
    let middle = points().sum::<Vector3<f64>>() / points().count().max(1) as f64;
    let total: f64 = hull.iter().map(area).sum();
    let (mut filled, mut deepest) = (0.0, 0.0_f64);
    // Area of faces that are too small for a point of their own; the next face that gets one stands for them.
    let mut carried = 0.0;
    for face in &hull {
        let [a, b, c] = *face;
        carried += area(face);
        if POINTS * carried < total {
            continue;
        }
        let stands_for = std::mem::take(&mut carried);
        // The middles of n x n equal triangles: n (n + 1) / 2 that lie as the face does, the others turned by half a turn.
        let n = (POINTS * area(face) / total).sqrt().round().max(1.0) as usize;
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(0.0) else { continue };
        let inward = if normal.dot(&(middle - a)) < 0.0 { -normal } else { normal };
        let middles = |rows: usize, offset: f64| {
            let at = move |i: usize| (i as f64 + offset) / n as f64;
            (0..rows).flat_map(move |i| (0..rows - i).map(move |j| a + (b - a) * at(i) + (c - a) * at(j)))
        };
        let middles = middles(n, 1.0 / 3.0).chain(middles(n.saturating_sub(1), 2.0 / 3.0));
        let depths: Vec<Option<f64>> = middles.map(|point| depth_below(&point, &inward, &faces)).collect();
        let deep: Vec<f64> = depths.iter().flatten().copied().filter(|depth| *depth > DEEP).collect();
        if !depths.is_empty() {
            filled += stands_for * deep.len() as f64 / depths.len() as f64;
        }
        deepest = deep.iter().copied().fold(deepest, f64::max);
    }
    (filled, deepest)
}

fn area([a, b, c]: &[Vector3<f64>; 3]) -> f64 {
    (b - a).cross(&(c - a)).norm() / 2.0
}

/// Returns how far below a point of the hull the mesh begins; none if a ray inwards meets none of its faces.
///
/// # Source
/// T. Moller and B. Trumbore, Fast, minimum storage ray-triangle intersection, J. Graphics Tools 2 (1997).
fn depth_below(point: &Vector3<f64>, inward: &Vector3<f64>, faces: &[[Vector3<f64>; 3]]) -> Option<f64> {
    /// The ray begins this far outside the hull (m), so that it meets faces that lie in it.
    const OUTSIDE: f64 = 1e-4;
    let from = point - inward * OUTSIDE;
    let distances = faces.iter().filter_map(|[a, b, c]| {
        let (to_b, to_c) = (b - a, c - a);
        let across = inward.cross(&to_c);
        let determinant = to_b.dot(&across);
        if determinant == 0.0 {
            return None;
        }
        let from_a = from - a;
        let u = from_a.dot(&across) / determinant;
        let turned = from_a.cross(&to_b);
        let v = inward.dot(&turned) / determinant;
        let distance = to_c.dot(&turned) / determinant;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance >= 0.0).then_some(distance - OUTSIDE)
    });
    distances.reduce(f64::min)
}

#[cfg(test)]
mod tests {
    use eigenhand_mujoco::{Model, MuJoCo};

    use super::*;

    /// Returns the model of a mesh that `boxes`, each with centre and half edges in cm, make together.
    fn mesh_of(boxes: &[[f64; 6]]) -> Model {
        let (mut vertices, mut faces) = (String::new(), String::new());
        for (i, [x, y, z, a, b, c]) in boxes.iter().enumerate() {
            for corner in 0..8 {
                let side = |bit: usize| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
                vertices += &format!(" {} {} {}", x + a * side(0), y + b * side(1), z + c * side(2));
            }
            // Counter-clockwise, seen from outside.
            for [a, b, c, d] in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
                for corner in [a, b, c, a, c, d] {
                    faces += &format!(" {}", 8 * i + corner);
                }
            }
        }
        let model = format!(
            "<mujoco><asset><mesh name=\"m\" vertex=\"{vertices}\" face=\"{faces}\" scale=\"0.01 0.01 0.01\"/></asset>\
             <worldbody><geom type=\"mesh\" mesh=\"m\"/></worldbody></mujoco>"
        );
        Model::from_xml(&MuJoCo::load().expect("MuJoCo is installed"), &model, &[]).expect("the model compiles")
    }

    fn filled(boxes: &[[f64; 6]]) -> (f64, f64) {
        let model = mesh_of(boxes);
        let geom = model.geoms().next().expect("a geom");
        let GeomShape::Mesh(mesh) = model.geom_shape(geom) else { panic!("expected a mesh") };
        filled_space(mesh)
    }

    #[test]
    fn the_hull_of_a_trough_fills_it_and_that_of_a_block_fills_nothing() {
        assert_eq!(filled(&[[0.0, 0.0, 0.0, 2.0, 3.0, 1.0]]), (0.0, 0.0));
        // A floor 6 x 8 x 1 cm with two walls of 1 x 8 x 3 cm: the hull covers 4 x 8 cm above the floor. A ray into an open end
        // meets nothing, so the ends do not count.
        let trough = [[0.0, 0.0, 0.0, 3.0, 4.0, 0.5], [-2.5, 0.0, 2.0, 0.5, 4.0, 1.5], [2.5, 0.0, 2.0, 0.5, 4.0, 1.5]];
        let (area, depth) = filled(&trough);
        assert!((area - 0.0032).abs() < 4e-4, "{area} m^2");
        assert!((depth - 0.03).abs() < 1e-6, "{depth} m");
        // Many pins that stand in a square, on a plate: their tops are the corners of many small faces of the hull.
        let pins = (0..20).flat_map(|i| [[i, 0], [i, 19], [0, i], [19, i]]).map(|[i, j]| {
            let at = |i: i32| f64::from(i) * 0.4 - 3.8;
            [at(i), at(j), 2.0, 0.05, 0.05, 2.0 + 0.001 * f64::from(i * (19 - i) + j * (19 - j)).sqrt()]
        });
        let fence: Vec<[f64; 6]> = pins.chain([[0.0, 0.0, -0.25, 4.0, 4.0, 0.25]]).collect();
        let (area, depth) = filled(&fence);
        assert!(area > 0.004 && depth > 0.035, "{area} m^2, {depth} m");
    }
}
