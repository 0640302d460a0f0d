//! Signs of a fault in a hand's model, each with what to change. A hand that shows one may still grasp.

use eigenhand_hands::{Hand, Transmission};
use eigenhand_mujoco::{BodyId, Data, Model};
use eigenhand_sim::scene::MOUNT;
use eigenhand_sim::{GraspTask, ObjectScene, Overlap, SelfContacts, SimError, fingertip_positions};
use nalgebra::Vector3;
use serde::Serialize;

mod hulls;

/// Distances in m from the palm within which the farthest fingertip of a hand lies.
const REACH: [f64; 2] = [0.02, 0.5];
/// Masses in kg between which hands lie.
const MASS: [f64; 2] = [0.01, 20.0];
/// A body of the size of its geoms has moments of inertia like a box of their size; a larger box by this factor, and by
/// this length in m, speaks of another unit.
const INERTIA_FACTOR: f64 = 4.0;
const INERTIA_MARGIN: f64 = 0.02;
/// Penetration in m of two links in the open posture that is worth a look.
const OVERLAP: f64 = 0.004;
/// Time in s that a servo has to reach its target, and the share of its joint's range by which it may miss it.
const DRIVE_TIME: f64 = 1.0;
const MISSED: f64 = 0.3;
/// Time in s that the hand has to close, and the path in m of a fingertip that moves.
const CLOSING_TIME: f64 = 1.0;
const MOVES: f64 = 0.005;
/// Cosine above which two fingertips move the same way.
const SAME_WAY: f64 = 0.5;
/// Limits in rad that model files give where nobody knows better.
const PLACEHOLDER: f64 = std::f64::consts::FRAC_PI_2;
const PLACEHOLDER_TOLERANCE: f64 = 2e-3;

/// Both directions of each axis.
const SIX_WAYS: [[f64; 3]; 6] =
    [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];

/// A sign that something is wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Symptom {
    /// What is wrong.
    pub name: &'static str,
    /// What was found, and what to change.
    pub detail: String,
}

impl std::fmt::Display for Symptom {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.name, self.detail)
    }
}

/// Looks for signs of a fault in a hand, by its first scene.
///
/// # Errors
/// [`SimError::MuJoCo`] for a name that the scene lacks, or when memory is short.
pub fn symptoms(hand: &Hand, task: &GraspTask) -> Result<Vec<Symptom>, SimError> {
    let Some(scene) = task.scenes.first() else { return Ok(Vec::new()) };
    let open = task.open_hand(scene)?;
    let patient = Patient { hand, task, scene, open };
    let found = [
        ("size", patient.size()?),
        ("mass", patient.mass()?),
        ("inertia", patient.inertia()?),
        ("links without collision geometry", patient.collision()?),
        ("meshes filled by their hulls", patient.filled_meshes()),
        ("links inside each other", patient.overlaps()?),
        ("weak servos", patient.weak_servos()?),
        ("fingers close the same way", patient.opposition()?),
        ("limits of ±90 degrees", patient.placeholders()),
    ];
    Ok(found.into_iter().filter_map(|(name, detail)| Some(Symptom { name, detail: detail? })).collect())
}

/// A hand, and a simulation of it, open and above everything else.
struct Patient<'a> {
    hand: &'a Hand,
    task: &'a GraspTask,
    scene: &'a ObjectScene,
    open: Data,
}

