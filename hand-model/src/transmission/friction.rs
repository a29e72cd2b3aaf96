//! Capstan friction of a cable in its guides, with hysteresis.
//!
//! Around a guide with wrap angle phi, the tension of a cable falls by up to exp(-mu phi) in the direction in which it
//! slides (Euler and Eytelwein). A state s of each guide says how much of that is used: 1 while the cable is pulled in,
//! -1 while it is let out, anything between while it sticks. It follows the cable's displacement x by Dahl's law, ds/dx
//! = (1 - s sign(dx)) / l with the presliding distance l. After a reversal the cable moves a few l before it slides
//! again, and meanwhile its far end keeps its tension. This is the hysteresis of tendon-driven fingers.

use serde::Deserialize;

/// Friction of a cable in its guides.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CableFriction {
    /// Coulomb friction coefficient mu between cable and guide.
    pub coefficient: f64,
    /// Presliding distance l, m.
    pub presliding: f64,
    /// Wrap angle of the cable in the palm between spool and first joint, rad.
    pub routing: f64,
}

impl CableFriction {
    /// Frictionless guides.
    pub const NONE: Self = Self { coefficient: 0.0, presliding: 1.0, routing: 0.0 };

    /// Returns the state after the cable has moved by `way` (m; positive: pulled in).
    pub fn next_state(&self, state: f64, way: f64) -> f64 {
        let end = if way < 0.0 { -1.0 } else { 1.0 };
        // Closed form of Dahl's law, so that no time step is too long for it.
        end + (state - end) * (-way.abs() / self.presliding).exp()
    }

    /// Computes the ratio of the tension behind a guide to the tension before it, for a wrap angle `wrap` (rad).
    pub fn tension_ratio(&self, state: f64, wrap: f64) -> f64 {
        (-self.coefficient * state * wrap).exp()
    }
}

/// Losses of a cable drive: friction in the guides, and backlash of the servo's gear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CableLosses {
    /// Friction in the guides.
    pub friction: CableFriction,
    /// Backlash of the servo's gear, rad at its output: the spool is up to half of it ahead of or behind the encoder.
    pub backlash: f64,
}

impl CableLosses {
    /// An ideal drive without losses.
    pub const NONE: Self = Self { friction: CableFriction::NONE, backlash: 0.0 };

    /// Builds losses with guide friction and no backlash.
    pub fn from_friction(friction: CableFriction) -> Self {
        Self { friction, ..Self::NONE }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FRICTION: CableFriction = CableFriction { coefficient: 0.1, presliding: 2e-4, routing: 0.5 };

    proptest! {
        /// The state stays in [-1, 1] and does not depend on how a displacement is divided into steps.
        #[test]
        fn state_is_bounded_and_independent_of_steps(start in -1.0f64..1.0, way in -1e-3f64..1e-3, cuts in 1usize..20) {
            let once = FRICTION.next_state(start, way);
            prop_assert!((-1.0..=1.0).contains(&once));
            let steps = (0..cuts).fold(start, |state, _| FRICTION.next_state(state, way / cuts as f64));
            prop_assert!((once - steps).abs() < 1e-12);
        }
    }

    /// A guide dissipates energy when the cable moves back and forth: the loop of tension over displacement encloses
    /// the capstan's area, 2 T sinh(mu phi) times the displacement.
    #[test]
    fn a_cycle_takes_the_capstan_s_energy() {
        let (tension, wrap, way, steps) = (10.0, 1.2, 0.02, 20_000);
        let mut state = 1.0;
        let mut lost = 0.0;
        for direction in [-1.0, 1.0] {
            for _ in 0..steps {
                let dx = direction * way / steps as f64;
                state = FRICTION.next_state(state, dx);
                lost += (tension - tension * FRICTION.tension_ratio(state, wrap)) * dx;
            }
        }
        let full = 2.0 * tension * (FRICTION.coefficient * wrap).sinh() * way;
        assert!(lost > 0.0 && (lost / full - 1.0).abs() < 0.05, "{lost} J of {full} J");
    }

    #[test]
    fn without_friction_tension_passes_unchanged() {
        assert_eq!(CableFriction::NONE.tension_ratio(CableFriction::NONE.next_state(0.3, 0.01), 2.0), 1.0);
    }
}
