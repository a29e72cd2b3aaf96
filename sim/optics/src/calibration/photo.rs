//! Images from real sensors, of any size, with 8 bits a channel.

use std::io::Cursor;
use std::path::Path;

use ftac_platform::file::write_atomically;
use image::{DynamicImage, ImageFormat, ImageReader};

use crate::calibration::bitmap;
pub use crate::calibration::rgb_image::Photo;
use crate::error::OpticsError;

/// Bit depth of a camera whose file has 16 bits per value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BitDepth {
    /// Number of bits: 10, 12 or 16.
    pub bits: u32,
    /// Largest value in the file.
    pub largest: u16,
}

impl BitDepth {
    /// Infers the fewest bits that hold the largest value. Cameras of 10 and 12 bits leave the upper bits of a 16-bit
    /// file empty.
    fn from_values(values: &[u16]) -> Self {
        let largest = values.iter().copied().max().unwrap_or(0);
        let bits = [10, 12].into_iter().find(|bits| u32::from(largest) < 1 << bits).unwrap_or(16);
        Self { bits, largest }
    }
}

impl std::fmt::Display for BitDepth {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "16-bit file with values up to {}: {}-bit data", self.largest, self.bits)
    }
}

impl Photo {
    /// Reads a PNG, JPEG or BMP file, recognised by its content.
    pub fn read(path: &Path) -> Result<Self, OpticsError> {
        Self::read_deep(path).map(|(photo, _)| photo)
    }

    /// Like [`Self::read`], with the depth of a 16-bit file. Its values are scaled by the camera's bits, not by the
    /// file's.
    pub fn read_deep(path: &Path) -> Result<(Self, Option<BitDepth>), OpticsError> {
        let fault = |error: image::ImageError| OpticsError::file(path, error);
        let bytes = std::fs::read(path).map_err(|error| OpticsError::file(path, error))?;
        if bitmap::is_bmp(&bytes) {
            return bitmap::decode(&bytes).map(|photo| (photo, None)).map_err(|what| OpticsError::file(path, what));
        }
        let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
        let image = reader.map_err(|error| OpticsError::file(path, error))?.decode().map_err(fault)?;
        let (width, height) = (image.width() as usize, image.height() as usize);
        let deep = matches!(
            image,
            DynamicImage::ImageLuma16(_)
                | DynamicImage::ImageLumaA16(_)
                | DynamicImage::ImageRgb16(_)
                | DynamicImage::ImageRgba16(_)
        );
        if !deep {
            return Ok((Self { width, height, rgb: image.to_rgb8().into_raw() }, None));
        }
        let values = image.to_rgb16().into_raw();
        let depth = BitDepth::from_values(&values);
        let full = f64::from((1u32 << depth.bits) - 1);
        let rgb = values.iter().map(|&value| (255.0 * f64::from(value) / full).round() as u8).collect();
        Ok((Self { width, height, rgb }, Some(depth)))
    }

    /// Writes a PNG or JPEG file, by the extension.
    pub fn write(&self, path: &Path) -> Result<(), OpticsError> {
        let format = ImageFormat::from_path(path).map_err(|error| OpticsError::file(path, error))?;
        let mut bytes = Cursor::new(Vec::new());
        let (columns, rows) = (self.width as u32, self.height as u32);
        image::write_buffer_with_format(&mut bytes, &self.rgb, columns, rows, image::ColorType::Rgb8, format)
            .map_err(|error| OpticsError::file(path, error))?;
        write_atomically(path, bytes.get_ref()).map_err(|error| OpticsError::file(path, error))
    }

    /// Returns an error that names `file` if the image has another size (columns, rows).
    pub(crate) fn expect_size(&self, [columns, rows]: [usize; 2], file: &Path) -> Result<(), OpticsError> {
        if (self.width, self.height) == (columns, rows) {
            return Ok(());
        }
        let what =
            format!("found {} x {} pixels; expected the background's {columns} x {rows}", self.width, self.height);
        Err(OpticsError::file(file, what))
    }

    pub(crate) fn mean(&self) -> f64 {
        self.rgb.iter().map(|&grey| f64::from(grey)).sum::<f64>() / self.rgb.len().max(1) as f64
    }

    /// True if no pixel has a colour.
    pub fn is_grey(&self) -> bool {
        self.rgb.chunks_exact(3).all(|pixel| pixel[0] == pixel[1] && pixel[1] == pixel[2])
    }

    /// Returns red, green and blue of a pixel.
    ///
    /// # Panics
    /// If the pixel is outside the image.
    #[inline]
    pub fn pixel(&self, column: usize, row: usize) -> [u8; 3] {
        let at = 3 * (row * self.width + column);
        [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]]
    }
}
