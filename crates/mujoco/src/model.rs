//! The owner of an `mjModel`.

use std::ffi::{CStr, CString, c_char};
use std::ptr::NonNull;
use std::sync::Arc;

use crate::MuJoCoError;
use crate::bindings::{self as mj, mjModel, mjVFS};
use crate::{ActuatorId, BodyId, GeomId, JointId, MuJoCo, SiteId};

const SCENE_FILE: &str = "scene.xml";
const ERROR_CAPACITY: usize = 1024;

/// A compiled model, shared by many [`Data`](crate::Data). It is immutable, except through the only
/// [`Data`](crate::Data) that holds it.
pub struct Model {
    pub(crate) library: Arc<MuJoCo>,
    pub(crate) raw: NonNull<mjModel>,
}

// SAFETY: the model is written through `&mut Model` alone, and MuJoCo's other functions take it as const.
unsafe impl Send for Model {}
// SAFETY: as above.
unsafe impl Sync for Model {}

impl Drop for Model {
    fn drop(&mut self) {
        // SAFETY: `raw` came from `mj_loadXML` or `mj_copyModel`, is owned here and is not used again.
        unsafe { (self.library.api.mj_deleteModel)(self.raw.as_ptr()) }
    }
}

impl Model {
    /// Compiles a model from MJCF text and the files it names, all in memory.
    ///
    /// # Errors
    /// [`MuJoCoError::Compile`] with MuJoCo's message, [`MuJoCoError::Asset`] for a file that its virtual file
    /// system cannot hold.
    pub fn from_xml(library: &Arc<MuJoCo>, xml: &str, assets: &[(String, Vec<u8>)]) -> Result<Model, MuJoCoError> {
        let mut files = VirtualFiles::new(library);
        files.add(SCENE_FILE, xml.as_bytes())?;
        for (name, bytes) in assets {
            let unsound = |reason| MuJoCoError::Asset { name: name.clone(), reason };
            crate::assets::check(xml, name, bytes).map_err(unsound)?;
            files.add(name, bytes)?;
        }
        let scene = c_name(SCENE_FILE)?;
        let mut message = [0 as c_char; ERROR_CAPACITY];
        // SAFETY: the file name is NUL-terminated, the file system is filled, and the error buffer's
        // length is passed with it.
        let raw = unsafe {
            (library.api.mj_loadXML)(scene.as_ptr(), &*files.raw, message.as_mut_ptr(), ERROR_CAPACITY as i32)
        };
        let Some(raw) = NonNull::new(raw) else {
            // SAFETY: MuJoCo terminates the message within the buffer.
            let message = unsafe { CStr::from_ptr(message.as_ptr()) }.to_string_lossy().trim().to_owned();
            return Err(MuJoCoError::Compile { message });
        };
        Ok(Model { library: Arc::clone(library), raw })
    }

    pub(crate) fn get(&self) -> &mjModel {
        // SAFETY: `raw` is a valid model for as long as `self` lives, and `&self` excludes a writer.
        unsafe { self.raw.as_ref() }
    }

    /// Returns the number of generalised coordinates.
    pub fn nq(&self) -> usize {
        self.get().nq as usize
    }

    /// Returns the number of degrees of freedom.
    pub fn nv(&self) -> usize {
        self.get().nv as usize
    }

    /// Returns the number of actuators.
    pub fn nu(&self) -> usize {
        self.get().nu as usize
    }

    /// Returns the number of geoms.
    pub fn ngeom(&self) -> usize {
        self.get().ngeom as usize
    }

    /// Returns the number of bodies, the world included.
    pub fn nbody(&self) -> usize {
        self.get().nbody as usize
    }

    /// Returns the number of sites.
    pub fn nsite(&self) -> usize {
        self.get().nsite as usize
    }

    /// Returns the integration step in seconds.
    pub fn timestep(&self) -> f64 {
        self.get().opt.timestep
    }

    /// Resolves a joint's name.
    ///
    /// # Errors
    /// [`MuJoCoError::Unresolved`] when the model has no such joint; the same for the functions below.
    pub fn joint(&self, name: &str) -> Result<JointId, MuJoCoError> {
        self.find(mj::mjOBJ_JOINT, "joint", name).map(JointId)
    }

    /// Resolves a body's name.
    pub fn body(&self, name: &str) -> Result<BodyId, MuJoCoError> {
        self.find(mj::mjOBJ_BODY, "body", name).map(BodyId)
    }

    /// Resolves a geom's name.
    pub fn geom(&self, name: &str) -> Result<GeomId, MuJoCoError> {
        self.find(mj::mjOBJ_GEOM, "geom", name).map(GeomId)
    }

