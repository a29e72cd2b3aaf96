//! Checks of a hand's parameter file. Each error names the field, what was found and what was expected.

use std::path::Path;

use ftac_platform::data::DataError;
use nalgebra::{Point3, Vector3};

use super::{ActuatorParameters, HandParameters, JointParameters, PadParameters, SensorConfiguration};
use crate::digit::Digit;
use crate::hand::{CoverShape, MAX_DIGITS, MAX_HAND_JOINTS};
use crate::transmission::MAX_SPANS;

/// Largest distance of a pad's centre from the surface of its link's cover, m.
const PAD_COVER_TOLERANCE: f64 = 3e-3;
/// Name of the link that is the root of all digits.
const PALM: &str = "palm";
/// Largest constant moment arm, m; for a sliding joint, largest force over tension.
const MAX_MOMENT_ARMS: [f64; 2] = [0.1, 10.0];
/// Permitted sizes of a pad, m.
const PAD_SIZE_RANGE: std::ops::RangeInclusive<f64> = 0.005..=0.1;

impl HandParameters {
    pub(crate) fn check(&self, path: &Path) -> Result<(), DataError> {
        let fault = |field: &str, found: String, expected: &str| Err(DataError::field(path, field, found, expected));
        if self.version != 1 {
            return fault("version", self.version.to_string(), "1");
        }
        if !(1..=MAX_HAND_JOINTS).contains(&self.joint.len()) {
            let expected = format!("1 to {MAX_HAND_JOINTS} joints");
            return fault("joint", format!("{} joints", self.joint.len()), &expected);
        }
        if self.pad.is_empty() {
            return fault("pad", "none".into(), "at least one pad");
        }
        for (letter, configuration) in &self.configuration {
            configuration.check(letter, path)?;
        }
        self.check_cable(path)?;
        let mut links = vec![PALM];
        for joint in &self.joint {
            joint.check(&links, path)?;
            links.push(&joint.name);
        }
        self.check_actuators(path)?;
        let mut names = std::collections::BTreeSet::new();
        for pad in &self.pad {
            if !names.insert(&pad.name) {
                return fault(&format!("pad[{}].name", pad.name), format!("`{}` twice", pad.name), "a name of its own");
            }
            self.check_pad(pad, &links, path)?;
        }
        self.check_hold_detection(path)?;
        let digits = self.actuator.iter().filter(|own| own.drives.is_none()).count();
        self.grasps.iter().try_for_each(|grasps| grasps.check(digits, path))
    }

