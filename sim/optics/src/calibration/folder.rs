//! A folder of calibration images.
//!
//! ```text
//! FOLDER/background.png              the untouched gel under all lamps (or .jpg, .bmp)
//! FOLDER/*.png, *.jpg, *.bmp         presses of a ball, one per image
//! FOLDER/labels.csv                  optional: positions of the presses
//! FOLDER/lamps/*.png                 optional: the untouched gel under each lamp alone, at the background's exposure
//! FOLDER/checkerboards/*.png         optional: at least three pictures of a checkerboard, tilted differently, by the same camera
//! FOLDER/checkerboards/board.toml    its inner corners: `columns = 9` and `rows = 6`
//! ```
//! All images have the same size. Lamp images may be in any order; each shows one lamp or several that are switched together.
//!
//! Labels are a CSV file (`labels.csv`, else `labels_auto.csv`) with the columns `file`, `center_x_px`, `center_y_px`,
//! `contact_radius_px` (or `visible_radius_px`) and, if several balls were used, `ball_diameter_mm`. Without a label file
//! presses are detected in the images ([`circle`]). An image that cannot be used is left out, with the reason.

use std::path::Path;

use crate::calibration::circle;
use crate::calibration::diameter::check_diameter;
use crate::calibration::image_files::{IMAGE_FORMATS, list_images, take_background};
use crate::calibration::labels::{LabelFile, PressLabel};
use crate::calibration::lens::Lens;
use crate::calibration::photo::{BitDepth, Photo};
use crate::error::OpticsError;

/// One press of a ball.
#[derive(Debug, Clone, PartialEq)]
pub struct BallPress {
    /// Name of the image file.
    pub name: String,
    /// The image.
    pub photo: Photo,
    /// Middle of the visible circle: column and row, pixels (pixel centres are whole).
    pub center: [f64; 2],
    /// Radius of the visible circle, pixels.
    pub radius: f64,
    /// Diameter of the ball, m.
    pub diameter: f64,
    /// True if centre and radius come from a label file.
    pub labelled: bool,
    /// True if the radius is that of the contact. The visible circle is larger because of the gel's flank.
    pub contact_labelled: bool,
}

/// An image, or a label, that is not used.
#[derive(Debug, Clone, PartialEq)]
pub struct SkippedImage {
    /// Name of the image file, or of the file that the label names.
    pub name: String,
    /// The image, if it has the background's size.
    pub photo: Option<Photo>,
    /// Circle of the label, if there is one: centre (column, row) and radius, pixels.
    pub circle: Option<([f64; 2], f64)>,
    /// Reason in words: found and expected.
    pub reason: String,
    /// True if the label file names an image that is not in the folder.
    pub missing: bool,
}

/// A background and presses, all of one image size.
#[derive(Debug, Clone, PartialEq)]
pub struct PressFolder {
    /// The untouched gel.
    pub background: Photo,
    /// Presses, ordered by file name.
    pub presses: Vec<BallPress>,
    /// The untouched gel under each lamp alone, ordered by file name; empty if there are no such images.
    pub lamps: Vec<Photo>,
    /// Images and labels that cannot be used.
    pub skipped: Vec<SkippedImage>,
    /// Depth of the background's file, if it has 16 bits a channel.
    pub depth: Option<BitDepth>,
}

/// Options for reading a folder.
#[derive(Debug, Clone, Copy)]
pub struct PressReadOptions<'a> {
    /// Diameter of balls whose label gives none, m.
    pub diameter: f64,
    /// True if presses are detected in the images even if there are labels.
    pub ignore_labels: bool,
    /// Image of the untouched gel, if it is not called `background`.
    pub background: Option<&'a Path>,
}

impl PressFolder {
    /// Reads a folder whose untouched gel is called `background`; `diameter` (m) applies to balls whose label gives none.
    pub fn read(folder: &Path, diameter: f64, ignore_labels: bool) -> Result<Self, OpticsError> {
        Self::read_with(folder, &PressReadOptions { diameter, ignore_labels, background: None })
    }

    /// Reads a folder.
    pub fn read_with(folder: &Path, options: &PressReadOptions<'_>) -> Result<Self, OpticsError> {
        check_diameter(options.diameter)?;
        let mut files = list_images(folder)?;
        let Some(path) = take_background(&mut files, options.background)? else {
            let what = "no background image found; expected `background.png`, the untouched gel, or --background FILE";
            return Err(OpticsError::file(folder, what));
        };
        let (background, depth) = Photo::read_deep(&path)?;
        if files.is_empty() {
            let what = format!("no press images found; expected {IMAGE_FORMATS} images beside the background");
            return Err(OpticsError::file(folder, what));
        }
        let size = [background.width, background.height];
        let labels = if options.ignore_labels { None } else { LabelFile::read(folder, size)? };
        let lamps = read_lamps(&folder.join("lamps"), &background)?;
        let mut found =
            Self { background, presses: Vec::with_capacity(files.len()), lamps, skipped: Vec::new(), depth };
        let mut names = Vec::with_capacity(files.len());
        for path in &files {
            let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            let label = labels.as_ref().map(|labels| labels.find(&name));
            found.read_press(path, &name, label, options.diameter);
            names.push(name);
        }
        if let Some(labels) = &labels {
            let unknown = labels.without_image(&names).into_iter();
            found.skipped.extend(unknown.map(|(name, reason)| SkippedImage {
                name,
                photo: None,
                circle: None,
                reason,
                missing: true,
            }));
        }
        match (found.presses.is_empty(), found.skipped.first()) {
            (true, Some(first)) => Err(OpticsError::file(&folder.join(&first.name), &first.reason)),
            _ => Ok(found),
        }
    }

