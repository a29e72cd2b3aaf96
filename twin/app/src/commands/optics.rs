//! `ftac optics`: renders tactile images, calibrates the model to real sensors, and evaluates both.

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
    /// Fit the image-formation model of a real sensor to presses of a ball, and test it on held-out presses.
    Calibrate(calibrate::CalibrateArgs),
    /// Reconstruct normals, heights, contact masks and point clouds from images of a calibrated sensor.
    Reconstruct(reconstruct::ReconstructArgs),
    /// Evaluate a calibration, the gel's pressure law, or the fit itself.
    Eval(eval::EvalArgs),
    /// Render the image of a pad into which a mesh is pressed along its normal.
    Render(render::RenderArgs),
    /// Render twenty known shapes onto a contact sheet.
    Shapes(render::ShapesArgs),
    /// Write the calibration files of the hand's 17 pads.
    Pads(pads::PadsArgs),
}

/// Runs an `optics` command.
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
