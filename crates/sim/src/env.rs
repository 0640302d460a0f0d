//! The grasp task as an environment: reset, observe, step.

use std::sync::Arc;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::{Rng, RngExt};

use crate::SimError;
use crate::reward::StepFacts;
use crate::scene::OBJECT_GEOM;
use crate::self_contacts::deepest;
use crate::setting::{Factors, Orientation, middle};
use crate::task::{AWAY, Addresses, GraspTask, ObjectScene};
use eigenhand_mujoco::{Data, Model, WarningCounts};

/// Time in s in which the hand takes the posture of its start.
pub const CLOSING_TIME: f64 = 0.6;

/// Height in m from which an object is dropped, so that it does not start inside the plane.
pub const DROP: f64 = 0.001;

/// A simulation for each scene of a task; one of them runs the current episode.
pub struct GraspEnv {
    task: Arc<GraspTask>,
    simulations: Vec<Data>,
    /// For each scene, a simulation of its object alone on the plane.
    resting: Vec<Data>,
    /// Whether size and friction are drawn.
    draws: bool,
    /// Whether each simulation has a model of its own, because something in it is drawn or has a factor.
    changes: bool,
    current: usize,
    drawn: Drawn,
    /// Whether the hand starts open in spite of `task.closed_start`.
    starts_open: bool,
    step: usize,
    desired_goal: [f32; GraspTask::GOAL_LEN],
    facts: StepFacts,
}

/// What is drawn for an episode besides poses and goal.
#[derive(Clone, Copy)]
struct Drawn {
    /// Factor on the lengths of the object.
    scale: f64,
    /// Sliding friction.
    friction: f64,
}

impl GraspEnv {
    /// Allocates the simulations.
    ///
    /// # Errors
    /// [`MuJoCoError::OutOfMemory`](eigenhand_mujoco::MuJoCoError::OutOfMemory).
    pub fn new(task: &Arc<GraspTask>) -> Result<GraspEnv, SimError> {
        Self::with(task, task.varies())
    }

