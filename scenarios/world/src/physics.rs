//! Physics of the simulated world besides robot and objects: the table and the contact law, from `data/physics.toml`.

use std::path::Path;
use std::sync::LazyLock;

use ftac_platform::data::parse_toml;
use serde::Deserialize;

/// The table, a box.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TablePhysics {
    /// Centre in the world frame, m.
    pub center: [f64; 3],
    /// Half extents, m.
    pub half: [f64; 3],
    /// Coulomb friction coefficient; an object's own coefficient applies if it is smaller.
    pub friction: f64,
    /// Rolling resistance: lever arm of the normal force divided by the height of the rolling body's centre of mass.
    pub rolling_resistance: f64,
}

/// Contact law: a spring and damper along the normal.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactParameters {
    /// Natural frequency, Hz; doubled for contact with a fixed body.
    pub frequency: f64,
    /// Damping ratio: damping divided by critical damping.
    pub damping_ratio: f64,
    /// Spin damping of a loose object, 1/s.
    pub spin_damping: f64,
}

/// Bristle friction model: surfaces at rest spring back to their friction anchors.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BristleFriction {
    /// Fraction of the tangential displacement that is undone per step.
    pub back: f64,
    /// Elastic limit: tangential displacement beyond which the surfaces slide, m.
    pub elastic: f64,
    /// Elastic limit of the rotation about the normal, rad.
    pub elastic_turn: f64,
}

/// Table and contacts.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Physics {
    /// The table on which the objects stand.
    pub table: TablePhysics,
    /// Contact law.
    pub contact: ContactParameters,
    /// Friction model between the hand and the objects it holds.
    pub bristle_friction: BristleFriction,
}

static STANDARD: LazyLock<Physics> = LazyLock::new(|| {
    parse_toml(include_str!("../data/physics.toml"), Path::new("physics.toml")).expect("the built-in physics is valid")
});

impl Physics {
    /// Returns the built-in world, `scenarios/world/data/physics.toml`.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn standard() -> Self {
        *STANDARD
    }
}
