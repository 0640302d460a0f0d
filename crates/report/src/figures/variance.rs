//! The variance of end postures against the number of components, beside published figures of human hands.

use plotters::element::{PathElement, Polygon};
use plotters::style::Color;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas::{Area, Axes, Drawn, FINE, INK, Key, dashed, draw, fine, head, marker, series_color, text};
use super::{Cell, Figure, Group, csv, spread};
use crate::ReportError;

const NAME: &str = "variance-components";
const TITLE: &str = "Variance of end postures against components";
const SIZE: (u32, u32) = (760, 430);
/// Components on the axis, at most.
const MOST: usize = 15;
/// Factor from shares to percent.
const PERCENT: f64 = 100.0;

/// Published figures of human hands: components, the share that they exceed, and where it is from.
const HUMAN: [(usize, f64, &str); 3] = [(2, 0.80, "human, 1998"), (3, 0.50, "human, 2019"), (12, 0.80, "human, 2019")];

/// Draws the figure, if a run has enough end postures.
pub fn figure(groups: &[Group<'_>]) -> Result<Option<Figure>, ReportError> {
    let curves: Vec<(usize, &Group<'_>, Vec<[f64; 3]>)> = groups
        .iter()
        .enumerate()
        .map(|(series, group)| (series, group, curve(group)))
        .filter(|(_, _, curve)| !curve.is_empty())
        .collect();
    if curves.is_empty() {
        return Ok(None);
    }
    let rows = curves.iter().flat_map(|(_, group, curve)| {
        curve.iter().enumerate().map(|(i, [median, low, high])| {
            vec![Cell::Text(group.key.clone()), (i + 1).into(), (*median).into(), (*low).into(), (*high).into()]
        })
    });
    let human = HUMAN.iter().map(|(k, share, source)| {
        // They exceed the share: it is a lower bound.
        vec![Cell::Text((*source).to_owned()), (*k).into(), f64::NAN.into(), (*share).into(), f64::NAN.into()]
    });
    let caption = "Share of the variance of the end postures in the first components. Dashed lines end in diamonds at published figures: human hands exceed these shares in other tasks, with other joints: two \
                   components hold more than 80 % of 15 joints (57 imagined objects; Santello, Flanders and Soechting 1998, J. \
                   Neurosci. 18(23)); three hold more than 50 % and twelve more than 80 % (77 subjects, activities of daily living; \
                   2019, doi 10.1186/s12984-019-0536-6). So they are a scale, and no bar. ";
    Ok(Some(Figure {
        name: NAME.to_owned(),
        title: TITLE.to_owned(),
        caption: format!("{caption}{}", spread(groups)),
        svg: draw(NAME, SIZE, |area| paint(area, &curves))?,
        csv: csv(NAME, &["lambda", "components", "median", "min", "max"], rows.chain(human))?,
        is_repeated: false,
    }))
}

/// Median, least and greatest share of the runs with the first component, with the first two, and so on.
fn curve(group: &Group<'_>) -> Vec<[f64; 3]> {
    let shares: Vec<&[f64]> =
        group.runs.iter().map(|run| run.end_variance.as_slice()).filter(|s| !s.is_empty()).collect();
    let n = shares.iter().map(|shares| shares.len()).min().unwrap_or(0).min(MOST);
    (0..n)
        .filter_map(|i| {
            let values: Vec<f64> = shares.iter().map(|shares| shares[i]).collect();
            let [low, high] = [f64::min, f64::max].map(|pick| values.iter().copied().reduce(pick).unwrap_or(f64::NAN));
            Some([crate::stats::median(&values)?, low, high])
        })
        .collect()
}

fn paint(area: &Area<'_>, curves: &[(usize, &Group<'_>, Vec<[f64; 3]>)]) -> Drawn {
    let entries: Vec<(Key, String)> =
        curves.iter().map(|(series, group, _)| (Key::Series(*series), group.label.clone())).collect();
    let rest = head(area, TITLE, &entries)?;
    let most = curves.iter().map(|(_, _, curve)| curve.len()).max().unwrap_or(1).max(HUMAN[2].0);
    let axes = Axes {
        x: 0.5..most as f64 + 0.5,
        y: 0.0..PERCENT,
        x_name: "components",
        y_name: "share of the variance (%)",
        x_digits: 0,
        y_digits: 0,
    };
    let chart = axes.draw(&rest)?;
    let plot = chart.plotting_area();
    let screen = rest.use_screen_coord();
    for (series, _, curve) in curves {
        let at = |which: usize| curve.iter().enumerate().map(move |(i, c)| ((i + 1) as f64, PERCENT * c[which]));
        let band: Vec<(f64, f64)> = at(2).chain(at(1).rev()).collect();
        plot.draw(&Polygon::new(band, series_color(*series).mix(0.18)))?;
        plot.draw(&PathElement::new(at(0).collect::<Vec<_>>(), series_color(*series).stroke_width(fine(2.2))))?;
        for point in at(0) {
            marker(&screen, *series, plot.map_coordinate(&point), 3.6, true)?;
        }
    }
    for (k, share, source) in HUMAN {
        let at = |x: f64| (x, PERCENT * share);
        plot.draw(&dashed(vec![at(axes.x.start), at(k as f64)], INK.mix(0.6).stroke_width(FINE)))?;
        let (x, y) = plot.map_coordinate(&at(k as f64));
        let half = fine(5.0) as i32;
        let corners = vec![(x, y - half), (x + half, y), (x, y + half), (x - half, y)];
        screen.draw(&Polygon::new(corners, INK.filled()))?;
        // plotters places text relative to the corner of its area, even if the coordinates are those of the screen.
        let (left, above) = screen.get_base_pixel();
        let style = text(12.0).pos(Pos::new(HPos::Center, VPos::Bottom));
        screen.draw_text(source, &style, (x - left, y - fine(8.0) as i32 - above))?;
    }
    Ok(())
}
