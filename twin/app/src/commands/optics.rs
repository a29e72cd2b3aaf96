//! `ftac optics`: renders tactile images, calibrates to real sensors, and evaluates both.

pub mod calibrate;
pub mod eval;
pub mod pads;
pub mod reconstruct;
pub mod render;
mod sensor_option;

use clap::Subcommand;

use crate::terminal::{Outcome, Terminal};

/// `optics` commands.
#[derive(Debug, Subcommand)]
pub enum OpticsCommand {
    /// Fit a real sensor's image-formation model to presses of a ball, and render presses held out.
    Calibrate(calibrate::CalibrateArgs),
    /// Turn images of a calibrated sensor into normals, heights, contact masks and point clouds.
    Reconstruct(reconstruct::ReconstructArgs),
    /// Evaluate a calibration, the gel's pressure law, or the fit itself.
    Eval(eval::EvalArgs),
    /// Render what a pad sees when a mesh is pressed into it along its normal.
    Render(render::RenderArgs),
    /// Render twenty known shapes onto a contact sheet.
    Shapes(render::ShapesArgs),
    /// Write the calibration files of the hand's 17 pads.
    Pads(pads::PadsArgs),
}

/// Runs a command.
pub fn run(terminal: &Terminal, command: &OpticsCommand) -> Outcome {
    match command {
        OpticsCommand::Calibrate(args) => calibrate::calibrate(terminal, args),
        OpticsCommand::Reconstruct(args) => reconstruct::reconstruct(terminal, args),
        OpticsCommand::Eval(args) => eval::eval(terminal, args),
        OpticsCommand::Render(args) => render::render(terminal, args),
        OpticsCommand::Shapes(args) => render::shapes(terminal, args),
        OpticsCommand::Pads(args) => pads::pads(terminal, args),
    }
}
