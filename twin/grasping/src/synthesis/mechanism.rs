//! What the energy has to know of a hand's mechanism: limits of the joints, and along which lines the actuators move them.

use hand_model::Hand;
use hand_model::any_hand::AnyHand;

/// A line in joint space along which one actuator moves its joints, free of contact.
#[derive(Debug, Clone, PartialEq)]
pub struct ActuatorLine {
    /// The joints it moves, those that follow others included.
    pub joints: Vec<usize>,
    /// Angle of each over the mean angle of all.
    pub share: Vec<f64>,
}

/// Limits and lines.
#[derive(Debug, Clone, PartialEq)]
pub struct Mechanism {
    /// Lower and upper limit of each joint, rad.
    pub limits: Vec<(f64, f64)>,
    /// One an actuator.
    pub lines: Vec<ActuatorLine>,
}

impl Mechanism {
    /// Of the F-TAC Hand: the free posture at a middling tension gives the direction in which a cable moves its joints.
    pub fn of(hand: &Hand) -> Self {
        let lines = (0..hand.transmission.cables.len()).map(|cable| {
            let angles = hand.transmission.free_angles(cable, 5.0, std::f64::consts::FRAC_PI_2);
            let mean = angles.iter().map(|(_, q)| q).sum::<f64>() / angles.len() as f64;
            ActuatorLine {
                joints: angles.iter().map(|(joint, _)| *joint).collect(),
                share: angles.iter().map(|(_, q)| q / mean).collect(),
            }
        });
        Self {
            limits: hand.tree.joints.iter().map(|joint| (joint.lower, joint.upper)).collect(),
            lines: lines.collect(),
        }
    }

    /// Of any hand: equal springs against moment arms, followers with their leaders. Joints that nothing pulls stay at rest:
    /// their limits close on that angle.
    pub fn of_any(hand: &AnyHand) -> Self {
        let rest = rest(hand);
        let mut limits: Vec<(f64, f64)> = rest.iter().map(|q| (*q, *q)).collect();
        let lines = hand.pulls.iter().map(|pull| {
            let mut line: Vec<(usize, f64)> = pull.arms.clone();
            for follower in &hand.followers {
                if let Some((_, arm)) = pull.arms.iter().find(|(joint, _)| *joint == follower.leader) {
                    line.push((follower.joint, arm * follower.multiplier));
                }
            }
            // Signs differ where fingers close by turning opposite ways: the mean of the amounts is the measure.
            let mean = line.iter().map(|(_, arm)| arm.abs()).sum::<f64>() / line.len() as f64;
            ActuatorLine {
                joints: line.iter().map(|(joint, _)| *joint).collect(),
                share: line.iter().map(|(_, arm)| arm / mean).collect(),
            }
        });
        let lines: Vec<ActuatorLine> = lines.collect();
        for joint in lines.iter().flat_map(|line| &line.joints) {
            limits[*joint] = (hand.tree.joints[*joint].lower, hand.tree.joints[*joint].upper);
        }
        Self { limits, lines }
    }

    /// How far an actuator has moved its joints from zero, rad: the mean of |angle|, signed by the line's direction.
    pub fn amount(&self, line: usize, joints: &[f64]) -> f64 {
        let ActuatorLine { joints: own, share } = &self.lines[line];
        own.iter().zip(share).map(|(joint, share)| joints[*joint] * share.signum()).sum::<f64>() / own.len() as f64
    }

    /// Puts the joints of an actuator `amount` along its line, within their limits.
    pub fn set_amount(&self, line: usize, amount: f64, joints: &mut [f64]) {
        let ActuatorLine { joints: own, share } = &self.lines[line];
        for (joint, share) in own.iter().zip(share) {
            joints[*joint] = (amount * share).clamp(self.limits[*joint].0, self.limits[*joint].1);
        }
    }
}

/// Angle 0 of every joint, or the nearest within its limits, rad.
pub fn rest(hand: &AnyHand) -> Vec<f64> {
    hand.tree.joints.iter().map(|joint| 0f64.clamp(joint.lower, joint.upper)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines() -> Mechanism {
        let line = ActuatorLine { joints: vec![0, 2], share: vec![1.5, -0.5] };
        Mechanism { limits: vec![(-1.0, 1.0), (0.3, 0.3), (-0.2, 0.2)], lines: vec![line] }
    }

    /// What is set along a line is found along it, until a limit cuts it.
    #[test]
    fn amounts_along_a_line() {
        let mechanism = lines();
        let mut joints = [0.0, 0.3, 0.0];
        mechanism.set_amount(0, 0.3, &mut joints);
        assert_eq!(joints, [0.3 * 1.5, 0.3, -0.3 * 0.5]);
        assert!((mechanism.amount(0, &joints) - 0.3).abs() < 1e-12);
        mechanism.set_amount(0, 2.0, &mut joints);
        assert_eq!(joints, [1.0, 0.3, -0.2]);
    }

    #[test]
    fn the_hand_has_a_line_a_cable() {
        let mechanism = Mechanism::of(&Hand::ftac());
        assert_eq!((mechanism.lines.len(), mechanism.limits.len()), (5, 15));
        for line in &mechanism.lines {
            let mean = line.share.iter().sum::<f64>() / line.share.len() as f64;
            assert!((mean - 1.0).abs() < 1e-9);
        }
    }
}
