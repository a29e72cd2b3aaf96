//! A robot as one file describes it: arm, hand, and the hand's deviations from its parameter file.
//!
//! ```toml
//! version = 1
//! name = "ftac_small_right"
//! arm = "gen3"                  # the Gen3, or a parameter file beside this one, which may name a URDF: see `hand_model::arm`
//! calibration = "pads.json"     # photometric calibration of the pads; default: the built-in one
//!
//! [mount]                       # of the hand on the arm's flange, z out of it; default: straight on it
//! xyz = [0.0, 0.0, 0.01]        # m
//! rpy = [0.0, 0.0, 1.5708]      # roll, pitch and yaw, rad
//!
//! [start]                       # of a trial; default: the palm level, the fingers ahead
//! pitch = 1.5708                # of the fingers below the horizontal, rad
//!
//! [hand]
//! parameters = "ftac"           # the F-TAC Hand, or a parameter file beside this one
//! handedness = "right"          # default: as in the parameter file
//! scale = 0.85                  # of all lengths; default: 1
//!
//! [hand.configuration]          # sensor configurations beyond those of the parameter file
//! s = { h = 0.024, w = 0.012, cameras = 1 }
//!
//! [[hand.pad]]                  # pads beyond those of the parameter file
//! name = "ring_middle_back"
//! link = "ring_2"
//! configuration = "s"
//! center = [0.0145, -0.006, 0.0]
//! y = [1.0, 0.0, 0.0]
//! z = [0.0, -1.0, 0.0]
//! ```
//! Numbers in the file refer to the left hand at full size, as in the parameter file.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ftac_platform::data::{DataError, parse_toml, read_text};
use ftac_platform::file_access::FileAccess;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use crate::kinematics::pose_from_xyz_rpy;
use crate::parameters::{HandParameters, Handedness, PadParameters, SensorConfiguration};
use crate::{Arm, Hand};

/// Version of the file format.
const VERSION: u32 = 1;
/// File of the built-in robot.
const BUILTIN_FILE: &str = "ftac_gen3.toml";
/// Name by which a file asks for the built-in hand.
const BUILTIN_HAND: &str = "ftac";
/// Name by which a file asks for the built-in arm.
const BUILTIN_ARM: &str = "gen3";
/// Smallest and largest scale of a hand.
const SCALE_RANGE: [f64; 2] = [0.5, 2.0];

/// Arm and hand: everything that is fixed for a run.
///
/// ```
/// use hand_model::{RobotModel, RobotSources};
///
/// // The same as `RobotModel::read(Path::new("right.toml"))`, from text.
/// let robot = "version = 1\nname = \"right\"\narm = \"gen3\"\n[hand]\nparameters = \"ftac\"\nhandedness = \"right\"\n";
/// let sources = RobotSources { name: "right.toml".into(), robot: robot.to_owned(), files: [].into() };
/// let robot = RobotModel::from_sources(Some(&sources))?;
///
/// // The palm in the base frame of the arm at home.
/// let base_from_palm = robot.arm.tool_pose(&robot.arm.home) * robot.hand.palm_from_flange.inverse();
/// println!("{}: palm at {:.3?} m", robot.name, base_from_palm.translation.vector.as_slice());
/// assert!(!robot.moves_like(&RobotModel::ftac_gen3()));
/// # Ok::<(), hand_model::DataError>(())
/// ```
#[derive(Debug, Clone)]
pub struct RobotModel {
    /// Name of the robot, as in its file.
    pub name: String,
    /// The arm, with the hand's mount in its tool frame.
    pub arm: Arc<Arm>,
    /// The hand.
    pub hand: Arc<Hand>,
    /// Pitch of the fingers below the horizontal when a trial begins, rad.
    pub start_pitch: f64,
    /// Name of the file with the pads' photometric calibration; none for the built-in one.
    pub calibration: Option<String>,
    /// Source texts of the robot; `None` for the built-in robot.
    pub sources: Option<RobotSources>,
}

