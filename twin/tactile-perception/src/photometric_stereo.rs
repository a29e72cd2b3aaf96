//! Photometric stereo: the slope of the gel at every pixel of a tactile image that differs from its background.

use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;

use crate::PIXELS;
use crate::calibration::PhotometricModel;
use crate::colour_change::{Region, StereoOptions, colour_change, find_change};

/// Slopes of the indentation, pad frame; 0 outside the changed region.
#[derive(Debug, Clone, PartialEq)]
pub struct Gradients {
    /// dh/dx, [`PIXELS`] values.
    pub gx: Vec<f32>,
    /// dh/dy, [`PIXELS`] values.
    pub gy: Vec<f32>,
    /// The region in which the image changed.
    pub region: Region,
}

/// Slopes of the gel under a tactile image; `None` if the pad is untouched. Both images are `IMAGE_SIZE` squared RGB.
pub fn gradients(
    image: &TactileImage,
    background: &TactileImage,
    model: &PhotometricModel,
    options: &StereoOptions,
) -> Option<Gradients> {
    let change = find_change(image, background, options)?;
    let (region, change) = (change.region, colour_change(image, background, change));
    let (mut gx, mut gy) = (vec![0.0; PIXELS], vec![0.0; PIXELS]);
    for row in region.row_begin..region.row_end {
        let row_model = model.row(row);
        let line = row * N + region.column_begin..row * N + region.column_end;
        row_model.gradients(region.column_begin, &change[line.clone()], &mut gx[line.clone()], &mut gy[line]);
    }
    Some(Gradients { gx, gy, region })
}
