//! Conversion of an image's bytes to and from 240 x 240 RGB pixels.
//!
//! A JPEG decoder accepts many errors of a camera, so the markers are checked first: the data must begin with SOI
//! (`FF D8`) and hold EOI (`FF D9`). Padding after EOI, which the OV2640 adds, is cut off. The decoder judges the data
//! in between; damage that it does not detect cannot be detected here. Damage in transit is detected by the frame's
//! CRC.

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::TactileImage;
use image::codecs::jpeg::{JpegDecoder, JpegEncoder};
use image::{ColorType, ExtendedColorType, ImageDecoder};

use super::message::{LinkImage, PixelEncoding};

/// Error of an image's data.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ImageError {
    /// The image does not have the cameras' size.
    #[error("size: found {width} x {height}, expected {IMAGE_SIZE} x {IMAGE_SIZE}")]
    Size {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The number of bytes is wrong for RGB565.
    #[error("rgb565: found {found} bytes, expected {expected}")]
    Length {
        /// Bytes received.
        found: usize,
        /// Bytes expected: two per pixel.
        expected: usize,
    },
    /// There is no SOI at the start.
    #[error("jpeg: no start marker FF D8")]
    NoStart,
    /// There is no EOI.
    #[error("jpeg: no end marker FF D9 in {0} bytes")]
    NoEnd(usize),
    /// The decoder reports an error.
    #[error("jpeg: {0}")]
    Jpeg(String),
}

/// Decodes the pixels of an image.
pub fn decode(image: &LinkImage) -> Result<TactileImage, ImageError> {
    check_size(image.width.into(), image.height.into())?;
    match image.encoding {
        PixelEncoding::Rgb565 => decode_rgb565(&image.data),
        PixelEncoding::Jpeg => decode_jpeg(&image.data),
    }
}

fn check_size(width: u32, height: u32) -> Result<(), ImageError> {
    let side = IMAGE_SIZE as u32;
    if (width, height) == (side, side) { Ok(()) } else { Err(ImageError::Size { width, height }) }
}

fn decode_rgb565(data: &[u8]) -> Result<TactileImage, ImageError> {
    let expected = 2 * IMAGE_SIZE * IMAGE_SIZE;
    if data.len() != expected {
        return Err(ImageError::Length { found: data.len(), expected });
    }
    let mut rgb = Vec::with_capacity(3 * IMAGE_SIZE * IMAGE_SIZE);
    for pixel in data.chunks_exact(2) {
        let word = u16::from_be_bytes([pixel[0], pixel[1]]);
        let (r, g, b) = ((word >> 11) as u8, (word >> 5 & 0x3F) as u8, (word & 0x1F) as u8);
        // The high bits repeated below make the darkest 0 and the brightest 255.
        rgb.extend_from_slice(&[r << 3 | r >> 2, g << 2 | g >> 4, b << 3 | b >> 2]);
    }
    Ok(TactileImage { rgb })
}

fn decode_jpeg(data: &[u8]) -> Result<TactileImage, ImageError> {
    if !data.starts_with(&[0xFF, 0xD8]) {
        return Err(ImageError::NoStart);
    }
    // Inside the coded picture FF is followed by 00 or a restart marker, so the last FF D9 is the end.
    let end = data.windows(2).rposition(|pair| pair == [0xFF, 0xD9]).ok_or(ImageError::NoEnd(data.len()))?;
    let failed = |error: image::ImageError| ImageError::Jpeg(error.to_string());
    let decoder = JpegDecoder::new(std::io::Cursor::new(&data[..end + 2])).map_err(failed)?;
    let (width, height) = decoder.dimensions();
    check_size(width, height)?;
    if decoder.color_type() != ColorType::Rgb8 {
        return Err(ImageError::Jpeg(format!("found {:?}, expected colour", decoder.color_type())));
    }
    let mut rgb = vec![0; 3 * IMAGE_SIZE * IMAGE_SIZE];
    decoder.read_image(&mut rgb).map_err(failed)?;
    Ok(TactileImage { rgb })
}

/// Encodes 240 x 240 RGB pixels as a JPEG: the board's side.
pub fn encode_jpeg(rgb: &[u8], quality: u8) -> Result<Vec<u8>, ImageError> {
    let mut data = Vec::new();
    let side = IMAGE_SIZE as u32;
    JpegEncoder::new_with_quality(&mut data, quality)
        .encode(rgb, side, side, ExtendedColorType::Rgb8)
        .map_err(|error| ImageError::Jpeg(error.to_string()))?;
    Ok(data)
}

/// Encodes RGB pixels as RGB565: the board's side.
pub fn encode_rgb565(rgb: &[u8]) -> Vec<u8> {
    rgb.chunks_exact(3)
        .flat_map(|pixel| {
            let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(u16::from);
            ((r >> 3) << 11 | (g >> 2) << 5 | b >> 3).to_be_bytes()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Vec<u8> {
        (0..IMAGE_SIZE * IMAGE_SIZE).flat_map(|n| [(n % IMAGE_SIZE) as u8, (n / IMAGE_SIZE) as u8, 128]).collect()
    }

    fn image(encoding: PixelEncoding, data: Vec<u8>) -> LinkImage {
        LinkImage { camera: 0, sequence: 0, captured_us: 0, width: 240, height: 240, encoding, data }
    }

    fn largest_difference(a: &[u8], b: &[u8]) -> u8 {
        a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().expect("pixels")
    }

    #[test]
    fn both_encodings_come_back() {
        let rgb = picture();
        let raw = decode(&image(PixelEncoding::Rgb565, encode_rgb565(&rgb))).expect("raw");
        assert!(largest_difference(&raw.rgb, &rgb) <= 7);
        let jpeg = decode(&image(PixelEncoding::Jpeg, encode_jpeg(&rgb, 90).expect("coded"))).expect("jpeg");
        assert!(largest_difference(&jpeg.rgb, &rgb) <= 12);
        let white = decode(&image(PixelEncoding::Rgb565, vec![0xFF; 115_200])).expect("raw");
        assert!(white.rgb.iter().all(|value| *value == 255));
    }

    #[test]
    fn camera_quirks() {
        let good = encode_jpeg(&picture(), 70).expect("coded");
        let padded = [good.clone(), vec![0; 37]].concat();
        assert!(decode(&image(PixelEncoding::Jpeg, padded)).is_ok(), "padding after the end is harmless");
        assert_eq!(decode(&image(PixelEncoding::Jpeg, good[2..].to_vec())), Err(ImageError::NoStart));
        let half = good[..good.len() / 2].to_vec();
        assert_eq!(decode(&image(PixelEncoding::Jpeg, half.clone())), Err(ImageError::NoEnd(half.len())));
        assert!(matches!(decode(&image(PixelEncoding::Rgb565, good)), Err(ImageError::Length { .. })));
        let mut small = image(PixelEncoding::Jpeg, vec![]);
        small.width = 160;
        assert_eq!(decode(&small), Err(ImageError::Size { width: 160, height: 240 }));
    }
}
