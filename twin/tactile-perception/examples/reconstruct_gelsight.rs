//! Calibrates a GelSight-type sensor by presses of a ball, measures the error of its normals, reconstructs two surfaces, and
//! prints contacts, forces and slip: `cargo run --release -p tactile-perception --example reconstruct_gelsight`.
//!
//! The images are those of a small renderer. For your own sensor read them from files, with centre and radius of each
//! contact; the crate `tactile-optics` detects both in images.

use std::error::Error;

use tactile_perception::hand_model::parameters::Gel;
use tactile_perception::single_sensor::{BallImage, ImageGeometry, SingleSensor};
use tactile_perception::slip::match_patches;

/// A GelSight Mini at 320 x 240 pixels.
const GEOMETRY: ImageGeometry = ImageGeometry { columns: 320, rows: 240, pixel: 0.0634e-3 };
const DIAMETER: f64 = 8e-3;

/// Depth (m) of a ball's contact of radius `contact` (m) around `center` (m).
fn ball(center: [f64; 2], contact: f64) -> impl Fn(f64, f64) -> f64 {
    move |x, y| {
        let square = (x - center[0]).powi(2) + (y - center[1]).powi(2);
        let depth = |square: f64| (0.25 * DIAMETER * DIAMETER - square).sqrt();
        if square < contact * contact { depth(square) - depth(contact * contact) } else { 0.0 }
    }
}

/// Image of a gel with a red, a green and a blue lamp around it; row-major RGB.
fn image(depth: impl Fn(f64, f64) -> f64) -> Vec<u8> {
    let pixel = |at: usize| {
        let [x, y] = GEOMETRY.position((at % GEOMETRY.columns) as f64, (at / GEOMETRY.columns) as f64);
        let gx = (depth(x + 1e-5, y) - depth(x - 1e-5, y)) / 2e-5;
        let gy = (depth(x, y + 1e-5) - depth(x, y - 1e-5)) / 2e-5;
        [0.5_f64, 2.6, 4.7].map(|lamp| {
            // The light of a lamp fades across the gel.
            let near = 1.0 + 20.0 * (lamp.cos() * x + lamp.sin() * y);
            let light = 1.0 + 0.8 * near * (lamp.cos() * gx + lamp.sin() * gy);
            (100.0 * near * light / (1.0 + gx * gx + gy * gy).sqrt()).round().clamp(0.0, 255.0) as u8
        })
    };
    (0..GEOMETRY.columns * GEOMETRY.rows).flat_map(pixel).collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    // Sixteen presses: every second one calibrates, the others are held out.
    let background = image(|_, _| 0.0);
    let labels: Vec<([f64; 2], f64)> = (0..16)
        .map(|n| ([70.0 + 60.0 * f64::from(n % 4), 55.0 + 43.0 * f64::from(n / 4)], 22.0 + f64::from(n % 3)))
        .collect();
    let images: Vec<Vec<u8>> = labels
        .iter()
        .map(|&([column, row], radius)| image(ball(GEOMETRY.position(column, row), radius * GEOMETRY.pixel)))
        .collect();
    let presses: Vec<BallImage<'_>> = images
        .iter()
        .zip(&labels)
        .map(|(rgb, &(center, radius))| BallImage { rgb, center, radius, diameter: DIAMETER })
        .collect();
    let every_second =
        |first: usize| -> Vec<BallImage<'_>> { presses.iter().skip(first).step_by(2).copied().collect() };
    let sensor = SingleSensor::calibrate(GEOMETRY, &background, &every_second(0))?;
    let error = sensor.evaluate(&every_second(1))?;
    println!(
        "normals of held-out presses: {:.1} deg off on the mean, {:.1} deg at the 95th percentile",
        error.mean, error.p95
    );

    // The ball slides by 0.8 mm.
    let gel = Gel { thickness: 4e-3, stiffness: 40e6 };
    let mut before = Vec::new();
    for x in [0.0, 0.8e-3] {
        let contact = 1.5e-3;
        let surface = sensor.reconstruct(&image(ball([x, 1e-3], contact)))?.ok_or("an untouched gel")?;
        let deepest = sensor.depths(&surface).into_iter().fold(0.0, f32::max);
        println!("deepest {:.3} mm, truly {:.3} mm", 1e3 * deepest, 1e3 * ball([0.0; 2], contact)(0.0, 0.0));
        let now = sensor.contacts(&surface, gel);
        for patch in &now {
            let (place, area) = (1e3 * patch.centroid.coords, 1e6 * patch.area);
            println!("  contact at ({:.2}, {:.2}) mm, {area:.1} mm2, {:.2} N", place.x, place.y, patch.force);
        }
        for slip in match_patches(&before, &now).iter().filter(|slip| slip.slides(0.3e-3)) {
            println!("  slid by ({:.2}, {:.2}) mm", 1e3 * slip.shift.x, 1e3 * slip.shift.y);
        }
        before = now;
    }
    Ok(())
}
