//! The loadings of a control synergy: how much each number moves each actuator.

use plotters::element::Rectangle;
use plotters::style::Color;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas::{Area, Drawn, INK, draw, fine, head, series_color, text};
use super::{Figure, csv};
use crate::ReportError;
use crate::run::{Run, best};

const NAME: &str = "loadings";
/// Sizes in units of the drawing: of a cell, and of what stands left of and above the cells.
const CELL: [f64; 2] = [74.0, 19.0];
const ABOVE: f64 = 26.0;
const TITLE: f64 = 32.0;
const EDGE: f64 = 12.0;
/// Width of a letter of an actuator's name.
const LETTER: f64 = 8.5;

/// Draws the figure for the run that succeeds most, if it has a control synergy.
pub fn figure(runs: &[Run]) -> Result<Option<Figure>, ReportError> {
    let Some((run, file)) = best(runs).and_then(|run| Some((run, &run.control.as_ref()?.file))) else {
        return Ok(None);
    };
    let synergy = &file.synergy;
    let names: Vec<&str> = synergy.joints().iter().map(|joint| joint.name.as_str()).collect();
    let k = synergy.n_components();
    let header: Vec<String> =
        std::iter::once("actuator".to_owned()).chain((1..=k).map(|i| format!("number_{i}"))).collect();
    let rows = names.iter().enumerate().map(|(j, name)| {
        let loadings = (0..k).map(move |i| synergy.component(i)[j].into());
        std::iter::once((*name).to_owned().into()).chain(loadings).collect()
    });
    let left = EDGE + LETTER * names.iter().map(|name| name.chars().count()).max().unwrap_or(0) as f64;
    let size =
        ((left + CELL[0] * k as f64 + EDGE) as u32, (TITLE + ABOVE + CELL[1] * names.len() as f64 + EDGE) as u32);
    let title = "Loadings of the control synergy".to_owned();
    Ok(Some(Figure {
        name: NAME.to_owned(),
        caption: format!(
            "Run {}: change of each actuator's command, in the actuator's unit, for a change of a number by 1. Blue: the \
             command rises with the number; orange: it falls.",
            run.name
        ),
        svg: draw(NAME, (size.0.max(420), size.1), |area| {
            let rest = head(area, &title, &[])?;
            let at = |x: f64, y: f64| (fine(x) as i32, fine(y) as i32);
            for i in 0..k {
                let x = left + CELL[0] * (i as f64 + 0.5);
                rest.draw_text(
                    &format!("number {}", i + 1),
                    &text(13.0).pos(Pos::new(HPos::Center, VPos::Center)),
                    at(x, ABOVE / 2.0),
                )?;
            }
            for (j, name) in names.iter().enumerate() {
                let y = ABOVE + CELL[1] * (j as f64 + 0.5);
                rest.draw_text(name, &text(13.0).pos(Pos::new(HPos::Right, VPos::Center)), at(left - 6.0, y))?;
                for i in 0..k {
                    cell(&rest, synergy.component(i)[j], [left + CELL[0] * i as f64, y])?;
                }
            }
            Ok(())
        })?,
        title: title.clone(),
        csv: csv(NAME, &header.iter().map(String::as_str).collect::<Vec<_>>(), rows)?,
        is_repeated: false,
    }))
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
