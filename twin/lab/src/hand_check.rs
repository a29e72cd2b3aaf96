//! `ftac hand check`: validation of the hand against the paper, each figure with its method, tolerance and picture.
//!
//! A check is a list of [`row`]s. [`figures`] counts and measures the model, [`public_model`] compares its frames with
//! another group's model of this hand. [`kapandji`], [`closing_force`], [`dumbbell`] and [`flexion`] run the hand in
//! physics on a test stand, driven only by its six servos. [`feix`] tries the 33 grasp types. [`engine`] sweeps the
//! engine's settings, and [`second_engine`] writes scenes for another engine.

pub mod closing_force;
pub mod dumbbell;
pub mod engine;
pub mod feix;
pub mod figures;
pub mod flexion;
pub mod kapandji;
pub mod public_model;
pub mod row;
pub mod second_engine;

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use hand_model::Hand;

pub use row::{CheckRow, Verdict};

/// Options of `ftac hand check`.
pub struct CheckOptions<'a> {
    /// Folder of the public model of this hand; without it the row is left out.
    pub public_model: Option<&'a Path>,
    /// Folder for the pictures; without it none are drawn.
    pub out: Option<&'a Path>,
    pub seed: u64,
    /// Number of seeds of the Kapandji test, from `seed` on.
    pub seeds: u64,
}

/// Returns all rows of the check, in order.
pub fn run(hand: &Arc<Hand>, options: &CheckOptions<'_>) -> Result<Vec<CheckRow>> {
    if let Some(folder) = options.out {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    let mut rows = figures::rows(hand);
    rows.push(figures::coverage(hand, options.out)?);
    if let Some(folder) = options.public_model {
        rows.push(public_model::row(hand, folder, options.seed)?);
    }
    rows.push(kapandji::row(hand, options.out, (options.seed, options.seeds))?);
    rows.extend(closing_force::rows(hand, options.out)?);
    rows.push(dumbbell::row(hand, options.out)?);
    rows.extend(flexion::rows(hand, options.out)?);
    Ok(rows)
}

/// Lists the rows that fail, in one line; `None` if all are good.
pub fn shortfall(rows: &[CheckRow]) -> Option<String> {
    let bad: Vec<String> = rows
        .iter()
        .filter(|row| row.verdict != Verdict::Good)
        .map(|row| format!("{}: {} (beside: {})", row.what, row.ours, row.paper))
        .collect();
    (!bad.is_empty()).then(|| bad.join("; "))
}
