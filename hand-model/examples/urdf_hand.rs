//! Reads a hand from its URDF and its actuation file, and prints its joints, its actuators and their efforts
//! in the open hand.
//!
//! `cargo run -p hand-model --example urdf_hand` reads a gripper with two fingers that is part of this program, and
//! with `-- HAND.urdf ACTUATION.toml` a hand of your own. Collision meshes of the URDF are refused here; pass functions
//! that read and decompose them as `MeshTools`.

use std::error::Error;
use std::path::Path;

use hand_model::hand_mechanism::HandMechanism;
use hand_model::urdf_hand::MeshTools;

const URDF: &str = r#"
<robot name="gripper">
  <link name="palm"/>
  <link name="left">
    <inertial><mass value="0.05"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
    <collision><origin xyz="0.03 0 0"/><geometry><box size="0.06 0.01 0.02"/></geometry></collision>
  </link>
  <link name="right">
    <inertial><mass value="0.05"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
    <collision><origin xyz="0.03 0 0"/><geometry><box size="0.06 0.01 0.02"/></geometry></collision>
  </link>
  <joint name="left_joint" type="revolute"><parent link="palm"/><child link="left"/>
    <origin xyz="0 0.03 0"/><axis xyz="0 0 -1"/><limit lower="0" upper="0.6" effort="2" velocity="3"/></joint>
  <joint name="right_joint" type="revolute"><parent link="palm"/><child link="right"/>
    <origin xyz="0 -0.03 0"/><axis xyz="0 0 1"/><limit lower="0" upper="0.6" effort="2" velocity="3"/></joint>
</robot>"#;

const ACTUATION: &str = r#"
version = 1
damping = 0.01      # N m s/rad
armature = 1e-4     # kg m2
spring = 0.02       # N m/rad

[[actuator]]
name = "close"
arms = { left_joint = 0.01, right_joint = 0.01 }    # m
"#;

/// Tension for which efforts are printed, N.
const TENSION: f64 = 50.0;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let hand = match arguments.as_slice() {
        [] => HandMechanism::parse(
            URDF,
            Path::new("gripper.urdf"),
            ACTUATION,
            Path::new("gripper.toml"),
            MeshTools::NONE,
        )?,
        [urdf, actuation] => HandMechanism::read(Path::new(urdf), Path::new(actuation), MeshTools::NONE)?,
        _ => return Err("expected no arguments, or HAND.urdf ACTUATION.toml".into()),
    };

    println!("{}: {} joints, {} collision shapes", hand.name, hand.tree.len(), hand.solids.len());
    for (joint, effort) in hand.tree.joints.iter().zip(&hand.effort_limits) {
        let unit = joint.kind.unit();
        let effort = effort.map_or("unknown".to_owned(), |effort| format!("{effort} {}", joint.kind.effort_unit()));
        println!("  {}: {:.3} to {:.3} {unit}, effort limit {effort}", joint.name, joint.lower, joint.upper);
    }
    for actuator in &hand.actuators {
        let joints: Vec<&str> =
            actuator.moment_arms().map(|(joint, _)| hand.tree.joints[joint].name.as_str()).collect();
        let limit = actuator
            .max_tension
            .as_ref()
            .map_or("no known limit".to_owned(), |(most, source)| format!("at most {most:.0} N, because of {source}"));
        println!("  actuator {} pulls {}: {limit}", actuator.name, joints.join(", "));
    }
    hand.notes.iter().for_each(|note| println!("  note: {note}"));

    let (tensions, reduced) = hand.limit_tensions(&vec![TENSION; hand.actuators.len()]);
    println!("tensions of {TENSION} N, {} of them reduced to a limit; efforts in the open hand:", reduced.len());
    let open = hand.rest_coordinates();
    for (joint, effort) in hand.tree.joints.iter().zip(hand.torques(&open, &tensions)) {
        println!("  {}: {effort:.3} {}", joint.name, joint.kind.effort_unit());
    }
    Ok(())
}
