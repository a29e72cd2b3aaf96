//! `ftac optics pads`: writes the calibration files of the hand's pads, nominal or of one manufactured unit.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;
use ftac_platform::data::write_atomically;
use schemars::JsonSchema;
use serde::Serialize;
use tactile_optics::pads::PadOptics;

use crate::options::robot::{RobotArgs, instance_model};
use crate::terminal::Outcome;
use crate::terminal::Terminal;

/// Arguments of `optics pads`.
#[derive(Debug, Args)]
pub struct PadsArgs {
    /// Folder for the files, one per pad.
    #[arg(long)]
    pub out: PathBuf,
    /// Serial number of a hand whose pads are written instead of the nominal ones.
    #[arg(long)]
    pub unit: Option<u64>,
    /// Robot instance (a file of `ftac sysid identify`) that gives the stiffness and thickness of the gel; these keep
    /// the nominal values unless a session identifies them.
    #[arg(long)]
    pub instance: Option<PathBuf>,
    #[command(flatten)]
    pub robot: RobotArgs,
}

/// JSON output of `optics pads`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct PadsOutput {
    /// Files written.
    files: Vec<PathBuf>,
}

/// Runs `ftac optics pads`.
pub fn pads(terminal: &Terminal, args: &PadsArgs) -> Outcome {
    if args.out.is_file() {
        bail!("--out {}: found a file; expected a folder", args.out.display());
    }
    let hand = instance_model(args.instance.as_deref(), &args.robot.model()?)?.hand;
    let mut files = Vec::new();
    for pad in &hand.pads {
        let design = PadOptics::nominal(&hand, pad);
        let calibration = match args.unit {
            Some(unit) => design.unit(unit.wrapping_mul(1000).wrapping_add(pad.cameras[0] as u64)),
            None => design,
        };
        files.push((args.out.join(format!("{}.toml", pad.name)), calibration.to_toml()?));
    }
    std::fs::create_dir_all(&args.out).with_context(|| format!("--out {}", args.out.display()))?;
    for (path, text) in &files {
        if path.exists() && std::fs::read(path).with_context(|| path.display().to_string())? != text.as_bytes() {
            bail!(
                "--out {}: found {} with another content, expected none; name another folder or remove it",
                args.out.display(),
                path.display()
            );
        }
    }
    for (path, text) in &files {
        write_atomically(path, text.as_bytes())?;
    }
    if !terminal.json && !terminal.quiet {
        eprintln!("{} files in {}", files.len(), args.out.display());
    }
    terminal.print(&PadsOutput { files: files.into_iter().map(|(path, _)| path).collect() }, "")?;
    Ok(None)
}
