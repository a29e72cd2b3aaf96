//! Presses of known shapes into simulated pads: training data of networks, and test data of normals.

use anyhow::{Context, Result};
use hand_model::Hand;
use hand_model::pads::IMAGE_SIZE;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use sim::tactile::TactileBoard;
use tactile_optics::shapes::TEST_SHAPES;
use tactile_optics::{Sensor, press};
use tactile_perception::CalibrationPress;

/// Shapes that are never trained on.
pub const HELD_OUT_SHAPES: [&str; 4] = ["dots", "moon", "prism", "wave1"];
/// Radii of the balls pressed in addition to the shapes, m.
const BALL_RADII: [f64; 4] = [0.004, 0.008, 0.015, 0.025];
/// Range of normal forces, N.
const FORCE_RANGE: std::ops::Range<f64> = 0.4..5.0;

/// Height map of an object's underside: height (m) of its lowest points above its own plane; `None` outside the object.
pub type Relief = Box<dyn Fn(f64, f64) -> Option<f64> + Sync + Send>;

/// Returns all shapes and balls that may be trained on.
pub fn training_reliefs() -> Vec<Relief> {
    let shapes = TEST_SHAPES.iter().filter(|(name, _)| !HELD_OUT_SHAPES.contains(name));
    let shapes = shapes.map(|(_, relief)| Box::new(relief) as Relief);
    shapes.chain(BALL_RADII.map(|radius| Box::new(move |x, y| ball_height(radius, x, y)) as Relief)).collect()
}

/// Returns a shape by its name, those of [`HELD_OUT_SHAPES`] included.
pub fn relief_by_name(name: &str) -> Option<Relief> {
    TEST_SHAPES.iter().find(|(known, _)| *known == name).map(|(_, relief)| Box::new(relief) as Relief)
}

/// Returns the height of a ball's lower half above the plane it lies on, m; `None` outside the ball.
pub fn ball_height(radius: f64, x: f64, y: f64) -> Option<f64> {
    let inside = radius * radius - x * x - y * y;
    (inside > 0.0).then(|| radius - inside.sqrt())
}

/// Position and rotation of a pressed object.
pub struct PressPlace {
    /// Position of the object's origin, m.
    pub at: [f64; 2],
    /// Rotation about the normal, rad.
    pub turn: f64,
}

impl PressPlace {
    /// Draws a random place within 0.38 of a rectangle's sides (m) from its centre, with any rotation.
    pub fn draw(sides: [f64; 2], middle: [f64; 2], rng: &mut impl Rng) -> Self {
        let at = std::array::from_fn(|k| middle[k] + rng.random_range(-0.38..0.38) * sides[k]);
        Self { at, turn: rng.random_range(0.0..std::f64::consts::TAU) }
    }

    /// Returns the relief's height at a point of the pad.
    pub fn height(&self, relief: &Relief, x: f64, y: f64) -> Option<f64> {
        let (sin, cos) = self.turn.sin_cos();
        let (x, y) = (x - self.at[0], y - self.at[1]);
        relief(cos * x + sin * y, cos * y - sin * x)
    }
}

/// Presses `relief` into the pad of camera `index`.
pub fn press_into(
    hand: &Hand,
    (index, sensor): (usize, &Sensor),
    (relief, place): (&Relief, &PressPlace),
    force: f64,
    rng: &mut impl Rng,
) -> Result<CalibrationPress> {
    let camera = &hand.cameras[index];
    let pad = &hand.pads[camera.pad];
    let top = pad.surface_height(place.at[0], place.at[1]);
    let pressed = press(pad, &[camera], &hand.gel(), force, |x, y| place.height(relief, x, y).map(|z| top + z))?;
    let map = &pressed.maps[0];
    // The label is the gel's surface, bulge included.
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

/// Makes press `n` of a random sequence: cameras in turn, boards in turn, with random relief, place and force.
pub fn random_press(
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
    let place = PressPlace::draw([camera.w, camera.h], [0.0, camera.center_y], &mut rng);
    let force = rng.random_range(FORCE_RANGE);
    press_into(hand, (index, &board.sensors()[index]), (relief, &place), force, &mut rng)
}

/// Runs `make` for each of `count` presses in parallel. The results are in order, whatever the number of threads.
pub fn make_each<T: Send>(count: usize, make: impl Fn(usize) -> Result<T> + Sync + Send) -> Result<Vec<T>> {
    (0..count).into_par_iter().map(make).collect()
}
