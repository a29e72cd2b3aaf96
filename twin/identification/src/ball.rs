//! The ball on which pads are pressed: what the script says of it, and how the arm brings a pad onto it.
//!
//! A ball is fixed on a thin post in the hand's reach. Each camera's part of its pad is pressed on it at several spots, every time with
//! the hand turned and tilted otherwise: then touches show the arm's joints and the hand's mount as well as the links of the fingers,
//! which are pushed onto their stops.

use control::inverse_kinematics::{ArmKinematics, Joints, Mount};
use hand_model::hand::CoverShape;
use hand_model::{Hand, RobotModel};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Turns of the hand about the vertical that are tried for a press, ...
const HEADINGS: usize = 16;
/// ... with these shares of its tilt.
const TILTS: [f64; 3] = [1.0, 0.5, 0.0];
/// Headings, tilts and their directions of successive presses: fractions that never come close to each other again, those of the golden
/// ratio and its relatives of higher degree (Roberts 2018).
const SPREAD: [f64; 3] = [0.819_173, 0.671_044, 0.549_701];
/// No other link comes closer to the ball than this, m, ...
const CLEARANCE: f64 = 0.002;
/// ... (on the way from one press to the next than this: half of a usual standoff), ...
const FREE: f64 = 0.02;
/// ... nor to the post below it, from its middle line, ...
const POST: f64 = 0.012;
/// ... nor to the table, on which the arm stands.
const TABLE: f64 = 0.03;
/// The joints before the wrist turn by no more than this from where the arm begins, rad: the others would bring its elbow to the other side.
const MOST_TURN: f64 = 1.5;
/// How many joints that are.
const SIDED: usize = 4;
/// Where the straight way from press to press is not free the hand rises by one of these, m, by which no joint may turn more than this, rad.
const RISES: [f64; 3] = [0.06, 0.1, 0.15];
const MOST_RISE: f64 = 0.8;
/// Pieces of such a way that are looked at.
const PLACES: usize = 12;
/// Points along each axis of a cover that are looked at.
const GRID: i32 = 3;

/// A ball that is fixed in the hand's reach, and how pads are pressed on it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ball {
    /// m.
    pub radius: f64,
    /// Its middle, m, in the frame of the arm's base, as somebody has measured it.
    pub place: [f64; 3],
    /// Standard deviation of that along each axis, m.
    pub uncertain: f64,
    /// Where a camera's part of its pad is pressed, as shares of its width and height from its middle.
    pub spots: Vec<[f64; 2]>,
    /// Greatest angle between the direction in which a pad is pressed and the vertical, rad.
    pub tilt: f64,
    /// Distance from the ball at which the arm goes from one press to the next, m.
    pub standoff: f64,
    /// Between one look at the pad and the next, m.
    pub stride: f64,
    /// For which the arm stands before a look, s.
    pub settle: f64,
    /// How far a pad is pressed onto the ball at most, m.
    pub depth: f64,
    /// Pads of the palm then slide over it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slide: Option<Slide>,
}

/// How a pad slides over the ball, and what is known of its friction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slide {
    /// m, along the pad.
    pub way: f64,
    /// Of the ball against a pad as drawn, as somebody has measured it.
    pub friction: f64,
    /// Standard deviation of that, as a share of it.
    pub uncertain: f64,
}

/// One press.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Press {
    /// Of all presses of a script.
    pub number: usize,
    /// Index of the camera.
    pub camera: usize,
    /// See [`Ball::spots`].
    pub spot: [f64; 2],
}

/// Where the arm goes for a press.
#[derive(Debug, Clone, PartialEq)]
pub struct Approach {
    /// On the way there, where the straight way is not free.
    pub round: Vec<Joints>,
    /// At the standoff.
    pub hover: Joints,
    /// A stride apart, the deepest last.
    pub way: Vec<Joints>,
}

impl Ball {
    /// Its middle, m, in the frame of the arm's base.
    pub fn middle(&self) -> Point3<f64> {
        Point3::from(self.place)
    }

    /// How the pad of a press slides, if it does: those of links do not, because a push from the side may turn them.
    pub fn slide_of(&self, hand: &Hand, press: &Press) -> Option<&Slide> {
        self.slide.as_ref().filter(|_| hand.pads[hand.cameras[press.camera].pad].link.is_none())
    }

