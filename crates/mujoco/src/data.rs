//! The owner of an `mjData`.

use std::ptr::NonNull;
use std::sync::Arc;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::MuJoCoError;
use crate::bindings::{self as mj, mjContact, mjData};
use crate::model::slice_of;
use crate::{BodyId, GeomId, Model, SiteId};

/// The state of one simulation; it keeps its [`Model`] alive.
pub struct Data {
    pub(crate) model: Arc<Model>,
    /// The model of which `model` is a changeable copy.
    pub(crate) original: Option<Arc<Model>>,
    pub(crate) raw: NonNull<mjData>,
}

// SAFETY: an mjData is owned by one `Data` and touched only through it.
unsafe impl Send for Data {}

impl Drop for Data {
    fn drop(&mut self) {
        // SAFETY: `raw` came from `mj_makeData`, is owned here and is not used again.
        unsafe { (self.model.library.api.mj_deleteData)(self.raw.as_ptr()) }
    }
}

/// A contact that the constraint solver acts on.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// The two geoms.
    pub geoms: [GeomId; 2],
    /// Distance between the surfaces in m; negative is penetration.
    pub distance: f64,
}

/// Numbers of warnings that MuJoCo raised since the last reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct WarningCounts {
    /// Steps whose position, velocity, acceleration or control was not finite or too large.
    pub bad_state: u64,
    /// Steps at which the contact buffer was full.
    pub contacts_full: u64,
    /// Steps at which the constraint buffer was full.
    pub constraints_full: u64,
    /// Steps whose inertia matrix was not positive definite.
    pub inertia: u64,
}

impl WarningCounts {
    /// Tells whether there was no warning.
    pub fn is_clear(&self) -> bool {
        *self == WarningCounts::default()
    }
}

impl std::ops::AddAssign for WarningCounts {
    fn add_assign(&mut self, other: Self) {
        self.bad_state += other.bad_state;
        self.contacts_full += other.contacts_full;
        self.constraints_full += other.constraints_full;
        self.inertia += other.inertia;
    }
}

impl Data {
    /// Allocates a simulation state for `model`, at its default configuration.
    ///
    /// # Errors
    /// [`MuJoCoError::OutOfMemory`] when MuJoCo cannot allocate it.
    pub fn new(model: &Arc<Model>) -> Result<Data, MuJoCoError> {
        // SAFETY: the model is valid.
        let raw = unsafe { (model.library.api.mj_makeData)(model.raw.as_ptr()) };
        let raw = NonNull::new(raw).ok_or(MuJoCoError::OutOfMemory)?;
        Ok(Data { model: Arc::clone(model), original: None, raw })
    }

