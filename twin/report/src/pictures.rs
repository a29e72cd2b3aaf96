//! Pictures in a report: of the objects, and stills of a trial if one was recorded.

use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use anyhow::Result;
use image::{ImageFormat, RgbImage};
use maud::{Markup, html};
use nalgebra::{Isometry3, Point3, Vector3};
use scenarios::{Condition, TrialRecord};
use world::objects::{ObjectModel, ObjectSet};

use super::html::data_uri;
use crate::film;
use crate::picture::{Picture, View};

/// Size of an object's picture, pixels, and width of its view, m.
const OBJECT_PICTURE_SIZE: (u32, f64) = (96, 0.16);
/// Returns the file with the stills of a trial in a result folder. `name` is the name of the trial's recording.
pub fn strip_file(folder: &Path, name: &str, condition: Condition) -> PathBuf {
    let ending = file_suffix(condition);
    let named = ending.trim_end_matches(PNG_EXTENSION);
    folder.join("recordings").join(format!("{}{ending}", name.trim_end_matches(named)))
}

const PNG_EXTENSION: &str = ".png";

fn file_suffix(condition: Condition) -> String {
    format!("_{condition}{PNG_EXTENSION}")
}

/// Draws a single object in its resting pose.
pub fn object(model: &ObjectModel, size: u32, width: f64, caption: &str) -> RgbImage {
    let eye = Vector3::new(0.75, -0.9, 0.75).normalize();
    let mut picture = Picture::new(size, View { eye, up: Vector3::z(), center: Point3::origin(), width });
    let (vertices, triangles, normals) = model.shape.triangles();
    let color = model.color.map(f64::from);
    picture.triangles(&Isometry3::from_parts(Default::default(), model.rest), &vertices, &triangles, &normals, color);
    picture.finish(caption)
}

fn png(image: &RgbImage) -> Result<String> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(data_uri("image/png", bytes.get_ref()))
}

/// Returns the file of the film of a run's first trial in a result folder.
pub fn film_file(folder: &Path) -> PathBuf {
    folder.join("recordings").join(film::FILE)
}

/// Returns the figure of one trial: its film, or stills of it if there is none.
fn trial_figure(folder: &Path) -> Result<Option<Markup>> {
    let film = film_file(folder);
    if film.exists() {
        let animation = data_uri("image/webp", &std::fs::read(&film)?);
        return Ok(Some(html! {
            figure.strip {
                img alt="film of a trial" src=(animation);
                figcaption {
                    "The first trial, " (film::SPEED) " times as fast: scene, changes of the tactile images laid out as the hand (a pad that feels something has an \
                    orange frame), phase and the controller's notes."
                }
            }
        }));
    }
    let Some((file, condition)) = strip(folder) else { return Ok(None) };
    let name = file.file_name().unwrap_or_default().to_string_lossy().replace(&file_suffix(condition), "");
    let image = data_uri("image/png", &std::fs::read(&file)?);
    Ok(Some(html! {
        figure.strip {
            img alt="stills of a trial" src=(image);
            figcaption { (name.replace('_', " ")) ", " (condition) ": stills in order of time." }
        }
    }))
}

/// Returns the sections. An object that is not built in is only named.
pub fn section(folder: &Path, records: &[TrialRecord]) -> Result<Markup> {
    let trial = trial_figure(folder)?;
    let (known, (size, width)) = (ObjectSet::standard(), OBJECT_PICTURE_SIZE);
    let names: BTreeSet<&str> = records.iter().flat_map(TrialRecord::objects).collect();
    let picture = |name: &str| known.get(name).map(|model| png(&object(model, size, width, ""))).transpose();
    let objects = names.into_iter().map(|name| Ok((name, picture(name)?))).collect::<Result<Vec<_>>>()?;
    Ok(html! {
        @if let Some(figure) = trial { h2 id="strip" { "One trial" } (figure) }
        @if !objects.is_empty() {
            h2 id="objects" { "Objects" }
            div.objects {
                @for (name, image) in &objects {
                    figure {
                        @if let Some(image) = image { img width=(size) height=(size) alt="" src=(image); }
                        figcaption { (name) }
                    }
                }
            }
        }
    })
}

/// Returns the stills of the first recorded trial, and its condition: touch if there is one.
fn strip(folder: &Path) -> Option<(PathBuf, Condition)> {
    let entries = std::fs::read_dir(folder.join("recordings")).ok()?;
    let files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    let preferred = [Condition::Touch, Condition::External, Condition::Reflex, Condition::Blind];
    preferred.into_iter().find_map(|condition| {
        let its = |file: &&PathBuf| {
            file.file_name().is_some_and(|name| name.to_string_lossy().ends_with(&file_suffix(condition)))
        };
        Some((files.iter().filter(its).min()?.clone(), condition))
    })
}
