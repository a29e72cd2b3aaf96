//! `ftac twin`: which one of the robots built from one drawing this is.

pub mod evaluate;
pub mod excite;
pub mod identify;

use std::path::Path;

use anyhow::Result;
use clap::Subcommand;
use hand_model::transmission::friction::CableLosses;
use hand_model::{Arm, Hand};
use proving::world::World;
use scenarios::Scenario;
use scenarios::individuals::robot::RobotIndividual;

use crate::terminal::{Outcome, Terminal};

/// Commands of `twin`.
#[derive(Debug, Subcommand)]
pub enum TwinCommand {
    /// Move the robot so that its motion shows what it is made of, and record that.
    Excite(excite::ExciteArgs),
    /// Find the parameters of the robot that was recorded.
    Identify(identify::IdentifyArgs),
    /// Identify robots whose parameters were drawn and hidden, and set what is found beside the truth.
    Evaluate(evaluate::EvaluateArgs),
}

pub fn run(terminal: &Terminal, command: &TwinCommand) -> Outcome {
    match command {
        TwinCommand::Excite(args) => excite::run(terminal, args),
        TwinCommand::Identify(args) => identify::run(terminal, args),
        TwinCommand::Evaluate(args) => evaluate::run(terminal, args),
    }
}

/// Writes the true parameters of individual `number`, which nothing but an evaluation reads.
pub fn write_truth(path: &Path, number: u64) -> Result<()> {
    let truth = RobotIndividual::draw(&Hand::ftac(), number);
    let text = serde_json::json!({
        "individual": number,
        "cameras": RobotIndividual::cameras(number),
        "parameters": truth.described(),
    });
    report::write_whole(path, serde_json::to_string_pretty(&text)?.as_bytes())
}

/// The robot as drawn, and what its cables and gears take.
pub struct Drawing {
    pub hand: Hand,
    pub arm: Arm,
    pub losses: CableLosses,
}

impl Drawing {
    /// That of the benchmark.
    pub fn new() -> Result<Self> {
        let losses = World::new(Scenario::benchmark())?.known_cable_losses();
        Ok(Self { hand: Hand::ftac(), arm: Arm::gen3(), losses })
    }
}
