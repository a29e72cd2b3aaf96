//! A frame of a film: for each condition the scene, the phase, the tactile images and the last notes.

use std::sync::OnceLock;

use image::{Rgb, RgbImage, imageops};
use nalgebra::Point3;

use super::tactile_map::MapLayout;
use super::{Film, FilmFrame, FilmStage};
use crate::lettering::{TEXT_COLOR, sized_text, width, wrapped};
use crate::picture::Picture;

/// Width of the part of one condition, and height of a film, pixels.
pub const PART_SIZE: [u32; 2] = [640, 720];
/// Rows at which title, scene, phase and tactile images begin.
const ROWS: [i64; 4] = [8, 44, 476, 504];
const MARGIN: i64 = 12;
const TITLE_HEIGHT: f32 = 26.0;
const PHASE_HEIGHT: f32 = 20.0;
const NOTE_HEIGHT: f32 = 16.0;
const PAPER_COLOR: [u8; 3] = [250, 250, 248];
const FADED_COLOR: [u8; 3] = [128, 131, 138];
const GOOD_COLOR: [u8; 3] = [22, 122, 74];
const BAD_COLOR: [u8; 3] = [176, 62, 44];

/// Films that run in step, side by side.
pub struct Composition<'a> {
    stage: &'a FilmStage<'a>,
    films: &'a [Film],
    layout: MapLayout,
    /// Picture of the scene without what moves.
    backdrop: Picture,
    /// Last part of each film, which stays while the others go on.
    last: Vec<OnceLock<RgbImage>>,
}

impl<'a> Composition<'a> {
    pub fn new(stage: &'a FilmStage<'a>, films: &'a [Film]) -> Self {
        let view = films.first().map_or((Point3::origin(), 1.0), FilmStage::enclosing_view);
        let last = films.iter().map(|_| OnceLock::new()).collect();
        let [_, scene, phase, _] = ROWS;
        let backdrop = FilmStage::backdrop([PART_SIZE[0] - 2, (phase - scene - 8) as u32], view);
        Self { stage, films, layout: MapLayout::new(stage.hand), backdrop, last }
    }

    /// Number of frames: those of the longest film.
    pub fn frame_count(&self) -> usize {
        self.films.iter().map(|film| film.frames.len()).max().unwrap_or(0)
    }

    /// Draws a frame.
    pub fn frame(&self, index: usize) -> RgbImage {
        let mut image = RgbImage::from_pixel(PART_SIZE[0] * self.films.len() as u32, PART_SIZE[1], Rgb(PAPER_COLOR));
        for (n, film) in self.films.iter().enumerate() {
            let Some(last) = film.frames.len().checked_sub(1) else { continue };
            let draw = || self.part(film, &film.frames[index.min(last)], index >= last);
            let left = i64::from(PART_SIZE[0]) * n as i64;
            if index < last {
                imageops::replace(&mut image, &draw(), left, 0);
            } else {
                imageops::replace(&mut image, self.last[n].get_or_init(draw), left, 0);
            }
        }
        image
    }

    fn part(&self, film: &Film, frame: &FilmFrame, ended: bool) -> RgbImage {
        let [full, height] = PART_SIZE;
        let mut image = RgbImage::from_pixel(full, height, Rgb(PAPER_COLOR));
        let [title, scene, phase, below] = ROWS;
        sized_text(&mut image, (MARGIN, title), TITLE_HEIGHT, &film.title, TEXT_COLOR);
        if ended {
            let (outcome, good) = &film.outcome;
            let left = i64::from(full) - MARGIN - width(outcome, PHASE_HEIGHT) as i64;
            let color = if *good { GOOD_COLOR } else { BAD_COLOR };
            sized_text(&mut image, (left, title + 4), PHASE_HEIGHT, outcome, color);
        }
        let still = self.stage.scene(frame, self.backdrop.clone());
        imageops::replace(&mut image, &still, 1, scene);
        let words = format!("{:4.1} s  {}", frame.time, frame.phase);
        sized_text(&mut image, (MARGIN, phase), PHASE_HEIGHT, &words, TEXT_COLOR);
        self.layout.draw(&mut image, (MARGIN - 3, below), &frame.tactile);
        let left = MARGIN + i64::from(self.layout.size()[0]) + 10;
        let room = ((i64::from(height) - below) as f32 / NOTE_HEIGHT) as usize;
        let said: Vec<&(f64, String)> = film.notes.iter().filter(|(time, _)| *time <= frame.time + 1e-6).collect();
        let mut lines: Vec<(String, [u8; 3])> = Vec::new();
        for (n, (time, note)) in said.iter().enumerate() {
            let color = if n + 1 == said.len() { TEXT_COLOR } else { FADED_COLOR };
            let limit = (i64::from(full) - MARGIN - left) as f32;
            lines.extend(
                wrapped(&format!("{time:.1} s: {note}"), NOTE_HEIGHT, limit).into_iter().map(|line| (line, color)),
            );
        }
        for (row, (line, color)) in lines.iter().skip(lines.len().saturating_sub(room)).enumerate() {
            let top = below + (row as f32 * NOTE_HEIGHT) as i64;
            sized_text(&mut image, (left, top), NOTE_HEIGHT, line, *color);
        }
        image
    }
}
