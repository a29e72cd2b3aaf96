//! Collision model of arm and hand, simple enough to be placed in every cycle.
//!
//! Arm links are the tubes of [`hand_model::Arm::tube_ends`]. Links of the hand are their covers: rounded boxes for
//! heights and extents, which are exact, and enclosing capsules for distances. Digits take the posture of their servo
//! angles as if they touched nothing.

use std::fmt;

use hand_model::digit::Digit;
use hand_model::hand::CoverShape;
use hand_model::{Hand, HandVector, RobotModel};
use nalgebra::{Isometry3, Point3, Vector3};

/// A part of the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CollisionBody {
    /// A part of the arm: 0 is the base, 1 to 7 are the links.
    Arm(usize),
    Palm,
    /// A link of the hand, 0 to 14: three for each digit.
    Finger(usize),
}

impl fmt::Display for CollisionBody {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Arm(0) => write!(f, "the arm's base"),
            Self::Arm(link) => write!(f, "arm link {link}"),
            Self::Palm => write!(f, "the palm"),
            Self::Finger(link) => {
                let digit = Digit::ALL.get(link / 3).map_or("digit", |digit| digit.name());
                write!(f, "{digit} link {}", link % 3 + 1)
            }
        }
    }
}

/// Capsule: a segment with a radius, m.
#[derive(Debug, Clone, Copy)]
pub struct Capsule {
    pub ends: [Point3<f64>; 2],
    pub radius: f64,
}

impl Capsule {
    fn transformed(&self, pose: &Isometry3<f64>) -> Self {
        Self { ends: self.ends.map(|end| pose * end), radius: self.radius }
    }

    /// Computes the distance between two capsules, m; negative if they overlap.
    pub fn distance(&self, other: &Self) -> f64 {
        segment_distance(&self.ends, &other.ends) - self.radius - other.radius
    }
}

/// Computes the distance between two segments (Ericson, Real-Time Collision Detection, 5.1.9).
fn segment_distance(one: &[Point3<f64>; 2], other: &[Point3<f64>; 2]) -> f64 {
    let (u, v, w) = (one[1] - one[0], other[1] - other[0], one[0] - other[0]);
    let (a, b, c, d, e) = (u.norm_squared(), u.dot(&v), v.norm_squared(), u.dot(&w), v.dot(&w));
    let share = |up: f64, down: f64| if down > 1e-18 { (up / down).clamp(0.0, 1.0) } else { 0.0 };
    let s = share(b * e - c * d, a * c - b * b);
    let t = share(b * s + e, c);
    // Point of the first segment nearest to that of the second.
    let s = share(b * t - d, a);
    (w + u * s - v * t).norm()
}

/// Computes capsules that enclose a cover, side by side along its second longest axis, in the link's frame.
fn enclosing_capsules(cover: &CoverShape) -> Vec<Capsule> {
    let mut axes = [0, 1, 2];
    axes.sort_by(|a, b| cover.half[*b].total_cmp(&cover.half[*a]));
    let [long, wide, thin] = axes.map(|axis| cover.half[axis]);
    let count = (wide / thin).round().max(1.0);
    let radius = (wide / count).hypot(thin);
    let side = |n: f64| wide * ((2.0 * n + 1.0) / count - 1.0);
    let ends = |n: f64| {
        [-1.0, 1.0].map(|sign| {
            let mut at = Vector3::zeros();
            at[axes[0]] = sign * (long - 0.5 * radius).max(0.0);
            at[axes[1]] = side(n);
            cover.link_from_cover * Point3::from(at)
        })
    };
    (0..count as usize).map(|n| Capsule { ends: ends(n as f64), radius }).collect()
}

/// Lookup tables from servo angles to joint angles of the digits.
#[derive(Debug, Clone)]
struct PostureTable {
    /// Table of each cable, with rising angles: servo angle, and the angles of its joints, rad.
    tables: Vec<Vec<(f64, [f64; 3])>>,
    joints: Vec<Vec<usize>>,
    /// Joint that the last servo turns, and the gear ratio between the two.
    opposition: Option<(usize, f64)>,
    open: HandVector,
}

