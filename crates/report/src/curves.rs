//! Joining the curves of several runs: their median, and the range from the lowest to the highest.

use serde::Serialize;

use crate::stats::quantile;

/// Number of points of an interpolated band.
const TIMES: usize = 60;

/// Median and range of several curves.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Band {
    /// Points, from the least to the greatest x.
    pub points: Vec<BandPoint>,
}

/// One point of a [`Band`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BandPoint {
    /// Place on the x axis.
    pub x: f64,
    /// Median over the runs.
    pub median: f64,
    /// Least value of a run.
    pub min: f64,
    /// Greatest value of a run.
    pub max: f64,
    /// Number of runs that reach this x.
    pub n_runs: usize,
}

impl Band {
    /// Joins curves with points at the same x, such as evaluations at the same episodes.
    pub fn at_common_points(curves: &[Vec<(f64, f64)>]) -> Band {
        let mut places: Vec<f64> = curves.iter().flatten().map(|(x, _)| *x).collect();
        places.sort_by(f64::total_cmp);
        places.dedup();
        let at = |x: f64| curves.iter().filter_map(move |curve| curve.iter().find(|(at, _)| *at == x).map(|(_, y)| *y));
        Band { points: places.into_iter().filter_map(|x| BandPoint::of(x, at(x).collect())).collect() }
    }

    /// Joins curves with points at different x, by straight lines between the points. The band begins where the last
    /// curve begins, and ends where less than half of the curves go on. Each point of it joins the curves that reach
    /// this x.
    pub fn interpolated(curves: &[Vec<(f64, f64)>]) -> Band {
        let filled = || curves.iter().filter(|curve| !curve.is_empty());
        let start = filled().map(|curve| curve[0].0).fold(f64::NEG_INFINITY, f64::max);
        let mut ends: Vec<f64> = filled().map(|curve| curve[curve.len() - 1].0).collect();
        ends.sort_by(f64::total_cmp);
        let Some(&end) = ends.get(ends.len() / 2).filter(|end| start.is_finite() && **end >= start) else {
            return Band::default();
        };
        let place = |i: usize| start + (end - start) * i as f64 / (TIMES - 1) as f64;
        let at = |x: f64| filled().filter_map(|curve| interpolate(curve, x)).collect();
        Band { points: (0..TIMES).map(place).filter_map(|x| BandPoint::of(x, at(x))).collect() }
    }

    /// Returns the greatest x.
    pub fn end(&self) -> Option<f64> {
        self.points.last().map(|point| point.x)
    }
}

impl BandPoint {
    /// Joins the values at one place.
    pub fn of(x: f64, mut values: Vec<f64>) -> Option<BandPoint> {
        values.sort_by(f64::total_cmp);
        let (min, max) = (*values.first()?, *values.last()?);
        Some(BandPoint { x, median: quantile(&values, 0.5)?, min, max, n_runs: values.len() })
    }
}

/// (points by ascending x, x) => y on the line between the two nearest; `None` outside
fn interpolate(curve: &[(f64, f64)], x: f64) -> Option<f64> {
    let after = curve.partition_point(|(at, _)| *at < x);
    let (x1, y1) = *curve.get(after)?;
    if x1 == x {
        return Some(y1);
    }
    let (x0, y0) = *curve.get(after.checked_sub(1)?)?;
    Some(y0 + (y1 - y0) * (x - x0) / (x1 - x0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_of_unequal_length_are_joined_where_they_reach() {
        let band = Band::at_common_points(&[vec![(1.0, 0.2), (2.0, 0.6)], vec![(1.0, 0.4)], vec![(1.0, 0.9)]]);
        let expected = [
            BandPoint { x: 1.0, median: 0.4, min: 0.2, max: 0.9, n_runs: 3 },
            BandPoint { x: 2.0, median: 0.6, min: 0.6, max: 0.6, n_runs: 1 },
        ];
        assert_eq!(band.points, expected);
        assert_eq!(Band::at_common_points(&[]), Band::default());
    }

    #[test]
    fn curves_are_joined_by_straight_lines() {
        let curves = [vec![(0.0, 0.0), (10.0, 1.0)], vec![(5.0, 0.0), (20.0, 0.3)], vec![]];
        let band = Band::interpolated(&curves);
        let (first, last) = (band.points[0], band.points[TIMES - 1]);
        assert_eq!(first, BandPoint { x: 5.0, median: 0.25, min: 0.0, max: 0.5, n_runs: 2 });
        assert_eq!(last, BandPoint { x: 20.0, median: 0.3, min: 0.3, max: 0.3, n_runs: 1 });
        let third = Band::interpolated(&[curves[0].clone(), curves[1].clone(), vec![(0.0, 1.0), (8.0, 1.0)]]);
        assert_eq!(third.end(), Some(10.0), "beyond it there is less than half of the curves");
        assert_eq!(Band::interpolated(&[vec![]]), Band::default());
    }
}
