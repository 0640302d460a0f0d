//! Changes to a model that belongs to one simulation.

use std::ops::Range;
use std::ptr::NonNull;
use std::sync::Arc;

use crate::bindings::mjModel;
use crate::data::slice_of_mut;
use crate::model::slice_of;
use crate::{ActuatorId, BodyId, Data, GeomId, Model, MuJoCoError};

/// Numbers of an actuator's gain, and of its bias: mjNGAIN and mjNBIAS of mjmodel.h.
const PARAMETERS: usize = 10;
/// The last kinds of gain and of bias that are linear in their parameters: mjGAIN_AFFINE and mjBIAS_AFFINE of mjmodel.h.
/// Muscles and a user's own actuators follow.
const AFFINE: i32 = 1;

impl Model {
    /// Copies the model.
    ///
    /// # Errors
    /// [`MuJoCoError::OutOfMemory`].
    pub fn copy(&self) -> Result<Model, MuJoCoError> {
        // SAFETY: the model is valid; for a null destination, MuJoCo allocates the copy.
        let raw = unsafe { (self.library.api.mj_copyModel)(std::ptr::null_mut(), self.raw.as_ptr()) };
        let raw = NonNull::new(raw).ok_or(MuJoCoError::OutOfMemory)?;
        Ok(Model { library: Arc::clone(&self.library), raw })
    }
}

impl Data {
    /// Allocates a simulation of a copy of `original`, which [`change_model`](Self::change_model) can change.
    ///
    /// # Errors
    /// [`MuJoCoError::OutOfMemory`].
    pub fn of_own_model(original: &Arc<Model>) -> Result<Data, MuJoCoError> {
        let mut data = Data::new(&Arc::new(original.copy()?))?;
        data.original = Some(Arc::clone(original));
        Ok(data)
    }

    /// Changes the model of this simulation, and returns to its default configuration.
    ///
    /// Constants that MuJoCo derives from lengths and masses follow the change.
    ///
    /// # Errors
    /// [`MuJoCoError::SharedModel`] unless the simulation came from [`of_own_model`](Self::of_own_model) and nothing
    /// else holds its model.
    pub fn change_model(&mut self, change: impl FnOnce(&mut ModelChanges<'_>)) -> Result<(), MuJoCoError> {
        let original = self.original.as_ref().ok_or(MuJoCoError::SharedModel)?;
        let model = Arc::get_mut(&mut self.model).ok_or(MuJoCoError::SharedModel)?;
        let mut changes = ModelChanges { model, original, constants: false };
        change(&mut changes);
        if changes.constants {
            // SAFETY: the data belongs to the model, which nothing else holds.
            unsafe { (self.model.library.api.mj_setConst)(self.model.raw.as_ptr(), self.raw.as_ptr()) }
        }
        self.reset();
        Ok(())
    }
}

/// Writes into the model of one simulation; see [`Data::change_model`].
pub struct ModelChanges<'a> {
    model: &'a mut Model,
    /// The model as it was compiled.
    original: &'a Model,
    /// Whether a length or a mass has changed.
    constants: bool,
}

