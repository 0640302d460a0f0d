//! Pixels, pictures side by side, PNG and GIF.

use crate::error::RenderError;

/// Width in pixels of the gap between two pictures, and its colour.
const GAP: usize = 4;
const GAP_COLOUR: u8 = 255;
/// Unit of a GIF's delays, in s.
const GIF_TICK: f64 = 0.01;
/// How coarsely the colours of a GIF are chosen, from 1 (best) to 30 (fastest).
const QUANTISATION: i32 = 10;

/// A picture of red, green and blue bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Red, green and blue of each pixel, row by row from the upper left.
    pub rgb: Vec<u8>,
}

impl Picture {
    /// Returns the colour of a pixel, if it is in the picture.
    pub fn pixel(&self, column: usize, row: usize) -> Option<[u8; 3]> {
        if column >= self.width {
            return None;
        }
        let first = 3 * (row * self.width + column);
        self.rgb.get(first..first + 3)?.first_chunk().copied()
    }

    /// Puts pictures side by side with a thin gap.
    pub fn beside(pictures: &[Picture]) -> Picture {
        Picture::grid(pictures, pictures.len())
    }

    /// Puts pictures in rows of `columns` with thin gaps. Every cell is as large as the largest picture.
    pub fn grid(pictures: &[Picture], columns: usize) -> Picture {
        let columns = columns.clamp(1, pictures.len().max(1));
        let rows = pictures.len().div_ceil(columns);
        let cell_width = pictures.iter().map(|picture| picture.width).max().unwrap_or(0);
        let cell_height = pictures.iter().map(|picture| picture.height).max().unwrap_or(0);
        let along = |cells: usize, size: usize| cells * size + cells.saturating_sub(1) * GAP;
        let (width, height) = (along(columns, cell_width), along(rows, cell_height));
        let mut rgb = vec![GAP_COLOUR; 3 * width * height];
        for (index, picture) in pictures.iter().enumerate() {
            let (left, top) = (index % columns * (cell_width + GAP), index / columns * (cell_height + GAP));
            for (row, line) in picture.rgb.chunks_exact(3 * picture.width.max(1)).take(picture.height).enumerate() {
                let first = 3 * ((top + row) * width + left);
                rgb[first..first + line.len()].copy_from_slice(line);
            }
        }
        Picture { width, height, rgb }
    }

    /// Returns a moving picture as a GIF file that repeats: each picture is shown for so many seconds.
    ///
    /// # Errors
    /// [`RenderError::Frames`] for pictures of different sizes, or none; [`RenderError::Movie`].
    pub fn gif(frames: &[(Picture, f64)]) -> Result<Vec<u8>, RenderError> {
        let side = |length: usize| u16::try_from(length).ok().filter(|&length| length > 0);
        let size = frames.first().and_then(|(first, _)| Some((side(first.width)?, side(first.height)?)));
        let same = |(picture, _): &(Picture, f64)| {
            side(picture.width).zip(side(picture.height)) == size
                && picture.rgb.len() == 3 * picture.width * picture.height
        };
        let Some((width, height)) = size.filter(|_| frames.iter().all(same)) else { return Err(RenderError::Frames) };
        let mut file = Vec::new();
        let mut encode = || -> Result<(), gif::EncodingError> {
            let mut encoder = gif::Encoder::new(&mut file, width, height, &[])?;
            encoder.set_repeat(gif::Repeat::Infinite)?;
            for (picture, seconds) in frames {
                let mut frame = gif::Frame::from_rgb_speed(width, height, &picture.rgb, QUANTISATION);
                frame.delay = (seconds / GIF_TICK).round() as u16;
                encoder.write_frame(&frame)?;
            }
            Ok(())
        };
        encode().map_err(RenderError::Movie)?;
        Ok(file)
    }

    /// Returns the picture as a PNG file.
    ///
    /// # Errors
    /// [`RenderError::Picture`] for a picture without pixels or with fewer bytes than pixels.
    pub fn png(&self) -> Result<Vec<u8>, RenderError> {
        let mut file = Vec::new();
        let mut encode = || {
            let (width, height) = (u32::try_from(self.width), u32::try_from(self.height));
            let mut encoder = png::Encoder::new(&mut file, width.unwrap_or(0), height.unwrap_or(0));
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_depth(png::BitDepth::Eight);
            let mut writer = encoder.write_header()?;
            writer.write_image_data(&self.rgb)?;
            writer.finish()
        };
        match encode() {
            Ok(()) => Ok(file),
            Err(source) => Err(RenderError::Picture { width: self.width, height: self.height, source }),
        }
    }
}
