//! Writer of NumPy arrays (format 1.0, little endian, C order).

use std::path::Path;

use anyhow::{Context, Result};

/// Writes an array of 32-bit floats of this shape.
pub fn write(path: &Path, values: &[f32], shape: &[usize]) -> Result<()> {
    let mut bytes = header(shape);
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    ftac_platform::file::write_atomically(path, &bytes).with_context(|| path.display().to_string())
}

/// Returns the header: magic, version, and a dictionary padded so that the data start at a multiple of 64.
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
    use super::*;

    /// Splits a file by NumPy's format description (NEP 1) into the header's text and the data.
    fn parts(bytes: &[u8]) -> (&str, &[u8]) {
        assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
        let (text, data) = bytes[10..].split_at(usize::from(u16::from_le_bytes([bytes[8], bytes[9]])));
        (std::str::from_utf8(text).expect("ASCII"), data)
    }

    #[test]
    fn an_array_is_read_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("array.npy");
        for (shape, written) in [(&[6][..], "(6,)"), (&[2, 3], "(2, 3,)"), (&[1, 2, 3], "(1, 2, 3,)")] {
            let values = [0.0, -1.5, f32::MIN_POSITIVE, 3e38, f32::NAN, 0.1];
            write(&path, &values, shape).expect("written");
            let bytes = std::fs::read(&path).expect("read");
            let (text, data) = parts(&bytes);
            assert_eq!((bytes.len() - data.len()) % 64, 0, "data are aligned");
            let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {written}, }}");
            assert!(text.trim_end() == header && text.ends_with('\n'), "{text}");
            let found: Vec<u32> =
                data.chunks_exact(4).map(|four| u32::from_le_bytes(four.try_into().unwrap())).collect();
            assert_eq!(found, values.map(f32::to_bits));
        }
    }
}