impl ModelChanges<'_> {
    /// Sets the sliding (no unit), torsional (m) and rolling (m) friction of a geom.
    ///
    /// # Panics
    /// If the id is of another model that has more geoms.
    pub fn set_friction(&mut self, id: GeomId, friction: [f64; 3]) {
        let raw = self.model.get();
        // SAFETY: geom_friction holds three numbers for each geom, and `&mut self` excludes other views.
        let all = unsafe { slice_of_mut(raw.geom_friction, 3 * raw.ngeom as usize) };
        all[3 * id.0..3 * id.0 + 3].copy_from_slice(&friction);
    }

    /// Sets every length of a body's geoms and of its mass distribution to `length` times that of the compiled model, and
    /// its mass to `mass` times.
    ///
    /// The body's place in its parent stays too. A mesh changes for every geom that uses it.
    ///
    /// # Panics
    /// If the id is of another model that has more bodies.
    pub fn scale_body(&mut self, id: BodyId, length: f64, mass: f64) {
        let three = |index: usize| 3 * index..3 * index + 3;
        self.scale(|m| (m.body_mass, m.nbody), id.0..id.0 + 1, mass);
        self.scale(|m| (m.body_ipos, 3 * m.nbody), three(id.0), length);
        self.scale(|m| (m.body_inertia, 3 * m.nbody), three(id.0), length * length * mass);
        for geom in self.original.geoms().filter(|&geom| self.original.geom_body(geom) == id) {
            self.scale(|m| (m.geom_pos, 3 * m.ngeom), three(geom.0), length);
            self.scale(|m| (m.geom_size, 3 * m.ngeom), three(geom.0), length);
            self.scale(|m| (m.geom_rbound, m.ngeom), geom.0..geom.0 + 1, length);
            self.scale(|m| (m.mesh_vert, 3 * m.nmeshvert), self.original.mesh_range(geom), length);
        }
        self.constants = true;
    }

    /// Sets gain and bias of an actuator to `factor` times those of the compiled model: a servo answers the same command
    /// with `factor` times the force. Its limits stay. A muscle does not change.
    ///
    /// # Panics
    /// If the id is of another model that has more actuators.
    pub fn scale_actuator(&mut self, id: ActuatorId, factor: f64) {
        let raw = self.original.get();
        let part = PARAMETERS * id.0..PARAMETERS * (id.0 + 1);
        if self.original.ints(raw.actuator_gaintype, raw.nu)[id.0] <= AFFINE {
            self.scale(|m| (m.actuator_gainprm, PARAMETERS as i32 * m.nu), part.clone(), factor);
        }
        if self.original.ints(raw.actuator_biastype, raw.nu)[id.0] <= AFFINE {
            self.scale(|m| (m.actuator_biasprm, PARAMETERS as i32 * m.nu), part, factor);
        }
    }

    /// Sets a part of an array to `factor` times that of the compiled model.
    fn scale<T>(&mut self, array: impl Fn(&mjModel) -> (*mut T, i32), part: Range<usize>, factor: f64)
    where
        T: Copy + Into<f64> + FromNumber,
    {
        let (first, count) = array(self.original.get());
        // SAFETY: callers pass an array of a model with its own length, and nothing writes to the original.
        let original = unsafe { slice_of(first, count) };
        let (first, count) = array(self.model.get());
        // SAFETY: as above, and `&mut self` excludes other views.
        let own = unsafe { slice_of_mut(first, count as usize) };
        for (own, &original) in own[part.clone()].iter_mut().zip(&original[part]) {
            *own = T::from_number(original.into() * factor);
        }
    }
}

/// A number of a model's array, in single or double precision.
trait FromNumber {
    fn from_number(number: f64) -> Self;
}

impl FromNumber for f64 {
    fn from_number(number: f64) -> f64 {
        number
    }
}

