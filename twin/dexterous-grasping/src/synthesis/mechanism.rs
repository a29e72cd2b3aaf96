//! Mechanism of the hand for the energy: joint limits, and the lines in joint space along which actuators move.

use hand_model::Hand;
use hand_model::hand_mechanism::HandMechanism;
use hand_model::kinematics::JointKind;

/// Radians that a metre of a sliding joint counts as: the angle by which a fingertip 50 mm from its joint moves as far.
const RADIANS_PER_METRE: f64 = 20.0;

/// A line in joint space along which one actuator moves its joints, free of contact.
#[derive(Debug, Clone, PartialEq)]
pub struct ActuatorLine {
    /// Joints it moves, including coupled ones.
    pub joints: Vec<usize>,
    /// Ratio of each joint's angle to the mean.
    pub share: Vec<f64>,
    /// Angle of each joint at the line's zero, rad: the offset of a joint that follows another.
    pub offset: Vec<f64>,
}

/// Joint limits and actuator lines.
#[derive(Debug, Clone, PartialEq)]
pub struct Mechanism {
    /// Lower and upper limit of each joint, rad or m.
    pub limits: Vec<(f64, f64)>,
    /// Radians that a unit of each joint's coordinate counts as. 1 for a revolute joint.
    pub scale: Vec<f64>,
    /// Lines, one per actuator.
    pub lines: Vec<ActuatorLine>,
}

impl Mechanism {
    /// Builds the mechanism of the F-TAC Hand. The free posture at a medium tension gives the direction in which a
    /// cable moves its joints.
    pub fn from_hand(hand: &Hand) -> Self {
        let lines = (0..hand.transmission.cables.len()).map(|cable| {
            let angles = hand.transmission.free_angles(cable, 5.0);
            let mean = angles.iter().map(|(_, q)| q).sum::<f64>() / angles.len() as f64;
            ActuatorLine {
                joints: angles.iter().map(|(joint, _)| *joint).collect(),
                share: angles.iter().map(|(_, q)| q / mean).collect(),
                offset: vec![0.0; angles.len()],
            }
        });
        Self {
            limits: hand.tree.joints.iter().map(|joint| (joint.lower, joint.upper)).collect(),
            scale: vec![1.0; hand.tree.len()],
            lines: lines.collect(),
        }
    }

    /// Builds the mechanism of a hand from a URDF: equal springs against the moment arms, and coupled joints with their
    /// leaders. Joints without an actuator stay at rest: both limits are the rest angle.
    pub fn from_urdf(hand: &HandMechanism) -> Self {
        let rest = hand.rest_coordinates();
        let mut limits: Vec<(f64, f64)> = rest.iter().map(|q| (*q, *q)).collect();
        // A line has its zero where its springs rest. A coupled joint is then where its leader's rest position puts it.
        let offset = |joint: usize| {
            let follower = hand.followers.iter().find(|follower| follower.joint == joint);
            follower.map_or(hand.spring_rest[joint], |own| own.multiplier * hand.spring_rest[own.leader] + own.offset)
        };
        let lines = hand.actuators.iter().map(|pull| {
            let mut line: Vec<(usize, f64)> = pull.moment_arms().collect();
            for follower in &hand.followers {
                if let Some((_, arm)) = pull.moment_arms().find(|(joint, _)| *joint == follower.leader) {
                    line.push((follower.joint, arm * follower.multiplier));
                }
            }
            // Fingers may close by turning in opposite directions, so the mean is of absolute values.
            let mean = line.iter().map(|(_, arm)| arm.abs()).sum::<f64>() / line.len() as f64;
            ActuatorLine {
                joints: line.iter().map(|(joint, _)| *joint).collect(),
                share: line.iter().map(|(_, arm)| arm / mean).collect(),
                offset: line.iter().map(|(joint, _)| offset(*joint)).collect(),
            }
        });
        let lines: Vec<ActuatorLine> = lines.collect();
        for joint in lines.iter().flat_map(|line| &line.joints) {
            limits[*joint] = (hand.tree.joints[*joint].lower, hand.tree.joints[*joint].upper);
        }
        let scale = hand.tree.joints.iter().map(|joint| match joint.kind {
            JointKind::Turn => 1.0,
            JointKind::Slide => RADIANS_PER_METRE,
        });
        Self { limits, scale: scale.collect(), lines }
    }

    /// Holds the joints for which `moves` is false at `angles`, rad or m, within their limits.
    pub fn hold_others(&mut self, moves: impl Fn(usize) -> bool, angles: &[f64]) {
        for (joint, limits) in self.limits.iter_mut().enumerate().filter(|(joint, _)| !moves(*joint)) {
            let angle = angles[joint].clamp(limits.0, limits.1);
            *limits = (angle, angle);
        }
        self.lines.retain(|line| line.joints.iter().all(|joint| moves(*joint)));
    }

