//! `ftac hand close`: closes a hand read from files on a ball.

use std::sync::Arc;

use anyhow::{Result, bail};
use ftac::lab::arguments::hand::CloseArgs;
use ftac::options::renamed_options;
use ftac::terminal::{Outcome, Terminal};
use hand_model::hand_mechanism::HandMechanism;
use lab::closing::BallGrip;
use nalgebra::Point3;
use world::geometry::LINK_MESHES;

/// Closes the hand, prints the contact forces and draws the grip.
pub fn run(terminal: &Terminal, args: &CloseArgs) -> Outcome {
    let hand = Arc::new(HandMechanism::read(&args.urdf, &args.pulls, LINK_MESHES)?);
    renamed_options::note_renamed_options();
    let asked = tensions(&hand, &args.tensions)?;
    let (tensions, above) = hand.limit_tensions(&asked);
    for n in above {
        eprintln!(
            "note: {}: {} N requested, {:.1} N used: {}",
            hand.actuators[n].name,
            asked[n],
            tensions[n],
            hand.actuators[n].max_tension.as_ref().map_or("the efforts of its joints", |(_, by)| by)
        );
    }
    let (at, radius) = ball(args)?;
    for note in &hand.notes {
        eprintln!("note: {note}");
    }
    let grip = BallGrip::close(hand, &tensions, &at, radius);
    if let Some(path) = &args.out {
        grip.draw(path)?;
    }
    terminal.print(&grip.figures(), &grip.table())?;
    Ok(grip.shortfall())
}

fn tensions(hand: &HandMechanism, given: &[f64]) -> Result<Vec<f64>> {
    let names: Vec<&str> = hand.actuators.iter().map(|pull| pull.name.as_str()).collect();
    let all = match given {
        [one] => vec![*one; names.len()],
        several => several.to_vec(),
    };
    if all.len() != names.len() {
        bail!("--tensions: found {} values, expected 1 or {} ({})", all.len(), names.len(), names.join(", "));
    }
    if let Some(bad) = all.iter().find(|tension| !(tension.is_finite() && **tension >= 0.0)) {
        bail!("--tensions: found {bad}, expected tensions of 0 N or more");
    }
    Ok(all)
}

fn ball(args: &CloseArgs) -> Result<(Point3<f64>, f64)> {
    let [x, y, z] = args.at[..] else { bail!("--at: found {} values, expected x,y,z in m", args.at.len()) };
    if !(x.is_finite() && y.is_finite() && z.is_finite()) {
        bail!("--at: found {x},{y},{z}, expected finite numbers in m");
    }
    let diameter = args.ball_diameter_mm;
    if !(1.0..=1000.0).contains(&diameter) {
        bail!("--ball-diameter-mm: found {diameter}, expected 1 to 1000");
    }
    Ok((Point3::new(x, y, z), 0.5e-3 * diameter))
}