impl FromNumber for f32 {
    fn from_number(number: f64) -> f32 {
        number as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MuJoCo;

    fn model(size: f64, friction: f64) -> Arc<Model> {
        let xml = format!(
            "<mujoco><worldbody><geom type='plane' size='1 1 1'/><body name='thing' pos='0 0 0.2'><freejoint/>\
             <geom name='thing' type='box' size='{} {} {}' mass='0.1' priority='1' friction='{friction} 0.01 0.001'/>\
             </body></worldbody></mujoco>",
            0.03 * size,
            0.02 * size,
            0.01 * size
        );
        let library = MuJoCo::load().unwrap_or_else(|error| panic!("{error}"));
        Arc::new(Model::from_xml(&library, &xml, &[]).expect("a sound model"))
    }

    fn fall(data: &mut Data) -> Vec<f64> {
        data.qpos_mut()[..7].copy_from_slice(&[0.0, 0.0, 0.1, 0.9, 0.3, 0.3, 0.1]);
        (0..500).for_each(|_| data.step());
        data.qpos().to_vec()
    }

    #[test]
    fn a_changed_model_simulates_as_a_compiled_one_whatever_came_before() {
        let original = model(1.0, 0.9);
        let (body, geom) = (original.body("thing").expect("named"), original.geom("thing").expect("named"));
        let mut data = Data::of_own_model(&original).expect("memory");
        let mut ends = Vec::new();
        for (factor, friction) in [(1.3, 0.2), (0.7, 0.6), (1.3, 0.2)] {
            data.change_model(|model| {
                model.set_friction(geom, [friction, 0.01, 0.001]);
                model.scale_body(body, factor, 1.0);
            })
            .expect("its own model");
            let compiled = model(factor, friction);
            let end = fall(&mut data);
            let expected = fall(&mut Data::new(&compiled).expect("memory"));
            for (end, expected) in end.iter().zip(&expected) {
                assert!((end - expected).abs() < 1e-9, "{end}, expected {expected}");
            }
            ends.push(end);
        }
        assert_eq!(ends[0], ends[2]);
        assert_ne!(ends[0], ends[1]);
        assert_eq!(original.principal_inertia(body), model(1.0, 0.9).principal_inertia(body), "the original stays");
    }

    #[test]
    fn a_push_moves_a_free_body_as_newton_says() {
        let original = model(1.0, 0.9);
        let body = original.body("thing").expect("named");
        let mut data = Data::of_own_model(&original).expect("memory");
        for mass in [1.0, 2.0] {
            data.change_model(|model| model.scale_body(body, 1.0, mass)).expect("its own model");
            let kilograms = data.model().body_mass(body);
            assert!((kilograms - 0.1 * mass).abs() < 1e-12, "{kilograms} kg");
            data.qpos_mut()[2] = 1.0;
            let force = [0.3, -0.4, 0.0];
            data.set_force(body, force);
            let steps = 50;
            (0..steps).for_each(|_| data.step());
            let time = data.time();
            for (axis, force) in force.iter().take(2).enumerate() {
                let speed = force * time / kilograms;
                assert!((data.qvel()[axis] - speed).abs() < 1e-9, "{} m/s, expected {speed}", data.qvel()[axis]);
            }
            let before = data.qvel()[0];
            data.set_force(body, [0.0; 3]);
            data.step();
            assert!((data.qvel()[0] - before).abs() < 1e-12, "nothing pushes any more");
        }
        data.set_force(body, [1.0; 3]);
        data.reset();
        data.step();
        assert_eq!(data.qvel()[0], 0.0, "a reset ends the push");
    }

    #[test]
    fn a_heavier_body_is_not_lifted_by_the_weight_of_a_light_one() {
        let original = model(1.0, 0.9);
        let body = original.body("thing").expect("named");
        let mut data = Data::of_own_model(&original).expect("memory");
        let mut rise = |mass: f64| {
            data.change_model(|model| model.scale_body(body, 1.0, mass)).expect("its own model");
            data.qpos_mut()[2] = 0.01;
            (0..200).for_each(|_| data.step());
            let rest = data.qpos()[2];
            data.set_force(body, [0.0, 0.0, 1.5 * 0.1 * 9.81]);
            (0..100).for_each(|_| data.step());
            data.qpos()[2] - rest
        };
        let heights = [1.0, 2.0, 1.0].map(&mut rise);
        assert!(heights[0] > 0.05 && heights[1].abs() < 1e-3, "{heights:?}");
        assert_eq!(heights[0], heights[2]);
    }

    #[test]
    fn a_stiffer_servo_answers_the_same_command_with_more_force() {
        let xml = "<mujoco><option gravity='0 0 0'/><worldbody><body><joint name='turn'/><geom size='0.1' mass='1'/></body>\
                   </worldbody><actuator><position name='servo' joint='turn' kp='2'/></actuator></mujoco>";
        let library = MuJoCo::load().unwrap_or_else(|error| panic!("{error}"));
        let original = Arc::new(Model::from_xml(&library, xml, &[]).expect("a sound model"));
        let servo = original.actuator("servo").expect("named");
        let mut data = Data::of_own_model(&original).expect("memory");
        let mut speed = |factor: f64| {
            data.change_model(|model| model.scale_actuator(servo, factor)).expect("its own model");
            data.qpos_mut()[0] = 0.3;
            data.ctrl_mut()[0] = 0.5;
            data.step();
            data.qvel()[0]
        };
        let [own, soft, stiff] = [1.0, 0.7, 1.3].map(&mut speed);
        assert!(own > 0.0 && (soft / own - 0.7).abs() < 1e-9 && (stiff / own - 1.3).abs() < 1e-9);
    }

    #[test]
    fn a_shared_model_cannot_be_changed() {
        let original = model(1.0, 0.9);
        let refused = |data: &mut Data| matches!(data.change_model(|_| ()), Err(MuJoCoError::SharedModel));
        assert!(refused(&mut Data::new(&original).expect("memory")));
        let mut own = Data::of_own_model(&original).expect("memory");
        assert!(!refused(&mut own));
        let other = Data::new(own.model()).expect("memory");
        assert!(refused(&mut own));
        drop(other);
        assert!(!refused(&mut own));
    }
}
