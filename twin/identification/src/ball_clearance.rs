//! Clearance of hand and arm from the calibration ball, its post and the table on which the arm stands.

use control::arm_clearance::link_solids;
use control::collision::{Solid, signed_distance};
use control::inverse_kinematics::{ArmKinematics, ArmMount, Joints};
use hand_model::hand::CoverShape;
use hand_model::{Arm, Hand, RobotModel};
use nalgebra::{Isometry3, Point3, Vector3};

/// Minimum clearance of other links from the ball during a press, m.
const PRESS_CLEARANCE: f64 = 0.002;
/// Minimum clearance of the hand's links from the ball between presses, m: half of a usual standoff.
const TRAVEL_CLEARANCE: f64 = 0.02;
/// Minimum clearance of the arm's links from the ball and from the centre line of its post, m.
const ARM_CLEARANCE: f64 = 0.01;
/// Minimum distance of the hand's links from that line, m.
const POST_CLEARANCE: f64 = 0.012;
/// Minimum height of the hand's links above the table, m.
const TABLE_CLEARANCE: f64 = 0.03;
/// Number of the arm's moving links that cannot come near the ball.
const FIRST_LINKS: usize = 2;
/// Maximum rotation of a joint between two postures of a path that are checked for collisions, rad.
const CHECKED_ROTATION: f64 = 0.05;
/// Points on each side of the centre along each axis of a cover that are checked for collisions.
const GRID_HALF_COUNT: i32 = 3;

/// The robot with its hand open, beside a ball on a post.
pub struct BallClearance<'a> {
    hand: &'a Hand,
    kinematics: ArmKinematics,
    /// Links of the arm that can come near the ball, with their indices, each in its own frame.
    links: Vec<(usize, Solid)>,
    middle: Point3<f64>,
    radius: f64,
    /// Ball and post.
    obstacles: [Solid; 2],
}

impl<'a> BallClearance<'a> {
    /// Creates the clearances of `robot` from a ball with this `radius` (m) at `middle` in the frame of the arm's base.
    pub fn new(robot: &'a RobotModel, radius: f64, middle: &Point3<f64>) -> Self {
        let at = |height: f64| Isometry3::translation(middle.x, middle.y, height);
        let bottom = middle.z - radius;
        let ball = Solid::ball("ball", radius, at(middle.z));
        let post = Solid::capsule("post", &Vector3::new(0.0, 0.0, -bottom), 0.0, at(bottom));
        Self {
            hand: &robot.hand,
            kinematics: kinematics(robot),
            links: near_links(&robot.arm),
            middle: *middle,
            radius,
            obstacles: [ball, post],
        }
    }

    /// Returns the hand.
    pub fn hand(&self) -> &'a Hand {
        self.hand
    }

    /// Returns the kinematics of the arm.
    pub fn kinematics(&self) -> &ArmKinematics {
        &self.kinematics
    }

    /// Returns the centre of the ball in the frame of the arm's base, m.
    pub fn middle(&self) -> Point3<f64> {
        self.middle
    }

    /// True if hand and arm are clear on the straight line in joint space between two postures.
    pub fn is_path_clear(&self, from: &Joints, to: &Joints) -> bool {
        let longest = from.iter().zip(to).map(|(from, to)| (to - from).abs()).fold(0.0, f64::max);
        let intervals = (longest / CHECKED_ROTATION).ceil().max(1.0) as usize;
        straight_line(from, to, intervals).all(|at| {
            self.is_arm_clear(&at, ARM_CLEARANCE) && self.is_hand_clear(None, &self.kinematics.palm_pose(&at))
        })
    }

    /// True if the links of the arm are clear of ball and post while a pad is pressed on the ball.
    pub fn is_arm_clear_of_press(&self, at: &Joints) -> bool {
        self.is_arm_clear(at, PRESS_CLEARANCE)
    }

    fn is_arm_clear(&self, at: &Joints, clearance: f64) -> bool {
        let poses = self.kinematics.link_poses(at);
        self.links.iter().all(|(index, link)| {
            let is_clear =
                |from| signed_distance(link, &poses[*index], from).is_ok_and(|distance| distance > clearance);
            self.obstacles.iter().all(is_clear)
        })
    }

    /// True if the hand's links are clear of ball, post and table with the palm at `palm`. `pressed` is the link that
    /// is pressed and may touch the ball (`Some(None)` for the palm); with `None`, all links must keep clear.
    pub fn is_hand_clear(&self, pressed: Option<Option<usize>>, palm: &Isometry3<f64>) -> bool {
        let clearance = if pressed.is_some() { PRESS_CLEARANCE } else { TRAVEL_CLEARANCE };
        posed_covers(self.hand, palm).all(|(link, pose, cover)| {
            grid_points(cover).all(|point| {
                let point = pose * point;
                let beside = (point - self.middle).xy().norm();
                let below = point.z < self.middle.z - self.radius && beside < POST_CLEARANCE;
                let near = pressed != Some(link) && (point - self.middle).norm() < self.radius + clearance;
                point.z > TABLE_CLEARANCE && !below && !near
            })
        })
    }
}

/// Returns the links that can come near the ball: the capsules of the wrist, which end at the flange, and the tubes
/// of the other links.
fn near_links(arm: &Arm) -> Vec<(usize, Solid)> {
    let tubes = link_solids(arm).into_iter().skip(1).enumerate().skip(FIRST_LINKS);
    tubes
        .map(|(index, tube)| match arm.wrist.iter().find(|capsule| capsule.link == index) {
            Some(capsule) => (index, Solid::capsule(tube.name, &capsule.end, capsule.radius, tube.pose)),
            None => (index, tube),
        })
        .collect()
}

/// Returns the kinematics of a robot whose base is the world's origin.
pub fn kinematics(robot: &RobotModel) -> ArmKinematics {
    let RobotModel { hand, arm, .. } = robot;
    ArmKinematics::new((**arm).clone(), ArmMount::for_hand(hand, 0.0))
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

/// Returns a grid of points of a cover, link frame.
pub(crate) fn grid_points(cover: &CoverShape) -> impl Iterator<Item = Point3<f64>> + '_ {
    let steps = move || -GRID_HALF_COUNT..=GRID_HALF_COUNT;
    let grid = steps().flat_map(move |x| steps().flat_map(move |y| steps().map(move |z| [x, y, z])));
    grid.map(|at| {
        let share = Vector3::from(at.map(|n| f64::from(n) / f64::from(GRID_HALF_COUNT)));
        cover.link_from_cover * Point3::from(share.component_mul(&cover.half))
    })
}
