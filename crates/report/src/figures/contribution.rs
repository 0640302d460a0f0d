//! The paper's figures 3 and 4: contribution rates as bars and success as a line, along training.

use eigenhand_train::MetricsRow;
use plotters::element::{PathElement, Polygon, Rectangle};
use plotters::style::Color;

use super::canvas::{Area, Axes, Drawn, FINE, INK, Key, PAPER, component_color, draw, fine, head};
use super::{Cell, Figure, Group, csv, spread};
use crate::ReportError;
use crate::curves::Band;

/// Size of one panel.
const SIZE: (u32, u32) = (760, 430);
/// Share of the distance between evaluations that a bar takes.
const BAR: f64 = 0.72;

/// Data of one panel.
struct Panel {
    label: String,
    success: Band,
    /// Contribution rate of each component.
    rates: Vec<Band>,
    sum: Band,
}

/// Draws a figure for each lambda, and one with all of them.
pub fn figures(groups: &[Group<'_>]) -> Result<Vec<Figure>, ReportError> {
    let panels: Vec<(&str, Panel)> = groups
        .iter()
        .map(|group| (group.key.as_str(), Panel::of(group)))
        .filter(|(_, panel)| !panel.success.points.is_empty())
        .collect();
    let end = panels.iter().filter_map(|(_, panel)| panel.success.end()).fold(1.0, f64::max);
    let mut figures = Vec::new();
    for (lambda, panel) in &panels {
        let name = format!("contribution-l{lambda}");
        let svg = draw(&name, SIZE, |area| panel.draw(area, end, true))?;
        figures.push(figure(
            name,
            format!("Contribution rates and success, \u{3bb} = {lambda}"),
            svg,
            &[(lambda, panel)],
            groups,
        )?);
    }
    if panels.len() > 1 {
        let name = "contribution".to_owned();
        let columns = panels.len().min(2);
        let rows = panels.len().div_ceil(columns);
        let svg = draw(&name, (SIZE.0 * columns as u32 * 4 / 5, SIZE.1 * rows as u32), |area| {
            let areas = area.split_evenly((rows, columns));
            areas.iter().zip(&panels).try_for_each(|(area, (_, panel))| panel.draw(area, end, true))
        })?;
        let all: Vec<(&str, &Panel)> = panels.iter().map(|(lambda, panel)| (*lambda, panel)).collect();
        figures.insert(0, figure(name, "Contribution rates and success, side by side".to_owned(), svg, &all, groups)?);
    }
    Ok(figures)
}

fn figure(
    name: String,
    title: String,
    svg: String,
    panels: &[(&str, &Panel)],
    groups: &[Group<'_>],
) -> Result<Figure, ReportError> {
    let several = match spread(groups) {
        "" => String::new(),
        spread => format!(" Bars are medians too. {spread}"),
    };
    let caption = format!(
        "Bars: contribution rate of each principal component at that time, the first component at the bottom. Line: success rate \
         of the evaluation.{several}"
    );
    let csv = Panel::numbers(&name, panels)?;
    Ok(Figure { csv, name, title, caption, svg, is_repeated: panels.len() > 1 })
}

impl Panel {
    fn of(group: &Group<'_>) -> Panel {
        let band = |value: &dyn Fn(&MetricsRow) -> Option<f64>| {
            let episode = |row: &MetricsRow| Some(row.episode as f64);
            let curves: Vec<Vec<(f64, f64)>> = group.runs.iter().map(|run| run.curve(episode, value)).collect();
            Band::at_common_points(&curves)
        };
        let components = group.runs.iter().map(|run| run.components).max().unwrap_or(0);
        Panel {
            label: group.label.clone(),
            success: band(&|row| row.success_rate),
            rates: (0..components).map(|i| band(&|row| row.contribution.get(i).copied().flatten())).collect(),
            sum: band(&|row| row.contribution_sum),
        }
    }

    fn draw(&self, area: &Area<'_>, end: f64, legend: bool) -> Drawn {
        let mut entries: Vec<(Key, String)> = Vec::new();
        if legend {
            let name = |i| if i == 0 { "component 1".to_owned() } else { format!("{}", i + 1) };
            entries.extend((0..self.rates.len()).map(|i| (Key::Square(component_color(i)), name(i))));
            let several = self.success.points.iter().any(|point| point.n_runs > 1);
            entries.push((Key::Ink, if several { "success, median and range" } else { "success" }.to_owned()));
        }
        let rest = head(area, &self.label, &entries)?;
        let spacing = self.spacing();
        let axes = Axes {
            x: 0.0..end + spacing / 2.0,
            y: 0.0..100.0,
            x_name: "training episodes",
            y_name: "contribution rate, success rate (%)",
            x_digits: 0,
            y_digits: 0,
        };
        let chart = axes.draw(&rest)?;
        let plot = chart.plotting_area();
        for point in &self.success.points {
            let mut bottom = 0.0;
            for (i, rate) in self.rates.iter().enumerate() {
                let Some(part) = rate.points.iter().find(|part| part.x == point.x) else { continue };
                let top = bottom + 100.0 * part.median;
                let (left, right) = (point.x - spacing * BAR / 2.0, point.x + spacing * BAR / 2.0);
                plot.draw(&Rectangle::new([(left, bottom), (right, top)], component_color(i).filled()))?;
                bottom = top;
            }
        }
        let line: Vec<(f64, f64)> = self.success.points.iter().map(|p| (p.x, 100.0 * p.median)).collect();
        let upper = self.success.points.iter().map(|p| (p.x, 100.0 * p.max));
        let lower = self.success.points.iter().rev().map(|p| (p.x, 100.0 * p.min));
        plot.draw(&Polygon::new(upper.chain(lower).collect::<Vec<_>>(), INK.mix(0.22)))?;
        plot.draw(&PathElement::new(line.clone(), PAPER.stroke_width(fine(4.6))))?;
        plot.draw(&PathElement::new(line, INK.stroke_width(fine(2.2))))?;
        // The bars have covered the axis, so it is drawn again.
        plot.draw(&PathElement::new(vec![(0.0, 0.0), (axes.x.end, 0.0)], INK.stroke_width(FINE)))
    }

    /// Returns the distance between evaluations.
    fn spacing(&self) -> f64 {
        let places = self.success.points.windows(2).map(|pair| pair[1].x - pair[0].x);
        let least = places.fold(f64::INFINITY, f64::min);
        if least.is_finite() { least } else { self.success.end().unwrap_or(1.0) }
    }

    fn numbers(name: &str, panels: &[(&str, &Panel)]) -> Result<Vec<u8>, ReportError> {
        let quantities = |panel: &Panel| {
            let rates =
                panel.rates.iter().enumerate().map(|(i, band)| (format!("contribution_{}", i + 1), band.clone()));
            let mut all = vec![("success_rate".to_owned(), panel.success.clone())];
            all.extend(rates);
            all.push(("contribution_sum".to_owned(), panel.sum.clone()));
            all
        };
        let rows = panels.iter().flat_map(|(lambda, panel)| {
            quantities(panel).into_iter().flat_map(move |(quantity, band)| {
                band.points.into_iter().map(move |p| {
                    let quantity = Cell::Text(quantity.clone());
                    vec![
                        Cell::Text((*lambda).to_owned()),
                        quantity,
                        p.x.into(),
                        p.median.into(),
                        p.min.into(),
                        p.max.into(),
                        p.n_runs.into(),
                    ]
                })
            })
        });
        csv(name, &["lambda", "quantity", "episode", "median", "min", "max", "n_runs"], rows)
    }
}
