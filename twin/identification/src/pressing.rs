//! Aiming of presses, by a model of the robot that is refined with each press.
//!
//! The nominal model misses a ball by a good part of a pad's width. Each press is aimed with the kinematic calibration from the
//! presses before it. It begins as far before the ball as that calibration is uncertain.

use control::inverse_kinematics::Joints;
use hand_model::RobotModel;
use hand_model::robot::ArmState;
use plant::RobotIndividual;
use tactile_perception::PhotometricCalibration;

use crate::arm_load::force;
use crate::ball::{Approach, Ball, Press, approach, round, sideways};
use crate::kinematic_calibration::{KinematicCalibration, Touch, calibrate};
use crate::means::Means;
use crate::touches::{PressImages, touches};

/// Distance before the ball at which a press begins, in standard deviations of the expected contact.
const EARLY: f64 = 3.0;
/// Bounds of that distance, m.
const EARLIEST: [f64; 2] = [0.001, 0.02];
/// Number of touches up to which the calibration is repeated after every press, and number of touches between
/// repetitions after that.
const ENOUGH: (usize, usize) = (12, 6);

/// Aim of presses.
pub struct Aim<'a> {
    robot: &'a RobotModel,
    pads: &'a PhotometricCalibration,
    ball: &'a Ball,
    ready: Joints,
    touches: Vec<Touch>,
    found: KinematicCalibration,
    /// Robot model of that calibration.
    own: RobotModel,
}

impl<'a> Aim<'a> {
    /// Creates the aim of the nominal model.
    pub fn new(means: &Means<'a>, ball: &'a Ball) -> Self {
        let Means { robot, pads, ready, .. } = *means;
        let found = calibrate(robot, ball, &RobotIndividual::designed(robot), &[]);
        let own = found.individual.robot(robot);
        Self { robot, pads, ball, ready, touches: Vec::new(), found, own }
    }

    /// Returns the robot model calibrated by the presses so far.
    pub fn own(&self) -> &RobotModel {
        &self.own
    }

    /// Returns the ball.
    pub fn ball(&self) -> &'a Ball {
        self.ball
    }

    /// Plans the way from posture `from` to a press. Inverse kinematics starts from the ready posture, so that the
    /// joints do not wind up from press to press.
    pub fn at(&self, press: &Press, from: &Joints) -> Option<Approach> {
        let way = |early| approach(self.own(), self.ball, press, &self.found.ball, early, &self.ready);
        let near = way(EARLIEST[0])?;
        let unsure =
            self.found.along_normal(self.robot, self.ball, press.camera, near.way.last().unwrap_or(&self.ready));
        let approach = way((EARLY * unsure).clamp(EARLIEST[0], EARLIEST[1]))?;
        let round = round(self.own(), self.ball, &self.found.ball, [from, &approach.hover])?;
        Some(Approach { round, ..approach })
    }

    /// Plans the slide of a press's pad over the ball from the posture `at`, if it slides.
    pub fn sideways(&self, press: &Press, at: &Joints) -> Option<Vec<Joints>> {
        sideways(self.own(), self.ball, press, at)
    }

    /// True if the newest look of `camera` shows the ball deep enough in its pad.
    pub fn is_deep(&self, camera: usize, images: &PressImages) -> bool {
        let newest = images.of_look().filter(|image| image.camera == camera);
        let touch = touches(&self.robot.hand, self.pads, self.ball.radius, newest);
        touch.first().is_some_and(|touch| touch.depth(&self.robot.hand, self.ball) >= self.ball.depth)
    }

    /// Returns the magnitude of the force on the hand near the ball, N, from the arm's torques `now` compared with
    /// those `before` contact.
    pub fn force(&self, before: &ArmState, now: &ArmState) -> f64 {
        force(self.own(), [before, now], &self.found.ball).map_or(0.0, |force| force.norm())
    }

    /// Updates the calibration with the newest press.
    pub fn learn(&mut self, images: &PressImages) {
        let before = self.touches.len();
        self.touches.extend(touches(&self.robot.hand, self.pads, self.ball.radius, images.of_press()));
        let now = self.touches.len();
        if now > before && (now <= ENOUGH.0 || before / ENOUGH.1 != now / ENOUGH.1) {
            self.found = calibrate(self.robot, self.ball, &RobotIndividual::designed(self.robot), &self.touches);
            self.own = self.found.individual.robot(self.robot);
        }
    }
}
