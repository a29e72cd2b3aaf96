//! Identification of cameras by the appearance of their untouched pads.
//!
//! No camera reports its socket, and an image of the wrong pad looks like any other. Pads differ in their lamps and
//! their cover, so that a coarse reference picture of each shows later whether a plug was moved to another socket.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::TactileFrame;
use serde::{Deserialize, Serialize};

use crate::cameras::Cameras;
use crate::config::ConfigError;

/// Version of the file.
const VERSION: u32 = 1;
/// Number of blocks along each side of a picture.
const BLOCKS_PER_SIDE: usize = 12;
/// Factor by which a picture must be closer to another camera's reference than to its own to count as exchanged.
const EXCHANGE_RATIO: f64 = 2.0;

/// Reference pictures of all cameras' untouched pads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferencePictures {
    version: u32,
    /// One entry per camera: mean colours of blocks, row by row, 0 to 255.
    cameras: Vec<Vec<f64>>,
}

/// A camera whose images show another camera's pad.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("camera {camera} shows the pad of {shows}")]
pub struct ExchangedCamera {
    /// Index under which the images come.
    pub camera: usize,
    /// Index of the camera whose pad they show.
    pub shows: usize,
}

impl ReferencePictures {
    /// Computes the pictures from the newest frame of each of `cameras` cameras; the error is the index of a camera
    /// without one.
    pub fn from_frames(frames: &[TactileFrame], cameras: usize) -> Result<Self, usize> {
        let picture = |camera: usize| {
            let frame = frames.iter().rev().find(|frame| frame.camera == camera).ok_or(camera)?;
            Ok::<_, usize>(block_means(&frame.image.rgb))
        };
        Ok(Self { version: VERSION, cameras: (0..cameras).map(picture).collect::<Result<_, _>>()? })
    }

    /// Takes one image with every camera; the error is in words.
    pub fn capture(link: &Cameras, timeout: Duration) -> Result<Self, String> {
        link.take_images();
        link.request_capture().map_err(|error| error.to_string())?;
        let (started, cameras, mut frames) = (Instant::now(), link.camera_counters().len(), Vec::new());
        loop {
            frames.extend(link.take_images());
            match Self::from_frames(&frames, cameras) {
                Ok(pictures) => return Ok(pictures),
                Err(camera) if started.elapsed() > timeout => {
                    return Err(format!("found no image of camera {camera}, expected one"));
                }
                Err(_) => std::thread::sleep(Duration::from_millis(5)),
            }
        }
    }

    /// Returns the path of the file, beside the calibration.
    pub fn beside(calibration: &Path) -> PathBuf {
        calibration.with_file_name("pictures.json")
    }

    /// Reads a file and checks that it has `cameras` cameras; `None` if there is no file.
    pub fn read(path: &Path, cameras: usize) -> Result<Option<Self>, ConfigError> {
        let text = match std::fs::read_to_string(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            text => text.map_err(|source| ConfigError::Io { path: path.to_owned(), source })?,
        };
        let read: Self = serde_json::from_str(&text)
            .map_err(|error| ConfigError::Syntax { path: path.to_owned(), message: error.to_string() })?;
        let field = |field: &str, found: String, expected: String| {
            Err(ConfigError::Field { path: path.to_owned(), field: field.to_owned(), found, expected })
        };
        if read.version != VERSION {
            return field("version", read.version.to_string(), VERSION.to_string());
        }
        let numbers = 3 * BLOCKS_PER_SIDE * BLOCKS_PER_SIDE;
        if read.cameras.len() != cameras || read.cameras.iter().any(|picture| picture.len() != numbers) {
            return field(
                "cameras",
                format!("{} pictures", read.cameras.len()),
                format!("{cameras} of {numbers} numbers"),
            );
        }
        Ok(Some(read))
    }

    pub fn write(&self, path: &Path) -> Result<(), ConfigError> {
        let text = serde_json::to_string(self).unwrap_or_default() + "\n";
        ftac_platform::file::write_atomically(path, text.as_bytes())
            .map_err(|source| ConfigError::Io { path: path.to_owned(), source })
    }

    /// Returns the cameras that now show another camera's picture.
    pub fn exchanged_cameras(&self, now: &Self) -> Vec<ExchangedCamera> {
        let shown = |(camera, picture): (usize, &Vec<f64>)| {
            let off = |other: usize| distance(picture, &self.cameras[other]);
            let shows = (0..self.cameras.len()).min_by(|one, other| off(*one).total_cmp(&off(*other)))?;
            (shows != camera && off(camera) > EXCHANGE_RATIO * off(shows)).then_some(ExchangedCamera { camera, shows })
        };
        now.cameras.iter().enumerate().filter_map(shown).collect()
    }