impl PostureTable {
    /// Number of tensions in a table, and the greatest of them, N. Half of it closes a digit.
    const TENSION_GRID: (u32, f64) = (48, 60.0);

    fn new(hand: &Hand) -> Self {
        let transmission = &hand.transmission;
        let table = |cable: usize| {
            let own = &hand.cables[cable];
            let at = |n: u32| {
                let share = f64::from(n) / f64::from(Self::TENSION_GRID.0);
                let tension = Self::TENSION_GRID.1 * share * share;
                let angles = transmission.free_angles(cable, tension);
                let mut q = hand.open_angles();
                angles.iter().for_each(|(joint, angle)| q[*joint] = *angle);
                let wound = transmission.cables[cable].excursion(&q) + tension / own.stiffness;
                let of = |n: usize| angles.get(n).map_or(0.0, |(_, angle)| *angle);
                (wound / own.spool_radius, [of(0), of(1), of(2)])
            };
            (0..=Self::TENSION_GRID.0).map(at).collect()
        };
        let joints =
            transmission.cables.iter().map(|cable| cable.joints.iter().map(|crossing| crossing.joint).collect());
        // The opposition is driven by the actuator after the digits'.
        let gear = hand.servos.get(transmission.cables.len()).map(|servo| servo.gear_ratio_opposition);
        Self {
            tables: (0..transmission.cables.len()).map(table).collect(),
            joints: joints.collect(),
            opposition: transmission.opposition.zip(gear),
            open: hand.open_angles(),
        }
    }

    fn joint_angles(&self, servos: &[f64]) -> HandVector {
        let mut q = self.open;
        if let (Some((joint, gear)), Some(servo)) = (self.opposition, servos.get(self.tables.len())) {
            q[joint] = (servo / gear).clamp(0.0, std::f64::consts::FRAC_PI_2);
        }
        for ((table, joints), servo) in self.tables.iter().zip(&self.joints).zip(servos) {
            let next = table.partition_point(|(angle, _)| angle < servo).clamp(1, table.len() - 1);
            let ((low, from), (high, to)) = (table[next - 1], table[next]);
            let share = ((servo - low) / (high - low).max(1e-9)).clamp(0.0, 1.0);
            for (n, joint) in joints.iter().enumerate().take(3) {
                q[*joint] = from[n] + (to[n] - from[n]) * share;
            }
        }
        q
    }
}

/// Collision model of arm and hand.
#[derive(Debug, Clone)]
pub struct CollisionBodies {
    robot: RobotModel,
    /// Capsules of the arm's base and links, each in its own frame.
    arm_capsules: Vec<Capsule>,
    /// Covers of the palm and of the 15 links of the hand, in this order, each in its own frame.
    covers: Vec<(CoverShape, Vec<Capsule>)>,
    last_from_palm: Isometry3<f64>,
    postures: PostureTable,
}

/// Collision model in a posture, in the frame of the arm's base.
#[derive(Debug, Clone)]
pub struct PlacedBodies<'a> {
    bodies: &'a CollisionBodies,
    arm: Vec<Isometry3<f64>>,
    /// Poses of the palm and of the 15 links of the hand, in this order.
    hand: Vec<Isometry3<f64>>,
}

/// First arm link whose height is checked: those before it stand on the table.
const FIRST_CHECKED_LINK: usize = 3;
/// Number of the arm's last links, which carry the hand and are not compared with it.
const WRIST_LINK_COUNT: usize = 3;

impl CollisionBodies {
    pub fn new(robot: &RobotModel) -> Self {
        let (hand, arm) = (&robot.hand, &robot.arm);
        let ends = arm.tube_ends();
        let tube = |n: usize| Capsule { ends: [Point3::origin(), Point3::from(ends[n])], radius: arm.radii[n] };
        let covers = std::iter::once(&hand.palm_cover).chain(&hand.covers);
        Self {
            arm_capsules: (0..=arm.joints()).map(tube).collect(),
            covers: covers.map(|cover| (*cover, enclosing_capsules(cover))).collect(),
            last_from_palm: arm.last_from_tool * hand.palm_from_flange.inverse(),
            postures: PostureTable::new(hand),
            robot: robot.clone(),
        }
    }

