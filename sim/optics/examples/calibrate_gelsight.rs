//! Calibrates a GelSight-type sensor from presses of a steel ball, measures how well the model renders presses that it was
//! not fitted to, and renders a rod.
//!
//! `cargo run --release -p tactile-optics --example calibrate_gelsight` calibrates a synthetic sensor. With `-- FOLDER
//! BALL_DIAMETER_MM PIXEL_MM` it calibrates yours: `FOLDER` holds `background.png`, the untouched gel, and a dozen or two
//! images of presses at different positions. A GelSight Mini at 320 x 240 pixels has pixels of 0.0634 mm.

use std::error::Error;
use std::path::Path;

use tactile_optics::calibration::{
    Assumptions, BallFit, CalibratedSensor, FitEffort, PressFolder, SensorCalibration, Similarity,
};

/// Returns presses of a ball of 6 mm diameter into a sensor of 160 x 120 pixels of 0.1 mm.
fn synthetic_presses() -> Result<PressFolder, Box<dyn Error>> {
    let sensor = CalibratedSensor::nominal(160, 120, 0.1e-3)?;
    let (columns, rows) = sensor.size();
    let background = sensor.render(&vec![f32::NEG_INFINITY; columns * rows])?;
    let mut presses = Vec::new();
    for n in 0..12 {
        let center = [30.0 + 33.0 * f64::from(n % 4), 30.0 + 30.0 * f64::from(n / 4)];
        let radius = 13.0 + f64::from(n % 3);
        presses.push((format!("{n}.png"), sensor.render(&sensor.ball_penetration(center, radius, 6e-3))?));
    }
    Ok(PressFolder::from_photos(background, presses, 6e-3)?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    // Less effort than usual suffices for images without noise.
    let quick = FitEffort { per_press: 120, starts: 1, steps: [8, 12], split: false };
    let (presses, pixel, effort) = match arguments.as_slice() {
        [] => (synthetic_presses()?, 0.1e-3, quick),
        [folder, diameter, pixel] => {
            let (diameter, pixel) = (1e-3 * diameter.parse::<f64>()?, 1e-3 * pixel.parse::<f64>()?);
            (PressFolder::read(Path::new(folder), diameter, false)?, pixel, FitEffort::default())
        }
        _ => return Err("expected no argument, or FOLDER BALL_DIAMETER_MM PIXEL_MM".into()),
    };
    for skipped in &presses.skipped {
        println!("{}: not used: {}", skipped.name, skipped.reason);
    }

    // Every second press is fitted; the others are rendered and compared.
    let (fitted, held_out) = presses.even_odd();
    let fit = BallFit::new(&fitted, Assumptions::full(Some(pixel)), &effort, 1)?;
    println!("{} presses fitted, residual {:.2} grey levels", fitted.presses.len(), fit.residual);
    let quality = fit.evaluate(&held_out).ok_or("expected at least two presses")?;
    let line = |Similarity { l1, ssim, psnr }| format!("{psnr:5.1} dB, SSIM {ssim:.3}, L1 {l1:.4}");
    println!("held-out presses, rendered:       {}", line(quality.rendered.crop));
    println!("the background in their place:    {}", line(quality.floor.crop));

    // The calibration is a TOML file with an image beside it.
    let folder = std::env::temp_dir().join(format!("tactile-optics-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    SensorCalibration::write(&fit, &folder.join("sensor.toml"))?;

    // A rod of 2 mm radius along y, pressed in by 0.4 mm.
    let sensor = CalibratedSensor::read(&folder.join("sensor.toml"))?;
    let (columns, rows) = sensor.size();
    let depth = |at: usize| {
        let (x, _) = sensor.pixel_center((at % columns) as f64, (at / columns) as f64);
        let inside = 2e-3_f64.powi(2) - x * x;
        if inside > 0.0 { (inside.sqrt() - 1.6e-3) as f32 } else { f32::NEG_INFINITY }
    };
    let rod: Vec<f32> = (0..columns * rows).map(depth).collect();
    sensor.render(&rod)?.write(&folder.join("rod.png"))?;
    println!("calibration and image of a rod: {}", folder.display());
    Ok(())
}
