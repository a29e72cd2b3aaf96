//! `ftac hand picture`: draws the hand in any posture, without a display.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use hand_model::{Hand, HandVector};
use image::RgbImage;
use report::lettering::{self, TEXT_COLOR};
use report::picture::{self, Picture, View};
use schemars::JsonSchema;
use serde::Serialize;

use crate::options::robot::RobotArgs;
use crate::terminal::{Outcome, Terminal};

/// Height of a view's caption, in heights of the view.
const CAPTION_HEIGHT: f32 = 0.028;

/// Arguments of `hand picture`.
#[derive(Debug, Args)]
pub struct PictureArgs {
    /// Posture: open, relaxed, fist, pinch, point, or angles in degrees: one for all joints, one per digit (thumb to
    /// little), or one for each of the 15 joints (thumb to little, proximal first).
    #[arg(long, default_value = "relaxed", allow_hyphen_values = true)]
    pub pose: String,
    /// Viewpoint; several are drawn side by side.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "palm")]
    pub view: Vec<Viewpoint>,
    /// Colour scheme of the pads.
    #[arg(long, value_enum, default_value_t = ColorScheme::Configuration)]
    pub color: ColorScheme,
    #[command(flatten)]
    pub robot: RobotArgs,
    /// Width and height of each view, pixels.
    #[arg(long, default_value_t = 900, value_parser = clap::value_parser!(u32).range(64..=4000))]
    pub size: u32,
    /// Leave out legend and captions.
    #[arg(long)]
    pub plain: bool,
    /// File for the picture (PNG).
    #[arg(long)]
    pub out: PathBuf,
}

/// Viewpoint of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Viewpoint {
    /// View of the palm.
    Palm,
    /// View of the back.
    Back,
    /// View from the thumb's side.
    Thumb,
    /// View from in front of the fingertips.
    Tips,
}

impl Viewpoint {
    fn view(self) -> View {
        match self {
            Self::Palm => View::palm(),
            Self::Back => View::back(),
            Self::Thumb => View::thumb_side(),
            Self::Tips => View::tips(),
        }
    }

    /// Caption of the view.
    fn words(self) -> &'static str {
        match self {
            Self::Palm => "palm",
            Self::Back => "back",
            Self::Thumb => "from the thumb's side",
            Self::Tips => "from the fingertips",
        }
    }
}

/// Colour scheme of the pads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ColorScheme {
    /// By the sensor's configuration, a to f.
    Configuration,
    /// By digit, as in recordings.
    Digit,
}

/// JSON output of `hand picture`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct PictureOutput<'a> {
    /// File of the picture.
    picture: &'a Path,
    /// Joint angles in the order of the hand file, degrees.
    angles_deg: Vec<f64>,
}

/// Runs `ftac hand picture`.
pub fn run(terminal: &Terminal, args: &PictureArgs) -> Outcome {
    let hand = args.robot.model()?.hand;
    let angles = angles(&hand, &args.pose)?;
    let pictures: Vec<RgbImage> = args.view.iter().map(|side| draw(&hand, &angles, *side, args)).collect();
    let mut sheet = picture::tile(&pictures, pictures.len());
    if !args.plain && args.color == ColorScheme::Configuration {
        legend(&mut sheet, &hand);
    }
    picture::save(&sheet, &args.out)?;
    let angles_deg = angles.iter().map(|angle| (angle.to_degrees() * 10.0).round() / 10.0).collect();
    let text = format!("{}: {} by {} pixels\n", args.out.display(), sheet.width(), sheet.height());
    terminal.print(&PictureOutput { picture: &args.out, angles_deg }, &text)?;
    Ok(None)
}

fn draw(hand: &Hand, angles: &[f64], side: Viewpoint, args: &PictureArgs) -> RgbImage {
    let mut picture = Picture::new(args.size, side.view().enclosing(&picture::hand_points(hand, angles)));
    picture.hand_with(hand, angles, |pad| match args.color {
        ColorScheme::Configuration => picture::configuration_color(pad),
        ColorScheme::Digit => telemetry::scene::link_color(hand, pad.link).map(f64::from),
    });
    let mut image = picture.finish("");
    if !args.plain {
        let height = CAPTION_HEIGHT * args.size as f32;
        let words = format!("{} hand, {}", hand.parameters.handedness, side.words());
        let at = (i64::from(args.size) / 60, i64::from(args.size) - (1.4 * height) as i64);
        lettering::sized_text(&mut image, at, height, &words, TEXT_COLOR);
    }
    image
}

