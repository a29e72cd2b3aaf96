//! Pictures of the hand: an orthographic software renderer with a depth buffer, lit from the eye and from above, with
//! ambient occlusion in corners.

mod coverage;
mod occlusion;

use std::io::Cursor;
use std::path::Path;

use anyhow::{Context, Result};
use ftac_platform::data::write_atomically;
use hand_model::pads::Pad;
use hand_model::{Arm, Hand};
use image::{ImageFormat, Rgb, RgbImage};
use nalgebra::{Isometry3, Point3, Vector3};
use sim::test_stand::{HandTestStand, Prop};
use telemetry::hand_mesh::{self, Material, RigidPart};
use telemetry::mesh::Mesh;

use crate::lettering::{self, LINE_HEIGHT, TEXT_COLOR};

/// Colours of the arm's parts, used in turn.
const ARM_COLORS: [[f64; 3]; 2] = [[214.0, 217.0, 222.0], [172.0, 177.0, 185.0]];
/// Oversampling factor: each pixel is the mean of this many by this many.
const OVERSAMPLE: u32 = 2;
const BACKGROUND_COLOR: [f64; 3] = [250.0, 250.0, 248.0];
const COVER_COLOR: [f64; 3] = [196.0, 199.0, 206.0];
const PALM_COLOR: [f64; 3] = [170.0, 174.0, 184.0];
const PAD_COLOR: [f64; 3] = [92.0, 120.0, 150.0];
const CABLE_COLOR: [f64; 3] = [150.0, 60.0, 52.0];
/// Radius of a drawn cable, m: twice the real one, for visibility.
const CABLE_RADIUS: f64 = 5.0e-4;
/// Width of a picture that encloses something, in widths of that.
const VIEW_MARGIN: f64 = 1.14;
/// Colours of the pads' configurations, from a on, used in turn.
pub const CONFIGURATION_COLORS: [[f64; 3]; 9] = [
    [76.0, 146.0, 206.0],
    [92.0, 176.0, 124.0],
    [236.0, 168.0, 74.0],
    [206.0, 96.0, 92.0],
    [150.0, 116.0, 190.0],
    [96.0, 178.0, 186.0],
    [214.0, 130.0, 176.0],
    [150.0, 150.0, 66.0],
    [120.0, 92.0, 70.0],
];
/// Colours of props, used in turn.
pub const PROP_COLORS: [[f64; 3]; 3] = [[226.0, 150.0, 70.0], [120.0, 176.0, 96.0], [190.0, 110.0, 150.0]];

/// Returns the colour of a pad's configuration.
pub fn configuration_color(pad: &Pad) -> [f64; 3] {
    let letter = (pad.configuration as usize).wrapping_sub('a' as usize);
    CONFIGURATION_COLORS[letter % CONFIGURATION_COLORS.len()]
}

fn material_color(material: Material) -> [f64; 3] {
    match material {
        Material::Palm => PALM_COLOR,
        Material::Cover => COVER_COLOR,
        Material::Knuckle => [112.0, 116.0, 126.0],
        Material::Board => [52.0, 116.0, 84.0],
        Material::ServoPack => [88.0, 91.0, 100.0],
    }
}

/// Viewpoint and scale of a picture.
#[derive(Debug, Clone, Copy)]
pub struct View {
    /// Unit vector from the scene to the eye, palm frame.
    pub eye: Vector3<f64>,
    /// Direction that points up in the picture.
    pub up: Vector3<f64>,
    /// Point in the middle of the picture, palm frame, m.
    pub center: Point3<f64>,
    /// Width of the picture, m.
    pub width: f64,
}

impl View {
    /// Views the palm, a little from the side, fingers up.
    pub fn palm() -> Self {
        Self {
            eye: Vector3::new(0.25, 0.1, -1.0).normalize(),
            up: Vector3::y(),
            center: Point3::new(0.01, -0.02, 0.0),
            width: 0.22,
        }
    }

    /// Views the hand from the thumb's side, fingers to the left and the palm facing down.
    pub fn thumb_side() -> Self {
        Self {
            eye: Vector3::new(1.0, 0.25, -0.15).normalize(),
            up: Vector3::z(),
            center: Point3::new(0.0, -0.01, -0.01),
            width: 0.22,
        }
    }

