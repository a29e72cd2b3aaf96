//! Tactile pads: poses, sizes, and the rectangle of each that a camera sees.
//!
//! The F-TAC Hand has 17 pads and 18 cameras; another hand has as many as its parameter file lists. Images of all
//! cameras are rectified to squares of [`IMAGE_SIZE`] pixels, whatever the size of the rectangle.

use nalgebra::{Isometry3, Point3};

/// A tactile pad. Frame: origin in the centre of the surface, x across, y along the digit, z out of the surface.
#[derive(Debug, Clone)]
pub struct Pad {
    /// Name, `<digit>_<phalanx>` or `palm_<side>`.
    pub name: String,
    /// Link that carries it; `None` for the palm.
    pub link: Option<usize>,
    /// Letter of the sensor configuration, `a` to `f`.
    pub configuration: char,
    /// `link_from_pad`.
    pub link_from_pad: Isometry3<f64>,
    /// Size along y, m.
    pub h: f64,
    /// Size along x, m.
    pub w: f64,
    /// Rounding radius of the cover's edges under the pad, m.
    pub edge_radius: f64,
    /// Indices of the pad's cameras.
    pub cameras: Vec<usize>,
}

/// The rectangle of a pad that one camera sees. Its images are rectified to 240 x 240 pixels.
///
/// ```
/// use hand_model::Hand;
///
/// let hand = Hand::ftac();
/// let camera = &hand.cameras[0];
/// let pad = &hand.pads[camera.pad];
/// // A pixel, as a point on the undeformed surface in the pad's frame, m.
/// let (x, y) = camera.pixel_center(120, 60);
/// let z = pad.surface_height(x, y);
/// assert!(x.abs() <= 0.5 * pad.w && y.abs() <= 0.5 * pad.h && z <= 0.0);
/// ```
#[derive(Debug, Clone)]
pub struct PadCamera {
    /// Name, `<pad>` or `<pad>_<n>`.
    pub name: String,
    /// Index of the pad.
    pub pad: usize,
    /// Centre of the view along the pad's y, m (0 for the only camera of a pad).
    pub center_y: f64,
    /// Extent along y, m.
    pub h: f64,
    /// Extent along x, m.
    pub w: f64,
}

/// Number of pixels along each side of a tactile image.
pub const IMAGE_SIZE: usize = 240;

impl PadCamera {
    /// Returns the size of a pixel along x and y, m.
    pub fn pixel_size(&self) -> (f64, f64) {
        (self.w / IMAGE_SIZE as f64, self.h / IMAGE_SIZE as f64)
    }

    /// Computes the pad coordinates (m) of the centre of pixel (column, row). Row 0 is the distal edge (largest y).
    pub fn pixel_center(&self, column: usize, row: usize) -> (f64, f64) {
        let (dx, dy) = self.pixel_size();
        ((column as f64 + 0.5) * dx - 0.5 * self.w, self.center_y + 0.5 * self.h - (row as f64 + 0.5) * dy)
    }
}

impl Pad {
    /// Computes the height (m, never positive) of the undeformed surface over the pad's plane at (x, y): 0 in the flat
    /// middle, falling off over the rounded edges of the cover.
    pub fn surface_height(&self, x: f64, y: f64) -> f64 {
        let r = self.edge_radius;
        let ex = (x.abs() - (0.5 * self.w - r)).max(0.0);
        let ey = (y.abs() - (0.5 * self.h - r)).max(0.0);
        let e2 = (ex * ex + ey * ey).min(r * r);
        (r * r - e2).sqrt() - r
    }

    /// Samples the surface on a grid of `nx` by `ny` points (pad frame, m), inset from the border by half a cell.
    pub fn surface_samples(&self, nx: usize, ny: usize) -> Vec<Point3<f64>> {
        let mut points = Vec::with_capacity(nx * ny);
        for j in 0..ny {
            for i in 0..nx {
                let x = ((i as f64 + 0.5) / nx as f64 - 0.5) * self.w;
                let y = ((j as f64 + 0.5) / ny as f64 - 0.5) * self.h;
                points.push(Point3::new(x, y, self.surface_height(x, y)));
            }
        }
        points
    }
}
