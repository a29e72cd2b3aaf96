//! Ball on which pads are pressed: its parameters in the script, and the arm motions that bring a pad onto it.
//!
//! A ball is fixed on a thin post within the hand's workspace. Each camera's part of its pad is pressed on it at
//! several spots, each time with another heading and tilt of the hand. The touches then identify the arm's joints, the
//! hand's mount, and the links of the fingers, which are pushed onto their stops.

use control::inverse_kinematics::{ArmKinematics, ArmMount, Joints};
use hand_model::hand::CoverShape;
use hand_model::{Hand, RobotModel};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Number of headings of the hand about the vertical that are tried for a press.
const HEADING_COUNT: usize = 16;
/// Tried shares of the press's tilt.
const TILT_SHARES: [f64; 3] = [1.0, 0.5, 0.0];
/// Increments of heading, tilt and tilt direction between successive presses: low-discrepancy fractions from the golden
/// ratio and its generalizations to higher degrees (Roberts 2018).
const LOW_DISCREPANCY_STEPS: [f64; 3] = [0.819_173, 0.671_044, 0.549_701];
/// Minimum clearance of other links from the ball during a press, m.
const PRESS_CLEARANCE: f64 = 0.002;
/// Minimum clearance of all links from the ball between presses, m: half of a usual standoff.
const TRAVEL_CLEARANCE: f64 = 0.02;
/// Minimum distance of links from the centre line of the post below the ball, m.
const POST_CLEARANCE: f64 = 0.012;
/// Minimum height of links above the table on which the arm stands, m.
const TABLE_CLEARANCE: f64 = 0.03;
/// Maximum rotation of the joints before the wrist from their start angles, rad: more would bring the elbow to the
/// other side.
const MAX_ARM_ROTATION: f64 = 1.5;
/// Number of joints before the wrist.
const JOINTS_BEFORE_WRIST: usize = 4;
/// Rise heights of the hand if the straight path between presses is blocked, m; below, the maximum rotation of a joint
/// for such a rise, rad.
const RISE_HEIGHTS: [f64; 3] = [0.06, 0.1, 0.15];
const MAX_RISE_ROTATION: f64 = 0.8;
/// Number of intervals of such a path that are checked for collisions.
const CHECKED_INTERVALS: usize = 12;
/// Points on each side of the centre along each axis of a cover that are checked for collisions.
const GRID_HALF_COUNT: i32 = 3;

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

/// Returns the kinematics of a robot whose base is the world's origin.
pub fn kinematics(robot: &RobotModel) -> ArmKinematics {
    let RobotModel { hand, arm, .. } = robot;
    ArmKinematics::new((**arm).clone(), ArmMount::for_hand(hand, 0.0))
}

/// Plans the approach by which the arm of `robot` brings a pad onto a ball at `middle`. Snapshots are taken from
/// `early` (m) before the expected contact to as much beyond the maximum depth. Uses the first heading that the arm
/// reaches with everything else clear; returns none if there is no such heading.
pub fn plan_approach(
    robot: &RobotModel,
    ball: &CalibrationBall,
    press: &PadPress,
    middle: &Point3<f64>,
    early: f64,
    from: &Joints,
) -> Option<PressApproach> {
    let hand = &robot.hand;
    let kinematics = kinematics(robot);
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
        if !is_clear(hand, Some(pad.link), &palm_at(&turn, 0.0), ball, middle) {
            return None;
        }
        let hover = kinematics.solve(&palm_at(&turn, ball.standoff), from)?;
        // Straight lines in joint space lead from press to press: none may lead round to the other side of the arm.
        if !keeps_elbow_side(from, &hover) {
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
        Some(PressApproach { waypoints: Vec::new(), hover, press_postures: way })
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

/// Returns postures on the straight line in joint space, in `pieces` intervals, both ends included.
pub(crate) fn straight_line(from: &Joints, to: &Joints, pieces: usize) -> impl Iterator<Item = Joints> {
    let (from, to) = (*from, *to);
    (0..=pieces).map(move |n| {
        let share = n as f64 / pieces as f64;
        from.iter().zip(to).map(|(from, to)| from + share * (to - from)).collect()
    })
}

/// Returns the covers of an open hand with its palm at `palm`, with their poses: that of the palm, which is no link,
/// and those of all links.
pub(crate) fn posed_covers<'a>(
    hand: &'a Hand,
    palm: &Isometry3<f64>,
) -> impl Iterator<Item = (Option<usize>, Isometry3<f64>, &'a CoverShape)> {
    let palm = *palm;
    let links = hand.tree.forward(&hand.open_angles());
    let fingers =
        links.into_iter().zip(&hand.covers).enumerate().map(move |(n, (link, cover))| (Some(n), palm * link, cover));
    std::iter::once((None, palm, &hand.palm_cover)).chain(fingers)
}

/// Plans waypoints between two postures beside the ball: none if the straight path is free, otherwise up and down
/// again. `None` if that is blocked, too.
pub fn plan_detour(
    robot: &RobotModel,
    ball: &CalibrationBall,
    middle: &Point3<f64>,
    [from, to]: [&Joints; 2],
) -> Option<Vec<Joints>> {
    let hand = &robot.hand;
    let kinematics = kinematics(robot);
    let free = |from: &Joints, to: &Joints| {
        straight_line(from, to, CHECKED_INTERVALS)
            .all(|at| is_clear(hand, None, &kinematics.palm_pose(&at), ball, middle))
    };
    let above = |at: &Joints, by: f64| {
        let up = kinematics.solve(&(Translation3::new(0.0, 0.0, by) * kinematics.palm_pose(at)), at)?;
        (0..up.len()).all(|joint| (up[joint] - at[joint]).abs() < MAX_RISE_ROTATION).then_some(up)
    };
    if free(from, to) {
        return Some(Vec::new());
    }
    RISE_HEIGHTS.iter().find_map(|by| {
        let up = [above(from, *by)?, above(to, *by)?];
        // Beside the ball, the start may already be closer to it than the required clearance.
        (free(&up[0], &up[1]) && free(&up[1], to)).then(|| up.to_vec())
    })
}

/// True if the links keep clear of ball, post and table with the palm at `palm`. `pressed` is the link that is pressed
/// and may touch the ball (`Some(None)` for the palm); with `None`, all links must keep clear.
fn is_clear(
    hand: &Hand,
    pressed: Option<Option<usize>>,
    palm: &Isometry3<f64>,
    ball: &CalibrationBall,
    middle: &Point3<f64>,
) -> bool {
    let clearance = if pressed.is_some() { PRESS_CLEARANCE } else { TRAVEL_CLEARANCE };
    posed_covers(hand, palm).all(|(link, pose, cover)| {
        grid_points(cover).all(|point| {
            let point = pose * point;
            let beside = (point - middle).xy().norm();
            let below = point.z < middle.z - ball.radius && beside < POST_CLEARANCE;
            let near = pressed != Some(link) && (point - middle).norm() < ball.radius + clearance;
            point.z > TABLE_CLEARANCE && !below && !near
        })
    })
}

/// Returns a grid of points of a cover, link frame.
pub(crate) fn grid_points(cover: &CoverShape) -> impl Iterator<Item = Point3<f64>> + '_ {
    let steps = move || -GRID_HALF_COUNT..=GRID_HALF_COUNT;
    let grid = steps().flat_map(move |x| steps().flat_map(move |y| steps().map(move |z| [x, y, z])));
    grid.map(|at| {
        let share = Vector3::from(at.map(|n| f64::from(n) / f64::from(GRID_HALF_COUNT)));
        cover.link_from_cover * Point3::from(share.component_mul(&cover.half))
    })
}