impl Patient<'_> {
    fn model(&self) -> &Model {
        &self.scene.model
    }

    /// Lists the bodies of the hand, without the mount that carries it.
    fn bodies(&self) -> Result<Vec<BodyId>, SimError> {
        let model = self.model();
        let mount = model.body(MOUNT)?;
        Ok(model.bodies().filter(|&body| body != mount && is_below(model, body, mount)).collect())
    }

    fn size(&self) -> Result<Option<String>, SimError> {
        let palm = self.open.body_position(self.model().body(&self.hand.manifest.palm)?);
        let reach =
            fingertip_positions(self.hand, &self.open)?.iter().map(|tip| (tip - palm).norm()).fold(0.0, f64::max);
        Ok((!(REACH[0]..=REACH[1]).contains(&reach)).then(|| {
            format!(
                "the farthest fingertip is {reach:.3} m from the palm: if the file's lengths are not in m, scale its \
                 meshes and positions"
            )
        }))
    }

    fn mass(&self) -> Result<Option<String>, SimError> {
        let mass = self.model().subtree_mass(self.model().body(MOUNT)?);
        Ok((!(MASS[0]..=MASS[1]).contains(&mass)).then(|| {
            format!("the hand weighs {mass:.4} kg: check the masses, or the densities, and their unit, which is kg")
        }))
    }

    /// Compares each body's geoms with the box that has the body's mass and moments of inertia.
    fn inertia(&self) -> Result<Option<String>, SimError> {
        let model = self.model();
        let mut large = Vec::new();
        for body in self.bodies()? {
            let mass = model.body_mass(body);
            let trace: f64 = model.principal_inertia(body).iter().sum();
            let own: Vec<_> = model.geoms().filter(|&geom| model.geom_body(geom) == body).collect();
            let solid = own.iter().copied().filter(|&geom| model.geom_collides(geom)).collect::<Vec<_>>();
            let points: Vec<Vector3<f64>> = if solid.is_empty() { own } else { solid }
                .into_iter()
                .flat_map(|geom| SIX_WAYS.map(|way| self.open.farthest_point(geom, &Vector3::from(way))))
                .collect();
            if mass <= 0.0 || points.is_empty() {
                continue;
            }
            let middle = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
            let radius = points.iter().map(|point| (point - middle).norm()).fold(0.0, f64::max);
            // A box with half diagonal d has the sum of moments 2 m d^2 / 3.
            let half_diagonal = (1.5 * trace / mass).sqrt();
            if half_diagonal > INERTIA_FACTOR * radius + INERTIA_MARGIN {
                large.push(format!("{} ({half_diagonal:.2} m, geoms {radius:.2} m)", model.body_name(body)));
            }
        }
        Ok(said(&large, |bodies| {
            format!(
                "by their moments of inertia, these bodies reach much farther from their middles than by their geoms: \
                 {bodies}; moments are in kg m^2, so check their unit"
            )
        }))
    }

    fn collision(&self) -> Result<Option<String>, SimError> {
        let model = self.model();
        let bare: Vec<String> = self
            .hand
            .posture
            .iter()
            .map(|joint| Ok((joint, model.joint_body(model.joint(&joint.name)?))))
            .collect::<Result<Vec<_>, SimError>>()?
            .into_iter()
            .filter(|(_, body)| {
                let below = model.geoms_below(*body);
                !model.geoms().any(|geom| below[geom.index()] && model.geom_collides(geom))
            })
            .map(|(joint, _)| joint.name.clone())
            .collect();
        Ok(said(&bare, |joints| {
            format!(
                "nothing that these joints move can touch an object: {joints}; give their links collision geometry, or \
                 leave the joints out of posture_joints"
            )
        }))
    }

    /// Links of one finger may overlap where they are joined.
    fn overlaps(&self) -> Result<Option<String>, SimError> {
        let model = self.model();
        let mut deep = Vec::new();
        for Overlap { bodies: [a, b], depth } in self.task.self_contacts.iter().flat_map(SelfContacts::overlaps) {
            let [first, second] = [model.body(a)?, model.body(b)?];
            if *depth > OVERLAP && !is_below(model, first, second) && !is_below(model, second, first) {
                deep.push(format!("{a} and {b} ({:.0} mm)", 1000.0 * depth));
            }
        }
        Ok(said(&deep, |pairs| {
            format!(
                "in the open posture, these links stand inside each other, so they never collide: {pairs}; change \
                 [open_posture], or divide meshes that are not convex, because MuJoCo collides their convex hulls"
            )
        }))
    }

    /// Drives each servo of a joint to both ends of its range, where nothing is in the way.
    fn weak_servos(&self) -> Result<Option<String>, SimError> {
        let model = self.model();
        let steps = (DRIVE_TIME / self.task.physics.timestep).ceil() as usize;
        let mut weak = Vec::new();
        for actuator in &self.hand.actuators {
            let (Some(servo), Transmission::Joint(name)) = (&actuator.servo, &actuator.transmission) else { continue };
            let joint = model.joint(name)?;
            let Some((low, high)) = model.joint_range(joint) else { continue };
            let Some(index) = self.task.actuators.iter().position(|known| *known == actuator.name) else { continue };
            let mut worst: f64 = 0.0;
            for command in [actuator.ctrlrange.0, actuator.ctrlrange.1] {
                let mut data = self.task.open_hand(self.scene)?;
                data.ctrl_mut()[index] = command;
                (0..steps).for_each(|_| data.step());
                let blocked =
                    data.contacts().any(|contact| contact.geoms.iter().all(|geom| self.scene.is_hand()[geom.index()]));
                if blocked || !data.warnings().is_clear() {
                    continue;
                }
                let target = (servo.gain * command + servo.bias) / (servo.stiffness * actuator.gear);
                let away = (data.qpos()[model.qpos_address(joint)] - target.clamp(low, high)).abs();
                worst = worst.max(away / (high - low));
            }
            if worst > MISSED {
                weak.push(format!("{} (by {:.0} % of its joint's range)", actuator.name, 100.0 * worst));
            }
        }
        Ok(said(&weak, |servos| {
            format!(
                "with nothing in the way, these servos do not reach the ends of their ranges: {servos}; raise their force \
                 limit or gain, or lower the damping and friction of their joints"
            )
        }))
    }

    /// Compares the horizontal ways of the fingertips while the hand closes.
    fn opposition(&self) -> Result<Option<String>, SimError> {
        let mut data = self.task.open_hand(self.scene)?;
        let before = fingertip_positions(self.hand, &data)?;
        let top = data.ctrl()[self.task.slide_action()];
        data.ctrl_mut().copy_from_slice(self.task.closed_controls());
        data.ctrl_mut()[self.task.slide_action()] = top;
        let steps = (CLOSING_TIME / self.task.physics.timestep).ceil() as usize;
        (0..steps).for_each(|_| data.step());
        let ways = fingertip_positions(self.hand, &data)?;
        let ways: Vec<Vector3<f64>> = ways
            .iter()
            .zip(&before)
            .map(|(after, before)| Vector3::new(after.x - before.x, after.y - before.y, 0.0))
            .collect();
        // A fingertip that stays where it is can be what the others press against.
        let all_move = ways.len() > 1 && ways.iter().all(|way| way.norm() > MOVES);
        let same = |a: &Vector3<f64>, b: &Vector3<f64>| a.dot(b) > SAME_WAY * a.norm() * b.norm();
        let together = ways.iter().enumerate().all(|(i, a)| ways[..i].iter().all(|b| same(a, b)));
        Ok((all_move && together).then(|| {
            "all fingertips close in nearly the same direction, so none presses against another: check [closing], and turn \
             the thumb against the fingers in [open_posture]"
                .to_owned()
        }))
    }

    fn placeholders(&self) -> Option<String> {
        let is_placeholder = |(low, high): (f64, f64)| {
            (low + PLACEHOLDER).abs() < PLACEHOLDER_TOLERANCE && (high - PLACEHOLDER).abs() < PLACEHOLDER_TOLERANCE
        };
        let joints: Vec<String> = self
            .hand
            .posture
            .iter()
            .filter(|joint| joint.range().is_some_and(is_placeholder))
            .map(|joint| joint.name.clone())
            .collect();
        said(&joints, |joints| {
            format!(
                "these joints have limits that files state where the maker's are unknown: {joints}; compare with the data \
                 sheet, because a finger that bends backwards by 90 degrees is seldom right"
            )
        })
    }
}

fn is_below(model: &Model, body: BodyId, root: BodyId) -> bool {
    let mut at = body;
    while at != root {
        let parent = model.body_parent(at);
        // The world is its own parent.
        if parent == at {
            return false;
        }
        at = parent;
    }
    true
}

/// Joins what was found, for the text that tells of it; none if nothing was found.
fn said(found: &[String], text: impl Fn(String) -> String) -> Option<String> {
    (!found.is_empty()).then(|| text(found.join(", ")))
}
