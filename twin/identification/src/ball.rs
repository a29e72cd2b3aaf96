//! Ball on which pads are pressed: its parameters in the script, and the arm motions that bring a pad onto it.
//!
//! A ball is fixed on a thin post within the hand's workspace. Each camera's part of its pad is pressed on it at
//! several spots, each time with another heading and tilt of the hand. The touches then identify the arm's joints, the
//! hand's mount, and the links of the fingers, which are pushed onto their stops.

use control::inverse_kinematics::Joints;
use hand_model::{Hand, RobotModel};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::ball_clearance::{BallClearance, kinematics};

/// Number of headings of the hand about the vertical that are tried for a press.
const HEADING_COUNT: usize = 16;
/// Tried shares of the press's tilt.
const TILT_SHARES: [f64; 3] = [1.0, 0.5, 0.0];
/// Increments of heading, tilt and tilt direction between successive presses: low-discrepancy fractions from the golden
/// ratio and its generalizations to higher degrees (Roberts 2018).
const LOW_DISCREPANCY_STEPS: [f64; 3] = [0.819_173, 0.671_044, 0.549_701];
/// Maximum rotation of the joints before the wrist from their start angles, rad: more would bring the elbow to the
/// other side.
const MAX_ARM_ROTATION: f64 = 1.5;
/// Number of joints before the wrist.
const JOINTS_BEFORE_WRIST: usize = 4;
/// Rise heights of the hand if the straight path between presses is blocked, m; below, the maximum rotation of a joint
/// for such a rise, rad.
const RISE_HEIGHTS: [f64; 3] = [0.06, 0.1, 0.15];
const MAX_RISE_ROTATION: f64 = 0.8;

/// A ball that is fixed within the hand's workspace, and the presses of pads on it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationBall {
    /// Radius, m.
    pub radius: f64,
    /// Measured position of its centre in the frame of the arm's base, m.
    pub place: [f64; 3],
    /// Standard deviation of `place` along each axis, m.
    pub uncertain: f64,
    /// Spots at which a camera's part of its pad is pressed, as shares of its width and height from its centre.
    pub spots: Vec<[f64; 2]>,
    /// Maximum angle between the pressing direction and the vertical, rad.
    pub tilt: f64,
    /// Standoff: distance from the ball at which the arm moves between presses, m.
    pub standoff: f64,
    /// Distance between two snapshots of the pad, m.
    pub stride: f64,
    /// Settling time of the arm before a snapshot, s.
    pub settle: f64,
    /// Penetration at which a press ends, m.
    pub depth: f64,
    /// Slide of the palm's pads over the ball after a press, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slide: Option<Slide>,
}

/// Slide of a pad over the ball, with the ball's friction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slide {
    /// Length of the slide along the pad, m.
    pub way: f64,
    /// Measured friction coefficient of the ball against a nominal pad.
    pub friction: f64,
    /// Relative standard deviation of `friction`.
    pub uncertain: f64,
}

/// One press of a pad on the ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PadPress {
    /// Number among all presses of a script.
    pub number: usize,
    /// Index of the camera.
    pub camera: usize,
    /// See [`CalibrationBall::spots`].
    pub spot: [f64; 2],
}

/// Arm trajectory of a press.
#[derive(Debug, Clone, PartialEq)]
pub struct PressApproach {
    /// Waypoints to the ball, if the straight path is blocked.
    pub waypoints: Vec<Joints>,
    /// Posture at the standoff.
    pub hover: Joints,
    /// Postures of the press, one stride apart, the deepest last.
    pub press_postures: Vec<Joints>,
}

impl CalibrationBall {
    /// Returns its centre in the frame of the arm's base, m.
    pub fn center(&self) -> Point3<f64> {
        Point3::from(self.place)
    }

    /// Returns the slide of a press's pad, if it slides. Pads of links do not, because a lateral push may turn the
    /// links.
    pub fn slide_of(&self, hand: &Hand, press: &PadPress) -> Option<&Slide> {
        self.slide.as_ref().filter(|_| hand.pads[hand.cameras[press.camera].pad].link.is_none())
    }

