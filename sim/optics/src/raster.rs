//! The pixel grid over the rectangle that a camera sees: that of its images, or a coarser one.

use hand_model::pads::{IMAGE_SIZE, PadCamera};

/// A grid of `side` x `side` pixels over a camera's rectangle. Row 0 is the distal edge, as in [`PadCamera::pixel_center`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Raster {
    side: usize,
    center_y: f64,
    h: f64,
    w: f64,
}

impl Raster {
    /// Returns the grid of the camera's own pixels.
    pub fn full(camera: &PadCamera) -> Self {
        Self::with_side(camera, IMAGE_SIZE)
    }

    /// Returns a grid of `side` x `side` pixels.
    pub fn with_side(camera: &PadCamera, side: usize) -> Self {
        Self { side, center_y: camera.center_y, h: camera.h, w: camera.w }
    }

    /// Returns the number of pixels along a side.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Returns the size of a pixel along x and y, m.
    pub fn pixel_size(&self) -> (f64, f64) {
        (self.w / self.side as f64, self.h / self.side as f64)
    }

    /// Computes the pad coordinates (m) of the centre of pixel (column, row).
    pub fn pixel_center(&self, column: usize, row: usize) -> (f64, f64) {
        let (dx, dy) = self.pixel_size();
        ((column as f64 + 0.5) * dx - 0.5 * self.w, self.center_y + 0.5 * self.h - (row as f64 + 0.5) * dy)
    }
}

#[cfg(test)]
mod tests {
    use hand_model::Hand;

    use super::*;

    #[test]
    fn the_full_raster_is_the_camera_s_and_a_coarse_pixel_lies_in_the_middle_of_fine_ones() {
        for camera in &Hand::ftac().cameras {
            let (full, coarse) = (Raster::full(camera), Raster::with_side(camera, IMAGE_SIZE / 3));
            assert_eq!(full.pixel_size(), camera.pixel_size());
            for (column, row) in [(0, 0), (17, 101), (79, 40)] {
                assert_eq!(full.pixel_center(column, row), camera.pixel_center(column, row));
                let (middle, place) =
                    (camera.pixel_center(3 * column + 1, 3 * row + 1), coarse.pixel_center(column, row));
                assert!((middle.0 - place.0).abs() < 1e-12 && (middle.1 - place.1).abs() < 1e-12);
            }
        }
    }
}
