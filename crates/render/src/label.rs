//! Text on pictures.

use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};
use eigenhand_font::FONT;

use crate::Picture;

/// Height of a line, and distance of a label from the picture's edges, in pixels.
const LINE: f32 = 18.0;
const MARGIN: f32 = 8.0;
/// Red, green and blue of text, and of the plate behind it, which covers a share of what is there.
const INK: [f32; 3] = [30.0, 30.0, 40.0];
const PLATE: [f32; 3] = [255.0; 3];
const PLATE_COVER: f32 = 0.7;
/// Width in pixels of the plate around the text.
const PLATE_EDGE: f32 = 2.0;

impl Picture {
    /// Writes a text into the lower left corner.
    #[must_use]
    pub fn labelled(mut self, text: &str) -> Picture {
        let base = self.height as f32 - MARGIN;
        self.write(text, [MARGIN, base]);
        self
    }

    /// Writes a text that begins at a pixel (column, row of the base line). If it would leave the picture to the right,
    /// it is moved to the left; what lies outside the picture is left out.
    pub fn write(&mut self, text: &str, [column, row]: [f32; 2]) {
        // The font is part of the program, so it can be read.
        let Ok(font) = FontRef::try_from_slice(FONT) else { return };
        let font = font.into_scaled(PxScale::from(LINE));
        let mut glyphs: Vec<Glyph> = Vec::new();
        let mut end = 0.0;
        for letter in text.chars() {
            let mut glyph = font.scaled_glyph(letter);
            if let Some(previous) = glyphs.last() {
                end += font.kern(previous.id, glyph.id);
            }
            glyph.position = point(end, row);
            end += font.h_advance(glyph.id);
            glyphs.push(glyph);
        }
        let left = column.min(self.width as f32 - MARGIN - end).max(0.0);
        let (top, bottom) = (row - font.ascent() - PLATE_EDGE, row - font.descent() + PLATE_EDGE);
        for y in top as i32..bottom as i32 {
            for x in (left - PLATE_EDGE) as i32..(left + end + PLATE_EDGE) as i32 {
                self.blend([x as f32, y as f32], PLATE, PLATE_COVER);
            }
        }
        for mut glyph in glyphs {
            glyph.position.x += left;
            let Some(outline) = font.outline_glyph(glyph) else { continue };
            let corner = outline.px_bounds().min;
            outline.draw(|x, y, cover| self.blend([corner.x + x as f32, corner.y + y as f32], INK, cover));
        }
    }

    /// Covers a share of a pixel with a colour.
    fn blend(&mut self, [column, row]: [f32; 2], colour: [f32; 3], cover: f32) {
        if column < 0.0 || row < 0.0 || column >= self.width as f32 {
            return;
        }
        let first = 3 * (row as usize * self.width + column as usize);
        for (byte, part) in self.rgb.iter_mut().skip(first).take(3).zip(colour) {
            *byte = (f32::from(*byte) + cover.clamp(0.0, 1.0) * (part - f32::from(*byte))).round() as u8;
        }
    }
}