    /// Places the bodies with the arm at joint angles `q` and the servos at angles `servos`, rad.
    pub fn place_at(&self, q: &[f64], servos: &[f64]) -> PlacedBodies<'_> {
        let links = self.robot.arm.tree.forward(q);
        let palm = links[self.robot.arm.last_link()] * self.last_from_palm;
        let digits = self.robot.hand.tree.forward(&self.postures.joint_angles(servos));
        let arm = std::iter::once(Isometry3::identity()).chain(links).collect();
        let hand = std::iter::once(palm).chain(digits.iter().map(|link| palm * link)).collect();
        PlacedBodies { bodies: self, arm, hand }
    }
}

fn hand_body(n: usize) -> CollisionBody {
    n.checked_sub(1).map_or(CollisionBody::Palm, CollisionBody::Finger)
}

impl PlacedBodies<'_> {
    /// Returns the furthest reach along a direction, m, of each part that moves freely.
    pub fn extents(&self, direction: Vector3<f64>) -> impl Iterator<Item = (CollisionBody, f64)> {
        let tubes = (FIRST_CHECKED_LINK..self.arm.len()).map(move |n| {
            let tube = self.bodies.arm_capsules[n].transformed(&self.arm[n]);
            let [one, other] = tube.ends.map(|end| end.coords.dot(&direction));
            (CollisionBody::Arm(n), one.max(other) + tube.radius)
        });
        let covers = self.bodies.covers.iter().zip(&self.hand).enumerate().map(move |(n, ((cover, _), pose))| {
            let placed = pose * cover.link_from_cover;
            let local = placed.rotation.inverse() * direction;
            let core = cover.half.add_scalar(-cover.radius);
            (hand_body(n), placed.translation.vector.dot(&direction) + local.abs().dot(&core) + cover.radius)
        });
        tubes.chain(covers)
    }

    /// Returns the distance of the two nearest parts that could touch, m, and the two parts.
    pub fn nearest_pair(&self) -> (f64, [CollisionBody; 2]) {
        let tubes: Vec<Capsule> =
            self.bodies.arm_capsules.iter().zip(&self.arm).map(|(tube, pose)| tube.transformed(pose)).collect();
        let mut nearest = (f64::INFINITY, [CollisionBody::Palm; 2]);
        let mut compare = |between: [CollisionBody; 2], distance: f64| {
            if distance < nearest.0 {
                nearest = (distance, between);
            }
        };
        for (n, first) in tubes.iter().enumerate() {
            for (m, second) in tubes.iter().enumerate().skip(n + 2) {
                compare([CollisionBody::Arm(n), CollisionBody::Arm(m)], first.distance(second));
            }
        }
        for (n, ((_, capsules), pose)) in self.bodies.covers.iter().zip(&self.hand).enumerate() {
            for capsule in capsules {
                let capsule = capsule.transformed(pose);
                for (m, tube) in tubes.iter().enumerate().take(tubes.len() - WRIST_LINK_COUNT) {
                    compare([hand_body(n), CollisionBody::Arm(m)], capsule.distance(tube));
                }
            }
        }
        nearest
    }
}

/// A side of the workspace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WorkspaceSide {
    /// Axis, 0 to 2: x, y, z.
    pub axis: usize,
    pub upper: bool,
}

