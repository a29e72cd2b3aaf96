//! A robot of your own behind `RobotBackend`: two servos that follow their goals with a lag, and a controller that
//! closes them until their currents rise.
//!
//! `cargo run -p hand-model --example backend`. Replace `ToyGripper` by calls to your driver or your simulator.

use std::error::Error;

use hand_model::ActuatorVector;
use hand_model::robot::{
    Observation, Readings, RobotBackend, RobotCommand, RobotDevice, RobotError, ServoGoal, ServoState, Tick,
};

/// Length of a tick, s.
const TICK: f64 = 0.01;
/// Angle at which the toy object stops the servos, rad.
const OBJECT: f64 = 0.6;
/// Current per angle by which a blocked servo is behind its goal, A/rad.
const GAIN: f64 = 2.0;

/// Two servos that close on an object. Its bus answers from the third tick on.
#[derive(Default)]
struct ToyGripper {
    ticks: u64,
    servos: [ServoState; 2],
    goals: [f64; 2],
}

impl RobotBackend for ToyGripper {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        if self.ticks < 3 {
            return Err(RobotError::Unread(RobotDevice::Servo(0)));
        }
        // No arm and no cameras here: the arm's state is empty and no images arrive.
        let servos = self.servos.into_iter().collect();
        let time = self.ticks as f64 * TICK;
        Ok(Observation { time, sequence: self.ticks, servos, ..Observation::default() }.into())
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        // Angles are limited to 1 rad. The returned command is the one that the servos got.
        let limit = |goal: &ServoGoal| match *goal {
            ServoGoal::Position { angle, current_limit } => {
                ServoGoal::Position { angle: angle.clamp(0.0, 1.0), current_limit }
            }
            current => current,
        };
        let sent = RobotCommand { servos: command.servos.iter().map(limit).collect(), ..*command };
        for (own, goal) in self.goals.iter_mut().zip(&sent.servos) {
            if let ServoGoal::Position { angle, .. } = goal {
                *own = *angle;
            }
        }
        Ok(sent)
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.ticks += 1;
        for (servo, goal) in self.servos.iter_mut().zip(self.goals) {
            let next = (servo.position + 0.2 * (goal - servo.position)).min(OBJECT);
            let velocity = (next - servo.position) / TICK;
            *servo = ServoState { position: next, velocity, current: GAIN * (goal - next), temperature: 30.0 };
        }
        Tick { time: self.ticks as f64 * TICK, lateness: 0.0 }
    }

    fn tick_length(&self) -> f64 {
        TICK
    }
}

/// Closes the servos at 1 rad/s until each has a current of 0.2 A or more; returns their angles. It works with any
/// backend.
fn close(robot: &mut impl RobotBackend) -> Result<ActuatorVector, Box<dyn Error>> {
    let mut goal = 0.0;
    for _ in 0..500 {
        match robot.observe().and_then(Readings::into_observation) {
            Ok(seen) => {
                if seen.servos.iter().all(|servo| servo.current > 0.2 && servo.velocity.abs() < 0.05) {
                    return Ok(seen.servos.iter().map(|servo| servo.position).collect());
                }
                goal += robot.tick_length();
                let goal = ServoGoal::Position { angle: goal, current_limit: 0.5 };
                let servos = seen.servos.iter().map(|_| goal).collect();
                let command = RobotCommand { servos, ..RobotCommand::default() };
                let sent = robot.send(&command)?;
                if sent != command {
                    println!("the robot limited a command to {:?}", sent.servos);
                }
            }
            // Without a complete set of readings, the controller holds.
            Err(error) => println!("no observation: {error}"),
        }
        robot.wait_for_tick();
    }
    Err("nothing was grasped within 500 ticks".into())
}

fn main() -> Result<(), Box<dyn Error>> {
    let angles = close(&mut ToyGripper::default())?;
    println!("grasped at {angles:.3?} rad");
    Ok(())
}
