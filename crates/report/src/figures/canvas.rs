//! Shared parts of all figures: canvas, colours, axes, legends, and rendering as PNG.

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use eigenhand_font::FONT;
use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind, IntoDrawingArea};
use plotters::element::{Circle, DashedPathElement, PathElement, Polygon, Rectangle};
use plotters::prelude::{Cartesian2d, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontStyle, IntoFont, RGBColor, ShapeStyle, TextStyle, register_font};
use resvg::{tiny_skia, usvg};

use crate::ReportError;

const FAMILY: &str = "sans-serif";
/// Drawing units per unit of a figure's size. Coordinates are whole numbers, and curves need finer steps than the size
/// has.
pub const FINE: u32 = 4;
/// Pixels of a picture for each unit of a drawing's size.
const PNG_SCALE: f32 = 2.0;

/// Text, axes and the line of success.
pub const INK: RGBColor = RGBColor(0x1F, 0x23, 0x28);
/// Background.
pub const PAPER: RGBColor = RGBColor(0xFF, 0xFF, 0xFF);
/// One colour for each lambda or variant. People with any colour vision can tell the first six apart (Okabe and Ito 2008);
/// the marks tell the others apart.
const SERIES: [RGBColor; 9] = [
    RGBColor(0x00, 0x72, 0xB2),
    RGBColor(0xD5, 0x5E, 0x00),
    RGBColor(0x00, 0x9E, 0x73),
    RGBColor(0xCC, 0x79, 0xA7),
    RGBColor(0xE6, 0x9F, 0x00),
    RGBColor(0x56, 0xB4, 0xE9),
    RGBColor(0x6A, 0x3D, 0x9A),
    RGBColor(0x7F, 0x7F, 0x7F),
    RGBColor(0x8C, 0x56, 0x4B),
];
/// Colours of the components; from the first to the last they become lighter.
const COMPONENTS: [RGBColor; 5] = [
    RGBColor(0x3B, 0x7D, 0xB8),
    RGBColor(0x5F, 0xA3, 0xD0),
    RGBColor(0x8C, 0xC2, 0xDE),
    RGBColor(0xB7, 0xD9, 0xEA),
    RGBColor(0xDC, 0xEB, 0xF4),
];

/// A drawing in progress.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// A chart with two axes of numbers.
pub type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
/// Result of drawing.
pub type Drawn<T = ()> = Result<T, DrawingAreaErrorKind<std::io::Error>>;

/// Returns the colour of a lambda or variant by its position.
pub fn series_color(i: usize) -> RGBColor {
    SERIES[i % SERIES.len()]
}

/// Returns the colour of a component by its position.
pub fn component_color(i: usize) -> RGBColor {
    COMPONENTS[i.min(COMPONENTS.len() - 1)]
}

/// Converts a size to the units of the drawing.
pub fn fine(size: f64) -> u32 {
    (size * f64::from(FINE)).round() as u32
}

