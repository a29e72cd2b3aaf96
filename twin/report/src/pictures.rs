//! What a report shows of objects and trials: pictures of the objects, and stills of a trial where one was recorded.

use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use anyhow::Result;
use image::{ImageFormat, RgbImage};
use nalgebra::{Isometry3, Point3, Vector3};
use scenarios::{Condition, TrialRecord};
use world::objects::{ObjectModel, ObjectSet};

use super::html::{data_uri, escape};
use crate::picture::{Picture, View};

/// Size of an object's picture, pixels, and what it is wide, m.
const OBJECT: (u32, f64) = (96, 0.16);
/// The file with the stills of a trial in a result folder; `name` is that of the trial's recording.
pub fn strip_file(folder: &Path, name: &str, condition: Condition) -> PathBuf {
    let ending = ending(condition);
    let named = ending.trim_end_matches(PNG);
    folder.join("recordings").join(format!("{}{ending}", name.trim_end_matches(named)))
}

const PNG: &str = ".png";

fn ending(condition: Condition) -> String {
    format!("_{condition}{PNG}")
}

/// An object on its own, as it rests.
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

/// The sections; an object that does not come with the program is named only.
pub fn section(folder: &Path, records: &[TrialRecord]) -> Result<String> {
    let mut html = String::new();
    if let Some((file, condition)) = strip(folder) {
        let name = file.file_name().unwrap_or_default().to_string_lossy().replace(&ending(condition), "");
        html += &format!(
            "<h2 id=\"strip\">One trial</h2>\n<figure class=\"strip\"><img alt=\"stills of a trial\" src=\"{}\"><figcaption>{}, {condition}: \
             stills in order of time.</figcaption></figure>\n",
            data_uri("image/png", &std::fs::read(&file)?),
            escape(&name.replace('_', " "))
        );
    }
    let names: BTreeSet<&str> = records.iter().flat_map(TrialRecord::objects).collect();
    if names.is_empty() {
        return Ok(html);
    }
    let known = ObjectSet::standard();
    html += "<h2 id=\"objects\">Objects</h2>\n<div class=\"objects\">\n";
    for name in names {
        let words = escape(name);
        match known.get(name) {
            Some(model) => {
                let (size, width) = OBJECT;
                let image = png(&object(model, size, width, ""))?;
                html += &format!(
                    "<figure><img width=\"{size}\" height=\"{size}\" alt=\"\" src=\"{image}\"><figcaption>{words}</figcaption></figure>\n"
                );
            }
            None => html += &format!("<figure><figcaption>{words}</figcaption></figure>\n"),
        }
    }
    Ok(html + "</div>\n")
}

/// The stills of the first recorded trial, and its condition: touch where there is one.
fn strip(folder: &Path) -> Option<(PathBuf, Condition)> {
    let entries = std::fs::read_dir(folder.join("recordings")).ok()?;
    let files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    let preferred = [Condition::Touch, Condition::Own, Condition::Reflex, Condition::Blind];
    preferred.into_iter().find_map(|condition| {
        let its =
            |file: &&PathBuf| file.file_name().is_some_and(|name| name.to_string_lossy().ends_with(&ending(condition)));
        Some((files.iter().filter(its).min()?.clone(), condition))
    })
}
