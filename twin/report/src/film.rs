//! Films of trials, rendered without a screen: as a page that shows them side by side, and as strips of stills.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use hand_model::{Arm, Hand};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, RgbImage};
use maud::{Markup, html};
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use telemetry::mesh::Mesh;
use world::objects::ObjectModel;

use crate::html::{self, data_uri};
use crate::picture::{Picture, View, tile};

const TABLE_COLOR: [f64; 3] = [206.0, 196.0, 182.0];
/// Number of stills in the strip of a trial, and their size in pixels.
pub const STRIP_LAYOUT: (usize, u32) = (5, 220);
/// JPEG quality of a frame.
const JPEG_QUALITY: u8 = 72;

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
    /// Renders a still of `size` pixels, centred at `center` (m) and `width` m wide.
    pub fn still(&self, frame: &FilmFrame, size: u32, (center, width): (Point3<f64>, f64)) -> RgbImage {
        let eye = Vector3::new(0.30, -0.88, 0.36).normalize();
        let mut picture = Picture::new(size, View { eye, up: Vector3::z(), center, width });
        let mesh = |mesh: &Mesh| -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
            let vertices = mesh.vertices.iter().map(|v| Point3::from(*v).cast());
            (vertices.collect(), mesh.normals.iter().map(|n| Vector3::from(*n).cast()).collect())
        };
        let table = telemetry::scene::table();
        let (vertices, normals) = mesh(&table);
        picture.triangles(&Isometry3::identity(), &vertices, &table.triangles, &normals, TABLE_COLOR);
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

    /// Returns centre and width (m) of a view that shows the whole film: the objects at their initial poses, and the
    /// hand above them.
    fn enclosing_view(film: &Film) -> (Point3<f64>, f64) {
        let Some(first) = film.frames.first() else { return (Point3::origin(), 1.0) };
        let sum: Vector3<f64> = first.objects.iter().map(|pose| pose.translation.vector).sum();
        let mut center = Point3::from(sum / first.objects.len().max(1) as f64);
        center.z += 0.11;
        (center, 0.56)
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

    /// Renders all frames of a film as JPEG, on all cores.
    fn frames(&self, film: &Film, size: u32) -> Result<Vec<Vec<u8>>> {
        let around = Self::enclosing_view(film);
        film.frames.par_iter().map(|frame| jpeg(&self.still(frame, size, around))).collect()
    }
}

fn jpeg(image: &RgbImage) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
        .encode(image.as_raw(), image.width(), image.height(), ExtendedColorType::Rgb8)
        .context("a frame of the film")?;
    Ok(bytes)
}

/// Returns a page that shows `films` side by side with frames of `size` pixels at `rate` Hz. `about` is the text above
/// them.
pub fn page(
    stage: &FilmStage,
    films: &[Film],
    (size, rate): (u32, f64),
    (title, about): (&str, &Markup),
) -> Result<String> {
    let (mut columns, mut data) = (Vec::new(), "const films=[];\n".to_owned());
    for (n, film) in films.iter().enumerate() {
        let frames = stage.frames(film, size)?;
        let uris: Vec<String> = frames.iter().map(|bytes| data_uri("image/jpeg", bytes)).collect();
        let (first, (outcome, good)) = (uris.first().map_or("", String::as_str), &film.outcome);
        columns.push(html! {
            figure.film {
                h2 { (film.title) }
                img id={ "f" (n) } width=(size) height=(size) src=(first) alt={ "film of the trial, " (film.title) };
                figcaption {
                    b id={ "p" (n) } {}
                    br;
                    span class=(if *good { "good" } else { "bad" }) { (outcome) }
                    ol id={ "n" (n) } {
                        @for (at, note) in &film.notes { li data-t=(format!("{at:.2}")) { (format!("{at:.1} s: {note}")) } }
                    }
                }
            }
        });
        let words: Vec<String> =
            film.frames.iter().map(|frame| format!("{:.1} s: {}", frame.time, frame.phase)).collect();
        let times: Vec<f64> = film.frames.iter().map(|frame| frame.time).collect();
        data += &format!("films.push({});\n", serde_json::json!({ "frames": uris, "words": words, "times": times }));
    }
    let main = html! {
        h1 { (title) }
        (about)
        div.films { @for column in columns { (column) } }
        p.player { button id="play" { "Pause" } " " input id="at" type="range" min="0" value="0" aria-label="time"; }
    };
    Ok(html::page(title, STYLE, &main, &format!("{data}const rate={rate};\n{SCRIPT}")))
}

const STYLE: &str = include_str!("../data/film.css");
const SCRIPT: &str = include_str!("../data/film.js");

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
        };
        Film {
            title: "touch <1>".into(),
            outcome: ("both objects held".into(), true),
            frames: (0..3).map(frame).collect(),
            notes: vec![(0.25, "touched & decided".into())],
        }
    }

    /// The page holds every frame and every note; names are escaped.
    #[test]
    fn a_page_holds_all_frames() {
        let (hand, arm) = (Hand::ftac(), Arm::gen3());
        let stage = FilmStage { hand: &hand, arm: &arm, objects: vec![] };
        let html = page(&stage, &[film(&hand, &arm)], (64, 4.0), ("A trial", &html! { p { "about" } })).expect("drawn");
        assert_eq!(html.matches("data:image/jpeg;base64,").count(), 4, "the first frame, and three in the film");
        for part in ["touch &lt;1&gt;", "touched &amp; decided", "0.5 s: phase 2", "both objects held"] {
            assert!(html.contains(part), "{part}");
        }
        let strip = stage.strip(&film(&hand, &arm), 2, 64);
        assert_eq!((strip.width(), strip.height()), (128, 64));
    }
}
