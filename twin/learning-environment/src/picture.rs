//! A rendered image of a scene, for people.

use nalgebra::{Isometry3, Point3, Vector3};
use report::picture::{Picture, View};
use sim::robot::GroundTruth;

use super::scene::TactileScene;

/// Smallest and largest side of an image, pixels.
pub const SIDE_LIMITS: [u32; 2] = [32, 2048];
/// Colour of the table, RGB.
const TABLE_COLOR: [f64; 3] = [214.0, 206.0, 192.0];
/// Colour of the pads, RGB.
const PAD_COLOR: [f64; 3] = [236.0, 236.0, 240.0];
/// Drawn part of the table: lowest and highest x and y, m.
const TABLE_EXTENT: [[f64; 2]; 2] = [[0.35, 0.90], [-0.35, 0.35]];

/// Error for an unsupported image size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("side of the picture: found {0} pixels, expected {least} to {most}", least = SIDE_LIMITS[0], most = SIDE_LIMITS[1])]
pub struct PictureSizeError(pub u32);

impl TactileScene {
    /// Renders arm, hand, objects and table from the front and above: `side` x `side` pixels, row-major RGB. It shows
    /// the ground truth, as a camera would.
    pub fn picture(&self, side: u32) -> Result<Vec<u8>, PictureSizeError> {
        if !(SIDE_LIMITS[0]..=SIDE_LIMITS[1]).contains(&side) {
            return Err(PictureSizeError(side));
        }
        let (truth, hand) = (self.truth(), &self.cell().robot.hand);
        let eye = Vector3::new(0.9, -0.55, 0.65).normalize();
        let view = View { eye, up: Vector3::z(), center: Point3::new(0.62, 0.0, 0.12), width: 0.75 };
        let mut picture = Picture::new(side, view);
        let [[x0, x1], [y0, y1]] = TABLE_EXTENT;
        let corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(|[x, y]| Point3::new(x, y, 0.0));
        let up = [Vector3::z(); 4];
        picture.triangles(&Isometry3::identity(), &corners, &[[0, 1, 2], [0, 2, 3]], &up, TABLE_COLOR);
        let GroundTruth { palm, arm_links, hand_links, objects, .. } = &truth;
        for (model, pose) in self.models().zip(objects) {
            let (vertices, triangles, normals) = model.shape.triangles();
            picture.triangles(pose, &vertices, &triangles, &normals, model.color.map(f64::from));
        }
        picture.arm(&self.cell().robot.arm, arm_links);
        let links: Vec<Isometry3<f64>> = hand_links.iter().map(|link| palm.inverse() * link).collect();
        picture.hand_at(hand, (palm, &links), |_| PAD_COLOR);
        Ok(picture.finish("").into_raw())
    }
}
