//! Noise: a constant execution error of the arm and a perception error of each object, drawn once per trial.
//!
//! The generator of a trial depends only on the seed, the combination and the trial. It does not depend on the thread,
//! the order of the trials or the condition, so that `blind` and `touch` meet the same errors.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::effects::{Effect, Effects};
use plant::draws::{gaussian_vector, truncated_gaussian};
use plant::{ArmDefects, ObjectInstance};
use world::layout::{Layout, MAX_OBJECTS, PlacementShift};

/// Standard deviations of the arm's constant execution error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExecutionNoise {
    /// Position, each axis, m.
    pub position_sigma: f64,
    /// Rotation, about each axis, rad.
    pub rotation_sigma: f64,
}

/// Standard deviations of the error of a detected pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerceptionNoise {
    /// Position, each of x and y, m.
    pub xy_sigma: f64,
    /// Height, m.
    pub z_sigma: f64,
    /// Rotation about the vertical, rad.
    pub yaw_sigma: f64,
}

/// Levels of execution and perception noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseLevels {
    /// Execution noise of the arm.
    pub execution: ExecutionNoise,
    /// Perception noise of each object.
    pub perception: PerceptionNoise,
}

impl NoiseLevels {
    /// Returns the levels with all standard deviations multiplied by `factor`.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        let Self { execution, perception } = self;
        Self {
            execution: ExecutionNoise {
                position_sigma: factor * execution.position_sigma,
                rotation_sigma: factor * execution.rotation_sigma,
            },
            perception: PerceptionNoise {
                xy_sigma: factor * perception.xy_sigma,
                z_sigma: factor * perception.z_sigma,
                yaw_sigma: factor * perception.yaw_sigma,
            },
        }
    }
}

/// Wrong resting pose in which the detector reports an object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WrongRestingPose {
    /// Orientation reported instead of the true one.
    pub rotation: UnitQuaternion<f64>,
    /// Height of the object's centre in the reported resting pose less that in the true one, m.
    pub rise: f64,
}

/// Perception error of one object: detected minus true pose.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ObjectNoise {
    /// Position error in world axes, m.
    pub offset: Vector3<f64>,
    /// Rotation about the world's z axis through the object's origin, rad.
    pub yaw: f64,
    /// Rotation vector of the tilt about the world's x and y axes through the object's origin, rad.
    pub tilt: Vector2<f64>,
    /// Resting pose that is wrongly reported, if any.
    pub mistaken: Option<WrongRestingPose>,
}

impl ObjectNoise {
    /// Returns the detected pose, `world_from_object`, given the true one.
    pub fn perceived_pose(&self, world_from_object: &Isometry3<f64>) -> Isometry3<f64> {
        let mut position = world_from_object.translation.vector + self.offset;
        let mut rotation = world_from_object.rotation;
        if let Some(mistaken) = &self.mistaken {
            position.z += mistaken.rise;
            rotation = mistaken.rotation;
        }
        rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.yaw) * rotation;
        if self.tilt != Vector2::zeros() {
            rotation = UnitQuaternion::from_scaled_axis(self.tilt.push(0.0)) * rotation;
        }
        Isometry3::from_parts(Translation3::from(position), rotation)
    }
}

/// Random part of one trial: errors of the arm and of perception, and the true places and properties of the objects.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrialNoise {
    /// Position error of the palm, added to its commanded position, world axes, m.
    pub position: Vector3<f64>,
    /// Rotation error of the palm: rotation vector about the palm's origin, world axes, rad.
    pub rotation: Vector3<f64>,
    /// Perception error of each object, in the order in which they are picked.
    pub objects: [ObjectNoise; MAX_OBJECTS],
    /// Shift of each object from the place for which the plan was made. It is not an error: the detector reports it.
    pub shifts: [PlacementShift; MAX_OBJECTS],
    /// Defects of the arm, which replace the constant error.
    pub arm: ArmDefects,
    /// True mass, friction and size of the objects relative to their models.
    #[serde(alias = "individuals")]
    pub object_instances: [ObjectInstance; MAX_OBJECTS],
}

impl TrialNoise {
    /// Returns no errors: the condition `ideal`.
    pub fn none() -> Self {
        Self {
            position: Vector3::zeros(),
            rotation: Vector3::zeros(),
            objects: [ObjectNoise::default(); MAX_OBJECTS],
            shifts: [PlacementShift::default(); MAX_OBJECTS],
            arm: ArmDefects::default(),
            object_instances: [ObjectInstance::NOMINAL; MAX_OBJECTS],
        }
    }

    /// Draws the errors of a trial of `count` objects: Gaussian, truncated at three standard deviations. The objects
    /// stand in their nominal places.
    pub fn draw(levels: &NoiseLevels, count: usize, rng: &mut ChaCha8Rng) -> Self {
        let NoiseLevels { execution, perception } = levels;
        let position = gaussian_vector(rng, execution.position_sigma);
        let rotation = gaussian_vector(rng, execution.rotation_sigma);
        let mut objects = [ObjectNoise::default(); MAX_OBJECTS];
        for object in &mut objects[..count] {
            let [x, y] = [(); 2].map(|()| truncated_gaussian(rng) * perception.xy_sigma);
            let z = truncated_gaussian(rng) * perception.z_sigma;
            let yaw = truncated_gaussian(rng) * perception.yaw_sigma;
            *object = ObjectNoise { offset: Vector3::new(x, y, z), yaw, ..ObjectNoise::default() };
        }
        Self { position, rotation, objects, ..Self::none() }
    }

