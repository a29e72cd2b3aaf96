//! Presses of a ball in a video: of each touch, the frame with the largest change.

use std::path::Path;

use anyhow::{Context, Result, bail};
use tactile_optics::calibration::{Photo, PressFolder};

use super::{frame_name, frames};

/// Thresholds of a touch on the change, grey levels: it begins above the first, and ends below this share of it
/// (hysteresis).
const TOUCH_START_CHANGE: f64 = 8.0;
const TOUCH_END_SHARE: f64 = 0.5;
/// Side of the blocks over which the change is averaged, pixels, and share of the blocks that change most in a touch.
const BLOCK_SIDE: usize = 8;
const TOUCHED_BLOCK_SHARE: f64 = 0.01;

/// Reads the presses of a video. The untouched gel is the image `background`, or the video's first frame.
pub fn read_presses(path: &Path, diameter: f64, background: Option<&Path>) -> Result<PressFolder> {
    let mut untouched = background.map(Photo::read).transpose()?;
    let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let mut found: Vec<(String, Photo)> = Vec::new();
    // The frame of the current touch with the largest change.
    let mut best: Option<(f64, usize, Photo)> = None;
    frames(path, &mut |n, photo| {
        let before = untouched.get_or_insert_with(|| photo.clone());
        if (photo.width, photo.height) != (before.width, before.height) {
            bail!(
                "{}, frame {n}: found {} x {} pixels; expected {} x {}, as the untouched gel",
                path.display(),
                photo.width,
                photo.height,
                before.width,
                before.height
            );
        }
        let change = change(&photo, before);
        match best.as_ref().map(|(most, ..)| *most) {
            None if change > TOUCH_START_CHANGE => best = Some((change, n, photo)),
            Some(most) if change > most => best = Some((change, n, photo)),
            Some(_) if change < TOUCH_END_SHARE * TOUCH_START_CHANGE => {
                found.extend(best.take().map(|(_, n, photo)| (frame_name(&name, n), photo)));
            }
            _ => {}
        }
        Ok(true)
    })?;
    found.extend(best.map(|(_, n, photo)| (frame_name(&name, n), photo)));
    let background = untouched.context("no frame")?;
    if found.is_empty() {
        bail!("{}: found no press; expected frames that differ from the untouched gel", path.display());
    }
    Ok(PressFolder::from_photos(background, found, diameter)?)
}

/// Returns the mean change, grey levels, of the blocks that change most. A change common to all pixels of a channel is
/// drift and is removed.
fn change(photo: &Photo, background: &Photo) -> f64 {
    let (across, down) = (photo.width.div_ceil(BLOCK_SIDE), photo.height.div_ceil(BLOCK_SIDE));
    let mut sums = vec![[0.0; 3]; across * down];
    let mut counts = vec![0.0; across * down];
    for (at, (now, before)) in photo.rgb.chunks_exact(3).zip(background.rgb.chunks_exact(3)).enumerate() {
        let block = at / photo.width / BLOCK_SIDE * across + at % photo.width / BLOCK_SIDE;
        for c in 0..3 {
            sums[block][c] += f64::from(now[c]) - f64::from(before[c]);
        }
        counts[block] += 1.0;
    }
    let mean = |c: usize| sums.iter().zip(&counts).map(|(sum, count)| sum[c] / count).collect::<Vec<f64>>();
    let mut blocks = vec![0.0; sums.len()];
    for c in 0..3 {
        let channel = mean(c);
        let mut sorted = channel.clone();
        sorted.sort_by(f64::total_cmp);
        let drift = sorted[sorted.len() / 2];
        blocks.iter_mut().zip(channel).for_each(|(block, value)| *block = f64::max(*block, (value - drift).abs()));
    }
    blocks.sort_by(|a, b| b.total_cmp(a));
    blocks.truncate(((TOUCHED_BLOCK_SHARE * blocks.len() as f64) as usize).max(1));
    blocks.iter().sum::<f64>() / blocks.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::video::avi;

    /// A film of an untouched gel and three successive presses.
    #[test]
    fn each_touch_of_a_film_is_a_press() {
        let (width, height) = (160usize, 120usize);
        let frame = |center: [f64; 2], strength: f64| -> Vec<u8> {
            let pixel = |at: usize| {
                let (x, y) = ((at % width) as f64 - center[0], (height - 1 - at / width) as f64 - center[1]);
                let tint = if x.hypot(y) < 18.0 { strength * x.hypot(y) / 18.0 } else { 0.0 };
                [0.0, 2.1, 4.2].map(|turn: f64| (110.0 + tint * (y.atan2(x) - turn).cos()) as u8)
            };
            (0..width * height).flat_map(pixel).collect()
        };
        let touch = |center: [f64; 2]| [0.0, 20.0, 60.0, 40.0, 0.0].map(|strength| frame(center, strength));
        let film: Vec<Vec<u8>> = [[50.0, 40.0], [100.0, 70.0], [60.0, 80.0]].into_iter().flat_map(touch).collect();
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("film.avi");
        std::fs::write(&path, avi::tests::file([width as i32, height as i32], &[0; 4], 24, &film)).expect("written");
        let found = read_presses(&path, 4e-3, None).expect("read");
        let names: Vec<&str> = found.presses.iter().map(|press| press.name.as_str()).collect();
        assert_eq!(names, ["film-000002", "film-000007", "film-000012"]);
        let off = (found.presses[1].center[0] - 100.0).hypot(found.presses[1].center[1] - 70.0);
        assert!(off < 4.0, "{:?}", found.presses[1].center);
        let untouched = vec![frame([0.0; 2], 0.0)];
        std::fs::write(&path, avi::tests::file([width as i32, height as i32], &[0; 4], 24, &untouched))
            .expect("written");
        assert!(read_presses(&path, 4e-3, None).expect_err("no press").to_string().contains("found no press"));
    }
}
