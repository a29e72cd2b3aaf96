//! Cutting of a UVC device's picture into the squares of its pads.

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::TactileImage;
use image::codecs::jpeg::JpegDecoder;
use image::{ColorType, ImageDecoder};

/// Error of a picture.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PictureError {
    /// The number of bytes does not fit the size.
    #[error("yuyv: found {found} bytes, expected {expected}")]
    Length {
        /// Bytes received.
        found: usize,
        /// Bytes expected: two per pixel.
        expected: usize,
    },
    /// The picture has another size than configured.
    #[error("mjpeg: found {found:?}, expected {expected:?}")]
    Size {
        /// Columns and rows.
        found: (u32, u32),
        /// Columns and rows.
        expected: (u32, u32),
    },
    /// The data is not a usable JPEG.
    #[error("mjpeg: {0}")]
    Jpeg(String),
    /// The square does not lie within the picture.
    #[error("square at {corner:?}: expected it within {size:?}")]
    Square {
        /// First column and row of the square.
        corner: (u32, u32),
        size: (u32, u32),
    },
}

/// A whole picture, RGB, row by row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Columns and rows, pixels.
    pub size: (u32, u32),
    /// Pixels, three bytes each.
    pub rgb: Vec<u8>,
}

/// Marker for a webcam's JPEG that leaves out its Huffman tables: with it, decoders use the standard tables.
const AVI1_MARKER: [u8; 18] = *b"\xFF\xE0\x00\x10AVI1\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00";
/// Marker that begins a Huffman table.
const HUFFMAN_MARKER: [u8; 2] = [0xFF, 0xC4];

impl Picture {
    /// Decodes a frame of a motion-JPEG stream, which must have this `size`.
    ///
    /// # Errors
    /// [`PictureError::Jpeg`], [`PictureError::Size`].
    pub fn from_mjpeg(data: &[u8], size: (u32, u32)) -> Result<Self, PictureError> {
        let Some(rest) = data.strip_prefix(&[0xFF, 0xD8]) else {
            return Err(PictureError::Jpeg("no start marker FF D8".to_owned()));
        };
        let complete = rest.windows(2).any(|pair| pair == HUFFMAN_MARKER);
        let data = if complete { data.to_vec() } else { [&[0xFF, 0xD8], &AVI1_MARKER[..], rest].concat() };
        let failed = |error: image::ImageError| PictureError::Jpeg(error.to_string());
        let decoder = JpegDecoder::new(std::io::Cursor::new(data)).map_err(failed)?;
        let found = decoder.dimensions();
        if found != size {
            return Err(PictureError::Size { found, expected: size });
        }
        if decoder.color_type() != ColorType::Rgb8 {
            return Err(PictureError::Jpeg(format!("found {:?}, expected colour", decoder.color_type())));
        }
        let mut rgb = vec![0; 3 * size.0 as usize * size.1 as usize];
        decoder.read_image(&mut rgb).map_err(failed)?;
        Ok(Self { size, rgb })
    }

    /// Decodes a YUYV frame: four bytes hold two pixels, which share a colour. The conversion is ITU-R BT.601 with its
    /// limited range, the default of UVC.
    ///
    /// # Errors
    /// [`PictureError::Length`].
    pub fn from_yuyv(data: &[u8], size: (u32, u32)) -> Result<Self, PictureError> {
        let expected = 2 * size.0 as usize * size.1 as usize;
        if data.len() != expected {
            return Err(PictureError::Length { found: data.len(), expected });
        }
        let mut rgb = Vec::with_capacity(expected / 2 * 3);
        for pair in data.chunks_exact(4) {
            let (u, v) = (f32::from(pair[1]) - 128.0, f32::from(pair[3]) - 128.0);
            for y in [pair[0], pair[2]] {
                let y = 255.0 / 219.0 * (f32::from(y) - 16.0);
                // A conversion of a float to a byte saturates.
                rgb.extend([y + 1.596 * v, y - 0.392 * u - 0.813 * v, y + 2.017 * u].map(|value| (value + 0.5) as u8));
            }
        }
        Ok(Self { size, rgb })
    }

