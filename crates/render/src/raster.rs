//! The samples of a camera that a triangle covers.

use nalgebra::Vector3;

/// A corner of a triangle: its position in the camera's frame (right, up, forward, in m), and three numbers that vary
/// linearly over the triangle.
pub type Corner = (Vector3<f64>, Vector3<f64>);

/// A pinhole camera with a raster of samples.
pub struct Lens {
    pub width: usize,
    pub height: usize,
    /// Number of samples in a unit of length at depth 1.
    pub focal: f64,
    /// Depth of the near plane in m. Nothing nearer is seen.
    pub near: f64,
}

impl Lens {
    /// (sample) => the point at depth 1 that it sees
    pub fn ray(&self, column: usize, row: usize) -> Vector3<f64> {
        let x = column as f64 + 0.5 - self.width as f64 / 2.0;
        let y = self.height as f64 / 2.0 - row as f64 - 0.5;
        Vector3::new(x / self.focal, y / self.focal, 1.0)
    }

    /// Calls `paint` with the index, the depth and the interpolated numbers of each sample that a triangle covers.
    ///
    /// A triangle with a corner that is not finite is skipped.
    pub fn fill(&self, triangle: [Corner; 3], paint: &mut impl FnMut(usize, f64, Vector3<f64>)) {
        let finite = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
        if !triangle.iter().all(|(place, numbers)| finite(place) && finite(numbers)) {
            return;
        }
        if triangle.iter().all(|(place, _)| place.z >= self.near) {
            return self.fill_visible(triangle, paint);
        }
        let visible = self.clip(triangle);
        for i in 2..visible.len() {
            self.fill_visible([visible[0], visible[i - 1], visible[i]], paint);
        }
    }

    /// Returns the part of a triangle beyond the near plane: a polygon with up to four corners.
    fn clip(&self, triangle: [Corner; 3]) -> Vec<Corner> {
        let mut kept = Vec::with_capacity(4);
        for i in 0..3 {
            let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
            let (inside, other) = (a.0.z >= self.near, b.0.z >= self.near);
            if inside {
                kept.push(a);
            }
            if inside != other {
                let share = (self.near - a.0.z) / (b.0.z - a.0.z);
                kept.push((a.0.lerp(&b.0, share), a.1.lerp(&b.1, share)));
            }
        }
        kept
    }

    fn fill_visible(&self, triangle: [Corner; 3], paint: &mut impl FnMut(usize, f64, Vector3<f64>)) {
        let [a, b, c] = triangle.map(|(place, _)| {
            let x = self.width as f64 / 2.0 + self.focal * place.x / place.z;
            let y = self.height as f64 / 2.0 - self.focal * place.y / place.z;
            [x, y]
        });
        let cross =
            |o: [f64; 2], p: [f64; 2], q: [f64; 2]| (p[0] - o[0]) * (q[1] - o[1]) - (p[1] - o[1]) * (q[0] - o[0]);
        let area = cross(a, b, c);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        // Perspective: (number / depth) and (1 / depth) vary linearly over the picture, so the number is their
        // quotient.
        let inverse = triangle.map(|(place, _)| 1.0 / place.z);
        let over_depth = [0, 1, 2].map(|i| triangle[i].1 * inverse[i]);
        let bounds = |axis: usize, end: usize| {
            let low = a[axis].min(b[axis]).min(c[axis]);
            let high = a[axis].max(b[axis]).max(c[axis]);
            // A cast saturates, so a triangle outside the picture gives an empty range.
            ((low - 0.5).ceil().max(0.0) as usize)..((high - 0.5).floor() + 1.0).clamp(0.0, end as f64) as usize
        };
        for row in bounds(1, self.height) {
            for column in bounds(0, self.width) {
                let at = [column as f64 + 0.5, row as f64 + 0.5];
                let weights = [cross(b, c, at) / area, cross(c, a, at) / area, cross(a, b, at) / area];
                // An edge belongs to both of its triangles, so that no gap is left between them.
                if weights.iter().all(|&weight| weight >= 0.0) {
                    let depth = 1.0 / (0..3).map(|i| weights[i] * inverse[i]).sum::<f64>();
                    let numbers = over_depth[0] * weights[0] + over_depth[1] * weights[1] + over_depth[2] * weights[2];
                    paint(row * self.width + column, depth, numbers * depth);
                }
            }
        }
    }
}
