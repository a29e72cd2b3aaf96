//! Arguments of `hand` and `arm`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

/// `hand` commands.
#[derive(Debug, Subcommand)]
pub enum HandCommand {
    /// Check the body's figures against the paper's, in physics where they are about motion.
    Check(CheckArgs),
    /// Close any hand on a ball: a URDF and a file that says what pulls on its joints.
    Close(CloseArgs),
    /// Write scenes for a second engine, with the commands and what ours made of them.
    Export {
        /// Folder for the MJCF files and scenes.json.
        #[arg(long)]
        mjcf: PathBuf,
    },
}

/// Arguments of `hand check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Only read this URDF; it must have the hand's joints.
    #[arg(long)]
    pub urdf: Option<PathBuf>,
    /// Folder of the public model of this hand (holds urdf/f_tac_hand.urdf), to compare joint frames with; the default is seen from
    /// the folder ftac is started in.
    #[arg(long, default_value = "../shared/data/hands/ftac_public")]
    pub public_model: PathBuf,
    /// Try the 33 grasp types of Feix instead.
    #[arg(long, conflicts_with = "engine")]
    pub grasps: bool,
    /// Only these of the 33, by number.
    #[arg(long, value_delimiter = ',', requires = "grasps", value_parser = clap::value_parser!(u8).range(1..=33))]
    pub types: Vec<u8>,
    /// Attempts at each grasp type at most; the first that holds is kept.
    #[arg(long, default_value_t = 1500, value_parser = clap::value_parser!(u32).range(1..))]
    pub tries: u32,
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
    /// The hand: URDF with collision boxes, spheres, cylinders or OBJ/STL meshes.
    #[arg(long)]
    pub urdf: PathBuf,
    /// What pulls on its joints (TOML; hand-model/data/hands has two to start from).
    #[arg(long)]
    pub transmission: PathBuf,
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

/// `arm` commands.
#[derive(Debug, Subcommand)]
pub enum ArmCommand {
    /// Check the arm: limits, gravity compensation, inverse kinematics, reach, and what it does where it cannot follow.
    Check {
        /// Folder for pictures and check.json.
        #[arg(long)]
        out: Option<PathBuf>,
    },
}