impl fmt::Display for WorkspaceSide {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let axis = ["x", "y", "z"].get(self.axis).unwrap_or(&"?");
        write!(f, "limits.space.{}, {axis}", if self.upper { "high" } else { "low" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Point3<f64>> {
        prop::array::uniform3(-1.0..1.0_f64).prop_map(|at| Point3::from(Vector3::from(at)))
    }

    proptest! {
        /// No two points of the segments are nearer than the distance, and some are hardly farther.
        #[test]
        fn segments_are_as_far_apart_as_their_nearest_points(a in point(), b in point(), c in point(), d in point()) {
            let found = segment_distance(&[a, b], &[c, d]);
            let steps = || (0..=100).map(|n| f64::from(n) / 100.0);
            let pairs = steps().flat_map(|s| steps().map(move |t| (s, t)));
            let least = pairs.map(|(s, t)| ((a + (b - a) * s) - (c + (d - c) * t)).norm()).fold(f64::INFINITY, f64::min);
            prop_assert!(found <= least + 1e-9 && least - found < 0.03, "{found} {least}");
        }
    }

    /// A cover's height is that of its skin in any posture. No skin is outside the capsules by more than the rounding
    /// of their ends.
    #[test]
    fn covers_are_as_high_as_their_skin() {
        let bodies = CollisionBodies::new(&RobotModel::ftac_gen3());
        let placed = bodies.place_at(&[0.4, 0.5, 2.9, -2.1, 0.3, 0.9, 1.4], &[1.0, 2.0, 0.5, 3.0, 1.5, 0.7]);
        let down = -Vector3::z();
        for (body, reach) in placed.extents(down) {
            let n = match body {
                CollisionBody::Arm(_) => continue,
                CollisionBody::Palm => 0,
                CollisionBody::Finger(link) => link + 1,
            };
            let (cover, capsules) = &bodies.covers[n];
            let skin = cover.skin_elements(0.0005);
            let furthest =
                skin.iter().map(|one| (placed.hand[n] * one.point).coords.dot(&down)).fold(f64::MIN, f64::max);
            assert!((reach - furthest).abs() < 1e-3, "{body}: {reach} {furthest}");
            let outside = |at: &Point3<f64>| {
                let of = |capsule: &Capsule| segment_distance(&[*at, *at], &capsule.ends) - capsule.radius;
                capsules.iter().map(of).fold(f64::INFINITY, f64::min)
            };
            assert!(skin.iter().all(|one| outside(&one.point) < 2e-3), "{body}");
        }
    }

    /// Upright and at home nothing touches; the forearm and the link after the next are always 20 mm apart. Folded in
    /// at the elbow, the hand collides with the arm, and the parts are named.
    #[test]
    fn folded_in_it_runs_into_itself() {
        let bodies = CollisionBodies::new(&RobotModel::ftac_gen3());
        for q in [[0.0; 7].into(), hand_model::Arm::gen3().home] {
            let (distance, between) = bodies.place_at(&q, &[0.0; 6]).nearest_pair();
            assert!(distance > 0.015, "{distance}: {between:?}");
        }
        let (distance, [one, other]) = bodies.place_at(&[0.0, 0.0, 0.0, 2.5, 0.0, 2.0, 0.0], &[0.0; 6]).nearest_pair();
        assert!(distance < 0.0 && matches!(other, CollisionBody::Arm(_)), "{distance}: {one}, {other}");
    }

    /// Servo angles wind the digits as far as springs and cable allow.
    #[test]
    fn digits_stand_as_their_servos_say() {
        let hand = Hand::ftac();
        let postures = PostureTable::new(&hand);
        let tensions = [3.0, 5.0, 8.0, 2.0, 11.0];
        let free = hand_model::statics::free_equilibrium(&hand, &tensions, 0.6);
        let servos: [f64; 6] = std::array::from_fn(|n| match tensions.get(n) {
            Some(tension) => {
                let own = &hand.cables[n];
                (hand.transmission.cables[n].excursion(&free) + tension / own.stiffness) / own.spool_radius
            }
            None => 0.6 * hand.servos[n].gear_ratio_opposition,
        });
        let found = postures.joint_angles(&servos);
        assert!(found.iter().zip(&free).all(|(a, b)| (a - b).abs() < 0.02), "{found:?}\n{free:?}");
    }
}
