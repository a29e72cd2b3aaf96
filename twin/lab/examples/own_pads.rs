//! Self-calibration of the pads from presses on a ball, unit by unit, as in recordings/log/own-pads.md: `cargo run
//! --release --example own_pads -- RADIUS_MM FIRST_UNIT LAST_UNIT LAMP`. LAMP is the brightness of one lamp of each
//! camera, 1 as built.

use anyhow::{Context, Result};
use bench::builtin::builtin_calibration;
use hand_model::Hand;
use lab::touch::own_pads::{LocalizationErrors, Normals, board_with_scaled_lamp, evaluate_pads};

fn main() -> Result<()> {
    let numbers: Vec<f64> =
        std::env::args().skip(1).map(|argument| argument.parse()).collect::<Result<_, _>>().context("numbers")?;
    let [radius_mm, first, last, lamp] = numbers[..] else {
        anyhow::bail!("expected RADIUS_MM FIRST_UNIT LAST_UNIT LAMP")
    };
    let (hand, shipped) = (Hand::ftac(), builtin_calibration()?);
    let line = |name: &str, Normals { all, by_slope }: &Normals| {
        let split: Vec<String> = by_slope.iter().map(|class| format!("{:.2}", class.mean)).collect();
        println!(
            "  {name:10} mean {:.2} median {:.2} p95 {:.2}; by slope {}",
            all.mean,
            all.median,
            all.p95,
            split.join(" ")
        );
    };
    let place = |name: &str, found: &LocalizationErrors| {
        let [x, y, z] = [0, 1, 2].map(|axis| 1e3 * found.rms[axis]);
        let over = found.over_variance;
        println!(
            "  ball by {name}: {} of {}, rms {x:.3} {y:.3} {z:.3} mm, over variance {:.2} {:.2} {:.2}",
            found.found, found.of, over.x, over.y, over.z
        );
    };
    for serial in first as u64..=last as u64 {
        let board = board_with_scaled_lamp(&hand, serial, lamp)?;
        let found = evaluate_pads(&hand, &shipped, (&board, 1e-3 * radius_mm), |_| true, serial)?;
        println!("unit {serial}, {} rounds, last step {:.1} um", found.report.rounds, 1e6 * found.report.step);
        println!(
            "  held-out ball presses: {:.2} before, {:.2} after",
            found.report.before.mean, found.report.after.mean
        );
        line("other", &found.other);
        line("laboratory", &found.laboratory);
        line("own", &found.own);
        place("other", &found.localization[0]);
        place("own", &found.localization[1]);
    }
    Ok(())
}