/// Source texts of a robot. Runs and sessions keep them, so that they do not depend on files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotSources {
    /// Name of the robot file, for errors.
    pub name: PathBuf,
    /// Text of the robot file.
    pub robot: String,
    /// Texts of the files that it names, by the names it uses.
    pub files: BTreeMap<String, String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RobotFile {
    version: u32,
    name: String,
    arm: String,
    calibration: Option<String>,
    #[serde(default)]
    mount: MountFile,
    #[serde(default)]
    start: StartFile,
    hand: HandFile,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct StartFile {
    pitch: f64,
}

impl StartFile {
    fn check(&self, path: &Path) -> Result<f64, DataError> {
        if !(-FRAC_PI_2..=MAX_START_PITCH).contains(&self.pitch) {
            let expected = format!("{:.4} to {MAX_START_PITCH:.4}", -FRAC_PI_2);
            return Err(DataError::field(path, "start.pitch", self.pitch, expected));
        }
        Ok(self.pitch)
    }
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct MountFile {
    xyz: [f64; 3],
    rpy: [f64; 3],
}

/// Steepest pitch of the fingers when a trial begins, rad: straight down, plus a margin for rounding.
const MAX_START_PITCH: f64 = FRAC_PI_2 + 1e-3;
/// Largest offset of a mounted hand from its flange along each axis, m.
const MAX_MOUNT_OFFSET: f64 = 0.5;

impl MountFile {
    /// Checks the mount and returns `flange_from_hand`.
    fn pose(&self, path: &Path) -> Result<Isometry3<f64>, DataError> {
        for (field, values, most) in [("xyz", self.xyz, MAX_MOUNT_OFFSET), ("rpy", self.rpy, TAU)] {
            if let Some(n) = values.iter().position(|value| !(-most..=most).contains(value)) {
                let expected = format!("{} to {most:.3}", -most);
                return Err(DataError::field(path, format!("mount.{field}[{n}]"), values[n], expected));
            }
        }
        Ok(pose_from_xyz_rpy(self.xyz, self.rpy))
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct HandFile {
    parameters: String,
    handedness: Option<Handedness>,
    scale: Option<f64>,
    #[serde(default)]
    configuration: BTreeMap<String, SensorConfiguration>,
    #[serde(default)]
    pad: Vec<PadParameters>,
}

impl RobotFile {
    /// Returns the files that it names: (field, name).
    fn named_files(&self) -> impl Iterator<Item = (&'static str, &String)> {
        let arm = (self.arm != BUILTIN_ARM).then_some(("arm", &self.arm));
        let hand = (self.hand.parameters != BUILTIN_HAND).then_some(("hand.parameters", &self.hand.parameters));
        let calibration = self.calibration.as_ref().map(|name| ("calibration", name));
        arm.into_iter().chain(hand).chain(calibration)
    }
}

impl RobotSources {
    /// Reads a robot file and the files that it names, which are looked for beside it. A missing calibration is left
    /// out, because it has to be made with the robot.
    ///
    /// # Errors
    /// [`DataError`] with the file and field at fault.
    pub fn read(path: &Path, reach: FileAccess) -> Result<Self, DataError> {
        let robot = read_text(path)?;
        let file: RobotFile = parse_toml(&robot, path)?;
        let mut files = BTreeMap::new();
        for (field, name) in file.named_files() {
            let named = reach.resolve(path, field, Path::new(name))?;
            if field != "calibration" || named.exists() {
                files.insert(name.clone(), read_text(&named)?);
            }
            if let Some(urdf) =
                files.get(name).filter(|_| field == "arm").map_or(Ok(None), |arm| Arm::urdf_name(arm, &named))?
            {
                let text = read_text(&reach.resolve(&named, "urdf", Path::new(&urdf))?)?;
                files.insert(urdf, text);
            }
        }
        let name = path.file_name().map(PathBuf::from).unwrap_or_default();
        Ok(Self { name, robot, files })
    }
}

impl RobotModel {
    /// Returns the F-TAC Hand on a Gen3.
    ///
    /// # Panics
    /// Never in a tested build: the files are compiled in and a test reads them.
    pub fn ftac_gen3() -> Self {
        let text = include_str!("../data/ftac_gen3.toml");
        let file: RobotFile = parse_toml(text, Path::new(BUILTIN_FILE)).expect("the built-in robot is valid");
        let (arm, hand) = (Arc::new(Arm::gen3()), Arc::new(Hand::ftac()));
        Self { name: file.name, arm, hand, start_pitch: file.start.pitch, calibration: file.calibration, sources: None }
    }

    /// Reads a robot file; the files that it names are looked for beside it.
    ///
    /// # Errors
    /// [`DataError`] with the file and field at fault.
    pub fn read(path: &Path) -> Result<Self, DataError> {
        Self::parse(&RobotSources::read(path, FileAccess::Anywhere)?, path)
    }

    /// Builds the robot from `sources`, or the built-in one.
    ///
    /// # Errors
    /// Those of [`Self::parse`].
    pub fn from_sources(sources: Option<&RobotSources>) -> Result<Self, DataError> {
        sources.map_or_else(|| Ok(Self::ftac_gen3()), |sources| Self::parse(sources, &sources.name))
    }

    /// Returns the nominal robot as its files define it. For a plant instance, that is the robot of which it is one.
    ///
    /// # Errors
    /// Those of [`Self::parse`].
    pub fn nominal(&self) -> Result<Self, DataError> {
        Self::from_sources(self.sources.as_ref())
    }

    /// Returns the name of the robot's file, for errors.
    pub fn file(&self) -> &Path {
        self.sources.as_ref().map_or(Path::new(BUILTIN_FILE), |sources| &sources.name)
    }

    /// Builds the robot from `sources`; `path` is used in errors.
    ///
    /// # Errors
    /// [`DataError`] with the file and field at fault.
    pub fn parse(sources: &RobotSources, path: &Path) -> Result<Self, DataError> {
        let file: RobotFile = parse_toml(&sources.robot, path)?;
        if file.version != VERSION {
            return Err(DataError::field(path, "version", file.version, VERSION.to_string()));
        }
        let named = |field: &str, name: &String| {
            let text = sources
                .files
                .get(name)
                .ok_or_else(|| DataError::field(path, field, name, "a file that was kept with the robot"))?;
            Ok::<_, DataError>((text, path.with_file_name(name)))
        };
        let arm = if file.arm == BUILTIN_ARM {
            Arm::gen3()
        } else {
            let (text, path) = named("arm", &file.arm)?;
            let urdf = Arm::urdf_name(text, &path)?.map(|name| named("urdf", &name)).transpose()?;
            Arm::parse(text, &path, urdf.as_ref().map(|(text, path)| (text.as_str(), path.as_path())))?
        };
        let start_pitch = file.start.check(path)?;
        let arm = Arm { last_from_tool: arm.last_from_tool * file.mount.pose(path)?, ..arm };
        let mut parameters = if file.hand.parameters == BUILTIN_HAND {
            HandParameters::ftac()
        } else {
            let (text, path) = named("hand.parameters", &file.hand.parameters)?;
            HandParameters::parse(text, &path)?
        };
        file.hand.apply(&mut parameters, path)?;
        // Sessions and plant instances name the hand to which they belong.
        parameters.name.clone_from(&file.name);
        Ok(Self {
            name: file.name,
            arm: Arc::new(arm),
            hand: Arc::new(Hand::build(parameters)),
            start_pitch,
            calibration: file.calibration,
            sources: Some(sources.clone()),
        })
    }

    /// Returns the pads' photometric calibration, if it is not the built-in one: text and name of its file.
    ///
    /// # Errors
    /// [`DataError`] for a file that was missing.
    pub fn calibration(&self) -> Result<Option<(&str, PathBuf)>, DataError> {
        let Some((sources, name)) = self.sources.as_ref().zip(self.calibration.as_ref()) else { return Ok(None) };
        match sources.files.get(name) {
            Some(text) => Ok(Some((text, PathBuf::from(name)))),
            None => {
                let expected =
                    "a calibration beside the robot's file; `ftac touch train --robot-model FILE --out FILE` makes one";
                Err(DataError::field(&sources.name, "calibration", format!("no file {name}"), expected))
            }
        }
    }

    /// Returns all of arm, hand and start except pads, cameras and names, as text. Robots with the same text can share
    /// grasps. The file's own grasps are included if they differ from those of the F-TAC Hand.
    pub fn mechanics_text(&self) -> String {
        let parameters = HandParameters {
            name: String::new(),
            configuration: BTreeMap::new(),
            pad: Vec::new(),
            ..self.hand.parameters.clone()
        };
        let start = if self.start_pitch == 0.0 { String::new() } else { format!(" {}", self.start_pitch) };
        let builtin = HandParameters { grasps: None, ..parameters.clone() };
        let own = Some(parameters.grasps()).filter(|own| *own != builtin.grasps());
        let grasps = own.map_or(String::new(), |own| format!(" {own:?}"));
        format!("{parameters:?} {:?}{start}{grasps}", self.arm)
    }

    /// True if arm and hand move and touch like those of `other`.
    pub fn moves_like(&self, other: &Self) -> bool {
        self.mechanics_text() == other.mechanics_text()
    }
}

impl HandFile {
    /// Applies the requested changes and checks the result.
    fn apply(self, parameters: &mut HandParameters, path: &Path) -> Result<(), DataError> {
        for (letter, configuration) in self.configuration {
            let field = format!("hand.configuration.{letter}");
            if parameters.configuration.insert(letter, configuration).is_some() {
                return Err(DataError::field(path, field, "a configuration of the parameter file", "another letter"));
            }
        }
        parameters.pad.extend(self.pad);
        if let Some(handedness) = self.handedness {
            parameters.handedness = handedness;
        }
        parameters.check(path).map_err(|error| error.within("hand"))?;
        let scale = self.scale.unwrap_or(1.0);
        if !(SCALE_RANGE[0]..=SCALE_RANGE[1]).contains(&scale) {
            let expected = format!("{} to {}", SCALE_RANGE[0], SCALE_RANGE[1]);
            return Err(DataError::field(path, "hand.scale", scale, expected));
        }
        if scale != 1.0 {
            parameters.scale(scale);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<RobotModel, DataError> {
        let sources = RobotSources { name: "robot.toml".into(), robot: text.to_owned(), files: BTreeMap::new() };
        RobotModel::from_sources(Some(&sources))
    }

    const PLAIN: &str = "version = 1\nname = \"r\"\narm = \"gen3\"\n[hand]\nparameters = \"ftac\"\n";
    const PAD: &str = "[hand.configuration]\ns = { h = 0.024, w = 0.012, cameras = 1 }\n[[hand.pad]]\nname = \"ring_middle_back\"\n\
                       link = \"ring_2\"\nconfiguration = \"s\"\ncenter = [0.0145, -0.006, 0.0]\ny = [1.0, 0.0, 0.0]\nz = [0.0, -1.0, 0.0]\n";

    #[test]
    fn the_built_in_robot_is_hand_and_arm_as_published() {
        let robot = RobotModel::ftac_gen3();
        let file = parse(include_str!("../data/ftac_gen3.toml")).expect("valid");
        assert_eq!(robot.name, file.name);
        for same in [file, parse(PLAIN).expect("valid")] {
            assert!(robot.moves_like(&same) && matches!(same.calibration(), Ok(None)));
            assert_eq!(format!("{:?}", robot.hand.pads), format!("{:?}", same.hand.pads));
        }
    }

    /// Grasps depend on the pitch at the start of trials; the level palm is the default and is left out of the text.
    #[test]
    fn trials_may_begin_with_the_fingers_down() {
        let down = parse(&PLAIN.replace("[hand]", "[start]\npitch = 1.5\n[hand]")).expect("valid");
        let level = RobotModel::ftac_gen3();
        assert_eq!((down.start_pitch, level.start_pitch), (1.5, 0.0));
        assert_eq!(down.mechanics_text(), level.mechanics_text() + " 1.5");
    }

    /// Grasps do not depend on the thresholds for a hold, but they do depend on the sets of digits that take objects.
    #[test]
    fn mechanics_are_those_of_body_and_grasps() {
        let read = |change: fn(&mut HandParameters)| {
            let mut parameters = HandParameters::ftac();
            change(&mut parameters);
            RobotModel { hand: Arc::new(Hand::build(parameters)), ..RobotModel::ftac_gen3() }
        };
        let builtin = RobotModel::ftac_gen3();
        assert!(builtin.moves_like(&read(|own| (own.hold, own.palpation, own.grasps) = (None, None, None))));
        let fewer = read(|own| own.grasps.iter_mut().for_each(|grasps| grasps.set.truncate(1)));
        assert!(!builtin.moves_like(&fewer));
    }

    /// The distance of a scaled hand's links from the palm's origin scales with the hand at any posture, and its weight
    /// with the volume.
    #[test]
    fn a_scaled_hand_is_similar() {
        let (full, small) = (Hand::ftac(), parse(&format!("{PLAIN}scale = 0.85\n")).expect("valid").hand);
        let q: Vec<f64> = (0..full.tree.len()).map(|joint| 0.05 * joint as f64).collect();
        for (large, little) in full.tree.forward(&q).iter().zip(small.tree.forward(&q)) {
            assert!((large.translation.vector * 0.85 - little.translation.vector).norm() < 1e-12);
            assert!(large.rotation.angle_to(&little.rotation) < 1e-12);
        }
        for (large, little) in full.masses.iter().zip(&small.masses) {
            assert!((little.mass / large.mass - 0.85f64.powi(3)).abs() < 1e-12);
            assert!(((little.inertia / 0.85f64.powi(5)) - large.inertia).norm() < 1e-12);
        }
        // The same tension bends a digit as far as before.
        for ((_, large), (_, little)) in
            full.transmission.free_angles(1, 4.0).into_iter().zip(small.transmission.free_angles(1, 4.0))
        {
            assert!((large - little).abs() < 1e-9);
        }
        assert!((small.pads[0].h / full.pads[0].h - 0.85).abs() < 1e-12);
        assert!(!RobotModel::ftac_gen3().moves_like(&parse(&format!("{PLAIN}scale = 0.85\n")).expect("valid")));
    }

    /// A mount moves the hand on the flange and leaves the arm's joints unchanged.
    #[test]
    fn a_mount_moves_the_hand() {
        let mount = "[mount]\nxyz = [0.0, 0.0, 0.02]\nrpy = [0.0, 0.0, 1.5707963267948966]\n[hand]";
        let (plain, mounted) =
            (RobotModel::ftac_gen3().arm, parse(&PLAIN.replace("[hand]", mount)).expect("valid").arm);
        let off = plain.tool_pose(&plain.home).inv_mul(&mounted.tool_pose(&plain.home));
        assert!((off.translation.vector - nalgebra::Vector3::new(0.0, 0.0, 0.02)).norm() < 1e-12);
        assert!((off.rotation.angle() - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        let far =
            parse(&PLAIN.replace("[hand]", "[mount]\nxyz = [0.0, 2.0, 0.0]\n[hand]")).expect_err("far").to_string();
        assert_eq!(far, "robot.toml: mount.xyz[1]: found 2, expected -0.5 to 0.500");
    }

    #[test]
    fn pads_are_added_and_nothing_else() {
        let robot = parse(&format!("{PLAIN}{PAD}")).expect("valid");
        assert_eq!((robot.hand.pads.len(), robot.hand.cameras.len()), (18, 19));
        assert_eq!(robot.hand.pads[17].link, robot.hand.tree.find("ring_2"));
        assert!(robot.moves_like(&RobotModel::ftac_gen3()));
        let right = parse(&format!("{PLAIN}handedness = \"right\"\n{PAD}")).expect("valid");
        let places = [robot, right].map(|robot| {
            let links = robot.hand.tree.forward(&vec![0.3; robot.hand.tree.len()]);
            robot.hand.pad_poses(&links)[17].translation.vector
        });
        assert!((places[0].component_mul(&nalgebra::Vector3::new(-1.0, 1.0, 1.0)) - places[1]).norm() < 1e-9);
    }

    #[test]
    fn errors_name_file_and_field() {
        let with = |from: &str, to: &str| {
            let text = format!("{PLAIN}{PAD}");
            assert!(text.contains(from), "{from}");
            parse(&text.replacen(from, to, 1)).expect_err(to).to_string()
        };
        let nowhere = with("link = \"ring_2\"", "link = \"ring_9\"");
        assert_eq!(
            nowhere,
            "robot.toml: hand.pad[ring_middle_back].link: found `ring_9`, expected the palm or a joint's link"
        );
        let unknown = with("configuration = \"s\"", "configuration = \"t\"");
        assert!(unknown.contains("hand.pad[ring_middle_back].configuration: found `t`"), "{unknown}");
        let twice = with("ring_middle_back", "ring_middle");
        assert!(twice.contains("hand.pad[ring_middle].name: found `ring_middle` twice"), "{twice}");
        let off = with("[0.0145, -0.006, 0.0]", "[0.0145, -0.012, 0.0]");
        assert!(off.contains("hand.pad[ring_middle_back].center: found 6.0 mm outside"), "{off}");
        let wide = with("w = 0.012", "w = 0.12");
        assert!(wide.contains("hand.configuration.s.w: found 0.12"), "{wide}");
        let taken = with("\ns = {", "\na = {");
        assert!(taken.contains("hand.configuration.a: found a configuration of the parameter file"), "{taken}");
        let version = with("version = 1", "version = 7");
        assert_eq!(version, "robot.toml: version: found 7, expected 1");
        let steep = with("[hand]", "[start]\npitch = 2.0\n[hand]");
        assert!(steep.contains("robot.toml: start.pitch: found 2, expected -1.5708 to 1.57"), "{steep}");
        let lost = with("\"gen3\"", "\"ur5e.toml\"");
        assert!(lost.contains("arm: found ur5e.toml"), "{lost}");
        let scale = parse(&format!("{PLAIN}scale = 5.0\n")).expect_err("scale").to_string();
        assert_eq!(scale, "robot.toml: hand.scale: found 5, expected 0.5 to 2");
        let missing = parse("version = 1\n").expect_err("nothing").to_string();
        assert!(missing.contains("missing field `name`"), "{missing}");
    }
}
