//! The reference model: the simulated robot as modelled in the controller, moved by the same commands and corrected by
//! the robot's measurements.
//!
//! It is a Luenberger observer. Before each tick its servos are set to the measured positions of the robot's servos;
//! then both get the same command. The innovation is the difference in spool speed between robot and model one tick
//! later. Multiplied by the rotor's inertia over the tick, it is the torque that acted on the robot's spool and not on
//! the model's. The model touches nothing. On a sound robot the innovation is therefore the effect of contact on a
//! digit: a load, never a pull. Finger joints have no encoders; those of the model are moved by cables, springs and
//! weight. The arm follows its own position control, and the torque of its motors beyond the model's is the load on the
//! robot's arm. For a robot observed at uneven times, only the torque outside the range of the model's torques within
//! [`MAX_LAG_TICKS`] counts as load, since each set-point reaches the robot some ticks earlier or later.

use std::collections::VecDeque;
use std::sync::Arc;

use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::robot::{ArmState, RobotCommand, ServoState};
use hand_model::{Arm, ArmVector, DigitVector, Hand};
use nalgebra::Isometry3;
use sim::tactile::TactileBoard;
use sim::{SceneSetup, SimulatedRobot};

/// Innovation: the robot's motion in a tick beyond the model's, as loads.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Innovation {
    /// Load of each cable beyond the model's, at the spool, N. A positive load holds the digit open, as a contact does.
    pub loads: DigitVector,
    /// Torque on the opposition servo beyond the model's, N m at its output.
    pub opposition: f64,
    /// Cable tensions of the reference model, N.
    pub tensions: DigitVector,
    /// Torques of the arm's joints less the model's, N m.
    pub arm_torque: ArmVector,
}

/// The simulated robot as modelled in the controller.
#[derive(Clone)]
pub struct ReferenceModel {
    robot: SimulatedRobot,
    hand: Arc<Hand>,
    arm: Arc<Arm>,
    tick: f64,
    /// Torques of the model's arm in the newest ticks, N m, newest last.
    torques: VecDeque<ArmVector>,
}

/// Largest delay of a robot in real time behind the reference model, ticks: a servo cycle, the arm's network, and a
/// tick on either side.
const MAX_LAG_TICKS: usize = 6;

impl ReferenceModel {
    /// Creates the reference model with hand, arm, base and cables from the controller's `world`, the arm at rest at
    /// the measured angles `arm` (rad).
    pub fn new(world: &SimulatedWorld, arm: &ArmVector) -> Self {
        let cell = &world.cell;
        let setup = SceneSetup { cables: world.known_cable_losses(), ..SceneSetup::ideal(cell.world_from_base, *arm) };
        let robot = SimulatedRobot::new(&cell.robot, &setup, TactileBoard::blank());
        let tick = robot.tick_length();
        Self { robot, hand: cell.robot.hand.clone(), arm: cell.robot.arm.clone(), tick, torques: VecDeque::new() }
    }

    /// Corrects the reference model by the measurements at the end of a tick; `late` is true if the robot is observed
    /// at uneven times. Returns the innovation of the tick.
    pub fn correct(&mut self, servos: &[ServoState], arm: &ArmState, late: bool) -> Innovation {
        let own = self.robot.observe();
        self.torques.push_back(own.arm.torque);
        while self.torques.len() > if late { MAX_LAG_TICKS } else { 1 } {
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
            arm_torque: self.arm.true_torques(&self.arm.each(|n| arm.torque[n] - given(n))),
        };
        self.robot.follow_servos(servos);
        innovation
    }

    /// Returns the length of a tick, s.
    pub fn tick_length(&self) -> f64 {
        self.tick
    }

    /// Returns `world_from_palm` of the reference model.
    pub fn palm(&self) -> Isometry3<f64> {
        self.robot.truth().palm
    }

    /// Returns `world_from_link` of the model's arm links, and of its hand links.
    pub fn links(&self) -> [Vec<Isometry3<f64>>; 2] {
        let truth = self.robot.truth();
        [truth.arm_links, truth.hand_links]
    }

    /// Runs the next tick with the last command.
    pub fn advance(&mut self) {
        self.robot.wait_for_tick();
    }

    /// Runs the next tick with the command sent to the robot.
    pub fn advance_with(&mut self, sent: &RobotCommand) {
        self.robot.send(&RobotCommand { capture: false, ..*sent });
        self.robot.wait_for_tick();
    }
}
