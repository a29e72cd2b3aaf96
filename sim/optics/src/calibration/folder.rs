//! A folder of calibration images.
//!
//! ```text
//! FOLDER/background.png              the untouched gel under all lamps (or .jpg)
//! FOLDER/*.png, *.jpg                presses of a ball, one per image
//! FOLDER/labels.csv                  optional: positions of the presses
//! FOLDER/lamps/*.png                 optional: the untouched gel under each lamp alone, at the background's exposure
//! FOLDER/checkerboards/*.png         optional: at least three pictures of a checkerboard, tilted differently, by the same camera
//! FOLDER/checkerboards/board.toml    its inner corners: `columns = 9` and `rows = 6`
//! ```
//! All images have the same size. Lamp images may be in any order; each shows one lamp or several that are switched together.
//!
//! Labels are a CSV file (`labels.csv`, else `labels_auto.csv`) with the columns `file`, `center_x_px`, `center_y_px`,
//! `contact_radius_px` (or `visible_radius_px`) and, if several balls were used, `ball_diameter_mm`. Presses without a
//! label are detected in the image ([`circle`](super::circle)).

use std::path::{Path, PathBuf};

use crate::calibration::circle;
use crate::calibration::lens::Lens;
use crate::calibration::photo::Photo;
use crate::error::{OpticsError, positive};

/// One press of a ball.
#[derive(Debug, Clone, PartialEq)]
pub struct BallPress {
    pub name: String,
    pub photo: Photo,
    /// Middle of the visible circle: column and row, pixels (pixel centres are whole).
    pub center: [f64; 2],
    /// Radius of the visible circle, pixels.
    pub radius: f64,
    /// Diameter of the ball, m.
    pub diameter: f64,
    /// Whether centre and radius come from a label file.
    pub labelled: bool,
    /// Whether the radius is that of the contact, not of the circle that one sees, which the gel's flank makes larger.
    pub contact_labelled: bool,
}

/// An image in which no ball's press was found.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    pub name: String,
    pub photo: Photo,
    pub reason: String,
}

/// A background and presses, all of one image size.
#[derive(Debug, Clone, PartialEq)]
pub struct PressFolder {
    /// The untouched gel.
    pub background: Photo,
    /// Ordered by file name.
    pub presses: Vec<BallPress>,
    /// The untouched gel under each lamp alone, ordered by file name; empty if there are no such images.
    pub lamps: Vec<Photo>,
    /// Images without a label in which no press was found.
    pub left_out: Vec<LeftOut>,
}

impl PressFolder {
    /// Reads a folder. `diameter` (m) applies to balls whose label gives none. Presses are detected in the images if
    /// there are no labels or if `ignore_labels` is set.
    pub fn read(folder: &Path, diameter: f64, ignore_labels: bool) -> Result<Self, OpticsError> {
        check_diameter(diameter)?;
        let (background, files): (Vec<_>, Vec<_>) =
            images_of(folder)?.into_iter().partition(|path| path.file_stem().is_some_and(|stem| stem == "background"));
        let background = match background.first() {
            Some(path) => Photo::read(path)?,
            None => {
                let what = "no background image found; expected `background.png`, the untouched gel";
                return Err(OpticsError::file(folder, what));
            }
        };
        if files.is_empty() {
            return Err(OpticsError::file(
                folder,
                "no press images found; expected PNG or JPEG images beside the background",
            ));
        }
        let size = [background.width, background.height];
        let labels = if ignore_labels { Vec::new() } else { read_labels(folder, size)? };
        let grey = background.is_grey();
        let (mut presses, mut left_out) = (Vec::with_capacity(files.len()), Vec::new());
        for path in files {
            let photo = Photo::read(&path)?;
            photo.expect_size(size, &path)?;
            if photo.is_grey() != grey {
                let (found, expected) = if grey { ("colours", "grey") } else { ("a grey image", "colours") };
                return Err(OpticsError::file(
                    &path,
                    format!("found {found}; expected {expected}, as in the background"),
                ));
            }
            let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            let label = labels.iter().find(|label| label.file == name);
            if label.is_none() && !labels.is_empty() {
                return Err(OpticsError::file(&path, "found no row for this image in the label file; expected one"));
            }
            let (center, radius) = match label {
                Some(label) => (label.center, label.radius),
                None => match circle::find(&photo, &background) {
                    Ok(found) => (found.center, found.radius),
                    Err(error) => {
                        left_out.push(LeftOut { name, photo, reason: error.to_string() });
                        continue;
                    }
                },
            };
            let diameter = label.and_then(|label| label.diameter).unwrap_or(diameter);
            presses.push(BallPress {
                name,
                photo,
                center,
                radius,
                diameter,
                labelled: label.is_some(),
                contact_labelled: label.is_some_and(|label| label.contact),
            });
        }
        if let (true, Some(first)) = (presses.is_empty(), left_out.first()) {
            return Err(OpticsError::file(&folder.join(&first.name), &first.reason));
        }
        let lamps = read_lamps(&folder.join("lamps"), &background)?;
        Ok(Self { background, presses, lamps, left_out })
    }

