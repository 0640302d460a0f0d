//! Curves of all lambdas in one figure.

use eigenhand_train::MetricsRow;
use plotters::element::{PathElement, Polygon};
use plotters::style::Color;

use super::canvas::{Area, Axes, Drawn, Key, dashed, draw, fine, head, marker, round_up, series_color};
use super::{Cell, Figure, Group, csv, spread};
use crate::ReportError;
use crate::curves::Band;
use crate::stats::quantile;

const SIZE: (u32, u32) = (760, 420);
/// Number of steps of a distribution's curve.
const STEPS: usize = 120;
/// Share of the errors that the axis of their distribution covers.
const SHOWN: f64 = 0.995;

/// A number of an evaluation, if it exists.
type Number = fn(&MetricsRow) -> Option<f64>;

/// Description of a figure with curves.
struct Plot {
    /// What a group is, as a column of the figure's table.
    group_column: &'static str,
    name: &'static str,
    title: &'static str,
    caption: &'static str,
    x_name: &'static str,
    /// Name of x in the figure's table.
    x_column: &'static str,
    x: Number,
    y_name: &'static str,
    y: Number,
    /// A second number, drawn as a dashed line.
    beside: Option<Beside>,
    /// Factors from the files' units to those of the axes.
    scale: (f64, f64),
    y_digits: usize,
    /// Fixed end of the y axis, if any.
    top: Option<f64>,
    /// Whether each point of a curve has a mark.
    marked: bool,
}

