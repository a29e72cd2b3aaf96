//! What each command does. `Ok(Some(text))` means: ran, but the result falls short as the text says.

mod benchmark;
mod body_check;
mod lab_book;
mod one_trial;
mod rehearse;

use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, bail};
use hand_model::Hand;

use crate::builtin::CALIBRATION_UNIT;
use crate::cli::{ArmCommand, Cli, Command, GraspsCommand, HandCommand, OpticsCommand, TouchCommand};
use crate::{calibrate, check, hand_close, optics_commands, study, synthesis, touch_commands};

/// What a command came to: nothing to say, or in which respect its result falls short.
pub type Outcome = Result<Option<String>>;

/// Runs a command.
pub fn run(cli: &Cli) -> Outcome {
    match &cli.command {
        Command::Bench(args) => benchmark::benchmark(cli, args),
        Command::Trial(args) => one_trial::trial(cli, args),
        Command::Replay { recording, against: None } => crate::replay::command(cli, recording),
        Command::Replay { recording, against: Some(other) } => crate::replay::against(cli, recording, other),
        Command::Transport(args) => crate::transport::run(cli, args),
        Command::View { path } => view(path),
        Command::Report { folders, study: true, .. } => match folders.as_slice() {
            [] => study::report::run(cli, Path::new("recordings/study")),
            [folder] => study::report::run(cli, folder),
            _ => bail!("--study: found {} folders, expected one", folders.len()),
        },
        Command::Report { lab_book: Some(figures), out, .. } => lab_book::run(cli, figures, out.as_deref()),
        Command::Report { folders, out, .. } => benchmark::report(cli, folders, out.as_deref()),
        Command::Hand(HandCommand::Check(args)) => body_check::hand_check(cli, args),
        Command::Hand(HandCommand::Close(args)) => hand_close::run(cli, args),
        Command::Arm(ArmCommand::Check { out }) => body_check::arm_check(cli, out.as_deref()),
        Command::Hand(HandCommand::Export { mjcf }) => {
            check::second_engine::export(&Arc::new(Hand::ftac()), mjcf)?;
            eprintln!(
                "{0}: scenes.json and its MJCF files; `python3 tests/mujoco/compare.py {0}` runs them",
                mjcf.display()
            );
            Ok(None)
        }
        Command::Grasps(GraspsCommand::Generate(args)) => synthesis::generate(cli, args),
        Command::Grasps(GraspsCommand::Eval { synthesis, n }) => synthesis::eval(cli, synthesis, *n),
        Command::Grasps(GraspsCommand::Repertoire(args)) => synthesis::repertoire::make(cli, args),
        Command::Grasps(GraspsCommand::Show(args)) => synthesis::show::show(cli, args),
        Command::Grasps(GraspsCommand::Hands(args)) => synthesis::hands::run(cli, args),
        Command::Grasps(GraspsCommand::Classify(args)) => study::classify::run(cli, args),
        Command::Grasps(GraspsCommand::Annotate(args)) => study::annotate::run(cli, args),
        Command::Grasps(GraspsCommand::Map(args)) => study::map::run(cli, args),
        Command::Grasps(GraspsCommand::Landscape(args)) => study::landscape::run(cli, args),
        Command::Grasps(GraspsCommand::Rehearse { object, role, n, out }) => {
            rehearse::grasps_rehearse(cli, object, *role, *n, out)
        }
        Command::Grasps(GraspsCommand::Plan { combos, repertoire, out }) => {
            rehearse::grasps_plan(cli, *combos, repertoire.as_deref(), out)
        }
        Command::Touch(TouchCommand::Train { presses, out }) => touch_train(cli, *presses, out),
        Command::Touch(TouchCommand::TrainNetwork(args)) => touch_commands::train_network(cli, args),
        Command::Touch(TouchCommand::Eval(args)) => touch_commands::eval(cli, args),
        Command::Optics(OpticsCommand::Calibrate(args)) => optics_commands::calibrate(cli, args),
        Command::Optics(OpticsCommand::Eval(args)) => optics_commands::eval(cli, args),
        Command::Optics(OpticsCommand::Render(args)) => optics_commands::render(cli, args),
        Command::Optics(OpticsCommand::Shapes(args)) => optics_commands::shapes(cli, args),
        Command::Optics(OpticsCommand::Pads(args)) => optics_commands::pads(cli, args),
        Command::Bridge(command) => crate::bridge::run(cli, command),
    }
}

fn view(path: &Path) -> Outcome {
    // A benchmark's recordings lie in a folder of their own within its results.
    let inside = path.join("recordings");
    let opened = stream::viewer::open(if inside.is_dir() { &inside } else { path })?;
    eprintln!("opened {} recording(s)", opened.len());
    Ok(None)
}

fn touch_train(cli: &Cli, presses: usize, out: &Path) -> Outcome {
    let hand = Hand::ftac();
    let (calibration, error) = calibrate::train(&hand, CALIBRATION_UNIT, presses, cli.seed)?;
    calibration.write(out)?;
    if cli.json {
        println!(
            "{}",
            serde_json::json!({"mean_deg": error.mean, "median_deg": error.median, "p95_deg": error.p95, "pixels": error.pixels})
        );
    } else {
        println!(
            "angular error on another unit's presses: mean {:.2} deg, median {:.2} deg, p95 {:.2} deg over {} pixels",
            error.mean, error.median, error.p95, error.pixels
        );
    }
    Ok(None)
}
