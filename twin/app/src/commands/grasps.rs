//! `ftac grasps`: synthesis, the benchmark's pick-ups and plans, and the study of grasps.

mod collection;
mod export;
mod generate;
pub mod hands;
mod pick_ups;
mod show;

use clap::Subcommand;

use self::collection::CollectionArgs;
use self::export::ExportArgs;
use self::generate::{EvalArgs, GenerateArgs};
use self::pick_ups::{PickUpsArgs, PlanArgs};
use self::show::ShowArgs;
use super::study::{annotate, classify, landscape, map};
use crate::terminal::{Outcome, Terminal};

/// `grasps` commands.
#[derive(Debug, Subcommand)]
pub enum GraspsCommand {
    /// Find grasps for an object by sampling; each is closed by its cables, verified and held in physics.
    Generate(GenerateArgs),
    /// Measure how well synthesis works: rates, negative controls, what predicts holding; or check the grasps of a file once more.
    Eval(EvalArgs),
    /// Make the collection of synthesized grasps of all objects; an interrupted run goes on where it was.
    Collection(CollectionArgs),
    /// Show the best grasp of each kind: digits, contact points and friction cones, room, approach.
    Show(ShowArgs),
    /// Write held grasps as MJCF scenes with their commands and tests, to close and shake them in a second engine.
    Export(ExportArgs),
    /// Set hands side by side on the same objects: how often each finds a grasp that holds, with a picture sheet.
    Hands(hands::HandsArgs),
    /// Give every verified grasp one of the paper's 19 types, by rules with reasons; compare with people's labels.
    Classify(classify::ClassifyArgs),
    /// Write a page, usable offline, on which people give grasps their types.
    Annotate(annotate::AnnotateArgs),
    /// Put contact maps on a sheet, with the boundary between power and precision grasps.
    Map(map::MapArgs),
    /// Map the energy landscape of grasps: basins, barriers and their tree. An interrupted run goes on.
    Landscape(landscape::LandscapeArgs),
    /// Find the benchmark's repertoire of pick-ups for the scenario's objects by rehearsing them in physics.
    PickUps(PickUpsArgs),
    /// Draw combinations by the rule and rehearse them without noise.
    Plan(PlanArgs),
}

/// Runs a command.
pub fn run(terminal: &Terminal, command: &GraspsCommand) -> Outcome {
    match command {
        GraspsCommand::Generate(args) => generate::generate(terminal, args),
        GraspsCommand::Eval(args) => generate::eval(terminal, args),
        GraspsCommand::Collection(args) => collection::make(terminal, args),
        GraspsCommand::Show(args) => show::show(terminal, args),
        GraspsCommand::Export(args) => export::run(terminal, args),
        GraspsCommand::Hands(args) => hands::run(terminal, args),
        GraspsCommand::Classify(args) => classify::run(terminal, args),
        GraspsCommand::Annotate(args) => annotate::run(terminal, args),
        GraspsCommand::Map(args) => map::run(terminal, args),
        GraspsCommand::Landscape(args) => landscape::run(terminal, args),
        GraspsCommand::PickUps(args) => pick_ups::make(terminal, args),
        GraspsCommand::Plan(args) => pick_ups::plan(terminal, args),
    }
}
