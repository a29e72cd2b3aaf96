//! Circumstances: everything that differs from trial to trial when objects are taken, drawn for verification.
//!
//! A draw has the residual position errors of an object after a touch, the errors of the arm, the places of the objects
//! within the layout's variation, and the properties of the object instances. The first object is taken under the draw,
//! so that each draw has its own hold. Draws for a selection have wider errors ([`ErrorMagnitude::Wide`]), under which
//! few draws distinguish good grasps from better ones.

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

use super::{RolloutSnapshot, TrialStart, VERIFICATION_SEED, in_hand, narrow_levels};
use crate::simulated_world::{SimulatedWorld, drive};

/// Factors on the position errors of [`ErrorMagnitude::Residual`] for an informative touch and for an uninformative
/// one. [`UNINFORMATIVE_SHARE`] is the share of the latter. Measured on 63 touches of second objects on seed 1: errors
/// of 0.88, 0.44 and 0.79 mm in the median along x, y and z of the world, 2.0, 2.9 and 2.3 mm root mean square.
const RESIDUAL_FACTORS: [f64; 2] = [0.4, 1.8];
/// Share of the uninformative touches, see [`RESIDUAL_FACTORS`].
const UNINFORMATIVE_SHARE: f64 = 0.2;

/// Magnitude of the position errors of an object relative to the hand's aim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorMagnitude {
    /// The residual errors after a touch.
    Residual,
    /// Standard deviations of 2.5 mm along x and y and 1.7 mm along z.
    Wide,
}

/// Returns draw `number` of the circumstances of a trial of two objects. The draw is the same for every grasp.
pub fn draw_circumstances(world: &SimulatedWorld, errors: ErrorMagnitude, number: usize) -> TrialNoise {
    let (mut noise, mut rng) = draw_noise(errors, number);
    noise.shifts = draw_shifts(&world.scenario.layout, 2, &mut rng);
    if let Some(spread) = &world.scenario.effects.objects {
        noise.object_instances = noise.object_instances.map(|_| spread.draw(&mut rng));
    }
    noise
}

/// Returns only the errors of draw `number`.
pub fn draw_errors(errors: ErrorMagnitude, number: usize) -> TrialNoise {
    draw_noise(errors, number).0
}

/// Returns the errors of draw `number`, and the random generator for everything else in it.
fn draw_noise(errors: ErrorMagnitude, number: usize) -> (TrialNoise, ChaCha8Rng) {
    let stream = match errors {
        ErrorMagnitude::Wide => 3,
        ErrorMagnitude::Residual => 4,
    };
    let mut rng = trial_rng(VERIFICATION_SEED, stream, number);
    let mut noise = TrialNoise::draw(&narrow_levels(), 2, &mut rng);
    if errors == ErrorMagnitude::Residual {
        for object in &mut noise.objects {
            let little = rng.random::<f64>() < UNINFORMATIVE_SHARE;
            object.offset = (object.offset + noise.position) * RESIDUAL_FACTORS[usize::from(little)];
        }
        // A touch gives the object's position relative to the hand, whatever the arm's error is.
        noise.position = Vector3::zeros();
    }
    (noise, rng)
}

/// Takes the first object with the first of `grasps` in the circumstances of `noise`, and runs up to the decision on
/// the second. Returns `None` if the grasp does not reach or hold the object.
pub fn hold_first(
    world: &SimulatedWorld,
    grasps: [&Grasp; 2],
    noise: &TrialNoise,
    board: &TactileBoard,
) -> Result<Option<RolloutSnapshot>> {
    let models = world.models(&grasps.map(|grasp| grasp.object.as_str()))?;
    let start = TrialStart { protocol: world.protocol(), grasps: &grasps, noise, arm: world.cell.ready_posture };
    let mut snapshot = RolloutSnapshot::at_start(world, &start, &models, board.clone())?;
    let real = models
        .iter()
        .zip(&noise.object_instances)
        .map(|(model, one)| one.apply_to(model))
        .collect::<Result<Vec<_>, _>>()?;
    snapshot.robot = SimulatedRobot::new(
        world.simulated_robot(),
        &world.scene(&real, world.cell.ready_posture, noise),
        board.clone(),
    );
    if snapshot.executor.take_planned(0).is_err() {
        return Ok(None);
    }
    let RolloutSnapshot { robot, executor } = &mut snapshot;
    for phase in [Phase::run(Skill::Lift, 0), Phase::decide(Skill::Snapshot, 0)] {
        drive(robot, executor, phase, |_, _| {})?;
        if robot.truth().touched_by[0] == 0 {
            return Ok(None);
        }
    }
    Ok(in_hand(&robot.truth(), 0).then_some(snapshot))
}
