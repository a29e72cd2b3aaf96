//! Strategy: given where the held object really sits, which grasp takes the next object without a collision?
//!
//! For every candidate the union of the held object (with the digits holding it) and the target's geometry is checked along
//! the whole planned motion: the approach, and the target's way into its place in the hand while the digits close. The
//! candidate's worth is its proven score times the probability that this clearance, uncertain by the pose estimate and by the
//! perception of the target, is really positive. The plan is kept unless another candidate is worth clearly more.

use grasping::Grasp;
use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use parry3d_f64::shape::SharedShape;
use scenarios::geometry::{Shape, hull_mesh};
use scenarios::objects::ObjectModel;

use crate::collision::{CollisionError, Solid, clearance_along, clearance_at, hand_solids};
use crate::executive::Executive;
use crate::motion::MotionError;
use crate::worth::{Candidate, SWITCH_GAIN};

/// Points kept of a convex part for distance queries, whose cost goes with their number.
const HULL_POINTS: usize = 96;
/// A mesh counts as convex here while its hull has less than this many times its volume.
const NEARLY_CONVEX: f64 = 1.03;
/// Stages of the target's way into the hand that are checked.
const CLOSING_STAGES: usize = 4;

/// What is in the hand, as estimated.
#[derive(Debug, Clone)]
pub struct Held<'a> {
    pub object: &'a ObjectModel,
    /// `palm_from_object`.
    pub pose: Isometry3<f64>,
    /// Finger angles, rad.
    pub joints: Vec<f64>,
    /// Digits that hold it.
    pub digits: &'a [Digit],
    /// Standard deviation of its surface's position, m.
    pub sigma: f64,
}

/// One candidate's assessment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assessment {
    /// Smallest distance along the whole motion, m; negative is a collision.
    pub clearance: f64,
    /// Probability that the clearance is really negative.
    pub risk: f64,
    /// Worth times the probability of no collision.
    pub utility: f64,
}

/// What was decided, and why.
#[derive(Debug, Clone)]
pub struct Decision {
    /// The grasp to use.
    pub grasp: Grasp,
    /// Whether it is another than planned.
    pub switched: bool,
    pub plan: Assessment,
    /// Assessment of the chosen grasp.
    pub chosen: Assessment,
    /// The reason in words.
    pub reason: String,
}

/// Why no decision could be made.
#[derive(Debug, thiserror::Error)]
pub enum StrategyError {
    /// The geometric check failed.
    #[error(transparent)]
    Collision(#[from] CollisionError),
    /// A path could not be planned.
    #[error(transparent)]
    Motion(#[from] MotionError),
}

/// The solids of an object in its own frame.
pub fn object_solids(object: &ObjectModel) -> Vec<Solid> {
    let pose = Isometry3::identity();
    match &object.shape {
        Shape::Sphere { radius } => vec![Solid::new(object.name.clone(), SharedShape::ball(*radius), pose)],
        Shape::Cuboid { half, radius } => vec![Solid::rounded_box(object.name.clone(), *half, *radius, pose)],
        Shape::Cylinder { radius, half_height } => {
            let upright = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
            vec![Solid::new(object.name.clone(), SharedShape::cylinder(*half_height, *radius), pose * upright)]
        }
        Shape::Mesh(mesh) => {
            let hull_of = |points: &[Point3<f64>]| {
                Some(Solid::new(object.name.clone(), SharedShape::convex_hull(&outline(points))?, pose))
            };
            // Distances to one hull cost a fraction of those to many: slices of what is nearly convex are put together.
            let whole = hull_mesh(mesh.vertices()).ok().filter(|hull| hull.volume() < NEARLY_CONVEX * mesh.volume());
            match whole.and_then(|hull| hull_of(hull.vertices())) {
                Some(hull) => vec![hull],
                None => mesh.convex_parts().iter().filter_map(|points| hull_of(points)).collect(),
            }
        }
    }
}

/// The extreme points of a convex part in evenly spread directions: within half a millimetre of the part at these sizes.
fn outline(points: &[Point3<f64>]) -> Vec<parry3d_f64::math::Vector> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let mut kept: Vec<usize> = (0..HULL_POINTS)
        .filter_map(|n| {
            let z = 1.0 - (2.0 * n as f64 + 1.0) / HULL_POINTS as f64;
            let (sin, cos) = (golden * n as f64).sin_cos();
            let direction = Vector3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
            let along = |point: &Point3<f64>| point.coords.dot(&direction);
            (0..points.len()).max_by(|a, b| along(&points[*a]).total_cmp(&along(&points[*b])))
        })
        .collect();
    kept.sort_unstable();
    kept.dedup();
    kept.iter().map(|n| parry3d_f64::math::Vector::new(points[*n].x, points[*n].y, points[*n].z)).collect()
}

/// `solids` of an object that is at `pose`.
fn placed(solids: &[Solid], pose: &Isometry3<f64>) -> Vec<Solid> {
    solids.iter().map(|solid| Solid { pose: pose * solid.pose, ..solid.clone() }).collect()
}

/// The geometry of a decision: what moves with the palm (palm frame) and the target (its own frame).
struct Scene {
    moving: Vec<Solid>,
    target: Vec<Solid>,
    sigma: f64,
}

/// Assesses `candidate` from the executive's present pose.
fn assess(executive: &Executive, scene: &Scene, candidate: &Candidate) -> Result<Assessment, StrategyError> {
    let percept = executive.second().1;
    let path = executive.path_to_second(&candidate.grasp)?;
    let fixed = placed(&scene.target, &percept.pose());
    let mut clearance =
        clearance_along(&path, &scene.moving, &fixed, 2000)?.map_or(f64::INFINITY, |found| found.min_distance);
    let palm = path.end();
    let before = palm.inverse() * percept.pose();
    if let Some(after) = candidate.grasp.held {
        for stage in 1..=CLOSING_STAGES {
            let part = stage as f64 / CLOSING_STAGES as f64;
            // Only the place matters for most targets; the turn into the hand is taken over at the end.
            let place = before.translation.vector.lerp(&after.translation.vector, part);
            let rotation = if stage == CLOSING_STAGES { after.rotation } else { before.rotation };
            let there = Isometry3::from_parts(Translation3::from(place), rotation);
            let found = clearance_at(&Isometry3::identity(), &scene.moving, &placed(&scene.target, &there))?;
            clearance = clearance.min(found.map_or(f64::INFINITY, |found| found.min_distance));
        }
    }
    let passes = normal_cdf(clearance / scene.sigma);
    Ok(Assessment { clearance, risk: 1.0 - passes, utility: candidate.worth * passes })
}

/// What a choice depends on.
#[derive(Clone, Copy)]
pub struct Situation<'a> {
    /// Where the palm is, and where the target is seen.
    pub executive: &'a Executive,
    pub hand: &'a Hand,
    /// What it holds.
    pub held: &'a Held<'a>,
    /// The object to take next.
    pub target: &'a ObjectModel,
    /// Standard deviation of perceiving and reaching the target, m.
    pub target_sigma: f64,
}

