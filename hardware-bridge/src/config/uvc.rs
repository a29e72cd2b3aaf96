//! The sections `[[uvc]]` of `bridge.toml`: webcams instead of a camera board.

use std::collections::BTreeMap;

use hand_model::pads::IMAGE_SIZE;
use serde::{Deserialize, Serialize};

/// A UVC device.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UvcConfig {
    /// Path, part of a name below `/dev/v4l/by-id`, or the card's name.
    pub device: String,
    /// Columns and rows of its pictures, pixels.
    pub size: [u32; 2],
    /// Format in which it sends them.
    pub format: UvcFormat,
    /// Squares of its pictures, one for each camera of the hand that it shows.
    pub squares: Vec<UvcSquare>,
}

/// Picture format of a UVC device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UvcFormat {
    /// Motion JPEG: one JPEG per picture.
    Mjpeg,
    /// YUYV: two bytes per pixel.
    Yuyv,
}

/// Square of a UVC device's picture that shows a camera of the hand: 240 x 240 pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UvcSquare {
    /// Index of the camera.
    pub camera: usize,
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
}

/// Returns the first error in the squares of UVC devices as (field, found, expected). The squares must lie within their
/// pictures and show every camera, up to the last one that is shown, exactly once.
pub(super) fn find_square_error(devices: &[UvcConfig]) -> Option<(String, String, String)> {
    if devices.is_empty() {
        return None;
    }
    // Number of times that each camera is shown; a hand has at least one.
    let mut shown = BTreeMap::from([(0, 0)]);
    for (n, device) in devices.iter().enumerate() {
        for (m, square) in device.squares.iter().enumerate() {
            let name = format!("uvc[{n}].squares[{m}]");
            *shown.entry(square.camera).or_default() += 1;
            let within = |start: u32, length: u32| u64::from(start) + IMAGE_SIZE as u64 <= u64::from(length);
            if !within(square.x, device.size[0]) || !within(square.y, device.size[1]) {
                let expected =
                    format!("{IMAGE_SIZE} x {IMAGE_SIZE} pixels within {} x {}", device.size[0], device.size[1]);
                return Some((name, format!("({}, {})", square.x, square.y), expected));
            }
        }
    }
    let wrong = |(expected, (camera, count)): (usize, (&usize, &usize))| {
        let count = if *camera == expected { *count } else { 0 };
        (count != 1).then_some((expected, count))
    };
    let (camera, count) = (0..).zip(&shown).find_map(wrong)?;
    Some(("uvc".into(), format!("camera {camera} {count} times"), "every camera once".into()))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::BridgeConfig;
    use super::super::tests::GOOD;

    /// UVC devices that show every camera once replace a board.
    #[test]
    fn webcams_show_every_camera_once() {
        let device = |cameras: std::ops::Range<usize>| {
            let squares: Vec<String> = cameras
                .map(|n| format!("{{ camera = {n}, x = {}, y = {} }}", 240 * (n % 3), 240 * (n / 3 % 3)))
                .collect();
            format!(
                "[[uvc]]\ndevice = \"X\"\nsize = [720, 720]\nformat = \"mjpeg\"\nsquares = [{}]\n",
                squares.join(", ")
            )
        };
        let parse = |text: &str| BridgeConfig::parse(&format!("{GOOD}\n{text}"), Path::new("bridge.toml"));
        let error = |text: &str| parse(text).expect_err("bad").to_string();
        let both = device(0..9) + &device(9..18);
        let config = parse(&both).expect("good");
        assert_eq!((config.uvc.len(), config.uvc[1].squares[8].camera), (2, 17));
        assert_eq!(BridgeConfig::parse(&config.to_toml(), Path::new("bridge.toml")).expect("its own words"), config);
        assert!(error(&device(9..18)).contains("uvc: found camera 0 0 times, expected every camera once"));
        assert!(error(&device(0..0)).contains("camera 0 0 times"));
        assert!(error(&both.replace("camera = 17", "camera = 3")).contains("camera 3 2 times"));
        assert!(error(&both.replace("camera = 17", "camera = 18")).contains("camera 17 0 times"));
        let outside = error(&both.replace("[720, 720]", "[700, 720]"));
        assert!(outside.contains("uvc[0].squares[2]: found (480, 0), expected 240 x 240"), "{outside}");
        assert!(error(&(both + "[cameras]\nport = \"/dev/x\"")).contains("one or the other"));
    }
}
