//! Conversion between radians and the wire's degrees.
//!
//! Joint angles on the wire are in [0, 360) degrees. A joint without end stops may be several turns away from the
//! controller's zero, so each measured angle is unwrapped to the turn nearest to the previous one ([`Turns`]).

use std::f64::consts::{PI, TAU};

use crate::joints::JOINTS;

/// Converts a speed, or any difference of angles, from the wire's degrees to rad.
pub fn to_radians(degrees: f32) -> f64 {
    f64::from(degrees).to_radians()
}

/// Converts a speed, or any difference of angles, from rad to the wire's degrees.
pub fn to_degrees(radians: f64) -> f32 {
    radians.to_degrees() as f32
}

/// Converts an angle from rad to the wire's degrees in [0, 360).
pub fn to_wire_angle(radians: f64) -> f32 {
    let degrees = radians.rem_euclid(TAU).to_degrees() as f32;
    // Rounding to a float may reach the full turn, which is 0.
    if degrees < 360.0 { degrees } else { 0.0 }
}

/// Returns the angle for the same posture as `angle` that is nearest to `near`, rad.
pub fn nearest_turn(angle: f64, near: f64) -> f64 {
    angle + TAU * ((near - angle) / TAU).round()
}

/// Unwraps the angle of each joint over full turns.
///
/// # Example
/// ```
/// use kinova_kortex::degrees::Turns;
///
/// let mut turns = Turns::default();
/// turns.read([170.0; 7]);
/// let angles = turns.read([190.0; 7]);
/// assert!((angles[0] - 190_f64.to_radians()).abs() < 1e-6);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turns {
    last: [f64; JOINTS],
}

impl Default for Turns {
    /// Reads the first angles within half a turn of 0, where joints with end stops always are.
    fn default() -> Self {
        Self { last: [0.0; JOINTS] }
    }
}

impl Turns {
    /// Reads the first angles within half a turn of `posture`, rad.
    pub fn near(posture: [f64; JOINTS]) -> Self {
        Self { last: posture }
    }

    /// Converts wire angles (degrees) to unwrapped angles, rad. Between two calls no joint may move half a turn. At 80
    /// degrees per second and the feedback limit of the servoing this is far from happening.
    pub fn read(&mut self, degrees: [f32; JOINTS]) -> [f64; JOINTS] {
        self.last = std::array::from_fn(|i| nearest_turn(to_radians(degrees[i]), self.last[i]));
        self.last
    }
}

/// Returns the difference of two angles as postures, rad, in [-pi, pi].
pub fn difference(a: f64, b: f64) -> f64 {
    nearest_turn(a - b, 0.0).clamp(-PI, PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn known_angles() {
        assert_eq!(to_wire_angle(0.0), 0.0);
        assert_eq!(to_wire_angle(-PI / 2.0), 270.0);
        assert_eq!(to_wire_angle(PI * 2.5), 90.0);
        assert_eq!(to_wire_angle(-1e-12), 0.0);
    }

    /// Two turns in steps of 50 degrees, through the wire's 0.
    #[test]
    fn turns_are_counted() {
        let mut turns = Turns::default();
        for step in 0..15 {
            let angle = f64::from(step * 50).to_radians();
            let read = turns.read([to_wire_angle(angle); JOINTS]);
            assert!((read[0] - angle).abs() < 1e-6, "step {step}: {} for {angle}", read[0]);
        }
    }

    #[test]
    fn first_angle_follows_the_posture() {
        let posture = [0.0, 0.0, PI, 0.0, 0.0, 0.0, -PI];
        let read = Turns::near(posture).read([0.0, 0.0, 180.1, 0.0, 0.0, 0.0, 180.1]);
        assert!((read[2] - 180.1_f64.to_radians()).abs() < 1e-6);
        assert!((read[6] + 179.9_f64.to_radians()).abs() < 1e-6);
    }

    proptest! {
        /// A float holds 360 degrees to 3.1e-5, half of which is 2.7e-7 rad.
        #[test]
        fn wire_angles_come_back(angle in -20.0..20.0_f64) {
            let wire = to_wire_angle(angle);
            prop_assert!((0.0..360.0).contains(&wire));
            prop_assert!((nearest_turn(to_radians(wire), angle) - angle).abs() < 3e-7);
        }

        #[test]
        fn nearest_is_within_half_a_turn(angle in -20.0..20.0_f64, near in -20.0..20.0_f64) {
            let found = nearest_turn(angle, near);
            prop_assert!((found - near).abs() <= PI + 1e-9);
            prop_assert!(((found - angle) / TAU - ((found - angle) / TAU).round()).abs() < 1e-9);
        }
    }
}
