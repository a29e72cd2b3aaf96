//! The simulated world beside robot and objects: the table and the law of contacts, from `data/physics.toml`.

use std::path::Path;
use std::sync::LazyLock;

use platform::data::parse_toml;
use serde::Deserialize;

/// The table, a box.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// m, world.
    pub center: [f64; 3],
    /// Half extents, m.
    pub half: [f64; 3],
    /// Coulomb friction coefficient; an object's own applies where it is smaller.
    pub friction: f64,
    /// Lever arm of the normal force over the height of the centre of mass of what rolls.
    pub rolling_resistance: f64,
}

/// A contact is a spring and damper along its normal.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// Natural frequency, Hz; twice that with a fixed body.
    pub frequency: f64,
    /// Damping over critical damping.
    pub damping_ratio: f64,
    /// Damping of a loose object's spin, 1/s.
    pub spin_damping: f64,
}

/// Friction as a bristle: surfaces that stick go back where they were.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sticking {
    /// Share of the displacement that is undone in a step.
    pub back: f64,
    /// The displacement of one surface along the other beyond which it slides, m.
    pub elastic: f64,
    /// The turn about the normal beyond which it does, rad.
    pub elastic_turn: f64,
}

/// Table and contacts.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Physics {
    /// What the objects stand on.
    pub table: Table,
    /// How bodies touch.
    pub contact: Contact,
    /// How what the hand holds sticks to it.
    pub sticking: Sticking,
}

static STANDARD: LazyLock<Physics> = LazyLock::new(|| {
    parse_toml(include_str!("../data/physics.toml"), Path::new("physics.toml")).expect("the built-in physics is valid")
});

impl Physics {
    /// The built-in world, `scenarios/world/data/physics.toml`.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn standard() -> Self {
        *STANDARD
    }
}
