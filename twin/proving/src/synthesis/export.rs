//! A held grasp as a scene for a second engine: the open hand around its object, what closes it, and what it then has to bear.
//!
//! `tests/mujoco/shake.py` closes and shakes it in MuJoCo.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use grasping::synthesis::held::{HeldGrasp, pose_from_array};
use hand_model::Hand;
use nalgebra::Vector3;
use platform::file::write_whole;
use serde_json::{Value, json};
use sim::engine::EngineSettings;
use sim::hand_scene::Pull;
use sim::mjcf::{self, Scene, UrdfScene};
use sim::stand::Prop;
use world::objects::ObjectModel;

use super::checks::{HOLD_TIME, MOST_MOTION, PULL};
use super::closing::{DAMPING, RISE, SETTLE_DAMPED, SETTLE_FREE};
use super::subject::verified_for;
use super::urdf_hand::describe::Described;

/// Writes `grasp` of `object` into `folder`: an MJCF scene whose keyframe is the open hand, and a JSON file with the commands, the
/// test, and what was found here. Answers with both files.
pub fn write(hand: &Hand, object: &ObjectModel, grasp: &HeldGrasp, folder: &Path) -> Result<[PathBuf; 2]> {
    let load = verified_for(grasp);
    let props = [(Prop::new("object", object.shape.clone(), load.0, load.1), pose_from_array(&grasp.start))];
    let open = Pull { tensions: vec![0.0; grasp.tensions.len()], opposition: grasp.opposition.unwrap_or_default() };
    let dt = EngineSettings::default().dt;
    let start = Some((grasp.open_joints.iter().copied().collect(), open.clone()));
    let scene = mjcf::write(&Scene { hand, arm: None, props: &props, start, gravity: Vector3::zeros(), dt });
    let mut test = test(&grasp.object, grasp.chain, load);
    test["open_tensions"] = json!(open.tensions);
    test["tensions"] = json!(*grasp.tensions);
    test["opposition"] = json!(open.opposition);
    test["closed"] = json!({ "object": *grasp.closed, "joints": *grasp.joints });
    files(folder, &format!("{}_{}", grasp.object, grasp.chain), &scene, test)
}

/// The same for a hand from a URDF; `object` has the mass and friction of the grasp's proof in the scene, whatever its own are.
pub fn write_urdf(hand: &Described, object: &ObjectModel, grasp: &HeldGrasp, folder: &Path) -> Result<[PathBuf; 2]> {
    let load = verified_for(grasp);
    let props = [(Prop::new("object", object.shape.clone(), load.0, load.1), pose_from_array(&grasp.start))];
    let (joints, open) = (&*grasp.open_joints, grasp.open_tensions.as_deref().unwrap_or_default());
    let dt = EngineSettings::default().dt;
    let scene = mjcf::write_urdf(&UrdfScene { body: &hand.body, props: &props, start: (joints, open), dt });
    let mut test = test(&grasp.object, grasp.chain, load);
    test["hand"] = json!(hand.hand.name);
    test["open_tensions"] = json!(open);
    test["tensions"] = json!(*grasp.tensions);
    test["closed"] = json!({ "object": *grasp.closed, "joints": *grasp.joints });
    files(folder, &format!("{}_{}_{}", hand.hand.name, grasp.object, grasp.chain), &scene, test)
}

/// What a second engine has to do, and how much the object may move; SI units.
fn test(object: &str, chain: u64, (mass, friction): (f64, f64)) -> Value {
    json!({
        "object": object, "chain": chain, "mass": mass, "friction": friction,
        "rise": RISE, "settle_damped": SETTLE_DAMPED, "settle_free": SETTLE_FREE, "damping": DAMPING,
        "shake": { "force": PULL * mass, "time": HOLD_TIME, "most_distance": MOST_MOTION.0, "most_angle": MOST_MOTION.1 },
    })
}

/// Writes a scene and its test.
fn files(folder: &Path, name: &str, scene: &str, mut test: Value) -> Result<[PathBuf; 2]> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let plain = name.replace(|c: char| !c.is_ascii_alphanumeric() && c != '-', "_");
    let (scene_file, test_file) = (folder.join(format!("{plain}.xml")), folder.join(format!("{plain}.json")));
    test["model"] = json!(scene_file.file_name().and_then(|name| name.to_str()));
    write_whole(&scene_file, scene.as_bytes())?;
    write_whole(&test_file, serde_json::to_string_pretty(&test)?.as_bytes())?;
    Ok([scene_file, test_file])
}
