//! Arguments of `bench` and `trial`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use scenarios::record::Condition;

use crate::bench::Record;
use crate::tactile_backend::TactileBackend;

/// Which body runs the trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Body {
    /// The simulated robot.
    Sim,
    /// The real robot, under --config; the operator is asked for the verdict.
    Hardware,
    /// The hardware bridge on emulated devices whose plant is the simulated robot, in lock-step.
    Emulated,
    /// The simulated robot behind all that `emulated` does to commands, measurements and images, but without wires: to tell what is the devices' doing.
    Rounded,
}

impl Body {
    /// As results and recordings write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Hardware => "hardware",
            Self::Emulated => "emulated",
            Self::Rounded => "rounded",
        }
    }
}

/// Arguments of `bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Object combinations.
    #[arg(long, default_value_t = 60)]
    pub combos: usize,
    /// Trials of each combination.
    #[arg(long, default_value_t = 10)]
    pub trials: usize,
    /// Body.
    #[arg(long, value_enum, default_value_t = Body::Sim)]
    pub robot: Body,
    /// Configuration of the hardware bridge, for --robot hardware.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Scenario file; default: the built-in benchmark.
    #[arg(long)]
    pub scenario: Option<PathBuf>,
    /// Threads; default: all cores.
    #[arg(long)]
    pub jobs: Option<usize>,
    /// Run only shard i of n, as `i/n`.
    #[arg(long, default_value = "1/1")]
    pub shard: String,
    /// Result folder; default: the next free recordings/bench-N.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Which trials are recorded.
    #[arg(long, value_enum, default_value_t = Record::Sample)]
    pub record: Record,
    /// Factor of all of the scenario's noise, for a curve of rates over noise.
    #[arg(long, default_value_t = 1.0)]
    pub noise_scale: f64,
    /// Also run touch with less of the senses, all kinds or those named: servos_only, palm_only, fingertips, quarter_of_pads,
    /// coarse_images, points_only, true_pose.
    #[arg(long, num_args = 0.., value_delimiter = ',', value_name = "NAMES")]
    pub ablations: Option<Vec<String>>,
    /// Stream every trial to a Rerun viewer as well (one thread).
    #[arg(long)]
    pub live: bool,
    /// Where tactile images are rendered.
    #[arg(long, value_enum, default_value_t = TactileBackend::Cpu)]
    pub tactile: TactileBackend,
    /// Go on with the interrupted run in this folder.
    #[arg(long, conflicts_with_all = ["out", "shard", "scenario"])]
    pub resume: Option<PathBuf>,
}

/// Arguments of `trial`.
#[derive(Debug, Args)]
pub struct TrialArgs {
    /// Number of the combination, from 0.
    pub combination: usize,
    /// Number of the trial, from 0.
    #[arg(long, default_value_t = 0)]
    pub trial: usize,
    /// Policy; `ideal` runs without noise.
    #[arg(long, value_enum, default_value_t = Policy::Touch)]
    pub policy: Policy,
    /// Body.
    #[arg(long, value_enum, default_value_t = Body::Sim)]
    pub robot: Body,
    /// Configuration of the hardware bridge, for --robot hardware.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Folder for the session's MCAP file, for `ftac replay`; hardware always records, into recordings/sessions by default.
    #[arg(long)]
    pub session: Option<PathBuf>,
    /// Stream to a Rerun viewer.
    #[arg(long)]
    pub live: bool,
    /// Where tactile images are rendered.
    #[arg(long, value_enum, default_value_t = TactileBackend::Cpu)]
    pub tactile: TactileBackend,
    /// Recording file; default: recordings/combination_N_trial_K_POLICY.rrd.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// What decides the second grasp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Policy {
    /// Without noise, as planned.
    Ideal,
    /// As planned.
    Blind,
    /// Adapts to what is felt.
    Touch,
}

impl Policy {
    /// The condition it stands for.
    pub fn condition(self) -> Condition {
        match self {
            Self::Ideal => Condition::Ideal,
            Self::Blind => Condition::Blind,
            Self::Touch => Condition::Touch,
        }
    }
}
