//! Which robot a command is about, and whose pads it feels with.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use bench::builtin::parse_pads;
use bench::trial::Means;
use hand_model::Hand;
use plant::RobotIndividual;
use plant::identified::IdentifiedRobot;
use scenarios::record::Condition;

use super::body::Body;

/// The text of the file that `--individual` names, once it is known to be good, and the name for errors.
pub fn text(path: Option<&Path>) -> Result<(Option<String>, PathBuf)> {
    let named = PathBuf::from("--individual");
    let Some(path) = path else { return Ok((None, named)) };
    let text = platform::data::read_text(path).context("--individual")?;
    IdentifiedRobot::parse(&text, path, &Hand::ftac()).context("--individual")?;
    Ok((Some(text), named))
}

/// The text of the file that `--pads` names, once it is known to be a calibration of every pad of the hand.
pub fn pads(path: Option<&Path>) -> Result<Option<String>> {
    let Some(path) = path else { return Ok(None) };
    let text = platform::data::read_text(path).context("--pads")?;
    parse_pads(&Hand::ftac(), &text, path).context("--pads")?;
    Ok(Some(text))
}

/// The robot that `--individual` names, if it names one.
pub fn robot(path: Option<&Path>) -> Result<Option<RobotIndividual>> {
    let Some(path) = path else { return Ok(None) };
    let text = platform::data::read_text(path).context("--individual")?;
    Ok(Some(IdentifiedRobot::parse(&text, path, &Hand::ftac()).context("--individual")?.individual))
}

/// The hand that it has; the drawing's without one.
pub fn hand(path: Option<&Path>) -> Result<Hand> {
    let drawn = Hand::ftac();
    Ok(robot(path)?.map_or_else(|| drawn.clone(), |own| own.hand(&drawn)))
}

/// Says that a real hand is felt with as if its pads were those of the drawing, where images are looked at and no `pads` are its own.
pub fn say_whose_pads(robot: Body, conditions: &[Condition], pads: Option<&str>) {
    let sees = |condition: &Condition| Means::of(*condition).is_some_and(Means::see_images);
    if robot == Body::Hardware && pads.is_none() && conditions.iter().any(sees) {
        eprintln!(
            "warning: touch uses the designed pads' calibration, and takes objects to sink in as its scenario says: this hand's own pads have none (--pads)"
        );
    }
}
