//! Draws the state of a simulation: geoms that hide one another, light, planes and shadows.

use eigenhand_mujoco::{Data, GeomId, GeomShape};
use nalgebra::{Matrix3, Vector3};

use crate::camera::Camera;
use crate::geoms::drawn_geoms;
use crate::picture::Picture;
use crate::raster::Lens;
use crate::shapes::{Triangle, surface};

/// Samples along each side of a pixel.
const SUPERSAMPLING: usize = 2;
/// Depth of the near plane, as a share of the camera's distance. Nothing nearer is seen.
const NEAR: f64 = 0.01;
/// Direction to the light in the camera's frame: behind the camera, above it and to its left.
const LIGHT: Vector3<f64> = Vector3::new(-0.6, 1.0, -0.5);
/// Least value of a surface's brightest colour channel. Without it, a black hand would be a silhouette.
const DARKEST: f64 = 0.3;
/// Brightness from ambient light, from the light at perpendicular incidence, from the camera at perpendicular view, and from the
/// table on faces that look down.
const AMBIENT: f64 = 0.35;
const DIFFUSE: f64 = 0.5;
const HEADLIGHT: f64 = 0.25;
const BOUNCE: f64 = 0.25;
pub(crate) const BACKGROUND: [f64; 3] = [0.93, 0.95, 0.97];
/// Least number of a plane's squares along the camera's distance.
const SQUARES: f64 = 10.0;
/// How much brighter and darker than the plane its squares are.
const SQUARE_CONTRAST: f64 = 0.05;
/// Depths at which a plane begins to fade and at which it has disappeared, in units of the camera's distance.
const FADE: [f64; 2] = [1.5, 6.0];
/// Darkness of the shadow of an object on the plane, and the height, in units of the camera's distance, at which the
/// darkness has fallen to 1/e.
const SHADOW: f64 = 0.6;
const SHADOW_HEIGHT: f64 = 0.12;

/// Draws the present state of a simulation. Call [`Data::forward`] first: it computes the dependent quantities.
///
/// Geoms are opaque. The light comes from beside the camera; the model's own lights are ignored. Planes have squares
/// and show shadows. Height fields, textures and skins are not drawn. The same state gives the same bytes.
pub fn draw(data: &Data, camera: &Camera, width: usize, height: usize) -> Picture {
    let mut canvas = Canvas::new(data, camera, width, height);
    canvas.draw();
    canvas.picture()
}

/// The samples of a picture while it is drawn.
struct Canvas<'a> {
    data: &'a Data,
    camera: Camera,
    axes: Matrix3<f64>,
    eye: Vector3<f64>,
    lens: Lens,
    colour: Vec<[f64; 3]>,
    depth: Vec<f64>,
}

