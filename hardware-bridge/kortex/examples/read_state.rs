//! Reads everything that an arm reports without moving: devices, state, faults, joint angles and torques.
//!
//! `cargo run -p kinova-kortex --features emulator --example read_state` reads an emulated arm, and with `-- ADDRESS USER
//! PASSWORD` a real one.

use std::error::Error;

use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
use kinova_kortex::message::action::ActionType;
use kinova_kortex::{Address, Arm, Credentials, Timeouts, gen3};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.as_slice() {
        [] => {
            let settings = Settings::default();
            let credentials = settings.credentials.clone();
            let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::RealTime)?;
            read(emulator.address(), &credentials)
        }
        [host, user, password] => {
            let credentials = Credentials { user: user.clone(), password: password.clone() };
            read(Address::of(host.parse()?), &credentials)
        }
        _ => Err("expected no arguments, or ADDRESS USER PASSWORD".into()),
    }
}

fn read(address: Address, credentials: &Credentials) -> Result<(), Box<dyn Error>> {
    let mut arm = Arm::connect(address, credentials, Timeouts::default(), gen3::HOME)?;
    for device in arm.base.devices()? {
        let serial = arm.base.serial_number(device.address)?;
        println!("device {:3}: {:?}, serial number {serial}", device.address, device.kind);
    }
    println!("state: {:?}, servoing mode {:?}", arm.base.arm_state()?, arm.base.servoing_mode()?);
    for action in arm.base.actions(ActionType::Unspecified)? {
        println!("action {}: {} ({:?})", action.id, action.name, action.kind);
    }
    let feedback = arm.cyclic.feedback()?;
    println!("faults: {}; warnings: {}", feedback.faults, feedback.warnings);
    let motion = feedback.motion;
    for (joint, (angle, torque)) in (1..).zip(motion.position.iter().zip(motion.torque)) {
        println!("joint {joint}: {:8.2} degrees, {torque:6.2} N m", angle.to_degrees());
    }
    arm.close()?;
    Ok(())
}
