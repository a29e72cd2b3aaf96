//! The twin itself: the simulated robot as the controller knows it, moved by the same commands and kept beside the robot by its measurements.
//!
//! It is an observer in the sense of Luenberger. Before each tick its servos are put where the robot's were measured; then both get the same
//! command. By how much the robot's spools are faster a tick later than the twin's is the innovation: multiplied by the rotor's inertia over the
//! tick it is the torque that acted on the robot's spool and not on the twin's. The twin touches nothing, so that of a sound robot
//! this is what contact does to a digit: a load, never a pull. Finger joints have no encoders; the twin's go where cables, springs and weight
//! take them. The arm follows its own position control; what its motors give beyond the twin's is what loads the robot's. Of a robot that is seen at
//! uneven times that is what they give beyond all that the twin's gave within [`LAG`]: each set-point reaches the robot some ticks earlier or later.

use std::collections::VecDeque;
use std::sync::Arc;

use hand_model::robot::{ArmState, Command, ServoState};
use hand_model::{Arm, ArmVector, DigitVector, Hand};
use nalgebra::Isometry3;
use proving::simulated_world::World;
use sim::tactile::TactileBoard;
use sim::{SceneSetup, SimulatedRobot};

/// What the robot did in a tick that the twin did not.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Innovation {
    /// Load of each cable beyond the twin's, at the spool, N: positive holds the digit open, as a contact does.
    pub loads: DigitVector,
    /// Torque on the opposition servo beyond the twin's, N m at its output.
    pub opposition: f64,
    /// Cable tensions of the twin, N.
    pub tensions: DigitVector,
    /// Torques that the arm's joints bear less the twin's, N m.
    pub arm_torque: ArmVector,
}

/// The simulated robot that the controller believes to drive.
#[derive(Clone)]
pub struct Twin {
    robot: SimulatedRobot,
    hand: Arc<Hand>,
    arm: Arc<Arm>,
    tick: f64,
    /// Torques of its arm in the newest ticks, N m, the newest last.
    torques: VecDeque<ArmVector>,
}

/// A robot in real time does what the twin did within so many ticks: a servo cycle, the arm's network, and a tick of either side.
const LAG: usize = 6;

impl Twin {
    /// Hand, arm, base and cables as the controller of `world` knows them, the arm at rest where it was measured (rad).
    pub fn new(world: &World, arm: &ArmVector) -> Self {
        let cell = &world.cell;
        let setup = SceneSetup { cables: world.known_cable_losses(), ..SceneSetup::ideal(cell.world_from_base, *arm) };
        let robot = SimulatedRobot::new(&cell.robot, &setup, TactileBoard::blank());
        let tick = robot.tick_length();
        Self { robot, hand: cell.robot.hand.clone(), arm: cell.robot.arm.clone(), tick, torques: VecDeque::new() }
    }

    /// Takes what was measured at the end of a tick, of a robot that is seen at uneven times if `late`; what the robot did in it that the twin did not.
    pub fn correct(&mut self, servos: &[ServoState], arm: &ArmState, late: bool) -> Innovation {
        let own = self.robot.observe();
        self.torques.push_back(own.arm.torque);
        while self.torques.len() > if late { LAG } else { 1 } {
            self.torques.pop_front();
        }
        let given = |n: usize| {
            let all = self.torques.iter().map(|torques| torques[n]);
            let (least, most) = all.fold((f64::MAX, f64::MIN), |(a, b), torque| (a.min(torque), b.max(torque)));
            arm.torque[n].clamp(least, most)
        };
        let torque = |n: usize| {
            let faster = servos[n].velocity - own.servos[n].velocity;
            -self.hand.servos[n].rotor_inertia * faster / self.tick
        };
        let innovation = Innovation {
            loads: self.hand.each_digit(|n| torque(n) / self.hand.cables[n].spool_radius),
            opposition: torque(self.hand.servos.len() - 1),
            tensions: self.robot.tensions().iter().copied().collect(),
            arm_torque: self.arm.borne(&self.arm.each(|n| arm.torque[n] - given(n))),
        };
        self.robot.follow_servos(servos);
        innovation
    }

    /// Length of a tick, s.
    pub fn tick_length(&self) -> f64 {
        self.tick
    }

    /// `world_from_palm` of the twin.
    pub fn palm(&self) -> Isometry3<f64> {
        self.robot.truth().palm
    }

    /// `world_from_link` of the twin's arm and of its hand.
    pub fn links(&self) -> [Vec<Isometry3<f64>>; 2] {
        let truth = self.robot.truth();
        [truth.arm_links, truth.hand_links]
    }

    /// The next tick, with what was sent last.
    pub fn go_on(&mut self) {
        self.robot.wait_for_tick();
    }

    /// The next tick, with what was sent to the robot.
    pub fn follow(&mut self, sent: &Command) {
        self.robot.send(&Command { capture: false, ..*sent });
        self.robot.wait_for_tick();
    }
}