    /// Resolves a site's name.
    pub fn site(&self, name: &str) -> Result<SiteId, MuJoCoError> {
        self.find(mj::mjOBJ_SITE, "site", name).map(SiteId)
    }

    /// Resolves an actuator's name.
    pub fn actuator(&self, name: &str) -> Result<ActuatorId, MuJoCoError> {
        self.find(mj::mjOBJ_ACTUATOR, "actuator", name).map(ActuatorId)
    }

    /// Lists the actuators in the order of `ctrl`.
    pub fn actuators(&self) -> impl Iterator<Item = ActuatorId> {
        (0..self.nu()).map(ActuatorId)
    }

    /// Returns an actuator's name, empty when it has none.
    pub fn actuator_name(&self, id: ActuatorId) -> String {
        self.name(mj::mjOBJ_ACTUATOR, id.0)
    }

    /// Returns a geom's name, empty when it has none.
    pub fn geom_name(&self, id: GeomId) -> String {
        self.name(mj::mjOBJ_GEOM, id.0)
    }

    /// Returns a body's name, empty when it has none.
    pub fn body_name(&self, id: BodyId) -> String {
        self.name(mj::mjOBJ_BODY, id.0)
    }

    /// Returns the index of a joint's first coordinate in `qpos`.
    pub fn qpos_address(&self, id: JointId) -> usize {
        self.ints(self.get().jnt_qposadr, self.get().njnt)[id.0] as usize
    }

    /// Returns the index of a joint's first degree of freedom in `qvel`.
    pub fn dof_address(&self, id: JointId) -> usize {
        self.ints(self.get().jnt_dofadr, self.get().njnt)[id.0] as usize
    }

    /// Returns a joint's limits, if it is limited.
    ///
    /// # Units
    /// rad or m.
    pub fn joint_range(&self, id: JointId) -> Option<(f64, f64)> {
        let limited = self.bytes(self.get().jnt_limited, self.get().njnt)[id.0] != 0;
        let range = self.numbers(self.get().jnt_range, 2 * self.get().njnt);
        limited.then(|| (range[2 * id.0], range[2 * id.0 + 1]))
    }

    /// Returns an actuator's control range, if it is limited.
    pub fn control_range(&self, id: ActuatorId) -> Option<(f64, f64)> {
        let limited = self.bytes(self.get().actuator_ctrllimited, self.get().nu)[id.0] != 0;
        let range = self.numbers(self.get().actuator_ctrlrange, 2 * self.get().nu);
        limited.then(|| (range[2 * id.0], range[2 * id.0 + 1]))
    }

    /// Returns the body to which a geom belongs.
    pub fn geom_body(&self, id: GeomId) -> BodyId {
        BodyId(self.ints(self.get().geom_bodyid, self.get().ngeom)[id.0] as usize)
    }

    /// Tells for every geom whether it belongs to `root` or to a descendant of `root`.
    pub fn geoms_below(&self, root: BodyId) -> Vec<bool> {
        let parents = self.ints(self.get().body_parentid, self.get().nbody);
        let mut below = vec![false; self.nbody()];
        for body in 0..self.nbody() {
            // A parent always precedes its children, and the world is its own parent.
            below[body] = body == root.0 || (body != 0 && below[parents[body] as usize]);
        }
        self.ints(self.get().geom_bodyid, self.get().ngeom).iter().map(|&body| below[body as usize]).collect()
    }

    /// Returns the body that carries a site.
    pub fn site_body(&self, id: SiteId) -> BodyId {
        BodyId(self.ints(self.get().site_bodyid, self.get().nsite)[id.0] as usize)
    }

    /// Returns a body's own mass in kg.
    pub fn body_mass(&self, id: BodyId) -> f64 {
        self.numbers(self.get().body_mass, self.get().nbody)[id.0]
    }

    /// Returns a body's principal moments of inertia in kg m2.
    pub fn principal_inertia(&self, id: BodyId) -> [f64; 3] {
        let moments = self.numbers(self.get().body_inertia, 3 * self.get().nbody);
        std::array::from_fn(|i| moments[3 * id.0 + i])
    }

    /// Returns the orientation of a body's principal axes of inertia in the body's frame, as w, x, y, z.
    pub fn principal_axes(&self, id: BodyId) -> [f64; 4] {
        let quaternions = self.numbers(self.get().body_iquat, 4 * self.get().nbody);
        std::array::from_fn(|i| quaternions[4 * id.0 + i])
    }

    /// Returns the mass of a body with all its descendants, in kg.
    pub fn subtree_mass(&self, id: BodyId) -> f64 {
        self.numbers(self.get().body_subtreemass, self.get().nbody)[id.0]
    }

