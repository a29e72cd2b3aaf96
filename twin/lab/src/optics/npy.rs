//! Arrays as NumPy reads them (format 1.0, little endian, C order).

use std::path::Path;

use anyhow::{Context, Result};

/// Writes 32-bit numbers of this shape.
pub fn write(path: &Path, values: &[f32], shape: &[usize]) -> Result<()> {
    let mut bytes = header(shape);
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    std::fs::write(path, bytes).with_context(|| path.display().to_string())
}

/// Magic, version, and a dictionary padded so that the data start at a multiple of 64.
fn header(shape: &[usize]) -> Vec<u8> {
    let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let mut text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", shape.trim_end());
    while (10 + text.len() + 1) % 64 != 0 {
        text.push(' ');
    }
    text.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.into_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::header;

    #[test]
    fn the_header_is_aligned_and_says_its_length() {
        for shape in [&[7][..], &[240, 240], &[240, 240, 3]] {
            let bytes = header(shape);
            assert_eq!(bytes.len() % 64, 0);
            assert_eq!(usize::from(u16::from_le_bytes([bytes[8], bytes[9]])), bytes.len() - 10);
        }
    }
}