    /// Returns the noise with the draws of the effects `arm` and `objects` for this trial. The arm's errors replace the
    /// constant one.
    #[must_use]
    pub fn with_effects(mut self, effects: &Effects, seed: u64, combination: usize, trial: usize) -> Self {
        if let Some(errors) = &effects.arm {
            (self.position, self.rotation) = (Vector3::zeros(), Vector3::zeros());
            self.arm = errors.draw(&mut Effect::Arm.draw_rng(seed, combination, trial));
        }
        if let Some(spread) = &effects.objects {
            let mut rng = Effect::Objects.draw_rng(seed, combination, trial);
            self.object_instances = [(); MAX_OBJECTS].map(|()| spread.draw(&mut rng));
        }
        self
    }

    /// Returns the same errors with the first and the second object exchanged.
    #[must_use]
    pub fn with_swapped_objects(mut self) -> Self {
        self.objects.swap(0, 1);
        self.shifts.swap(0, 1);
        self.object_instances.swap(0, 1);
        self
    }

    /// Returns the palm pose that results from the command `world_from_palm`.
    pub fn executed_pose(&self, world_from_palm: &Isometry3<f64>) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::from(world_from_palm.translation.vector + self.position),
            UnitQuaternion::from_scaled_axis(self.rotation) * world_from_palm.rotation,
        )
    }
}

/// Draws uniformly from (0, 1), with 53 bits.
pub(crate) fn uniform(rng: &mut ChaCha8Rng) -> f64 {
    ((rng.next_u64() >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
}

/// Draws the offsets of the `count` objects of one trial from their nominal places: uniform within the layout's limits.
/// Draws nothing from `rng` if these are 0.
pub fn draw_shifts(layout: &Layout, count: usize, rng: &mut ChaCha8Rng) -> [PlacementShift; MAX_OBJECTS] {
    let Layout { spread_xy, spread_yaw, .. } = *layout;
    if spread_xy == 0.0 && spread_yaw == 0.0 {
        return [PlacementShift::default(); MAX_OBJECTS];
    }
    let mut even = |spread: f64| spread * (2.0 * uniform(rng) - 1.0);
    let mut shifts = [PlacementShift::default(); MAX_OBJECTS];
    for shift in &mut shifts[..count] {
        *shift = PlacementShift { x: even(spread_xy), y: even(spread_xy), yaw: even(spread_yaw) };
    }
    shifts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generator::trial_rng;

    fn levels() -> NoiseLevels {
        NoiseLevels {
            execution: ExecutionNoise { position_sigma: 0.004, rotation_sigma: 0.02 },
            perception: PerceptionNoise { xy_sigma: 0.004, z_sigma: 0.002, yaw_sigma: 0.05 },
        }
    }

    #[test]
    fn a_trial_has_the_same_bits_on_every_thread() {
        let draw = || TrialNoise::draw(&levels(), 2, &mut trial_rng(7, 3, 5));
        let elsewhere = std::thread::spawn(draw).join().unwrap();
        assert_eq!(draw(), elsewhere);
    }

    #[test]
    fn trials_differ() {
        let mut seen = std::collections::HashSet::new();
        for seed in 0..3 {
            for combination in 0..20 {
                for trial in 0..20 {
                    assert!(seen.insert(trial_rng(seed, combination, trial).next_u64()));
                }
            }
        }
    }

    #[test]
    fn deviations_are_as_asked() {
        let xs: Vec<f64> =
            (0..4000).map(|n| TrialNoise::draw(&levels(), 2, &mut trial_rng(1, n, 0)).position.x).collect();
        let mean = xs.iter().sum::<f64>() / xs.len() as f64;
        let sd = (xs.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / xs.len() as f64).sqrt();
        assert!(mean.abs() < 3e-4 && (sd - 0.004).abs() < 2e-4, "{mean} {sd}");
        assert!(xs.iter().all(|x| x.abs() <= 0.012));
    }

    #[test]
    fn no_spread_draws_nothing() {
        let layout = Layout { spread_xy: 0.0, spread_yaw: 0.0, ..crate::Scenario::benchmark().layout };
        let (mut used, mut fresh) = (trial_rng(1, 2, 3), trial_rng(1, 2, 3));
        assert_eq!(draw_shifts(&layout, 2, &mut used), [PlacementShift::default(); MAX_OBJECTS]);
        assert_eq!(uniform(&mut used), uniform(&mut fresh));
        assert_eq!(layout.first.shifted(&PlacementShift::default()), layout.first);
    }

    #[test]
    fn a_spread_moves_objects_on_the_table() {
        let layout = Layout { spread_xy: 0.01, spread_yaw: 0.5, ..crate::Scenario::benchmark().layout };
        let set = world::ObjectSet::standard();
        let mut farthest = [0.0_f64; 3];
        for trial in 0..200 {
            let shifts = draw_shifts(&layout, 2, &mut trial_rng(3, 0, trial));
            assert_ne!(shifts[0], shifts[1]);
            for (shift, object) in shifts.iter().zip(set.iter()) {
                let pose = layout.first.shifted(shift).pose(object);
                assert!((pose.translation.z + object.shape.lowest_height(&pose.rotation)).abs() < 1e-9);
                assert!((pose.translation.x - layout.first.x - shift.x).abs() < 1e-12);
                for (most, moved) in farthest.iter_mut().zip([shift.x, shift.y, shift.yaw]) {
                    *most = most.max(moved.abs());
                }
            }
        }
        // The largest of 400 uniform draws is within a few per cent of the limit.
        for (most, spread) in farthest.into_iter().zip([0.01, 0.01, 0.5]) {
            assert!(most <= spread && most > 0.95 * spread, "{most} of {spread}");
        }
    }
}
