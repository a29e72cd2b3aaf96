//! A calibrated sensor as a file: commented TOML, with the image of the untouched gel as a PNG beside it.

use std::fmt::Write as _;
use std::path::Path;

use ftac_platform::file::write_atomically;
use serde::{Deserialize, Serialize};

use crate::calibration::fit::BallFit;
use crate::calibration::lens::Lens;
use crate::calibration::photo::Photo;
use crate::error::{OpticsError, check_positive};
use crate::model::SensorModel;
use crate::versioned;

/// Version of the file format.
pub const VERSION: u32 = 1;

/// Largest coating thickness, pixels: every pixel is compared with all pixels within it.
const MAX_COATING_PIXELS: f64 = 200.0;
/// Largest size of a pixel on the gel, mm.
const MAX_PIXEL_SIZE_MM: f64 = 10.0;

/// The calibration of one real sensor: image geometry, lens and image-formation model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorCalibration {
    /// Version of the file format.
    pub version: u32,
    /// Columns of an image.
    pub columns: usize,
    /// Rows of an image.
    pub rows: usize,
    /// Size of a pixel on the gel, mm.
    pub pixel_mm: f64,
    /// 95 % interval of the size of a pixel, mm; none if it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixel_interval_mm: Option<[f64; 2]>,
    /// Ratio of the contact radius of a ball's press to its visible radius.
    pub contact_over_visible: f64,
    /// File name of the image of the untouched gel, in the same folder.
    pub background: String,
    /// The camera's lens, if images are rectified first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<Lens>,
    /// The image-formation model, in the frame of the image: origin in its middle, x right, y up, z towards the object.
    pub model: SensorModel,
}

impl SensorCalibration {
    /// Creates the calibration from a fit; `background` is the name of the image beside the file.
    pub fn new(fit: &BallFit, background: String) -> Self {
        Self {
            version: VERSION,
            columns: fit.size[0],
            rows: fit.size[1],
            pixel_mm: 1e3 * fit.pixel,
            pixel_interval_mm: fit.pixel_interval.map(|ends| ends.map(|end| 1e3 * end)),
            contact_over_visible: fit.contact,
            background,
            lens: fit.lens,
            model: fit.model.clone(),
        }
    }

    /// Writes the file, with every parameter and its standard deviation as comments, and the background beside it.
    pub fn write(fit: &BallFit, path: &Path) -> Result<(), OpticsError> {
        let background = path.with_extension("background.png");
        let name = background.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let file = Self::new(fit, name);
        let rgb = fit.background.iter().map(|grey| grey.round() as u8).collect();
        Photo { width: fit.size[0], height: fit.size[1], rgb }.write(&background)?;
        let mut text = String::from(
            "# Calibration of a camera-based tactile sensor, by `ftac optics calibrate`.\n\
             #\n\
             # Frame: origin in the image's middle on the untouched gel, x right, y up, z out of the gel; camera and lamps at\n\
             # negative z. Lengths in metres unless the name says mm.\n\
             # A grey level M (0 to 1) stands for the radiance G(M) = g1 M + g2 M^2 + g3 M^3 (`coefficients`).\n\
             # A lamp gives a place at distance |s| the light eta color (cos of the angle to its direction)^mu / |s|^2.\n\
             # `roughness` is that of Oren and Nayar, rad; `ambient` is diffuse light; `size` half a lamp's extent.\n\
             # `coating` is what the camera's view of an object is grown by; `kernels` smooth the gel around a contact.\n\
             #\n\
             # What was fitted, with standard deviations (`bound`: stopped at a bound of the search; `?`: not determined by the presses):\n",
        );
        for parameter in &fit.parameters {
            let certainty = match (parameter.deviation, parameter.on_bound) {
                (_, true) => "bound".to_owned(),
                (Some(deviation), _) => format!("+- {deviation:.2e}"),
                (None, _) => "?".to_owned(),
            };
            // Writing to a string cannot fail.
            let _ = writeln!(text, "#   {:34} {:>11.4e}  {certainty}", parameter.name, parameter.value);
        }
        text.push('\n');
        text += &toml::to_string(&file).map_err(OpticsError::calibration)?;
        write_atomically(path, text.as_bytes()).map_err(|error| OpticsError::file(path, error))
    }

    /// Reads and checks a calibration and its background (grey levels, row-major RGB).
    pub fn read(path: &Path) -> Result<(Self, Vec<f32>), OpticsError> {
        let text = std::fs::read_to_string(path).map_err(|error| OpticsError::file(path, error))?;
        let file = Self::parse(&text).map_err(|error| OpticsError::file(path, error))?;
        let photo = Photo::read(&path.with_file_name(&file.background))?;
        if (photo.width, photo.height) != (file.columns, file.rows) {
            return Err(OpticsError::file(
                path,
                format!(
                    "background: found {} x {} pixels; expected {} x {}",
                    photo.width, photo.height, file.columns, file.rows
                ),
            ));
        }
        Ok((file, photo.rgb.iter().map(|&value| f32::from(value)).collect()))
    }

    /// Reads and checks the text of a calibration.
    pub fn parse(text: &str) -> Result<Self, OpticsError> {
        let file: Self = versioned::parse(text, VERSION)?;
        check_positive("pixel_mm", file.pixel_mm)?;
        if file.pixel_mm > MAX_PIXEL_SIZE_MM {
            let what = format!("pixel_mm: found {}; expected at most {MAX_PIXEL_SIZE_MM}", file.pixel_mm);
            return Err(OpticsError::calibration(what));
        }
        if let Some([low, high]) = file.pixel_interval_mm
            && !(low > 0.0 && low <= file.pixel_mm && file.pixel_mm <= high && high.is_finite())
        {
            let what = format!("pixel_interval_mm: found {low} to {high}; expected it around {}", file.pixel_mm);
            return Err(OpticsError::calibration(what));
        }
        if !(file.contact_over_visible > 0.0 && file.contact_over_visible.is_finite()) {
            let what = format!("contact_over_visible: found {}; expected a positive number", file.contact_over_visible);
            return Err(OpticsError::calibration(what));
        }
        if file.columns == 0 || file.rows == 0 {
            let what = format!("columns, rows: found {} x {}; expected at least 1", file.columns, file.rows);
            return Err(OpticsError::calibration(what));
        }
        if let Some(lens) = &file.lens {
            lens.check(file.columns, file.rows)?;
        }
        file.model.check()?;
        let coating = 1e3 * file.model.elastomer.coating / file.pixel_mm;
        if coating > MAX_COATING_PIXELS {
            let what = format!("elastomer.coating: found {coating:.0} pixels; expected at most {MAX_COATING_PIXELS}");
            return Err(OpticsError::calibration(what));
        }
        Ok(file)
    }
}