    /// Detects presses in photos of the background's size, given with their names.
    pub fn from_photos(background: Photo, photos: Vec<(String, Photo)>, diameter: f64) -> Result<Self, OpticsError> {
        check_diameter(diameter)?;
        let mut found = Self { background, presses: Vec::new(), lamps: Vec::new(), skipped: Vec::new(), depth: None };
        photos.into_iter().for_each(|(name, photo)| found.add_press(name, photo, None, diameter));
        match (found.presses.is_empty(), found.skipped.first()) {
            (true, Some(first)) => Err(OpticsError::file(Path::new(&first.name), &first.reason)),
            _ => Ok(found),
        }
    }

    /// Reads an image and adds it to the presses or to `skipped`.
    fn read_press(&mut self, path: &Path, name: &str, label: Option<Result<PressLabel, String>>, diameter: f64) {
        match self.read_like_background(path) {
            Ok(photo) => self.add_press(name.to_owned(), photo, label, diameter),
            Err(reason) => {
                self.skipped.push(SkippedImage {
                    name: name.to_owned(),
                    photo: None,
                    circle: None,
                    reason,
                    missing: false,
                });
            }
        }
    }

    /// Adds a photo with its label, or with the circle detected in it if there are no labels.
    fn add_press(&mut self, name: String, photo: Photo, label: Option<Result<PressLabel, String>>, diameter: f64) {
        let found = match label {
            Some(label) => label.map(|label| (label, true)),
            None => circle::find_circle(&photo, &self.background).map_err(|error| error.to_string()).map(|found| {
                (PressLabel { center: found.center, radius: found.radius, contact: false, diameter: None }, false)
            }),
        };
        match found {
            Ok((label, labelled)) => self.presses.push(BallPress {
                name,
                photo,
                center: label.center,
                radius: label.radius,
                diameter: label.diameter.unwrap_or(diameter),
                labelled,
                contact_labelled: label.contact,
            }),
            Err(reason) => {
                self.skipped.push(SkippedImage { name, photo: Some(photo), circle: None, reason, missing: false })
            }
        }
    }

    /// Reads an image of the background's size, kind and depth. The error is the reason why it does not match.
    fn read_like_background(&self, path: &Path) -> Result<Photo, String> {
        let plain = |error: OpticsError| match error {
            OpticsError::File { what, .. } => what,
            error => error.to_string(),
        };
        let (photo, depth) = Photo::read_deep(path).map_err(plain)?;
        photo.expect_size([self.background.width, self.background.height], path).map_err(plain)?;
        if photo.is_grey() != self.background.is_grey() {
            let (found, expected) = if photo.is_grey() { ("a grey image", "colours") } else { ("colours", "grey") };
            return Err(format!("found {found}; expected {expected}, as in the background"));
        }
        match (depth, self.depth) {
            (Some(depth), Some(expected)) if depth.bits != expected.bits => {
                Err(format!("found a {depth}; expected {}-bit data, as in the background", expected.bits))
            }
            _ => Ok(photo),
        }
    }

    /// Returns the same presses with images, centres and radii rectified by this lens.
    pub fn rectified(&self, lens: &Lens) -> Result<Self, OpticsError> {
        lens.check(self.background.width, self.background.height)?;
        let press = |press: &BallPress| {
            let center = lens.rectify_point(press.center);
            // The circle stays nearly circular: its new radius is the mean distance of four of its points.
            let [x, y] = press.center;
            let rim = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]
                .map(|[dx, dy]| lens.rectify_point([x + dx * press.radius, y + dy * press.radius]));
            let radius = 0.25 * rim.iter().map(|p| (p[0] - center[0]).hypot(p[1] - center[1])).sum::<f64>();
            BallPress { photo: lens.rectify(&press.photo), center, radius, ..press.clone() }
        };
        Ok(Self {
            background: lens.rectify(&self.background),
            presses: self.presses.iter().map(press).collect(),
            lamps: self.lamps.iter().map(|photo| lens.rectify(photo)).collect(),
            skipped: self.skipped.clone(),
            depth: self.depth,
        })
    }

    /// Leaves out the presses that have a reason; `reasons` are in the presses' order.
    pub fn skip_presses(&mut self, reasons: impl IntoIterator<Item = Option<String>>) {
        let presses = std::mem::take(&mut self.presses);
        for (press, reason) in presses.into_iter().zip(reasons) {
            match reason {
                None => self.presses.push(press),
                Some(reason) => {
                    let circle = Some((press.center, press.radius));
                    self.skipped.push(SkippedImage {
                        name: press.name,
                        photo: Some(press.photo),
                        circle,
                        reason,
                        missing: false,
                    });
                }
            }
        }
    }

    /// Splits the presses into those at even and at odd indices, each set with the background.
    pub fn even_odd(&self) -> (Self, Self) {
        self.split(|index, _| index % 2 == 0)
    }

    /// Splits the presses into those for which `first` is true, and the others.
    pub fn split(&self, first: impl Fn(usize, &BallPress) -> bool) -> (Self, Self) {
        let part = |wanted: bool| {
            let chosen = self.presses.iter().enumerate().filter(|(index, press)| first(*index, press) == wanted);
            let presses = chosen.map(|(_, press)| press.clone()).collect();
            Self {
                background: self.background.clone(),
                presses,
                lamps: self.lamps.clone(),
                skipped: Vec::new(),
                depth: self.depth,
            }
        };
        (part(true), part(false))
    }
}

/// Reads the images of single lamps; empty if there is no such folder.
fn read_lamps(folder: &Path, background: &Photo) -> Result<Vec<Photo>, OpticsError> {
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let files = list_images(folder)?;
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
