//! Individuals: how one arm and one object differ from the models that a controller has of them, drawn once a trial; and how one
//! whole [`robot`] differs from its drawing, for as long as it lives. [`spread`] says what differs and by how much, [`file`](mod@file) keeps what
//! was identified of one.

pub mod file;
pub mod robot;
pub mod spread;

use std::sync::Arc;

use hand_model::ARM_JOINTS;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::effects::{ArmErrors, Individuals};
use crate::noise::{gaussian, vector};
use world::geometry::GeometryError;
use world::objects::ObjectModel;

/// How an arm differs from the one that its controller believes in.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ArmDefects {
    /// What each joint's encoder shows too much, rad: the joint really is at what is commanded less this.
    pub encoders: [f64; ARM_JOINTS],
    /// Where the hand really sits on its flange, seen from its nominal place there, m.
    pub mount_position: Vector3<f64>,
    /// Rotation vector of its turn, about the flange's origin, rad.
    pub mount_rotation: Vector3<f64>,
    /// Mass at the palm's origin of which gravity compensation knows nothing, kg.
    pub payload: f64,
}

impl ArmDefects {
    /// Draws an arm: Gaussians cut at three standard deviations; of the payload, which nobody takes away, the absolute value.
    pub fn draw(errors: &ArmErrors, rng: &mut ChaCha8Rng) -> Self {
        Self {
            encoders: [(); ARM_JOINTS].map(|()| gaussian(rng) * errors.encoder_sigma),
            mount_position: vector(rng, errors.mount_position_sigma),
            mount_rotation: vector(rng, errors.mount_rotation_sigma),
            payload: gaussian(rng).abs() * errors.payload_sigma,
        }
    }

    /// The hand on its flange, seen from where it nominally is.
    pub fn mount(&self) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(self.mount_rotation);
        Isometry3::from_parts(Translation3::from(self.mount_position), turn)
    }

    /// Angles of the joints whose encoders show `shown`, rad.
    pub fn real(&self, shown: &[f64; ARM_JOINTS]) -> [f64; ARM_JOINTS] {
        std::array::from_fn(|joint| shown[joint] - self.encoders[joint])
    }

    /// What the encoders show of joints at `real`, rad.
    pub fn shown(&self, real: &[f64; ARM_JOINTS]) -> [f64; ARM_JOINTS] {
        std::array::from_fn(|joint| real[joint] + self.encoders[joint])
    }
}

/// How an object differs from its model: factors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Individual {
    /// Of the mass, whatever the size is.
    pub mass: f64,
    /// Of the friction coefficient.
    pub friction: f64,
    /// Of the size along all axes.
    pub size: f64,
}

impl Individual {
    /// Just like its model.
    pub const AS_MODELLED: Self = Self { mass: 1.0, friction: 1.0, size: 1.0 };

    /// Draws one: Gaussians cut at three standard deviations.
    pub fn draw(spread: &Individuals, rng: &mut ChaCha8Rng) -> Self {
        let Individuals { mass_sigma, friction_sigma, size_sigma } = *spread;
        let [mass, friction, size] = [mass_sigma, friction_sigma, size_sigma].map(|sigma| 1.0 + gaussian(rng) * sigma);
        Self { mass, friction, size }
    }

