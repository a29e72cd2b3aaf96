//! Films of trials, rendered without a screen: as an animation with the conditions side by side, as a page that shows
//! it, and as strips of stills. [`tactile_map`] shows the tactile images as a hand, `composition` draws a frame, and
//! `animation` encodes all of them.

mod animation;
mod composition;
pub mod tactile_map;

use std::sync::Arc;

use anyhow::Result;
use hand_model::{Arm, Hand};
use image::RgbImage;
use maud::{Markup, html};
use nalgebra::{Isometry3, Point3, Vector3};
use world::objects::ObjectModel;

use self::composition::Composition;
use self::tactile_map::CameraTile;
use crate::html::{self, data_uri};
use crate::picture::{Picture, View, tile};

const TABLE_COLOR: [f64; 3] = [206.0, 196.0, 182.0];
/// Number of stills in the strip of a trial, and their size in pixels.
pub const STRIP_LAYOUT: (usize, u32) = (5, 220);
/// Frames of an animation, 1/s.
pub const FRAME_RATE: f64 = 25.0;
/// Simulated seconds in a second of an animation.
pub const SPEED: f64 = 2.0;
/// Frames of an animation per simulated second.
pub const TRIAL_FRAME_RATE: f64 = FRAME_RATE / SPEED;
/// File name of an animation.
pub const FILE: &str = "film.webp";
/// Direction from the scene to the eye.
const EYE: [f64; 3] = [0.30, -0.88, 0.36];

/// Point in the middle of a picture of the scene (m, world frame), and the picture's width, m.
pub type SceneView = (Point3<f64>, f64);

/// Poses of everything at one time, in the world frame; those of the hand's links are in the palm frame.
#[derive(Debug, Clone)]
pub struct FilmFrame {
    /// Time, s.
    pub time: f64,
    pub phase: String,
    pub arm: Vec<Isometry3<f64>>,
    pub palm: Isometry3<f64>,
    pub links: Vec<Isometry3<f64>>,
    pub objects: Vec<Isometry3<f64>>,
    /// Newest change of each tactile camera; `None` before its first image. Empty in a film without them.
    pub tactile: Vec<Option<Arc<CameraTile>>>,
}

/// Film of one trial.
#[derive(Debug, Clone, Default)]
pub struct Film {
    /// Title above the film.
    pub title: String,
    /// Outcome in words, and true if it was good.
    pub outcome: (String, bool),
    pub frames: Vec<FilmFrame>,
    /// Log lines with their times, s.
    pub notes: Vec<(f64, String)>,
}

/// Parts of a film that do not change: hand, arm and object models.
pub struct FilmStage<'a> {
    pub hand: &'a Hand,
    pub arm: &'a Arm,
    pub objects: Vec<Arc<ObjectModel>>,
}

impl FilmStage<'_> {
    /// Renders a square still of `size` pixels.
    pub fn still(&self, frame: &FilmFrame, size: u32, view: SceneView) -> RgbImage {
        self.scene(frame, Self::backdrop([size, size], view))
    }

    /// Draws what stands still in a film, the table, in a picture of `[width, height]` pixels.
    fn backdrop(size: [u32; 2], (center, width): SceneView) -> Picture {
        let eye = Vector3::from(EYE).normalize();
        let mut picture = Picture::rectangle(size, View { eye, up: Vector3::z(), center, width });
        picture.mesh(&Isometry3::identity(), &telemetry::scene::table(), TABLE_COLOR);
        picture
    }

    /// Draws what moves into a backdrop and renders it.
    fn scene(&self, frame: &FilmFrame, mut picture: Picture) -> RgbImage {
        picture.arm(self.arm, &frame.arm);
        for (model, pose) in self.objects.iter().zip(&frame.objects) {
            let (vertices, triangles, normals) = model.shape.triangles();
            picture.triangles(pose, &vertices, &triangles, &normals, model.color.map(f64::from));
        }
        picture.hand_at(self.hand, (&frame.palm, &frame.links), |pad| {
            telemetry::scene::link_color(self.hand, pad.link).map(f64::from)
        });
        picture.finish("")
    }

    /// Returns a view that shows the whole film: the objects at their initial poses, and the hand above them.
    fn enclosing_view(film: &Film) -> SceneView {
        let Some(first) = film.frames.first() else { return (Point3::origin(), 1.0) };
        let sum: Vector3<f64> = first.objects.iter().map(|pose| pose.translation.vector).sum();
        let mut center = Point3::from(sum / first.objects.len().max(1) as f64);
        center.z += 0.13;
        (center, 0.66)
    }

    /// Renders `count` stills side by side, evenly spread over the time from the first approach to the end and closer
    /// to the hand.
    pub fn strip(&self, film: &Film, count: usize, size: u32) -> RgbImage {
        let last = film.frames.len().saturating_sub(1);
        let chosen = (0..count).map(|n| last * (n + 1) / (count + 1).max(2) + last / (2 * (count + 1).max(2)));
        let stills: Vec<RgbImage> = chosen
            .filter_map(|index| film.frames.get(index))
            .map(|frame| {
                let at = frame.palm.translation.vector - Vector3::z() * 0.05;
                self.still(frame, size, (Point3::from(at), 0.34))
            })
            .collect();
        tile(&stills, count)
    }

    /// Returns `films` side by side and in step as an animated WebP of [`FRAME_RATE`]. Without `quiet`, a bar shows
    /// the progress.
    pub fn animation(&self, films: &[Film], quiet: bool) -> Result<Vec<u8>> {
        let composition = Composition::new(self, films);
        let count = composition.frame_count();
        let bar = progress::bar(count as u64, "frames", quiet);
        let animation = animation::encode(count, FRAME_RATE, &|index| {
            let frame = composition.frame(index);
            bar.inc(1);
            frame
        });
        bar.finish_and_clear();
        animation
    }
}

