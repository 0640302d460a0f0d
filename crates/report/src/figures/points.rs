//! Results of single runs as points, with their interquartile means.

use plotters::element::PathElement;
use plotters::style::Color;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas::{Area, Axes, Drawn, INK, Key, draw, fine, head, marker, round_up, series_color, text};
use super::{Cell, Figure, csv, label};
use crate::ReportError;
use crate::records::{Analysis, LambdaRecord, Quantity, RunRecord};
use crate::stats::Estimate;

const OBJECTS_SIZE: (u32, u32) = (760, 420);
const RESULT_SIZE: (u32, u32) = (300, 420);

/// One column of points: the runs of a lambda.
struct Column {
    lambda: f64,
    series: usize,
    category: String,
    /// Seeds with their values.
    values: Vec<(u64, f64)>,
    estimate: Estimate,
}

/// Draws success for each object, and the results over the runs.
pub fn figures(analysis: &Analysis) -> Result<Vec<Figure>, ReportError> {
    let mut figures = Vec::new();
    figures.extend(results(analysis)?);
    figures.extend(objects(analysis)?);
    Ok(figures)
}

fn complete(analysis: &Analysis, lambda: f64) -> impl Iterator<Item = &RunRecord> {
    analysis.runs.iter().filter(move |run| run.lambda == lambda && run.is_complete())
}

fn objects(analysis: &Analysis) -> Result<Option<Figure>, ReportError> {
    let objects = analysis.objects();
    let mut columns = Vec::new();
    for object in &objects {
        for (series, lambda) in analysis.lambdas.iter().enumerate() {
            let Some(estimate) = lambda.objects.get(object) else { continue };
            let value = |run: &RunRecord| Some((run.seed, *run.success_rate_per_object.get(object)?));
            columns.push(Column {
                lambda: lambda.lambda,
                series,
                category: object.clone(),
                values: complete(analysis, lambda.lambda).filter_map(value).collect(),
                estimate: estimate.clone(),
            });
        }
    }
    if columns.is_empty() {
        return Ok(None);
    }
    let name = "objects";
    let svg = draw(name, OBJECTS_SIZE, |area| {
        let rest = head(area, "Success for each object", &legend(analysis))?;
        Categories {
            names: &objects,
            columns: &columns,
            y_name: "success rate (%)",
            factor: 100.0,
            digits: 0,
            top: Some(100.0),
        }
        .draw(&rest, analysis.lambdas.len())
    })?;
    Ok(Some(Figure {
        name: name.to_owned(),
        title: "Success for each object".to_owned(),
        caption: match analysis.runs.len() {
            1 => "Final evaluation.".to_owned(),
            _ => {
                "Final evaluation. Small marks: one run each; large marks: interquartile mean, with its 95 % bootstrap \
                  interval."
                    .to_owned()
            }
        },
        svg,
        csv: numbers(name, "object", &columns)?,
        is_repeated: false,
    }))
}

/// A panel of the results: one quantity for every lambda.
struct Panel {
    quantity: Quantity,
    y_name: &'static str,
    factor: f64,
    digits: usize,
    top: Option<f64>,
}

const PANELS: [Panel; 3] = [
    Panel {
        quantity: Quantity::SuccessRate,
        y_name: "final success rate (%)",
        factor: 100.0,
        digits: 0,
        top: Some(100.0),
    },
    Panel {
        quantity: Quantity::ContributionSum,
        y_name: "sum of contribution rates (%)",
        factor: 100.0,
        digits: 0,
        top: Some(100.0),
    },
    Panel {
        quantity: Quantity::MeanErrorRad,
        y_name: "mean approximation error (rad)",
        factor: 1.0,
        digits: 2,
        top: None,
    },
];

fn results(analysis: &Analysis) -> Result<Option<Figure>, ReportError> {
    let names: Vec<String> = analysis.lambdas.iter().map(|lambda| format!("\u{3bb} = {}", lambda.lambda)).collect();
    let columns = |quantity: Quantity| -> Vec<Column> {
        let column = |(series, lambda): (usize, &LambdaRecord)| {
            let value = |run: &RunRecord| Some((run.seed, quantity.of(run)?));
            Some(Column {
                lambda: lambda.lambda,
                series,
                category: names[series].clone(),
                values: complete(analysis, lambda.lambda).filter_map(value).collect(),
                estimate: lambda.quantities.get(quantity.key())?.clone(),
            })
        };
        analysis.lambdas.iter().enumerate().filter_map(column).collect()
    };
    let drawn = PANELS.map(|panel| (columns(panel.quantity), panel));
    if drawn.iter().all(|(columns, _)| columns.iter().map(|column| column.values.len()).sum::<usize>() < 2) {
        return Ok(None);
    }
    let name = "results";
    let svg = draw(name, (RESULT_SIZE.0 * PANELS.len() as u32, RESULT_SIZE.1), |area| {
        let rest = head(area, "Results of the complete runs", &[])?;
        for (area, (columns, panel)) in rest.split_evenly((1, PANELS.len())).iter().zip(&drawn) {
            let Panel { y_name, factor, digits, top, .. } = *panel;
            Categories { names: &names, columns, y_name, factor, digits, top }.draw(area, 1)?;
        }
        Ok(())
    })?;
    let numbers = drawn.iter().flat_map(|(columns, panel)| rows(panel.quantity.key(), columns));
    Ok(Some(Figure {
        name: name.to_owned(),
        title: "Results of the complete runs".to_owned(),
        caption:
            "Small marks: one run each; large marks: interquartile mean, with its 95 % bootstrap interval where there \
                  are enough runs."
                .to_owned(),
        svg,
        csv: csv(name, &header("quantity"), numbers)?,
        is_repeated: false,
    }))
}

