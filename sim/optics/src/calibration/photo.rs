//! Images from real sensors: any size, 8 bits a channel.

use std::io::Cursor;
use std::path::Path;

use hand_model::file::write_whole;
use image::ImageFormat;

use crate::error::OpticsError;

/// An RGB image, row-major.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Photo {
    pub width: usize,
    pub height: usize,
    /// Red, green and blue of each pixel.
    pub rgb: Vec<u8>,
}

impl Photo {
    /// Reads a PNG or JPEG file.
    pub fn read(path: &Path) -> Result<Self, OpticsError> {
        let image = image::open(path).map_err(|error| OpticsError::file(path, error))?.to_rgb8();
        let (width, height) = (image.width() as usize, image.height() as usize);
        Ok(Self { width, height, rgb: image.into_raw() })
    }

    /// Writes a PNG or JPEG file, by the extension.
    pub fn write(&self, path: &Path) -> Result<(), OpticsError> {
        let format = ImageFormat::from_path(path).map_err(|error| OpticsError::file(path, error))?;
        let mut bytes = Cursor::new(Vec::new());
        let (columns, rows) = (self.width as u32, self.height as u32);
        image::write_buffer_with_format(&mut bytes, &self.rgb, columns, rows, image::ColorType::Rgb8, format)
            .map_err(|error| OpticsError::file(path, error))?;
        write_whole(path, bytes.get_ref()).map_err(|error| OpticsError::file(path, error))
    }

    /// An error that names `file` if the image has another size (columns, rows).
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

    /// Whether no pixel has a colour.
    pub fn is_grey(&self) -> bool {
        self.rgb.chunks_exact(3).all(|pixel| pixel[0] == pixel[1] && pixel[1] == pixel[2])
    }

    #[inline]
    pub fn pixel(&self, column: usize, row: usize) -> [u8; 3] {
        let at = 3 * (row * self.width + column);
        [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]]
    }
}
