//! Circumstances: everything that differs from trial to trial when objects are taken, drawn for proofs.
//!
//! A draw has the residual errors of an object's place after a touch, the errors of the arm, the places of the objects
//! within the layout's spread, and the individual properties of the objects. The first object is taken under the draw,
//! so that each draw has its own hold. Draws for a selection have wider errors ([`Errors::Wider`]), under which few
//! draws tell good grasps from better ones.

use anyhow::Result;
use control::executor::{Phase, Skill};
use dexterous_grasping::Grasp;
use nalgebra::Vector3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use scenarios::generator::trial_rng;
use scenarios::noise::{TrialNoise, draw_shifts};
use sim::robot::SimulatedRobot;
use sim::tactile::TactileBoard;

use super::{PROVING_SEED, Snapshot, TrialStart, in_hand, narrow_levels};
use crate::simulated_world::{World, drive};

/// Factors on the position errors of [`Errors::Wider`] for an informative touch and for one that tells little.
/// [`TELLS_LITTLE`] is the share of the latter. Measured on 63 touches of second objects on seed 1: errors of 0.88,
/// 0.44 and 0.79 mm in the median along x, y and z of the world, 2.0, 2.9 and 2.3 mm root mean square.
const LEFT_OVER: [f64; 2] = [0.4, 1.8];
/// Share of the touches that tell little, see [`LEFT_OVER`].
const TELLS_LITTLE: f64 = 0.2;

/// Magnitude of the errors of an object's place relative to the hand's aim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Errors {
    /// The residual errors after a touch.
    LeftOver,
    /// Standard deviations of 2.5 mm along x and y and 1.7 mm along z.
    Wider,
}

/// Returns draw `number` of the circumstances of a trial of two objects. The draw is the same for every grasp.
pub fn circumstances(world: &World, errors: Errors, number: usize) -> TrialNoise {
    let (mut noise, mut rng) = drawn(errors, number);
    noise.shifts = draw_shifts(&world.scenario.layout, 2, &mut rng);
    if let Some(spread) = &world.scenario.effects.objects {
        noise.individuals = noise.individuals.map(|_| spread.draw(&mut rng));
    }
    noise
}

/// Returns only the errors of draw `number`.
pub fn errors_of(errors: Errors, number: usize) -> TrialNoise {
    drawn(errors, number).0
}

/// Returns the errors of draw `number`, and the random generator for everything else in it.
fn drawn(errors: Errors, number: usize) -> (TrialNoise, ChaCha8Rng) {
    let stream = match errors {
        Errors::Wider => 3,
        Errors::LeftOver => 4,
    };
    let mut rng = trial_rng(PROVING_SEED, stream, number);
    let mut noise = TrialNoise::draw(&narrow_levels(), 2, &mut rng);
    if errors == Errors::LeftOver {
        for object in &mut noise.objects {
            let little = rng.random::<f64>() < TELLS_LITTLE;
            object.offset = (object.offset + noise.position) * LEFT_OVER[usize::from(little)];
        }
        // A touch gives the object's place relative to the hand, whatever the arm's error is.
        noise.position = Vector3::zeros();
    }
    (noise, rng)
}

/// Takes the first object with the first of `grasps` in the circumstances of `noise`, and plays up to the decision on
/// the second. Returns `None` if the grasp does not reach or hold the object.
pub fn hold(world: &World, grasps: [&Grasp; 2], noise: &TrialNoise, board: &TactileBoard) -> Result<Option<Snapshot>> {
    let models = world.models(&grasps.map(|grasp| grasp.object.as_str()))?;
    let start = TrialStart { protocol: world.protocol(), grasps: &grasps, noise, arm: world.cell.ready };
    let mut snapshot = Snapshot::at_start(world, &start, &models, board.clone())?;
    let real =
        models.iter().zip(&noise.individuals).map(|(model, one)| one.of(model)).collect::<Result<Vec<_>, _>>()?;
    snapshot.robot = SimulatedRobot::new(world.body(), &world.scene(&real, world.cell.ready, noise), board.clone());
    if snapshot.executor.take_planned(0).is_err() {
        return Ok(None);
    }
    let Snapshot { robot, executor } = &mut snapshot;
    for phase in [Phase::run(Skill::Lift, 0), Phase::decide(Skill::Look, 0)] {
        drive(robot, executor, phase, |_, _| {})?;
        if robot.truth().touched_by[0] == 0 {
            return Ok(None);
        }
    }
    Ok(in_hand(&robot.truth(), 0).then_some(snapshot))
}