    /// Narrows the limits of `joint` to `range`, rad or m, as far as they overlap.
    pub fn narrow_limits(&mut self, joint: usize, [low, high]: [f64; 2]) {
        let (lower, upper) = self.limits[joint];
        self.limits[joint] = (low.clamp(lower, upper), high.clamp(lower, upper));
    }

    /// Returns a step of 1 rad along an actuator's line in its own unit: 1 if its joints are revolute.
    pub fn unit(&self, line: usize) -> f64 {
        let own = &self.lines[line].joints;
        own.len() as f64 / own.iter().map(|joint| self.scale[*joint]).sum::<f64>()
    }

    /// Returns the position along an actuator's line, rad: the mean of its joint coordinates, signed by the line's
    /// direction.
    pub fn amount(&self, line: usize, joints: &[f64]) -> f64 {
        let ActuatorLine { joints: own, share, offset } = &self.lines[line];
        let along = own.iter().zip(share).zip(offset);
        along.map(|((joint, share), offset)| (joints[*joint] - offset) * share.signum()).sum::<f64>() / own.len() as f64
    }

    /// Sets the joints of an actuator to the position `amount` on its line, clamped to their limits.
    pub fn set_amount(&self, line: usize, amount: f64, joints: &mut [f64]) {
        let ActuatorLine { joints: own, share, offset } = &self.lines[line];
        for ((joint, share), offset) in own.iter().zip(share).zip(offset) {
            joints[*joint] = (amount * share + offset).clamp(self.limits[*joint].0, self.limits[*joint].1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines() -> Mechanism {
        let line = ActuatorLine { joints: vec![0, 2], share: vec![1.5, -0.5], offset: vec![0.0, 0.0] };
        Mechanism { limits: vec![(-1.0, 1.0), (0.3, 0.3), (-0.2, 0.2)], scale: vec![1.0; 3], lines: vec![line] }
    }

    /// A position set on a line is read back from it, up to the joint limits.
    #[test]
    fn amounts_along_a_line() {
        let mechanism = lines();
        let mut joints = [0.0, 0.3, 0.0];
        mechanism.set_amount(0, 0.3, &mut joints);
        assert_eq!(joints, [0.3 * 1.5, 0.3, -0.3 * 0.5]);
        assert!((mechanism.amount(0, &joints) - 0.3).abs() < 1e-12);
        mechanism.set_amount(0, 2.0, &mut joints);
        assert_eq!(joints, [1.0, 0.3, -0.2]);
        let mut shifted = lines();
        shifted.lines[0].offset[1] = 0.1;
        shifted.set_amount(0, 0.3, &mut joints);
        assert!((joints[2] + 0.05).abs() < 1e-12 && (shifted.amount(0, &joints) - 0.3).abs() < 1e-12, "{joints:?}");
    }

    /// A joint that is held keeps its coordinate and no longer has a line.
    #[test]
    fn other_joints_are_held() {
        let mut mechanism = lines();
        mechanism.hold_others(|joint| joint != 2, &[0.5, 0.5, 0.5]);
        assert_eq!(mechanism.limits, [(-1.0, 1.0), (0.3, 0.3), (0.2, 0.2)]);
        assert!(mechanism.lines.is_empty());
    }

    /// One line per cable with the joints of its digit, all closing, near the free postures at other tensions too.
    #[test]
    fn lines_of_the_hand_are_near_its_free_postures() {
        let hand = Hand::ftac();
        let mechanism = Mechanism::from_hand(&hand);
        assert_eq!((mechanism.lines.len(), mechanism.limits.len()), (5, 15));
        for (cable, line) in mechanism.lines.iter().enumerate() {
            let digit = hand_model::Digit::ALL[cable];
            assert!(line.joints.iter().all(|joint| hand.links(digit).contains(joint)), "{line:?}");
            assert!(line.share.iter().all(|share| *share > 0.0), "{line:?}");
            for tension in [2.0, 10.0] {
                let mut free = [0.0; 15];
                for (joint, angle) in hand.transmission.free_angles(cable, tension) {
                    free[joint] = angle;
                }
                let mut on_line = free;
                mechanism.set_amount(cable, mechanism.amount(cable, &free), &mut on_line);
                let off = line.joints.iter().map(|&joint| (free[joint] - on_line[joint]).abs()).fold(0.0, f64::max);
                println!("cable {cable} at {tension} N: {off} rad off its line");
                assert!(off < 0.15, "cable {cable} at {tension} N: {off} rad off its line");
            }
        }
    }
}
