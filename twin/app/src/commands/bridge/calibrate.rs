//! `ftac bridge calibrate`: the open marks and travels of all six servos.

use anyhow::{Context, Result, bail};
use bench::body::operator::{Interrupt, agreed};
use clap::Args;
use hand_model::Hand;
use hardware_bridge::calibration::{HandCalibration, ServoCalibration, Unfinished};
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::homing::{HomingSettings, feel, store};
use hardware_bridge::servo_bus::ServoBus;
use hardware_bridge::xc330;

use super::shared::{ConfigArg, actuator_names, shown};
use crate::terminal::Terminal;

/// Arguments of `bridge calibrate`.
#[derive(Debug, Args)]
pub struct CalibrateArgs {
    #[command(flatten)]
    config: ConfigArg,
    /// Go on after a calibration that failed, with the servo that failed; those found before it must not have been remounted since.
    #[arg(long = "continue")]
    go_on: bool,
    /// Do not ask before moving.
    #[arg(long)]
    yes: bool,
}

pub fn run(terminal: &Terminal, args: &CalibrateArgs) -> Result<Option<String>> {
    let config = args.config.read()?;
    let unfinished = Unfinished::beside(&config.calibration);
    let mut servos = match args.go_on {
        true => unfinished.read(&config.servos.ids).context("--continue")?,
        false => Vec::new(),
    };
    let folder = config.calibration.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(std::path::Path::new("."));
    // Where the result cannot be written, nothing needs to move.
    tempfile::NamedTempFile::new_in(folder).with_context(|| format!("{}: cannot be written to", shown(folder)))?;
    let mut bus = ServoBus::open(&config.servos.port, config.bus())?;
    identify(&mut bus, &config).context("before any motion")?;
    for servo in &servos {
        let found = bus.ping(servo.id)?;
        if (found.model, found.firmware) != (servo.model, servo.firmware) {
            bail!("servo {}: not the one found before: calibrate without --continue", servo.id);
        }
    }
    if !args.yes && !agreed("Every digit will open, close and open again. Is the hand empty and clear of fingers?")? {
        bail!("not calibrated: the operator did not say yes");
    }
    let felt = feel_all(terminal, &config, &mut bus, &unfinished, &mut servos);
    if let Err(error) = felt {
        let kept = match servos.len() {
            0 => String::new(),
            n => format!("; the first {n} are kept in {}, and --continue goes on after them", shown(unfinished.path())),
        };
        return Err(error.context(format!("nothing was calibrated, and the last calibration stays{kept}")));
    }
    // The servos first: a file without them is refused at the next connection, and calibrating again mends it.
    store(&mut bus, &servos)?;
    let servos = servos.try_into().map_err(|_| anyhow::anyhow!("found another number of servos than actuators"))?;
    let calibration = HandCalibration::new(&Hand::ftac().parameters.name, servos);
    calibration.write(&config.calibration)?;
    unfinished.remove();
    if terminal.json {
        println!("{}", serde_json::json!({"calibration": shown(&config.calibration), "crc": calibration.hash()}));
    } else {
        println!("written to {}, crc {}", shown(&config.calibration), calibration.hash());
    }
    Ok(None)
}

/// Makes sure that all servos are there and of the right model.
fn identify(bus: &mut ServoBus, config: &BridgeConfig) -> Result<()> {
    for (id, name) in config.servos.ids.iter().zip(actuator_names()) {
        let found = bus.ping(*id).with_context(|| name.clone())?.model;
        if found != xc330::MODEL {
            bail!("{name}: servo {id}: found model {found}, expected {}", xc330::MODEL);
        }
    }
    Ok(())
}

/// Feels for the stops of all servos that `servos` lacks.
fn feel_all(
    terminal: &Terminal,
    config: &BridgeConfig,
    bus: &mut ServoBus,
    unfinished: &Unfinished,
    servos: &mut Vec<ServoCalibration>,
) -> Result<()> {
    let interrupt = Interrupt::catch()?;
    let settings = HomingSettings::default();
    for (id, name) in config.servos.ids.iter().zip(actuator_names()).skip(servos.len()) {
        let servo = feel(bus, *id, &settings, &|| interrupt.happened()).with_context(|| name.clone())?;
        // Each digit's line says that it moves no more.
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