/// Draws the legend in the upper left corner: the sensor configurations with their sizes.
fn legend(sheet: &mut RgbImage, hand: &Hand) {
    let scale = (sheet.height() / 450).max(1);
    for (n, (letter, configuration)) in hand.parameters.configuration.iter().enumerate() {
        let Some(pad) = hand.pads.iter().find(|pad| letter.starts_with(pad.configuration)) else { continue };
        let count = hand.pads.iter().filter(|other| other.configuration == pad.configuration).count();
        let (w, h) = (configuration.w * 1e3, configuration.h * 1e3);
        let top = i64::from(scale) * (8 + 12 * n as i64);
        let color = picture::configuration_color(pad).map(|part| part as u8);
        picture::swatch(sheet, (i64::from(scale) * 8, top), 8 * scale, color);
        let line = format!("{letter}  {h:.0} x {w:.0} mm  {count} pad{}", if count == 1 { "" } else { "s" });
        let height = 12.0 * scale as f32;
        lettering::sized_text(sheet, (i64::from(scale) * 22, top - 2 * i64::from(scale)), height, &line, TEXT_COLOR);
    }
}

/// Returns the joint angles (rad) of a posture given by its name or in degrees.
fn angles(hand: &Hand, pose: &str) -> Result<HandVector> {
    let named: Option<[[f64; 3]; 5]> = match pose {
        "open" => Some([[0.0; 3]; 5]),
        "relaxed" => {
            Some([[35.0, 12.0, 10.0], [18.0, 20.0, 12.0], [22.0, 24.0, 14.0], [26.0, 28.0, 16.0], [30.0, 32.0, 18.0]])
        }
        "fist" => {
            Some([[80.0, 40.0, 55.0], [85.0, 88.0, 60.0], [85.0, 88.0, 60.0], [85.0, 88.0, 60.0], [85.0, 88.0, 60.0]])
        }
        "pinch" => {
            Some([[78.0, 30.0, 22.0], [48.0, 42.0, 26.0], [50.0, 44.0, 26.0], [20.0, 22.0, 12.0], [14.0, 16.0, 10.0]])
        }
        "point" => {
            Some([[70.0, 45.0, 50.0], [4.0, 4.0, 2.0], [85.0, 88.0, 60.0], [85.0, 88.0, 60.0], [85.0, 88.0, 60.0]])
        }
        _ => None,
    };
    let (degrees, named): (Vec<f64>, bool) = match named {
        Some(digits) => (digits.concat(), true),
        None => (numbers(hand, pose)?, false),
    };
    let mut angles = hand.open_angles();
    for ((angle, degrees), joint) in angles.iter_mut().zip(&degrees).zip(&hand.tree.joints) {
        let (low, high) = (joint.lower.to_degrees(), joint.upper.to_degrees());
        // The angles of a named posture are clamped to the joint limits.
        let degrees = if named { degrees.clamp(low, high) } else { *degrees };
        if !(low - 1e-9..=high + 1e-9).contains(&degrees) {
            bail!("--pose: found {degrees} degrees for {}, expected {low:.0} to {high:.0}", joint.name);
        }
        *angle = degrees.to_radians();
    }
    Ok(angles)
}

/// Expands one number, one per digit, or one per joint to an angle for each joint, in the unit given.
fn numbers(hand: &Hand, pose: &str) -> Result<Vec<f64>> {
    let (digits, joints) = (hand.cables.len(), hand.tree.len());
    let expected =
        format!("open, relaxed, fist, pinch, point, or 1, {digits} or {joints} angles in degrees with commas between");
    let Ok(given) = pose.split(',').map(|word| word.trim().parse::<f64>()).collect::<Result<Vec<f64>, _>>() else {
        bail!("--pose: found `{pose}`, expected {expected}");
    };
    match given.len() {
        1 => Ok(vec![given[0]; joints]),
        count if count == digits => Ok(given.iter().flat_map(|angle| [*angle; 3]).collect()),
        count if count == joints => Ok(given),
        other => bail!("--pose: found {other} angles, expected {expected}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn postures_have_names_or_numbers() {
        let hand = Hand::ftac();
        for name in ["open", "relaxed", "fist", "pinch", "point"] {
            assert!(angles(&hand, name).is_ok(), "{name}");
        }
        let digits = angles(&hand, "0,10,20,30,90").expect("five");
        assert!((digits[5] - 10f64.to_radians()).abs() < 1e-12 && (digits[14] - 90f64.to_radians()).abs() < 1e-12);
        for (pose, found) in [("claw", "`claw`"), ("1,2", "2 angles"), ("0,0,0,0,120", "120 degrees for little_1")] {
            let error = angles(&hand, pose).expect_err(pose).to_string();
            assert!(error.contains(found), "{error}");
        }
    }
}
