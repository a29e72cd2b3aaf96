//! Reader of video frames.
//!
//! AVI files of uncompressed or Motion-JPEG frames are read here ([`avi`]). Every other video is decoded by the program
//! `ffmpeg` ([`decoder`]), if it is installed.

mod avi;
mod decoder;
mod presses;

use std::path::Path;

use anyhow::{Result, bail};
use tactile_optics::calibration::Photo;
use tactile_optics::calibration::image_files::is_hidden;

pub use presses::read_presses;

/// File extensions of videos.
const VIDEO_EXTENSIONS: [&str; 6] = ["avi", "mp4", "m4v", "mov", "mkv", "webm"];

/// Callback for a frame and its number, counted from 0; returning `false` ends the reading.
type FrameCallback<'a> = &'a mut dyn FnMut(usize, Photo) -> Result<bool>;

/// True if a file's name is that of a video and the file is not hidden.
pub fn is_video(path: &Path) -> bool {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    !is_hidden(path) && ending.is_some_and(|ending| VIDEO_EXTENSIONS.iter().any(|known| ending == *known))
}

/// Passes the frames of a video to `take`, one at a time. Returns an error for a video without a frame.
pub fn frames(path: &Path, take: &mut dyn FnMut(usize, Photo) -> Result<bool>) -> Result<()> {
    let mut count = 0;
    let mut counted = |n: usize, photo: Photo| {
        count += 1;
        take(n, photo)
    };
    if !avi::frames(path, &mut counted)? {
        decoder::frames(path, &mut counted)?;
    }
    if count == 0 {
        bail!("{}: found no frame; expected a video", path.display());
    }
    Ok(())
}

/// Returns the name of a frame: that of the video and the frame's number.
pub fn frame_name(video: &str, frame: usize) -> String {
    format!("{video}-{frame:06}")
}
