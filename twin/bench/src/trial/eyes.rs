//! Prior perception of a trial: what is reported of an object, how wrong, how late, and whether it is seen at all.

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
use crate::body::{Body, Glance};

/// A time just short of a tick, s: what is as old as the latency has arrived.
const JUST: f64 = 1e-9;

/// The generators of a trial's looks; a clone sees with the same errors.
#[derive(Debug, Clone)]
pub struct Looks {
    rng: ChaCha8Rng,
    sight: Option<Sight>,
}

impl Looks {
    /// Looks whose own errors come from `rng`; with `sight` what vision errs by beside them.
    pub fn new(rng: ChaCha8Rng, sight: Option<Sight>) -> Self {
        Self { rng, sight }
    }

    /// `noise` with the errors of the first look at `objects`, which stand at `places`.
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

    /// The error of a later look at one of the `objects`, by its index, which stands at `pose` as far as anybody knows.
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

/// Where the objects were a moment ago: as long as vision takes to report it.
#[derive(Debug, Clone, Default)]
pub struct History {
    /// s.
    length: f64,
    poses: VecDeque<(f64, Vec<Isometry3<f64>>)>,
}

impl History {
    /// Of the last `length` s; nothing is kept where that is 0.
    pub fn new(length: f64) -> Self {
        Self { length, poses: VecDeque::new() }
    }

    /// Takes note of where the objects are.
    pub fn see(&mut self, truth: &Truth) {
        if self.length <= 0.0 {
            return;
        }
        self.poses.push_back((truth.time, truth.objects.clone()));
        // The first one is the newest that is old enough.
        while self.poses.get(1).is_some_and(|(time, _)| *time <= truth.time - self.length + JUST) {
            self.poses.pop_front();
        }
    }

    /// Where object `index` was when the frame was taken of which the report arrives now; `None` where nothing is kept.
    pub fn then(&self, index: usize) -> Option<Isometry3<f64>> {
        self.poses.front().map(|(_, poses)| poses[index])
    }
}

/// Prior perception of a trial in progress: each look has an error of its own, and those of the disturbances.
pub struct NoisyEyes<'a> {
    /// Whose objects are looked at.
    pub robot: &'a mut Body,
    /// What perception is wrong about.
    pub disturber: &'a Disturber,
    /// Errors.
    pub noise: &'a NoiseLevels,
    /// The branch's looks.
    pub looks: &'a mut Looks,
    /// The objects as they are known.
    pub objects: &'a [Arc<ObjectModel>],
    /// In every way in which they can lie.
    pub library: &'a ObjectSet,
    /// Where they were.
    pub history: &'a History,
}

impl Eyes for NoisyEyes<'_> {
    fn look(&mut self, object: usize) -> Result<Option<Sighted>, EyesError> {
        let camera = self.looks.sight.as_ref().map(|sight| Point3::from(sight.eyes().camera));
        let mut then = None;
        if camera.is_some() {
            // A body whose truth nobody knows errs by itself.
            then = self.history.then(object).or_else(|| self.robot.truth().map(|truth| truth.objects[object]));
        }
        let noise = self.looks.later(self.noise, (object, self.objects), self.library, then.as_ref());
        let noise = self.disturber.perceived_noise(object, &noise);
        let glance = Glance { object, noise, then, camera };
        // Whoever asks for the cause of the error finds it under this one.
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

    /// What is reported was so long ago, to a tick, and nothing older is kept; at the beginning it is the first there is.
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
