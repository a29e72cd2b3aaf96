//! Text in pictures, in the font Hack (fixed width).

use std::sync::LazyLock;

use ab_glyph::{Font as _, FontRef, PxScale, ScaleFont as _, point};
use image::{Rgb, RgbImage};

/// Ink of texts that have no colour of their own.
pub const TEXT_COLOR: [u8; 3] = [40, 42, 48];
/// Height of a line of [`text`], pixels.
pub const LINE_HEIGHT: i64 = 14;

static FONT: LazyLock<FontRef> =
    LazyLock::new(|| FontRef::try_from_slice(epaint_default_fonts::HACK_REGULAR).expect("the font is in the program"));

/// Writes `line` with its upper left corner at (x, y), in lines of [`LINE_HEIGHT`]. What lies outside the image is left
/// out.
pub fn text(image: &mut RgbImage, at: (i64, i64), line: &str, color: [u8; 3]) {
    sized_text(image, at, LINE_HEIGHT as f32, line, color);
}

/// As [`text`], with lines of `height` pixels.
pub fn sized_text(image: &mut RgbImage, (x, y): (i64, i64), height: f32, line: &str, color: [u8; 3]) {
    let font = FONT.as_scaled(PxScale::from(height));
    let (mut across, baseline) = (x as f32, y as f32 + font.ascent());
    for letter in line.chars() {
        let id = font.glyph_id(letter);
        let glyph = id.with_scale_and_position(PxScale::from(height), point(across, baseline));
        across += font.h_advance(id);
        let Some(outline) = FONT.outline_glyph(glyph) else { continue };
        let corner = outline.px_bounds().min;
        outline.draw(|column, row, cover| {
            let at = [corner.x as i64 + i64::from(column), corner.y as i64 + i64::from(row)].map(u32::try_from);
            let [Ok(px), Ok(py)] = at else { return };
            if let Some(Rgb(pixel)) = image.get_pixel_mut_checked(px, py) {
                for (part, ink) in pixel.iter_mut().zip(color) {
                    *part = (f32::from(*part) + (f32::from(ink) - f32::from(*part)) * cover.min(1.0)).round() as u8;
                }
            }
        });
    }
}

/// Returns the width of `line` in lines of `height` pixels, pixels.
pub fn width(line: &str, height: f32) -> f32 {
    let font = FONT.as_scaled(PxScale::from(height));
    line.chars().map(|letter| font.h_advance(font.glyph_id(letter))).sum()
}

/// Breaks `text` at blanks into lines of `limit` pixels at most, in lines of `height` pixels; a longer word has a line
/// of its own.
pub fn wrapped(text: &str, height: f32, limit: f32) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width(line, height) + width(" ", height) + width(word, height) <= limit => {
                *line += " ";
                *line += word;
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ink(image: &RgbImage) -> Vec<(u32, u32)> {
        image.enumerate_pixels().filter(|(.., pixel)| pixel.0[0] < 128).map(|(x, y, _)| (x, y)).collect()
    }

    /// Letters lie in their line, at their width; what lies outside the image is left out.
    #[test]
    fn letters_lie_in_their_line() {
        let mut image = RgbImage::from_pixel(200, 60, Rgb([255; 3]));
        sized_text(&mut image, (20, 10), 30.0, "Mg|", [0; 3]);
        let (letters, wide) = (ink(&image), width("Mg|", 30.0));
        assert!((40.0..60.0).contains(&wide), "{wide}");
        assert!(!letters.is_empty());
        assert!(
            letters.iter().all(|(x, y)| (20..=20 + wide as u32).contains(x) && (10..=40).contains(y)),
            "{letters:?}"
        );
        let before = image.clone();
        for at in [(-500, 10), (500, 10), (20, -100), (20, 100)] {
            text(&mut image, at, "outside", [0; 3]);
        }
        assert_eq!(image, before);
        text(&mut image, (-10, -5), "half", [0; 3]);
        assert_ne!(image, before);
    }

    /// Lines are as long as they can be; a long word is alone.
    #[test]
    fn texts_are_wrapped() {
        let letter = width("a", 14.0);
        let lines = wrapped("the hand lifts the salt mill", 14.0, 9.5 * letter);
        assert_eq!(lines, ["the hand", "lifts the", "salt mill"]);
        assert_eq!(wrapped("a phenomenally b", 14.0, 4.0 * letter), ["a", "phenomenally", "b"]);
        assert!(wrapped(" ", 14.0, 50.0).is_empty());
    }
}
