//! Decoding of videos by the program `ffmpeg`, which outputs its frames as PPM images.

use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};
use tactile_optics::calibration::Photo;

use super::FrameCallback;

/// Name of the program.
const FFMPEG: &str = "ffmpeg";
/// Largest side of a frame, pixels.
const MAX_FRAME_SIDE: usize = 16_384;

/// Passes the frames on. If the program is missing, the error explains how to proceed.
pub(super) fn frames(path: &Path, take: FrameCallback<'_>) -> Result<()> {
    let name = || path.display().to_string();
    std::fs::File::open(path).with_context(name)?;
    let mut input = std::ffi::OsString::from("file:");
    input.push(path);
    let started = Command::new(FFMPEG)
        .args(["-v", "error", "-nostdin", "-i"])
        .arg(input)
        .args(["-map", "0:v:0", "-f", "image2pipe", "-c:v", "ppm", "-pix_fmt", "rgb24", "-"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let mut child = match started {
        Err(error) if error.kind() == ErrorKind::NotFound => bail!(
            "{}: found no program `{FFMPEG}` on this computer, which decodes such videos; install it (`apt install ffmpeg`, \
             `brew install ffmpeg`, `winget install ffmpeg`), or save the video as a Motion-JPEG AVI file or as images",
            name()
        ),
        started => started.with_context(|| format!("{}: {FFMPEG}", name()))?,
    };
    let (output, mut told) = (child.stdout.take().context("no output")?, child.stderr.take().context("no errors")?);
    let teller = std::thread::spawn(move || {
        let mut text = Vec::new();
        told.read_to_end(&mut text).map(|_| String::from_utf8_lossy(&text).into_owned()).unwrap_or_default()
    });
    let read = pictures(BufReader::with_capacity(1 << 20, output), take);
    if !matches!(read, Ok(true)) {
        // The remaining output is discarded.
        let _ = child.kill();
    }
    let status = child.wait().with_context(|| format!("{}: {FFMPEG}", name()))?;
    let told = teller.join().unwrap_or_default();
    if read.with_context(name)? && !status.success() {
        let first = told.lines().next().unwrap_or("no reason given").escape_debug().to_string();
        bail!("{}: {FFMPEG} cannot decode it: {first}", name());
    }
    Ok(())
}

/// Passes PPM images (P6, 255 levels) on until they end; returns `false` if the callback has ended the reading.
fn pictures(mut from: impl BufRead, take: FrameCallback<'_>) -> Result<bool> {
    for n in 0.. {
        if from.fill_buf()?.is_empty() {
            break;
        }
        let mut magic = [0; 2];
        from.read_exact(&mut magic)?;
        let [width, height, levels] = [number(&mut from)?, number(&mut from)?, number(&mut from)?];
        let possible = (1..=MAX_FRAME_SIDE).contains(&width) && (1..=MAX_FRAME_SIDE).contains(&height);
        if magic != *b"P6" || levels != 255 || !possible {
            bail!("frame {n}: found {width} x {height} pixels of {levels} levels; expected a PPM image of 255");
        }
        let mut rgb = vec![0; 3 * width * height];
        from.read_exact(&mut rgb).with_context(|| format!("frame {n}"))?;
        if !take(n, Photo { width, height, rgb })? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Reads a number of a PPM header, with the white space before it and one character after it.
fn number(from: &mut impl Read) -> Result<usize> {
    let mut digits = String::new();
    let mut byte = [0];
    loop {
        from.read_exact(&mut byte)?;
        match byte[0] {
            b'0'..=b'9' if digits.len() < 9 => digits.push(char::from(byte[0])),
            letter if letter.is_ascii_whitespace() && digits.is_empty() => {}
            letter if letter.is_ascii_whitespace() => break,
            _ => bail!("found no PPM image"),
        }
    }
    Ok(digits.parse()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_follow_one_another() {
        let mut bytes = b"P6\n2 1\n255\n".to_vec();
        bytes.extend([1, 2, 3, 10, 32, 13]);
        bytes.extend(b"P6\n1 1\n255\n\n\n\n");
        let mut found = Vec::new();
        assert!(
            pictures(&bytes[..], &mut |_, photo| {
                found.push(photo);
                Ok(true)
            })
            .expect("read")
        );
        assert_eq!((found[0].pixel(1, 0), found[1].pixel(0, 0)), ([10, 32, 13], [10, 10, 10]));
        assert!(pictures(&b"P6\n2 1\n255\nab"[..], &mut |_, _| Ok(true)).is_err());
        assert!(pictures(&b"P6\n99999 1\n255\n"[..], &mut |_, _| Ok(true)).is_err());
    }
}
