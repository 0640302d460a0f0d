//! Reads triangles from STL, OBJ and COLLADA files, and writes STL for MuJoCo 2.2.2.

mod changes;
mod collada;
mod obj;
mod stl;
mod triangles;

pub(super) use changes::Changes;
pub(super) use triangles::{MAX_FACES, Mesh};

/// The kinds of mesh that are read, and the way out for others.
pub(super) const READABLE: &str = "an STL, OBJ or COLLADA (.dae) mesh (convert other kinds to STL with Blender or \
                                   `assimp export IN OUT.stl`, and name the STL in the model)";
/// Half of the thickness of the box that takes the place of a flat mesh (m).
pub(super) const MIN_HALF: f64 = 0.0005;

impl Mesh {
    /// Reads a file; its `extension` names the format.
    ///
    /// # Errors
    /// The fault, phrased to follow "expected ..., got".
    pub(super) fn read(bytes: &[u8], extension: &str) -> Result<Self, String> {
        let mesh = match extension.to_lowercase().as_str() {
            "stl" => stl::read(bytes)?,
            "obj" => obj::read(bytes)?,
            "dae" => collada::read(bytes)?,
            other => return Err(format!("a file of kind `{other}`")),
        };
        if mesh.triangles.is_empty() {
            return Err("a file without faces".to_owned());
        }
        if !mesh.points().all(|p| p.iter().all(|x| x.abs() < 1e9)) {
            return Err("a vertex that is not finite".to_owned());
        }
        Ok(mesh)
    }

    /// Returns the mesh as a binary STL.
    pub(super) fn to_stl(&self) -> Vec<u8> {
        stl::write(&self.triangles)
    }

    /// Returns true if MuJoCo 2.2.2 reads the bytes of such a file itself.
    pub(super) fn is_native(&self, bytes: &[u8], extension: &str) -> bool {
        match extension.to_lowercase().as_str() {
            "stl" => stl::is_exact(bytes),
            // MuJoCo refuses an OBJ file with neighbouring faces that run through their edge in the same direction.
            "obj" => self.is_oriented(),
            _ => false,
        }
    }
}