    /// Returns the default configuration.
    pub fn qpos0(&self) -> &[f64] {
        self.numbers(self.get().qpos0, self.get().nq)
    }

    fn find(&self, kind: mj::mjtObj_, what: &'static str, name: &str) -> Result<usize, MuJoCoError> {
        let unresolved = || MuJoCoError::Unresolved { what, name: name.to_owned() };
        let c_name = CString::new(name).map_err(|_| unresolved())?;
        // SAFETY: the model is valid and the name NUL-terminated.
        let id = unsafe { (self.library.api.mj_name2id)(self.raw.as_ptr(), kind as i32, c_name.as_ptr()) };
        usize::try_from(id).map_err(|_| unresolved())
    }

    pub(crate) fn name(&self, kind: mj::mjtObj_, index: usize) -> String {
        // SAFETY: the model is valid; MuJoCo answers null for an index without a name.
        unsafe {
            let name = (self.library.api.mj_id2name)(self.raw.as_ptr(), kind as i32, index as i32);
            if name.is_null() { String::new() } else { CStr::from_ptr(name).to_string_lossy().into_owned() }
        }
    }

    pub(crate) fn numbers(&self, first: *const f64, count: i32) -> &[f64] {
        // SAFETY: callers pass an array of this model with its own length.
        unsafe { slice_of(first, count) }
    }

    pub(crate) fn ints(&self, first: *const i32, count: i32) -> &[i32] {
        // SAFETY: callers pass an array of this model with its own length.
        unsafe { slice_of(first, count) }
    }

    fn bytes(&self, first: *const u8, count: i32) -> &[u8] {
        // SAFETY: callers pass an array of this model with its own length.
        unsafe { slice_of(first, count) }
    }
}

/// Views `count` values from `first`; an empty MuJoCo array may be null.
///
/// # Safety
/// Unless `count` is 0, `first` points at `count` initialised values that stay alive and unchanged
/// during `'a`.
pub(crate) unsafe fn slice_of<'a, T>(first: *const T, count: i32) -> &'a [T] {
    if count <= 0 || first.is_null() {
        return &[];
    }
    // SAFETY: the caller promises this.
    unsafe { std::slice::from_raw_parts(first, count as usize) }
}

fn c_name(name: &str) -> Result<CString, MuJoCoError> {
    CString::new(name)
        .map_err(|_| MuJoCoError::Asset { name: name.to_owned(), reason: "the name holds a NUL byte".to_owned() })
}

/// MuJoCo's in-memory file system, filled before a model is compiled.
struct VirtualFiles<'a> {
    library: &'a MuJoCo,
    raw: Box<mjVFS>,
}

impl<'a> VirtualFiles<'a> {
    fn new(library: &'a MuJoCo) -> Self {
        // SAFETY: an all-zero mjVFS is a valid value (integers and null pointers), and the box is
        // allocated on the heap at once because the struct is two megabytes large.
        let mut raw: Box<mjVFS> = unsafe { Box::<mjVFS>::new_zeroed().assume_init() };
        // SAFETY: `raw` is a valid file system to initialise.
        unsafe { (library.api.mj_defaultVFS)(&mut *raw) };
        VirtualFiles { library, raw }
    }

    fn add(&mut self, name: &str, bytes: &[u8]) -> Result<(), MuJoCoError> {
        let refuse = |reason: &str| MuJoCoError::Asset { name: name.to_owned(), reason: reason.to_owned() };
        let c_name = c_name(name)?;
        if name.len() >= self.raw.filename[0].len() {
            return Err(refuse("the name is too long for MuJoCo"));
        }
        let size = i32::try_from(bytes.len()).map_err(|_| refuse("the file is larger than 2 GiB"))?;
        if size == 0 {
            return Err(refuse("the file is empty"));
        }
        // SAFETY: the file system is valid and the name NUL-terminated and short enough.
        let status = unsafe { (self.library.api.mj_makeEmptyFileVFS)(&mut *self.raw, c_name.as_ptr(), size) };
        match status {
            0 => {}
            1 => return Err(refuse("there are more files than MuJoCo's virtual file system holds")),
            2 => return Err(refuse("two files have the same name")),
            _ => return Err(refuse("MuJoCo could not store it")),
        }
        let slot = self.raw.nfile as usize - 1;
        // SAFETY: MuJoCo has just allocated `size` bytes for the last slot.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), self.raw.filedata[slot].cast::<u8>(), bytes.len()) };
        Ok(())
    }
}

impl Drop for VirtualFiles<'_> {
    fn drop(&mut self) {
        // SAFETY: the file system is valid and not used again.
        unsafe { (self.library.api.mj_deleteVFS)(&mut *self.raw) }
    }
}
