//! COLLADA: the triangles of the scene's geometries, in metres.

use std::collections::HashMap;
use std::path::Path;

use nalgebra::{Matrix4, Rotation3, Translation3, Unit};
use xmltree::Element;

use super::triangles::{Mesh, Point, push_fan};
use crate::xml::{self, elements};

/// Deepest nesting of nodes, including instances of nodes.
const MAX_DEPTH: usize = 50;

/// Most nodes and triangles that are read; instances of nodes can multiply them without end.
const MAX_NODES: usize = 100_000;
const MAX_TRIANGLES: usize = 4_000_000;

/// Reads the scene of a file. `up_axis` is ignored, as viewers of robots ignore it.
pub(super) fn read(bytes: &[u8]) -> Result<Mesh, String> {
    let root = xml::parse(&xml::decode(bytes).0, Path::new("COLLADA")).map_err(|e| e.to_string())?;
    if root.name != "COLLADA" {
        return Err(format!("<{}> as the root element", root.name));
    }
    let mut ids = HashMap::new();
    index(&root, &mut ids);
    let asset = root.get_child("asset");
    let unit = asset.and_then(|a| a.get_child("unit")).and_then(|u| u.attributes.get("meter"));
    let unit = unit.and_then(|m| m.trim().parse().ok()).filter(|m: &f64| m.is_finite() && *m > 0.0).unwrap_or(1.0);
    let mut scene = Scene { ids, mesh: Mesh::default(), n_nodes: 0 };
    for library in elements(&root).filter(|e| e.name == "library_visual_scenes") {
        for visual in elements(library).filter(|e| e.name == "visual_scene") {
            scene.add_node(visual, &Matrix4::new_scaling(unit), 0)?;
        }
    }
    let up = asset.and_then(|a| a.get_child("up_axis")).and_then(Element::get_text);
    let up = up.map(|up| up.trim().to_owned()).filter(|up| up != "Z_UP");
    scene.mesh.note = up.map(|up| format!("meshes that say {up} were not rotated"));
    Ok(scene.mesh)
}

fn index<'a>(element: &'a Element, ids: &mut HashMap<&'a str, &'a Element>) {
    for child in elements(element) {
        if let Some(id) = child.attributes.get("id") {
            ids.insert(id, child);
        }
        index(child, ids);
    }
}

struct Scene<'a> {
    ids: HashMap<&'a str, &'a Element>,
    mesh: Mesh,
    n_nodes: usize,
}

