//! Raw images of a held object: every camera with its read-out noise, idle pads included, with the optics as built or
//! changed.

use std::sync::Arc;

use bench::trial::HeldGrasp;
use hand_model::Hand;
use hand_model::robot::{TactileFrame, TactileImage};
use nalgebra::Isometry3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use scenarios::effects::{Effect, PadEffects};
use sim::tactile::{BrightnessDrift, TactileBoard};
use tactile_optics::{IndentationMap, SensorModel};
use world::geometry::ObjectShape;

/// Difference of a hand from those in the training data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpticsChange {
    pub name: &'static str,
    /// Factor on the lamps' brightness.
    pub lamps: f64,
    /// Displacement of each lamp, each in another direction, m.
    pub shift: f64,
    /// Factor on the gel's stiffness.
    pub stiffness: f64,
    /// Factor on the read-out noise.
    pub noise: f64,
}

impl OpticsChange {
    /// No change: as built.
    pub const NONE: Self = Self { name: "as built", lamps: 1.0, shift: 0.0, stiffness: 1.0, noise: 1.0 };
    /// Changes that are tested in addition to [`Self::NO_DIGITS`].
    pub const ALL: [Self; 6] = [
        Self { name: "lamps -15 %", lamps: 0.85, ..Self::NONE },
        Self { name: "lamps +15 %", lamps: 1.15, ..Self::NONE },
        Self { name: "lamps moved 0.5 mm", shift: 5e-4, ..Self::NONE },
        Self { name: "gel 20 % softer", stiffness: 0.8, ..Self::NONE },
        Self { name: "gel 20 % stiffer", stiffness: 1.2, ..Self::NONE },
        Self { name: "camera noise x 2", noise: 2.0, ..Self::NONE },
    ];

    fn apply(&self, model: &mut SensorModel, seed: u64) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for lamp in &mut model.lamps {
            lamp.eta *= self.lamps;
            let mut draw = || rng.random_range(-1.0..1.0);
            let way = nalgebra::Vector3::new(draw(), draw(), draw());
            lamp.position += way.normalize() * self.shift;
        }
        model.noise *= self.noise;
    }
}

/// Cameras of a changed hand unit, with its changed gel.
pub struct CameraUnit {
    hand: Hand,
    board: TactileBoard,
    /// Drift model of the cameras, with its seed.
    drift: Option<(PadEffects, u64)>,
}

/// Time of the perception of a first grasp, s after the trial's start.
const TOUCH_TIME: f64 = 8.0;

impl CameraUnit {
    /// Creates the cameras of unit `serial` under `change`.
    pub fn new(hand: &Hand, serial: u64, change: &OpticsChange) -> anyhow::Result<Self> {
        let mut hand = hand.clone();
        hand.parameters.gel.stiffness *= change.stiffness;
        let board = TactileBoard::with_models(&hand, serial, |camera, model| change.apply(model, camera as u64))?;
        Ok(Self { hand, board, drift: None })
    }

    /// Adds camera drift as in trials of this `seed`, if the scenario has any.
    pub fn with_drift(self, pads: Option<PadEffects>, seed: u64) -> Self {
        Self { drift: pads.map(|pads| (pads, seed)), ..self }
    }

    /// Returns the board for a grasp's trial; `seed` draws the noise.
    fn board_for(&self, grasp: &HeldGrasp, seed: u64) -> TactileBoard {
        let board = self.board.with_noise(seed);
        let Some((pads, trials)) = &self.drift else { return board };
        let mut rng = Effect::Pads.draw_rng(*trials, grasp.combination, grasp.trial);
        board.drifting(BrightnessDrift::new(
            pads.draw_drift_rates(self.hand.cameras.len(), &mut rng),
            pads.background_age,
        ))
    }

    /// Returns frames of the untouched pads from before a grasp's trial, if cameras drift; `seed` draws the noise.
    pub fn background_frames(&self, grasp: &HeldGrasp, seed: u64) -> Option<Vec<Arc<TactileImage>>> {
        self.drift.map(|_| self.board_for(grasp, seed).background_frames())
    }

    /// Returns the hand with its changed gel.
    pub fn hand(&self) -> &Hand {
        &self.hand
    }

    pub fn board(&self) -> &TactileBoard {
        &self.board
    }

    /// Returns images of the untouched pads.
    pub fn backgrounds(&self) -> Vec<Arc<TactileImage>> {
        self.board.backgrounds()
    }

    /// Renders the cameras' images of a grasp; `seed` draws the noise.
    pub fn render_images(&self, grasp: &HeldGrasp, shape: &ObjectShape, seed: u64) -> Vec<TactileFrame> {
        let mut board = self.board_for(grasp, seed);
        let objects: [(&ObjectShape, Isometry3<f64>); 1] = [(shape, grasp.truth)];
        let time = if self.drift.is_some() { TOUCH_TIME } else { 0.0 };
        let frames = board.capture(&self.hand, time, &grasp.pads, &grasp.forces, &objects);
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x6964_6c65);
        frames
            .into_iter()
            .zip(board.sensors())
            .map(|(mut frame, sensor)| {
                if Arc::ptr_eq(&frame.image, sensor.background()) {
                    frame.image = Arc::new(sensor.render(&IndentationMap::idle(), &mut rng));
                }
                frame
            })
            .collect()
    }
}
