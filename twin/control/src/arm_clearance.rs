//! Self-collision: distances of the arm from itself and from the hand that it carries.
//!
//! Each link is a capsule from its joint to the next one. The hand is its palm and a box around the open digits. Links
//! that a joint connects are not compared, nor are the wrist and the palm that it carries. Pairs that overlap in the
//! home posture already are left out too, because the capsules are wider than the links.

use hand_model::{Arm, Hand};
use nalgebra::{Isometry3, Point3, Vector3};

use crate::collision::{CollisionError, Solid, hand_solids, signed_distance};
use crate::inverse_kinematics::{ArmKinematics, Joints};

/// Number of links, counted from the last, that form the wrist and carry the hand.
const WRIST_LINKS: usize = 3;

/// Bodies of arm and hand, each in the frame of its link.
#[derive(Clone)]
pub struct ArmBodies {
    /// The base, then the moving links.
    links: Vec<Solid>,
    /// Palm and digits, in the palm frame.
    hand: Vec<Solid>,
    /// Pairs that are compared: (link, link), and (hand body, link).
    checked_pairs: [Vec<(usize, usize)>; 2],
}

/// The closest pair of bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct SelfClearance {
    /// Distance, m; negative where they overlap.
    pub distance: f64,
    /// Names of the two bodies.
    pub between: [String; 2],
}

impl ArmBodies {
    /// Bodies of the arm of `kinematics` and of the open `hand`.
    pub fn new(kinematics: &ArmKinematics, hand: &Hand) -> Result<Self, CollisionError> {
        let arm = kinematics.arm();
        let links = link_solids(arm);
        let hand = hand_solids(hand, &hand.open_angles(), hand.digits(), true);
        let among = (0..links.len()).flat_map(|first| (first + 2..links.len()).map(move |second| (first, second)));
        let with_hand =
            (0..hand.len()).flat_map(|body| (0..links.len().saturating_sub(WRIST_LINKS)).map(move |link| (body, link)));
        let compared = [among.collect(), with_hand.collect()];
        let mut bodies = Self { links, hand, checked_pairs: compared };
        let overlapping = bodies.distances(kinematics, &arm.home)?;
        for (compared, distances) in bodies.checked_pairs.iter_mut().zip(overlapping) {
            let mut distances = distances.into_iter();
            compared.retain(|_| distances.next().is_some_and(|distance| distance > 0.0));
        }
        Ok(bodies)
    }

    /// Computes the distance (m) of every compared pair at joint angles `q` (rad).
    fn distances(&self, kinematics: &ArmKinematics, q: &Joints) -> Result<[Vec<f64>; 2], CollisionError> {
        let mut poses = vec![kinematics.mount().world_from_base];
        poses.extend(kinematics.link_poses(q));
        let palm = kinematics.palm_pose(q);
        let placed: Vec<Solid> =
            self.links.iter().zip(&poses).map(|(link, pose)| Solid { pose: *pose, ..link.clone() }).collect();
        let [among, with_hand] = &self.checked_pairs;
        let among = among.iter().map(|&(a, b)| signed_distance(&placed[a], &placed[a].pose, &placed[b]));
        let with_hand = with_hand.iter().map(|&(body, link)| {
            let body = &self.hand[body];
            signed_distance(body, &(palm * body.pose), &placed[link])
        });
        Ok([among.collect::<Result<_, _>>()?, with_hand.collect::<Result<_, _>>()?])
    }

    /// Finds the closest of the compared pairs at joint angles `q` (rad).
    pub fn clearance(&self, kinematics: &ArmKinematics, q: &Joints) -> Result<SelfClearance, CollisionError> {
        let mut nearest = SelfClearance { distance: f64::INFINITY, between: [String::new(), String::new()] };
        let bodies = [&self.links, &self.hand];
        for ((compared, distances), bodies) in self.checked_pairs.iter().zip(self.distances(kinematics, q)?).zip(bodies)
        {
            for (&(a, b), distance) in compared.iter().zip(distances) {
                if distance < nearest.distance {
                    nearest = SelfClearance { distance, between: [bodies[a].name.clone(), self.links[b].name.clone()] };
                }
            }
        }
        Ok(nearest)
    }

    /// Height (m) above the plane z = 0 of the world of the lowest point of the hand and of the links from the third
    /// joint on.
    pub fn lowest_point_height(&self, kinematics: &ArmKinematics, q: &Joints) -> Result<f64, CollisionError> {
        let table = Solid::table(0.0);
        let palm = kinematics.palm_pose(q);
        let mut lowest = f64::INFINITY;
        for (link, pose) in self.links.iter().skip(3).zip(kinematics.link_poses(q).iter().skip(2)) {
            let tip = link.shape.as_segment().map_or(Vector3::zeros(), |s| Vector3::new(s.b.x, s.b.y, s.b.z));
            let ends = [Point3::origin(), Point3::from(tip)].map(|end| (pose * end).z);
            lowest = lowest.min(ends[0].min(ends[1]) - link.margin);
        }
        for body in &self.hand {
            lowest = lowest.min(signed_distance(body, &(palm * body.pose), &table)?);
        }
        Ok(lowest)
    }
}

/// Returns the base of the arm and its links as capsules, each in its own frame.
pub fn link_solids(arm: &Arm) -> Vec<Solid> {
    let names = std::iter::once("base").chain(arm.links.iter().map(String::as_str));
    names
        .zip(arm.tube_ends())
        .zip(&arm.radii)
        .map(|((name, end), radius)| Solid::capsule(name, &end, *radius, Isometry3::identity()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inverse_kinematics::ArmMount;

    fn arm() -> (ArmKinematics, ArmBodies) {
        let hand = Hand::ftac();
        let kinematics = ArmKinematics::new(Arm::gen3(), ArmMount::for_hand(&hand, 0.0));
        let bodies = ArmBodies::new(&kinematics, &hand).expect("comparable");
        (kinematics, bodies)
    }

    #[test]
    fn upright_and_home_are_free() {
        let (kinematics, bodies) = arm();
        for q in [[0.0; 7].into(), Arm::gen3().home] {
            let clearance = bodies.clearance(&kinematics, &q).expect("comparable");
            assert!(clearance.distance > 0.0, "{clearance:?}");
        }
    }

    /// With the elbow folded as far as it goes and the wrist turned in, the hand runs into the upper arm.
    #[test]
    fn folded_in_it_runs_into_itself() {
        let (kinematics, bodies) = arm();
        let q = [0.0, 0.0, 0.0, 2.5, 0.0, 2.0, 0.0].into();
        let clearance = bodies.clearance(&kinematics, &q).expect("comparable");
        assert!(clearance.distance < 0.0, "{clearance:?}");
    }

    /// With the arm upright, the lowest of the checked bodies is the tube that begins at the third joint.
    #[test]
    fn height_is_the_geometry_s() {
        let (kinematics, bodies) = arm();
        let upright = [0.0; 7].into();
        let links = kinematics.link_poses(&upright);
        let lowest = bodies.lowest_point_height(&kinematics, &upright).expect("comparable");
        assert!((lowest - (links[2].translation.z - kinematics.arm().radii[3])).abs() < 1e-9, "{lowest}");
    }
}