    /// Views the back of the hand, fingers up.
    pub fn back() -> Self {
        Self { eye: Vector3::new(0.3, 0.15, 1.0).normalize(), ..Self::palm() }
    }

    /// Views the hand from in front of the fingertips, palm down.
    pub fn tips() -> Self {
        Self { eye: Vector3::new(0.35, 1.0, -0.35).normalize(), up: Vector3::z(), ..Self::palm() }
    }

    /// Returns the same direction of view for a square picture that shows all `points` in its middle, with a margin.
    pub fn enclosing(self, points: &[Point3<f64>]) -> Self {
        let right = self.up.cross(&self.eye).normalize();
        let axes = [right, self.eye.cross(&right)];
        let ranges = axes.map(|axis| {
            let places = points.iter().map(|point| point.coords.dot(&axis));
            places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)))
        });
        if points.is_empty() {
            return self;
        }
        let [x, y] = ranges.map(|(low, high)| 0.5 * (low + high));
        let width = VIEW_MARGIN * ranges.iter().map(|(low, high)| high - low).fold(0.0, f64::max);
        Self { center: Point3::from(axes[0] * x + axes[1] * y), width, ..self }
    }

    /// Returns the same direction of view around another centre, with another width (m).
    pub fn recentered(self, center: Point3<f64>, width: f64) -> Self {
        Self { center, width, ..self }
    }
}

/// Returns points on the surface of the hand at joint angles `q` (rad), palm frame.
pub fn hand_points(hand: &Hand, q: &[f64]) -> Vec<Point3<f64>> {
    let links = hand.tree.forward(q);
    let parts = hand_mesh::parts(hand, hand_mesh::FINE_STEPS).into_iter();
    let parts = parts.map(|part| (part.link.map_or_else(Isometry3::identity, |link| links[link]), part.mesh));
    let pads = hand.pads.iter().zip(hand.pad_poses(&links)).map(|(pad, pose)| (pose, hand_mesh::pad_sheet(pad)));
    parts
        .chain(pads)
        .flat_map(|(pose, mesh)| {
            mesh.vertices.iter().map(|vertex| pose * Point3::from(*vertex).cast()).collect::<Vec<_>>()
        })
        .collect()
}

/// A picture that is being drawn.
#[derive(Clone)]
pub struct Picture {
    /// Width and height of the oversampled picture.
    size: [u32; 2],
    right: Vector3<f64>,
    up: Vector3<f64>,
    view: View,
    color: Vec<[f64; 3]>,
    depth: Vec<f64>,
}

impl Picture {
    /// Creates an empty square picture of `size` pixels.
    pub fn new(size: u32, view: View) -> Self {
        Self::rectangle([size, size], view)
    }

    /// Creates an empty picture of `[width, height]` pixels.
    pub fn rectangle(size: [u32; 2], view: View) -> Self {
        let right = view.up.cross(&view.eye).normalize();
        let size = size.map(|side| side * OVERSAMPLE);
        let count = (size[0] * size[1]) as usize;
        Self {
            size,
            right,
            up: view.eye.cross(&right),
            view,
            color: vec![BACKGROUND_COLOR; count],
            depth: vec![f64::NEG_INFINITY; count],
        }
    }

    /// Projects a point to (column, row, nearness to the eye).
    fn project(&self, point: &Point3<f64>) -> [f64; 3] {
        let d = point - self.view.center;
        let scale = f64::from(self.size[0]) / self.view.width;
        let [x, y] = self.size.map(|side| 0.5 * f64::from(side));
        [x + scale * d.dot(&self.right), y - scale * d.dot(&self.up), d.dot(&self.view.eye)]
    }

    /// Draws triangles. `pose` maps the frame of the vertices to the palm frame.
    pub fn triangles(
        &mut self,
        pose: &Isometry3<f64>,
        vertices: &[Point3<f64>],
        triangles: &[[u32; 3]],
        normals: &[Vector3<f64>],
        color: [f64; 3],
    ) {
        let placed: Vec<[f64; 3]> = vertices.iter().map(|vertex| self.project(&(pose * vertex))).collect();
        let light = (self.view.eye + 0.6 * self.up - 0.3 * self.right).normalize();
        let shade: Vec<f64> = normals
            .iter()
            .map(|normal| {
                let normal = pose * normal;
                0.42 + 0.42 * normal.dot(&light).max(0.0) + 0.24 * normal.dot(&self.view.eye).max(0.0)
            })
            .collect();
        for corner in triangles {
            let [a, b, c] = corner.map(|index| index as usize);
            self.triangle([placed[a], placed[b], placed[c]], [shade[a], shade[b], shade[c]], color);
        }
    }

