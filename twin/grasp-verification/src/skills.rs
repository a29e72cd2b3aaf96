//! Skills: ways to pick up a ball while other digits hold something, each closed and held in physics.
//!
//! The built-in skills are in `data/transport.json`, in addition to the balls' grasps of the benchmark's repertoire. A
//! ball of another size is taken with the grasps of the ball nearest in size, moved so that the palm keeps its
//! distance.

use std::path::Path;

use anyhow::{Context, Result, bail};
use control::policy::pick_sequence::plan::PickSkill;
use dexterous_grasping::{Grasp, Repertoire, digit_sets};
use hand_model::Digit;
use serde::{Deserialize, Serialize};

use crate::ball_sizes::resized;
use crate::simulated_world::SimulatedWorld;

/// Format version of skill files.
const VERSION: u32 = 1;
/// Tolerance within which sizes count as the same, m.
const SAME_SIZE_TOLERANCE: f64 = 5e-4;
/// Largest difference of diameters across which grasps are adapted, as a share of the diameter.
const MAX_RESIZE_SHARE: f64 = 0.16;
/// Factor on the score of an adapted grasp.
const RESIZED_SCORE_FACTOR: f64 = 0.8;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SkillFile {
    /// Format version.
    pub version: u32,
    /// The command that made it.
    pub command: String,
    pub skills: Vec<PickSkill>,
}

impl SkillFile {
    /// Creates a file of `skills`.
    pub fn new(command: String, skills: Vec<PickSkill>) -> Self {
        Self { version: VERSION, command, skills }
    }

    /// Returns the built-in skills.
    pub fn builtin() -> Result<Self> {
        Self::parse(include_str!("../data/transport.json"), Path::new("data/transport.json"))
    }

    /// Parses a file's text.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let file: Self = serde_json::from_str(text).with_context(|| path.display().to_string())?;
        if file.version != VERSION {
            bail!("{}: version: found {}, expected {VERSION}", path.display(), file.version);
        }
        Ok(file)
    }

    /// Writes the file with one skill per line. It is written whole or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        let lines: Vec<String> = self.skills.iter().map(serde_json::to_string).collect::<Result<_, _>>()?;
        let command = serde_json::Value::from(self.command.clone());
        let text = format!("{{\"version\":{VERSION},\"command\":{command},\"skills\":[\n{}\n]}}\n", lines.join(",\n"));
        Ok(ftac_platform::data::write_atomically(path, text.as_bytes())?)
    }
}

/// Converts the balls' grasps of the benchmark's repertoire to skills: ring and little finger first, then thumb, index
/// and middle finger.
pub fn from_repertoire(world: &SimulatedWorld, repertoire: &Repertoire) -> Result<Vec<PickSkill>> {
    let mut skills = Vec::new();
    let first = &digit_sets(&world.cell.robot.hand, 2)[0];
    for (name, grasps) in &repertoire.grasps {
        let model = world.object(name)?;
        if !matches!(model.shape, world::ObjectShape::Sphere { .. }) {
            continue;
        }
        for grasp in grasps {
            let beside = if grasp.digits == *first { Vec::new() } else { first.clone() };
            let diameter = 2.0 * model.shape.bounding_radius();
            skills.push(PickSkill { diameter, beside, keeps: grasp.digits.clone(), grasp: grasp.clone() });
        }
    }
    Ok(skills)
}

/// Returns the grasps of the built-in skills with which exactly `digits` take and keep an object, for those of the
/// objects `names` that are balls.
pub fn by_digits(world: &SimulatedWorld, names: &[String], digits: &[Digit]) -> Result<Vec<Grasp>> {
    let mut verified = SkillFile::builtin()?.skills;
    verified.retain(|skill| skill.keeps == digits && skill.grasp.digits == digits);
    let mut grasps = Vec::new();
    for name in names {
        let model = world.object(name)?;
        if !matches!(model.shape, world::ObjectShape::Sphere { .. }) {
            continue;
        }
        let skills = for_sizes(&verified, &[2.0 * model.shape.bounding_radius()]);
        let of_object = |(id, (_, skill)): (u32, (usize, PickSkill))| Grasp { id, object: name.clone(), ..skill.grasp };
        grasps.extend((0..).zip(skills).map(of_object));
    }
    Ok(grasps)
}

/// Returns the skills for balls of each of `diameters` (m), each with the index of its diameter.
pub fn for_sizes(verified: &[PickSkill], diameters: &[f64]) -> Vec<(usize, PickSkill)> {
    let mut skills = Vec::new();
    for (n, &diameter) in diameters.iter().enumerate() {
        let apart = |skill: &&PickSkill| (skill.diameter - diameter).abs();
        let same = verified.iter().any(|skill| apart(&skill) < SAME_SIZE_TOLERANCE);
        let within = if same { SAME_SIZE_TOLERANCE } else { MAX_RESIZE_SHARE * diameter };
        for skill in verified.iter().filter(|skill| apart(skill) < within) {
            let mut grasp = resized(&skill.grasp, &skill.grasp.object, 0.5 * (diameter - skill.diameter));
            if !same {
                grasp.score *= RESIZED_SCORE_FACTOR;
            }
            skills.push((n, PickSkill { grasp, ..skill.clone() }));
        }
    }
    skills
}

#[cfg(test)]
mod tests {
    use hand_model::RobotModel;

    use super::*;
    use scenarios::Scenario;

    fn repertoire() -> Repertoire {
        crate::builtin::repertoire().unwrap()
    }

    #[test]
    fn the_builtin_file_is_good() {
        for skill in SkillFile::builtin().unwrap().skills {
            let closing = &skill.grasp.digits;
            assert!(!skill.keeps.is_empty() && skill.keeps.iter().all(|digit| closing.contains(digit)));
            assert!(skill.beside.iter().all(|digit| !closing.contains(digit)));
            assert!((0.0..=1.0).contains(&skill.grasp.score));
        }
    }

    /// A ball of a known size has only its own grasps. A ball of another size has those of balls of nearly its size,
    /// and a very large one has none.
    #[test]
    fn sizes() {
        let world = SimulatedWorld::new(&RobotModel::ftac_gen3(), Scenario::benchmark()).unwrap();
        let verified = from_repertoire(&world, &repertoire()).unwrap();
        let sizes = for_sizes(&verified, &[0.0427, 0.046, 0.5]);
        let of = |n: usize| sizes.iter().filter(move |skill| skill.0 == n).map(|skill| &skill.1);
        assert!(of(0).all(|skill| skill.grasp.object == "golf_ball") && of(0).count() == 18);
        let moved = of(1).find(|skill| skill.grasp.object == "golf_ball").unwrap();
        let original =
            repertoire().grasps["golf_ball"].iter().find(|grasp| grasp.id == moved.grasp.id).cloned().unwrap();
        assert!((moved.grasp.center[2] - (original.center[2] - 0.00165)).abs() < 1e-12);
        assert!((moved.grasp.score - RESIZED_SCORE_FACTOR * original.score).abs() < 1e-12);
        assert_eq!(of(2).count(), 0);
    }
}