    fn check_cable(&self, path: &Path) -> Result<(), DataError> {
        let positive = [
            ("cable.spool_radius", self.cable.spool_radius),
            ("cable.stiffness", self.cable.stiffness),
            ("cable.friction.presliding", self.cable.friction.presliding),
        ];
        for (field, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(DataError::field(path, field, value, "a positive number"));
            }
        }
        let least = [
            ("cable.friction.coefficient", self.cable.friction.coefficient),
            ("cable.friction.routing", self.cable.friction.routing),
        ];
        for (field, value) in least {
            if !(value.is_finite() && value >= 0.0) {
                return Err(DataError::field(path, field, value, "zero or a positive number"));
            }
        }
        Ok(())
    }

    /// Checks that there is an actuator for each digit, named and ordered like the digits and pulling on joints of its
    /// own only, followed by at most one that drives the opposition.
    fn check_actuators(&self, path: &Path) -> Result<(), DataError> {
        self.actuator.iter().try_for_each(|own| self.check_actuator(own, path))?;
        let (pulling, driving): (Vec<_>, Vec<_>) = self.actuator.iter().partition(|own| own.drives.is_none());
        let fault = |field: String, found: String, expected: &str| Err(DataError::field(path, field, found, expected));
        if !(1..=MAX_DIGITS).contains(&pulling.len()) || driving.len() > 1 {
            let found = format!("{} with a cable, {} that drive a joint", pulling.len(), driving.len());
            return fault("actuator".into(), found, "1 to 5 with a cable and at most one that drives a joint");
        }
        if self.actuator[..pulling.len()].iter().any(|own| own.drives.is_some()) {
            return fault("actuator".into(), "one that drives a joint before others".into(), "it behind all others");
        }
        let roots: Vec<usize> = (0..self.joint.len()).filter(|n| self.joint[*n].parent == PALM).collect();
        if roots.len() != pulling.len() {
            let found = format!("{} digits, by the joints whose parent is the palm", roots.len());
            return fault("actuator".into(), found, &format!("{}, one for each cable", pulling.len()));
        }
        for (n, (own, digit)) in pulling.iter().zip(Digit::ALL).enumerate() {
            if own.name != digit.name() {
                return fault(format!("actuator[{n}].name"), format!("`{}`", own.name), &format!("`{}`", digit.name()));
            }
            let last = roots.get(n + 1).copied().unwrap_or(self.joint.len());
            let chain = &self.joint[roots[n]..last];
            if let Some(other) = own.cable.iter().find(|name| !chain.iter().any(|joint| joint.name == **name)) {
                let field = format!("actuator[{}].cable", own.name);
                return fault(
                    field,
                    format!("`{other}`"),
                    &format!("joints of digit {} in the order of [[joint]]", n + 1),
                );
            }
        }
        Ok(())
    }

    /// Checks the cable or shaft of an actuator: the joints that it names exist, and those that a cable crosses have
    /// guides or an arm.
    fn check_actuator(&self, actuator: &ActuatorParameters, path: &Path) -> Result<(), DataError> {
        let field = || format!("actuator[{}].cable", actuator.name);
        if actuator.cable.len() > MAX_SPANS {
            return Err(DataError::field(
                path,
                field(),
                format!("{} joints", actuator.cable.len()),
                "at most 3 joints",
            ));
        }
        if actuator.cable.is_empty() && actuator.drives.is_none() {
            return Err(DataError::field(path, field(), "no joint", "a cable's joints, or the joint that it `drives`"));
        }
        for name in actuator.cable.iter().chain(&actuator.drives) {
            let Some(joint) = self.joint.iter().find(|joint| &joint.name == name) else {
                return Err(DataError::field(path, field(), format!("`{name}`"), "the name of a joint"));
            };
            let guides = [joint.guide_before, joint.guide_after].iter().flatten().count();
            if actuator.drives.is_none() && !matches!((guides, joint.arm), (2, None) | (0, Some(_))) {
                return Err(DataError::field(
                    path,
                    format!("joint[{name}].guide_before/guide_after/arm"),
                    format!("{guides} guide points and {} arm", if joint.arm.is_some() { "an" } else { "no" }),
                    "two guide points or an arm, because a cable crosses this joint",
                ));
            }
        }
        Ok(())
    }

    fn check_pad(&self, pad: &PadParameters, links: &[&str], path: &Path) -> Result<(), DataError> {
        let fault = |field: &str, found: &str, expected: &str| {
            Err(DataError::field(path, format!("pad[{}].{field}", pad.name), format!("`{found}`"), expected))
        };
        if !links.contains(&pad.link.as_str()) {
            return fault("link", &pad.link, "the palm or a joint's link");
        }
        if !self.configuration.contains_key(&pad.configuration) {
            return fault("configuration", &pad.configuration, "one of the [configuration] table");
        }
        let long = |v: &[f64; 3]| v.iter().all(|x| x.is_finite()) && Vector3::from(*v).norm() > 1e-6;
        for (field, direction) in [("y", &pad.y), ("z", &pad.z)] {
            if !long(direction) {
                return Err(DataError::field(
                    path,
                    format!("pad[{}].{field}", pad.name),
                    format!("{direction:?}"),
                    "a direction",
                ));
            }
        }
        let joint = self.joint.iter().find(|joint| joint.name == pad.link);
        let cover = CoverShape::from_parameters(joint.map_or(&self.palm.cover, |joint| &joint.cover));
        let (distance, _) = cover.signed_distance(&Point3::from(Vector3::from(pad.center)));
        if distance.is_nan() || distance.abs() > PAD_COVER_TOLERANCE {
            let side = if distance > 0.0 { "outside" } else { "inside" };
            let found = format!("{:.1} mm {side} of its link's cover", 1e3 * distance.abs());
            return Err(DataError::field(
                path,
                format!("pad[{}].center", pad.name),
                found,
                format!("at most {:.0} mm from its surface", 1e3 * PAD_COVER_TOLERANCE),
            ));
        }
        Ok(())
    }
}

impl SensorConfiguration {
    fn check(&self, letter: &str, path: &Path) -> Result<(), DataError> {
        let field = |name: &str| format!("configuration.{letter}{name}");
        if letter.chars().count() != 1 {
            return Err(DataError::field(path, field(""), format!("`{letter}`"), "a name of one letter"));
        }
        for (name, size) in [(".h", self.h), (".w", self.w)] {
            if !PAD_SIZE_RANGE.contains(&size) {
                let expected = format!("{} to {} m", PAD_SIZE_RANGE.start(), PAD_SIZE_RANGE.end());
                return Err(DataError::field(path, field(name), size, expected));
            }
        }
        if !(1..=4).contains(&self.cameras) {
            return Err(DataError::field(path, field(".cameras"), self.cameras, "1 to 4"));
        }
        Ok(())
    }
}

