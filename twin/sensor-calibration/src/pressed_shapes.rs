//! Presses of known shapes into simulated pads: what networks learn from and what normals are measured on.

use anyhow::{Context, Result};
use hand_model::Hand;
use hand_model::pads::IMAGE_SIZE;
use optics::shapes::SHAPES;
use optics::{Sensor, press};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use sim::tactile::TactileBoard;
use touch::CalibrationPress;

/// Shapes that nothing is ever trained on.
pub const UNSEEN: [&str; 4] = ["dots", "moon", "prism", "wave1"];
/// Radii of the balls that are pressed beside the shapes, m.
const BALLS: [f64; 4] = [0.004, 0.008, 0.015, 0.025];
/// Normal forces, N.
const FORCES: std::ops::Range<f64> = 0.4..5.0;

/// Height (m) of the lowest points of something over its own plane.
pub type Relief = Box<dyn Fn(f64, f64) -> Option<f64> + Sync + Send>;

/// All shapes and balls that may be trained on.
pub fn seen() -> Vec<Relief> {
    let shapes = SHAPES.iter().filter(|(name, _)| !UNSEEN.contains(name));
    let shapes = shapes.map(|(_, relief)| Box::new(relief) as Relief);
    shapes.chain(BALLS.map(|radius| Box::new(move |x, y| ball(radius, x, y)) as Relief)).collect()
}

/// A shape of [`UNSEEN`] or any other by its name.
pub fn named(name: &str) -> Option<Relief> {
    SHAPES.iter().find(|(known, _)| *known == name).map(|(_, relief)| Box::new(relief) as Relief)
}

/// Height of a ball's lower half over the plane it lies on.
pub fn ball(radius: f64, x: f64, y: f64) -> Option<f64> {
    let inside = radius * radius - x * x - y * y;
    (inside > 0.0).then(|| radius - inside.sqrt())
}

/// Where and how something is pressed.
pub struct Place {
    /// Where its origin comes to lie, m.
    pub at: [f64; 2],
    /// By how much it is turned, rad.
    pub turn: f64,
}

impl Place {
    /// Anywhere within 0.38 of a rectangle's sides (m) from its middle.
    pub fn draw(sides: [f64; 2], middle: [f64; 2], rng: &mut impl Rng) -> Self {
        let at = std::array::from_fn(|k| middle[k] + rng.random_range(-0.38..0.38) * sides[k]);
        Self { at, turn: rng.random_range(0.0..std::f64::consts::TAU) }
    }

    /// The relief's height at a place of the pad.
    pub fn height(&self, relief: &Relief, x: f64, y: f64) -> Option<f64> {
        let (sin, cos) = self.turn.sin_cos();
        let (x, y) = (x - self.at[0], y - self.at[1]);
        relief(cos * x + sin * y, cos * y - sin * x)
    }
}

/// Presses `relief` into the pad that camera `index` looks at.
pub fn press_into(
    hand: &Hand,
    (index, sensor): (usize, &Sensor),
    (relief, place): (&Relief, &Place),
    force: f64,
    rng: &mut impl Rng,
) -> Result<CalibrationPress> {
    let camera = &hand.cameras[index];
    let pad = &hand.pads[camera.pad];
    let top = pad.surface_height(place.at[0], place.at[1]);
    let pressed = press(pad, &[camera], &hand.gel(), force, |x, y| place.height(relief, x, y).map(|z| top + z))?;
    let map = &pressed.maps[0];
    // What touch should see is the gel's surface, bulge included.
    let gel = sensor.model().elastomer.deform(camera, map);
    let pixels = (0..IMAGE_SIZE).flat_map(|row| (0..IMAGE_SIZE).map(move |column| (column, row)));
    let label = pixels.map(|(column, row)| gel.as_ref().map_or(0.0, |gel| gel.depth(column, row))).collect();
    Ok(CalibrationPress {
        camera: index,
        image: std::sync::Arc::new(sensor.render(map, rng)),
        background: sensor.background().clone(),
        indentation: label,
    })
}

/// Press `n` of many: camera `n` (in turn) of a board chosen in turn, the relief, place and force drawn.
pub fn drawn_press(
    hand: &Hand,
    boards: &[TactileBoard],
    reliefs: &[Relief],
    n: usize,
    seed: u64,
) -> Result<CalibrationPress> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(n as u64);
    let index = n % hand.cameras.len();
    let board = boards.get(n / hand.cameras.len() % boards.len().max(1)).context("no boards")?;
    let camera = &hand.cameras[index];
    let relief = &reliefs[rng.random_range(0..reliefs.len())];
    let place = Place::draw([camera.w, camera.h], [0.0, camera.center_y], &mut rng);
    let force = rng.random_range(FORCES);
    press_into(hand, (index, &board.sensors()[index]), (relief, &place), force, &mut rng)
}

/// What `make` says of each of `count` presses, in order whatever the number of threads.
pub fn each<T: Send>(count: usize, make: impl Fn(usize) -> Result<T> + Sync + Send) -> Result<Vec<T>> {
    (0..count).into_par_iter().map(make).collect()
}
