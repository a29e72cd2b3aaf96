//! Workspace limits of arm and hand: above the table, inside the workspace, clear of self-collision.

use crate::driven::SERVOS;

use hand_model::RobotModel;
use nalgebra::Vector3;

use super::bodies::{Bodies, Body, Side};
use super::state::Cause;

/// Workspace limits of arm and hand, in the frame of the arm's base, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpaceLimits {
    /// Height of the table.
    pub table: f64,
    /// Tolerance: depth below the table to which set-points may send a part.
    pub tolerance: f64,
    /// Least coordinates of every part from the elbow on; `high` has the greatest.
    pub low: [f64; 3],
    pub high: [f64; 3],
    /// Least distance between parts of the robot.
    pub clearance: f64,
}

/// Smallest margins to the workspace limits that have been commanded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Room {
    /// Height of the lowest point above the table, m.
    pub table: f64,
    /// Least distance from the sides of the workspace, m.
    pub sides: f64,
    /// Least distance between parts of the robot, m.
    pub clearance: f64,
}

impl Default for Room {
    fn default() -> Self {
        Self { table: f64::INFINITY, sides: f64::INFINITY, clearance: f64::INFINITY }
    }
}

/// Monitor that checks commanded positions against the workspace limits.
#[derive(Debug, Clone)]
pub struct SpaceWatch {
    bodies: Bodies,
    limits: SpaceLimits,
    room: Room,
}

impl SpaceWatch {
    pub fn new(robot: &RobotModel, limits: SpaceLimits) -> Self {
        Self { bodies: Bodies::new(robot), limits, room: Room::default() }
    }

    /// Returns the smallest margins commanded so far.
    pub fn room(&self) -> Room {
        self.room
    }

    /// Returns the violation that forbids sending the arm to `next` (rad) with the servos at `servos` (rad). A
    /// violation no deeper than that at `now` (rad) is allowed, so that the robot can leave a forbidden place.
    pub fn see(&mut self, next: &[f64], now: &[f64], servos: &[f64; SERVOS]) -> Option<Cause> {
        let room = self.look(next, servos);
        let least = |one: f64, other: f64| one.min(other);
        self.room = Room {
            table: least(self.room.table, room.0.table),
            sides: least(self.room.sides, room.0.sides),
            clearance: least(self.room.clearance, room.0.clearance),
        };
        let (cause, depth) = self.worst(&room)?;
        let (_, before) = self.worst(&self.look(now, servos)).unwrap_or((cause, 0.0));
        (depth > before).then_some(cause)
    }

    fn look(&self, q: &[f64], servos: &[f64; SERVOS]) -> (Room, [Cause; 3]) {
        let placed = self.bodies.placed(q, servos);
        let furthest = |direction: Vector3<f64>| {
            let start = (Body::Palm, f64::NEG_INFINITY);
            placed.reaches(direction).fold(start, |most, one| if one.1 > most.1 { one } else { most })
        };
        let (lowest, depth) = furthest(-Vector3::z());
        let table = -depth - self.limits.table;
        let mut sides = (f64::INFINITY, Cause::Workspace(Body::Palm, Side { axis: 0, upper: false }, 0.0));
        for axis in 0..3 {
            for upper in [false, true] {
                let sign = if upper { 1.0 } else { -1.0 };
                let (body, reach) = furthest(Vector3::ith(axis, sign));
                let bound = if upper { self.limits.high[axis] } else { -self.limits.low[axis] };
                if bound - reach < sides.0 {
                    sides = (bound - reach, Cause::Workspace(body, Side { axis, upper }, reach - bound));
                }
            }
        }
        let (clearance, [one, other]) = placed.nearest();
        let causes = [Cause::Table(lowest, -table), sides.1, Cause::SelfCollision(one, other, clearance)];
        (Room { table, sides: sides.0, clearance }, causes)
    }

    /// Returns the limit that is exceeded farthest, and by how much, m.
    fn worst(&self, (room, causes): &(Room, [Cause; 3])) -> Option<(Cause, f64)> {
        let limits = &self.limits;
        let depths = [-room.table - limits.tolerance, -room.sides, limits.clearance - room.clearance];
        let overstepped = causes.iter().copied().zip(depths).filter(|(_, depth)| *depth > 0.0);
        overstepped.max_by(|(_, a), (_, b)| a.total_cmp(b))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPEN: [f64; SERVOS] = [0.0; SERVOS];

    fn watch(limits: SpaceLimits) -> SpaceWatch {
        SpaceWatch::new(&RobotModel::ftac_gen3(), limits)
    }

    const WIDE: SpaceLimits =
        SpaceLimits { table: 0.0, tolerance: 0.02, low: [-2.0; 3], high: [2.0; 3], clearance: 0.0 };

    /// Each violated limit is named in the stop, and the arm may leave the violation again.
    #[test]
    fn each_bound_is_named_and_can_be_left() {
        let home = hand_model::Arm::gen3().home;
        assert_eq!(watch(WIDE).see(&home, &home, &OPEN), None);
        // The arm leans over at the shoulder with the elbow straight.
        let lying = [0.0, 1.9, 0.0, 0.0, 0.0, 0.0, 0.0];
        let lower = [0.0, 1.95, 0.0, 0.0, 0.0, 0.0, 0.0];
        let cause = watch(WIDE).see(&lying, &home, &OPEN);
        assert!(matches!(cause, Some(Cause::Table(_, below)) if below > 0.02), "{cause:?}");
        assert_eq!(watch(WIDE).see(&lying, &lower, &OPEN), None, "out of it");
        assert!(watch(WIDE).see(&lower, &lying, &OPEN).is_some(), "deeper");
        let folded = [0.0, 0.0, 0.0, 2.5, 0.0, 2.0, 0.0];
        let cause = watch(WIDE).see(&folded, &home, &OPEN);
        assert!(matches!(cause, Some(Cause::SelfCollision(_, Body::Arm(_), distance)) if distance < 0.0), "{cause:?}");
        let narrow = SpaceLimits { high: [0.5, 2.0, 2.0], ..WIDE };
        let cause = watch(narrow).see(&home, &[0.0; 7], &OPEN).expect("the hand reaches 0.65 m");
        assert!(matches!(cause, Cause::Workspace(Body::Finger(_), Side { axis: 0, upper: true }, _)), "{cause:?}");
        let words = cause.to_string();
        assert!(words.contains("limits.space.high, x") && words.contains("mm"), "{words}");
    }
}
