//! AVI files (RIFF) whose frames are uncompressed (24 or 32 bits a pixel) or JPEG images.
//!
//! ```text
//! RIFF 'AVI '   LIST hdrl (LIST strl (strh, strf) for each stream)   LIST movi (chunks 'NNdc' or 'NNdb' of stream NN)
//! RIFF 'AVIX'   LIST movi (the same), in files beyond 1 GB
//! ```

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Error, Result, bail};
use image::ImageFormat;
use tactile_optics::calibration::Photo;
use tactile_optics::calibration::bitmap::BitmapLayout;

use super::FrameCallback;

/// Largest frame, bytes.
const MAX_FRAME_BYTES: u32 = 256 << 20;
/// Maximum nesting of lists: a file, its header or frames, a stream, and one to spare.
const MAX_LIST_NESTING: usize = 5;

#[derive(Debug, Clone, Copy)]
struct AviStream {
    number: usize,
    layout: Option<BitmapLayout>,
}

/// Passes the frames on; returns `false` if the file is no AVI file or its frames have another coding.
pub(super) fn frames(path: &Path, take: FrameCallback<'_>) -> Result<bool> {
    let name = || path.display().to_string();
    let mut file = BufReader::new(File::open(path).with_context(name)?);
    let end = file.get_ref().metadata().with_context(name)?.len();
    let mut reader = Reader { file: &mut file, streams: 0, video: None, unknown: false, frame: 0 };
    if !reader.is_avi().with_context(name)? {
        return Ok(false);
    }
    reader.chunks(0..end, 0, take).with_context(name)?;
    if reader.unknown {
        return Ok(false);
    }
    if reader.video.is_none() {
        bail!("{}: found an AVI file without a video stream; expected one", name());
    }
    Ok(true)
}

/// Coding of Motion-JPEG.
const MOTION_JPEG: &[u8; 4] = b"MJPG";

struct Reader<'a> {
    file: &'a mut BufReader<File>,
    /// Number of streams whose headers have been read.
    streams: usize,
    video: Option<AviStream>,
    /// True if the video stream has a coding that is not supported here.
    unknown: bool,
    frame: usize,
}

impl Reader<'_> {
    fn is_avi(&mut self) -> Result<bool> {
        let mut head = [0; 12];
        let read = self.file.read_exact(&mut head);
        self.file.seek(SeekFrom::Start(0))?;
        Ok(read.is_ok() && head.starts_with(b"RIFF") && head.ends_with(b"AVI "))
    }

    /// Reads the chunks of a part of the file, nested in `lists` lists; returns `false` if the callback has ended the
    /// reading.
    fn chunks(&mut self, part: Range<u64>, lists: usize, take: FrameCallback<'_>) -> Result<bool> {
        let Range { start: mut at, end } = part;
        while at + 8 <= end {
            self.file.seek(SeekFrom::Start(at))?;
            let mut head = [0; 8];
            self.file.read_exact(&mut head)?;
            let (kind, size) = ([head[0], head[1], head[2], head[3]], word(&head, 4)?);
            let begin = at + 8;
            // A truncated recording ends within a chunk.
            let next = begin + u64::from(size) + u64::from(size % 2);
            let inside = next.min(end);
            let go_on = match &kind {
                b"RIFF" | b"LIST" if size >= 4 && lists < MAX_LIST_NESTING => {
                    self.chunks(begin + 4..inside, lists + 1, take)?
                }
                _ if begin + u64::from(size) > end => true,
                b"strh" => {
                    self.stream_header(size)?;
                    true
                }
                b"strf" => {
                    self.stream_format(size)?;
                    true
                }
                _ => self.data(kind, size, take)?,
            };
            if !go_on || self.unknown {
                return Ok(false);
            }
            at = next;
        }
        Ok(true)
    }

    fn read(&mut self, size: u32) -> Result<Vec<u8>> {
        if size > MAX_FRAME_BYTES {
            bail!("found a chunk of {size} bytes; expected at most {MAX_FRAME_BYTES}");
        }
        let mut bytes = vec![0; size as usize];
        self.file.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn stream_header(&mut self, size: u32) -> Result<()> {
        let bytes = self.read(size)?;
        self.streams += 1;
        if bytes.starts_with(b"vids") && self.video.is_none() {
            // The stream's format follows in the next chunk.
            self.video = Some(AviStream { number: self.streams - 1, layout: None });
        }
        Ok(())
    }

    /// Reads a stream's BITMAPINFOHEADER.
    fn stream_format(&mut self, size: u32) -> Result<()> {
        let bytes = self.read(size)?;
        let Some(stream) = self.video.as_mut().filter(|stream| stream.number + 1 == self.streams) else {
            return Ok(());
        };
        let layout = BitmapLayout::from_header(&bytes).map_err(Error::msg)?;
        self.unknown = layout.coding != *MOTION_JPEG && !layout.is_raw();
        stream.layout = Some(layout);
        Ok(())
    }

    fn data(&mut self, kind: [u8; 4], size: u32, take: FrameCallback<'_>) -> Result<bool> {
        let Some(AviStream { number: video, layout: Some(layout) }) = self.video else { return Ok(true) };
        let number = std::str::from_utf8(&kind[..2]).ok().and_then(|digits| digits.parse::<usize>().ok());
        // An empty chunk repeats the previous frame.
        if number != Some(video) || !matches!(&kind[2..], b"dc" | b"db") || size == 0 {
            return Ok(true);
        }
        let bytes = self.read(size)?;
        let photo = decode(&bytes, &layout).with_context(|| format!("frame {}", self.frame))?;
        self.frame += 1;
        take(self.frame - 1, photo)
    }
}

