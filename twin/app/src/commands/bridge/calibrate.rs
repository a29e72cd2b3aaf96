//! `ftac bridge calibrate`: the open marks and travels of all six servos.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::Args;
use dynamixel_bus::servo_bus::ServoBus;
use dynamixel_bus::x_series::hardware_error;
use dynamixel_bus::xc330;
use hand_model::Hand;
use hardware_bridge::calibration::{HandCalibration, PartialCalibration, ServoCalibration};
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::homing::{HomingSettings, find_stops, write_offsets};
use hardware_bridge::reboot::error_status;
use progress::interrupt::Interrupt;
use robot_backends::operator::operator_agrees;
use robot_backends::wire_emulation::shaft_travel;
use schemars::JsonSchema;
use serde::Serialize;

use super::shared::{ConfigArg, actuator_names, display_path};
use crate::options::robot::{RobotArgs, instance_model};
use crate::terminal::Terminal;

/// Relative deviation of a travel from the nominal one above which the operator is asked.
const TRAVEL_TOLERANCE: f64 = 0.2;

/// Arguments of `bridge calibrate`.
#[derive(Debug, Args)]
pub struct CalibrateArgs {
    #[command(flatten)]
    robot: RobotArgs,
    #[command(flatten)]
    config: ConfigArg,
    /// Continue a failed calibration with the servo that failed; the servos calibrated before it must not have been
    /// remounted since.
    #[arg(long = "continue")]
    go_on: bool,
    /// Robot instance (a file of `ftac sysid identify`) whose spools give the expected travels, instead of the nominal
    /// model's.
    #[arg(long)]
    instance: Option<PathBuf>,
    /// Do not ask before moving.
    #[arg(long)]
    yes: bool,
}

/// JSON output of `bridge calibrate`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct CalibrateOutput {
    /// The calibration file.
    calibration: String,
    /// Checksum of the calibration.
    crc: String,
}

pub fn run(terminal: &Terminal, args: &CalibrateArgs) -> Result<Option<String>> {
    let config = args.config.read_without_password()?;
    let hand = instance_model(args.instance.as_deref(), &args.robot.model()?)?.hand;
    let unfinished = PartialCalibration::beside(&config.calibration);
    let mut servos = match args.go_on {
        true => unfinished.read(&config.servos.ids).context("--continue")?,
        false => Vec::new(),
    };
    let folder = config.calibration.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(std::path::Path::new("."));
    // Nothing needs to move if the result cannot be written.
    tempfile::NamedTempFile::new_in(folder)
        .with_context(|| format!("{}: cannot be written to", display_path(folder)))?;
    let mut bus = ServoBus::open(&config.servos.port, config.bus())?;
    check_servos(&mut bus, &config, &hand).context("before any motion")?;
    for servo in &servos {
        let found = bus.ping(servo.id)?;
        if (found.model, found.firmware) != (servo.model, servo.firmware) {
            bail!("servo {}: not the one found before: calibrate without --continue", servo.id);
        }
    }
    if !args.yes
        && !operator_agrees("Every digit will open, close and open again. Is the hand empty and clear of fingers?")?
    {
        bail!("not calibrated: the operator did not confirm");
    }
    let felt = home_all(terminal, &config, &hand, &mut bus, &unfinished, &mut servos);
    if let Err(error) = felt {
        let kept = match servos.len() {
            0 => String::new(),
            n => format!(
                "; the first {n} are kept in {}, and --continue resumes after them",
                display_path(unfinished.path())
            ),
        };
        return Err(error.context(format!("nothing was calibrated; the last calibration is kept{kept}")));
    }
    let doubts = suspicious_travels(&hand, &servos);
    doubts.iter().for_each(|doubt| eprintln!("warning: {doubt}"));
    if !doubts.is_empty() && !args.yes && !operator_agrees("Does every servo drive the actuator of its id?")? {
        bail!("nothing was calibrated; the last calibration is kept: the operator did not confirm");
    }
    // The servos are written first: a file that does not match them is refused at the next connection, and a new
    // calibration repairs it.
    write_offsets(&mut bus, &servos)?;
    let servos = servos.try_into().map_err(|_| anyhow::anyhow!("found another number of servos than actuators"))?;
    let calibration = HandCalibration::new(&hand.parameters.name, servos);
    calibration.write(&config.calibration)?;
    unfinished.remove();
    let made = CalibrateOutput { calibration: display_path(&config.calibration), crc: calibration.hash() };
    terminal.print(&made, &format!("written to {}, crc {}\n", made.calibration, made.crc))?;
    Ok(None)
}