    /// Returns all presses: each spot of every camera, spot by spot, so that even an unfinished excitation has used
    /// every pad.
    pub fn presses(&self, hand: &Hand) -> Vec<PadPress> {
        let of = |spot: &[f64; 2]| (0..hand.cameras.len()).map(move |camera| (camera, *spot)).collect::<Vec<_>>();
        let all = self.spots.iter().flat_map(of).enumerate();
        all.map(|(number, (camera, spot))| PadPress { number, camera, spot }).collect()
    }
}

/// Returns `palm_from_pad` of an open hand whose links are on their stops.
pub fn palm_from_pad(hand: &Hand, pad: usize) -> Isometry3<f64> {
    let pad = &hand.pads[pad];
    let link = pad.link.map_or_else(Isometry3::identity, |link| hand.tree.forward(&hand.open_angles())[link]);
    link * pad.link_from_pad
}

/// Plans the approach from posture `from` by which the arm brings a pad onto the ball. Snapshots are taken from `early`
/// (m) before the expected contact to as much beyond the maximum depth. Inverse kinematics starts from the `ready`
/// posture. Uses the first heading that the arm reaches with everything else clear; returns none if there is no such
/// heading.
pub fn plan_approach(
    clearance: &BallClearance,
    ball: &CalibrationBall,
    press: &PadPress,
    early: f64,
    (from, ready): (&Joints, &Joints),
) -> Option<PressApproach> {
    let (hand, kinematics, middle) = (clearance.hand(), clearance.kinematics(), clearance.middle());
    let camera = &hand.cameras[press.camera];
    let pad = &hand.pads[camera.pad];
    let (x, y) = (press.spot[0] * camera.w, camera.center_y + press.spot[1] * camera.h);
    // Over the flat middle of a pad, its surface is level.
    let spot = Point3::new(x, y, pad.surface_height(x, y));
    let palm_from_pad = palm_from_pad(hand, camera.pad);
    let [heading, tilt, side] = LOW_DISCREPANCY_STEPS.map(|step| (0.5 + step * press.number as f64).fract());
    let tries = TILT_SHARES.into_iter().flat_map(|share| (0..HEADING_COUNT).map(move |n| (share, n)));
    tries.into_iter().find_map(|(share, n)| {
        let (tilt, side) = (share * ball.tilt * tilt.sqrt(), std::f64::consts::TAU * side);
        let down = Vector3::new(tilt.sin() * side.cos(), tilt.sin() * side.sin(), -tilt.cos());
        // Pose `world_from_palm` with the spot at distance `off` from the ball's surface, against `down`.
        let palm_at = |turn: &UnitQuaternion<f64>, off: f64| {
            let place = middle - down * (ball.radius + off);
            let pose = Isometry3::from_parts(Translation3::from(place - turn * spot), *turn);
            pose * palm_from_pad.inverse()
        };
        let about = std::f64::consts::TAU * (heading + n as f64 / HEADING_COUNT as f64);
        let flat = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), about)
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let turn = UnitQuaternion::rotation_between(&(flat * Vector3::z()), &down)? * flat;
        if !clearance.is_hand_clear(Some(pad.link), &palm_at(&turn, 0.0)) {
            return None;
        }
        let hover = kinematics.solve(&palm_at(&turn, ball.standoff), ready)?;
        // Straight lines in joint space lead from press to press: none may lead round to the other side of the arm.
        if !keeps_elbow_side(ready, &hover) {
            return None;
        }
        let looks = ((2.0 * early + ball.depth) / ball.stride).ceil() as usize;
        let mut way: Vec<Joints> = Vec::with_capacity(looks + 1);
        for snapshot in 0..=looks {
            let seed = way.last().unwrap_or(&hover);
            let next = kinematics.solve(&palm_at(&turn, early - snapshot as f64 * ball.stride), seed)?;
            // A jump to another branch of the inverse kinematics is not a straight path.
            if (0..next.len()).any(|joint| (next[joint] - seed[joint]).abs() > 0.5) {
                return None;
            }
            way.push(next);
        }
        if !clearance.is_arm_clear_of_press(way.last()?) {
            return None;
        }
        let waypoints = plan_detour(clearance, [from, &hover])?;
        Some(PressApproach { waypoints, hover, press_postures: way })
    })
}

