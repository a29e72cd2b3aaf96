//! `ftac grasps`: synthesis, the repertoire of pick-ups, plans, and the study of grasps.

mod collection;
mod generate;
pub mod hands;
mod other_hand;
mod pick_ups;
mod show;

use std::path::PathBuf;

use clap::Subcommand;

use self::collection::RepertoireArgs;
use self::generate::{GenerateArgs, SynthesisArgs};
use self::pick_ups::RoleArg;
use self::show::ShowArgs;
use super::study::{annotate, classify, landscape, map};
use crate::terminal::{Outcome, Terminal};

/// `grasps` commands.
#[derive(Debug, Subcommand)]
pub enum GraspsCommand {
    /// Find grasps for an object by sampling; each is closed by its cables, verified and held in physics.
    Generate(GenerateArgs),
    /// Measure how well synthesis works: rates, negative controls, what predicts holding.
    Eval {
        #[command(flatten)]
        synthesis: SynthesisArgs,
        /// Chains.
        #[arg(long, default_value_t = 128)]
        n: u64,
    },
    /// Make the repertoire of synthesized grasps of all objects; an interrupted run goes on where it was.
    Repertoire(RepertoireArgs),
    /// Show the best grasp of each kind: digits, contact points and friction cones, room, approach.
    Show(ShowArgs),
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
    Rehearse {
        /// Objects; default: all of the scenario.
        #[arg(long)]
        object: Vec<String>,
        /// Only this role; the other's grasps stay as they are.
        #[arg(long, value_enum)]
        role: Option<RoleArg>,
        /// Random proposals at most, for each object and role.
        #[arg(long, default_value_t = 128)]
        n: u32,
        /// The repertoire file to write (an existing one is extended).
        #[arg(long)]
        out: PathBuf,
    },
    /// Draw combinations by the rule and rehearse them without noise.
    Plan {
        /// Combinations.
        #[arg(long, default_value_t = 60)]
        combos: usize,
        /// Repertoire; default: the built-in one.
        #[arg(long)]
        repertoire: Option<PathBuf>,
        /// The plan file to write.
        #[arg(long)]
        out: PathBuf,
    },
}

/// Runs a command.
pub fn run(terminal: &Terminal, command: &GraspsCommand) -> Outcome {
    match command {
        GraspsCommand::Generate(args) => generate::generate(terminal, args),
        GraspsCommand::Eval { synthesis, n } => generate::eval(terminal, synthesis, *n),
        GraspsCommand::Repertoire(args) => collection::make(terminal, args),
        GraspsCommand::Show(args) => show::show(terminal, args),
        GraspsCommand::Hands(args) => hands::run(terminal, args),
        GraspsCommand::Classify(args) => classify::run(terminal, args),
        GraspsCommand::Annotate(args) => annotate::run(terminal, args),
        GraspsCommand::Map(args) => map::run(terminal, args),
        GraspsCommand::Landscape(args) => landscape::run(terminal, args),
        GraspsCommand::Rehearse { object, role, n, out } => pick_ups::grasps_rehearse(terminal, object, *role, *n, out),
        GraspsCommand::Plan { combos, repertoire, out } => {
            pick_ups::grasps_plan(terminal, *combos, repertoire.as_deref(), out)
        }
    }
}
