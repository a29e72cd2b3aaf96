//! The hidden pose of an emulated robot's base, and the balls by which registration finds it.

use std::path::Path;

use ftac_platform::data::{DataError, parse_toml};
use nalgebra::{Isometry3, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, Normal};
use scenarios::generator::trial_rng;
use serde::Deserialize;

/// Plan of a registration: the balls, and the touches of each.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegistrationPlan {
    /// Name of the ball.
    pub object: String,
    /// Positions of the balls, x and y, world, m.
    pub marks: Vec<[f64; 2]>,
    /// Yaw angles of the hand with which each ball is touched, rad.
    pub headings: Vec<f64>,
    /// Prior standard deviation of a mark's position relative to the arm before registration, each axis, m.
    pub expected: f64,
    /// Tolerance: largest distance of a ball from its mark after the fit, m.
    #[serde(alias = "most_residual")]
    pub max_residual: f64,
    /// Prior from which an emulated robot's hidden mount is drawn.
    pub hidden: HiddenMountSigmas,
}

/// Standard deviations of a mount aligned by sight and ruler.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HiddenMountSigmas {
    /// Position, m.
    pub position: [f64; 3],
    /// Rotation vector, rad.
    pub rotation: [f64; 3],
}

impl RegistrationPlan {
    /// Returns the plan that comes with the program.
    pub fn standard() -> Result<Self, DataError> {
        let path = Path::new("registration.toml");
        let plan: Self = parse_toml(include_str!("../data/registration.toml"), path)?;
        if plan.marks.len() < 3 || plan.headings.is_empty() {
            return Err(DataError::field(path, "marks", plan.marks.len(), "three or more, and a heading"));
        }
        Ok(plan)
    }
}

/// Draws the pose of a hidden base. Only the emulator and the evaluation know it.
pub fn hidden_mount(plan: &RegistrationPlan, seed: u64) -> Isometry3<f64> {
    let mut rng: ChaCha8Rng = trial_rng(seed, usize::MAX, 0);
    let mut draw = |sigma: [f64; 3]| {
        Vector3::from(sigma).map(|sigma| Normal::new(0.0, sigma).map_or(0.0, |normal| normal.sample(&mut rng)))
    };
    let (position, rotation) = (draw(plan.hidden.position), draw(plan.hidden.rotation));
    Isometry3::new(position, rotation)
}