/// Draws a figure of a size and returns it as SVG.
///
/// # Errors
/// [`ReportError::Draw`] names the figure.
pub fn draw(
    name: &str,
    (width, height): (u32, u32),
    paint: impl FnOnce(&Area<'_>) -> Drawn,
) -> Result<String, ReportError> {
    static REGISTERED: OnceLock<bool> = OnceLock::new();
    let failed = ReportError::draw(name);
    if !REGISTERED.get_or_init(|| register_font(FAMILY, FontStyle::Normal, FONT).is_ok()) {
        return Err(failed("its font is damaged".to_owned()));
    }
    let mut svg = String::new();
    let size = (width * FINE, height * FINE);
    {
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        paint(&area).and_then(|()| area.present()).map_err(|error| failed(error.to_string()))?;
    }
    // The SVG has the figure's size; only its coordinates are finer.
    let fine = format!("width=\"{}\" height=\"{}\"", size.0, size.1);
    Ok(svg.replacen(&fine, &format!("width=\"{width}\" height=\"{height}\""), 1))
}

/// Renders a drawing as PNG on white.
///
/// # Errors
/// [`ReportError::Draw`] names the figure.
pub fn render_png(name: &str, svg: &str) -> Result<Vec<u8>, ReportError> {
    let failed = ReportError::draw(name);
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(FONT.to_vec());
    fonts.set_sans_serif_family("DejaVu Sans");
    let options = usvg::Options { fontdb: Arc::new(fonts), ..usvg::Options::default() };
    let tree = usvg::Tree::from_str(svg, &options).map_err(|error| failed(error.to_string()))?;
    let size = tree.size();
    let (width, height) = ((size.width() * PNG_SCALE) as u32, (size.height() * PNG_SCALE) as u32);
    let mut picture = tiny_skia::Pixmap::new(width, height).ok_or_else(|| failed("it has no size".to_owned()))?;
    picture.fill(tiny_skia::Color::WHITE);
    resvg::render(&tree, tiny_skia::Transform::from_scale(PNG_SCALE, PNG_SCALE), &mut picture.as_mut());
    picture.encode_png().map_err(|error| failed(error.to_string()))
}

/// Returns the style of text of a size.
pub fn text(size: f64) -> TextStyle<'static> {
    // plotters expects the height of a line, which is larger than the text's size by this factor.
    const LINE_HEIGHT: f64 = 1.24;
    (FAMILY, fine(size * LINE_HEIGHT) as i32).into_font().color(&INK)
}

/// Ranges, names and digits of a chart's axes.
pub struct Axes<'a> {
    /// Range of x.
    pub x: Range<f64>,
    /// Range of y.
    pub y: Range<f64>,
    /// Name of x, with its unit.
    pub x_name: &'a str,
    /// Name of y, with its unit.
    pub y_name: &'a str,
    /// Digits of the numbers at x.
    pub x_digits: usize,
    /// Digits of the numbers at y.
    pub y_digits: usize,
}

impl Axes<'_> {
    /// Draws the axes into an area.
    pub fn draw<'b>(&self, area: &Area<'b>) -> Drawn<Chart<'b, 'b>> {
        self.draw_with(area, true)
    }

    /// Draws the axes without numbers at x, so that names can take their place.
    pub fn draw_named<'b>(&self, area: &Area<'b>) -> Drawn<Chart<'b, 'b>> {
        self.draw_with(area, false)
    }

    fn draw_with<'b>(&self, area: &Area<'b>, numbered: bool) -> Drawn<Chart<'b, 'b>> {
        let mut chart = ChartBuilder::on(area)
            .margin(fine(6.0))
            .margin_right(fine(16.0))
            .x_label_area_size(fine(44.0))
            .y_label_area_size(fine(58.0))
            .build_cartesian_2d(self.x.clone(), self.y.clone())?;
        let (x_digits, y_digits) = (self.x_digits, self.y_digits);
        chart
            .configure_mesh()
            .disable_x_mesh()
            .light_line_style(INK.mix(0.0))
            .bold_line_style(ShapeStyle::from(&INK.mix(0.13)).stroke_width(FINE))
            .axis_style(ShapeStyle::from(&INK).stroke_width(FINE))
            .set_all_tick_mark_size(fine(4.0))
            .label_style(text(13.0))
            .axis_desc_style(text(14.0))
            .x_desc(self.x_name)
            .y_desc(self.y_name)
            .x_labels(if numbered { 7 } else { 0 })
            .y_labels(6)
            .x_label_formatter(&|x| format!("{x:.x_digits$}"))
            .y_label_formatter(&|y| format!("{y:.y_digits$}"))
            .draw()?;
        Ok(chart)
    }
}

/// An entry of a legend.
pub enum Key {
    /// A filled square.
    Square(RGBColor),
    /// The line of a series, by its position.
    Series(usize),
    /// The line of success.
    Ink,
    /// A dashed line of any series.
    Dashed,
}

/// Makes a dashed line.
pub fn dashed<P: Clone>(points: Vec<P>, style: ShapeStyle) -> DashedPathElement<std::vec::IntoIter<P>, u32> {
    DashedPathElement::new(points, fine(6.0), fine(4.0), style)
}