    /// Allocates the simulations of an environment that draws neither size nor friction of an object: both are in the
    /// middle of their ranges, as in the scenes' files.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn without_draws(task: &Arc<GraspTask>) -> Result<GraspEnv, SimError> {
        Self::with(task, false)
    }

    fn with(task: &Arc<GraspTask>, draws: bool) -> Result<GraspEnv, SimError> {
        let changes = draws || task.factors != Factors::NONE;
        let data = |model: &Arc<Model>| if changes { Data::of_own_model(model) } else { Data::new(model) };
        Ok(GraspEnv {
            task: Arc::clone(task),
            simulations: task.scenes.iter().map(|scene| data(&scene.model)).collect::<Result<_, _>>()?,
            resting: task.scenes.iter().map(|scene| data(scene.resting())).collect::<Result<_, _>>()?,
            draws,
            changes,
            current: 0,
            drawn: Drawn { scale: middle(task.config.object_scale), friction: middle(task.physics.friction) },
            starts_open: false,
            step: 0,
            desired_goal: [0.0; GraspTask::GOAL_LEN],
            facts: StepFacts::default(),
        })
    }

    /// Returns the task.
    pub fn task(&self) -> &Arc<GraspTask> {
        &self.task
    }

    /// Returns the simulation of the running episode.
    pub fn simulation(&self) -> &Data {
        &self.simulations[self.current]
    }

    /// Returns the simulations of all scenes, each in the state of the last episode with its object.
    pub fn simulations(&self) -> &[Data] {
        &self.simulations
    }

    /// Lets the next episodes start with the open hand, in spite of `task.closed_start`.
    pub fn start_open(&mut self) {
        self.starts_open = true;
    }

    /// Starts an episode in scene `index` of [`GraspTask::scenes`].
    ///
    /// The object is dropped in a random pose, without the hand, and comes to rest on the plane. Then it is moved back
    /// to the random place above which it was dropped, and the hand is set to the slide's start, closed by a random
    /// share. If it would touch the object, it is closed less.
    ///
    /// # Errors
    /// [`SimError::Diverged`] when the simulation diverges while the object drops or the hand closes.
    /// [`SimError::MuJoCo`] when the model changes while something else holds that of
    /// [`simulation`](Self::simulation).
    pub fn reset<R: Rng + ?Sized>(&mut self, index: usize, rng: &mut R) -> Result<(), SimError> {
        let task = Arc::clone(&self.task);
        let scene = &task.scenes[index];
        self.current = index;
        self.step = 0;

        let range = task.config.object_range;
        let place = [0.0; 2].map(|_| if range > 0.0 { rng.random_range(-range..=range) } else { 0.0 });
        let orientation = draw_orientation(task.config.orientation, rng);
        let lift = draw(task.config.goal_height, rng);
        let closed = task.closes() && !self.starts_open;
        let mut share = if closed { draw(task.config.closed_start, rng) } else { 0.0 };
        // They come last, so that everything else is the same with and without them.
        if self.draws {
            let scale = draw(task.config.object_scale, rng);
            self.drawn = Drawn { scale, friction: draw(task.physics.friction, rng) };
        }
        let relative = self.drawn.scale / middle(task.config.object_scale);
        self.change_models(scene, relative)?;

        let resting = &mut self.resting[index];
        let height = scene.object.shape.depth_below_centre(&orientation) * relative + DROP;
        let q = orientation.quaternion();
        resting.qpos_mut().copy_from_slice(&[place[0], place[1], height, q.w, q.i, q.j, q.k]);
        let settling = (task.config.settle_time / task.physics.timestep).round() as usize;
        for _ in 0..settling {
            resting.step();
        }
        if resting.warnings().bad_state > 0 {
            return Err(SimError::Diverged { step: 0, joint: resting.bad_joint() });
        }

        let mut rest: Vec<f64> = resting.qpos().to_vec();
        // A quaternion and its negative are the same orientation; an episode starts with the one whose w is not
        // negative.
        if rest[3] < 0.0 {
            rest[3..7].iter_mut().for_each(|q| *q = -*q);
        }
        rest[..2].copy_from_slice(&place);
        self.desired_goal = [place[0] as f32, place[1] as f32, (rest[2] + lift) as f32];
        loop {
            self.start(share, &rest)?;
            if share == 0.0 || !self.facts.touches_hand {
                return Ok(());
            }
            share = if share > 0.1 { share / 2.0 } else { 0.0 };
        }
    }

    /// Begins the episode with the hand closed by a share and the object in a pose, all at rest.
    fn start(&mut self, share: f64, object: &[f64]) -> Result<(), SimError> {
        let Self { task, simulations, current, .. } = self;
        let at = &task.scenes[*current].addresses;
        let data = &mut simulations[*current];
        let begin = |data: &mut Data, qpos: &[f64]| {
            data.reset();
            data.qpos_mut().copy_from_slice(qpos);
            data.ctrl_mut().iter_mut().zip(task.controls_of_start(share)).for_each(|(ctrl, start)| *ctrl = start);
        };
        let mut qpos = at.start_qpos.clone();
        qpos[at.object_qpos..at.object_qpos + 7].copy_from_slice(object);
        if share > 0.0 {
            begin(data, &qpos);
            data.qpos_mut()[at.object_qpos] += AWAY;
            for _ in 0..(CLOSING_TIME / task.physics.timestep).round() as usize {
                data.step();
            }
            if data.warnings().bad_state > 0 {
                return Err(SimError::Diverged { step: 0, joint: data.bad_joint() });
            }
            qpos.copy_from_slice(data.qpos());
        }
        qpos[at.object_qpos..at.object_qpos + 7].copy_from_slice(object);
        begin(data, &qpos);
        data.forward();
        self.facts = read_facts(data, at);
        Ok(())
    }

    /// Resets both simulations of a scene, with the drawn size and friction of the object and the task's factors.
    fn change_models(&mut self, scene: &ObjectScene, relative_scale: f64) -> Result<(), SimError> {
        let (data, resting) = (&mut self.simulations[self.current], &mut self.resting[self.current]);
        if !self.changes {
            data.reset();
            resting.reset();
            return Ok(());
        }
        let friction = self.task.physics.friction_of(&scene.object, self.drawn.friction);
        let Factors { mass, stiffness } = self.task.factors;
        let [smallest, largest] = self.task.config.object_scale;
        let slide = scene.addresses.slide_ctrl;
        let vary = (self.draws && smallest < largest) || mass != 1.0;
        for (data, geom) in [(data, scene.object_geom()), (resting, scene.resting().geom(OBJECT_GEOM)?)] {
            let body = data.model().geom_body(geom);
            let servos: Vec<_> = data.model().actuators().collect();
            data.change_model(|model| {
                model.set_friction(geom, friction);
                if vary {
                    model.scale_body(body, relative_scale, mass);
                }
                for &servo in servos.iter().filter(|servo| stiffness != 1.0 && servo.index() != slide) {
                    model.scale_actuator(servo, stiffness);
                }
            })?;
        }
        Ok(())
    }

    /// Returns the factor on the lengths of the object in this episode.
    pub fn object_scale(&self) -> f64 {
        self.drawn.scale
    }

    /// Returns the sliding friction of the object in this episode.
    pub fn friction(&self) -> f64 {
        self.task.scenes[self.current].object.friction.unwrap_or(self.drawn.friction)
    }

    /// Moves the object along x and y on the plane.
    pub fn shift_object(&mut self, by: [f64; 2]) {
        let at = &self.task.scenes[self.current].addresses;
        let data = &mut self.simulations[self.current];
        let place = &mut data.qpos_mut()[at.object_qpos..at.object_qpos + 2];
        place.iter_mut().zip(by).for_each(|(p, by)| *p += by);
        data.forward();
        self.facts = read_facts(data, at);
    }

    /// Sets the force that acts at the object's centre of mass, until it is set again or the next episode starts.
    ///
    /// # Units
    /// N, along the axes of the world.
    pub fn push_object(&mut self, force: [f64; 3]) {
        let data = &mut self.simulations[self.current];
        let body = data.model().geom_body(self.task.scenes[self.current].addresses.object);
        data.set_force(body, force);
    }

    /// Applies an action for one control period.
    ///
    /// # Errors
    /// [`SimError::Diverged`]: discard the episode and start another with [`reset`](Self::reset).
    pub fn step(&mut self, action: &[f32]) -> Result<StepFacts, SimError> {
        let data = &mut self.simulations[self.current];
        self.task.scale_action(action, data.ctrl_mut());
        for _ in 0..self.task.physics.substeps {
            data.step();
        }
        self.step += 1;
        if data.warnings().bad_state > 0 || data.qpos().iter().any(|q| !q.is_finite()) {
            return Err(SimError::Diverged { step: self.step, joint: data.bad_joint() });
        }
        self.facts = read_facts(data, &self.task.scenes[self.current].addresses);
        Ok(self.facts)
    }

    /// Writes the observation; its layout is [`GraspTask::observation_layout`].
    pub fn observe(&self, observation: &mut [f32]) {
        self.observe_at(self.object_pose(), observation);
    }

    /// Writes the observation with the object shifted, and turned about its own place. Nothing else changes, the
    /// object's velocity included; the simulation does not see it.
    ///
    /// # Units
    /// `shift` in m and `turn` in rad, a rotation vector; both along the axes of the world.
    pub fn observe_displaced(&self, shift: [f64; 3], turn: [f64; 3], observation: &mut [f32]) {
        let [x, y, z, qw, qx, qy, qz] = self.object_pose();
        let [dx, dy, dz] = shift;
        let turned = UnitQuaternion::new(Vector3::from(turn)).quaternion() * Quaternion::new(qw, qx, qy, qz);
        self.observe_at([x + dx, y + dy, z + dz, turned.w, turned.i, turned.j, turned.k], observation);
    }

    /// Returns the object's position in m, and its orientation as w, x, y, z.
    pub fn object_pose(&self) -> [f64; 7] {
        let object = self.task.scenes[self.current].addresses.object_qpos;
        std::array::from_fn(|i| self.simulation().qpos()[object + i])
    }

    fn observe_at(&self, pose: [f64; 7], observation: &mut [f32]) {
        let scene = &self.task.scenes[self.current];
        let at = &scene.addresses;
        let data = &self.simulations[self.current];
        let (qpos, qvel) = (data.qpos(), data.qvel());
        let orientation = std::array::from_fn(|i| pose[3 + i]);
        let relative = self.drawn.scale / middle(self.task.config.object_scale);
        let shape = self.task.config.observe_shape.then(|| scene.shape_along_axes(orientation).map(|h| h * relative));
        let tips = at.tips.iter().filter(|_| self.task.config.observe_fingertips);
        let values = at
            .posture_qpos
            .iter()
            .map(|&i| qpos[i])
            .chain(at.posture_dof.iter().map(|&i| qvel[i]))
            .chain(pose)
            .chain(qvel[at.object_dof..at.object_dof + 6].iter().copied())
            .chain(tips.flat_map(|tip| {
                let place = tip.position(data);
                [place.x - pose[0], place.y - pose[1], place.z - pose[2]]
            }))
            .chain(self.task.config.observe_id.then_some(scene.object.id as f64))
            .chain(shape.into_iter().flatten());
        for (out, value) in observation.iter_mut().zip(values) {
            *out = value as f32;
        }
    }

    /// Returns the object's position in m.
    pub fn achieved_goal(&self) -> [f32; GraspTask::GOAL_LEN] {
        let object = self.task.scenes[self.current].addresses.object_qpos;
        let qpos = self.simulation().qpos();
        [qpos[object] as f32, qpos[object + 1] as f32, qpos[object + 2] as f32]
    }

    /// Returns the object's desired position in m.
    pub fn desired_goal(&self) -> [f32; GraspTask::GOAL_LEN] {
        self.desired_goal
    }

    /// Returns the contacts at the end of the last step.
    pub fn facts(&self) -> StepFacts {
        self.facts
    }

    /// Returns the deepest penetration between two geoms of the hand, in m; 0 without `physics.self_collision`.
    pub fn self_penetration(&self) -> f64 {
        let at = &self.task.scenes[self.current].addresses;
        if self.task.physics.self_collision { deepest(self.simulation(), at) } else { 0.0 }
    }

    /// Writes the values of the posture's joints, in rad and m.
    pub fn posture(&self, posture: &mut [f64]) {
        let qpos = self.simulation().qpos();
        let at = &self.task.scenes[self.current].addresses;
        for (out, &i) in posture.iter_mut().zip(&at.posture_qpos) {
            *out = qpos[i];
        }
    }

    /// Returns the warnings that MuJoCo raised in this episode.
    pub fn warnings(&self) -> WarningCounts {
        self.simulation().warnings()
    }
}

