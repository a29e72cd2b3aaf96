//! Which camera is which, by what their untouched pads show.
//!
//! No camera says where it is plugged in, and an image of the wrong pad is an image like any other. Pads differ by their lamps and their
//! cover, so that a coarse picture of each, kept while all was well, tells later whether a plug went into another place.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::TactileFrame;
use serde::{Deserialize, Serialize};

use crate::cameras::Cameras;
use crate::config::ConfigError;

/// Version of the file.
const VERSION: u32 = 1;
/// Blocks along each side of a picture.
const BLOCKS: usize = 12;
/// A camera that shows another one's picture is so many times closer to it than to its own.
const CLOSER: f64 = 2.0;

/// What every camera shows of its untouched pad.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pictures {
    version: u32,
    /// A camera each: mean colours of blocks, row by row, 0 to 255.
    cameras: Vec<Vec<f64>>,
}

/// A camera whose images are not its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("camera {camera} shows the pad of {shows}")]
pub struct Mistaken {
    /// Under whose number they come.
    pub camera: usize,
    /// Whose picture they show.
    pub shows: usize,
}

impl Pictures {
    /// Of the newest frames of so many cameras; the number of a camera that has none is the error.
    pub fn of(frames: &[TactileFrame], cameras: usize) -> Result<Self, usize> {
        let picture = |camera: usize| {
            let frame = frames.iter().rev().find(|frame| frame.camera == camera).ok_or(camera)?;
            Ok::<_, usize>(coarse(&frame.image.rgb))
        };
        Ok(Self { version: VERSION, cameras: (0..cameras).map(picture).collect::<Result<_, _>>()? })
    }

    /// One look with all cameras; what went wrong in words.
    pub fn look(link: &Cameras, patience: Duration) -> Result<Self, String> {
        link.take();
        link.request_capture().map_err(|error| error.to_string())?;
        let (started, cameras, mut frames) = (Instant::now(), link.cameras().len(), Vec::new());
        loop {
            frames.extend(link.take());
            match Self::of(&frames, cameras) {
                Ok(pictures) => return Ok(pictures),
                Err(camera) if started.elapsed() > patience => {
                    return Err(format!("found no image of camera {camera}, expected one"));
                }
                Err(_) => std::thread::sleep(Duration::from_millis(5)),
            }
        }
    }

    /// Where they are kept: beside the calibration.
    pub fn beside(calibration: &Path) -> PathBuf {
        calibration.with_file_name("pictures.json")
    }

    /// Reads a file and checks that it is of so many cameras; none where there is no file.
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
        let numbers = 3 * BLOCKS * BLOCKS;
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
        platform::file::write_whole(path, text.as_bytes())
            .map_err(|source| ConfigError::Io { path: path.to_owned(), source })
    }

    /// Cameras that now show what was another one's picture.
    pub fn mistaken(&self, now: &Self) -> Vec<Mistaken> {
        let shown = |(camera, picture): (usize, &Vec<f64>)| {
            let off = |other: usize| distance(picture, &self.cameras[other]);
            let shows = (0..self.cameras.len()).min_by(|one, other| off(*one).total_cmp(&off(*other)))?;
            (shows != camera && off(camera) > CLOSER * off(shows)).then_some(Mistaken { camera, shows })
        };
        now.cameras.iter().enumerate().filter_map(shown).collect()
    }

    /// Cameras that look so much alike that an exchange would not be noticed, given that two looks at the same pad differ by `noise`.
    pub fn alike(&self, noise: f64) -> Vec<[usize; 2]> {
        let count = self.cameras.len();
        let pairs = (0..count).flat_map(|one| (one + 1..count).map(move |other| [one, other]));
        pairs.filter(|[one, other]| distance(&self.cameras[*one], &self.cameras[*other]) < CLOSER * noise).collect()
    }

    /// The largest difference between two looks at the same camera.
    pub fn noise(&self, again: &Self) -> f64 {
        self.cameras.iter().zip(&again.cameras).map(|(one, other)| distance(one, other)).fold(0.0, f64::max)
    }
}

/// Mean colours of blocks.
fn coarse(rgb: &[u8]) -> Vec<f64> {
    let side = IMAGE_SIZE / BLOCKS;
    let mut sums = vec![0.0; 3 * BLOCKS * BLOCKS];
    for (n, value) in rgb.iter().enumerate() {
        let (pixel, colour) = (n / 3, n % 3);
        let (row, column) = (pixel / IMAGE_SIZE / side, pixel % IMAGE_SIZE / side);
        sums[3 * (row * BLOCKS + column) + colour] += f64::from(*value);
    }
    sums.iter().map(|sum| sum / (side * side) as f64).collect()
}

/// Root mean square difference of two pictures, each in units of its own brightness: lamps dim as they age.
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

    /// Pads whose brightness falls off to another side each, `dim` as bright as usual.
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
        let path = Pictures::beside(&folder.path().join("calibration.json"));
        assert_eq!(Pictures::read(&path, CAMERAS).expect("none is fine"), None);
        let known = Pictures::of(&frames(|camera| camera, 1.0), CAMERAS).expect("all");
        known.write(&path).expect("written");
        let known = Pictures::read(&path, CAMERAS).expect("good").expect("there");
        let dim = Pictures::of(&frames(|camera| camera, 0.8), CAMERAS).expect("all");
        assert_eq!(known.mistaken(&dim), []);
        let swapped = |camera: usize| {
            [camera, 4, 3][if camera == 3 {
                1
            } else if camera == 4 {
                2
            } else {
                0
            }]
        };
        let exchanged = Pictures::of(&frames(swapped, 0.9), CAMERAS).expect("all");
        let expected = [Mistaken { camera: 3, shows: 4 }, Mistaken { camera: 4, shows: 3 }];
        assert_eq!(known.mistaken(&exchanged), expected);
        assert_eq!(known.alike(known.noise(&dim)), Vec::<[usize; 2]>::new());
        assert_eq!(known.alike(10.0).len(), CAMERAS * (CAMERAS - 1) / 2);
        assert_eq!(Pictures::of(&frames(|camera| camera, 1.0)[1..], CAMERAS), Err(0));
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
            let message = Pictures::read(&path, CAMERAS).expect_err("bad").to_string();
            assert!(message.contains(words), "{message}");
        }
    }
}
