//! Export of a held grasp as a scene for a second engine: the open hand around its object, the commands that close it,
//! and the load in the test.
//!
//! `tests/mujoco/shake.py` closes and shakes it in MuJoCo.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use dexterous_grasping::synthesis::held::{HeldGrasp, pose_from_array};
use ftac_platform::file::write_atomically;
use nalgebra::Vector3;
use serde_json::{Value, json};
use sim::engine::EngineSettings;
use sim::hand_scene::TensionCommand;
use sim::mjcf::{self, MjcfScene};
use sim::test_stand::Prop;
use world::objects::ObjectModel;

use super::checks::{HOLD_TIME, MAX_MOTION, TEST_ACCELERATION};
use super::closing::{DAMPED_SETTLING_TIME, FREE_SETTLING_TIME, OBJECT_DAMPING, RISE_TIME};
use super::grasping_hand::GraspingHand;
use super::subject::verified_for;

/// Writes `grasp` of `object` into `folder`: an MJCF scene whose keyframe is the open hand, and a JSON file with the
/// commands, the test and the results found here. The object has the mass and friction of the grasp's verification,
/// whatever its own are. Returns the paths of both files.
pub fn write(hand: &GraspingHand, object: &ObjectModel, grasp: &HeldGrasp, folder: &Path) -> Result<[PathBuf; 2]> {
    let (mass, friction) = verified_for(grasp);
    let props = [(Prop::new("object", object.shape.clone(), mass, friction), pose_from_array(&grasp.start))];
    let slack = || vec![0.0; grasp.tensions.len()];
    let open = TensionCommand {
        tensions: grasp.open_tensions.as_ref().map_or_else(slack, |tensions| tensions.to_vec()),
        opposition: grasp.opposition.unwrap_or_default(),
    };
    let scene = mjcf::write(&MjcfScene {
        hand: &hand.body,
        arm: None,
        props: &props,
        start: Some((&grasp.open_joints, &open)),
        gravity: Vector3::zeros(),
        dt: EngineSettings::default().dt,
    });
    // Commands for the second engine, and the limits on the object's motion. SI units.
    let mut test = json!({
        "object": grasp.object, "chain": grasp.chain, "mass": mass, "friction": friction,
        "rise": RISE_TIME, "settle_damped": DAMPED_SETTLING_TIME, "settle_free": FREE_SETTLING_TIME, "damping": OBJECT_DAMPING,
        "shake": { "force": TEST_ACCELERATION * mass, "time": HOLD_TIME, "most_distance": MAX_MOTION.0, "most_angle": MAX_MOTION.1 },
        "hand": hand.name(), "open_tensions": open.tensions, "tensions": *grasp.tensions,
        "closed": { "object": *grasp.closed, "joints": *grasp.joints },
    });
    if let Some(opposition) = grasp.opposition {
        test["opposition"] = json!(opposition);
    }
    let mut name = format!("{}_{}", grasp.object, grasp.chain);
    if hand.named_hand.is_none() {
        name = format!("{}_{name}", hand.name());
    }
    files(folder, &name, &scene, test)
}

/// Writes a scene and its test.
fn files(folder: &Path, name: &str, scene: &str, mut test: Value) -> Result<[PathBuf; 2]> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let plain = name.replace(|c: char| !c.is_ascii_alphanumeric() && c != '-', "_");
    let (scene_file, test_file) = (folder.join(format!("{plain}.xml")), folder.join(format!("{plain}.json")));
    test["model"] = json!(scene_file.file_name().and_then(|name| name.to_str()));
    write_atomically(&scene_file, scene.as_bytes())?;
    write_atomically(&test_file, serde_json::to_string_pretty(&test)?.as_bytes())?;
    Ok([scene_file, test_file])
}
