//! Aiming of presses, by a model of the robot that is refined with each press.
//!
//! The nominal model misses a ball by a good part of a pad's width. Each press is aimed with the kinematic calibration
//! from the presses before it, and starts in front of the ball by that calibration's uncertainty.

use control::inverse_kinematics::Joints;
use hand_model::RobotModel;
use hand_model::robot::ArmState;
use plant::RobotInstance;
use tactile_perception::PhotometricCalibration;

use crate::arm_load::estimate_force;
use crate::ball::{CalibrationBall, PadPress, PressApproach, plan_approach, plan_detour, plan_slide};
use crate::ball_clearance::BallClearance;
use crate::excitation_setup::ExcitationSetup;
use crate::kinematic_calibration::{BallTouch, KinematicCalibration, calibrate};
use crate::touches::{PressImages, deepest_touches};

/// Distance before the ball at which a press starts, in standard deviations of the expected contact.
const APPROACH_MARGIN_SIGMAS: f64 = 3.0;
/// Bounds of that distance, m.
const APPROACH_MARGIN_BOUNDS: [f64; 2] = [0.001, 0.02];
/// Number of touches up to which the calibration is repeated after every press, and number of touches between
/// repetitions after that.
const CALIBRATION_SCHEDULE: (usize, usize) = (12, 6);

/// Aim of presses.
pub struct PressAim<'a> {
    robot: &'a RobotModel,
    pads: &'a PhotometricCalibration,
    ball: &'a CalibrationBall,
    ready: Joints,
    touches: Vec<BallTouch>,
    calibration: KinematicCalibration,
    /// Robot model of that calibration.
    robot_model: RobotModel,
}

impl<'a> PressAim<'a> {
    /// Creates the aim of the nominal model.
    pub fn new(means: &ExcitationSetup<'a>, ball: &'a CalibrationBall) -> Self {
        let ExcitationSetup { robot, pads, ready, .. } = *means;
        let found = calibrate(robot, ball, &RobotInstance::nominal(robot), &[]);
        let own = found.robot_instance.apply_to_robot(robot);
        Self { robot, pads, ball, ready, touches: Vec::new(), calibration: found, robot_model: own }
    }

    /// Returns the robot model calibrated by the presses so far.
    pub fn robot_model(&self) -> &RobotModel {
        &self.robot_model
    }

    /// Returns the ball.
    pub fn ball(&self) -> &'a CalibrationBall {
        self.ball
    }

    /// Plans the path from posture `from` to a press. Inverse kinematics starts from the ready posture, so that the
    /// joints do not wind up from press to press.
    pub fn plan_press(&self, press: &PadPress, from: &Joints) -> Option<PressApproach> {
        let clearance = self.clearance();
        let plan = |early| plan_approach(&clearance, self.ball, press, early, (from, &self.ready));
        let near = plan(APPROACH_MARGIN_BOUNDS[0])?;
        let unsure = self.calibration.normal_sigma(
            self.robot,
            self.ball,
            press.camera,
            near.press_postures.last().unwrap_or(&self.ready),
        );
        plan((APPROACH_MARGIN_SIGMAS * unsure).clamp(APPROACH_MARGIN_BOUNDS[0], APPROACH_MARGIN_BOUNDS[1]))
    }

    /// Plans waypoints from posture `from` through `postures` in turn, clear of the ball: a list for each. `None` if one
    /// is blocked.
    pub fn plan_paths(&self, from: &Joints, postures: &[Joints]) -> Option<Vec<Vec<Joints>>> {
        let clearance = self.clearance();
        let starts = std::iter::once(from).chain(postures);
        starts.zip(postures).map(|(from, to)| plan_detour(&clearance, [from, to])).collect()
    }

    fn clearance(&self) -> BallClearance<'_> {
        BallClearance::new(self.robot_model(), self.ball.radius, &self.calibration.ball)
    }

    /// Plans the slide of a press's pad over the ball from the posture `at`, if it slides.
    pub fn plan_slide(&self, press: &PadPress, at: &Joints) -> Option<Vec<Joints>> {
        plan_slide(self.robot_model(), self.ball, press, at)
    }

    /// True if the newest snapshot of `camera` shows the ball deep enough in its pad.
    pub fn is_deep(&self, camera: usize, images: &PressImages) -> bool {
        let newest = images.of_snapshot().filter(|image| image.camera == camera);
        let touch = deepest_touches(&self.robot.hand, self.pads, self.ball.radius, newest);
        touch.first().is_some_and(|touch| touch.depth(&self.robot.hand, self.ball) >= self.ball.depth)
    }

    /// Returns the magnitude of the force on the hand near the ball, N, from the arm's torques `now` compared with
    /// those `before` contact.
    pub fn force(&self, before: &ArmState, now: &ArmState) -> f64 {
        estimate_force(self.robot_model(), [before, now], &self.calibration.ball).map_or(0.0, |force| force.norm())
    }

    /// Updates the calibration with the newest press.
    pub fn update_calibration(&mut self, images: &PressImages) {
        let before = self.touches.len();
        self.touches.extend(deepest_touches(&self.robot.hand, self.pads, self.ball.radius, images.of_press()));
        let now = self.touches.len();
        if now > before
            && (now <= CALIBRATION_SCHEDULE.0 || before / CALIBRATION_SCHEDULE.1 != now / CALIBRATION_SCHEDULE.1)
        {
            self.calibration = calibrate(self.robot, self.ball, &RobotInstance::nominal(self.robot), &self.touches);
            self.robot_model = self.calibration.robot_instance.apply_to_robot(self.robot);
        }
    }
}
