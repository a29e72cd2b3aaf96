//! Effects: imperfections of a real table, hand, arm and camera, from the `[effects]` tables of a scenario file.
//!
//! An effect that is missing from a file is off. With all effects off, pads feel objects only, cables run without
//! friction, detection errors are independent, and decisions take no time. The random part of each effect is drawn from
//! a separate stream ([`Effect::draw_rng`]), so that switching one effect off leaves the draws of the others unchanged.

use hand_model::arm::MAX_ARM_JOINTS;
use plant::draws::{gaussian_vector, truncated_gaussian};
use plant::{ArmDefects, GelViscoelasticity, ObjectInstance};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use crate::generator::trial_rng;

/// The effects, named after their tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Effect {
    /// Pads feel fingers, palm and table, and their idle frames are noisy.
    Pads,
    /// Pad covers are viscoelastic, like gel.
    Gel,
    /// Cables have friction in their guides, and gears have backlash.
    Cables,
    /// The object detector has persistent errors and misses hidden objects.
    #[serde(alias = "eyes")]
    Detector,
    /// The arm has errors of encoders, mount and payload.
    Arm,
    /// Object instances differ from their models.
    Objects,
    /// A floor lies under the table.
    Floor,
    /// Frames and decisions have latency.
    Time,
}

/// Error: no effect has this name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("effect: found `{found}`, expected one of {}", Effect::ALL.map(Effect::name).join(", "))]
pub struct UnknownEffect {
    /// The name that was given.
    pub found: String,
}

impl Effect {
    /// All effects in order.
    pub const ALL: [Self; 8] =
        [Self::Pads, Self::Gel, Self::Cables, Self::Detector, Self::Arm, Self::Objects, Self::Floor, Self::Time];

    /// Name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pads => "pads",
            Self::Gel => "gel",
            Self::Cables => "cables",
            Self::Detector => "detector",
            Self::Arm => "arm",
            Self::Objects => "objects",
            Self::Floor => "floor",
            Self::Time => "time",
        }
    }

    /// Returns the generator of this effect's draws in one trial: a separate stream of the trial's generator.
    pub fn draw_rng(self, seed: u64, combination: usize, trial: usize) -> ChaCha8Rng {
        let mut rng = trial_rng(seed, combination, trial);
        rng.set_stream(1 + self as u64);
        rng
    }
}

impl std::fmt::Display for Effect {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(self.name())
    }
}

impl std::str::FromStr for Effect {
    type Err = UnknownEffect;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        // Scenarios of version 0.1 call the detector's effects `eyes`.
        let text = if text == "eyes" { Self::Detector.name() } else { text };
        let known = Self::ALL.into_iter().find(|effect| effect.name() == text);
        known.ok_or_else(|| UnknownEffect { found: text.to_owned() })
    }
}

/// Sensor effects of pads, beside the objects that press into them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PadEffects {
    /// True if fingers, palm and table press into pads too.
    pub self_contact: bool,
    /// Brightness drift of an untouched pad (lamps and exposure warm up): standard deviation of its relative rate,
    /// 1/min.
    pub drift: f64,
    /// Age of the background frame when a trial begins, s.
    pub background_age: f64,
}

impl PadEffects {
    /// Draws the brightness drift rates of `cameras` cameras in one trial, relative, 1/min.
    pub fn draw_drift_rates(&self, cameras: usize, rng: &mut impl Rng) -> Vec<f64> {
        (0..cameras).map(|_| self.drift * rng.sample::<f64, _>(StandardNormal)).collect()
    }
}

/// Friction and backlash of cables and gears.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CableEffects {
    /// Factor on the friction coefficient between cable and guide in the hand's data file.
    pub friction: f64,
    /// Backlash of the servo's gear, rad at its output.
    pub backlash: f64,
}

