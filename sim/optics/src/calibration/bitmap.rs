//! Device-independent bitmaps: BMP files, and the frames of uncompressed AVI files.
//!
//! A BITMAPINFOHEADER gives size and coding. Rows of blue, green, red (and a fourth byte with 32 bits), or of palette
//! indices (with 8 bits), are padded to four bytes and begin at the bottom, unless the height is negative.

use crate::calibration::rgb_image::Photo;

/// Largest side, pixels.
const MAX_SIDE: i32 = 16_384;
/// Length of a BMP file's own header, bytes.
const FILE_HEADER_SIZE: usize = 14;
/// Masks of red, green and blue of 32 bits in the usual order.
const COLOR_MASKS: [u32; 3] = [0x00ff_0000, 0x0000_ff00, 0x0000_00ff];

/// True if the bytes are those of a BMP file.
pub(crate) fn is_bmp(bytes: &[u8]) -> bool {
    bytes.starts_with(b"BM")
}

/// Size and coding of a bitmap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BitmapLayout {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    top_down: bool,
    /// Bytes per pixel: 1, 3 or 4.
    bytes: usize,
    /// Four-character code of the coding, upper case, or 0 if there is none.
    pub coding: [u8; 4],
    bits: u32,
}

impl BitmapLayout {
    /// Reads a BITMAPINFOHEADER. The coding is not checked.
    pub fn from_header(header: &[u8]) -> Result<Self, String> {
        let (width, height) = (read_u32(header, 4)?.cast_signed(), read_u32(header, 8)?.cast_signed());
        let possible = |side: i32| (1..=MAX_SIDE).contains(&side);
        if !possible(width) || !possible(height.saturating_abs()) {
            return Err(format!("found {width} x {height} pixels; expected 1 to {MAX_SIDE} a side"));
        }
        let bits = read_u32(header, 12)? >> 16;
        let coding = read_u32(header, 16)?.to_le_bytes().map(|letter| letter.to_ascii_uppercase());
        let (width, rows) = (width as usize, height.unsigned_abs() as usize);
        Ok(Self { width, height: rows, top_down: height < 0, bytes: bits as usize / 8, coding, bits })
    }

    /// True if pixels are stored uncompressed, with 24 or 32 bits.
    pub fn is_raw(&self) -> bool {
        self.coding == [0; 4] && matches!(self.bits, 24 | 32)
    }

    /// Decodes these rows; `palette` has blue, green, red and a fourth byte for each of its colours.
    fn image(&self, rows: &[u8], palette: &[u8]) -> Result<Photo, String> {
        let (width, height, each) = (self.width, self.height, self.bytes);
        let line = (width * each).next_multiple_of(4);
        if rows.len() < line * height {
            return Err(format!("found {} bytes of pixels; expected {}", rows.len(), line * height));
        }
        let mut rgb = Vec::with_capacity(3 * width * height);
        for row in 0..height {
            let row = if self.top_down { row } else { height - 1 - row };
            for pixel in rows[row * line..][..width * each].chunks_exact(each) {
                let pixel = if each == 1 {
                    let color = palette.chunks_exact(4).nth(usize::from(pixel[0]));
                    color.ok_or_else(|| format!("found colour {}; expected one of the palette", pixel[0]))?
                } else {
                    pixel
                };
                rgb.extend([pixel[2], pixel[1], pixel[0]]);
            }
        }
        Ok(Photo { width, height, rgb })
    }

    /// Decodes a frame of an AVI file.
    pub fn frame(&self, bytes: &[u8]) -> Result<Photo, String> {
        self.image(bytes, &[])
    }
}

/// Decodes the bytes of a BMP file.
pub(crate) fn decode(bytes: &[u8]) -> Result<Photo, String> {
    let (begin, header) = (read_u32(bytes, 10)? as usize, bytes.get(FILE_HEADER_SIZE..).unwrap_or_default());
    let (length, layout) = (read_u32(header, 0)? as usize, BitmapLayout::from_header(header)?);
    let usual = layout.coding == [3, 0, 0, 0] && (0..3).all(|c| read_u32(header, 40 + 4 * c) == Ok(COLOR_MASKS[c]));
    if !(layout.coding == [0; 4] && matches!(layout.bits, 8 | 24 | 32) || layout.bits == 32 && usual) {
        let coding = u32::from_le_bytes(layout.coding);
        return Err(format!(
            "found a BMP of {} bits and coding {coding}; expected 8, 24 or 32 bits, not compressed",
            layout.bits
        ));
    }
    let palette = header.get(length..begin.saturating_sub(FILE_HEADER_SIZE)).unwrap_or_default();
    layout.image(bytes.get(begin..).unwrap_or_default(), palette)
}

/// Reads a little-endian 32-bit number.
fn read_u32(bytes: &[u8], at: usize) -> Result<u32, String> {
    let four = bytes.get(at..at + 4).ok_or("found a header that ends too early")?;
    Ok(u32::from_le_bytes([four[0], four[1], four[2], four[3]]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(width: i32, height: i32, bits: u16, palette: &[u8], rows: &[u8]) -> Vec<u8> {
        let begin = (FILE_HEADER_SIZE + 40 + palette.len()) as u32;
        let mut bytes = [&b"BM"[..], &[0; 8], &begin.to_le_bytes()].concat();
        bytes.extend([40i32.to_le_bytes(), width.to_le_bytes(), height.to_le_bytes()].concat());
        bytes.extend([1u16.to_le_bytes(), bits.to_le_bytes()].concat());
        bytes.extend([0; 24]);
        [&bytes, palette, rows].concat()
    }

    #[test]
    fn bitmaps_are_read_the_right_way_up() {
        let rows = [[1, 2, 3, 4, 5, 6, 0, 0], [7, 8, 9, 10, 11, 12, 0, 0]].concat();
        let up = decode(&file(2, 2, 24, &[], &rows)).expect("read");
        assert_eq!((up.pixel(0, 0), up.pixel(1, 1)), ([9, 8, 7], [6, 5, 4]));
        assert_eq!(decode(&file(2, -2, 24, &[], &rows)).expect("read").pixel(0, 0), [3, 2, 1]);
        assert_eq!(decode(&file(1, 1, 32, &[], &[1, 2, 3, 9])).expect("read").rgb, [3, 2, 1]);
        let palette = [0, 0, 0, 0, 30, 20, 10, 0];
        assert_eq!(decode(&file(1, 1, 8, &palette, &[1, 0, 0, 0])).expect("read").rgb, [10, 20, 30]);
    }

    #[test]
    fn broken_bitmaps_are_errors() {
        let whole = file(2, 2, 24, &[], &[0; 16]);
        for length in 0..whole.len() {
            assert!(decode(&whole[..length]).is_err(), "{length}");
        }
        for bytes in [
            file(0, 2, 24, &[], &[0; 16]),
            file(2, i32::MIN, 24, &[], &[0; 16]),
            file(2, 2, 16, &[], &[0; 16]),
            file(1, 1, 8, &[0; 4], &[1, 0, 0, 0]),
        ] {
            assert!(decode(&bytes).is_err());
        }
    }
}