    fn triangle(&mut self, corners: [[f64; 3]; 3], shade: [f64; 3], color: [f64; 3]) {
        coverage::pixels(self.size, corners, |index, [w, u, v]| {
            let near = w * corners[0][2] + u * corners[1][2] + v * corners[2][2];
            if near > self.depth[index] {
                self.depth[index] = near;
                let light = w * shade[0] + u * shade[1] + v * shade[2];
                self.color[index] = color.map(|part| (part * light).min(255.0));
            }
        });
    }

    /// Draws a mesh at its pose.
    pub fn mesh(&mut self, pose: &Isometry3<f64>, mesh: &Mesh, color: [f64; 3]) {
        let vertices: Vec<Point3<f64>> = mesh.vertices.iter().map(|v| Point3::from(*v).cast()).collect();
        let normals: Vec<Vector3<f64>> = mesh.normals.iter().map(|n| Vector3::from(*n).cast()).collect();
        self.triangles(pose, &vertices, &mesh.triangles, &normals, color);
    }

    /// Draws the hand with all its parts at joint angles `q` (rad).
    pub fn hand(&mut self, hand: &Hand, q: &[f64]) {
        self.hand_with(hand, q, |_| PAD_COLOR);
    }

    /// As [`Picture::hand`], with a colour for each pad.
    pub fn hand_with(&mut self, hand: &Hand, q: &[f64], pad_color: impl Fn(&Pad) -> [f64; 3]) {
        let links = hand.tree.forward(q);
        self.rounded_hand(hand, (&Isometry3::identity(), &links), hand_mesh::FINE_STEPS, pad_color);
    }

    /// As [`Picture::hand_with`], for a hand in a scene: with the palm at `scene_from_palm`, the links at `palm_from_link`,
    /// and roundings for a hand that is small in the picture.
    pub fn hand_at(
        &mut self,
        hand: &Hand,
        poses: (&Isometry3<f64>, &[Isometry3<f64>]),
        pad_color: impl Fn(&Pad) -> [f64; 3],
    ) {
        self.rounded_hand(hand, poses, hand_mesh::SCENE_STEPS, pad_color);
    }

    fn rounded_hand(
        &mut self,
        hand: &Hand,
        (palm, links): (&Isometry3<f64>, &[Isometry3<f64>]),
        steps: u32,
        pad_color: impl Fn(&Pad) -> [f64; 3],
    ) {
        for RigidPart { link, material, mesh } in hand_mesh::parts(hand, steps) {
            let pose = link.map_or(*palm, |link| palm * links[link]);
            self.mesh(&pose, &mesh, material_color(material));
        }
        for (pad, pose) in hand.pads.iter().zip(hand.pad_poses(links)) {
            self.mesh(&(palm * pose), &hand_mesh::pad_sheet(pad), pad_color(pad));
        }
        for run in hand_mesh::cables(hand, links) {
            for pair in run.windows(2) {
                let ends = [pair[0], pair[1]];
                let cable = Mesh::smooth_capsule(ends, CABLE_RADIUS, (3 * steps - 1, steps / 2 + 2));
                self.mesh(palm, &cable, CABLE_COLOR);
            }
        }
    }

    /// Draws an arm with its base in the scene's origin and its moving links at `scene_from_link`.
    pub fn arm(&mut self, arm: &Arm, links: &[Isometry3<f64>]) {
        let base = Isometry3::identity();
        let poses = std::iter::once(&base).chain(links);
        for (k, (part, pose)) in telemetry::scene::arm_parts(arm).iter().zip(poses).enumerate() {
            self.mesh(pose, part, ARM_COLORS[k % 2]);
        }
    }

    /// Draws a prop at its pose.
    pub fn prop(&mut self, prop: &Prop, palm_from_prop: &Isometry3<f64>, color: [f64; 3]) {
        for (local, shape) in &prop.parts {
            let (vertices, triangles, normals) = shape.triangles();
            self.triangles(&(palm_from_prop * local), &vertices, &triangles, &normals, color);
        }
    }