fn legend(analysis: &Analysis) -> Vec<(Key, String)> {
    let entry = |(i, lambda): (usize, &LambdaRecord)| (Key::Series(i), label(lambda.lambda, lambda.n_complete));
    analysis.lambdas.iter().enumerate().filter(|(_, lambda)| lambda.n_complete > 0).map(entry).collect()
}

fn header(first: &str) -> [&str; 8] {
    [first, "lambda", "kind", "value", "low", "high", "n_runs", "seed"]
}

fn numbers(name: &str, first: &str, columns: &[Column]) -> Result<Vec<u8>, ReportError> {
    let all: Vec<Vec<Cell>> =
        columns.iter().flat_map(|column| rows(&column.category, std::slice::from_ref(column))).collect();
    csv(name, &header(first), all)
}

fn rows(first: &str, columns: &[Column]) -> Vec<Vec<Cell>> {
    let nothing = || Cell::Text(String::new());
    let mut rows = Vec::new();
    for column in columns {
        let [low, high] = column.estimate.interval.unwrap_or([f64::NAN; 2]);
        let row = |kind: &str, value: f64, low: f64, high: f64, n: Cell, seed: Cell| {
            let words = [first, kind].map(|word| Cell::Text(word.to_owned()));
            let [first, kind] = words;
            vec![first, column.lambda.into(), kind, value.into(), low.into(), high.into(), n, seed]
        };
        rows.push(row("interquartile_mean", column.estimate.iqm, low, high, column.estimate.n.into(), nothing()));
        for (seed, value) in &column.values {
            rows.push(row("run", *value, f64::NAN, f64::NAN, nothing(), Cell::Text(seed.to_string())));
        }
    }
    rows
}

/// A chart of points above names.
struct Categories<'a> {
    names: &'a [String],
    columns: &'a [Column],
    y_name: &'a str,
    factor: f64,
    digits: usize,
    top: Option<f64>,
}

impl Categories<'_> {
    /// Draws the chart with `side_by_side` columns for each name.
    fn draw(&self, area: &Area<'_>, side_by_side: usize) -> Drawn {
        let values = self.columns.iter().flat_map(|column| &column.values).map(|(_, value)| value * self.factor);
        let top = self.top.unwrap_or_else(|| round_up(values.fold(0.0, f64::max)));
        let axes = Axes {
            x: 0.0..self.names.len().max(1) as f64,
            y: 0.0..top,
            x_name: "",
            y_name: self.y_name,
            x_digits: 0,
            y_digits: self.digits,
        };
        let chart = axes.draw_named(area)?;
        let plot = chart.plotting_area();
        // Marks use the whole area, because a mark at the end of an axis reaches beyond the plot.
        let screen = area.use_screen_coord();
        let at = |x: f64, y: f64| plot.map_coordinate(&(x, y));
        let style = text(13.0).pos(Pos::new(HPos::Center, VPos::Top));
        // plotters places text relative to the corner of its area, even if the coordinates are those of the screen.
        let (left, above) = screen.get_base_pixel();
        for (i, name) in self.names.iter().enumerate() {
            let (x, y) = at(i as f64 + 0.5, 0.0);
            screen.draw_text(name, &style, (x - left, y - above + fine(9.0) as i32))?;
        }
        for column in self.columns {
            let Some(place) = self.names.iter().position(|name| *name == column.category) else { continue };
            let slot = if side_by_side > 1 { column.series as f64 } else { 0.0 };
            let x = place as f64 + (slot + 1.0) / (side_by_side as f64 + 1.0);
            let width = 1.0 / (side_by_side as f64 + 1.0);
            if let [(_, only)] = column.values[..] {
                marker(&screen, column.series, at(x, only * self.factor), 5.2, true)?;
                continue;
            }
            for (i, (_, value)) in column.values.iter().enumerate() {
                // The marks of the runs and of their mean stand side by side, so that they do not hide each other.
                let beside = 0.06 + 0.38 * (i as f64 + 0.5) / column.values.len() as f64;
                marker(&screen, column.series, at(x + beside * width, value * self.factor), 2.6, false)?;
            }
            let mean = column.estimate.iqm * self.factor;
            let x = x - 0.14 * width;
            if let Some([low, high]) = column.estimate.interval {
                let bar = vec![(x, low * self.factor), (x, high * self.factor)];
                plot.draw(&PathElement::new(bar, series_color(column.series).stroke_width(fine(2.4))))?;
            }
            marker(&screen, column.series, at(x, mean), 5.2, true)?;
        }
        plot.draw(&PathElement::new(vec![(0.0, 0.0), (axes.x.end, 0.0)], INK.stroke_width(super::canvas::FINE)))
    }
}