    /// The same presses with images, centres and radii rectified by this lens.
    pub fn rectified(&self, lens: &Lens) -> Result<Self, OpticsError> {
        lens.check(self.background.width, self.background.height)?;
        let press = |press: &BallPress| {
            let center = lens.rectified(press.center);
            // The circle stays nearly circular: its new radius is the mean distance of four of its points.
            let [x, y] = press.center;
            let rim = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]
                .map(|[dx, dy]| lens.rectified([x + dx * press.radius, y + dy * press.radius]));
            let radius = 0.25 * rim.iter().map(|p| (p[0] - center[0]).hypot(p[1] - center[1])).sum::<f64>();
            BallPress { photo: lens.rectify(&press.photo), center, radius, ..press.clone() }
        };
        Ok(Self {
            background: lens.rectify(&self.background),
            presses: self.presses.iter().map(press).collect(),
            lamps: self.lamps.iter().map(|photo| lens.rectify(photo)).collect(),
            left_out: self.left_out.clone(),
        })
    }

    /// The presses at even and at odd indices, each set with the background.
    pub fn even_odd(&self) -> (Self, Self) {
        self.split(|index, _| index % 2 == 0)
    }

    /// The presses for which `first` is true, and the others.
    pub fn split(&self, first: impl Fn(usize, &BallPress) -> bool) -> (Self, Self) {
        let part = |wanted: bool| {
            let chosen = self.presses.iter().enumerate().filter(|(index, press)| first(*index, press) == wanted);
            let presses = chosen.map(|(_, press)| press.clone()).collect();
            Self { background: self.background.clone(), presses, lamps: self.lamps.clone(), left_out: Vec::new() }
        };
        (part(true), part(false))
    }
}

/// The images in a folder, by name.
pub(crate) fn images_of(folder: &Path) -> Result<Vec<PathBuf>, OpticsError> {
    let entries = std::fs::read_dir(folder).map_err(|error| OpticsError::file(folder, error))?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(|path| is_image(path)).collect();
    files.sort();
    Ok(files)
}

/// The images of single lamps; none where there is no such folder.
fn read_lamps(folder: &Path, background: &Photo) -> Result<Vec<Photo>, OpticsError> {
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let files = images_of(folder)?;
    if files.len() < 2 {
        let what = format!("found {} images of single lamps; expected one for each lamp, at least 2", files.len());
        return Err(OpticsError::file(folder, what));
    }
    let mut lamps = Vec::with_capacity(files.len());
    for path in files {
        let photo = Photo::read(&path)?;
        photo.expect_size([background.width, background.height], &path)?;
        let (found, all) = (photo.mean(), background.mean());
        if found >= all {
            let what = format!(
                "found a mean grey level of {found:.1}; expected less than the background's {all:.1}, which has all lamps"
            );
            return Err(OpticsError::file(&path, what));
        }
        lamps.push(photo);
    }
    Ok(lamps)
}