    /// Draws the hand and all props of a stand at their current poses.
    pub fn stand(&mut self, stand: &HandTestStand) {
        self.hand(stand.hand(), &stand.angles());
        for index in 0..stand.prop_count() {
            self.prop(stand.prop(index), &stand.prop_pose(index), PROP_COLORS[index % PROP_COLORS.len()]);
        }
    }

    /// Overlays triangles on everything drawn so far, with opacity `covers` (0 to 1).
    pub fn overlay(&mut self, vertices: &[Point3<f64>], triangles: &[[u32; 3]], color: [f64; 3], covers: f64) {
        let placed: Vec<[f64; 3]> = vertices.iter().map(|vertex| self.project(vertex)).collect();
        let mut over = vec![false; self.color.len()];
        for corners in triangles {
            let [a, b, c] = corners.map(|index| placed[index as usize]);
            coverage::pixels(self.size, [a, b, c], |index, _| over[index] = true);
        }
        for (pixel, _) in self.color.iter_mut().zip(over).filter(|(_, over)| *over) {
            for (part, own) in pixel.iter_mut().zip(color) {
                *part += (own - *part) * covers;
            }
        }
    }

    /// Draws a dot on top of everything, `radius` in m.
    pub fn dot(&mut self, point: &Point3<f64>, radius: f64, color: [f64; 3]) {
        let [x, y, _] = self.project(point);
        let reach = radius * f64::from(self.size[0]) / self.view.width;
        for row in (y - reach) as i64..=(y + reach) as i64 {
            for column in (x - reach) as i64..=(x + reach) as i64 {
                let inside = (column as f64 - x).hypot(row as f64 - y) <= reach;
                let fits = |value: i64, axis: usize| (0..i64::from(self.size[axis])).contains(&value);
                if inside && fits(row, 1) && fits(column, 0) {
                    self.color[(row as u32 * self.size[0] + column as u32) as usize] = color;
                }
            }
        }
    }

    /// Returns the finished picture with a caption.
    pub fn finish(&self, caption: &str) -> RgbImage {
        let [width, height] = self.size;
        let mut image = RgbImage::new(width / OVERSAMPLE, height / OVERSAMPLE);
        let samples = |x: u32, y: u32| {
            let inside = (0..OVERSAMPLE).flat_map(|dx| (0..OVERSAMPLE).map(move |dy| (dx, dy)));
            inside.map(move |(dx, dy)| ((y * OVERSAMPLE + dy) * width + x * OVERSAMPLE + dx) as usize)
        };
        // Corners are darkened by the nearest sample of each pixel, outlines by every sample.
        let nearest =
            |(x, y): (u32, u32)| samples(x, y).map(|index| self.depth[index]).fold(f64::NEG_INFINITY, f64::max);
        let places = (0..image.height()).flat_map(|y| (0..image.width()).map(move |x| (x, y)));
        let depth: Vec<f64> = places.map(nearest).collect();
        let shade = occlusion::shading(&depth, image.width() as usize, self.view.width / f64::from(image.width()));
        let outline = |index: usize| occlusion::outline(&self.depth, width as usize, index);
        let columns = image.width() as usize;
        for (x, y, pixel) in image.enumerate_pixels_mut() {
            let mut sum = [0.0; 3];
            for index in samples(x, y) {
                let background = self.depth[index] == f64::NEG_INFINITY;
                let light = if background { 1.0 } else { shade[y as usize * columns + x as usize] * outline(index) };
                for (total, part) in sum.iter_mut().zip(self.color[index]) {
                    *total += light * part / f64::from(OVERSAMPLE * OVERSAMPLE);
                }
            }
            *pixel = Rgb(sum.map(|part| part as u8));
        }
        for (row, line) in caption.lines().enumerate() {
            lettering::text(&mut image, (6, 6 + LINE_HEIGHT * row as i64), line, TEXT_COLOR);
        }
        image
    }
}

/// Draws a square of `side` pixels with its upper left corner at (x, y).
pub fn swatch(image: &mut RgbImage, (x, y): (i64, i64), side: u32, color: [u8; 3]) {
    image::imageops::replace(image, &RgbImage::from_pixel(side, side, Rgb(color)), x, y);
}