impl<'a> Scene<'a> {
    fn find(&self, element: &Element, key: &str) -> Result<&'a Element, String> {
        let url = element.attributes.get(key).map_or("", String::as_str);
        let id = url.strip_prefix('#').unwrap_or(url);
        self.ids.get(id).copied().ok_or_else(|| format!("<{} {key}=\"{url}\">, which is not in the file", element.name))
    }

    fn add_node(&mut self, node: &'a Element, above: &Matrix4<f64>, depth: usize) -> Result<(), String> {
        self.n_nodes += 1;
        if depth > MAX_DEPTH || self.n_nodes > MAX_NODES {
            return Err(format!("more than {MAX_NODES} nodes, or nodes nested deeper than {MAX_DEPTH}"));
        }
        let mut pose = *above;
        for child in elements(node) {
            match child.name.as_str() {
                "matrix" | "translate" | "rotate" | "scale" => pose *= transform(child)?,
                "node" => self.add_node(child, &pose, depth + 1)?,
                "instance_node" => self.add_node(self.find(child, "url")?, &pose, depth + 1)?,
                "instance_geometry" => {
                    let geometry = self.find(child, "url")?;
                    for mesh in elements(geometry).filter(|e| e.name == "mesh") {
                        self.add_mesh(mesh, &pose)?;
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn add_mesh(&mut self, mesh: &'a Element, pose: &Matrix4<f64>) -> Result<(), String> {
        let mirrored = pose.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        for faces in elements(mesh) {
            let polygons = match faces.name.as_str() {
                "triangles" | "polylist" | "polygons" | "tristrips" | "trifans" => self.polygons(faces)?,
                _ => continue,
            };
            for mut corners in polygons {
                for corner in &mut corners {
                    *corner = pose.transform_point(&(*corner).into()).coords;
                }
                if mirrored {
                    corners.reverse();
                }
                push_fan(&mut self.mesh.triangles, &corners);
            }
            if self.mesh.triangles.len() > MAX_TRIANGLES {
                return Err(format!("more than {MAX_TRIANGLES} faces"));
            }
        }
        Ok(())
    }

    /// Returns the corners of every polygon in an element of faces.
    fn polygons(&self, faces: &Element) -> Result<Vec<Vec<Point>>, String> {
        let offset = |input: &Element| input.attributes.get("offset").and_then(|o| o.parse().ok()).unwrap_or(0_usize);
        let inputs = || elements(faces).filter(|e| e.name == "input");
        let Some(input) = inputs().find(|i| i.attributes.get("semantic").is_some_and(|s| s == "VERTEX")) else {
            return Ok(Vec::new());
        };
        let stride = inputs().map(offset).max().unwrap_or(0).saturating_add(1);
        let vertices = self.positions(self.find(input, "source")?)?;
        let corner = |indices: &[usize]| {
            let place = indices.get(offset(input)).copied().unwrap_or(usize::MAX);
            vertices.get(place).copied().ok_or_else(|| format!("<{}> with vertex {place}", faces.name))
        };
        let mut polygons = Vec::new();
        for p in elements(faces).filter(|e| e.name == "p") {
            let indices: Vec<usize> = numbers(p)?;
            let corners: Vec<Point> = indices.chunks_exact(stride).map(corner).collect::<Result<_, _>>()?;
            match faces.name.as_str() {
                "triangles" => polygons.extend(corners.chunks_exact(3).map(<[Point]>::to_vec)),
                "polylist" => {
                    let mut rest = &corners[..];
                    for count in faces.get_child("vcount").map(numbers::<usize>).transpose()?.unwrap_or_default() {
                        let (polygon, after) =
                            rest.split_at_checked(count).ok_or("a <polylist> with too few corners")?;
                        polygons.push(polygon.to_vec());
                        rest = after;
                    }
                }
                "tristrips" => polygons.extend(corners.windows(3).enumerate().map(|(i, w)| match i % 2 {
                    0 => w.to_vec(),
                    _ => vec![w[1], w[0], w[2]],
                })),
                _ => polygons.push(corners),
            }
        }
        Ok(polygons)
    }

    fn positions(&self, vertices: &Element) -> Result<Vec<Point>, String> {
        let input = elements(vertices)
            .find(|i| i.attributes.get("semantic").is_some_and(|s| s == "POSITION"))
            .ok_or("<vertices> without positions")?;
        let source = self.find(input, "source")?;
        let array = source.get_child("float_array").ok_or("a <source> without <float_array>")?;
        let accessor = source.get_child("technique_common").and_then(|t| t.get_child("accessor"));
        let stride = accessor.and_then(|a| a.attributes.get("stride")).and_then(|s| s.parse().ok()).unwrap_or(3_usize);
        let values: Vec<f64> = numbers(array)?;
        Ok(values.chunks_exact(stride.max(3)).map(|v| Point::new(v[0], v[1], v[2])).collect())
    }
}

fn transform(element: &Element) -> Result<Matrix4<f64>, String> {
    let values: Vec<f64> = numbers(element)?;
    match (element.name.as_str(), &values[..]) {
        ("matrix", values) if values.len() == 16 => Ok(Matrix4::from_row_slice(values)),
        ("translate", &[x, y, z]) => Ok(Translation3::new(x, y, z).to_homogeneous()),
        ("scale", &[x, y, z]) => Ok(Matrix4::new_nonuniform_scaling(&Point::new(x, y, z))),
        ("rotate", &[x, y, z, degrees]) => Ok(Unit::try_new(Point::new(x, y, z), 0.0)
            .map_or_else(Matrix4::identity, |axis| {
                Rotation3::from_axis_angle(&axis, degrees.to_radians()).to_homogeneous()
            })),
        (name, values) => Err(format!("<{name}> with {} numbers", values.len())),
    }
}

fn numbers<T: std::str::FromStr>(element: &Element) -> Result<Vec<T>, String> {
    let text = element.get_text().unwrap_or_default();
    text.split_whitespace().map(|word| word.parse().map_err(|_| format!("<{}> with `{word}`", element.name))).collect()
}
