//! Writes a joint state as CDR, prints its bytes, and reads it back.
//!
//! `cargo run -p robot-ros2-messages --example joint_state`

use std::time::Duration;

use robot_ros2_messages::names::{dds_topic, dds_type};
use robot_ros2_messages::{Header, JointState, Message};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let state = JointState {
        header: Header::new(Duration::from_secs(1), ""),
        name: vec!["left_finger".to_owned(), "right_finger".to_owned()],
        position: vec![0.25, -0.25],
        velocity: vec![0.0, 0.0],
        effort: vec![],
    };
    let bytes = state.to_cdr();
    println!("{} on {}: {} bytes", dds_type(JointState::NAME), dds_topic("/joint_states")?, bytes.len());
    for row in bytes.chunks(16) {
        println!("{}", row.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" "));
    }
    println!("{:?}", JointState::from_cdr(&bytes)?);
    Ok(())
}
