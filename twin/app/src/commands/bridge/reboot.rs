//! `ftac bridge reboot`: restarts servos that have shut down.

use anyhow::{Result, bail};
use clap::Args;
use dynamixel_bus::servo_bus::ServoBus;
use dynamixel_bus::x_series::hardware_error;
use hardware_bridge::calibration::HandCalibration;
use hardware_bridge::reboot::{check, error_status, reboot};
use hardware_bridge::setup::SetupFinding;
use robot_backends::operator::operator_agrees;
use schemars::JsonSchema;
use serde::Serialize;

use super::shared::{ConfigArg, FindingRow, actuator_names, expect_no_robot, finding_rows, format_findings, shortfall};
use crate::options::robot::RobotArgs;
use crate::terminal::Terminal;

/// Arguments of `bridge reboot`.
#[derive(Debug, Args)]
pub struct RebootArgs {
    #[command(flatten)]
    robot: RobotArgs,
    #[command(flatten)]
    config: ConfigArg,
    /// Actuator whose servo is restarted: thumb, index, middle, ring, little or opposition (repeatable). Default: every
    /// servo that reports an error.
    #[arg(long)]
    actuator: Vec<String>,
    /// Do not ask before restarting: the hand drops what it holds.
    #[arg(long)]
    yes: bool,
}

/// A servo that was restarted.
#[derive(Debug, Serialize, JsonSchema)]
struct RestartedServo {
    actuator: String,
    id: u8,
    /// Its hardware error status before the restart, in words.
    reported: String,
}

/// JSON output of `bridge reboot`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct RebootOutput {
    /// The servos that were restarted.
    restarted: Vec<RestartedServo>,
    /// One entry per row of the table.
    rows: Vec<FindingRow>,
}

/// A servo that is to be restarted.
struct RestartTarget {
    n: usize,
    id: u8,
    name: String,
    /// Its hardware error status (bits of the register).
    error: u8,
}

pub fn run(terminal: &Terminal, args: &RebootArgs) -> Result<Option<String>> {
    let config = args.config.read_without_password()?;
    let names = actuator_names(&args.robot.model()?.hand);
    if let Some(unknown) = args.actuator.iter().find(|wanted| !names.contains(wanted)) {
        bail!("--actuator: found `{unknown}`, expected one of {}", names.join(", "));
    }
    expect_no_robot(&args.config.config)?;
    // Servos can be restarted without a calibration; then fewer settings are compared afterwards.
    let calibration = match config.calibration.exists() {
        true => Some(HandCalibration::read(&config.calibration)?),
        false => None,
    };
    let mut bus = ServoBus::open(&config.servos.port, config.bus())?;
    let (mut patients, mut silent) = (Vec::new(), Vec::new());
    for (n, (id, name)) in config.servos.ids.into_iter().zip(names).enumerate() {
        let wanted = args.actuator.contains(&name);
        match error_status(&mut bus, id) {
            Ok(error) if wanted || args.actuator.is_empty() && error != 0 => {
                patients.push(RestartTarget { n, id, name, error });
            }
            Ok(_) => {}
            Err(error) if wanted || args.actuator.is_empty() => {
                silent.push(SetupFinding::new(format!("{name} ({id})"), error, "an answer", false));
            }
            Err(_) => {}
        }
    }
    for patient in &patients {
        eprintln!("{} (id {}) reports: {}", patient.name, patient.id, hardware_error::describe(patient.error));
    }
    let question = "A restart switches a servo's torque off: its springs open that digit, which drops its object. The torque stays off. Is everything supported, or the hand empty?";
    if !patients.is_empty() && !args.yes && !operator_agrees(question)? {
        bail!("nothing was restarted: the operator did not confirm");
    }
    let mut findings = silent;
    for RestartTarget { n, id, name, .. } in &patients {
        let known = calibration.as_ref().map(|calibration| &calibration.servos[*n]);
        let back = reboot(&mut bus, *id).and_then(|()| check(&mut bus, &config, (*id, name.as_str()), known));
        match back {
            Ok(found) => findings.extend(found),
            // The other servos are still restarted.
            Err(error) => findings.push(SetupFinding::new(format!("{name} ({id})"), error, "an answer", false)),
        }
    }
    let text = match patients.is_empty() && findings.is_empty() {
        true => "no servo reports an error; nothing was restarted\n".to_owned(),
        false => format_findings(terminal, &findings),
    };
    let restarted = |RestartTarget { id, name, error, .. }| RestartedServo {
        actuator: name,
        id,
        reported: hardware_error::describe(error).to_string(),
    };
    let restarted = patients.into_iter().map(restarted).collect();
    terminal.print(&RebootOutput { restarted, rows: finding_rows(&findings) }, &text)?;
    Ok(shortfall(&findings))
}