    /// All presses: each spot of every camera, spot by spot, so that an unfinished excitation has touched with every pad.
    pub fn presses(&self, hand: &Hand) -> Vec<Press> {
        let of = |spot: &[f64; 2]| (0..hand.cameras.len()).map(move |camera| (camera, *spot)).collect::<Vec<_>>();
        let all = self.spots.iter().flat_map(of).enumerate();
        all.map(|(number, (camera, spot))| Press { number, camera, spot }).collect()
    }
}

/// `palm_from_pad` of an open hand whose links are on their stops.
pub fn palm_from_pad(hand: &Hand, pad: usize) -> Isometry3<f64> {
    let pad = &hand.pads[pad];
    let link = pad.link.map_or_else(Isometry3::identity, |link| hand.tree.forward(&hand.open())[link]);
    link * pad.link_from_pad
}

/// Kinematics of a robot whose base is the world's origin.
pub fn kinematics(robot: &RobotModel) -> ArmKinematics {
    let RobotModel { hand, arm, .. } = robot;
    ArmKinematics::new((**arm).clone(), Mount::of_hand(hand, 0.0))
}

/// How the arm of a robot believed to be `hand` on `arm` brings a pad onto a ball believed to be at `middle`, looking from `early` (m) before
/// the pad should touch to as much behind its greatest depth. The first heading that the arm reaches with everything else clear; none
/// where there is no such.
pub fn approach(
    robot: &RobotModel,
    ball: &Ball,
    press: &Press,
    middle: &Point3<f64>,
    early: f64,
    from: &Joints,
) -> Option<Approach> {
    let hand = &robot.hand;
    let kinematics = kinematics(robot);
    let camera = &hand.cameras[press.camera];
    let pad = &hand.pads[camera.pad];
    let (x, y) = (press.spot[0] * camera.w, camera.center_y + press.spot[1] * camera.h);
    // Over the flat middle of a pad, where its surface is level.
    let spot = Point3::new(x, y, pad.surface_height(x, y));
    let palm_from_pad = palm_from_pad(hand, camera.pad);
    let [heading, tilt, side] = SPREAD.map(|step| (0.5 + step * press.number as f64).fract());
    let tries = TILTS.into_iter().flat_map(|share| (0..HEADINGS).map(move |n| (share, n)));
    tries.into_iter().find_map(|(share, n)| {
        let (tilt, side) = (share * ball.tilt * tilt.sqrt(), std::f64::consts::TAU * side);
        let down = Vector3::new(tilt.sin() * side.cos(), tilt.sin() * side.sin(), -tilt.cos());
        // `world_from_palm` with the spot so far from where the ball's surface is, against `down`.
        let palm_at = |turn: &UnitQuaternion<f64>, off: f64| {
            let place = middle - down * (ball.radius + off);
            let pose = Isometry3::from_parts(Translation3::from(place - turn * spot), *turn);
            pose * palm_from_pad.inverse()
        };
        let about = std::f64::consts::TAU * (heading + n as f64 / HEADINGS as f64);
        let flat = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), about)
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let turn = UnitQuaternion::rotation_between(&(flat * Vector3::z()), &down)? * flat;
        if !is_clear(hand, Some(pad.link), &palm_at(&turn, 0.0), ball, middle) {
            return None;
        }
        let hover = kinematics.solve(&palm_at(&turn, ball.standoff), from)?;
        // Straight lines of the joints lead from press to press: none may lead round to the other side of the arm.
        if !keeps_its_side(from, &hover) {
            return None;
        }
        let looks = ((2.0 * early + ball.depth) / ball.stride).ceil() as usize;
        let mut way: Vec<Joints> = Vec::with_capacity(looks + 1);
        for look in 0..=looks {
            let seed = way.last().unwrap_or(&hover);
            let next = kinematics.solve(&palm_at(&turn, early - look as f64 * ball.stride), seed)?;
            // Another branch of the arm's posture is no straight way.
            if (0..next.len()).any(|joint| (next[joint] - seed[joint]).abs() > 0.5) {
                return None;
            }
            way.push(next);
        }
        Some(Approach { round: Vec::new(), hover, way })
    })
}

