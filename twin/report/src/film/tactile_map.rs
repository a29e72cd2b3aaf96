//! Tactile images of all cameras as a map of the hand: a column for each digit with the fingertip on top, and the palm
//! below.

use std::sync::Arc;

use hand_model::Hand;
use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{TactileFrame, TactileImage};
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};
use nalgebra::Point3;
use telemetry::tactile_changes::TactileChanges;

/// Side of the image of one camera, pixels.
pub const TILE_SIDE: u32 = 50;
/// Distance of two images, pixels.
const GAP: u32 = 3;
/// Amplification of the change.
const AMPLIFICATION: f32 = 2.0;
const EMPTY_COLOR: [u8; 3] = [226, 227, 229];
const TOUCHED_COLOR: [u8; 3] = [232, 112, 20];

/// Change of one camera's image against the untouched pad.
#[derive(Debug, Clone)]
pub struct CameraTile {
    /// Change around mid-grey, amplified; `TILE_SIDE` pixels wide.
    pub image: RgbImage,
    /// True while the pad is touched.
    pub touched: bool,
}

/// Keeps the newest image of each camera as a tile.
pub struct TactileTiles {
    changes: TactileChanges,
    newest: Vec<Option<Arc<TactileImage>>>,
    tiles: Vec<Option<Arc<CameraTile>>>,
}

impl TactileTiles {
    /// Creates the tiles of so many cameras, all empty.
    pub fn new(cameras: usize) -> Self {
        Self { changes: TactileChanges::new(cameras), newest: vec![None; cameras], tiles: vec![None; cameras] }
    }

    /// Takes the newest images, and returns the tile of each camera.
    pub fn update(&mut self, frames: &[TactileFrame]) -> Vec<Option<Arc<CameraTile>>> {
        for frame in frames {
            let Some(newest) = self.newest.get_mut(frame.camera) else { continue };
            // An idle pad sends the same image again and again.
            if newest.as_ref().is_some_and(|image| Arc::ptr_eq(image, &frame.image)) {
                continue;
            }
            *newest = Some(frame.image.clone());
            self.changes.update(frame.camera, &frame.image);
            let difference = self.changes.difference(frame.camera, &frame.image);
            let tile = CameraTile { image: tile(difference), touched: self.changes.active(frame.camera) };
            self.tiles[frame.camera] = Some(Arc::new(tile));
        }
        self.tiles.clone()
    }
}

fn tile(difference: TactileImage) -> RgbImage {
    let side = IMAGE_SIZE as u32;
    let image = RgbImage::from_raw(side, side, difference.rgb).unwrap_or_else(|| RgbImage::new(side, side));
    let mut tile = imageops::resize(&image, TILE_SIDE, TILE_SIDE, FilterType::Triangle);
    for value in tile.iter_mut() {
        *value = (128.0 + AMPLIFICATION * (f32::from(*value) - 128.0)).clamp(0.0, 255.0) as u8;
    }
    tile
}

/// Column and row of each camera's tile.
#[derive(Debug, Clone)]
pub struct MapLayout {
    cells: Vec<[u32; 2]>,
}

impl MapLayout {
    /// Lays out the cameras of a hand by the names of its pads.
    pub fn new(hand: &Hand) -> Self {
        let poses = hand.pad_poses(&hand.tree.forward(&vec![0.0; hand.tree.len()]));
        // Centre of a camera's view on an open hand: x across the palm, y towards the fingers, m.
        let center = |camera: usize| {
            let camera = &hand.cameras[camera];
            poses[camera.pad] * Point3::new(0.0, camera.center_y, 0.0)
        };
        let mut digits: Vec<(&str, Vec<usize>)> = Vec::new();
        let mut palm = Vec::new();
        for (camera, of) in hand.cameras.iter().enumerate() {
            let pad = &hand.pads[of.pad];
            match pad.name.split_once('_') {
                Some((digit, _)) if pad.link.is_some() => match digits.iter_mut().find(|(name, _)| *name == digit) {
                    Some((_, cameras)) => cameras.push(camera),
                    None => digits.push((digit, vec![camera])),
                },
                _ => palm.push(camera),
            }
        }
        let rows = digits.iter().map(|(_, cameras)| cameras.len()).max().unwrap_or(0);
        let mut cells = vec![[0, 0]; hand.cameras.len()];
        for (column, (_, cameras)) in digits.iter().enumerate() {
            for (n, camera) in cameras.iter().rev().enumerate() {
                cells[*camera] = [column as u32, n as u32];
            }
        }
        // A camera of the palm lies below the nearest digit that begins above it and has none below it yet.
        let mut free: Vec<usize> = (0..digits.len()).collect();
        for (n, camera) in palm.into_iter().enumerate() {
            let distance = |column: usize| {
                let apart = center(digits[column].1[0]) - center(camera);
                if apart.y > 0.0 { apart.x.abs() } else { f64::INFINITY }
            };
            let nearest = free.iter().copied().min_by(|a, b| distance(*a).total_cmp(&distance(*b)));
            free.retain(|column| Some(*column) != nearest);
            cells[camera] = [nearest.unwrap_or(n) as u32, rows as u32];
        }
        Self { cells }
    }