/// Returns a page that shows an animation of `films` ([`FilmStage::animation`]), and their notes. `about` is the text
/// above them.
pub fn page(films: &[Film], animation: &[u8], (title, about): (&str, &Markup)) -> String {
    let [width, height] = composition::PART_SIZE;
    let main = html! {
        h1 { (title) }
        (about)
        img.film width=(width * films.len() as u32) height=(height) src=(data_uri("image/webp", animation))
            alt="film of the trials: scene, phase, tactile images and notes";
        div.films {
            @for film in films {
                section {
                    h2 { (film.title) }
                    p class=(if film.outcome.1 { "good" } else { "bad" }) { (film.outcome.0) }
                    ol { @for (at, note) in &film.notes { li { (format!("{at:.1} s: {note}")) } } }
                }
            }
        }
    };
    html::page(title, STYLE, &main, "")
}

const STYLE: &str = include_str!("../data/film.css");

#[cfg(test)]
mod tests {
    use super::*;

    fn film(hand: &Hand, arm: &Arm) -> Film {
        let arm_links = arm.tree.forward(&arm.home);
        let frame = |n: usize| FilmFrame {
            time: n as f64 * 0.25,
            phase: format!("phase {n}"),
            arm: arm_links.clone(),
            palm: Isometry3::translation(0.5, 0.0, 0.3),
            links: hand.tree.forward(&vec![0.1 * n as f64; hand.tree.len()]),
            objects: vec![],
            tactile: vec![],
        };
        Film {
            title: "touch <1>".into(),
            outcome: ("both objects held".into(), true),
            frames: (0..3).map(frame).collect(),
            notes: vec![(0.25, "touched & decided".into())],
        }
    }

    /// Films run in step, and the shorter one keeps its last frame; the page holds the animation and every note, and
    /// names are escaped.
    #[test]
    fn a_page_holds_the_animation_and_all_notes() {
        let (hand, arm) = (Hand::ftac(), Arm::gen3());
        let stage = FilmStage { hand: &hand, arm: &arm, objects: vec![] };
        let (first, mut second) = (film(&hand, &arm), film(&hand, &arm));
        second.frames.truncate(2);
        let films = [first, second];
        let bytes = stage.animation(&films, true).expect("encoded");
        let decoder = webp_animation::Decoder::new(&bytes).expect("a WebP");
        assert_eq!(decoder.dimensions(), (1280, 720));
        let frames: Vec<_> = decoder.into_iter().collect();
        assert_eq!(frames.len(), 3);
        // The phase of the first film changes between the last two frames, and nothing of the second film.
        let part = |frame: &webp_animation::Frame, columns: std::ops::Range<usize>| -> Vec<u8> {
            (480..500)
                .flat_map(|row| &frame.data()[4 * (row * 1280 + columns.start)..4 * (row * 1280 + columns.end)])
                .copied()
                .collect()
        };
        let change = |columns: std::ops::Range<usize>| -> u8 {
            let [before, after] = [1, 2].map(|n| part(&frames[n], columns.clone()));
            before.iter().zip(&after).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
        };
        assert!(change(0..600) > 60 && change(660..1280) < 30, "{} {}", change(0..600), change(660..1280));
        let html = page(&films, &bytes, ("A trial", &html! { p { "about" } }));
        assert_eq!(html.matches("data:image/webp;base64,").count(), 1);
        for part in ["touch &lt;1&gt;", "touched &amp; decided", "both objects held"] {
            assert_eq!(html.matches(part).count(), 2, "{part}");
        }
        let strip = stage.strip(&films[0], 2, 64);
        assert_eq!((strip.width(), strip.height()), (128, 64));
    }
}
