//! The camera of a picture.

use nalgebra::{Matrix3, Vector3};

/// Position and direction from which a picture is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The point in the middle of the picture, in m.
    pub target: [f64; 3],
    /// Direction of view around the vertical in degrees, as in MuJoCo: 0 looks along x, 90 along y.
    pub azimuth_deg: f64,
    /// Direction of view above the horizontal in degrees: -90 looks straight down.
    pub elevation_deg: f64,
    /// Distance from the target in m.
    pub distance: f64,
    /// Angle of view from the lower to the upper edge in degrees.
    pub fov_deg: f64,
}

impl Camera {
    /// Returns the directions to the right, up and forward as rows.
    pub(crate) fn axes(&self) -> Matrix3<f64> {
        let (sin, cos) = self.azimuth_deg.to_radians().sin_cos();
        let (up, level) = self.elevation_deg.to_radians().sin_cos();
        let right = Vector3::new(sin, -cos, 0.0);
        let forward = Vector3::new(level * cos, level * sin, up);
        Matrix3::from_rows(&[right.transpose(), right.cross(&forward).transpose(), forward.transpose()])
    }

    pub(crate) fn position(&self) -> Vector3<f64> {
        Vector3::from(self.target) - self.axes().row(2).transpose() * self.distance
    }

    /// Returns the tangents of half the horizontal and half the vertical angle of view; `aspect` is width over height.
    pub(crate) fn half_view(&self, aspect: f64) -> [f64; 2] {
        let upright = (self.fov_deg.to_radians() / 2.0).tan();
        [upright * aspect, upright]
    }

    /// Returns the pixel (column, row) at which a point in m appears in a picture of this size; none behind the camera.
    pub fn pixel(&self, at: [f64; 3], [width, height]: [usize; 2]) -> Option<[f64; 2]> {
        let seen = self.axes() * (Vector3::from(at) - self.position());
        let (width, height) = (width as f64, height as f64);
        let half = self.half_view(width / height);
        let place = [1.0 + seen.x / seen.z / half[0], 1.0 - seen.y / seen.z / half[1]];
        (seen.z > 0.0).then(|| [place[0] * width / 2.0, place[1] * height / 2.0])
    }

    /// Moves the camera without turning it, so that `points` fill `share` of the picture; `aspect` is width over
    /// height.
    ///
    /// Points that are not finite are ignored. Without finite points, the camera stays where it is.
    pub fn framing(self, points: &[[f64; 3]], aspect: f64, share: f64) -> Camera {
        let axes = self.axes();
        let seen: Vec<Vector3<f64>> = points
            .iter()
            .filter(|point| point.iter().all(|x| x.is_finite()))
            .map(|&point| axes * Vector3::from(point))
            .collect();
        let Some(&first) = seen.first() else { return self };
        let low = seen.iter().fold(first, |low, point| low.inf(point));
        let high = seen.iter().fold(first, |high, point| high.sup(point));
        let middle = (low + high) / 2.0;
        let half = self.half_view(aspect);
        let distance = seen.iter().map(|point| point - middle).fold(0.0, |distance: f64, offset| {
            let needed = (offset.x.abs() / half[0]).max(offset.y.abs() / half[1]) / share - offset.z;
            distance.max(needed)
        });
        Camera { target: (axes.transpose() * middle).into(), distance, ..self }
    }
}