    /// The object as it really is.
    pub fn of(&self, model: &Arc<ObjectModel>) -> Result<Arc<ObjectModel>, GeometryError> {
        if *self == Self::AS_MODELLED {
            return Ok(model.clone());
        }
        Ok(Arc::new(ObjectModel {
            shape: model.shape.scaled(self.size)?,
            mass: model.mass * self.mass,
            friction: model.friction * self.friction,
            ..(**model).clone()
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Effect, Effects};
    use crate::noise::{NoiseLevels, TrialNoise, trial_rng};
    use crate::scenario::Scenario;
    use world::objects::ObjectSet;

    /// Share of a normal distribution's variance that is left when it is cut at three standard deviations.
    const CUT: f64 = 0.9733;
    const TRIALS: usize = 4000;

    fn drawn(levels: &NoiseLevels, trial: usize) -> TrialNoise {
        static EFFECTS: std::sync::LazyLock<Effects> = std::sync::LazyLock::new(|| Scenario::benchmark().effects);
        TrialNoise::draw(levels, &mut trial_rng(5, 0, trial)).with_effects(&EFFECTS, 5, 0, trial)
    }

    /// Mean square of `value` over many trials, over that of a cut normal distribution about `mean`.
    fn spread(sigma: f64, mean: f64, value: impl Fn(&TrialNoise) -> f64) -> f64 {
        let levels = Scenario::benchmark().noise;
        let square = |trial| (value(&drawn(&levels, trial)) - mean).powi(2);
        (0..TRIALS).map(square).sum::<f64>() / (TRIALS as f64 * CUT * sigma * sigma)
    }

    /// The variance of 4000 draws is known to 2.2 %.
    #[test]
    fn spreads_are_as_asked() {
        let scenario = Scenario::benchmark();
        let (arm, objects) = (scenario.effects.arm.unwrap(), scenario.effects.objects.unwrap());
        let ratios = [
            spread(arm.encoder_sigma, 0.0, |noise| noise.arm.encoders[0]),
            spread(arm.encoder_sigma, 0.0, |noise| noise.arm.encoders[6]),
            spread(arm.mount_position_sigma, 0.0, |noise| noise.arm.mount_position.y),
            spread(arm.mount_rotation_sigma, 0.0, |noise| noise.arm.mount_rotation.z),
            spread(arm.payload_sigma, 0.0, |noise| noise.arm.payload),
            spread(objects.mass_sigma, 1.0, |noise| noise.individuals[0].mass),
            spread(objects.friction_sigma, 1.0, |noise| noise.individuals[1].friction),
            spread(objects.size_sigma, 1.0, |noise| noise.individuals[1].size),
        ];
        assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.09), "{ratios:?}");
    }

    #[test]
    fn an_arm_that_errs_by_its_joints_has_no_constant_error() {
        let noise = drawn(&Scenario::benchmark().noise, 0);
        assert!(noise.position == Vector3::zeros() && noise.rotation == Vector3::zeros() && noise.arm.payload > 0.0);
        let posture = [0.3; ARM_JOINTS];
        let back = noise.arm.shown(&noise.arm.real(&posture));
        assert!(back.iter().zip(posture).all(|(back, angle)| (back - angle).abs() < 1e-15));
    }

    /// With an effect off, the draws of everything else keep their bits.
    #[test]
    fn an_effect_off_changes_nothing_else() {
        let (scenario, all) = (Scenario::benchmark(), drawn(&Scenario::benchmark().noise, 7));
        let plain = TrialNoise::draw(&scenario.noise, &mut trial_rng(5, 0, 7));
        let without = |effect| plain.with_effects(&scenario.effects.without(effect), 5, 0, 7);
        let no_arm = without(Effect::Arm);
        assert_eq!((no_arm.individuals, no_arm.position), (all.individuals, plain.position));
        let no_objects = without(Effect::Objects);
        assert_eq!((no_objects.arm, no_objects.individuals), (all.arm, [Individual::AS_MODELLED; 2]));
    }

    #[test]
    fn an_individual_rests_on_the_table_with_its_own_size() {
        let other = Individual { mass: 1.1, friction: 0.8, size: 1.03 };
        for model in ObjectSet::standard().iter() {
            let real = other.of(model).unwrap();
            assert!((real.rest_height() / model.rest_height() - 1.03).abs() < 1e-6, "{}", model.name);
            assert!(
                (real.mass / model.mass - 1.1).abs() < 1e-12 && (real.friction / model.friction - 0.8).abs() < 1e-12
            );
            assert!(Arc::ptr_eq(&Individual::AS_MODELLED.of(model).unwrap(), model));
        }
    }
}
