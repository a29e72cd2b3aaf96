//! A held grasp as a scene for a second engine: the open hand around its object, what closes it, and what it then has to bear.
//!
//! `tests/mujoco/shake.py` closes and shakes it in MuJoCo.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use grasping::synthesis::held::{HeldGrasp, pose_from_array};
use hand_model::Hand;
use hand_model::file::write_whole;
use nalgebra::Vector3;
use scenarios::objects::ObjectModel;
use serde_json::json;
use sim::engine::EngineSettings;
use sim::hand_scene::Pull;
use sim::mjcf::{self, Scene};
use sim::stand::Prop;

use super::checks::{HOLD_TIME, MOST_MOTION, PULL};
use super::closing::{DAMPING, RISE, SETTLE_DAMPED, SETTLE_FREE};
use super::subject::verified_for;

/// Writes `grasp` of `object` into `folder`: an MJCF scene whose keyframe is the open hand, and a JSON file with the commands, the
/// test, and what was found here. Answers with both files.
pub fn write(hand: &Hand, object: &ObjectModel, grasp: &HeldGrasp, folder: &Path) -> Result<[PathBuf; 2]> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let name = format!("{}_{}", grasp.object, grasp.chain);
    let (scene_file, test_file) = (folder.join(format!("{name}.xml")), folder.join(format!("{name}.json")));
    let (mass, friction) = verified_for(grasp);
    let props = [(Prop::new("object", object.shape.clone(), mass, friction), pose_from_array(&grasp.start))];
    let open = Pull { tensions: [0.0; 5], opposition: grasp.opposition };
    let dt = EngineSettings::default().dt;
    let start = Some((grasp.open_joints, open));
    let scene = Scene { hand, arm: None, props: &props, start, gravity: Vector3::zeros(), dt };
    write_whole(&scene_file, mjcf::write(&scene).as_bytes())?;
    let test = json!({
        "model": scene_file.file_name().and_then(|name| name.to_str()),
        "object": grasp.object, "chain": grasp.chain, "mass": mass, "friction": friction,
        "tensions": grasp.tensions, "opposition": grasp.opposition,
        "rise": RISE, "settle_damped": SETTLE_DAMPED, "settle_free": SETTLE_FREE, "damping": DAMPING,
        "shake": { "force": PULL * mass, "time": HOLD_TIME, "most_distance": MOST_MOTION.0, "most_angle": MOST_MOTION.1 },
        "closed": { "palm_from_object": grasp.palm_from_object, "joints": grasp.joints },
    });
    write_whole(&test_file, serde_json::to_string_pretty(&test)?.as_bytes())?;
    Ok([scene_file, test_file])
}
