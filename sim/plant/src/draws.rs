//! Samples from a normal distribution truncated at three standard deviations.

use nalgebra::Vector3;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Samples the standard normal distribution, truncated at three standard deviations.
pub fn truncated_gaussian(rng: &mut ChaCha8Rng) -> f64 {
    loop {
        let value: f64 = rng.sample(StandardNormal);
        if value.abs() <= 3.0 {
            return value;
        }
    }
}

/// Samples a vector of independent values of [`truncated_gaussian`], times `sigma`.
pub fn gaussian_vector(rng: &mut ChaCha8Rng, sigma: f64) -> Vector3<f64> {
    let [x, y, z] = [(); 3].map(|()| truncated_gaussian(rng) * sigma);
    Vector3::new(x, y, z)
}
