//! Localization of a pressed ball by the built-in calibration, radius by radius, as in recordings/log/own-pads.md:
//! `cargo run --release --example ball_places -- FIRST_UNIT LAST_UNIT RADIUS_MM...`.

use anyhow::{Context, Result};
use bench::builtin::builtin_calibration;
use hand_model::Hand;
use lab::touch::balls::press_session;
use lab::touch::own_pads::localization_errors;
use sim::tactile::TactileBoard;

fn main() -> Result<()> {
    let numbers: Vec<f64> =
        std::env::args().skip(1).map(|argument| argument.parse()).collect::<Result<_, _>>().context("numbers")?;
    let [first, last, radii @ ..] = &numbers[..] else { anyhow::bail!("expected FIRST_UNIT LAST_UNIT RADIUS_MM...") };
    let (hand, calibration) = (Hand::ftac(), builtin_calibration()?);
    for radius_mm in radii {
        let mut known = Vec::new();
        for serial in *first as u64..=*last as u64 {
            known.extend(press_session(&hand, &TactileBoard::unit(&hand, serial), 1e-3 * radius_mm, serial)?);
        }
        let found = localization_errors(&hand, &calibration, &known)?;
        let ([x, y, z], over) = ([0, 1, 2].map(|axis| 1e3 * found.rms[axis]), found.over_variance);
        println!(
            "{radius_mm} mm: {} of {}, rms {x:.3} {y:.3} {z:.3} mm, over variance {:.2} {:.2} {:.2}",
            found.found, found.of, over.x, over.y, over.z
        );
    }
    Ok(())
}
