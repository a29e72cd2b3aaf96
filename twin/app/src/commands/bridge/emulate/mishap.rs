//! What goes wrong with emulated devices, as the command line and whoever tells them say it.

use std::str::FromStr;

use anyhow::{Result, bail};
use hardware_bridge::emulator::Plug;
use hardware_bridge::emulator::faults::{Event, Faults};
use kortex::emulator::Injection;
use kortex::safety_bank::FOLLOWING_ERROR;

/// What goes wrong outside the servos and the camera board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mishap {
    Unplugged(Plug),
    Arm(Injection),
    /// Something that happens to a servo or a camera.
    Device(Event),
}

/// A fault's text that belongs to servos or cameras.
type Texts<'a> = Vec<&'a str>;

/// What a line without a time says.
pub fn at_once(line: &str) -> Result<Vec<Mishap>> {
    let text = [format!("{line}@0")];
    let (mut now, rest) = mishaps(&text)?;
    now.extend(Faults::parse(rest)?.events.into_iter().map(|(at, event)| (at, Mishap::Device(event))));
    Ok(now.into_iter().map(|(_, mishap)| mishap).collect())
}

/// Takes out what is not the servos' or the cameras'.
pub fn mishaps(texts: &[String]) -> Result<(Vec<(f64, Mishap)>, Texts<'_>)> {
    let (mut mishaps, mut rest) = (Vec::new(), Vec::new());
    for text in texts {
        let Some((name @ ("usb" | "arm"), value)) = text.split_once('=') else {
            rest.push(text.as_str());
            continue;
        };
        let parsed = value.split_once('@').and_then(|(what, at)| {
            let at = f64::from_str(at).ok().filter(|at| at.is_finite() && *at >= 0.0)?;
            let mishap = match (name, what) {
                ("usb", "servos") => Mishap::Unplugged(Plug::Servos),
                ("usb", "cameras") => Mishap::Unplugged(Plug::Cameras),
                ("arm", "stop") => Mishap::Arm(Injection::EmergencyStop(true)),
                ("arm", "free") => Mishap::Arm(Injection::EmergencyStop(false)),
                ("arm", "fault") => Mishap::Arm(Injection::JointFault { joint: 2, bits: FOLLOWING_ERROR }),
                ("arm", "deaf") => Mishap::Arm(Injection::Deaf(true)),
                ("arm", "lossy") => Mishap::Arm(Injection::LoseReplies(0.3)),
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
    Ok((mishaps, rest))
}
