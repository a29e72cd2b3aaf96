//! The geometry of a decision: how what is held passes the target on the way there, and while the digits close.

use grasping::Grasp;
use nalgebra::{Isometry3, Translation3, Vector3};

use super::solids::{free_solids, held_solids, placed};
use super::ways::{clear_enough, clearance_after};
use super::{Situation, StrategyError};
use crate::collision::{Solid, clearance_along, clearance_at};
use crate::executor::Executor;
use crate::percept::Percept;
use crate::trajectory::PosePath;
use crate::worth::Candidate;

/// Stages of the target's way into the hand that are checked.
const CLOSING_STAGES: usize = 4;
/// Poses that stand for each of the two parts of a course, less one.
const COURSE: usize = 16;
/// Beyond this many standard deviations a clearance says nothing.
const FAR: f64 = 2.0;

/// A way of the hand that was weighed, as the held object would go.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Course {
    /// `world_from_object` of the held object along the way.
    pub poses: Vec<Isometry3<f64>>,
    /// Where it comes nearest to the target, and the distance there, m; negative is a collision. `None` where that is before the
    /// last stretch.
    pub nearest: Option<(Isometry3<f64>, f64)>,
}

/// The geometry of a decision: what moves with the palm (palm frame), as felt and as rehearsed, and the target (its own frame).
pub(super) struct Scene<'a> {
    /// The held object alone.
    object: Vec<Solid>,
    /// With the digits that hold it.
    moving: Vec<Solid>,
    /// That and the rest of the hand, which is to stay clear on the way to the approach pose.
    whole: Vec<Solid>,
    rehearsed: Option<Vec<Solid>>,
    target: &'a [Solid],
    sigma: f64,
}

impl<'a> Scene<'a> {
    pub(super) fn new(situation: &Situation<'a>) -> Self {
        let (hand, held) = (situation.hand, situation.held);
        let rehearsed = situation.rehearsed.map(|(pose, joints)| held_solids(hand, held, (&pose, joints)));
        let moving = held_solids(hand, held, (&held.pose, &held.joints));
        let whole = [&moving[..], &free_solids(hand, held)].concat();
        Self {
            object: placed(held.solids, &held.pose),
            moving,
            whole,
            rehearsed,
            target: situation.target,
            sigma: held.sigma.hypot(situation.target_sigma).max(1e-4),
        }
    }

    /// The way to the approach pose of `grasp` that keeps the whole hand clear of the target, which is seen at `percept`: of those
    /// that do so the first, else the one that does best. With its smallest distance, m.
    fn way(
        &self,
        executor: &Executor,
        grasp: &Grasp,
        (percept, beside): (&Percept, &Percept),
    ) -> Result<(f64, Vec<Isometry3<f64>>), StrategyError> {
        let fixed = placed(self.target, &percept.pose());
        let best = clear_enough(executor.ways(), FAR * self.sigma, |stops| {
            clearance_after(stops, &self.whole, &fixed, |stops| {
                let [way, _] = executor.path_to(stops, grasp, beside)?;
                Ok(way)
            })
        })?;
        Ok(best.unwrap_or((f64::NEG_INFINITY, Vec::new())))
    }

    /// Smallest distance of `moving` to the target, which is seen at `percept`, while `path` is followed and `grasp` closes; and the
    /// palm's pose there.
    fn clearance(
        &self,
        moving: &[Solid],
        path: &PosePath,
        grasp: &Grasp,
        percept: &Percept,
    ) -> Result<(f64, Isometry3<f64>), StrategyError> {
        let fixed = placed(self.target, &percept.pose());
        let along = clearance_along(path, moving, &fixed, 2000)?;
        let (mut clearance, mut palm) =
            along.map_or((f64::INFINITY, path.end()), |found| (found.min_distance, path.sample(found.time).0));
        let before = path.end().inverse() * percept.pose();
        if let Some(after) = grasp.held {
            for stage in 1..=CLOSING_STAGES {
                let part = stage as f64 / CLOSING_STAGES as f64;
                // Only the place matters for most targets; the turn into the hand is taken over at the end.
                let place = before.translation.vector.lerp(&after.translation.vector, part);
                let rotation = if stage == CLOSING_STAGES { after.rotation } else { before.rotation };
                let there = Isometry3::from_parts(Translation3::from(place), rotation);
                let found = clearance_at(&Isometry3::identity(), moving, &placed(self.target, &there))?;
                if let Some(found) = found.filter(|found| found.min_distance < clearance) {
                    (clearance, palm) = (found.min_distance, path.end());
                }
            }
        }
        Ok((clearance, palm))
    }