/// Errors of the object detector besides its Gaussian ones.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectorErrors {
    /// Share of the error variance in `[noise.perception]` that persists over all detections of a trial and is common
    /// to all objects, such as the error of the camera's pose.
    pub lasting: f64,
    /// Standard deviation of the tilt error about each horizontal axis, rad; new in each detection.
    pub tilt_sigma: f64,
    /// Probability that a detection reports an object in another of its resting poses.
    pub mistaken: f64,
    /// Latency of a detection, s.
    pub latency: f64,
    /// Position of the camera in the world frame, m.
    pub camera: [f64; 3],
}

/// Errors of the arm; they replace `[noise.execution]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmErrors {
    /// Standard deviation of the joint encoders' offsets, rad.
    pub encoder_sigma: f64,
    /// Standard deviation of the hand's position on its flange, each axis, m.
    pub mount_position_sigma: f64,
    /// Standard deviation of the hand's orientation on its flange, about each axis, rad.
    pub mount_rotation_sigma: f64,
    /// Standard deviation of the payload at the palm that gravity compensation omits, kg.
    pub payload_sigma: f64,
}

impl ArmErrors {
    /// Draws the defects of an arm: Gaussians truncated at three standard deviations, and the absolute value for the
    /// payload, which is an added mass. Encoder offsets are drawn for [`MAX_ARM_JOINTS`] joints, so that the remaining
    /// draws are the same for all arms.
    pub fn draw(&self, rng: &mut ChaCha8Rng) -> ArmDefects {
        ArmDefects {
            encoders: (0..MAX_ARM_JOINTS).map(|_| truncated_gaussian(rng) * self.encoder_sigma).collect(),
            mount_position: gaussian_vector(rng, self.mount_position_sigma),
            mount_rotation: gaussian_vector(rng, self.mount_rotation_sigma),
            payload: truncated_gaussian(rng).abs() * self.payload_sigma,
        }
    }
}

/// Variation of object instances about their models: relative standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectVariation {
    /// Relative standard deviation of the mass.
    pub mass_sigma: f64,
    /// Relative standard deviation of the friction coefficient.
    pub friction_sigma: f64,
    /// Relative standard deviation of the size, the same along all axes.
    pub size_sigma: f64,
}

impl ObjectVariation {
    /// Draws an object: Gaussians truncated at three standard deviations.
    pub fn draw(&self, rng: &mut ChaCha8Rng) -> ObjectInstance {
        let Self { mass_sigma, friction_sigma, size_sigma } = *self;
        let [mass, friction, size] =
            [mass_sigma, friction_sigma, size_sigma].map(|sigma| 1.0 + truncated_gaussian(rng) * sigma);
        ObjectInstance { mass, friction, size }
    }
}

/// The floor under the table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FloorEffect {
    /// Height of the floor's surface, m; the top of the table is at 0.
    pub height: f64,
}

/// Latencies of frames and decisions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LatencyEffects {
    /// Latency from a camera's exposure to the arrival of its frame in the controller, s.
    pub frame: f64,
    /// Duration of a decision from measurements, s. The simulated robot waits this long, independent of the computing
    /// time.
    pub decision: f64,
}

/// The effects of a scenario; `None` means off.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Effects {
    /// See [`PadEffects`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pads: Option<PadEffects>,
    /// See [`GelViscoelasticity`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gel: Option<GelViscoelasticity>,
    /// See [`CableEffects`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cables: Option<CableEffects>,
    /// See [`DetectorErrors`].
    #[serde(skip_serializing_if = "Option::is_none")]
    #[serde(alias = "eyes")]
    pub detector: Option<DetectorErrors>,
    /// See [`ArmErrors`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub arm: Option<ArmErrors>,
    /// See [`ObjectVariation`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objects: Option<ObjectVariation>,
    /// See [`FloorEffect`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floor: Option<FloorEffect>,
    /// See [`LatencyEffects`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time: Option<LatencyEffects>,
}

