//! Writer of OpenEXR images: one part, scan lines, 32-bit floats, uncompressed.
//!
//! Written by hand: the crate `exr` turns on features of `pulp`, which chooses the SIMD code of the optics.

use std::path::Path;

use anyhow::{Context, Result};

/// Writes the channels (name and row-major values, one per pixel) of an image `width` pixels wide.
pub fn write(path: &Path, width: usize, channels: &[(&str, Vec<f32>)]) -> Result<()> {
    ftac_platform::file::write_atomically(path, &encode(width, channels)).with_context(|| path.display().to_string())
}

fn encode(width: usize, channels: &[(&str, Vec<f32>)]) -> Vec<u8> {
    const FLOAT: i32 = 2;
    let height = channels.first().map_or(0, |(_, values)| values.len() / width.max(1));
    // The format requires channels in the order of their names.
    let mut channels: Vec<&(&str, Vec<f32>)> = channels.iter().collect();
    channels.sort_by_key(|(name, _)| *name);
    let mut list = Vec::new();
    for (name, _) in &channels {
        list.extend(name.bytes().chain([0]));
        // Type, linear flag with padding, sampling along both axes.
        list.extend([FLOAT, 0, 1, 1].iter().flat_map(|value| value.to_le_bytes()));
    }
    list.push(0);
    let window: Vec<u8> = [0, 0, width as i32 - 1, height as i32 - 1].iter().flat_map(|v| v.to_le_bytes()).collect();
    let one = 1.0f32.to_le_bytes();
    let mut bytes = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        bytes.extend(name.bytes().chain([0]).chain(kind.bytes()).chain([0]));
        bytes.extend((value.len() as i32).to_le_bytes());
        bytes.extend(value);
    };
    attribute("channels", "chlist", &list);
    attribute("compression", "compression", &[0]);
    attribute("dataWindow", "box2i", &window);
    attribute("displayWindow", "box2i", &window);
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &one);
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &one);
    bytes.push(0);
    let line = 4 * width * channels.len();
    let first = bytes.len() + 8 * height;
    bytes.extend((0..height).flat_map(|row| ((first + row * (line + 8)) as u64).to_le_bytes()));
    for row in 0..height {
        bytes.extend((row as i32).to_le_bytes());
        bytes.extend((line as i32).to_le_bytes());
        for (_, values) in &channels {
            bytes.extend(values[row * width..(row + 1) * width].iter().flat_map(|value| value.to_le_bytes()));
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::encode;

    #[test]
    fn each_line_lies_where_the_table_says() {
        let (width, height) = (5, 3);
        let values = |k: usize| (0..width * height).map(|i| (10 * k + i) as f32).collect::<Vec<f32>>();
        let bytes = encode(width, &[("R", values(1)), ("G", values(2))]);
        let line = 8 + 4 * width * 2;
        let data = bytes.len() - height * line;
        for row in 0..height {
            let entry = data - 8 * (height - row);
            let at = u64::from_le_bytes(bytes[entry..entry + 8].try_into().unwrap()) as usize;
            assert_eq!(at, data + row * line);
            assert_eq!(bytes[at], row as u8);
            // Green comes before red.
            let number = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
            assert_eq!(number(at + 8), (20 + row * width) as f32);
            assert_eq!(number(at + 8 + 4 * width), (10 + row * width) as f32);
        }
    }
}
