//! Success against how many numbers command the hand.

use plotters::element::{PathElement, Polygon, Rectangle};
use plotters::style::Color;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas::{Area, Axes, Drawn, FINE, INK, Key, dashed, draw, fine, head, marker, series_color, text};
use super::{Cell, Figure, SPREAD, csv, label};
use crate::ReportError;
use crate::few_numbers::FewNumbers;
use crate::records::{Analysis, LambdaRecord};
use crate::stats::Estimate;

/// Name of the figure's files.
pub const NAME: &str = "success-numbers";
const TITLE: &str = "Success against how many numbers command the hand";
const SIZE: (u32, u32) = (760, 430);
/// Distance from the most numbers to the place of all joints.
const APART: f64 = 1.3;
/// Distance between two lambdas at the place of all joints.
const BESIDE: f64 = 0.26;
/// Half of the width of a band at the place of all joints.
const HALF_WIDTH: f64 = 0.1;
/// Factor from shares to percent.
const PERCENT: f64 = 100.0;

/// The curve of one lambda.
struct Curve<'a> {
    lambda: f64,
    series: usize,
    few: &'a FewNumbers,
}

/// Draws the figure, if a complete run has measured success with few numbers.
pub fn figure(analysis: &Analysis) -> Result<Option<Figure>, ReportError> {
    let lambdas = analysis.lambdas.iter().enumerate();
    let curves: Vec<Curve<'_>> = lambdas
        .filter_map(|(series, LambdaRecord { lambda, few_numbers, .. })| {
            Some(Curve { lambda: *lambda, series, few: few_numbers.as_ref()? })
        })
        .collect();
    if curves.is_empty() {
        return Ok(None);
    }
    let rows = curves.iter().flat_map(|curve| {
        let row = |numbers: Cell, e: &Estimate| {
            vec![curve.lambda.into(), numbers, e.median.into(), e.min.into(), e.max.into(), e.n.into()]
        };
        let success = curve.few.success.iter().enumerate().map(move |(k, estimate)| row(k.into(), estimate));
        success.chain(std::iter::once(row(Cell::Text("all".to_owned()), &curve.few.all_joints)))
    });
    let caption = "Final evaluation. At every step, the commands are projected on the mean and so many components of the \
                   control synergy; with 0 numbers the command is constant. Success with all joints stands at the right. ";
    let several = curves.iter().any(|curve| curve.few.n_runs > 1);
    Ok(Some(Figure {
        name: NAME.to_owned(),
        title: TITLE.to_owned(),
        caption: format!("{caption}{}", if several { SPREAD } else { "" }),
        svg: draw(NAME, SIZE, |area| paint(area, &curves, analysis.components))?,
        csv: csv(NAME, &["lambda", "numbers", "median", "min", "max", "n_runs"], rows)?,
        is_repeated: false,
    }))
}

fn paint(area: &Area<'_>, curves: &[Curve<'_>], components: Option<usize>) -> Drawn {
    let entries: Vec<(Key, String)> =
        curves.iter().map(|curve| (Key::Series(curve.series), label(curve.lambda, curve.few.n_runs))).collect();
    let rest = head(area, TITLE, &entries)?;
    let most = curves.iter().map(|curve| curve.few.success.len()).max().unwrap_or(1) - 1;
    let all_joints = most as f64 + APART;
    let half = BESIDE * (curves.len() - 1) as f64 / 2.0;
    let axes = Axes {
        x: -0.3..all_joints + half + 0.5,
        y: 0.0..PERCENT,
        x_name: "numbers that command the hand",
        y_name: "success rate (%)",
        x_digits: 0,
        y_digits: 0,
    };
    let chart = axes.draw_named(&rest)?;
    let plot = chart.plotting_area();
    // Marks and names use the whole area, because they reach beyond the plot.
    let screen = rest.use_screen_coord();
    let places = (0..=most).map(|k| (k as f64, k.to_string())).chain([(all_joints, "all joints".to_owned())]);
    for (x, name) in places {
        let (x, y) = plot.map_coordinate(&(x, 0.0));
        screen.draw(&PathElement::new(vec![(x, y), (x, y + fine(4.0) as i32)], INK.stroke_width(FINE)))?;
        write(&screen, &name, (x, y + fine(9.0) as i32), Pos::new(HPos::Center, VPos::Top))?;
    }
    if let Some(k) = components.filter(|k| *k <= most).map(|k| k as f64) {
        plot.draw(&dashed(vec![(k, 0.0), (k, PERCENT)], INK.mix(0.4).stroke_width(fine(1.0))))?;
        let (x, y) = plot.map_coordinate(&(k, 4.0));
        write(&screen, "as configured", (x + fine(6.0) as i32, y), Pos::new(HPos::Left, VPos::Center))?;
    }
    for Curve { series, few, .. } in curves {
        let at = |value: fn(&Estimate) -> f64| {
            few.success.iter().enumerate().map(move |(k, e)| (k as f64, PERCENT * value(e)))
        };
        let color = series_color(*series);
        let band: Vec<(f64, f64)> = at(|e| e.max).chain(at(|e| e.min).rev()).collect();
        plot.draw(&Polygon::new(band, color.mix(0.18)))?;
    }
    for (i, Curve { series, few, .. }) in curves.iter().enumerate() {
        let color = series_color(*series);
        let line: Vec<(f64, f64)> =
            few.success.iter().enumerate().map(|(k, e)| (k as f64, PERCENT * e.median)).collect();
        let Estimate { median, min, max, .. } = few.all_joints;
        let x = all_joints - half + BESIDE * i as f64;
        let (low, high) = ((x - HALF_WIDTH, PERCENT * min), (x + HALF_WIDTH, PERCENT * max));
        plot.draw(&Rectangle::new([low, high], color.mix(0.18).filled()))?;
        let end = (x, PERCENT * median);
        plot.draw(&dashed(line.last().copied().into_iter().chain([end]).collect(), color.stroke_width(fine(1.6))))?;
        plot.draw(&PathElement::new(line.clone(), color.stroke_width(fine(2.2))))?;
        for point in line.iter().chain([&end]) {
            marker(&screen, *series, plot.map_coordinate(point), 3.6, true)?;
        }
    }
    Ok(())
}