impl JointParameters {
    /// Checks a joint; `links` are the palm and the joints above this one in the file.
    fn check(&self, links: &[&str], path: &Path) -> Result<(), DataError> {
        let fault = |field: &str, found: String, expected: &str| {
            Err(DataError::field(path, format!("joint[{}].{field}", self.name), found, expected))
        };
        if !links.contains(&self.parent.as_str()) {
            return fault("parent", format!("`{}`", self.parent), "the palm or a joint defined above");
        }
        if self.mass.is_nan() || self.mass <= 0.0 {
            return fault("mass", self.mass.to_string(), "a positive mass in kg");
        }
        if self.lower.is_nan() || self.upper.is_nan() || self.lower >= self.upper {
            return fault("lower", self.lower.to_string(), "less than `upper`");
        }
        if self.spring.is_nan() || self.spring <= 0.0 {
            return fault("spring", self.spring.to_string(), "a positive stiffness in N m/rad, of a slide in N/m");
        }
        for (field, value) in [("damping", self.damping), ("armature", self.armature)] {
            if let Some(found) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
                return fault(field, found.to_string(), "a positive number");
            }
        }
        let most = MAX_MOMENT_ARMS[usize::from(self.slide)];
        if let Some(arm) = self.arm.filter(|arm| !(*arm > 0.0 && *arm <= most)) {
            return fault("arm", arm.to_string(), &format!("a positive number of at most {most}"));
        }
        if self.slide && (self.guide_before.is_some() || self.guide_after.is_some()) {
            return fault("slide", "guides".into(), "an arm: a cable between guides turns its joint");
        }
        if let Some(follows) = &self.follows {
            if !links.contains(&follows.joint.as_str()) || follows.joint == PALM {
                return fault("follows.joint", format!("`{}`", follows.joint), "a joint defined above");
            }
            if !(follows.multiplier.is_finite() && follows.multiplier != 0.0) {
                return fault("follows.multiplier", follows.multiplier.to_string(), "a number that is not 0");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Hand;
    use crate::kinematics::JointKind;
    use crate::transmission::Follower;

    const ALLEGRO: &str = include_str!("../../data/robots/allegro.toml");
    const GRIPPER: &str = include_str!("../../data/robots/franka_hand.toml");

    fn error(text: &str, from: &str, to: &str) -> String {
        assert!(text.contains(from), "{from}");
        Hand::parse(&text.replacen(from, to, 1), Path::new("hand.toml")).expect_err(to).to_string()
    }

    /// A hand with four digits and twelve joints, whose thumb opposition has its own motor. A tension bends each joint
    /// according to its arm and spring.
    #[test]
    fn a_hand_of_four_digits() {
        let hand = Hand::parse(ALLEGRO, Path::new("allegro.toml")).expect("valid");
        assert_eq!(hand.digits(), [Digit::Thumb, Digit::Index, Digit::Middle, Digit::Ring]);
        assert_eq!((hand.tree.len(), hand.servos.len(), hand.pads.len()), (12, 5, 4));
        assert_eq!((hand.links(Digit::Ring), hand.links(Digit::Little)), (&[9, 10, 11][..], &[][..]));
        assert_eq!(hand.transmission.opposition, Some(0));
        for (joint, angle) in hand.transmission.free_angles(Digit::Middle.index(), 2.0) {
            let arm = if joint == 8 { 0.008 } else { 0.010 };
            assert!((angle - 2.0 * arm / hand.transmission.springs[joint]).abs() < 1e-9, "{joint}: {angle}");
        }
    }

    /// Two sliding jaws, one following the other.
    #[test]
    fn a_gripper() {
        let hand = Hand::parse(GRIPPER, Path::new("franka_hand.toml")).expect("valid");
        assert_eq!((hand.digits().len(), hand.servos.len(), hand.transmission.opposition), (2, 2, None));
        assert!(hand.tree.joints.iter().all(|joint| joint.kind == JointKind::Slide));
        assert_eq!(hand.transmission.followers, [Follower { joint: 1, leader: 0, multiplier: 1.0, offset: 0.0 }]);
        let closed = hand.tree.forward(&hand.each_joint(|joint| hand.tree.joints[joint].upper));
        let gap = (closed[0].translation.vector - closed[1].translation.vector).norm();
        assert!(gap < 2e-3, "closed jaws are {gap} m apart");
    }

    #[test]
    fn errors_name_field_found_and_expected() {
        let cases = [
            (
                ALLEGRO,
                "name = \"index\"\ncable",
                "name = \"pinky\"\ncable",
                "actuator[1].name: found `pinky`, expected `index`",
            ),
            (
                ALLEGRO,
                "cable = [\"index_1\"",
                "cable = [\"ring_1\"",
                "actuator[index].cable: found `ring_1`, expected joints of digit 2 in the order of [[joint]]",
            ),
            (
                ALLEGRO,
                "cable = [\"middle_1\", \"middle_2\", \"middle_3\"]",
                "cable = []",
                "actuator[middle].cable: found no joint, expected a cable's joints",
            ),
            (
                ALLEGRO,
                "arm = 0.01\n",
                "",
                "joint[thumb_2].guide_before/guide_after/arm: found 0 guide points and no arm",
            ),
            (
                ALLEGRO,
                "arm = 0.01\n",
                "arm = 2.0\n",
                "joint[thumb_2].arm: found 2, expected a positive number of at most 0.1",
            ),
            (ALLEGRO, "parent = \"thumb_1\"", "parent = \"palm\"", "actuator: found 5 digits"),
            (GRIPPER, "joint = \"thumb_1\"", "joint = \"palm\"", "joint[index_1].follows.joint: found `palm`"),
            (GRIPPER, "arm = 1.0", "arm = 1.0\nguide_before = [0.0, 0.1]", "joint[thumb_1].slide: found guides"),
        ];
        for (text, from, to, expected) in cases {
            let found = error(text, from, to);
            assert!(found.starts_with(&format!("hand.toml: {expected}")), "{found}\n{expected}");
        }
    }
}
