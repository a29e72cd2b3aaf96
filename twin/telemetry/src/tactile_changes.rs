//! Change of tactile images against the untouched pad, as a picture and as colours of the pads on the hand.

use hand_model::Hand;
use hand_model::pads::{IMAGE_SIZE, Pad, PadCamera};
use hand_model::robot::TactileImage;

use crate::hand_mesh::pad_points;
use crate::scene::link_color;

/// Cells of a coarse change map along each side.
const MAP_CELLS: usize = 24;
/// Change of a cell that is drawn brightest, in levels of 255.
const BRIGHTEST_CHANGE: f32 = 42.0;
/// Touch threshold of a cell, in levels of 255. The gel of an untouched pad drifts by less.
const TOUCH_THRESHOLD: f32 = 12.0;
/// Number of touched cells that makes a pad active.
const ACTIVE_CELL_COUNT: usize = 4;
/// Quantization levels of the drawn change.
const CHANGE_LEVELS: f32 = 12.0;
/// Colours of a touch on the hand, from weak to strong.
const TOUCH_COLORS: [[f32; 3]; 2] = [[255.0, 140.0, 20.0], [255.0, 252.0, 190.0]];
/// Brightness factor of an untouched pad.
const IDLE_BRIGHTNESS: f32 = 0.62;

/// Mean change of each cell in the channel that changes most, rows from the distal edge.
type ChangeMap = [f32; MAP_CELLS * MAP_CELLS];

/// Untouched reference images, and the change of each camera since.
pub struct TactileChanges {
    untouched: Vec<Option<TactileImage>>,
    maps: Vec<ChangeMap>,
    active: Vec<bool>,
}

impl TactileChanges {
    /// Creates the changes of so many cameras, of which no image has come yet.
    pub fn new(cameras: usize) -> Self {
        Self {
            untouched: vec![None; cameras],
            maps: vec![[0.0; MAP_CELLS * MAP_CELLS]; cameras],
            active: vec![false; cameras],
        }
    }

    /// Adds an image; a camera's first image is its untouched reference. Returns true if the touch of its pad starts or
    /// ends.
    pub fn update(&mut self, camera: usize, image: &TactileImage) -> bool {
        let untouched = self.untouched[camera].get_or_insert_with(|| image.clone());
        self.maps[camera] = map(untouched, image);
        let active = self.maps[camera].iter().filter(|change| **change > TOUCH_THRESHOLD).count() >= ACTIVE_CELL_COUNT;
        std::mem::replace(&mut self.active[camera], active) != active
    }

    /// True if a camera's pad is touched.
    pub fn active(&self, camera: usize) -> bool {
        self.active[camera]
    }

    /// Returns the image minus the untouched reference, around mid-grey.
    pub fn difference(&self, camera: usize, image: &TactileImage) -> TactileImage {
        let untouched = self.untouched[camera].as_ref().unwrap_or(image);
        let value = |(a, b): (&u8, &u8)| (128 + i16::from(*a) - i16::from(*b)).clamp(0, 255) as u8;
        TactileImage { rgb: image.rgb.iter().zip(&untouched.rgb).map(value).collect() }
    }

    /// Returns the colours (RGBA) of the points of a pad's sheet.
    pub fn colors(&self, hand: &Hand, pad: &Pad) -> Vec<u32> {
        let base = link_color(hand, pad.link).map(|part| f32::from(part) * IDLE_BRIGHTNESS);
        let [columns, rows] = [pad.w, pad.h].map(|size| pad_points(size, pad.edge_radius));
        let points = rows.iter().flat_map(|y| columns.iter().map(move |x| (*x, *y)));
        points
            .map(|place| {
                let change = self.at(hand, pad, place);
                let hot: [f32; 3] =
                    std::array::from_fn(|k| TOUCH_COLORS[0][k] + (TOUCH_COLORS[1][k] - TOUCH_COLORS[0][k]) * change);
                let share = (1.6 * change).min(1.0);
                let [r, g, b] = std::array::from_fn(|k| (base[k] + (hot[k] - base[k]) * share) as u32);
                r << 24 | g << 16 | b << 8 | 255
            })
            .collect()
    }