    /// Returns the model.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    pub(crate) fn get(&self) -> &mjData {
        // SAFETY: `raw` is valid for as long as `self` lives, and `&self` excludes a writer.
        unsafe { self.raw.as_ref() }
    }

    /// Returns to the default configuration and clears time, warnings and warm starts.
    pub fn reset(&mut self) {
        // SAFETY: the data belongs to the model.
        unsafe { (self.model.library.api.mj_resetData)(self.model.raw.as_ptr(), self.raw.as_ptr()) }
    }

    /// Advances by one time step.
    pub fn step(&mut self) {
        // SAFETY: the data belongs to the model.
        unsafe { (self.model.library.api.mj_step)(self.model.raw.as_ptr(), self.raw.as_ptr()) }
    }

    /// Computes every dependent quantity of the present state without advancing.
    pub fn forward(&mut self) {
        // SAFETY: the data belongs to the model.
        unsafe { (self.model.library.api.mj_forward)(self.model.raw.as_ptr(), self.raw.as_ptr()) }
    }

    /// Copies the whole state of `source` into this one.
    ///
    /// # Errors
    /// [`MuJoCoError::OtherModel`] when the two belong to different models.
    pub fn copy_from(&mut self, source: &Data) -> Result<(), MuJoCoError> {
        if !Arc::ptr_eq(&self.model, &source.model) {
            return Err(MuJoCoError::OtherModel);
        }
        // SAFETY: both belong to the model, and `&mut self` makes them distinct.
        unsafe {
            (self.model.library.api.mj_copyData)(self.raw.as_ptr(), self.model.raw.as_ptr(), source.raw.as_ptr())
        };
        Ok(())
    }

    /// Returns the simulated time in s.
    pub fn time(&self) -> f64 {
        self.get().time
    }

    /// Returns the generalised coordinates.
    pub fn qpos(&self) -> &[f64] {
        // SAFETY: qpos holds nq numbers.
        unsafe { slice_of(self.get().qpos, self.model.nq() as i32) }
    }

    /// Returns the generalised coordinates for writing.
    pub fn qpos_mut(&mut self) -> &mut [f64] {
        // SAFETY: qpos holds nq numbers, and `&mut self` excludes other views.
        unsafe { slice_of_mut(self.get().qpos, self.model.nq()) }
    }

    /// Returns the generalised velocities.
    pub fn qvel(&self) -> &[f64] {
        // SAFETY: qvel holds nv numbers.
        unsafe { slice_of(self.get().qvel, self.model.nv() as i32) }
    }

    /// Returns the controls.
    pub fn ctrl(&self) -> &[f64] {
        // SAFETY: ctrl holds nu numbers.
        unsafe { slice_of(self.get().ctrl, self.model.nu() as i32) }
    }

    /// Returns the controls for writing.
    pub fn ctrl_mut(&mut self) -> &mut [f64] {
        // SAFETY: ctrl holds nu numbers, and `&mut self` excludes other views.
        unsafe { slice_of_mut(self.get().ctrl, self.model.nu()) }
    }

    /// Sets the force that acts at a body's centre of mass in every step, until it is set again or the simulation is reset.
    ///
    /// # Units
    /// N, along the axes of the world.
    ///
    /// # Panics
    /// If the id is of another model that has more bodies.
    pub fn set_force(&mut self, id: BodyId, force: [f64; 3]) {
        // SAFETY: xfrc_applied holds three forces and three torques for each body, and `&mut self` excludes other views.
        let all = unsafe { slice_of_mut(self.get().xfrc_applied, 6 * self.model.nbody()) };
        all[6 * id.0..6 * id.0 + 3].copy_from_slice(&force);
    }

    /// Returns a body's position in the world, in m.
    pub fn body_position(&self, id: BodyId) -> Vector3<f64> {
        // SAFETY: xpos holds three numbers for each body.
        let all = unsafe { slice_of(self.get().xpos, 3 * self.model.nbody() as i32) };
        Vector3::from_column_slice(&all[3 * id.0..3 * id.0 + 3])
    }

    /// Returns a body's orientation in the world.
    pub fn body_orientation(&self, id: BodyId) -> UnitQuaternion<f64> {
        // SAFETY: xquat holds four numbers for each body.
        let all = unsafe { slice_of(self.get().xquat, 4 * self.model.nbody() as i32) };
        let q = &all[4 * id.0..4 * id.0 + 4];
        UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]))
    }

    /// Returns a site's position in the world, in m.
    pub fn site_position(&self, id: SiteId) -> Vector3<f64> {
        // SAFETY: site_xpos holds three numbers for each site.
        let all = unsafe { slice_of(self.get().site_xpos, 3 * self.model.nsite() as i32) };
        Vector3::from_column_slice(&all[3 * id.0..3 * id.0 + 3])
    }

    /// Returns a geom's position in the world, in m.
    pub fn geom_position(&self, id: GeomId) -> Vector3<f64> {
        // SAFETY: geom_xpos holds three numbers for each geom.
        let all = unsafe { slice_of(self.get().geom_xpos, 3 * self.model.ngeom() as i32) };
        Vector3::from_column_slice(&all[3 * id.0..3 * id.0 + 3])
    }

    /// Returns a geom's orientation in the world, as a matrix.
    pub fn geom_orientation(&self, id: GeomId) -> Matrix3<f64> {
        // SAFETY: geom_xmat holds nine numbers for each geom, row by row.
        let all = unsafe { slice_of(self.get().geom_xmat, 9 * self.model.ngeom() as i32) };
        Matrix3::from_row_slice(&all[9 * id.0..9 * id.0 + 9])
    }

    /// Lists the contacts that the constraint solver acts on.
    pub fn contacts(&self) -> impl Iterator<Item = Contact> + '_ {
        // SAFETY: `contact` holds ncon entries.
        let contacts: &[mjContact] = unsafe { slice_of(self.get().contact, self.get().ncon) };
        contacts
            .iter()
            .filter(|c| c.efc_address >= 0 && c.geom1 >= 0 && c.geom2 >= 0)
            .map(|c| Contact { geoms: [GeomId(c.geom1 as usize), GeomId(c.geom2 as usize)], distance: c.dist })
    }

    /// Returns the warnings raised since the last reset.
    pub fn warnings(&self) -> WarningCounts {
        let count = |kind: mj::mjtWarning_| self.get().warning[kind as usize].number.max(0) as u64;
        WarningCounts {
            bad_state: count(mj::mjWARN_BADQPOS)
                + count(mj::mjWARN_BADQVEL)
                + count(mj::mjWARN_BADQACC)
                + count(mj::mjWARN_BADCTRL),
            contacts_full: count(mj::mjWARN_CONTACTFULL),
            constraints_full: count(mj::mjWARN_CNSTRFULL),
            inertia: count(mj::mjWARN_INERTIA),
        }
    }

    /// Returns the name of the joint whose position, velocity or acceleration was not finite or too large at the last reset
    /// that MuJoCo made because of it; none without one, or if the joint has no name.
    pub fn bad_joint(&self) -> Option<String> {
        let raised = |kind: mj::mjtWarning_| {
            let warning = &self.get().warning[kind as usize];
            (warning.number > 0).then(|| usize::try_from(warning.lastinfo).ok()).flatten()
        };
        let model = self.model();
        let joint = match raised(mj::mjWARN_BADQPOS) {
            Some(i) => model.joints().filter(|joint| model.qpos_address(*joint) <= i).last(),
            None => {
                let i = raised(mj::mjWARN_BADQVEL).or_else(|| raised(mj::mjWARN_BADQACC))?;
                model.joints().filter(|joint| model.dof_address(*joint) <= i).last()
            }
        };
        joint.map(|joint| model.joint_name(joint)).filter(|name| !name.is_empty())
    }
}

/// Views `count` values from `first` for writing.
///
/// # Safety
/// Unless `count` is 0, `first` points at `count` initialised values that nothing else reads or writes
/// during `'a`.
pub(crate) unsafe fn slice_of_mut<'a, T>(first: *mut T, count: usize) -> &'a mut [T] {
    if count == 0 || first.is_null() {
        return &mut [];
    }
    // SAFETY: the caller promises this.
    unsafe { std::slice::from_raw_parts_mut(first, count) }
}
