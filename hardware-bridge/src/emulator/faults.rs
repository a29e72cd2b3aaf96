//! Faults of the emulated hand and their command-line syntax.
//!
//! Chances are per answer (or per image) and drawn from a seeded generator; events happen at a time after the start:
//! `noise=0.1`, `drop=0.02`, `corrupt=0.01`, `delay=0.05`, `jpeg=0.05`; `overload=3@5` (servo 3 after 5 s),
//! `overheat=2@4`, `voltage=5.2@3` (the supply, V), `unplug=4@6`, `plug=4@8`, `freeze=7@2` (camera 7), `model=3@0`
//! (servo 3 is of another model), `ids=1@0` (servos 1 and 2 have each other's id), `swap=7@0` (cameras 7 and 8 are
//! exchanged).

use std::str::FromStr;

/// Delay of a delayed answer, s.
pub const ANSWER_DELAY: f64 = 0.030;

/// Probabilities of random faults.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FaultProbabilities {
    /// Probability of one to three stray bytes before an answer.
    pub noise: f64,
    /// Probability that an answer is lost.
    pub drop: f64,
    /// Probability that a byte of an answer is changed.
    pub corrupt: f64,
    /// Probability that an answer comes [`ANSWER_DELAY`] late.
    pub delay: f64,
    /// Probability that an image's JPEG is cut in half before it is framed, as by a camera that overruns its buffer.
    pub jpeg: f64,
}

/// A fault that happens once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultEvent {
    /// The servo with this id reports overload and shuts down.
    Overload(u8),
    /// The servo with this id is heated beyond its limit.
    Overheat(u8),
    /// The supply of all servos becomes this, V.
    Voltage(f64),
    /// The servo with this id loses its plug.
    Unplug(u8),
    /// The servo with this id is plugged in again.
    Plug(u8),
    /// This camera repeats the same image forever.
    FreezeCamera(u8),
    /// The servo with this id is of another model.
    WrongModel(u8),
    /// The servo with this id and the one with the next id have exchanged their ids.
    SwapIds(u8),
    /// This camera and the next are exchanged.
    SwapCameras(u8),
}

impl FaultEvent {
    /// True if the event concerns the camera board rather than the servos.
    pub fn concerns_cameras(self) -> bool {
        matches!(self, Self::FreezeCamera(_) | Self::SwapCameras(_))
    }
}

/// All injected faults.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Faults {
    /// Random faults.
    pub probabilities: FaultProbabilities,
    /// Timed faults: time since the start, s, and event.
    pub events: Vec<(f64, FaultEvent)>,
}

/// Syntax error in a fault on the command line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "fault: found `{0}`, expected noise|drop|corrupt|delay|jpeg=CHANCE, overload|overheat|unplug|plug|freeze|model|ids|swap=ID@SECONDS or voltage=VOLTS@SECONDS"
)]
pub struct FaultSyntax(String);

impl Faults {
    /// Parses a list of faults.
    pub fn parse<'a>(texts: impl IntoIterator<Item = &'a str>) -> Result<Self, FaultSyntax> {
        let mut faults = Self::default();
        for text in texts {
            faults.add(text).ok_or_else(|| FaultSyntax(text.to_owned()))?;
        }
        Ok(faults)
    }

    fn add(&mut self, text: &str) -> Option<()> {
        let (name, value) = text.split_once('=')?;
        let chances = &mut self.probabilities;
        let chance = match name {
            "noise" => &mut chances.noise,
            "drop" => &mut chances.drop,
            "corrupt" => &mut chances.corrupt,
            "delay" => &mut chances.delay,
            "jpeg" => &mut chances.jpeg,
            _ => return self.add_event(name, value),
        };
        *chance = f64::from_str(value).ok().filter(|chance| (0.0..=1.0).contains(chance))?;
        Some(())
    }

    fn add_event(&mut self, name: &str, value: &str) -> Option<()> {
        let (what, at) = value.split_once('@')?;
        let at = f64::from_str(at).ok().filter(|at| at.is_finite() && *at >= 0.0)?;
        let event = match name {
            "voltage" => FaultEvent::Voltage(what.parse().ok().filter(|volts| (0.0..20.0).contains(volts))?),
            "overload" => FaultEvent::Overload(what.parse().ok()?),
            "overheat" => FaultEvent::Overheat(what.parse().ok()?),
            "unplug" => FaultEvent::Unplug(what.parse().ok()?),
            "plug" => FaultEvent::Plug(what.parse().ok()?),
            "freeze" => FaultEvent::FreezeCamera(what.parse().ok()?),
            "model" => FaultEvent::WrongModel(what.parse().ok()?),
            "ids" => FaultEvent::SwapIds(what.parse().ok()?),
            "swap" => FaultEvent::SwapCameras(what.parse().ok()?),
            _ => return None,
        };
        self.events.push((at, event));
        Some(())
    }

    /// Removes and returns the events due at `now` (s).
    pub fn take_due(&mut self, now: f64) -> Vec<FaultEvent> {
        let (due, later) = self.events.iter().partition(|(at, _)| *at <= now);
        self.events = later;
        let due: Vec<(f64, FaultEvent)> = due;
        due.into_iter().map(|(_, event)| event).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn syntax() {
        let mut faults = Faults::parse(["noise=0.1", "overload=3@5", "voltage=5.2@0.5"]).expect("good");
        assert_eq!(faults.probabilities, FaultProbabilities { noise: 0.1, ..FaultProbabilities::default() });
        assert_eq!(faults.take_due(1.0), [FaultEvent::Voltage(5.2)]);
        assert_eq!(faults.take_due(1.0), []);
        assert_eq!(faults.take_due(5.0), [FaultEvent::Overload(3)]);
        for bad in ["noise", "noise=2", "overload=3", "overload=x@1", "melt=1@1", "voltage=5@-1"] {
            assert!(Faults::parse([bad]).expect_err("bad").to_string().contains(bad));
        }
    }
}