/// Lists travels that are far from that of `hand`, each with the actuator that it would fit.
fn suspicious_travels(hand: &Hand, servos: &[ServoCalibration]) -> Vec<String> {
    let design = shaft_travel(hand);
    let names = actuator_names(hand);
    let off = |found: f64, actuator: usize| (found / design[actuator] - 1.0).abs();
    let doubt = |(n, servo): (usize, &ServoCalibration)| {
        let nearest = (0..design.len()).min_by(|a, b| off(servo.travel, *a).total_cmp(&off(servo.travel, *b)))?;
        (off(servo.travel, n) > TRAVEL_TOLERANCE).then(|| {
            let whose = if off(servo.travel, nearest) < TRAVEL_TOLERANCE { format!(", as {} has", names[nearest]) } else { String::new() };
            format!(
                "{} (id {}): found a travel of {:.2} rad{whose}, expected about {:.2}: were ids exchanged, or is its cable off?",
                names[n], servo.id, servo.travel, design[n]
            )
        })
    };
    servos.iter().enumerate().filter_map(doubt).collect()
}

/// Checks that all servos are present, of the right model and free of hardware errors.
fn check_servos(bus: &mut ServoBus, config: &BridgeConfig, hand: &Hand) -> Result<()> {
    for (id, name) in config.servos.ids.iter().zip(actuator_names(hand)) {
        let found = bus.ping(*id).with_context(|| name.clone())?.model;
        if found != xc330::MODEL.number {
            bail!("{name}: servo {id}: found model {found}, expected {}", xc330::MODEL.number);
        }
        let error = error_status(bus, *id).with_context(|| name.clone())?;
        if error != 0 {
            bail!(
                "{name}: servo {id}: found hardware error {}, expected none: see `ftac bridge reboot`",
                hardware_error::describe(error)
            );
        }
    }
    Ok(())
}

/// Homes all servos that `servos` lacks against their stops.
fn home_all(
    terminal: &Terminal,
    config: &BridgeConfig,
    hand: &Hand,
    bus: &mut ServoBus,
    unfinished: &PartialCalibration,
    servos: &mut Vec<ServoCalibration>,
) -> Result<()> {
    let interrupt = Interrupt::catch()?;
    let settings = HomingSettings::default();
    for (id, name) in config.servos.ids.iter().zip(actuator_names(hand)).skip(servos.len()) {
        let servo = find_stops(bus, *id, &settings, &|| interrupt.happened()).with_context(|| name.clone())?;
        // The line also shows that this digit has stopped moving.
        if !terminal.quiet {
            eprintln!(
                "{name:12} id {id:3}: open mark at {} counts, travel {:.2} rad",
                -servo.homing_offset, servo.travel
            );
        }
        servos.push(servo);
        unfinished.write(servos)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exchanged_ids_show_in_the_travels() {
        let calibrated = |travels: [f64; 6]| -> Vec<ServoCalibration> {
            let servo = |(n, travel)| ServoCalibration {
                id: n as u8 + 1,
                model: xc330::MODEL.number,
                firmware: 46,
                homing_offset: 0,
                travel,
            };
            travels.into_iter().enumerate().map(servo).collect()
        };
        // The travels that homing finds on the emulated hand.
        assert_eq!(
            suspicious_travels(&Hand::ftac(), &calibrated([3.40, 4.45, 4.45, 4.45, 4.45, 1.61])),
            Vec::<String>::new()
        );
        let doubts = suspicious_travels(&Hand::ftac(), &calibrated([1.61, 4.45, 4.45, 4.45, 4.45, 3.40]));
        assert_eq!(doubts.len(), 2);
        assert!(doubts[0].starts_with("thumb (id 1): found a travel of 1.61 rad, as opposition has"), "{doubts:?}");
    }
}