    /// Returns the pairs of cameras that look so much alike that an exchange would not be noticed, given that two
    /// pictures of the same pad differ by `noise`.
    pub fn indistinguishable_cameras(&self, noise: f64) -> Vec<[usize; 2]> {
        let count = self.cameras.len();
        let pairs = (0..count).flat_map(|one| (one + 1..count).map(move |other| [one, other]));
        pairs
            .filter(|[one, other]| distance(&self.cameras[*one], &self.cameras[*other]) < EXCHANGE_RATIO * noise)
            .collect()
    }

    /// Returns the largest difference between two pictures of the same camera.
    pub fn noise(&self, again: &Self) -> f64 {
        self.cameras.iter().zip(&again.cameras).map(|(one, other)| distance(one, other)).fold(0.0, f64::max)
    }
}

/// Computes the mean colours of the blocks.
fn block_means(rgb: &[u8]) -> Vec<f64> {
    let side = IMAGE_SIZE / BLOCKS_PER_SIDE;
    let mut sums = vec![0.0; 3 * BLOCKS_PER_SIDE * BLOCKS_PER_SIDE];
    for (n, value) in rgb.iter().enumerate() {
        let (pixel, colour) = (n / 3, n % 3);
        let (row, column) = (pixel / IMAGE_SIZE / side, pixel % IMAGE_SIZE / side);
        sums[3 * (row * BLOCKS_PER_SIDE + column) + colour] += f64::from(*value);
    }
    sums.iter().map(|sum| sum / (side * side) as f64).collect()
}

/// Computes the root mean square difference of two pictures, each in units of its own brightness, because lamps dim as
/// they age.
fn distance(one: &[f64], other: &[f64]) -> f64 {
    let mean = |picture: &[f64]| (picture.iter().sum::<f64>() / picture.len() as f64).max(1.0);
    let (mine, its) = (mean(one), mean(other));
    let squares = one.iter().zip(other).map(|(a, b)| (a / mine - b / its).powi(2)).sum::<f64>();
    (squares / one.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hand_model::robot::TactileImage;

    use super::*;

    const CAMERAS: usize = 18;

    /// Frames of pads whose brightness falls off in a different direction each, with `dim` times the usual brightness.
    fn frames(order: impl Fn(usize) -> usize, dim: f64) -> Vec<TactileFrame> {
        let frame = |camera: usize| {
            let angle = order(camera) as f64 * 0.35;
            let value = |n: usize| {
                let (row, column) = ((n / 3 / IMAGE_SIZE) as f64, (n / 3 % IMAGE_SIZE) as f64);
                let along = (row * angle.sin() + column * angle.cos()) / IMAGE_SIZE as f64;
                (dim * (120.0 + 60.0 * along)) as u8
            };
            let rgb = (0..3 * IMAGE_SIZE * IMAGE_SIZE).map(value).collect();
            TactileFrame { camera, time: 0.0, sequence: 0, image: Arc::new(TactileImage { rgb }) }
        };
        (0..CAMERAS).map(frame).collect()
    }

    #[test]
    fn exchanged_plugs_are_told_and_dimmed_lamps_are_not() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = ReferencePictures::beside(&folder.path().join("calibration.json"));
        assert_eq!(ReferencePictures::read(&path, CAMERAS).expect("none is fine"), None);
        let known = ReferencePictures::from_frames(&frames(|camera| camera, 1.0), CAMERAS).expect("all");
        known.write(&path).expect("written");
        let known = ReferencePictures::read(&path, CAMERAS).expect("good").expect("there");
        let dim = ReferencePictures::from_frames(&frames(|camera| camera, 0.8), CAMERAS).expect("all");
        assert_eq!(known.exchanged_cameras(&dim), []);
        let swapped = |camera: usize| {
            [camera, 4, 3][if camera == 3 {
                1
            } else if camera == 4 {
                2
            } else {
                0
            }]
        };
        let exchanged = ReferencePictures::from_frames(&frames(swapped, 0.9), CAMERAS).expect("all");
        let expected = [ExchangedCamera { camera: 3, shows: 4 }, ExchangedCamera { camera: 4, shows: 3 }];
        assert_eq!(known.exchanged_cameras(&exchanged), expected);
        assert_eq!(known.indistinguishable_cameras(known.noise(&dim)), Vec::<[usize; 2]>::new());
        assert_eq!(known.indistinguishable_cameras(10.0).len(), CAMERAS * (CAMERAS - 1) / 2);
        assert_eq!(ReferencePictures::from_frames(&frames(|camera| camera, 1.0)[1..], CAMERAS), Err(0));
    }

    #[test]
    fn a_file_that_is_none_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("pictures.json");
        for (text, words) in [
            ("{", "pictures.json"),
            (r#"{"version": 2, "cameras": []}"#, "version: found 2, expected 1"),
            (r#"{"version": 1, "cameras": [[1.0]]}"#, "cameras: found 1 pictures, expected 18 of 432 numbers"),
        ] {
            std::fs::write(&path, text).expect("written");
            let message = ReferencePictures::read(&path, CAMERAS).expect_err("bad").to_string();
            assert!(message.contains(words), "{message}");
        }
    }
}