impl Effects {
    /// Returns the effects without `effect`.
    #[must_use]
    pub fn without(mut self, effect: Effect) -> Self {
        match effect {
            Effect::Pads => self.pads = None,
            Effect::Gel => self.gel = None,
            Effect::Cables => self.cables = None,
            Effect::Detector => self.detector = None,
            Effect::Arm => self.arm = None,
            Effect::Objects => self.objects = None,
            Effect::Floor => self.floor = None,
            Effect::Time => self.time = None,
        }
        self
    }

    /// Returns the effects with the standard deviations of arm and detector multiplied by `factor`.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        if let Some(eyes) = &mut self.detector {
            eyes.tilt_sigma *= factor;
        }
        if let Some(arm) = &mut self.arm {
            arm.encoder_sigma *= factor;
            arm.mount_position_sigma *= factor;
            arm.mount_rotation_sigma *= factor;
            arm.payload_sigma *= factor;
        }
        self
    }

    /// Describes the effects that [`Self::scaled`] leaves unchanged.
    pub fn describe_unscaled(&self) -> Vec<String> {
        let mut words = Vec::new();
        if let Some(pads) = &self.pads {
            let own = if pads.self_contact { " and feel fingers, palm and table" } else { "" };
            words.push(format!("pads: cameras drift{own}"));
        }
        if self.gel.is_some() {
            words.push("gel: covers are compliant".to_owned());
        }
        if self.cables.is_some() {
            words.push("cables: friction in the guides and backlash of the gears".to_owned());
        }
        if let Some(eyes) = self.detector.filter(|eyes| eyes.mistaken > 0.0 || eyes.latency > 0.0) {
            let share = 100.0 * eyes.mistaken;
            words.push(format!(
                "detector: {share} % of detections have a wrong resting pose, all have a latency of {} s",
                eyes.latency
            ));
        }
        if self.objects.is_some() {
            words.push("objects: instances differ from their models".to_owned());
        }
        if self.time.is_some() {
            words.push("time: latency of frames and decisions".to_owned());
        }
        words
    }

    /// Checks all values. The error is the first invalid one: field, found, expected.
    pub(crate) fn check(&self) -> Result<(), (String, String, String)> {
        let mut values: Vec<(&str, f64, [f64; 2])> = Vec::new();
        if let Some(PadEffects { drift, background_age, .. }) = self.pads {
            values.extend([("pads.drift", drift, [0.0, 1.0]), ("pads.background_age", background_age, [0.0, 3600.0])]);
        }
        if let Some(GelViscoelasticity { relaxation, shear }) = self.gel {
            values.extend([("gel.relaxation", relaxation, [0.0, 1.0]), ("gel.shear", shear, [0.0, 2.0])]);
        }
        if let Some(CableEffects { friction, backlash }) = self.cables {
            values.extend([("cables.friction", friction, [0.0, 5.0]), ("cables.backlash", backlash, [0.0, 0.2])]);
        }
        if let Some(DetectorErrors { lasting, tilt_sigma, mistaken, latency, camera: [x, y, z] }) = self.detector {
            values.extend([
                ("detector.lasting", lasting, [0.0, 1.0]),
                ("detector.tilt_sigma", tilt_sigma, [0.0, 0.5]),
                ("detector.mistaken", mistaken, [0.0, 1.0]),
                ("detector.latency", latency, [0.0, 10.0]),
                ("detector.camera[0]", x, [-3.0, 3.0]),
                ("detector.camera[1]", y, [-3.0, 3.0]),
                ("detector.camera[2]", z, [0.0, 3.0]),
            ]);
        }
        if let Some(ArmErrors { encoder_sigma, mount_position_sigma, mount_rotation_sigma, payload_sigma }) = self.arm {
            values.extend([
                ("arm.encoder_sigma", encoder_sigma, [0.0, 0.1]),
                ("arm.mount_position_sigma", mount_position_sigma, [0.0, 0.05]),
                ("arm.mount_rotation_sigma", mount_rotation_sigma, [0.0, 0.2]),
                ("arm.payload_sigma", payload_sigma, [0.0, 2.0]),
            ]);
        }
        if let Some(ObjectVariation { mass_sigma, friction_sigma, size_sigma }) = self.objects {
            values.extend([
                ("objects.mass_sigma", mass_sigma, [0.0, 0.3]),
                ("objects.friction_sigma", friction_sigma, [0.0, 0.3]),
                ("objects.size_sigma", size_sigma, [0.0, 0.1]),
            ]);
        }
        if let Some(FloorEffect { height }) = self.floor {
            values.push(("floor.height", height, [-3.0, -0.2]));
        }
        if let Some(LatencyEffects { frame, decision }) = self.time {
            values.extend([("time.frame", frame, [0.0, 1.0]), ("time.decision", decision, [0.0, 10.0])]);
        }
        match values.into_iter().find(|(_, value, [low, high])| !(low..=high).contains(&value)) {
            None => Ok(()),
            Some((field, value, [low, high])) => Err((
                format!("effects.{field}"),
                value.to_string(),
                format!("{low} to {high} (SI units: m, rad, s, kg)"),
            )),
        }
    }
}

