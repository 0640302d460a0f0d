//! Reads triangles from STL, OBJ and COLLADA files, and writes STL for MuJoCo 2.2.2.

mod collada;
mod obj;
mod stl;
mod triangles;

pub(super) use triangles::Mesh;

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
}
