//! Faults of emulated devices, as written on the command line and in requests.

use std::str::FromStr;

use anyhow::{Result, anyhow, bail};
use fault_injection::plant::{FAULT_SYNTAX, PlantFault};
use hand_model::Hand;
use hardware_bridge::emulator::Plug;
use hardware_bridge::emulator::faults::{FaultEvent, Faults};
use kinova_kortex::emulator::Injection;
use kinova_kortex::safety_bank::FOLLOWING_ERROR;

/// A fault of an emulated device, of its cable, or of the simulated robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EmulatorFault {
    Unplugged(Plug),
    Arm(Injection),
    /// A fault of a servo or a camera.
    Device(FaultEvent),
    /// A fault of the simulated robot behind the devices.
    Plant(PlantFault),
}

/// Parses a line without a time, for a robot with this hand.
pub fn parse_immediate(line: &str, hand: &Hand) -> Result<Vec<EmulatorFault>> {
    let (mut now, faults) = parse_faults(&[format!("{line}@0")], hand)?;
    now.extend(faults.events.into_iter().map(|(at, event)| (at, EmulatorFault::Device(event))));
    Ok(now.into_iter().map(|(_, mishap)| mishap).collect())
}

/// Parses faults of a robot with `hand`. Returns the faults that the caller applies, each with its time, s, and those
/// that the emulated servos and cameras apply by themselves.
pub fn parse_faults(texts: &[String], hand: &Hand) -> Result<(Vec<(f64, EmulatorFault)>, Faults)> {
    let (mut mishaps, mut rest) = (Vec::new(), Vec::new());
    for text in texts {
        let (what, at) = text.split_once('@').map_or((text.as_str(), None), |(what, at)| (what, Some(at)));
        if let Some(fault) = PlantFault::parse(what, hand)? {
            let at = at.and_then(|at| at.parse().ok()).filter(|at: &f64| at.is_finite() && *at >= 0.0);
            let at = at.ok_or_else(|| anyhow!("fault: found `{text}`, expected {what}@SECONDS"))?;
            mishaps.push((at, EmulatorFault::Plant(fault)));
            continue;
        }
        let Some((name @ ("usb" | "arm"), value)) = text.split_once('=') else {
            rest.push(text.as_str());
            continue;
        };
        let parsed = value.split_once('@').and_then(|(what, at)| {
            let at = f64::from_str(at).ok().filter(|at| at.is_finite() && *at >= 0.0)?;
            let mishap = match (name, what) {
                ("usb", "servos") => EmulatorFault::Unplugged(Plug::Servos),
                ("usb", "cameras") => EmulatorFault::Unplugged(Plug::Cameras),
                ("arm", "stop") => EmulatorFault::Arm(Injection::EmergencyStop(true)),
                ("arm", "free") => EmulatorFault::Arm(Injection::EmergencyStop(false)),
                ("arm", "fault") => EmulatorFault::Arm(Injection::JointFault { joint: 2, bits: FOLLOWING_ERROR }),
                ("arm", "deaf") => EmulatorFault::Arm(Injection::Deaf(true)),
                ("arm", "lossy") => EmulatorFault::Arm(Injection::LoseReplies(0.3)),
                _ => return None,
            };
            Some((at, mishap))
        });
        match parsed {
            Some(mishap) => mishaps.push(mishap),
            None => {
                bail!(
                    "fault: found `{text}`, expected usb=servos|cameras@SECONDS or arm=stop|free|fault|deaf|lossy@SECONDS"
                )
            }
        }
    }
    let faults = Faults::parse(rest).map_err(|error| {
        anyhow!("{error}; usb=servos|cameras@SECONDS, arm=stop|free|fault|deaf|lossy@SECONDS; or, each with @SECONDS, {FAULT_SYNTAX}")
    })?;
    Ok((mishaps, faults))
}
