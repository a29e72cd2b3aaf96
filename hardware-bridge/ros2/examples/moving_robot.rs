//! Publishes the built-in robot, whose arm and fingers move, with tactile images of every camera: something to look at in
//! RViz, and a measurement of the rate.
//!
//! `cargo run --release -p robot-ros2 --example moving_robot -- DOMAIN [ADDRESS [SECONDS [IMAGES_PER_SECOND]]]`

use std::net::IpAddr;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use hand_model::RobotModel;
use hand_model::nalgebra::Isometry3;
use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{
    ArmState, Observation, Readings, RobotCommand, ServoGoal, ServoState, TactileFrame, TactileImage,
};
use robot_ros2::{RobotPublisher, Ros2Node};

/// Time between two messages.
const TICK: Duration = Duration::from_millis(10);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let domain: u16 = arguments.next().map_or(Ok(0), |text| text.parse())?;
    let address: Option<IpAddr> = arguments.next().map(|text| text.parse()).transpose()?;
    let seconds: f64 = arguments.next().map_or(Ok(60.0), |text| text.parse())?;
    let rate: f64 = arguments.next().map_or(Ok(10.0), |text| text.parse())?;

    let robot = RobotModel::ftac_gen3();
    let node = Ros2Node::new(domain, address)?;
    let now = || SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let mut publisher = RobotPublisher::new(&node, &robot, &Isometry3::identity(), now())?;
    println!("subscriber found: {}", publisher.wait_for_subscriber(Duration::from_secs(20)));
    let (start, mut images, mut sequence) = (Instant::now(), 0_u64, 0_u64);
    for tick in 1.. {
        let time = start.elapsed().as_secs_f64();
        if time > seconds {
            break;
        }
        let swing = 0.3 * time.sin();
        let mut seen = Observation { time, sequence: tick, ..Observation::default() };
        seen.arm = ArmState::at_rest(robot.arm.home.iter().map(|angle| angle + swing).collect());
        seen.servos = robot.hand.each_actuator(|_| ServoState { position: swing, ..ServoState::default() });
        if images as f64 <= time * rate {
            images += 1;
            sequence += 1;
            // Every camera has a colour of its own, and every image a different one.
            let image = |camera: usize| {
                let pixel = [10 * camera as u8, (images % 256) as u8, 128];
                Arc::new(TactileImage { rgb: pixel.repeat(IMAGE_SIZE * IMAGE_SIZE) })
            };
            let frame = |camera| TactileFrame { camera, time, sequence, image: image(camera) };
            seen.tactile = (0..robot.hand.cameras.len()).map(frame).collect();
        }
        let fingers: Vec<f64> = robot.hand.open_angles().iter().map(|angle| angle + 0.5 + swing).collect();
        let servos = robot.hand.each_actuator(|_| ServoGoal::Position { angle: swing, current_limit: 0.1 });
        publisher.send_command(now(), &RobotCommand { arm: seen.arm.position, servos, capture: false })?;
        publisher.send_readings(now(), &Readings::from(seen), Some(&fingers))?;
        std::thread::sleep((TICK * tick as u32).saturating_sub(start.elapsed()));
    }
    publisher.flush(Duration::from_secs(2));
    let cameras = robot.hand.cameras.len() as u64;
    println!(
        "{} images of {cameras} cameras in {seconds} s, {} messages left out",
        images * cameras,
        publisher.unsent()
    );
    Ok(())
}