    /// Cuts out the square of a pad's camera that begins at `corner` (column, row).
    ///
    /// # Errors
    /// [`PictureError::Square`].
    pub fn square(&self, corner: (u32, u32)) -> Result<TactileImage, PictureError> {
        let side = IMAGE_SIZE as u32;
        let fits = |start: u32, length: u32| start.checked_add(side).is_some_and(|end| end <= length);
        if !fits(corner.0, self.size.0) || !fits(corner.1, self.size.1) {
            return Err(PictureError::Square { corner, size: self.size });
        }
        let row_bytes = 3 * self.size.0 as usize;
        let rows = self.rgb.chunks_exact(row_bytes).skip(corner.1 as usize).take(IMAGE_SIZE);
        let first = 3 * corner.0 as usize;
        Ok(TactileImage { rgb: rows.flat_map(|row| &row[first..first + 3 * IMAGE_SIZE]).copied().collect() })
    }
}

#[cfg(test)]
mod tests {
    use image::ExtendedColorType;
    use image::codecs::jpeg::JpegEncoder;

    use super::*;

    const SIZE: (u32, u32) = (640, 480);

    /// A ramp to the right in red, downwards in green.
    fn ramp() -> Vec<u8> {
        (0..SIZE.1).flat_map(|y| (0..SIZE.0).flat_map(move |x| [(x / 3) as u8, (y / 2) as u8, 60])).collect()
    }

    fn jpeg() -> Vec<u8> {
        let mut data = Vec::new();
        JpegEncoder::new_with_quality(&mut data, 90)
            .encode(&ramp(), SIZE.0, SIZE.1, ExtendedColorType::Rgb8)
            .expect("coded");
        data
    }

    /// Returns the JPEG without its Huffman tables, as webcams send it.
    fn without_tables(data: &[u8]) -> Vec<u8> {
        let (mut kept, mut place) = (data[..2].to_vec(), 2);
        // Segments up to the start of scan.
        while data[place + 1] != 0xDA {
            let length = 2 + usize::from(u16::from_be_bytes([data[place + 2], data[place + 3]]));
            if data[place + 1] != 0xC4 {
                kept.extend(&data[place..place + length]);
            }
            place += length;
        }
        kept.extend(&data[place..]);
        kept
    }

    #[test]
    fn a_webcams_jpeg_needs_no_tables() {
        let whole = Picture::from_mjpeg(&jpeg(), SIZE).expect("a picture");
        let bare = without_tables(&jpeg());
        assert!(bare.len() + 400 < jpeg().len(), "the tables are gone");
        assert_eq!(Picture::from_mjpeg(&bare, SIZE), Ok(whole.clone()));
        let worst = whole.rgb.iter().zip(ramp()).map(|(a, b)| a.abs_diff(b)).max();
        assert!(worst.is_some_and(|worst| worst < 12), "{worst:?}");
        assert!(matches!(Picture::from_mjpeg(&jpeg(), (320, 240)), Err(PictureError::Size { .. })));
        assert!(matches!(Picture::from_mjpeg(&jpeg()[2..], SIZE), Err(PictureError::Jpeg(_))));
    }

    /// Black, white, and the colour that BT.601 gives pure red (Y 81, U 90, V 240).
    #[test]
    fn yuyv_colours() {
        let rgb = |y, u, v| Picture::from_yuyv(&[y, u, y, v], (2, 1)).expect("a picture").rgb;
        assert_eq!(rgb(16, 128, 128), [0; 6]);
        assert_eq!(rgb(235, 128, 128), [255; 6]);
        let red = rgb(81, 90, 240);
        assert!(red[0] > 252 && red[1] < 3 && red[2] < 3, "{red:?}");
        let short = Picture::from_yuyv(&[0; 3], (2, 1));
        assert_eq!(short, Err(PictureError::Length { found: 3, expected: 4 }));
    }

    #[test]
    fn squares_are_cut_where_they_are() {
        let picture = Picture { size: SIZE, rgb: ramp() };
        let square = picture.square((150, 240)).expect("within");
        assert_eq!(square.rgb.len(), 3 * IMAGE_SIZE * IMAGE_SIZE);
        assert_eq!(square.rgb[..3], [50, 120, 60]);
        let last = 3 * (IMAGE_SIZE * IMAGE_SIZE - 1);
        assert_eq!(square.rgb[last..], [((150 + 239) / 3) as u8, ((240 + 239) / 2) as u8, 60]);
        for corner in [(401, 0), (0, 241), (u32::MAX, 0)] {
            assert_eq!(picture.square(corner), Err(PictureError::Square { corner, size: SIZE }));
        }
    }
}
