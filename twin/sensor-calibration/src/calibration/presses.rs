//! Presses for a calibration: read, rectified and given the checks that take seconds.

use std::path::Path;

use anyhow::{Context, Result, bail};
use tactile_optics::calibration::zhang::{self, LensFit};
use tactile_optics::calibration::{Lens, PressFolder, PressReadOptions, press_checks};

use super::scale::{self, PixelSize, PixelSource};
use super::sheet::Tile;
use crate::video;

/// Folder of pictures of a checkerboard inside a folder of presses.
pub const CHECKERBOARD_FOLDER: &str = "checkerboards";
/// Minimum number of presses to learn from and to evaluate on.
const MIN_PRESSES: usize = 4;
/// Minimum share of usable images. Below it, the fault is not in single presses.
const MIN_USABLE_SHARE: f64 = 0.5;

/// Checked presses, with the source of the pixel size.
pub struct CheckedPresses {
    /// Presses consistent with the others; the rest are rejected with a reason.
    pub(super) folder: PressFolder,
    pub(super) lens: Option<Lens>,
    pub(super) checkerboards: Option<LensFit>,
    pub(super) source: PixelSource,
    /// Pixel size from that source, if available.
    pub(super) measured: Option<PixelSize>,
    pub(super) shallow: bool,
}

/// Source of presses, with prior knowledge about them.
#[derive(Debug, Clone, Copy)]
pub struct PressSource<'a> {
    /// Folder of images, or a video.
    pub path: &'a Path,
    /// Diameter of the ball for presses whose labels do not give it, m.
    pub diameter: f64,
    pub ignore_labels: bool,
    /// Image of the untouched gel, if it is not called `background`.
    pub background: Option<&'a Path>,
    /// The camera's lens, if the images are not rectified.
    pub lens: Option<&'a Path>,
    /// Source of the pixel size.
    pub pixel: PixelSource,
    /// True if all presses may be shallow.
    pub shallow: bool,
}

/// Reads the presses of a folder or a video.
pub fn read(path: &Path, diameter: f64, ignore_labels: bool, background: Option<&Path>) -> Result<PressFolder> {
    if path.is_file() && video::is_video(path) {
        return video::read_presses(path, diameter, background);
    }
    Ok(PressFolder::read_with(path, &PressReadOptions { diameter, ignore_labels, background })?)
}

impl CheckedPresses {
    /// Reads the presses, rectifies them with the given lens or with one fitted to the folder's checkerboards, and
    /// rejects outliers. Returns an error if too few remain, or if the ball's diameter or the pixel size cannot be
    /// right. `show` is called with the presses before the first of these errors.
    pub fn read(source: &PressSource<'_>, show: impl Fn(&[Tile]) -> Result<()>) -> Result<Self> {
        let mut folder = read(source.path, source.diameter, source.ignore_labels, source.background)?;
        let lens = source.lens.map(Lens::read).transpose().context("--lens")?;
        let boards = source.path.join(CHECKERBOARD_FOLDER);
        let checkerboards = if boards.exists() {
            Some(zhang::fit_folder(&boards, [folder.background.width, folder.background.height])?)
        } else {
            None
        };
        let lens = lens.or(checkerboards.as_ref().map(|fit| fit.lens));
        let mut pixel = source.pixel;
        if let Some(lens) = &lens {
            folder = folder.rectified(lens).context("the camera's lens")?;
            if let PixelSource::Ruler { ends, .. } = &mut pixel {
                *ends = ends.map(|end| lens.rectify_point(end));
            }
        }
        let measured = pixel.measured(folder.background.width)?;
        let reasons = press_checks::inconsistent_presses(&folder);
        folder.skip_presses(reasons);
        let impossible = measured.map_or(Ok(()), |PixelSize { size, .. }| {
            scale::leave_out_impossible(&mut folder, size, false)
                .and_then(|()| scale::check_depth(&folder, size, source.shallow))
        });
        let checked = Self { folder, lens, checkerboards, source: pixel, measured, shallow: source.shallow };
        show(&checked.tiles())?;
        impossible?;
        checked.check_count()?;
        Ok(checked)
    }

    /// Returns the names of the rejected images, with the reasons.
    pub fn left_out(&self) -> impl Iterator<Item = (&str, &str)> {
        self.folder.skipped.iter().map(|image| (image.name.as_str(), image.reason.as_str()))
    }

    /// Counts the accepted presses.
    pub fn count(&self) -> usize {
        self.folder.presses.len()
    }

    /// Counts the images of single lamps.
    pub fn lamps(&self) -> usize {
        self.folder.lamps.len()
    }

    /// Returns an error if too few presses remain. Rows of the label file without an image are not counted.
    pub(super) fn check_count(&self) -> Result<()> {
        let kept = self.folder.presses.len();
        let left = self.folder.skipped.iter().filter(|left| !left.missing).count();
        let total = kept + left;
        if kept >= MIN_PRESSES && kept as f64 >= MIN_USABLE_SHARE * total as f64 {
            return Ok(());
        }
        let reasons = self.folder.skipped.iter().take(6).map(|image| format!("\n{}: {}", image.name, image.reason));
        let reasons: String = reasons.collect();
        if kept < MIN_PRESSES {
            bail!("found {kept} usable presses of {total}; expected at least {MIN_PRESSES}{reasons}");
        }
        bail!(
            "found {left} of {total} presses out of line; expected less than half: the fault is not in single presses{reasons}"
        )
    }

    /// Returns tiles of the presses as read, with their circles, and of the rejected images, with the reasons.
    fn tiles(&self) -> Vec<Tile> {
        let used =
            self.folder.presses.iter().map(|press| Tile::press(press, format!("r {:.0} px", press.radius), true));
        let mut tiles: Vec<Tile> = used.chain(self.folder.skipped.iter().flat_map(Tile::left_out)).collect();
        tiles.sort_by(|a, b| a.name.cmp(&b.name));
        tiles
    }
}