/// Draws uniformly from a range; takes no random number if it is a single value.
fn draw<R: Rng + ?Sized>([low, high]: [f64; 2], rng: &mut R) -> f64 {
    if high > low { rng.random_range(low..=high) } else { low }
}

fn draw_orientation<R: Rng + ?Sized>(kind: Orientation, rng: &mut R) -> UnitQuaternion<f64> {
    match kind {
        Orientation::Yaw => UnitQuaternion::from_axis_angle(
            &Vector3::z_axis(),
            rng.random_range(-std::f64::consts::PI..std::f64::consts::PI),
        ),
        // Shoemake, "Uniform random rotations", Graphics Gems III (1992).
        Orientation::Any => {
            let (u, a, b) = (
                rng.random_range(0.0..1.0f64),
                rng.random_range(0.0..std::f64::consts::TAU),
                rng.random_range(0.0..std::f64::consts::TAU),
            );
            let (first, second) = ((1.0 - u).sqrt(), u.sqrt());
            UnitQuaternion::from_quaternion(Quaternion::new(
                second * b.cos(),
                first * a.sin(),
                first * a.cos(),
                second * b.sin(),
            ))
        }
    }
}

fn read_facts(data: &Data, at: &Addresses) -> StepFacts {
    let mut facts = StepFacts::default();
    for contact in data.contacts() {
        let other = match contact.geoms {
            [a, b] if a == at.object => b,
            [a, b] if b == at.object => a,
            _ => continue,
        };
        if other == at.plane {
            facts.touches_plane = true;
        } else if at.is_hand[other.index()] {
            facts.touches_hand = true;
            facts.penetration = facts.penetration.max(-contact.distance);
        }
    }
    facts
}
