//! Arguments of `ftac hand`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use crate::options::robot::RobotArgs;

/// `hand` commands that `ftac-lab` runs.
#[derive(Debug, Subcommand)]
pub enum HandLabCommand {
    /// Check the body's figures against the paper's, in physics where they are about motion.
    Check(CheckArgs),
    /// Close any hand on a ball: a URDF and a file that says what pulls on its joints.
    Close(CloseArgs),
    /// Write scenes for a second engine, with the commands and what ours made of them.
    Export {
        /// Folder for the MJCF files and scenes.json.
        #[arg(long)]
        mjcf: PathBuf,
        /// Friction coefficient of ball, cylinder and box, 0 to 2.
        #[arg(long, default_value_t = 0.8)]
        friction: f64,
        #[command(flatten)]
        robot: RobotArgs,
        /// Also close the digits on each prop with steps up to 16 times shorter, to see where both engines' postures go; takes a minute.
        #[arg(long)]
        refine: bool,
    },
}

/// Arguments of `hand check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    #[command(flatten)]
    pub robot: RobotArgs,
    /// Only read this URDF, of any hand, and say what it holds and what is taken otherwise than it says.
    #[arg(long, alias = "hand", value_name = "URDF")]
    pub urdf: Option<PathBuf>,
    /// With what pulls on that hand's joints (TOML): also where its fingers close and may touch.
    #[arg(long, alias = "transmission", requires = "urdf")]
    pub pulls: Option<PathBuf>,
    /// Folder of the public model of this hand (holds urdf/f_tac_hand.urdf; from https://github.com/Taccel-Simulator/Taccel), to compare joint
    /// frames with; default: ../shared/data/hands/ftac_public, and where that is missing the row is left out.
    #[arg(long)]
    pub public_model: Option<PathBuf>,
    /// Try the 33 grasp types of Feix instead.
    #[arg(long, conflicts_with = "engine")]
    pub grasps: bool,
    /// Only these of the 33, by number.
    #[arg(long, value_delimiter = ',', requires = "grasps", value_parser = clap::value_parser!(u8).range(1..=33))]
    pub types: Vec<u8>,
    /// Attempts at each grasp type at most; the first that holds is kept.
    #[arg(long, default_value_t = 3000, value_parser = clap::value_parser!(u32).range(1..))]
    pub tries: u32,
    /// Search the Kapandji test's points, or the grasp types, with so many seeds, from --seed on.
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
    /// The hand: URDF with collision boxes, spheres, cylinders, capsules or meshes (OBJ, STL, PLY, glTF, COLLADA).
    #[arg(long, alias = "hand", value_name = "URDF")]
    pub urdf: PathBuf,
    /// What pulls on its joints (TOML; hand-model/data/hands has some to start from).
    #[arg(long, alias = "transmission")]
    pub pulls: PathBuf,
    /// Where the ball's centre is held while the hand closes, in the root link's frame, m: x,y,z.
    #[arg(long, required = true, value_delimiter = ',', allow_hyphen_values = true)]
    pub at: Vec<f64>,
    /// The ball's diameter, mm.
    #[arg(long, default_value_t = 60.0)]
    pub ball_diameter_mm: f64,
    /// Tension of each actuator, N: one for all, or one each in the file's order.
    #[arg(long, value_delimiter = ',', default_value = "12", allow_hyphen_values = true)]
    pub tensions: Vec<f64>,
    /// Picture to write (PNG).
    #[arg(long)]
    pub out: Option<PathBuf>,
}
