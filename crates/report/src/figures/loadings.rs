//! The loadings of a control synergy: how much each number moves each actuator and each joint.

use eigenhand_synergy::JointInfo;
use plotters::element::Rectangle;
use plotters::style::Color;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas::{Area, Drawn, INK, draw, fine, head, series_color, text};
use super::{Figure, csv};
use crate::ReportError;
use crate::run::{Run, best};

/// Sizes in units of the drawing: of a cell, and of what stands left of and above the cells.
const CELL: [f64; 2] = [74.0, 19.0];
const ABOVE: f64 = 26.0;
const TITLE: f64 = 32.0;
const EDGE: f64 = 12.0;
/// Width of a letter of a name.
const LETTER: f64 = 8.5;

/// A table of loadings: a row for each coordinate, with a loading for each number.
struct Loadings {
    name: &'static str,
    title: &'static str,
    /// What a row is.
    row: &'static str,
    caption: String,
    rows: Vec<(String, Vec<f64>)>,
}

/// Draws the figures for the run that succeeds most, if it has a control synergy: its commands, and the joints that they move.
pub fn figures(runs: &[Run]) -> Result<Vec<Figure>, ReportError> {
    let Some((run, file)) = best(runs).and_then(|run| Some((run, &run.control.as_ref()?.file))) else {
        return Ok(Vec::new());
    };
    let k = file.synergy.n_components();
    let rows = |coordinates: &[JointInfo], loading: &dyn Fn(usize, usize) -> f64| -> Vec<(String, Vec<f64>)> {
        let row =
            |(j, coordinate): (usize, &JointInfo)| (coordinate.name.clone(), (0..k).map(|i| loading(i, j)).collect());
        coordinates.iter().enumerate().map(row).collect()
    };
    let commands = file.synergy.joints();
    let caption = |what: &str, rises: &str| {
        format!(
            "Run {}: change of each {what}, in its own unit, for a change of a number by 1. Blue: the {rises} rises with the \
             number; orange: it falls.",
            run.name
        )
    };
    let mut found = vec![Loadings {
        name: "loadings",
        title: "Loadings of the control synergy",
        row: "actuator",
        caption: caption("actuator's command", "command"),
        rows: rows(commands, &|i, j| file.synergy.component(i)[j]),
    }];
    if let Some(map) = &file.joint_map {
        found.push(Loadings {
            name: "loadings-joints",
            title: "Joints that the numbers move",
            row: "joint",
            caption: caption("joint's measured position", "position"),
            rows: rows(&map.joints, &|i, j| map.matrix[i][j]),
        });
    }
    found.iter().map(Loadings::figure).collect()
}

impl Loadings {
    fn figure(&self) -> Result<Figure, ReportError> {
        let k = self.rows.first().map_or(0, |(_, loadings)| loadings.len());
        let header: Vec<String> =
            std::iter::once(self.row.to_owned()).chain((1..=k).map(|i| format!("number_{i}"))).collect();
        let rows = self.rows.iter().map(|(name, loadings)| {
            std::iter::once(name.clone().into()).chain(loadings.iter().map(|loading| (*loading).into())).collect()
        });
        let longest = self.rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
        let left = EDGE + LETTER * longest as f64;
        let height = TITLE + ABOVE + CELL[1] * self.rows.len() as f64 + EDGE;
        let size = ((left + CELL[0] * k as f64 + EDGE) as u32, height as u32);
        Ok(Figure {
            name: self.name.to_owned(),
            title: self.title.to_owned(),
            caption: self.caption.clone(),
            svg: draw(self.name, (size.0.max(420), size.1), |area| self.paint(area, left, k))?,
            csv: csv(self.name, &header.iter().map(String::as_str).collect::<Vec<_>>(), rows)?,
            is_repeated: false,
        })
    }

    /// `left` is where the cells begin.
    fn paint(&self, area: &Area<'_>, left: f64, k: usize) -> Drawn {
        let rest = head(area, self.title, &[])?;
        let at = |x: f64, y: f64| (fine(x) as i32, fine(y) as i32);
        for i in 0..k {
            let style = text(13.0).pos(Pos::new(HPos::Center, VPos::Center));
            rest.draw_text(&format!("number {}", i + 1), &style, at(left + CELL[0] * (i as f64 + 0.5), ABOVE / 2.0))?;
        }
        for (j, (name, loadings)) in self.rows.iter().enumerate() {
            let y = ABOVE + CELL[1] * (j as f64 + 0.5);
            rest.draw_text(name, &text(13.0).pos(Pos::new(HPos::Right, VPos::Center)), at(left - 6.0, y))?;
            for (i, loading) in loadings.iter().enumerate() {
                cell(&rest, *loading, [left + CELL[0] * i as f64, y])?;
            }
        }
        Ok(())
    }
}

/// Paints a loading; `place` is the left edge and the middle in height.
fn cell(area: &Area<'_>, loading: f64, [x, y]: [f64; 2]) -> Drawn {
    let at = |x: f64, y: f64| (fine(x) as i32, fine(y) as i32);
    let color = series_color(usize::from(loading < 0.0)).mix(loading.abs().min(1.0));
    let corners = [at(x + 1.0, y - CELL[1] / 2.0 + 1.0), at(x + CELL[0] - 1.0, y + CELL[1] / 2.0 - 1.0)];
    area.draw(&Rectangle::new(corners, color.filled()))?;
    area.draw(&Rectangle::new(corners, INK.mix(0.15).stroke_width(1)))?;
    let style = text(12.0).pos(Pos::new(HPos::Center, VPos::Center));
    area.draw_text(&format!("{loading:+.2}"), &style, at(x + CELL[0] / 2.0, y))
}
