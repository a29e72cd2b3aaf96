//! Labels of presses: `labels.csv`.
//!
//! An invalid row is reported with its line, and only its press is left out.

use std::path::{Path, PathBuf};

use crate::calibration::diameter::check_diameter;
use crate::error::OpticsError;

/// File names, in order of precedence.
const LABEL_FILE_NAMES: [&str; 2] = ["labels.csv", "labels_auto.csv"];

/// The circle of a label.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PressLabel {
    /// Centre: column and row, pixels.
    pub(crate) center: [f64; 2],
    /// Radius, pixels.
    pub(crate) radius: f64,
    /// True if the radius is that of the contact.
    pub(crate) contact: bool,
    /// Diameter of the ball, m.
    pub(crate) diameter: Option<f64>,
}

#[derive(Debug)]
struct LabelRow {
    file: String,
    line: usize,
    /// The label, or the reason why it cannot be used.
    found: Result<PressLabel, String>,
}

/// The rows of a label file.
#[derive(Debug)]
pub(crate) struct LabelFile {
    path: PathBuf,
    rows: Vec<LabelRow>,
}

impl LabelFile {
    /// Reads the label file of a folder of images of this size (columns, rows); `None` if there is none. Returns an
    /// error if a required column is missing.
    pub(crate) fn read(folder: &Path, size: [usize; 2]) -> Result<Option<Self>, OpticsError> {
        let Some(path) = LABEL_FILE_NAMES.map(|name| folder.join(name)).into_iter().find(|path| path.exists()) else {
            return Ok(None);
        };
        let fault = |what: String| OpticsError::file(&path, what);
        let text = std::fs::read_to_string(&path).map_err(|error| fault(error.to_string()))?;
        let text = text.trim_start_matches('\u{feff}');
        let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let header: Vec<&str> = lines.next().map(|(_, line)| cells(line)).unwrap_or_default();
        let column = |names: &[&str]| header.iter().position(|title| names.contains(title));
        let needed = |names: &[&str]| {
            column(names).ok_or_else(|| {
                fault(format!("found the columns {header:?}; expected one called `{}`", names.join("` or `")))
            })
        };
        let columns = Columns {
            file: needed(&["file"])?,
            center: [needed(&["center_x_px"])?, needed(&["center_y_px"])?],
            radius: needed(&["contact_radius_px", "visible_radius_px"])?,
            diameter: column(&["ball_diameter_mm"]),
        };
        let row = |(index, line): (usize, &str)| {
            let cells = cells(line);
            let file = cells.get(columns.file).copied().unwrap_or("").to_owned();
            LabelRow { file, line: index + 1, found: columns.label(&header, &cells, size) }
        };
        let rows = lines.map(row).collect();
        Ok(Some(Self { path, rows }))
    }

    /// Returns the label of an image. The error is the reason why there is none.
    pub(crate) fn find(&self, image: &str) -> Result<PressLabel, String> {
        let rows: Vec<&LabelRow> = self.rows.iter().filter(|row| row.file == image).collect();
        match rows.as_slice() {
            [] => Err("found no row for this image in the label file; expected one".to_owned()),
            [row] => row.found.clone().map_err(|what| format!("{}, line {}, {what}", self.name(), row.line)),
            [first, second, ..] => Err(format!(
                "{}, lines {} and {}: found two rows for this image; expected one",
                self.name(),
                first.line,
                second.line
            )),
        }
    }

    /// Lists rows whose image is not among `images`: file and reason.
    pub(crate) fn without_image(&self, images: &[String]) -> Vec<(String, String)> {
        let unknown = self.rows.iter().filter(|row| !images.contains(&row.file));
        unknown
            .map(|row| {
                let what = format!("{}, line {}: found no image `{}`; expected one", self.name(), row.line, row.file);
                (row.file.clone(), what)
            })
            .collect()
    }

    fn name(&self) -> String {
        self.path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    }
}

fn cells(line: &str) -> Vec<&str> {
    line.split(',').map(|cell| cell.trim().trim_matches('"')).collect()
}

/// Indices of the columns.
struct Columns {
    file: usize,
    center: [usize; 2],
    radius: usize,
    diameter: Option<usize>,
}

impl Columns {
    fn label(&self, header: &[&str], cells: &[&str], [width, height]: [usize; 2]) -> Result<PressLabel, String> {
        let number = |column: usize| {
            let cell = cells.get(column).copied().unwrap_or("");
            let value = cell.parse::<f64>().ok().filter(|value| value.is_finite() && *value >= 0.0);
            value.ok_or_else(|| format!("{}: found `{cell}`; expected a number of at least 0", header[column]))
        };
        let within = |column: usize, size: usize| {
            let found = number(column)?;
            if found <= size as f64 - 1.0 {
                return Ok(found);
            }
            Err(format!("{}: found {found}, outside the image; expected 0 to {}", header[column], size - 1))
        };
        let radius = number(self.radius)?;
        let largest = 0.5 * (width as f64).hypot(height as f64);
        if !(1.0..=largest).contains(&radius) {
            let title = header[self.radius];
            return Err(format!(
                "{title}: found {radius}; expected 1 to {largest:.0} pixels, half the image's diagonal"
            ));
        }
        let diameter = self.diameter.map(|column| number(column).map(|mm| (column, 1e-3 * mm))).transpose()?;
        if let Some((column, diameter)) = diameter {
            check_diameter(diameter).map_err(|error| format!("{}: {error}", header[column]))?;
        }
        Ok(PressLabel {
            center: [within(self.center[0], width)?, within(self.center[1], height)?],
            radius,
            contact: header[self.radius] == "contact_radius_px",
            diameter: diameter.map(|(_, diameter)| diameter),
        })
    }
}
