//! Prior perception of a trial: reported object poses with their errors, latency and occlusion.

use std::collections::VecDeque;
use std::sync::Arc;

use control::percept::{Eyes, EyesError, Sighted};
use nalgebra::{Isometry3, Point3};
use rand_chacha::ChaCha8Rng;
use scenarios::noise::{NoiseLevels, ObjectNoise, TrialNoise};
use scenarios::sight::Sight;
use sim::robot::Truth;
use world::objects::{ObjectModel, ObjectSet};

use super::disturbance::Disturber;
use robot_backends::{Body, Glance};

/// Tolerance of the latency, s, well below a tick: a pose exactly as old as the latency has arrived.
const JUST: f64 = 1e-9;

/// Random generators of a trial's looks; a clone sees with the same errors.
#[derive(Debug, Clone)]
pub struct Looks {
    rng: ChaCha8Rng,
    sight: Option<Sight>,
}

impl Looks {
    /// Creates looks whose own errors come from `rng`, with the additional errors of vision in `sight`.
    pub fn new(rng: ChaCha8Rng, sight: Option<Sight>) -> Self {
        Self { rng, sight }
    }

    /// Returns `noise` with the errors of the first look at `objects` standing at `places`.
    pub fn first(
        &mut self,
        noise: &TrialNoise,
        objects: &[Arc<ObjectModel>],
        library: &ObjectSet,
        places: &[Isometry3<f64>],
    ) -> TrialNoise {
        let Some(sight) = &mut self.sight else { return *noise };
        let mut seen = *noise;
        for ((error, object), place) in seen.objects.iter_mut().zip(objects).zip(places) {
            *error = sight.error(error, object, library, &place.rotation);
        }
        seen
    }

    /// Draws the error of a later look at one of the `objects`, given by its index, which stands at `pose` as far as is
    /// known.
    fn later(
        &mut self,
        levels: &NoiseLevels,
        (index, objects): (usize, &[Arc<ObjectModel>]),
        library: &ObjectSet,
        pose: Option<&Isometry3<f64>>,
    ) -> ObjectNoise {
        let (object, fresh) = (&objects[index], TrialNoise::draw(levels, objects.len(), &mut self.rng).objects[index]);
        match &mut self.sight {
            None => fresh,
            Some(sight) => sight.error(&fresh, object, library, &pose.map_or(object.rest, |pose| pose.rotation)),
        }
    }
}

/// Past object poses, as far back as the latency of vision.
#[derive(Debug, Clone, Default)]
pub struct History {
    /// Length of the history, s.
    length: f64,
    poses: VecDeque<(f64, Vec<Isometry3<f64>>)>,
}

impl History {
    /// Creates a history of the last `length` s; it keeps nothing if that is 0.
    pub fn new(length: f64) -> Self {
        Self { length, poses: VecDeque::new() }
    }

    /// Stores the present object poses.
    pub fn see(&mut self, truth: &Truth) {
        if self.length <= 0.0 {
            return;
        }
        self.poses.push_back((truth.time, truth.objects.clone()));
        // The first entry is the newest that is old enough.
        while self.poses.get(1).is_some_and(|(time, _)| *time <= truth.time - self.length + JUST) {
            self.poses.pop_front();
        }
    }

    /// Returns the pose of object `index` when the frame was taken whose report arrives now. `None` if nothing is kept.
    pub fn then(&self, index: usize) -> Option<Isometry3<f64>> {
        self.poses.front().map(|(_, poses)| poses[index])
    }
}

/// Prior perception of a trial in progress: each look has an error of its own, and those of the disturbances.
pub struct NoisyEyes<'a> {
    /// Body whose objects are looked at.
    pub robot: &'a mut Body,
    /// Disturbances, with their perception errors.
    pub disturber: &'a Disturber,
    /// Noise levels.
    pub noise: &'a NoiseLevels,
    /// Generators of the branch's looks.
    pub looks: &'a mut Looks,
    /// The objects as they are known.
    pub objects: &'a [Arc<ObjectModel>],
    /// Models of the objects in every stable pose.
    pub library: &'a ObjectSet,
    /// Past poses of the objects.
    pub history: &'a History,
}

impl Eyes for NoisyEyes<'_> {
    fn look(&mut self, object: usize) -> Result<Option<Sighted>, EyesError> {
        let camera = self.looks.sight.as_ref().map(|sight| Point3::from(sight.eyes().camera));
        let mut then = None;
        if camera.is_some() {
            // A body without ground truth has errors of its own.
            then = self.history.then(object).or_else(|| self.robot.truth().map(|truth| truth.objects[object]));
        }
        let noise = self.looks.later(self.noise, (object, self.objects), self.library, then.as_ref());
        let noise = self.disturber.perceived_noise(object, &noise);
        let glance = Glance { object, noise, then, camera };
        // The cause of the error stays in its chain.
        let boxed = |error: anyhow::Error| error.reallocate_into_boxed_dyn_error_without_backtrace();
        self.robot.look(&glance).map_err(|error| EyesError { object, source: boxed(error) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time: f64) -> Truth {
        let pose = Isometry3::translation(time, 0.0, 0.0);
        Truth { time, objects: vec![pose, pose.inverse()], ..Truth::default() }
    }

    /// A report is as old as the latency, to a tick, and nothing older is kept. At the beginning it is the first pose.
    #[test]
    fn a_report_is_as_old_as_the_latency() {
        let mut history = History::new(0.15);
        let tick = 1.0 / 120.0;
        for n in 0..200 {
            let time = f64::from(n) * tick;
            history.see(&at(time));
            let then = history.then(0).expect("kept").translation.x;
            let age = time - then;
            assert!((age - time.min(0.15)).abs() < tick, "{age}");
            assert!(then <= (time - 0.15).max(0.0) + 1e-9);
            assert_eq!(history.then(1).expect("kept").translation.x, -then);
        }
        assert!(history.poses.len() < 22);
        let mut none = History::new(0.0);
        none.see(&at(1.0));
        assert!(none.then(0).is_none());
    }
}
