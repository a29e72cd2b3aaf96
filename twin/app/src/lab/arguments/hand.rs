//! Arguments of `ftac hand`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use crate::options::robot::RobotArgs;

/// `hand` commands that `ftac-lab` runs.
#[derive(Debug, Subcommand)]
pub enum HandLabCommand {
    /// Check the hand's figures against the paper's, in physics where they concern motion.
    Check(CheckArgs),
    /// Close any hand on a ball, from a URDF and a file with its transmission.
    Close(CloseArgs),
    /// Write scenes for a second engine, with the commands and this engine's results.
    Export {
        /// Folder for the MJCF files and scenes.json.
        #[arg(long)]
        mjcf: PathBuf,
        /// Friction coefficient of ball, cylinder and box, 0 to 2.
        #[arg(long, default_value_t = 0.8)]
        friction: f64,
        #[command(flatten)]
        robot: RobotArgs,
        /// Also close the digits on each object with time steps up to 16 times shorter, to see where the postures of
        /// both engines converge; takes a minute.
        #[arg(long)]
        refine: bool,
    },
}

/// Arguments of `hand check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    #[command(flatten)]
    pub robot: RobotArgs,
    /// Only read this URDF, of any hand, and report its contents and every deviation from it.
    #[arg(
        long,
        alias = "hand",
        value_name = "URDF",
        conflicts_with_all = ["out", "grasps", "engine", "public_model", "seeds", "robot_model"]
    )]
    pub urdf: Option<PathBuf>,
    /// Transmission of that hand (TOML): also report where its fingers close and may touch.
    #[arg(long, alias = "transmission", requires = "urdf")]
    pub pulls: Option<PathBuf>,
    /// Folder of the public model of this hand (holds urdf/f_tac_hand.urdf; from
    /// https://github.com/Taccel-Simulator/Taccel), for a comparison of joint frames; default: none, and the row is left
    /// out.
    #[arg(long)]
    pub public_model: Option<PathBuf>,
    /// Check the 33 grasp types of Feix instead.
    #[arg(long, conflicts_with = "engine")]
    pub grasps: bool,
    /// Check only these of the 33 types, by number.
    #[arg(long, value_delimiter = ',', requires = "grasps", value_parser = clap::value_parser!(u8).range(1..=33))]
    pub types: Vec<u8>,
    /// Maximum number of attempts at each grasp type; the first that holds is kept.
    #[arg(long, default_value_t = 8000, value_parser = clap::value_parser!(u32).range(1..))]
    pub tries: u32,
    /// Number of seeds, from --seed on, of the search for the Kapandji test's points, or for the grasp types.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub seeds: u32,
    /// Sweep the engine's settings instead: slip, overlap, jitter and cost over time step and iterations.
    #[arg(long)]
    pub engine: bool,
    /// Folder for pictures and check.json.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Arguments of `hand close`.
#[derive(Debug, Args)]
pub struct CloseArgs {
    /// URDF of the hand, with collision boxes, spheres, cylinders, capsules or meshes (OBJ, STL, PLY, glTF, COLLADA).
    #[arg(long, alias = "hand", value_name = "URDF")]
    pub urdf: PathBuf,
    /// Transmission of the hand (TOML; hand-model/data/hands has examples to start from).
    #[arg(long, alias = "transmission")]
    pub pulls: PathBuf,
    /// Position at which the ball's centre is held while the hand closes, in the frame of the root link, m: x,y,z.
    #[arg(long, required = true, value_delimiter = ',', allow_hyphen_values = true)]
    pub at: Vec<f64>,
    /// Diameter of the ball, mm.
    #[arg(long, default_value_t = 60.0)]
    pub ball_diameter_mm: f64,
    /// Tension of the actuators, N: one for all, or one each in the file's order.
    #[arg(long, value_delimiter = ',', default_value = "12", allow_hyphen_values = true)]
    pub tensions: Vec<f64>,
    /// File for the picture (PNG).
    #[arg(long)]
    pub out: Option<PathBuf>,
}
