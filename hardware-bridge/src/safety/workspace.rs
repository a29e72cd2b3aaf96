//! Workspace limits of arm and hand: above the table, inside the workspace, clear of self-collision.

use hand_model::RobotModel;
use nalgebra::Vector3;

use super::collision_bodies::{CollisionBodies, CollisionBody, WorkspaceSide};
use super::state::StopCause;

/// Workspace limits of arm and hand, in the frame of the arm's base, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorkspaceLimits {
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
pub struct WorkspaceMargins {
    /// Height of the lowest point above the table, m.
    pub table: f64,
    /// Least distance from the sides of the workspace, m.
    pub sides: f64,
    /// Least distance between parts of the robot, m.
    pub clearance: f64,
}

impl Default for WorkspaceMargins {
    fn default() -> Self {
        Self { table: f64::INFINITY, sides: f64::INFINITY, clearance: f64::INFINITY }
    }
}

/// Monitor that checks commanded positions against the workspace limits.
#[derive(Debug, Clone)]
pub struct WorkspaceMonitor {
    bodies: CollisionBodies,
    limits: WorkspaceLimits,
    margins: WorkspaceMargins,
}

impl WorkspaceMonitor {
    pub fn new(robot: &RobotModel, limits: WorkspaceLimits) -> Self {
        Self { bodies: CollisionBodies::new(robot), limits, margins: WorkspaceMargins::default() }
    }

    /// Returns the smallest margins commanded so far.
    pub fn margins(&self) -> WorkspaceMargins {
        self.margins
    }

    /// Returns the violation that forbids sending the arm to `next` (rad) with the servos at `servos` (rad). A
    /// violation no deeper than that at `now` (rad) is allowed, so that the robot can leave a forbidden place.
    pub fn check(&mut self, next: &[f64], now: &[f64], servos: &[f64]) -> Option<StopCause> {
        let room = self.margins_at(next, servos);
        let least = |one: f64, other: f64| one.min(other);
        self.margins = WorkspaceMargins {
            table: least(self.margins.table, room.0.table),
            sides: least(self.margins.sides, room.0.sides),
            clearance: least(self.margins.clearance, room.0.clearance),
        };
        let (cause, depth) = self.worst_violation(&room)?;
        let (_, before) = self.worst_violation(&self.margins_at(now, servos)).unwrap_or((cause, 0.0));
        (depth > before).then_some(cause)
    }

    fn margins_at(&self, q: &[f64], servos: &[f64]) -> (WorkspaceMargins, [StopCause; 3]) {
        let placed = self.bodies.place_at(q, servos);
        let furthest = |direction: Vector3<f64>| {
            let start = (CollisionBody::Palm, f64::NEG_INFINITY);
            placed.extents(direction).fold(start, |most, one| if one.1 > most.1 { one } else { most })
        };
        let (lowest, depth) = furthest(-Vector3::z());
        let table = -depth - self.limits.table;
        let mut sides =
            (f64::INFINITY, StopCause::Workspace(CollisionBody::Palm, WorkspaceSide { axis: 0, upper: false }, 0.0));
        for axis in 0..3 {
            for upper in [false, true] {
                let sign = if upper { 1.0 } else { -1.0 };
                let (body, reach) = furthest(Vector3::ith(axis, sign));
                let bound = if upper { self.limits.high[axis] } else { -self.limits.low[axis] };
                if bound - reach < sides.0 {
                    sides = (bound - reach, StopCause::Workspace(body, WorkspaceSide { axis, upper }, reach - bound));
                }
            }
        }
        let (clearance, [one, other]) = placed.nearest_pair();
        let causes = [StopCause::Table(lowest, -table), sides.1, StopCause::SelfCollision(one, other, clearance)];
        (WorkspaceMargins { table, sides: sides.0, clearance }, causes)
    }

    /// Returns the limit that is exceeded farthest, and by how much, m.
    fn worst_violation(&self, (room, causes): &(WorkspaceMargins, [StopCause; 3])) -> Option<(StopCause, f64)> {
        let limits = &self.limits;
        let depths = [-room.table - limits.tolerance, -room.sides, limits.clearance - room.clearance];
        let overstepped = causes.iter().copied().zip(depths).filter(|(_, depth)| *depth > 0.0);
        overstepped.max_by(|(_, a), (_, b)| a.total_cmp(b))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPEN: [f64; 6] = [0.0; 6];

    fn watch(limits: WorkspaceLimits) -> WorkspaceMonitor {
        WorkspaceMonitor::new(&RobotModel::ftac_gen3(), limits)
    }

    const WIDE: WorkspaceLimits =
        WorkspaceLimits { table: 0.0, tolerance: 0.02, low: [-2.0; 3], high: [2.0; 3], clearance: 0.0 };

    /// Each violated limit is named in the stop, and the arm may leave the violation again.
    #[test]
    fn each_bound_is_named_and_can_be_left() {
        let home = hand_model::Arm::gen3().home;
        assert_eq!(watch(WIDE).check(&home, &home, &OPEN), None);
        // The arm leans over at the shoulder with the elbow straight.
        let lying = [0.0, 1.9, 0.0, 0.0, 0.0, 0.0, 0.0];
        let lower = [0.0, 1.95, 0.0, 0.0, 0.0, 0.0, 0.0];
        let cause = watch(WIDE).check(&lying, &home, &OPEN);
        assert!(matches!(cause, Some(StopCause::Table(_, below)) if below > 0.02), "{cause:?}");
        assert_eq!(watch(WIDE).check(&lying, &lower, &OPEN), None, "out of it");
        assert!(watch(WIDE).check(&lower, &lying, &OPEN).is_some(), "deeper");
        let folded = [0.0, 0.0, 0.0, 2.5, 0.0, 2.0, 0.0];
        let cause = watch(WIDE).check(&folded, &home, &OPEN);
        assert!(
            matches!(cause, Some(StopCause::SelfCollision(_, CollisionBody::Arm(_), distance)) if distance < 0.0),
            "{cause:?}"
        );
        let narrow = WorkspaceLimits { high: [0.5, 2.0, 2.0], ..WIDE };
        let cause = watch(narrow).check(&home, &[0.0; 7], &OPEN).expect("the hand reaches 0.65 m");
        assert!(
            matches!(cause, StopCause::Workspace(CollisionBody::Finger(_), WorkspaceSide { axis: 0, upper: true }, _)),
            "{cause:?}"
        );
        let words = cause.to_string();
        assert!(words.contains("limits.space.high, x") && words.contains("mm"), "{words}");
    }
}
