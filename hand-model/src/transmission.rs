//! The cable transmission: what one cable does to the three joints of its digit.
//!
//! A cable runs along both sides of the phalanges (the paper's Methods, hand fabrication; its finger schematic has joint
//! stiffness K_n, angle theta_n and cable force F). At each joint it spans from a guide point on the link before to one on the
//! link after. The free length between the two is l(q) = |R(q) b - a|, so the joint takes up an **excursion** l(0) - l(q) and
//! the cable acts on a **moment arm** r(q) = -dl/dq. A torsion spring K with rest at 0 opens the joint. In equilibrium without
//! contact K q = r(q) T. Virtual work makes the map from tension to torque the transpose of the map from joint speeds to
//! excursion rate; a test holds it to that.

/// The pair of guide points at one joint, in the plane across its axis at angle zero: (along the link, towards the palm side).
#[derive(Debug, Clone, Copy)]
pub struct Guides {
    /// On the link before the joint, m.
    pub before: [f64; 2],
    /// On the link after the joint, m.
    pub after: [f64; 2],
}

impl Guides {
    /// Free cable length between the guides, m.
    pub fn length(&self, q: f64) -> f64 {
        let [x, y] = self.rotated(q);
        (x - self.before[0]).hypot(y - self.before[1])
    }

    /// Moment arm r(q) = -dl/dq, m.
    pub fn moment_arm(&self, q: f64) -> f64 {
        let [x, y] = self.rotated(q);
        let (dx, dy) = (x - self.before[0], y - self.before[1]);
        // d/dq of the rotated point is (-y, x).
        -(dx * -y + dy * x) / dx.hypot(dy)
    }

    /// Excursion l(0) - l(q), m.
    pub fn excursion(&self, q: f64) -> f64 {
        self.length(0.0) - self.length(q)
    }

    fn rotated(&self, q: f64) -> [f64; 2] {
        let (sin, cos) = q.sin_cos();
        let [x, y] = self.after;
        [cos * x - sin * y, sin * x + cos * y]
    }
}

/// One cable: the joints it crosses, by index in the hand's joint vector.
#[derive(Debug, Clone)]
pub struct CablePath {
    /// (joint, guides), proximal first.
    pub joints: Vec<(usize, Guides)>,
}

impl CablePath {
    /// Cable taken up between q = 0 and `q` (all 15 joint angles, rad), m.
    pub fn excursion(&self, q: &[f64]) -> f64 {
        self.joints.iter().map(|(joint, guides)| guides.excursion(q[*joint])).sum()
    }

    /// Rate of the excursion, m/s.
    pub fn excursion_rate(&self, q: &[f64], qd: &[f64]) -> f64 {
        self.joints.iter().map(|(joint, guides)| guides.moment_arm(q[*joint]) * qd[*joint]).sum()
    }

    /// Excursion with every crossed joint at `angle`, m.
    pub fn full_excursion(&self, angle: f64) -> f64 {
        self.joints.iter().map(|(_, guides)| guides.excursion(angle)).sum()
    }
}

/// The whole transmission: five cables, the opposition drive and the springs.
#[derive(Debug, Clone)]
pub struct Transmission {
    /// Cables of thumb, index, middle, ring, little.
    pub cables: [CablePath; 5],
    /// Joint that the sixth actuator turns.
    pub opposition_joint: usize,
    /// Torsion spring of each joint, N m/rad, rest at 0.
    pub springs: [f64; crate::HAND_JOINTS],
}

impl Transmission {
    /// Joint torques (N m) of cable `tensions` (N) and springs at `q` (rad), opposition drive excluded.
    pub fn torques(&self, q: &[f64], tensions: &[f64; 5]) -> [f64; crate::HAND_JOINTS] {
        let mut torques: [f64; crate::HAND_JOINTS] = std::array::from_fn(|joint| -self.springs[joint] * q[joint]);
        for (cable, tension) in self.cables.iter().zip(tensions) {
            for (joint, guides) in &cable.joints {
                torques[*joint] += guides.moment_arm(q[*joint]) * tension;
            }
        }
        torques
    }