#[cfg(test)]
mod draw_tests;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for effect in Effect::ALL {
            assert_eq!(effect.name().parse(), Ok(effect));
        }
        let error = "ghosts".parse::<Effect>().unwrap_err().to_string();
        assert!(error.contains("`ghosts`") && error.contains("pads, gel, cables"), "{error}");
    }

    #[test]
    fn every_effect_draws_from_a_stream_of_its_own() {
        let mut seen = std::collections::HashSet::new();
        assert!(seen.insert(trial_rng(1, 2, 3).next_u64()));
        for effect in Effect::ALL {
            assert!(seen.insert(effect.draw_rng(1, 2, 3).next_u64()));
            assert_eq!(effect.draw_rng(1, 2, 3).next_u64(), effect.draw_rng(1, 2, 3).next_u64());
        }
    }

    /// From 3000 draws, the mean is within 4 standard errors of 0, and the standard deviation within 6 % (4.6 of its
    /// standard errors) of the stated one.
    #[test]
    fn cameras_drift_as_stated() {
        let pads = PadEffects { self_contact: false, drift: 0.02, background_age: 0.0 };
        let rates = pads.draw_drift_rates(3000, &mut Effect::Pads.draw_rng(1, 0, 0));
        let mean = rates.iter().sum::<f64>() / 3000.0;
        let deviation = (rates.iter().map(|rate| (rate - mean).powi(2)).sum::<f64>() / 2999.0).sqrt();
        assert!(
            mean.abs() < 4.0 * 0.02 / 3000f64.sqrt() && (deviation / 0.02 - 1.0).abs() < 0.06,
            "{mean} {deviation}"
        );
        assert_eq!(
            PadEffects { drift: 0.0, ..pads }.draw_drift_rates(18, &mut Effect::Pads.draw_rng(1, 0, 0)),
            [0.0; 18]
        );
    }

    /// Regression: `--noise-scale 0` once reported that all errors were scaled, while objects still differed from their
    /// models.
    #[test]
    fn what_a_scale_leaves_is_said() {
        let scaled = crate::Scenario::benchmark().effects.scaled(0.0);
        let words = scaled.describe_unscaled().join("; ");
        for word in ["pads", "gel", "cables", "detector: 1 %", "objects", "time"] {
            assert!(words.contains(word), "{word}: {words}");
        }
        assert!(!words.contains("arm"), "{words}");
        assert!(Effects::default().describe_unscaled().is_empty());
    }

    #[test]
    fn an_effect_is_switched_off_alone() {
        let all = crate::Scenario::benchmark().effects;
        let none = Effect::ALL.into_iter().fold(all, Effects::without);
        assert_eq!(none, Effects::default());
        let text = |effects: &Effects| toml::to_string(effects).unwrap();
        for effect in Effect::ALL {
            let table = format!("[{effect}]");
            assert!(text(&all).contains(&table) && !text(&all.without(effect)).contains(&table));
        }
    }
}
