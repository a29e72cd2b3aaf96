//! Draws of arms and objects.

use nalgebra::Vector3;

use super::*;
use crate::generator::trial_rng;
use crate::noise::{NoiseLevels, TrialNoise};
use crate::scenario::Scenario;

/// Fraction of a normal distribution's variance that remains after truncation at three standard deviations.
const TRUNCATED_VARIANCE: f64 = 0.9733;
const TRIALS: usize = 4000;

fn drawn(levels: &NoiseLevels, trial: usize) -> TrialNoise {
    static EFFECTS: std::sync::LazyLock<Effects> = std::sync::LazyLock::new(|| Scenario::benchmark().effects);
    TrialNoise::draw(levels, 2, &mut trial_rng(5, 0, trial)).with_effects(&EFFECTS, 5, 0, trial)
}

/// Mean square deviation of `value` from `mean` over many trials, relative to that of a truncated normal distribution
/// with `sigma`.
fn spread(sigma: f64, mean: f64, value: impl Fn(&TrialNoise) -> f64) -> f64 {
    let levels = Scenario::benchmark().noise;
    let square = |trial| (value(&drawn(&levels, trial)) - mean).powi(2);
    (0..TRIALS).map(square).sum::<f64>() / (TRIALS as f64 * TRUNCATED_VARIANCE * sigma * sigma)
}

/// The standard error of a variance from 4000 draws is 2.2 %.
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
        spread(objects.mass_sigma, 1.0, |noise| noise.object_instances[0].mass),
        spread(objects.friction_sigma, 1.0, |noise| noise.object_instances[1].friction),
        spread(objects.size_sigma, 1.0, |noise| noise.object_instances[1].size),
    ];
    assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.09), "{ratios:?}");
}

#[test]
fn an_arm_that_errs_by_its_joints_has_no_constant_error() {
    let noise = drawn(&Scenario::benchmark().noise, 0);
    assert!(noise.position == Vector3::zeros() && noise.rotation == Vector3::zeros() && noise.arm.payload > 0.0);
    let posture = [0.3; 7];
    let back = noise.arm.encoder_readings(&noise.arm.true_angles(&posture));
    assert!(back.iter().zip(posture).all(|(back, angle)| (back - angle).abs() < 1e-15));
}

/// Switching an effect off leaves the draws of everything else bit-identical.
#[test]
fn an_effect_off_changes_nothing_else() {
    let (scenario, all) = (Scenario::benchmark(), drawn(&Scenario::benchmark().noise, 7));
    let plain = TrialNoise::draw(&scenario.noise, 2, &mut trial_rng(5, 0, 7));
    let without = |effect| plain.with_effects(&scenario.effects.without(effect), 5, 0, 7);
    let no_arm = without(Effect::Arm);
    assert_eq!((no_arm.object_instances, no_arm.position), (all.object_instances, plain.position));
    let no_objects = without(Effect::Objects);
    assert_eq!(
        (no_objects.arm, no_objects.object_instances),
        (all.arm, [ObjectInstance::NOMINAL; world::layout::MAX_OBJECTS])
    );
}