/// Writes a title and a legend below it, and returns the rest of the area.
pub fn head<'a>(area: &Area<'a>, title: &str, entries: &[(Key, String)]) -> Drawn<Area<'a>> {
    const LEFT: f64 = 14.0;
    const ROW: f64 = 22.0;
    const KEY: f64 = 22.0;
    let (width, _) = area.dim_in_pixel();
    let at = |x: f64, y: f64| (fine(x) as i32, fine(y) as i32);
    let middle = Pos::new(HPos::Left, VPos::Center);
    area.draw_text(title, &text(16.0).pos(middle), at(LEFT, 16.0))?;
    let style = text(13.0).pos(middle);
    let (mut x, mut y) = (LEFT, 16.0 + ROW);
    for (key, label) in entries {
        let (label_width, _) = area.estimate_text_size(label, &style)?;
        let entry = KEY + 6.0 + f64::from(label_width) / f64::from(FINE) + 16.0;
        if x > LEFT && fine(x + entry) > width {
            (x, y) = (LEFT, y + ROW - 2.0);
        }
        let (from, to) = (at(x, y), at(x + KEY, y));
        match key {
            Key::Square(color) => {
                area.draw(&Rectangle::new([at(x + 5.0, y - 6.0), at(x + 17.0, y + 6.0)], color.filled()))?;
            }
            Key::Ink => area.draw(&PathElement::new(vec![from, to], INK.stroke_width(fine(2.2))))?,
            Key::Dashed => area.draw(&dashed(vec![from, to], INK.stroke_width(fine(1.6))))?,
            Key::Series(i) => {
                area.draw(&PathElement::new(vec![from, to], series_color(*i).stroke_width(fine(2.0))))?;
                marker(area, *i, at(x + KEY / 2.0, y), 4.5, true)?;
            }
        }
        area.draw_text(label, &style, at(x + KEY + 6.0, y))?;
        x += entry;
    }
    let used = if entries.is_empty() { 16.0 + 14.0 } else { y + 14.0 };
    Ok(area.split_vertically(fine(used)).1)
}

/// Draws the mark of a series. Its shape identifies the series also without colours.
pub fn marker(area: &Area<'_>, series: usize, (x, y): (i32, i32), size: f64, filled: bool) -> Drawn {
    let color = series_color(series);
    let style = if filled { color.filled() } else { color.stroke_width(fine(1.2)) };
    let half = fine(size) as i32;
    let corners = match series % 4 {
        0 => return area.draw(&Circle::new((x, y), half, style)),
        1 => vec![(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)],
        2 => vec![(x, y - half), (x + half, y + half), (x - half, y + half)],
        _ => vec![(x, y - half), (x + half, y), (x, y + half), (x - half, y)],
    };
    if filled {
        return area.draw(&Polygon::new(corners, style));
    }
    let closed = corners.iter().chain(&corners[..2]).copied().collect::<Vec<_>>();
    area.draw(&PathElement::new(closed, style))
}

/// Rounds up to a number that is easy to read.
pub fn round_up(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return 1.0;
    }
    let power = 10f64.powf(value.log10().floor());
    let steps = [1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0];
    steps.iter().map(|step| step * power).find(|rounded| *rounded >= value * (1.0 - 1e-9)).unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_up() {
        assert_eq!([0.92, 1.0, 37.0, 3000.0, 0.0].map(round_up), [1.0, 1.0, 40.0, 3000.0, 1.0]);
    }

    #[test]
    fn text_is_in_the_picture() {
        let paint = |words: &'static str| {
            let svg = draw("a figure", (200, 40), |area| area.draw_text(words, &text(20.0), (10, 10))).expect("drawn");
            let png = render_png("a figure", &svg).expect("rendered");
            let picture = tiny_skia::Pixmap::decode_png(&png).expect("a PNG");
            assert_eq!((picture.width(), picture.height()), (400, 80));
            picture.pixels().iter().filter(|pixel| pixel.red() < 128).count()
        };
        let (none, little, much) = (paint(" "), paint("\u{3bb}"), paint("success \u{3bb} = 1 (%)"));
        assert!(none == 0 && little > 50 && much > 8 * little, "{none}, {little} and {much} dark pixels");
    }
}