    /// Returns the change at a point of a pad (m, pad frame), 0 to 1.
    fn at(&self, hand: &Hand, pad: &Pad, (x, y): (f64, f64)) -> f32 {
        let sees = |camera: &PadCamera| (y - camera.center_y).abs() <= 0.5 * camera.h + 1e-9;
        let Some(index) = pad.cameras.iter().copied().find(|index| sees(&hand.cameras[*index])) else { return 0.0 };
        let camera = &hand.cameras[index];
        let cell = |share: f64| ((share * MAP_CELLS as f64) as usize).min(MAP_CELLS - 1);
        let column = cell(x / camera.w + 0.5);
        let row = cell((camera.center_y - y) / camera.h + 0.5);
        // Drift of an untouched pad is not drawn.
        let change =
            ((self.maps[index][row * MAP_CELLS + column] - 0.5 * TOUCH_THRESHOLD) / BRIGHTEST_CHANGE).clamp(0.0, 1.0);
        // Few levels compress well.
        (change * CHANGE_LEVELS).round() / CHANGE_LEVELS
    }
}

fn map(untouched: &TactileImage, image: &TactileImage) -> ChangeMap {
    let mut map = [0.0; MAP_CELLS * MAP_CELLS];
    let side = IMAGE_SIZE / MAP_CELLS;
    if image.rgb.len() != IMAGE_SIZE * IMAGE_SIZE * 3 || image.rgb.len() != untouched.rgb.len() {
        return map;
    }
    for (cell, value) in map.iter_mut().enumerate() {
        let (row, column) = (cell / MAP_CELLS * side, cell % MAP_CELLS * side);
        let mut sums = [0i32; 3];
        for y in row..row + side {
            let start = (y * IMAGE_SIZE + column) * 3;
            let pair = image.rgb[start..start + 3 * side].iter().zip(&untouched.rgb[start..start + 3 * side]);
            pair.enumerate().for_each(|(n, (a, b))| sums[n % 3] += i32::from(*a) - i32::from(*b));
        }
        *value = sums.map(|sum| sum.abs()).into_iter().max().unwrap_or(0) as f32 / (side * side) as f32;
    }
    map
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey() -> TactileImage {
        TactileImage { rgb: vec![100; IMAGE_SIZE * IMAGE_SIZE * 3] }
    }

    /// A press near a pad's distal edge colours the sheet only there, and ends when the pad is untouched again.
    #[test]
    fn the_hand_lights_where_it_is_touched() {
        let hand = Hand::ftac();
        let pad = &hand.pads[hand.cameras[0].pad];
        let camera = pad.cameras[0];
        let mut changes = TactileChanges::new(hand.cameras.len());
        assert!(!changes.update(camera, &grey()) && !changes.active(camera));
        let idle = changes.colors(&hand, pad);
        let mut pressed = grey();
        pressed.rgb[..IMAGE_SIZE * 3 * 60].fill(190);
        assert!(changes.update(camera, &pressed) && changes.active(camera));
        let lit = changes.colors(&hand, pad);
        // The sheet's last row of points is the distal one. The palm's large pad has one camera for each half.
        let points = idle.len();
        let distal = hand.cameras[camera].center_y >= 0.0;
        assert_eq!(lit[points - 1] != idle[points - 1], distal);
        assert_eq!(lit[0], idle[0]);
        assert!(lit.iter().zip(&idle).any(|(a, b)| a != b));
        assert_eq!(changes.difference(camera, &pressed).rgb[0], 218);
        assert!(changes.update(camera, &grey()) && !changes.active(camera));
        assert_eq!(changes.colors(&hand, pad), idle);
    }
}