    /// Distance of the held object alone to the target, which is seen at `percept`, when the palm has arrived at the end of `path`, m.
    fn separation(&self, path: &PosePath, percept: &Percept) -> Result<f64, StrategyError> {
        let found = clearance_at(&path.end(), &self.object, &placed(self.target, &percept.pose()))?;
        Ok(found.map_or(f64::INFINITY, |found| found.min_distance))
    }

    /// How the hold as felt gets to the target and takes it with `candidate`, aimed `aim` beside what is seen.
    pub(super) fn passage(
        &self,
        executor: &Executor,
        candidate: &Candidate,
        aim: &Vector3<f64>,
    ) -> Result<Passage, StrategyError> {
        let (percept, grasp) = (executor.target(1).percept, &candidate.grasp);
        let beside = Percept { position: percept.position + aim, ..percept };
        let risk = |clearance: f64| normal_cdf(-clearance / self.sigma);
        let (there, stops) = self.way(executor, grasp, (&percept, &beside))?;
        let [first, last] = executor.path_to(&stops, grasp, &beside)?;
        let (taking, palm) = self.clearance(&self.moving, &last, grasp, &percept)?;
        // Rehearsals after many holds have met what is in the way of each of them.
        let proven = candidate.rehearsed.iter().any(|rehearsed| rehearsed.hold.is_some());
        let contact = if proven || taking > FAR * self.sigma {
            0.0
        } else {
            let known = match &self.rehearsed {
                Some(rehearsed) if !candidate.rehearsed.is_empty() => {
                    risk(self.clearance(rehearsed, &last, grasp, &percept)?.0)
                }
                _ => 0.0,
            };
            (risk(taking) - known).max(0.0)
        };
        let on_the_way = if there > FAR * self.sigma { 0.0 } else { risk(there) };
        let contact = 1.0 - (1.0 - contact) * (1.0 - on_the_way);
        let nearest = (taking <= there && taking.is_finite()).then_some(palm);
        let separation = self.separation(&last, &percept)?;
        Ok(Passage { clearance: taking.min(there), separation, contact, stops, path: [first, last], nearest })
    }
}

/// How what is held passes the target.
pub(super) struct Passage {
    /// Smallest distance, m.
    pub clearance: f64,
    /// See [`super::Assessment::separation`].
    pub separation: f64,
    /// Probability of a contact beyond what rehearsals have seen: they began where the trial's plan does, and took the same last
    /// stretch.
    pub contact: f64,
    /// Of the way to the approach pose.
    pub stops: Vec<Isometry3<f64>>,
    /// That way, and the last stretch.
    path: [PosePath; 2],
    /// The palm's pose where the clearance is smallest, if that is on the last stretch.
    nearest: Option<Isometry3<f64>>,
}

impl Passage {
    /// The same as it goes for the object that is held at `palm_from_object`.
    pub fn course(&self, palm_from_object: &Isometry3<f64>) -> Course {
        let sampled = |path: &PosePath| {
            let step = path.duration() / COURSE as f64;
            (0..=COURSE).map(|n| path.sample(step * n as f64).0 * palm_from_object).collect::<Vec<_>>()
        };
        let nearest = self.nearest.map(|palm| (palm * palm_from_object, self.clearance));
        Course { poses: self.path.iter().flat_map(sampled).collect(), nearest }
    }
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