/// Arranges pictures side by side, `columns` per row.
pub fn tile(pictures: &[RgbImage], columns: usize) -> RgbImage {
    let (w, h) = pictures.iter().fold((0, 0), |(w, h), picture| (picture.width().max(w), picture.height().max(h)));
    let columns = columns.min(pictures.len()).max(1);
    let rows = pictures.len().div_ceil(columns);
    let mut sheet =
        RgbImage::from_pixel(w * columns as u32, h * rows as u32, Rgb(BACKGROUND_COLOR.map(|part| part as u8)));
    for (n, picture) in pictures.iter().enumerate() {
        let (x, y) = ((n % columns) as i64 * i64::from(w), (n / columns) as i64 * i64::from(h));
        image::imageops::replace(&mut sheet, picture, x, y);
    }
    sheet
}

/// Writes an image file; its format follows from the extension.
pub fn save(image: &RgbImage, path: &Path) -> Result<()> {
    let mut bytes = Cursor::new(Vec::new());
    let format = ImageFormat::from_path(path).with_context(|| path.display().to_string())?;
    image.write_to(&mut bytes, format).with_context(|| path.display().to_string())?;
    Ok(write_atomically(path, bytes.get_ref())?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The nearer of two balls on the line of sight is visible.
    #[test]
    fn the_nearer_hides_the_farther() {
        let view = View { eye: Vector3::z(), up: Vector3::y(), center: Point3::origin(), width: 0.1 };
        let ball = Prop::new("ball", world::ObjectShape::Sphere { radius: 0.02 }, 1.0, 0.5);
        for (near, far) in [(0.05, -0.05), (-0.05, 0.05)] {
            let mut picture = Picture::new(64, view);
            picture.prop(&ball, &Isometry3::translation(0.0, 0.0, near), [255.0, 0.0, 0.0]);
            picture.prop(&ball, &Isometry3::translation(0.0, 0.0, far), [0.0, 0.0, 255.0]);
            let Rgb([red, _, blue]) = *picture.finish("").get_pixel(32, 32);
            assert_eq!(red > blue, near > far);
        }
    }

    /// The hand is in the middle of its picture, whole, and nearly fills it, from every side and in every posture.
    #[test]
    fn the_hand_is_centered() {
        let hand = Hand::ftac();
        for view in [View::palm(), View::back(), View::thumb_side(), View::tips()] {
            for angle in [0.0, 0.7] {
                let q = vec![angle; hand.tree.len()];
                let mut picture = Picture::new(200, view.enclosing(&hand_points(&hand, &q)));
                picture.hand(&hand, &q);
                let background = BACKGROUND_COLOR.map(|part| part as u8);
                let image = picture.finish("");
                let drawn = || image.enumerate_pixels().filter(|(.., pixel)| pixel.0 != background);
                let margins = [
                    drawn().map(|(x, ..)| x).min().expect("a hand"),
                    199 - drawn().map(|(x, ..)| x).max().expect("a hand"),
                    drawn().map(|(_, y, _)| y).min().expect("a hand"),
                    199 - drawn().map(|(_, y, _)| y).max().expect("a hand"),
                ];
                let [left, right, above, below] = margins;
                assert!(left.abs_diff(right) <= 3 && above.abs_diff(below) <= 3, "{margins:?}");
                assert!((8..=16).contains(margins.iter().min().expect("four")), "{margins:?}");
            }
        }
    }

    /// A ball of 40 mm covers the expected share of the picture.
    #[test]
    fn scale_is_true() {
        let view = View { eye: Vector3::x(), up: Vector3::z(), center: Point3::origin(), width: 0.1 };
        let mut picture = Picture::new(100, view);
        picture.prop(
            &Prop::new("ball", world::ObjectShape::Sphere { radius: 0.02 }, 1.0, 0.5),
            &Isometry3::identity(),
            [0.0, 0.0, 0.0],
        );
        let image = picture.finish("");
        let dark = image.pixels().filter(|pixel| pixel.0[0] < 100).count() as f64;
        assert!((dark / 1e4 - std::f64::consts::PI * 0.04).abs() < 0.004, "{dark}");
        // Nothing casts a shadow on the background.
        let beside = [[50, 27], [73, 50], [50, 73], [2, 2]].map(|[x, y]| image.get_pixel(x, y).0);
        assert_eq!(beside, [BACKGROUND_COLOR.map(|part| part as u8); 4]);
    }
}
