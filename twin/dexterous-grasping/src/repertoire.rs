//! Repertoire: ranked grasps of each object, with the seed and the command that generated them. The file format is JSON
//! with one grasp per line.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ftac_platform::digest::sha256;
use ftac_platform::file::write_atomically;
use hand_model::{Digit, RobotModel};
use serde::{Deserialize, Serialize};

use crate::grasp::Grasp;

/// Errors of repertoire files.
#[derive(Debug, thiserror::Error)]
pub enum RepertoireError {
    /// The file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The text is not a repertoire, or a grasp has another number of values than the robot's hand.
    #[error("{path}: {message}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The parser's message, or the field with the found and the expected number of values.
        message: String,
    },
    /// The file has another version of the format.
    #[error("{path}: version: found {found}, expected {VERSION}")]
    Version {
        /// The file.
        path: PathBuf,
        /// Version in the file.
        found: u32,
    },
    /// The grasps are those of a robot that moves differently.
    #[error("{path}: robot: found grasps of {found}, expected those of {expected}, which moves otherwise")]
    Robot {
        /// The file.
        path: PathBuf,
        /// Name of the robot in the file.
        found: String,
        /// Name of the requested robot.
        expected: String,
    },
}

/// Version of the file format.
pub const VERSION: u32 = 1;

/// Grasps of several objects.
///
/// ```
/// use dexterous_grasping::{Grasp, Repertoire};
/// # let grasp = |id: u32, score: f64| -> Grasp {
/// #     serde_json::from_value(serde_json::json!({"id": id, "object": "ball", "yaw": 0.0, "pitch": 0.2, "roll": -0.9,
/// #         "center": [-0.03, -0.04, -0.02], "pre_tension": [0, 0, 0, 1.5, 1.5], "close_tension": [0, 0, 0, 18, 18],
/// #         "opposition": 0.0, "raise": 0.0, "thumb_delay": 0.0, "held": null, "held_joints": null, "score": score}))
/// #         .expect("a grasp")
/// # };
/// use dexterous_grasping::repertoire::VERSION;
/// use hand_model::Digit;
///
/// let mut repertoire =
///     Repertoire { version: VERSION, command: "a search".into(), seed: 7, ..Repertoire::default() };
/// repertoire.insert(grasp(0, 0.4));
/// repertoire.insert(grasp(1, 0.9));
///
/// let path = std::env::temp_dir().join(format!("repertoire-example-{}.json", std::process::id()));
/// repertoire.write(&path)?;
/// let read = Repertoire::read(&path)?;
/// # std::fs::remove_file(&path).expect("removed");
/// let best = read.for_digits("ball", &[Digit::Ring, Digit::Little]).next();
/// assert_eq!(best.map(|grasp| grasp.id), Some(1));
/// # Ok::<(), dexterous_grasping::RepertoireError>(())
/// ```
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Repertoire {
    /// Version of the file format, [`VERSION`].
    pub version: u32,
    /// Command that generated it.
    pub command: String,
    /// Seed of the search.
    pub seed: u64,
    /// Name of the robot and SHA-256 of its [mechanics](RobotModel::mechanics_text). `None` for the built-in robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<[String; 2]>,
    /// Grasps by object, best first.
    pub grasps: BTreeMap<String, Vec<Grasp>>,
}