impl<'a> Canvas<'a> {
    fn new(data: &'a Data, camera: &Camera, width: usize, height: usize) -> Canvas<'a> {
        let (width, height) = (SUPERSAMPLING * width, SUPERSAMPLING * height);
        let focal = height as f64 / 2.0 / camera.half_view(1.0)[1];
        Canvas {
            data,
            camera: *camera,
            axes: camera.axes(),
            eye: camera.position(),
            lens: Lens { width, height, focal, near: NEAR * camera.distance },
            colour: vec![BACKGROUND; width * height],
            depth: vec![f64::INFINITY; width * height],
        }
    }

    fn draw(&mut self) {
        let drawn = drawn_geoms(self.data.model());
        let surfaces: Vec<_> = drawn.iter().map(|&geom| surface(self.data, geom)).collect();
        for &geom in &drawn {
            if let GeomShape::Plane { half } = self.data.model().geom_shape(geom) {
                let heights = self.heights_above(geom, &surfaces);
                self.draw_plane(geom, half, &heights);
            }
        }
        for (&geom, triangles) in drawn.iter().zip(&surfaces) {
            self.draw_surface(self.data.model().geom_colour(geom), triangles);
        }
    }

    fn seen(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.axes * (point - self.eye)
    }

    /// Returns the direction to the light in the world's frame.
    fn light(&self) -> Vector3<f64> {
        self.axes.transpose() * LIGHT.normalize()
    }

    fn draw_surface(&mut self, colour: [f32; 4], triangles: &[Triangle]) {
        let light = self.light();
        let brightest = colour[..3].iter().fold(0.0, |most: f32, &part| most.max(part));
        let lift = (DARKEST - f64::from(brightest)).max(0.0);
        for triangle in triangles {
            let corners = triangle.map(|point| (self.seen(&point.position), point.normal));
            let Canvas { lens, depth, colour: painted, axes, .. } = self;
            lens.fill(corners, &mut |sample, at, normal| {
                if at < depth[sample] {
                    let view = lens.ray(sample % lens.width, sample / lens.width).normalize();
                    let normal = normal.try_normalize(0.0).unwrap_or_default();
                    let towards = -(*axes * normal).dot(&view);
                    // A face is seen from both sides, because meshes are not always closed or consistently oriented.
                    let seen = if towards < 0.0 { -normal } else { normal };
                    let shade = AMBIENT
                        + DIFFUSE * seen.dot(&light).max(0.0)
                        + HEADLIGHT * towards.abs()
                        + BOUNCE * (-seen.z).max(0.0);
                    depth[sample] = at;
                    painted[sample] = std::array::from_fn(|i| (f64::from(colour[i]) + lift) * shade);
                }
            });
        }
    }

    /// Returns for each sample the height of the lowest surface above the point of the plane that the sample sees;
    /// infinite if there is none.
    fn heights_above(&self, plane: GeomId, surfaces: &[Vec<Triangle>]) -> Vec<f64> {
        let (origin, up) = (self.data.geom_position(plane), self.data.geom_orientation(plane).column(2).into_owned());
        let mut heights = vec![f64::INFINITY; self.depth.len()];
        for triangle in surfaces.iter().flatten() {
            let corners = triangle.map(|point| {
                let height = (point.position - origin).dot(&up);
                (self.seen(&(point.position - up * height)), Vector3::new(height, 0.0, 0.0))
            });
            self.lens.fill(corners, &mut |sample, _, numbers| {
                if numbers.x > -f64::EPSILON {
                    heights[sample] = heights[sample].min(numbers.x.max(0.0));
                }
            });
        }
        heights
    }

    fn draw_plane(&mut self, plane: GeomId, half: [f64; 2], heights: &[f64]) {
        let (origin, turn) = (self.data.geom_position(plane), self.data.geom_orientation(plane));
        let colour = self.data.model().geom_colour(plane);
        let eye = turn.transpose() * (self.eye - origin);
        let looks = turn.transpose() * self.axes.transpose();
        let light = self.light().dot(&turn.column(2)).max(0.0);
        let square = square_size(self.camera.distance);
        let inside = |x: f64, half: f64| half <= 0.0 || x.abs() <= half;
        for (sample, height) in heights.iter().enumerate() {
            let ray = looks * self.lens.ray(sample % self.lens.width, sample / self.lens.width);
            let depth = -eye.z / ray.z;
            // A plane is seen from above only, and hides what is behind it. A ray along the plane has no finite depth.
            if !(eye.z > 0.0 && depth > self.lens.near && depth < self.depth[sample]) {
                continue;
            }
            let at = eye + ray * depth;
            if !(inside(at.x, half[0]) && inside(at.y, half[1])) {
                continue;
            }
            let odd = ((at.x / square).floor() + (at.y / square).floor()).rem_euclid(2.0) == 1.0;
            let tone = if odd { 1.0 - SQUARE_CONTRAST } else { 1.0 + SQUARE_CONTRAST };
            let dark = SHADOW * (-height / (SHADOW_HEIGHT * self.camera.distance)).exp();
            let facing = eye.z / (depth * ray.norm());
            let shade = tone * (1.0 - dark) * (AMBIENT + DIFFUSE * light + HEADLIGHT * facing);
            let fade = ((depth / self.camera.distance - FADE[0]) / (FADE[1] - FADE[0])).clamp(0.0, 1.0);
            self.depth[sample] = depth;
            self.colour[sample] =
                std::array::from_fn(|i| f64::from(colour[i]) * shade * (1.0 - fade) + BACKGROUND[i] * fade);
        }
    }

    /// Averages the samples of each pixel.
    fn picture(&self) -> Picture {
        let (width, height) = (self.lens.width / SUPERSAMPLING, self.lens.height / SUPERSAMPLING);
        let mut rgb = Vec::with_capacity(3 * width * height);
        for pixel in 0..width * height {
            let (column, row) = (SUPERSAMPLING * (pixel % width), SUPERSAMPLING * (pixel / width));
            for channel in 0..3 {
                let sum: f64 = (0..SUPERSAMPLING * SUPERSAMPLING)
                    .map(|i| (row + i / SUPERSAMPLING) * self.lens.width + column + i % SUPERSAMPLING)
                    .map(|sample| self.colour[sample][channel].clamp(0.0, 1.0))
                    .sum();
                rgb.push((255.0 * sum / (SUPERSAMPLING * SUPERSAMPLING) as f64).round() as u8);
            }
        }
        Picture { width, height, rgb }
    }
}

/// Returns the side in m of a plane's squares: 1, 2 or 5 times a power of ten, as large as [`SQUARES`] allows.
fn square_size(distance: f64) -> f64 {
    let most = distance / SQUARES;
    let power = 10f64.powf(most.log10().floor());
    [5.0, 2.0].map(|step| step * power).into_iter().find(|size| *size <= most).unwrap_or(power)
}
