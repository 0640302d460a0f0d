//! A jaw that does not move, against which the only finger closes.

use eigenhand_mujoco::GeomId;
use nalgebra::Vector3;

use super::{Lab, Pose};
use crate::error::{OnboardError, refuse};
use crate::survey::fingers::{Chain, jointed, rigid_root};

impl Lab<'_> {
    /// Finds the part of the palm against which the only finger closes, and takes it as a second finger that does not
    /// move.
    pub(in crate::survey) fn add_fixed_jaw(&mut self, poses: &mut [Pose]) -> Result<(), OnboardError> {
        const NEAR: f64 = 0.4;
        const LONG: f64 = 0.5;
        const DIRECTIONS: usize = 300;
        if self.chains.len() != 1 {
            return Ok(());
        }
        let moving = &self.chains[0];
        let base = self.base(moving);
        let reach = poses.iter().map(|pose| (pose.tips[0] - base).norm()).fold(0.0, f64::max);
        let moves = jointed(self.model);
        let group = rigid_root(self.model, &moves, self.palm);
        let palm_from_world = self.palm_pose().inverse();
        let gap =
            |point: &Vector3<f64>| poses.iter().map(|pose| (pose.tips[0] - point).norm()).fold(f64::INFINITY, f64::min);
        let geoms = self.model.geoms().filter(|&g| {
            self.model.geom_collides(g) && rigid_root(self.model, &moves, self.model.geom_body(g)) == group
        });
        let mut points: Vec<(GeomId, Vector3<f64>, f64)> = Vec::new();
        for geom in geoms {
            for direction in sphere(DIRECTIONS) {
                let point = palm_from_world.transform_point(&self.data.farthest_point(geom, &direction).into()).coords;
                let distance = gap(&point);
                if (point - base).norm() >= LONG * reach && distance <= NEAR * reach {
                    points.push((geom, point, distance));
                }
            }
        }
        let Some(&(geom, nearest, _)) = points.iter().min_by(|a, b| a.2.total_cmp(&b.2)) else {
            return Err(refuse(format!(
                "only one finger moves ({:?}), and no part of {:?} reaches beside it to close against: one finger cannot \
                 grasp. If the fixed jaw is a link of its own, give it collision geometry; if the hand is another part \
                 of the file, name its palm with --palm",
                self.model.body_name(moving.tip_body),
                self.model.body_name(self.palm)
            )));
        };
        // The middle of the corners around the nearest one.
        let around: Vec<&Vector3<f64>> = points
            .iter()
            .filter(|(g, point, _)| *g == geom && (point - nearest).norm() < NEAR * reach)
            .map(|(_, point, _)| point)
            .collect();
        let (lowest, highest) = around.iter().fold((nearest, nearest), |(l, h), p| (l.inf(p), h.sup(p)));
        let tip = (lowest + highest) / 2.0;
        let body = self.model.geom_body(geom);
        let in_world = self.palm_pose().transform_point(&tip.into()).coords;
        let own =
            self.data.body_orientation(body).inverse_transform_vector(&(in_world - self.data.body_position(body)));
        self.chains.push(Chain {
            first_joint: moving.first_joint,
            tip_body: body,
            tip: own,
            follows: false,
            slide: moving.slide,
            hinges: Vec::new(),
            fixed: true,
        });
        self.guided.push(f64::INFINITY);
        for pose in poses {
            pose.tips.push(tip);
        }
        Ok(())
    }
}

/// Lists directions that are spread evenly (Fibonacci lattice).
fn sphere(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (radius, angle) = ((1.0 - z * z).sqrt(), golden * i as f64);
        Vector3::new(radius * angle.cos(), radius * angle.sin(), z)
    })
}