/// Chooses among `candidates`; the first is the plan.
pub fn choose(situation: &Situation, candidates: &[Candidate]) -> Result<Option<Decision>, StrategyError> {
    let Situation { executive, hand, held, target, target_sigma } = *situation;
    let mut moving = placed(&object_solids(held.object), &held.pose);
    moving.extend(hand_solids(hand, &held.joints, held.digits, false));
    let sigma = held.sigma.hypot(target_sigma).max(1e-4);
    let scene = Scene { moving, target: object_solids(target), sigma };
    let Some((planned, others)) = candidates.split_first() else { return Ok(None) };
    let plan = assess(executive, &scene, planned)?;
    // Only what is worth clearly more than the plan replaces it, and no candidate is worth more than without any obstacle:
    // those that cannot win are not looked at.
    let (mut chosen, mut assessment) = (planned, plan);
    for candidate in others {
        if candidate.worth > assessment.utility.max(SWITCH_GAIN * plan.utility) {
            let assessed = assess(executive, &scene, candidate)?;
            if assessed.utility > assessment.utility.max(SWITCH_GAIN * plan.utility) {
                (chosen, assessment) = (candidate, assessed);
            }
        }
    }
    let switched = chosen.grasp.id != planned.grasp.id;
    let reason = reason(&held.object.name, [&planned.grasp, &chosen.grasp], [&plan, &assessment]);
    Ok(Some(Decision { grasp: chosen.grasp.clone(), switched, plan, chosen: assessment, reason }))
}

/// The choice in words; grasps and assessments of the plan and of what was chosen.
fn reason(held: &str, [planned, chosen]: [&Grasp; 2], [plan, assessment]: [&Assessment; 2]) -> String {
    let mm = |clearance: f64| clearance * 1e3;
    if chosen.id == planned.id {
        return format!(
            "grasp {} as planned passes the held {held} at {:.1} mm (worth {:.2})",
            planned.id,
            mm(plan.clearance),
            plan.utility
        );
    }
    format!(
        "grasp {} would pass the held {held} at {:.1} mm (worth {:.2}); grasp {} passes at {:.1} mm (worth {:.2})",
        planned.id,
        mm(plan.clearance),
        plan.utility,
        chosen.id,
        mm(assessment.clearance),
        assessment.utility
    )
}

/// Distribution function of the standard normal.
fn normal_cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x / std::f64::consts::SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::normal_cdf;

    #[test]
    fn normal_distribution() {
        for (x, p) in [(0.0, 0.5), (1.0, 0.841344746), (-1.959963984540054, 0.025)] {
            assert!((normal_cdf(x) - p).abs() < 1e-9, "{x}");
        }
    }
}
