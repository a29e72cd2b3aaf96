//! Error of a calibration against the number of presses, as in recordings/log/own-sensor.md. Odd presses of a folder
//! are held out; training uses 3, 6, 12, 24 ... evenly chosen ones of the even presses. `cargo run --release -p
//! sensor-calibration --example calibration_curve -- FOLDER BALL_DIAMETER_MM PIXEL_MM`.

use std::path::PathBuf;

use anyhow::{Context, Result};
use sensor_calibration::calibration::folds::{self, Fold};
use tactile_optics::calibration::{Assumptions, FitEffort, PressFolder, press_checks};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, numbers @ ..] = &arguments[..] else { anyhow::bail!("expected FOLDER BALL_DIAMETER_MM PIXEL_MM") };
    let numbers: Vec<f64> = numbers.iter().map(|number| number.parse()).collect::<Result<_, _>>().context("numbers")?;
    let [diameter, pixel] = numbers[..] else { anyhow::bail!("expected FOLDER BALL_DIAMETER_MM PIXEL_MM") };
    let mut all = PressFolder::read(&PathBuf::from(folder), 1e-3 * diameter, false)?;
    let reasons = press_checks::inconsistent_presses(&all);
    all.skip_presses(reasons);
    let (even, odd) = all.even_odd();
    println!("presses  method   normals deg  depth rms %  found/depth  height mm");
    let of = even.presses.len();
    for count in std::iter::successors(Some(3), |count| Some(2 * count)).take_while(|count| *count <= of) {
        let chosen: Vec<usize> = (0..count).map(|n| (2 * n + 1) * of / (2 * count)).collect();
        let (fitted, _) = even.split(|index, _| chosen.contains(&index));
        let folds = [Fold { fitted, held_out: odd.clone() }];
        let assumptions = Assumptions::full(Some(1e-3 * pixel));
        let judged = match folds::evaluate_folds(&folds, assumptions, &FitEffort::default(), 1, &|| ()) {
            Ok(judged) => judged,
            Err(error) => {
                println!("{count:>7}  {error:#}");
                continue;
            }
        };
        let (_, accuracy) = folds::combine_folds(judged);
        for (method, found) in ["look-up", "network"].into_iter().zip(accuracy) {
            println!(
                "{count:>7}  {method:<7}  {:>11.2}  {:>11.1}  {:>11.3}  {:>9.3}",
                found.normals_deg.mean,
                100.0 * found.depth_relative,
                found.depth_ratio,
                1e3 * found.height
            );
        }
    }
    Ok(())
}