/// Balls from a pinhead to a table-tennis ball and a half: what lies beyond was given in another unit, m.
const BALLS: std::ops::RangeInclusive<f64> = 0.5e-3..=60e-3;

/// An error for a diameter (m) that no ball pressed into a fingertip sensor has.
fn check_diameter(diameter: f64) -> Result<(), OpticsError> {
    positive("ball diameter", diameter)?;
    if BALLS.contains(&diameter) { Ok(()) } else { Err(OpticsError::BallDiameter(1e3 * diameter)) }
}

fn is_image(path: &Path) -> bool {
    let extension = path.extension().map(|extension| extension.to_ascii_lowercase());
    extension.is_some_and(|extension| ["png", "jpg", "jpeg"].iter().any(|known| extension == *known))
}

#[derive(Debug)]
struct Label {
    file: String,
    center: [f64; 2],
    radius: f64,
    /// Whether the radius is the contact's.
    contact: bool,
    diameter: Option<f64>,
}

fn read_labels(folder: &Path, [width, height]: [usize; 2]) -> Result<Vec<Label>, OpticsError> {
    let Some(path) =
        ["labels.csv", "labels_auto.csv"].map(|name| folder.join(name)).into_iter().find(|path| path.exists())
    else {
        return Ok(Vec::new());
    };
    let fault = |what: String| OpticsError::file(&path, what);
    let text = std::fs::read_to_string(&path).map_err(|error| fault(error.to_string()))?;
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let header: Vec<&str> = lines.next().map(|(_, line)| line.split(',').map(str::trim).collect()).unwrap_or_default();
    let column = |names: &[&str]| header.iter().position(|title| names.contains(title));
    let needed = |names: &[&str]| {
        column(names).ok_or_else(|| {
            fault(format!("found the columns {header:?}; expected one called `{}`", names.join("` or `")))
        })
    };
    let file = needed(&["file"])?;
    let center = [needed(&["center_x_px"])?, needed(&["center_y_px"])?];
    let radius = needed(&["contact_radius_px", "visible_radius_px"])?;
    let diameter = column(&["ball_diameter_mm"]);
    let mut labels = Vec::new();
    for (index, line) in lines {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let number = |column: usize| {
            let cell = cells.get(column).copied().unwrap_or("");
            cell.parse::<f64>().ok().filter(|value| value.is_finite() && *value >= 0.0).ok_or_else(|| {
                fault(format!(
                    "line {}, {}: found `{cell}`; expected a number of at least 0",
                    index + 1,
                    header[column]
                ))
            })
        };
        let within = |column: usize, size: usize| {
            let found = number(column)?;
            if found <= size as f64 - 1.0 {
                return Ok(found);
            }
            Err(fault(format!(
                "line {}, {}: found {found}, outside the image; expected 0 to {}",
                index + 1,
                header[column],
                size - 1
            )))
        };
        let found = number(radius)?;
        let largest = 0.5 * (width as f64).hypot(height as f64);
        if !(1.0..=largest).contains(&found) {
            return Err(fault(format!(
                "line {}, {}: found {found}; expected 1 to {largest:.0} pixels, half the image's diagonal",
                index + 1,
                header[radius]
            )));
        }
        if let Some(column) = diameter {
            check_diameter(1e-3 * number(column)?)
                .map_err(|error| fault(format!("line {}, {}: {error}", index + 1, header[column])))?;
        }
        labels.push(Label {
            file: cells.get(file).copied().unwrap_or("").to_owned(),
            center: [within(center[0], width)?, within(center[1], height)?],
            radius: found,
            contact: header[radius] == "contact_radius_px",
            diameter: diameter.map(|column| number(column).map(|mm| mm * 1e-3)).transpose()?,
        });
    }
    Ok(labels)
}