/// Plans the slide of a pad over the ball from the posture `at` along the pad's width, in strides, so that the ball
/// moves towards the pad's middle. None if the arm does not reach that far, and for pads that do not slide.
pub fn plan_slide(robot: &RobotModel, ball: &CalibrationBall, press: &PadPress, at: &Joints) -> Option<Vec<Joints>> {
    let hand = &robot.hand;
    let slide = ball.slide_of(hand, press)?;
    let pad = &hand.pads[hand.cameras[press.camera].pad];
    let kinematics = kinematics(robot);
    let palm = kinematics.palm_pose(at);
    let along = palm * pad.link_from_pad * Vector3::x() * if press.spot[0] < 0.0 { -1.0 } else { 1.0 };
    let strides = (slide.way / ball.stride).ceil() as usize;
    let mut way: Vec<Joints> = Vec::with_capacity(strides);
    for stride in 1..=strides {
        let next = Translation3::from(along * (stride as f64 * ball.stride)) * palm;
        way.push(kinematics.solve(&next, way.last().unwrap_or(at))?);
    }
    Some(way)
}

/// True if an arm that moves between these postures keeps its elbow on the same side.
pub(crate) fn keeps_elbow_side(from: &Joints, to: &Joints) -> bool {
    to.iter().zip(from).take(JOINTS_BEFORE_WRIST).all(|(to, from)| (to - from).abs() <= MAX_ARM_ROTATION)
}

/// Plans waypoints between two postures beside the ball: none if the straight path is free, otherwise up and down
/// again. `None` if that is blocked, too.
pub fn plan_detour(clearance: &BallClearance, [from, to]: [&Joints; 2]) -> Option<Vec<Joints>> {
    let kinematics = clearance.kinematics();
    let above = |at: &Joints, by: f64| {
        let up = kinematics.solve(&(Translation3::new(0.0, 0.0, by) * kinematics.palm_pose(at)), at)?;
        (0..up.len()).all(|joint| (up[joint] - at[joint]).abs() < MAX_RISE_ROTATION).then_some(up)
    };
    if clearance.is_path_clear(from, to) {
        return Some(Vec::new());
    }
    RISE_HEIGHTS.iter().find_map(|by| {
        let up = [above(from, *by)?, above(to, *by)?];
        // Beside the ball, the start may already be closer to it than the required clearance.
        (clearance.is_path_clear(&up[0], &up[1]) && clearance.is_path_clear(&up[1], to)).then(|| up.to_vec())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ball_clearance::straight_line;
    use crate::script::ExcitationScript;

    /// Intervals of a straight path between two postures; below, the number of presses.
    const INTERVALS: usize = 200;
    const PRESSES: usize = 36;

    /// Returns the distance between the surfaces of a capsule from `start` to `end` and a ball at `middle`, m.
    fn gap([start, end]: [Point3<f64>; 2], radius: f64, middle: &Point3<f64>, ball: f64) -> f64 {
        let axis = end - start;
        let share = ((middle - start).dot(&axis) / axis.norm_squared()).clamp(0.0, 1.0);
        (middle - start - share * axis).norm() - radius - ball
    }

    /// From press to press and during the presses, the wrist stays away from the ball.
    #[test]
    fn the_wrist_keeps_clear_of_the_ball() {
        let robot = RobotModel::ftac_gen3();
        let script = ExcitationScript::standard(&robot).expect("valid");
        let ball = script.ball.as_ref().expect("a ball");
        let (ready, middle) = (robot.arm.home, ball.center());
        let clearance = BallClearance::new(&robot, ball.radius, &middle);
        let (mut at, mut pressed) = (ready, 0);
        for press in ball.presses(&robot.hand).iter().take(PRESSES) {
            let Some(approach) = plan_approach(&clearance, ball, press, 0.005, (&at, &ready)) else { continue };
            let posts = approach.waypoints.iter().chain([&approach.hover]).chain(&approach.press_postures);
            let mut from = at;
            for to in posts {
                for joints in straight_line(&from, to, INTERVALS) {
                    let links = robot.arm.tree.forward(&joints);
                    for capsule in &robot.arm.wrist {
                        let ends = [Point3::origin(), Point3::from(capsule.end)].map(|end| links[capsule.link] * end);
                        let gap = gap(ends, capsule.radius, &middle, ball.radius);
                        assert!(gap > 0.0, "press {}: {gap}", press.number);
                    }
                }
                from = *to;
            }
            (at, pressed) = (approach.hover, pressed + 1);
        }
        assert!(pressed > PRESSES / 2, "{pressed}");
    }
}
