//! OBJ: vertices and faces, all groups as one mesh.

use super::triangles::{Mesh, Point, push_fan};

/// Reads the faces of a file; normals, texture coordinates and materials are not used.
pub(super) fn read(bytes: &[u8]) -> Result<Mesh, String> {
    let text = String::from_utf8_lossy(bytes);
    let mut vertices: Vec<Point> = Vec::new();
    let mut mesh = Mesh::default();
    let mut corners = Vec::new();
    for (number, line) in text.replace("\\\r\n", " ").replace("\\\n", " ").lines().enumerate() {
        let wrong = |what: &str| format!("line {}: {what}", number + 1);
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let mut point = Point::zeros();
                for x in point.iter_mut() {
                    let word = words.next().and_then(|w| w.parse().ok());
                    *x = word.ok_or_else(|| wrong("a vertex that is not three numbers"))?;
                }
                vertices.push(point);
            }
            Some("f") => {
                corners.clear();
                for word in words {
                    let corner = vertex(word, vertices.len()).and_then(|i| vertices.get(i));
                    corners.push(*corner.ok_or_else(|| wrong(&format!("a face with the corner `{word}`")))?);
                }
                push_fan(&mut mesh.triangles, &corners);
            }
            _ => {}
        }
    }
    Ok(mesh)
}

/// Reads the index of a vertex from `7`, `7/1`, `7//3` or, counted from the last vertex, `-1`.
fn vertex(word: &str, n_vertices: usize) -> Option<usize> {
    let number: i64 = word.split('/').next()?.parse().ok()?;
    match number {
        0 => None,
        1.. => usize::try_from(number - 1).ok(),
        _ => n_vertices.checked_sub(usize::try_from(number.unsigned_abs()).ok()?),
    }
}