    /// Width and height of the map, pixels.
    pub fn size(&self) -> [u32; 2] {
        [0, 1].map(|axis| self.cells.iter().map(|cell| cell[axis] + 1).max().unwrap_or(0) * (TILE_SIDE + GAP) + GAP)
    }

    /// Draws the map with its upper left corner at (x, y). The tile of a touched pad has a frame.
    pub fn draw(&self, image: &mut RgbImage, (x, y): (i64, i64), tiles: &[Option<Arc<CameraTile>>]) {
        for (camera, [column, row]) in self.cells.iter().enumerate() {
            let at = |cell: u32, start: i64| start + i64::from(GAP + cell * (TILE_SIDE + GAP));
            let (left, top) = (at(*column, x), at(*row, y));
            let tile = tiles.get(camera).and_then(Option::as_deref);
            if tile.is_some_and(|tile| tile.touched) {
                let side = TILE_SIDE + 2 * GAP;
                let frame = RgbImage::from_pixel(side, side, Rgb(TOUCHED_COLOR));
                imageops::replace(image, &frame, left - i64::from(GAP), top - i64::from(GAP));
            }
            let empty = || RgbImage::from_pixel(TILE_SIDE, TILE_SIDE, Rgb(EMPTY_COLOR));
            imageops::replace(image, &tile.map_or_else(empty, |tile| tile.image.clone()), left, top);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every camera has a place of its own: digits side by side from the thumb, tips on top, the palm below.
    #[test]
    fn the_map_looks_like_the_hand() {
        let hand = Hand::ftac();
        let layout = MapLayout::new(&hand);
        let cell = |name: &str| {
            let pad = hand.find_pad(name).expect("a pad");
            layout.cells[hand.pads[pad].cameras[0]]
        };
        assert_eq!((cell("thumb_distal"), cell("index_distal"), cell("little_distal")), ([0, 0], [1, 0], [4, 0]));
        assert_eq!((cell("index_middle"), cell("index_proximal")), ([1, 1], [1, 2]));
        assert!(
            cell("palm_radial")[1] == 3
                && cell("palm_ulnar")[1] == 3
                && 0 < cell("palm_radial")[0]
                && cell("palm_radial")[0] < cell("palm_ulnar")[0]
        );
        let mut sorted = layout.cells.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), hand.cameras.len());
    }

    /// A pressed pad has an amplified change and a frame; one of which nothing came is empty.
    #[test]
    fn touch_is_visible() {
        let hand = Hand::ftac();
        let layout = MapLayout::new(&hand);
        let mut tiles = TactileTiles::new(hand.cameras.len());
        let frame = |value: u8, sequence: u64| {
            let image = Arc::new(TactileImage { rgb: vec![value; IMAGE_SIZE * IMAGE_SIZE * 3] });
            TactileFrame { camera: 3, time: 0.0, sequence, image }
        };
        let idle = tiles.update(&[frame(100, 0)]);
        assert!(idle[3].as_ref().is_some_and(|tile| !tile.touched && tile.image.get_pixel(9, 9).0 == [128; 3]));
        let pressed = tiles.update(&[frame(130, 1)]);
        assert!(pressed[3].as_ref().is_some_and(|tile| tile.touched && tile.image.get_pixel(9, 9).0 == [188; 3]));
        let [width, height] = layout.size();
        let mut map = RgbImage::new(width, height);
        layout.draw(&mut map, (0, 0), &pressed);
        let corner = layout.cells[3].map(|cell| cell * (TILE_SIDE + GAP));
        assert_eq!(map.get_pixel(corner[0], corner[1]).0, TOUCHED_COLOR);
        assert_eq!(map.get_pixel(corner[0] + GAP, corner[1] + GAP).0, [188; 3]);
        assert!(map.pixels().any(|pixel| pixel.0 == EMPTY_COLOR));
    }
}
