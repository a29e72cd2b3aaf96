//! Capstan friction of a cable in its guides, with hysteresis.
//!
//! Where a cable turns by an angle phi around a guide, its tension falls by up to exp(-mu phi) in the direction in which it
//! slides (Euler and Eytelwein). How much of that is used is a state s of each guide: 1 while the cable is pulled in, -1
//! while it is let out, anything between while it sticks. It follows the cable's way x by Dahl's law, ds/dx = (1 - s sign(dx)) / l
//! with the presliding way l: a cable whose direction turns round takes a few l to slide again, and meanwhile its far end keeps
//! the tension it had. That is the hysteresis of tendon-driven fingers.

use serde::Deserialize;

/// What the guides do to a cable.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CableFriction {
    /// Coulomb coefficient mu of cable on guide.
    pub coefficient: f64,
    /// Presliding way l, m.
    pub presliding: f64,
    /// Turn of the cable in the palm between spool and first joint, rad.
    pub routing: f64,
}

impl CableFriction {
    /// Guides that take nothing.
    pub const NONE: Self = Self { coefficient: 0.0, presliding: 1.0, routing: 0.0 };

    /// The state after the cable has slid by `way` (m; positive: pulled in).
    pub fn slid(&self, state: f64, way: f64) -> f64 {
        let end = if way < 0.0 { -1.0 } else { 1.0 };
        // Dahl's law in closed form, so that no time step is too long for it.
        end + (state - end) * (-way.abs() / self.presliding).exp()
    }

    /// Tension behind a guide over the tension before it, for a turn of `wrap` (rad).
    pub fn ratio(&self, state: f64, wrap: f64) -> f64 {
        (-self.coefficient * state * wrap).exp()
    }
}

/// What a cable drive does beside pulling: what guides take, and the play of the servo's gear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CableLosses {
    /// Friction in the guides.
    pub friction: CableFriction,
    /// Play of the servo's gear, rad at its output: the spool is up to half of it before or behind the encoder.
    pub backlash: f64,
}

impl CableLosses {
    /// A drive that only pulls.
    pub const NONE: Self = Self { friction: CableFriction::NONE, backlash: 0.0 };

    /// Guides that rub, and a gear without play.
    pub fn of(friction: CableFriction) -> Self {
        Self { friction, ..Self::NONE }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FRICTION: CableFriction = CableFriction { coefficient: 0.1, presliding: 2e-4, routing: 0.5 };

    proptest! {
        /// The state stays in [-1, 1] and does not depend on how a way is cut into steps.
        #[test]
        fn state_is_bounded_and_independent_of_steps(start in -1.0f64..1.0, way in -1e-3f64..1e-3, cuts in 1usize..20) {
            let once = FRICTION.slid(start, way);
            prop_assert!((-1.0..=1.0).contains(&once));
            let steps = (0..cuts).fold(start, |state, _| FRICTION.slid(state, way / cuts as f64));
            prop_assert!((once - steps).abs() < 1e-12);
        }
    }

    /// Pulled back and forth, a guide takes energy: tension over way encloses the capstan's area, 2 T sinh(mu phi) a way.
    #[test]
    fn a_cycle_takes_the_capstan_s_energy() {
        let (tension, wrap, way, steps) = (10.0, 1.2, 0.02, 20_000);
        let mut state = 1.0;
        let mut lost = 0.0;
        for direction in [-1.0, 1.0] {
            for _ in 0..steps {
                let dx = direction * way / steps as f64;
                state = FRICTION.slid(state, dx);
                lost += (tension - tension * FRICTION.ratio(state, wrap)) * dx;
            }
        }
        let full = 2.0 * tension * (FRICTION.coefficient * wrap).sinh() * way;
        assert!(lost > 0.0 && (lost / full - 1.0).abs() < 0.05, "{lost} J of {full} J");
    }

    #[test]
    fn without_friction_tension_passes_unchanged() {
        assert_eq!(CableFriction::NONE.ratio(CableFriction::NONE.slid(0.3, 0.01), 2.0), 1.0);
    }
}