/// The way of a pad over the ball: from where the arm stands `at` along the pad's width, so that the ball comes towards its middle, in strides.
/// None where the arm does not reach so far, and for pads that do not slide.
pub fn sideways(robot: &RobotModel, ball: &Ball, press: &Press, at: &Joints) -> Option<Vec<Joints>> {
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

/// Whether an arm that goes `from` one posture `to` another keeps its elbow on the same side.
pub(crate) fn keeps_its_side(from: &Joints, to: &Joints) -> bool {
    to.iter().zip(from).take(SIDED).all(|(to, from)| (to - from).abs() <= MOST_TURN)
}

/// Postures on the straight way of the joints `from` one `to` another, in so many `pieces`, both ends included.
pub(crate) fn straight(from: &Joints, to: &Joints, pieces: usize) -> impl Iterator<Item = Joints> {
    let (from, to) = (*from, *to);
    (0..=pieces).map(move |n| {
        let share = n as f64 / pieces as f64;
        from.iter().zip(to).map(|(from, to)| from + share * (to - from)).collect()
    })
}

/// Covers of an open hand with its palm at `palm`: of the palm, which is no link, and of all links, each where the link is.
pub(crate) fn covers<'a>(
    hand: &'a Hand,
    palm: &Isometry3<f64>,
) -> impl Iterator<Item = (Option<usize>, Isometry3<f64>, &'a CoverShape)> {
    let palm = *palm;
    let links = hand.tree.forward(&hand.open());
    let fingers =
        links.into_iter().zip(&hand.covers).enumerate().map(move |(n, (link, cover))| (Some(n), palm * link, cover));
    std::iter::once((None, palm, &hand.palm_cover)).chain(fingers)
}

/// Where the arm of a robot believed to be `hand` on `arm` goes in between on its way `from` one posture `to` another, both beside the ball: nowhere if
/// the straight way is free, or else up and down again. None where even so it is not free.
pub fn round(robot: &RobotModel, ball: &Ball, middle: &Point3<f64>, [from, to]: [&Joints; 2]) -> Option<Vec<Joints>> {
    let hand = &robot.hand;
    let kinematics = kinematics(robot);
    let free = |from: &Joints, to: &Joints| {
        straight(from, to, PLACES).all(|at| is_clear(hand, None, &kinematics.palm_pose(&at), ball, middle))
    };
    let above = |at: &Joints, by: f64| {
        let up = kinematics.solve(&(Translation3::new(0.0, 0.0, by) * kinematics.palm_pose(at)), at)?;
        (0..up.len()).all(|joint| (up[joint] - at[joint]).abs() < MOST_RISE).then_some(up)
    };
    if free(from, to) {
        return Some(Vec::new());
    }
    RISES.iter().find_map(|by| {
        let up = [above(from, *by)?, above(to, *by)?];
        // What is beside the ball already may be nearer to it than that.
        (free(&up[0], &up[1]) && free(&up[1], to)).then(|| up.to_vec())
    })
}

/// Whether all links but the one that is pressed (none of it is the palm), or all of them where none is, keep away from ball, post and table with the palm at
/// `palm`.
fn is_clear(
    hand: &Hand,
    pressed: Option<Option<usize>>,
    palm: &Isometry3<f64>,
    ball: &Ball,
    middle: &Point3<f64>,
) -> bool {
    let clearance = if pressed.is_some() { CLEARANCE } else { FREE };
    covers(hand, palm).all(|(link, pose, cover)| {
        points(cover).all(|point| {
            let point = pose * point;
            let beside = (point - middle).xy().norm();
            let below = point.z < middle.z - ball.radius && beside < POST;
            let near = pressed != Some(link) && (point - middle).norm() < ball.radius + clearance;
            point.z > TABLE && !below && !near
        })
    })
}

/// A grid of points of a cover, link frame.
pub(crate) fn points(cover: &CoverShape) -> impl Iterator<Item = Point3<f64>> + '_ {
    let steps = move || -GRID..=GRID;
    let grid = steps().flat_map(move |x| steps().flat_map(move |y| steps().map(move |z| [x, y, z])));
    grid.map(|at| {
        let share = Vector3::from(at.map(|n| f64::from(n) / f64::from(GRID)));
        cover.link_from_cover * Point3::from(share.component_mul(&cover.half))
    })
}
