//! Circumstances: what differs from trial to trial when objects are taken, drawn for proofs.
//!
//! A draw has the errors that are left of an object's place once it was touched, those of the arm, where the objects stand in the layout's spread, and
//! the individuals that they are. The first object is taken under it, so that each draw has a hold of its own. Draws for a selection
//! have wider errors ([`Errors::Wider`]): few of them tell good grasps from better ones.

use anyhow::Result;
use control::executor::{Phase, Skill};
use grasping::Grasp;
use nalgebra::Vector3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use scenarios::generator::trial_rng;
use scenarios::noise::{TrialNoise, draw_shifts};
use sim::robot::SimulatedRobot;
use sim::tactile::TactileBoard;

use super::{PROVING_SEED, Snapshot, TrialStart, in_hand, narrow_levels};
use crate::simulated_world::{World, drive};

/// Factors of the errors of place of [`Errors::Wider`] for a touch that tells all and one that tells little, and the share of the latter. From 63 touches
/// of second objects on seed 1: errors of 0.88, 0.44 and 0.79 mm in the median along x, y and z of the world, 2.0, 2.9 and 2.3 mm root mean square.
const LEFT_OVER: [f64; 2] = [0.4, 1.8];
/// See [`LEFT_OVER`].
const TELLS_LITTLE: f64 = 0.2;

/// Size of the errors of an object's place beside the hand's aim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Errors {
    /// As after a touch.
    LeftOver,
    /// 2.5 mm along each axis.
    Wider,
}

/// Draw `number` of the circumstances of a trial of two objects, the same one for every grasp.
pub fn circumstances(world: &World, errors: Errors, number: usize) -> TrialNoise {
    let (mut noise, mut rng) = drawn(errors, number);
    noise.shifts = draw_shifts(&world.scenario.layout, 2, &mut rng);
    if let Some(spread) = &world.scenario.effects.objects {
        noise.individuals = noise.individuals.map(|_| spread.draw(&mut rng));
    }
    noise
}

/// The errors of draw `number` alone.
pub fn errors_of(errors: Errors, number: usize) -> TrialNoise {
    drawn(errors, number).0
}

/// The errors of draw `number`, and the generator of all else in it.
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
        // A touch tells where an object is beside the hand, whatever the arm's error is.
        noise.position = Vector3::zeros();
    }
    (noise, rng)
}

/// The first of `grasps` has taken its object in the circumstances of `noise`, up to the decision on the second. None where it does not reach or
/// hold it.
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
