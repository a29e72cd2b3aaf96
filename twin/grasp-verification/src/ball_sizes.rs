//! Balls of other sizes: each diameter of a scenario's sweep becomes an object of its own, with the grasps of the ball
//! that it replaces.

use std::sync::Arc;

use anyhow::Result;
use dexterous_grasping::{Grasp, Repertoire};
use nalgebra::Vector3;
use scenarios::disturbance::{SizeSweep, TargetObject};
use world::objects::ObjectModel;

use crate::grasp_pair::GraspPair;
use crate::simulated_world::SimulatedWorld;

/// Adds the balls of `sweep` to the world's objects and to the repertoire, and returns them.
pub fn add_balls(
    sweep: &SizeSweep,
    world: &mut SimulatedWorld,
    repertoire: &mut Repertoire,
) -> Result<Vec<Arc<ObjectModel>>> {
    let names = match sweep.object {
        TargetObject::First => world.scenario.first.clone(),
        TargetObject::Second => world.scenario.second.clone(),
    };
    let mut added = Vec::new();
    for ball in names {
        let model = world.object(&ball)?;
        let radius = model.shape.bounding_radius();
        for diameter in &sweep.diameters {
            let name = ball_name(&ball, *diameter);
            let other = ObjectModel { name: name.clone(), ..model.scaled(0.5 * diameter / radius)? };
            world.objects.insert(other);
            added.push(world.object(&name)?);
            for grasp in repertoire.grasps.get(&ball).cloned().unwrap_or_default() {
                repertoire.insert(resized(&grasp, &name, 0.5 * diameter - radius));
            }
        }
    }
    Ok(added)
}

/// Returns the grasp pair of a trial of the sweep.
pub fn pair_for_trial(plan: &GraspPair, sweep: &SizeSweep, trial: usize) -> GraspPair {
    let mut other = plan.clone();
    let ball = match sweep.object {
        TargetObject::First => &mut other.first,
        TargetObject::Second => &mut other.second,
    };
    *ball = ball_name(ball, sweep.diameter(trial));
    other
}

fn ball_name(ball: &str, diameter: f64) -> String {
    format!("{ball}_as_{:.1}_mm", diameter * 1e3)
}

/// Adapts `grasp` to a ball whose radius is larger by `growth` (m). Its centre is that much farther from the palm,
/// whose normal points to it along -z.
pub fn resized(grasp: &Grasp, object: &str, growth: f64) -> Grasp {
    let mut other = Grasp { object: object.to_owned(), ..grasp.clone() };
    other.center[2] -= growth;
    if let Some(held) = &mut other.held {
        held.translation.vector -= Vector3::z() * growth;
    }
    other
}

#[cfg(test)]
mod tests {
    use super::*;
    use hand_model::{Digit, RobotModel};
    use scenarios::Scenario;

    const SIDE: [Digit; 2] = [Digit::Ring, Digit::Little];

    /// The palm stays at the same distance from the surface. Numbers and digits stay the same.
    #[test]
    fn the_palm_keeps_its_distance() {
        let mut world = SimulatedWorld::new(&RobotModel::ftac_gen3(), Scenario::benchmark()).unwrap();
        world.scenario.first = vec!["golf_ball".into()];
        let mut repertoire = crate::builtin::repertoire().unwrap();
        let sweep = SizeSweep { object: TargetObject::First, diameters: vec![0.036, 0.05] };
        let added = add_balls(&sweep, &mut world, &mut repertoire).unwrap();
        assert_eq!(added.len(), 2);
        let gap = |name: &str, id: u32| {
            let grasp = repertoire.for_digits(name, &SIDE).find(|grasp| grasp.id == id).unwrap();
            -grasp.center[2] - world.object(name).unwrap().shape.bounding_radius()
        };
        let id = repertoire.for_digits("golf_ball", &SIDE).next().unwrap().id;
        for ball in &added {
            assert!((gap(&ball.name, id) - gap("golf_ball", id)).abs() < 1e-12, "{}", ball.name);
        }
        let plan = GraspPair::new(["golf_ball", "egg"], id, Vec::new());
        assert_eq!(pair_for_trial(&plan, &sweep, 3).first, added[1].name);
    }
}
