//! Convex meshes, read from OBJ or STL.

use std::fmt::Write;

use nalgebra::Vector3;

/// Bytes before the triangles of a binary STL, and bytes of each triangle.
const STL_HEAD: usize = 84;
const STL_TRIANGLE: usize = 50;
/// Distance by which a vertex may lie outside a face, as a share of the mesh's size.
const FLATNESS: f64 = 1e-3;

/// A closed convex mesh about its centre of mass, with lengths in m.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexMesh {
    vertices: Vec<Vector3<f64>>,
    triangles: Vec<[usize; 3]>,
}

impl ConvexMesh {
    /// Reads a mesh in OBJ or STL by the file's extension, and moves its centre of mass to the origin.
    ///
    /// # Errors
    /// Says what is wrong, and what is expected.
    pub fn parse(extension: &str, bytes: &[u8]) -> Result<ConvexMesh, String> {
        let mesh = match extension.to_lowercase().as_str() {
            "obj" => parse_obj(&String::from_utf8_lossy(bytes))?,
            "stl" => parse_stl(bytes)?,
            _ => return Err("expected a file that ends with .obj or .stl".to_owned()),
        };
        mesh.centred()
    }

    /// Returns the mesh with its lengths multiplied by `factor`.
    pub fn scaled(&self, factor: f64) -> ConvexMesh {
        let vertices = self.vertices.iter().map(|v| v * factor).collect();
        ConvexMesh { vertices, triangles: self.triangles.clone() }
    }

    /// Returns how far the mesh reaches from its centre of mass in a direction of length 1, in m.
    pub fn extent(&self, direction: &Vector3<f64>) -> f64 {
        self.vertices.iter().map(|v| v.dot(direction)).fold(0.0, f64::max)
    }

    /// Returns the text of an OBJ file.
    pub fn to_obj(&self) -> String {
        let mut text = String::new();
        for v in &self.vertices {
            let _ = writeln!(text, "v {} {} {}", v.x, v.y, v.z);
        }
        for [a, b, c] in &self.triangles {
            let _ = writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1);
        }
        text
    }

    /// Turns every face outwards, and moves the centre of mass to the origin.
    fn centred(mut self) -> Result<ConvexMesh, String> {
        if self.triangles.len() < 4 {
            return Err("expected at least four triangles".to_owned());
        }
        let inside = self.vertices.iter().sum::<Vector3<f64>>() / self.vertices.len() as f64;
        let size = self.vertices.iter().map(|v| (v - inside).norm()).fold(0.0, f64::max);
        let (mut volume, mut moment) = (0.0, Vector3::zeros());
        for triangle in &mut self.triangles {
            let [a, b, c] = triangle.map(|i| self.vertices[i] - inside);
            let normal = (b - a).cross(&(c - a));
            let Some(unit) = normal.try_normalize(0.0) else { continue };
            let outward = if unit.dot(&a) < 0.0 { -unit } else { unit };
            if outward != unit {
                triangle.swap(1, 2);
            }
            let farthest = self.vertices.iter().map(|v| (v - inside - a).dot(&outward)).fold(0.0, f64::max);
            if farthest > FLATNESS * size {
                return Err("expected a convex mesh, but a corner lies outside one of the faces".to_owned());
            }
            let six_volumes = normal.dot(&a).abs();
            volume += six_volumes;
            moment += (a + b + c) / 4.0 * six_volumes;
        }
        if !(volume > 0.0 && volume.is_finite()) {
            return Err("expected a mesh with a volume".to_owned());
        }
        let centre = inside + moment / volume;
        self.vertices.iter_mut().for_each(|v| *v -= centre);
        Ok(self)
    }
}

