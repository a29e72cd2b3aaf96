//! Paths that the executor could take next: to touch an object, or to grasp it.

use grasping::Grasp;
use nalgebra::Isometry3;
use world::geometry::Shape;

use super::{Executor, Target};
use crate::motion::MotionError;
use crate::motion::approach::in_parts;
use crate::palpation::{self, Touching};
use crate::percept::Percept;
use crate::trajectory::PosePath;

/// Rises of the palm before it goes to an object beside others, so that what it holds passes above, m.
const RISES: [f64; 3] = [0.0, 0.05, 0.1];

impl Executor {
    /// The stops of the ways from the present palm pose to another, before the approach pose: the shortest way, then higher ones.
    pub fn ways(&self) -> impl Iterator<Item = Vec<Isometry3<f64>>> {
        RISES.iter().map(|rise| self.motion.stops(self.rise() + rise))
    }

    /// The path by way of `stops` that takes an object with `grasp` where it is seen at `percept`: to the approach pose, and from
    /// there to where the digits close.
    pub fn path_to(
        &self,
        stops: &[Isometry3<f64>],
        grasp: &Grasp,
        percept: &Percept,
    ) -> Result<[PosePath; 2], MotionError> {
        Ok(in_parts((self.motion.hand(), &self.protocol.limits), stops, grasp, percept)?)
    }

    /// A path by way of `stops` that the arm can follow to where `grasp` closes on what is seen at `percept`; see
    /// [`crate::motion::Motion::rehearsed_approach`].
    pub fn rehearsed_approach(&self, stops: &[Isometry3<f64>], grasp: &Grasp, percept: &Percept) -> Option<PosePath> {
        self.motion.rehearsed_approach(&self.protocol.limits, grasp, percept, stops)
    }

    /// Rise of the palm before it goes anywhere else, m: fingers that touch an object leave it upwards.
    fn rise(&self) -> f64 {
        if self.has_touched() { palpation::RISE } else { 0.0 }
    }

    /// The ways in which the arm can touch `object` of this `shape` where it is seen, the usual one first.
    pub fn rehearsed_touches(&self, object: usize, shape: &Shape) -> impl Iterator<Item = Touching> {
        let (motion, limits, Target { grasp, percept }) = (&self.motion, &self.protocol.limits, self.target(object));
        let onto = palpation::touches(motion.hand(), grasp.yaw + percept.yaw, (shape, percept)).into_iter();
        onto.filter_map(move |onto| {
            let there = onto.start();
            let way = motion.rehearsed(limits, |limits| [palpation::way(limits, &motion.end(), &there)])?;
            Some(Touching { way, onto })
        })
    }
}
