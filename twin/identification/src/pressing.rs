//! Where to press: by the robot as its presses so far show it.
//!
//! A robot as drawn misses a ball by a good part of a pad's width. Each press is aimed with the kinematic calibration of those before it, and
//! begins as far before the ball as that is unsure.

use control::inverse_kinematics::Joints;
use hand_model::RobotModel;
use hand_model::robot::ArmState;
use plant::RobotIndividual;
use touch::PhotometricCalibration;

use crate::arm_load::force;
use crate::ball::{Approach, Ball, Press, approach, round, sideways};
use crate::kinematic_calibration::{KinematicCalibration, Touch, calibrate};
use crate::means::Means;
use crate::touches::{PressImages, touches};

/// How far before the ball a press begins, in standard deviations of where it is felt, ...
const EARLY: f64 = 3.0;
/// ... and between these, m.
const EARLIEST: [f64; 2] = [0.001, 0.02];
/// With so many touches the aim is as good as it needs to be; it is found again after every so many.
const ENOUGH: (usize, usize) = (12, 6);

/// What presses are aimed by.
pub struct Aim<'a> {
    robot: &'a RobotModel,
    pads: &'a PhotometricCalibration,
    ball: &'a Ball,
    ready: Joints,
    touches: Vec<Touch>,
    found: KinematicCalibration,
    /// The robot that it describes.
    own: RobotModel,
}

impl<'a> Aim<'a> {
    /// By the drawing.
    pub fn new(means: &Means<'a>, ball: &'a Ball) -> Self {
        let Means { robot, pads, ready, .. } = *means;
        let found = calibrate(robot, ball, &RobotIndividual::designed(robot), &[]);
        let own = found.individual.robot(robot);
        Self { robot, pads, ball, ready, touches: Vec::new(), found, own }
    }

    /// The robot as its presses so far show it.
    pub fn own(&self) -> &RobotModel {
        &self.own
    }

    /// The ball.
    pub fn ball(&self) -> &'a Ball {
        self.ball
    }

    /// The way `from` where the arm is to a press, with the arm bent as in its ready posture: from press to press its joints do not wind up.
    pub fn at(&self, press: &Press, from: &Joints) -> Option<Approach> {
        let way = |early| approach(self.own(), self.ball, press, &self.found.ball, early, &self.ready);
        let near = way(EARLIEST[0])?;
        let unsure =
            self.found.along_normal(self.robot, self.ball, press.camera, near.way.last().unwrap_or(&self.ready));
        let approach = way((EARLY * unsure).clamp(EARLIEST[0], EARLIEST[1]))?;
        let round = round(self.own(), self.ball, &self.found.ball, [from, &approach.hover])?;
        Some(Approach { round, ..approach })
    }

    /// The way of a press's pad over the ball from where the arm stands `at`, if it slides.
    pub fn sideways(&self, press: &Press, at: &Joints) -> Option<Vec<Joints>> {
        sideways(self.own(), self.ball, press, at)
    }

    /// Whether the newest look of `camera` shows the ball deep enough in its pad.
    pub fn is_deep(&self, camera: usize, images: &PressImages) -> bool {
        let newest = images.of_look().filter(|image| image.camera == camera);
        let touch = touches(&self.robot.hand, self.pads, self.ball.radius, newest);
        touch.first().is_some_and(|touch| touch.depth(&self.robot.hand, self.ball) >= self.ball.depth)
    }

    /// How hard something pushes on the hand about where the ball is, N, by the arm's torques `now` beside those `before` it touched.
    pub fn force(&self, before: &ArmState, now: &ArmState) -> f64 {
        force(self.own(), [before, now], &self.found.ball).map_or(0.0, |force| force.norm())
    }

    /// Takes what the newest press has shown.
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
