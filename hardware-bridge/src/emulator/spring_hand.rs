//! A plant without a simulator: six servos on springs, an arm that follows its set-points exactly, and images of spots.
//!
//! It is a [`Plant`] and can replace the simulated one. Each servo winds against a spring between two hard stops;
//! without current the spring unwinds it to the open mark.

use crate::supported_robot::SERVOS;
use std::sync::Arc;

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{
    ArmState, Observation, Plant, RobotCommand, ServoGoal, ServoState, TactileFrame, TactileImage, Tick,
};
use kinova_kortex::joints::JOINTS;

/// Length of a tick, s.
const TICK: f64 = 1.0 / 240.0;
/// Current that balances the spring: at the open mark, A, and per rad of closing, A/rad.
const PRELOAD: f64 = 0.01;
const STIFFNESS: f64 = 0.04;
/// Speed per unbalanced current, rad/s per A, and top speed, rad/s.
const MOBILITY: f64 = 30.0;
const NO_LOAD_SPEED: f64 = 6.8;
/// Position gain of current-based position control, A/rad.
const POSITION_GAIN: f64 = 6.0;

/// Six servos on springs.
#[derive(Debug, Clone)]
pub struct SpringHand {
    /// Angle of the closing stop of each shaft, rad; the opening stop is at 0.
    travel: [f64; SERVOS],
    /// Number of cameras.
    cameras: usize,
    servos: [ServoState; SERVOS],
    command: Option<RobotCommand>,
    arm: ArmState,
    sequence: u64,
    images: u64,
    frames: Vec<TactileFrame>,
}

impl SpringHand {
    /// Creates an open hand with `cameras` cameras, whose shafts stop at `travel`, rad.
    pub fn new(travel: [f64; SERVOS], cameras: usize) -> Self {
        Self {
            travel,
            cameras,
            servos: [ServoState::default(); SERVOS],
            command: None,
            arm: ArmState::at_rest([0.0; JOINTS].into()),
            sequence: 0,
            images: 0,
            frames: Vec::new(),
        }
    }

    fn step_servo(&mut self, n: usize, goal: ServoGoal) {
        let angle = self.servos[n].position;
        let current = match goal {
            ServoGoal::Current(current) => current,
            ServoGoal::Position { angle: goal, current_limit } => {
                (POSITION_GAIN * (goal - angle)).clamp(-current_limit, current_limit)
            }
        };
        let unbalanced = current - PRELOAD - STIFFNESS * angle;
        let speed = (MOBILITY * unbalanced).clamp(-NO_LOAD_SPEED, NO_LOAD_SPEED);
        let next = (angle + speed * TICK).clamp(0.0, self.travel[n]);
        self.servos[n] = ServoState { position: next, velocity: (next - angle) / TICK, current, temperature: 28.0 };
    }

    /// Takes an image with each camera: a spot whose brightness grows with its servo's current.
    fn take_images(&mut self) {
        self.images += 1;
        let time = self.sequence as f64 * TICK;
        self.frames = (0..self.cameras)
            .map(|camera| {
                let current = self.servos[camera % SERVOS].current.abs();
                let image = Arc::new(TactileImage { rgb: spot(40.0 + 400.0 * current, 20 + camera) });
                TactileFrame { camera, time, sequence: self.images, image }
            })
            .collect();
    }
}

fn spot(brightness: f64, radius: usize) -> Vec<u8> {
    let center = IMAGE_SIZE / 2;
    let value = brightness.clamp(0.0, 255.0) as u8;
    let mut rgb = Vec::with_capacity(3 * IMAGE_SIZE * IMAGE_SIZE);
    for row in 0..IMAGE_SIZE {
        for column in 0..IMAGE_SIZE {
            let inside = row.abs_diff(center).pow(2) + column.abs_diff(center).pow(2) < radius.pow(2);
            rgb.extend_from_slice(&if inside { [value; 3] } else { [60, 50, 40] });
        }
    }
    rgb
}

impl Plant for SpringHand {
    fn observe(&mut self) -> Observation {
        Observation {
            time: self.sequence as f64 * TICK,
            sequence: self.sequence,
            servos: self.servos.into(),
            arm: self.arm,
            tactile: std::mem::take(&mut self.frames),
        }
    }

    fn send(&mut self, command: &RobotCommand) -> RobotCommand {
        self.command = Some(*command);
        *command
    }

    fn wait_for_tick(&mut self) -> Tick {
        let command = self.command;
        for n in 0..SERVOS {
            self.step_servo(n, command.map_or(ServoGoal::Current(0.0), |command| command.servos[n]));
        }
        if let Some(command) = &mut self.command {
            self.arm.position = command.arm;
            if std::mem::take(&mut command.capture) {
                self.take_images();
            }
        }
        self.sequence += 1;
        Tick { time: self.sequence as f64 * TICK, lateness: 0.0 }
    }

    fn tick_length(&self) -> f64 {
        TICK
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(hand: &mut SpringHand, goal: ServoGoal, ticks: usize) -> ServoState {
        let command = RobotCommand { arm: [0.0; 7].into(), servos: [goal; SERVOS].into(), capture: false };
        for _ in 0..ticks {
            hand.send(&command);
            hand.wait_for_tick();
        }
        hand.observe().servos[0]
    }

    /// Current balances the spring where it should; stops hold; without current the hand opens.
    #[test]
    fn springs_and_stops() {
        let mut hand = SpringHand::new([4.0; SERVOS], 3);
        let state = run(&mut hand, ServoGoal::Current(0.05), 2000);
        assert!((state.position - (0.05 - PRELOAD) / STIFFNESS).abs() < 1e-3, "{state:?}");
        assert_eq!(run(&mut hand, ServoGoal::Current(0.5), 2000).position, 4.0);
        assert_eq!(run(&mut hand, ServoGoal::Current(0.0), 4000).position, 0.0);
    }

    #[test]
    fn images_only_when_asked() {
        let mut hand = SpringHand::new([4.0; SERVOS], 3);
        run(&mut hand, ServoGoal::Current(0.0), 3);
        assert!(hand.observe().tactile.is_empty());
        let command =
            RobotCommand { arm: [0.0; 7].into(), servos: [ServoGoal::Current(0.0); SERVOS].into(), capture: true };
        hand.send(&command);
        hand.wait_for_tick();
        assert_eq!(hand.observe().tactile.len(), 3);
    }
}