fn parse_obj(text: &str) -> Result<ConvexMesh, String> {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for (number, line) in text.lines().enumerate() {
        let wrong = |expected: &str| format!("line {}: expected {expected}", number + 1);
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let numbers: Vec<f64> = words.take(3).filter_map(|word| word.parse().ok()).collect();
                let [x, y, z] = numbers[..] else { return Err(wrong("v and three numbers")) };
                vertices.push(Vector3::new(x, y, z));
            }
            Some("f") => {
                let corner = |word: &str| -> Option<usize> {
                    word.split('/').next()?.parse::<usize>().ok()?.checked_sub(1).filter(|&i| i < vertices.len())
                };
                let corners: Option<Vec<usize>> = words.map(corner).collect();
                let corners = corners.filter(|corners| corners.len() >= 3);
                let corners = corners.ok_or_else(|| wrong("f and at least three numbers of corners above"))?;
                triangles.extend((1..corners.len() - 1).map(|i| [corners[0], corners[i], corners[i + 1]]));
            }
            _ => {}
        }
    }
    Ok(ConvexMesh { vertices, triangles })
}

fn parse_stl(bytes: &[u8]) -> Result<ConvexMesh, String> {
    let count = bytes.get(80..STL_HEAD).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let corners: Vec<Vector3<f64>> = if bytes.len() == STL_HEAD + STL_TRIANGLE * count {
        let number = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let corner = |b: &[u8]| Vector3::new(number(&b[0..4]), number(&b[4..8]), number(&b[8..12]));
        bytes[STL_HEAD..].chunks_exact(STL_TRIANGLE).flat_map(|t| t[12..48].chunks_exact(12).map(corner)).collect()
    } else {
        let text = String::from_utf8_lossy(bytes);
        let numbers = |line: &str| -> Option<Vector3<f64>> {
            let mut words = line.trim().strip_prefix("vertex")?.split_whitespace().map(|w| w.parse().ok());
            Some(Vector3::new(words.next()??, words.next()??, words.next()??))
        };
        text.lines().filter_map(numbers).collect()
    };
    if corners.is_empty() || !corners.len().is_multiple_of(3) {
        return Err("expected an STL file, as text or binary".to_owned());
    }
    let mut vertices: Vec<Vector3<f64>> = Vec::new();
    let mut index = |corner: &Vector3<f64>| {
        vertices.iter().position(|v| v == corner).unwrap_or_else(|| {
            vertices.push(*corner);
            vertices.len() - 1
        })
    };
    let triangles = corners.chunks_exact(3).map(|t| [index(&t[0]), index(&t[1]), index(&t[2])]).collect();
    Ok(ConvexMesh { vertices, triangles })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TETRAHEDRON: &str = "v 1 0 0\nv 2 0 0\nv 1 1 0\nv 1 0 1\nf 1 2 3\nf 1 2 4\nf 1 4/1/1 3\nf 2 3 4\n";

    #[test]
    fn the_centre_of_mass_becomes_the_origin() {
        let mesh = ConvexMesh::parse("obj", TETRAHEDRON.as_bytes()).expect("a sound mesh");
        for direction in [Vector3::x(), Vector3::y(), Vector3::z()] {
            assert!((mesh.extent(&direction) - 0.75).abs() < 1e-12);
            assert!((mesh.extent(&-direction) - 0.25).abs() < 1e-12);
        }
        assert_eq!(ConvexMesh::parse("OBJ", mesh.to_obj().as_bytes()).map(|m| m.triangles), Ok(mesh.triangles.clone()));
        let solid: String = mesh
            .triangles
            .iter()
            .flat_map(|t| t.map(|i| mesh.vertices[i]))
            .map(|v| format!("vertex {} {} {}\n", v.x, v.y, v.z))
            .collect();
        let stl = ConvexMesh::parse("stl", solid.as_bytes()).expect("a sound mesh");
        assert!((stl.extent(&Vector3::x()) - 0.75).abs() < 1e-12);
    }

    #[test]
    fn a_wrong_mesh_is_refused() {
        let dented = TETRAHEDRON.replace("f 2 3 4", "v 1.1 0.1 0.1\nf 2 3 5\nf 3 4 5\nf 4 2 5");
        for (extension, text, expected) in [
            ("obj", dented.as_str(), "convex"),
            ("obj", "v 1 2\n", "line 1: expected v and three numbers"),
            ("obj", "v 0 0 0\nf 1 2 3\n", "line 2"),
            ("obj", "", "four triangles"),
            ("stl", "solid", "STL"),
            ("dae", "", ".obj or .stl"),
        ] {
            let error = ConvexMesh::parse(extension, text.as_bytes()).expect_err(expected);
            assert!(error.contains(expected), "{error}");
        }
    }
}