impl Repertoire {
    /// Parses text; `path` is used in errors.
    ///
    /// # Errors
    /// [`RepertoireError::Syntax`] or [`RepertoireError::Version`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, RepertoireError> {
        let repertoire: Self = serde_json::from_str(text)
            .map_err(|error| RepertoireError::Syntax { path: path.into(), message: error.to_string() })?;
        if repertoire.version != VERSION {
            return Err(RepertoireError::Version { path: path.into(), found: repertoire.version });
        }
        Ok(repertoire)
    }

    /// Returns the value of a repertoire's field `robot` for this robot.
    pub fn robot_identity(robot: &RobotModel) -> Option<[String; 2]> {
        let other = !robot.moves_like(&RobotModel::ftac_gen3());
        other.then(|| [robot.name.clone(), sha256(robot.mechanics_text().as_bytes())])
    }

    /// Reads a file of grasps of `robot`.
    ///
    /// # Errors
    /// [`RepertoireError::Robot`] for a file of a robot that moves differently, [`RepertoireError::Syntax`] for a grasp
    /// with another number of tensions or joint angles, and those of [`Self::read`].
    pub fn read_for(robot: &RobotModel, path: &Path) -> Result<Self, RepertoireError> {
        let (found, expected) = (Self::read(path)?, Self::robot_identity(robot));
        let digest = |mark: &Option<[String; 2]>| mark.as_ref().map(|[_, digest]| digest.clone());
        if digest(&found.robot) == digest(&expected) {
            found.check(robot, path)?;
            return Ok(found);
        }
        let found = found.robot.map_or_else(|| RobotModel::ftac_gen3().name, |[name, _]| name);
        Err(RepertoireError::Robot { path: path.into(), found, expected: robot.name.clone() })
    }

    /// Checks that every grasp has a tension for each digit of `robot` and an angle for each joint.
    fn check(&self, robot: &RobotModel, path: &Path) -> Result<(), RepertoireError> {
        let (digits, joints) = (robot.hand.cables.len(), robot.hand.tree.len());
        for grasp in self.grasps.values().flatten() {
            let angles = grasp.held_joints.as_ref().map_or(joints, Vec::len);
            let tensions = [("pre_tension", &grasp.pre_tension), ("close_tension", &grasp.close_tension)];
            let counts = tensions.map(|(field, tensions)| (field, tensions.len(), digits));
            for (field, found, expected) in counts.into_iter().chain([("held_joints", angles, joints)]) {
                if found != expected {
                    let of = format!("grasps.{}[id {}].{field}", grasp.object, grasp.id);
                    let message = format!("{of}: found {found} numbers, expected {expected}");
                    return Err(RepertoireError::Syntax { path: path.into(), message });
                }
            }
        }
        Ok(())
    }

    /// Reads a file of grasps of any robot.
    ///
    /// # Errors
    /// [`RepertoireError::Io`], [`RepertoireError::Syntax`] or [`RepertoireError::Version`].
    pub fn read(path: &Path) -> Result<Self, RepertoireError> {
        let text =
            ftac_platform::file::read_text(path).map_err(|source| RepertoireError::Io { path: path.into(), source })?;
        Self::parse(&text, path)
    }

    /// Writes a file with one grasp per line. It is written whole or not at all.
    ///
    /// # Errors
    /// [`RepertoireError::Io`].
    pub fn write(&self, path: &Path) -> Result<(), RepertoireError> {
        let robot = self.robot.as_ref().map_or(String::new(), |mark| format!("\"robot\":{},", serde_json::json!(mark)));
        let mut text = format!(
            "{{\"version\":{},\"command\":{},\"seed\":{},{robot}\"grasps\":{{\n",
            self.version,
            serde_json::Value::from(self.command.clone()),
            self.seed
        );
        for (n, (object, grasps)) in self.grasps.iter().enumerate() {
            let lines: Vec<String> = grasps.iter().filter_map(|grasp| serde_json::to_string(grasp).ok()).collect();
            text += &format!(
                "{}: [\n{}\n]{}\n",
                serde_json::Value::from(object.clone()),
                lines.join(",\n"),
                if n + 1 < self.grasps.len() { "," } else { "" }
            );
        }
        text += "}}\n";
        write_atomically(path, text.as_bytes()).map_err(|source| RepertoireError::Io { path: path.into(), source })
    }

    /// Returns the grasps of `object` that close these `digits`, best first.
    pub fn for_digits<'a, 'd>(
        &'a self,
        object: &str,
        digits: &'d [Digit],
    ) -> impl Iterator<Item = &'a Grasp> + use<'a, 'd> {
        self.grasps.get(object).into_iter().flatten().filter(move |grasp| grasp.digits == digits)
    }

    /// Adds a grasp and keeps its object's list ranked by score (ties: by number).
    pub fn insert(&mut self, grasp: Grasp) {
        let list = self.grasps.entry(grasp.object.clone()).or_default();
        list.push(grasp);
        list.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.id.cmp(&b.id)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIRST: &[Digit] = &[Digit::Ring, Digit::Little];
    const SECOND: &[Digit] = &[Digit::Thumb, Digit::Index, Digit::Middle];

    fn grasp(id: u32, object: &str, digits: &[Digit], score: f64) -> Grasp {
        Grasp {
            id,
            object: object.into(),
            digits: digits.to_vec(),
            yaw: 0.1,
            pitch: 0.2,
            roll: -0.9,
            center: [-0.03, -0.04, 1.0 / 3.0],
            pre_tension: [0.0, 0.0, 0.0, 1.5, 1.5].into(),
            close_tension: [0.0, 0.0, 0.0, 18.0, 18.0].into(),
            opposition: 0.1,
            raise: 0.002,
            thumb_delay: 0.0,
            held: None,
            held_joints: None,
            held_sigmas: None,
            score,
        }
    }

    fn repertoire() -> Repertoire {
        let mut repertoire =
            Repertoire { version: VERSION, command: "a \"quoted\" command".into(), seed: 7, ..Repertoire::default() };
        for (id, score) in [(0, 0.4), (1, 0.9), (2, 0.9), (3, 0.1)] {
            repertoire.insert(grasp(id, "ball", if id == 1 { SECOND } else { FIRST }, score));
        }
        repertoire.insert(grasp(0, "can", SECOND, 0.5));
        repertoire
    }

    #[test]
    fn best_first_and_by_digits() {
        let repertoire = repertoire();
        let ids = |digits| repertoire.for_digits("ball", digits).map(|grasp| grasp.id).collect::<Vec<_>>();
        assert_eq!((ids(FIRST), ids(SECOND)), (vec![2, 0, 3], vec![1]));
        assert_eq!(repertoire.grasps["ball"].iter().map(|grasp| grasp.id).collect::<Vec<_>>(), [1, 2, 0, 3]);
        assert_eq!(repertoire.for_digits("pawn", FIRST).count(), 0);
    }

    /// The writer formats one grasp per line itself. The result must still be valid JSON that can be read.
    #[test]
    fn a_written_file_has_one_grasp_per_line_and_is_read_back() {
        let path = std::env::temp_dir().join(format!("repertoire-{}.json", std::process::id()));
        let written = repertoire();
        written.write(&path).expect("written");
        let text = std::fs::read_to_string(&path).expect("text");
        let read = Repertoire::read(&path).expect("read");
        std::fs::remove_file(&path).expect("removed");
        assert_eq!((read.command, read.seed, read.grasps), (written.command, written.seed, written.grasps));
        assert_eq!(text.lines().filter(|line| line.starts_with("{\"id\":")).count(), 5);
    }

    /// A grasp with too few tensions is refused by name, instead of an index out of range in a trial.
    #[test]
    fn grasps_of_another_hand_are_refused() {
        let path = std::env::temp_dir().join(format!("short-repertoire-{}.json", std::process::id()));
        let mut short = repertoire();
        if let Some(grasp) = short.grasps.get_mut("can").and_then(|grasps| grasps.first_mut()) {
            grasp.close_tension.pop();
        }
        short.write(&path).expect("written");
        let error = Repertoire::read_for(&RobotModel::ftac_gen3(), &path).expect_err("refused").to_string();
        std::fs::remove_file(&path).expect("removed");
        assert!(error.ends_with("grasps.can[id 0].close_tension: found 4 numbers, expected 5"), "{error}");
    }

    #[test]
    fn other_versions_and_damage_are_errors_that_name_the_file() {
        let path = Path::new("r.json");
        let error = |text: &str| Repertoire::parse(text, path).expect_err("refused").to_string();
        let old = r#"{"version":9,"command":"","seed":1,"grasps":{}}"#;
        assert_eq!(error(old), "r.json: version: found 9, expected 1");
        assert!(error("{").starts_with("r.json: EOF"), "{}", error("{"));
    }
}