/// Writes words at a place of the whole drawing.
fn write(screen: &Area<'_>, words: &str, (x, y): (i32, i32), anchor: Pos) -> Drawn {
    // plotters places text relative to the corner of its area, even if the coordinates are those of the screen.
    let (left, above) = screen.get_base_pixel();
    screen.draw_text(words, &text(13.0).pos(anchor), (x - left, y - above))
}

#[cfg(test)]
mod tests {
    use crate::analyse;
    use crate::figures::all;
    use crate::made_up::{complete, interrupted, without_few_numbers};

    #[test]
    fn the_first_figure_has_a_curve_for_each_lambda_with_these_numbers() {
        let runs = [
            complete(0.0, 1, 0.9, &[0.1, 0.3, 0.5], Some(2)),
            complete(0.0, 2, 0.8, &[0.2, 0.4, 0.7], None),
            complete(1.0, 1, 0.97, &[0.1, 0.9, 0.95], Some(2)),
            without_few_numbers(0.5, 1),
        ];
        let figures = all(&runs, &analyse(&runs)).expect("drawn");
        assert_eq!(figures[0].name, super::NAME);
        let csv = String::from_utf8(figures[0].csv.clone()).expect("text");
        let expected = "lambda,numbers,median,min,max,n_runs\n0,0,0.15000000000000002,0.1,0.2,2\n0,1,0.35,0.3,0.4,2\n\
                        0,2,0.6,0.5,0.7,2\n0,all,0.8500000000000001,0.8,0.9,2\n1,0,0.1,0.1,0.1,1\n1,1,0.9,0.9,0.9,1\n\
                        1,2,0.95,0.95,0.95,1\n1,all,0.97,0.97,0.97,1\n";
        assert_eq!(csv, expected);
        assert!(figures[0].svg.contains("all joints") && !figures[0].svg.contains("\u{3bb} = 0.5"));
    }

    #[test]
    fn runs_without_few_numbers_have_no_such_figure() {
        let runs = [without_few_numbers(0.0, 1), interrupted(1.0, 1)];
        let names: Vec<String> = all(&runs, &analyse(&runs)).expect("drawn").into_iter().map(|f| f.name).collect();
        assert!(!names.iter().any(|name| name == super::NAME) && names.iter().any(|name| name == "success-episodes"));
    }

    #[test]
    fn success_with_the_components_is_drawn_beside_all_joints() {
        let runs = [interrupted(1.0, 1), without_few_numbers(1.0, 2)];
        let figures = all(&runs, &analyse(&runs)).expect("drawn");
        let figure = figures.iter().find(|figure| figure.name == "success-components").expect("a figure");
        let csv = String::from_utf8(figure.csv.clone()).expect("text");
        let rows: Vec<&str> = csv.lines().collect();
        assert_eq!(rows[0], "lambda,quantity,episode,median,min,max,n_runs");
        assert!(rows[1].starts_with("1,success_with_components,300,") && rows[1].ends_with(",1"), "{csv}");
        assert!(rows[11].starts_with("1,success_rate,100,") && rows[11].ends_with(",2"), "{csv}");
    }
}