    /// Tension (N) that best explains `torque` on the joints of `cable` at `q` (least squares over its moment arms).
    pub fn tension_for(&self, cable: usize, q: &[f64], torque: &[f64]) -> f64 {
        let (mut num, mut den) = (0.0, 0.0);
        for (joint, guides) in &self.cables[cable].joints {
            let r = guides.moment_arm(q[*joint]);
            num += r * (torque[*joint] + self.springs[*joint] * q[*joint]);
            den += r * r;
        }
        num / den
    }

    /// Angles (rad) of the joints on `cable` in static equilibrium at `tension` (N) without contact, within [0, `upper`].
    pub fn free_angles(&self, cable: usize, tension: f64, upper: f64) -> Vec<(usize, f64)> {
        self.cables[cable]
            .joints
            .iter()
            .map(|(joint, guides)| {
                // K q - r(q) T is increasing wherever springs dominate the growth of r: bisect, which never diverges.
                let residual = |q: f64| self.springs[*joint] * q - guides.moment_arm(q) * tension;
                let (mut low, mut high) = (0.0, upper);
                if residual(upper) <= 0.0 {
                    return (*joint, upper);
                }
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if residual(middle) < 0.0 { low = middle } else { high = middle }
                }
                (*joint, 0.5 * (low + high))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use crate::Hand;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    proptest! {
        #[test]
        fn moment_arm_is_derivative_of_excursion(q in 0.01f64..1.55, cable in 0usize..5) {
            let hand = Hand::ftac();
            for (_, guides) in &hand.transmission.cables[cable].joints {
                let h = 1e-6;
                let difference = (guides.excursion(q + h) - guides.excursion(q - h)) / (2.0 * h);
                prop_assert!((difference - guides.moment_arm(q)).abs() < 1e-9);
            }
        }

        /// Virtual work: tension times excursion rate equals cable torque times joint speed.
        #[test]
        fn reciprocity(q in proptest::collection::vec(0.0f64..1.57, 15), qd in proptest::collection::vec(-3.0f64..3.0, 15), t in proptest::collection::vec(0.0f64..40.0, 5)) {
            let hand = Hand::ftac();
            let tensions = [t[0], t[1], t[2], t[3], t[4]];
            let torques = hand.transmission.torques(&q, &tensions);
            let joint_power: f64 = (0..15).map(|j| (torques[j] + hand.transmission.springs[j] * q[j]) * qd[j]).sum();
            let cable_power: f64 = hand.transmission.cables.iter().zip(&tensions).map(|(c, t)| t * c.excursion_rate(&q, &qd)).sum();
            prop_assert!((joint_power - cable_power).abs() < 1e-9);
        }

        #[test]
        fn tension_back_from_torque(q in proptest::collection::vec(0.0f64..1.57, 15), tension in 0.1f64..40.0, cable in 0usize..5) {
            let hand = Hand::ftac();
            let mut tensions = [0.0; 5];
            tensions[cable] = tension;
            let torques = hand.transmission.torques(&q, &tensions);
            prop_assert!((hand.transmission.tension_for(cable, &q, &torques) - tension).abs() < 1e-9);
        }
    }

    /// Mean moment arms near 9 / 7.5 / 6 mm, the design's intent.
    #[test]
    fn mean_moment_arms() {
        let hand = Hand::ftac();
        let mean: Vec<f64> =
            hand.transmission.cables[1].joints.iter().map(|(_, g)| g.excursion(FRAC_PI_2) / FRAC_PI_2).collect();
        for (got, want) in mean.iter().zip([0.009, 0.0075, 0.006]) {
            assert!((got - want).abs() < 0.0008, "{mean:?}");
        }
    }

    /// Free equilibrium: spring torque equals cable torque at every joint inside its range.
    #[test]
    fn free_equilibrium() {
        let hand = Hand::ftac();
        for (joint, q) in hand.transmission.free_angles(1, 4.0, 1.57) {
            let mut angles = [0.0; 15];
            angles[joint] = q;
            let mut tensions = [0.0; 5];
            tensions[1] = 4.0;
            assert!(hand.transmission.torques(&angles, &tensions)[joint].abs() < 1e-9);
        }
    }
}
