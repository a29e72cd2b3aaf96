//! `ftac grasps`: grasp synthesis, and the benchmark's repertoire and grasp pairs.

pub mod collection;
pub mod export;
mod generate;
pub mod repertoire;
pub mod show;

use clap::Subcommand;

use self::collection::CollectionArgs;
use self::export::ExportArgs;
use self::generate::{EvalArgs, GenerateArgs};
use self::repertoire::{PairsArgs, RepertoireArgs};
use self::show::ShowArgs;
use crate::lab::arguments::grasps::GraspsLabCommand;
use crate::lab::hand_over::LabProgram;
use crate::terminal::{Outcome, Terminal};

/// `grasps` commands.
#[derive(Debug, Subcommand)]
pub enum GraspsCommand {
    /// Synthesize grasps for an object by sampling; each is closed by its cables, verified and held in physics.
    Generate(GenerateArgs),
    /// Evaluate synthesis: success rates, negative controls, predictors of holding; or check the grasps of a file
    /// again.
    Eval(EvalArgs),
    /// Synthesize the collection of grasps of all objects; resumes if interrupted.
    Collection(CollectionArgs),
    /// Show the best grasp of each kind: digits, contact points and friction cones, free space, approach.
    Show(ShowArgs),
    /// Write held grasps as MJCF scenes with commands and tests, to close and shake them in a second engine.
    Export(ExportArgs),
    #[command(flatten)]
    Lab(GraspsLabCommand),
    /// Make the benchmark's repertoire for the scenario's objects: grasps that hold in physics rollouts.
    Repertoire(RepertoireArgs),
    /// Draw object combinations by the benchmark's rule and verify their grasp pairs in rollouts without noise.
    Pairs(PairsArgs),
}

/// Runs a `grasps` command; those of `ftac-lab` are handed over to the `lab`.
pub fn run(terminal: &Terminal, command: &GraspsCommand, lab: &LabProgram<'_>) -> Outcome {
    match command {
        GraspsCommand::Generate(args) => generate::generate(terminal, args),
        GraspsCommand::Eval(args) => generate::eval(terminal, args),
        GraspsCommand::Collection(args) => collection::make(terminal, args),
        GraspsCommand::Show(args) => show::show(terminal, args),
        GraspsCommand::Export(args) => export::run(terminal, args),
        GraspsCommand::Lab(_) => Err(lab.exec_lab()),
        GraspsCommand::Repertoire(args) => repertoire::make_repertoire(terminal, args),
        GraspsCommand::Pairs(args) => repertoire::make_pairs(terminal, args),
    }
}