/// A second number of a figure.
struct Beside {
    y: Number,
    /// Names of the first and of the second number in the figure's table.
    columns: [&'static str; 2],
    /// Name of the second number in the legend.
    label: &'static str,
}

/// Describes the curve of a number along training.
fn along(
    name: &'static str,
    title: &'static str,
    y_name: &'static str,
    y: Number,
    scale: f64,
    y_digits: usize,
    top: Option<f64>,
) -> Plot {
    Plot {
        group_column: "lambda",
        name,
        title,
        caption: "",
        x_name: "training episodes",
        x_column: "episode",
        x: |row| Some(row.episode as f64),
        y_name,
        y,
        beside: None,
        scale: (1.0, scale),
        y_digits,
        top,
        marked: true,
    }
}

/// Draws success, contribution and error along training, and the distribution of the error.
pub fn figures(groups: &[Group<'_>]) -> Result<Vec<Figure>, ReportError> {
    let rate = Some(100.0);
    let success: Number = |row| row.success_rate;
    let plots = [
        along("success-episodes", "Success along training", "success rate (%)", success, 100.0, 0, rate),
        Plot {
            caption: "Solid: success when the configured number of components commands the hand. Dashed: success with all \
                      joints. ",
            beside: Some(Beside {
                y: success,
                columns: ["success_with_components", "success_rate"],
                label: "with all joints",
            }),
            ..along(
                "success-components",
                "Success with the configured components along training",
                "success rate (%)",
                |row| row.success_with_components,
                100.0,
                0,
                rate,
            )
        },
        Plot {
            x_name: "wall time (min)",
            x_column: "wall_s",
            x: |row| row.wall_s,
            scale: (1.0 / 60.0, 100.0),
            marked: false,
            ..along("success-wall", "Success over wall time", "success rate (%)", success, 100.0, 0, rate)
        },
        along(
            "contribution-sum",
            "Sum of the contribution rates along training",
            "sum of contribution rates (%)",
            |row| row.contribution_sum,
            100.0,
            0,
            rate,
        ),
        along(
            "error-training",
            "Approximation error of the evaluation's successes",
            "mean approximation error (rad)",
            |row| row.mean_error_rad,
            1.0,
            2,
            None,
        ),
    ];
    let mut figures = Vec::new();
    for plot in &plots {
        let band = |group: &Group<'_>, y: Number| {
            let curves: Vec<Vec<(f64, f64)>> = group.runs.iter().map(|run| run.curve(plot.x, y)).collect();
            if plot.marked { Band::at_common_points(&curves) } else { Band::interpolated(&curves) }
        };
        let bands = |y: Number| groups.iter().map(|group| band(group, y)).collect::<Vec<_>>();
        let first = bands(plot.y);
        let mut beside = plot.beside.as_ref().map(|beside| bands(beside.y)).unwrap_or_default();
        // A lambda without the first number would have no entry in the legend.
        beside
            .iter_mut()
            .zip(&first)
            .filter(|(_, band)| band.points.is_empty())
            .for_each(|(b, _)| *b = Band::default());
        figures.extend(plot.figure(groups, &first, &beside)?);
    }
    figures.extend(distribution(groups)?);
    Ok(figures)
}

/// Draws success along training for groups of a study.
///
/// # Errors
/// [`ReportError::Draw`].
pub(crate) fn learning_curves(
    name: &'static str,
    title: &'static str,
    groups: &[Group<'_>],
) -> Result<Option<Figure>, ReportError> {
    let rate: Number = |row| row.success_rate;
    let plot = Plot { group_column: "variant", ..along(name, title, "success rate (%)", rate, 100.0, 0, Some(100.0)) };
    let band = |group: &Group<'_>| {
        let curves: Vec<Vec<(f64, f64)>> = group.runs.iter().map(|run| run.curve(plot.x, plot.y)).collect();
        Band::at_common_points(&curves)
    };
    plot.figure(groups, &groups.iter().map(band).collect::<Vec<_>>(), &[])
}

/// Draws the distribution of the error: the share of postures with at most this error.
fn distribution(groups: &[Group<'_>]) -> Result<Option<Figure>, ReportError> {
    let reach = |errors: &Vec<f64>| quantile(errors, SHOWN);
    let end = groups.iter().flat_map(|g| &g.runs).filter_map(|run| reach(&run.errors)).fold(0.0, f64::max);
    if end <= 0.0 {
        return Ok(None);
    }
    let end = round_up(end);
    let band = |group: &Group<'_>| {
        let filled: Vec<&Vec<f64>> = group.runs.iter().map(|run| &run.errors).filter(|e| !e.is_empty()).collect();
        let share = |errors: &Vec<f64>, x: f64| errors.partition_point(|e| *e <= x) as f64 / errors.len() as f64;
        let curve = |errors: &&Vec<f64>| {
            (0..=STEPS).map(|i| end * i as f64 / STEPS as f64).map(|x| (x, share(errors, x))).collect()
        };
        Band::at_common_points(&filled.iter().map(curve).collect::<Vec<_>>())
    };
    let plot = Plot {
        group_column: "lambda",
        name: "error-distribution",
        title: "Distribution of the approximation error",
        caption: "Share of postures whose distance from the run's synergy is at most e, among the postures that the synergy \
                  covers. ",
        x_name: "approximation error e (rad)",
        x_column: "error_rad",
        x: |_| None,
        y_name: "share of postures (%)",
        y: |_| None,
        beside: None,
        scale: (1.0, 100.0),
        y_digits: 0,
        top: Some(100.0),
        marked: false,
    };
    plot.figure(groups, &groups.iter().map(band).collect::<Vec<_>>(), &[])
}

impl Plot {
    /// Draws the bands of the lambdas, and dashed lines through the bands `beside`; returns no figure if there is no
    /// point.
    fn figure(&self, groups: &[Group<'_>], bands: &[Band], beside: &[Band]) -> Result<Option<Figure>, ReportError> {
        if bands.iter().all(|band| band.points.is_empty()) {
            return Ok(None);
        }
        let columns = self.beside.as_ref().map(|beside| beside.columns);
        let mut header = vec![self.group_column, self.x_column, "median", "min", "max", "n_runs"];
        if columns.is_some() {
            header.insert(1, "quantity");
        }
        let mut rows: Vec<Vec<Cell>> = Vec::new();
        for (i, bands) in [bands, beside].into_iter().enumerate() {
            for (group, band) in groups.iter().zip(bands) {
                rows.extend(band.points.iter().map(|p| {
                    let mut row = vec![Cell::Text(group.key.clone())];
                    row.extend([p.x, p.median, p.min, p.max, p.n_runs as f64].map(Cell::from));
                    if let Some(columns) = columns {
                        row.insert(1, Cell::Text(columns[i].to_owned()));
                    }
                    row
                }));
            }
        }
        Ok(Some(Figure {
            csv: csv(self.name, &header, rows)?,
            is_repeated: false,
            svg: draw(self.name, SIZE, |area| self.draw(area, groups, bands, beside))?,
            name: self.name.to_owned(),
            title: self.title.to_owned(),
            caption: format!("{}{}", self.caption, spread(groups)),
        }))
    }

    fn draw(&self, area: &Area<'_>, groups: &[Group<'_>], bands: &[Band], beside: &[Band]) -> Drawn {
        let mut entries: Vec<(Key, String)> = groups
            .iter()
            .enumerate()
            .filter(|(i, _)| !bands[*i].points.is_empty())
            .map(|(i, group)| (Key::Series(i), group.label.clone()))
            .collect();
        entries.extend(self.beside.iter().map(|beside| (Key::Dashed, beside.label.to_owned())));
        let rest = head(area, self.title, &entries)?;
        let (sx, sy) = self.scale;
        let end = bands.iter().chain(beside).filter_map(Band::end).fold(0.0, f64::max) * sx;
        let top = bands.iter().flat_map(|band| &band.points).map(|p| p.max).fold(0.0, f64::max) * sy;
        let fraction = end < 10.0;
        let axes = Axes {
            x: 0.0..if end > 0.0 { end * 1.01 } else { 1.0 },
            y: 0.0..self.top.unwrap_or_else(|| round_up(top)),
            x_name: self.x_name,
            y_name: self.y_name,
            x_digits: if fraction { 1 } else { 0 },
            y_digits: self.y_digits,
        };
        let chart = axes.draw(&rest)?;
        let plot = chart.plotting_area();
        for (i, band) in bands.iter().enumerate() {
            let upper = band.points.iter().map(|p| (p.x * sx, p.max * sy));
            let lower = band.points.iter().rev().map(|p| (p.x * sx, p.min * sy));
            plot.draw(&Polygon::new(upper.chain(lower).collect::<Vec<_>>(), series_color(i).mix(0.18)))?;
        }
        for (i, band) in beside.iter().enumerate() {
            let line: Vec<(f64, f64)> = band.points.iter().map(|p| (p.x * sx, p.median * sy)).collect();
            plot.draw(&dashed(line, series_color(i).stroke_width(fine(1.6))))?;
        }
        for (i, band) in bands.iter().enumerate() {
            let line: Vec<(f64, f64)> = band.points.iter().map(|p| (p.x * sx, p.median * sy)).collect();
            plot.draw(&PathElement::new(line.clone(), series_color(i).stroke_width(fine(2.2))))?;
            if self.marked {
                // Marks use the whole area, because a mark at the end of an axis reaches beyond the plot.
                let screen = rest.use_screen_coord();
                for point in &line {
                    marker(&screen, i, plot.map_coordinate(point), 3.6, true)?;
                }
            }
        }
        Ok(())
    }
}
