//! STL, binary and text.

use super::triangles::{Mesh, Point, push_fan};

const HEADER: usize = 80;
const COUNT: usize = 4;
const FACE: usize = 50;

/// Reads triangles; the normals in the file are not used.
pub(super) fn read(bytes: &[u8]) -> Result<Mesh, String> {
    match binary(bytes) {
        Some(mesh) => Ok(mesh),
        // A binary file may also begin with `solid`, so its length is checked first.
        None if bytes.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid")) => {
            text(&String::from_utf8_lossy(bytes))
        }
        None => Err("an STL file whose length does not match its number of faces".to_owned()),
    }
}

/// Returns true for a binary file whose length is exactly that of its faces.
pub(super) fn is_exact(bytes: &[u8]) -> bool {
    binary(bytes).is_some_and(|mesh| bytes.len() == HEADER + COUNT + FACE * mesh.triangles.len())
}

fn binary(bytes: &[u8]) -> Option<Mesh> {
    let count = u32::from_le_bytes(bytes.get(HEADER..HEADER + COUNT)?.try_into().ok()?) as usize;
    let faces = bytes[HEADER + COUNT..].chunks_exact(FACE);
    // Some writers append a few bytes.
    if count == 0 || faces.len() < count || faces.len() - count > 1 {
        return None;
    }
    let number = |face: &[u8], i: usize| {
        let mut word = [0; 4];
        word.copy_from_slice(&face[4 * i..4 * i + 4]);
        f64::from(f32::from_le_bytes(word))
    };
    // Three numbers of the normal come first.
    let corner = |face: &[u8], i: usize| Point::from_fn(|axis, _| number(face, 3 + 3 * i + axis));
    let triangles = faces.take(count).map(|face| [0, 1, 2].map(|i| corner(face, i))).collect();
    Some(Mesh { triangles, note: None })
}

fn text(text: &str) -> Result<Mesh, String> {
    let mut mesh = Mesh::default();
    let mut corners = Vec::new();
    let mut words = text.split_whitespace();
    while let Some(word) = words.next() {
        match word.to_ascii_lowercase().as_str() {
            "vertex" => {
                let mut point = Point::zeros();
                for x in point.iter_mut() {
                    *x = words.next().and_then(|w| w.parse().ok()).ok_or("a vertex that is not three numbers")?;
                }
                corners.push(point);
            }
            "endloop" => {
                push_fan(&mut mesh.triangles, &corners);
                corners.clear();
            }
            _ => {}
        }
    }
    Ok(mesh)
}

/// Writes triangles with their normals, no attributes.
pub(super) fn write(triangles: &[[Point; 3]]) -> Vec<u8> {
    let mut bytes = vec![0; HEADER];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for [a, b, c] in triangles {
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Point::zeros);
        for vector in [&normal, a, b, c] {
            vector.iter().for_each(|&x| bytes.extend((x as f32).to_le_bytes()));
        }
        bytes.extend([0; 2]);
    }
    bytes
}
