//! Images from real sensors: any size, 8 bits a channel.

use std::path::Path;

use crate::error::OpticsError;

/// An RGB image, row-major.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Photo {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green, blue of each pixel.
    pub rgb: Vec<u8>,
}

impl Photo {
    /// Reads a PNG or JPEG.
    pub fn read(path: &Path) -> Result<Self, OpticsError> {
        let fault = |what: String| OpticsError::File { path: path.display().to_string(), what };
        let image = image::open(path).map_err(|error| fault(error.to_string()))?.to_rgb8();
        let (width, height) = (image.width() as usize, image.height() as usize);
        Ok(Self { width, height, rgb: image.into_raw() })
    }

    /// Writes a PNG or JPEG.
    pub fn write(&self, path: &Path) -> Result<(), OpticsError> {
        image::save_buffer(path, &self.rgb, self.width as u32, self.height as u32, image::ColorType::Rgb8)
            .map_err(|error| OpticsError::File { path: path.display().to_string(), what: error.to_string() })
    }

    /// Grey levels of a pixel.
    #[inline]
    pub fn pixel(&self, column: usize, row: usize) -> [u8; 3] {
        let at = 3 * (row * self.width + column);
        [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]]
    }
}