fn decode(bytes: &[u8], layout: &BitmapLayout) -> Result<Photo> {
    if layout.coding != *MOTION_JPEG {
        return layout.frame(bytes).map_err(Error::msg);
    }
    let image = image::load_from_memory_with_format(bytes, ImageFormat::Jpeg)?.to_rgb8();
    Ok(Photo { width: image.width() as usize, height: image.height() as usize, rgb: image.into_raw() })
}

/// Reads a little-endian 32-bit number.
fn word(bytes: &[u8], at: usize) -> Result<u32> {
    let four = bytes.get(at..at + 4).context("found a header that ends too early")?;
    Ok(u32::from_le_bytes([four[0], four[1], four[2], four[3]]))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
        let mut bytes = [&kind[..], &(data.len() as u32).to_le_bytes(), data].concat();
        bytes.extend((data.len() % 2 == 1).then_some(0));
        bytes
    }

    fn list(kind: &[u8; 4], of: &[u8; 4], parts: &[Vec<u8>]) -> Vec<u8> {
        chunk(kind, &[&of[..], &parts.concat()].concat())
    }

    /// Returns an AVI file with an audio stream before the video's.
    pub fn file([width, height]: [i32; 2], coding: &[u8; 4], bits: u16, frames: &[Vec<u8>]) -> Vec<u8> {
        let mut format = [40i32.to_le_bytes(), width.to_le_bytes(), height.to_le_bytes()].concat();
        format.extend([1u16.to_le_bytes(), bits.to_le_bytes()].concat());
        format.extend(coding);
        format.extend([0; 20]);
        let audio = list(b"LIST", b"strl", &[chunk(b"strh", b"auds0000"), chunk(b"strf", &[0; 18])]);
        let video = list(b"LIST", b"strl", &[chunk(b"strh", b"vids0000"), chunk(b"strf", &format)]);
        let header = list(b"LIST", b"hdrl", &[chunk(b"avih", &[0; 56]), audio, video]);
        let data = frames.iter().flat_map(|frame| [chunk(b"00wb", b"sound"), chunk(b"01dc", frame)]);
        let movie = list(b"LIST", b"movi", &data.collect::<Vec<_>>());
        list(b"RIFF", b"AVI ", &[header, movie, chunk(b"idx1", &[0; 16])])
    }

    fn read(bytes: &[u8]) -> Result<Option<Vec<Photo>>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.avi");
        std::fs::write(&path, bytes)?;
        let mut found = Vec::new();
        let known = frames(&path, &mut |n, photo| {
            assert_eq!(n, found.len());
            found.push(photo);
            Ok(true)
        })?;
        Ok(known.then_some(found))
    }

    #[test]
    fn raw_frames_are_turned_the_right_way_up() {
        // 3 x 2 pixels: rows of nine bytes, padded to twelve, the lower one first.
        let row = |red: u8| [[1, 2, red], [3, 4, red], [5, 6, red]].concat();
        let frame = [row(200), vec![0; 3], row(100), vec![0; 3]].concat();
        let photos = read(&file([3, 2], &[0; 4], 24, &[frame.clone(), frame.clone()])).expect("read").expect("frames");
        assert_eq!(photos.len(), 2);
        assert_eq!((photos[0].pixel(0, 0), photos[0].pixel(2, 1)), ([100, 2, 1], [200, 6, 5]));
        let down = read(&file([3, -2], &[0; 4], 24, &[frame])).expect("read").expect("frames");
        assert_eq!(down[0].pixel(0, 0), [200, 2, 1]);
    }

    #[test]
    fn jpeg_frames_are_read_and_other_codings_are_left_to_the_decoder() {
        let image = image::RgbImage::from_pixel(32, 16, image::Rgb([180, 90, 40]));
        let mut jpeg = std::io::Cursor::new(Vec::new());
        image.write_to(&mut jpeg, ImageFormat::Jpeg).expect("written");
        let whole = file([32, 16], b"MJPG", 24, &[jpeg.get_ref().clone(), jpeg.get_ref().clone()]);
        let photos = read(&whole).expect("read").expect("frames");
        assert!(photos.len() == 2 && photos[1].pixel(5, 5)[0].abs_diff(180) < 6);
        assert!(read(&file([32, 16], b"H264", 24, &[vec![1, 2, 3]])).expect("read").is_none());
        assert!(read(b"no video at all").expect("read").is_none());
        // A truncated recording keeps its whole frames.
        let cut = read(&whole[..whole.len() - 200]).expect("read").expect("frames");
        assert!(!cut.is_empty());
        let broken = file([32, 16], b"MJPG", 24, &[b"no jpeg".to_vec()]);
        assert!(format!("{:#}", read(&broken).expect_err("refused")).contains("frame 0"));
        assert!(read(&file([-3, 0], &[0; 4], 24, &[vec![0; 9]])).is_err());
    }
}
