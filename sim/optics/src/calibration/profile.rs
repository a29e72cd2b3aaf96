//! The gel around a ball: the elastomer's smoothing in one dimension, possible because a ball's press is rotationally
//! symmetric.
//!
//! The passes are those of [`Elastomer::deform`](crate::elastomer::Elastomer::deform), but with true Gaussians on rings:
//! smoothing a rotationally symmetric function with a Gaussian of deviation sigma weights ring s by `s exp(-(r^2 + s^2) /
//! 2 sigma^2) I0(r s / sigma^2)`. The result is smooth in every kernel's width, which the fit needs.

use nalgebra::DMatrix;

/// Smoothing of rotationally symmetric functions, one matrix per kernel.
#[derive(Debug, Clone)]
pub(crate) struct RoundSmoothing {
    step: f64,
    passes: Vec<DMatrix<f64>>,
}

impl RoundSmoothing {
    /// Computes the matrices for radii up to `reach` (m), in steps of `step` (m).
    pub(crate) fn new(kernels: &[f64], reach: f64, step: f64) -> Self {
        let n = (reach / step).ceil() as usize + 1;
        let ring = |j: usize| if j == 0 { 0.125 } else { j as f64 };
        let pass = |&sigma: &f64| {
            let sigma = (sigma / step).max(1e-3);
            let square = sigma * sigma;
            let mut matrix = DMatrix::from_fn(n, n, |i, j| {
                let (r, s) = (i as f64, j as f64);
                let off = (r - s) / sigma;
                if off.abs() > 6.0 { 0.0 } else { ring(j) * (-0.5 * off * off).exp() * i0_scaled(r * s / square) }
            });
            for mut row in matrix.row_iter_mut() {
                let sum = row.sum();
                row /= sum;
            }
            matrix
        };
        Self { step, passes: kernels.iter().map(pass).collect() }
    }

    /// Computes the gel's profile under a ball of `radius` (m) with the contact radius `contact` (m).
    pub(crate) fn press(&self, radius: f64, contact: f64) -> BallProfile {
        let contact = contact.min(0.999 * radius);
        let rim = (radius * radius - contact * contact).sqrt();
        let n = self.passes.first().map_or(0, |pass| pass.nrows());
        let own: Vec<f64> = (0..n)
            .map(|i| i as f64 * self.step)
            .map(|r| if r < contact { (radius * radius - r * r).sqrt() - rim } else { 0.0 })
            .collect();
        let mut depth = nalgebra::DVector::from_column_slice(&own);
        for pass in &self.passes {
            depth = pass * depth;
            depth.iter_mut().zip(&own).for_each(|(depth, own)| *depth = depth.max(*own));
        }
        BallProfile::new(self.step, depth.as_slice().to_vec())
    }
}

/// Fraction of the greatest depth below which a bump casts no shadow.
const SHALLOW_SHARE: f64 = 0.02;

/// Depth of the gel (m) as a function of the distance from a press's centre.
#[derive(Debug, Clone)]
pub(crate) struct BallProfile {
    step: f64,
    depth: Vec<f64>,
    slope: Vec<f64>,
    reach: f64,
}

impl BallProfile {
    fn new(step: f64, depth: Vec<f64>) -> Self {
        let n = depth.len();
        let slope = (0..n)
            .map(|i| if i == 0 || i + 1 == n { 0.0 } else { (depth[i + 1] - depth[i - 1]) / (2.0 * step) })
            .collect();
        let notable = SHALLOW_SHARE * depth.first().copied().unwrap_or(0.0);
        let last = depth.iter().rposition(|&depth| depth > notable).unwrap_or(0);
        Self { step, depth, slope, reach: last as f64 * step }
    }

    /// Returns the distance (m) beyond which the bump casts no notable shadow.
    pub(crate) fn reach(&self) -> f64 {
        self.reach
    }

    /// Interpolates the depth (m) and its derivative at distance `r` (m).
    #[inline]
    pub(crate) fn depth_and_slope(&self, r: f64) -> (f64, f64) {
        let place = r / self.step;
        let cell = place as usize;
        if cell + 1 >= self.depth.len() {
            return (0.0, 0.0);
        }
        let part = place - cell as f64;
        let mix = |table: &[f64]| table[cell] + part * (table[cell + 1] - table[cell]);
        (mix(&self.depth), mix(&self.slope))
    }
}

/// Computes `I0(x) exp(-x)`, the modified Bessel function, to 2e-7, by the polynomials of Abramowitz and Stegun, 9.8.1
/// and 9.8.2.
fn i0_scaled(x: f64) -> f64 {
    let polynomial = |t: f64, c: &[f64]| c.iter().rev().fold(0.0, |sum, c| sum * t + c);
    if x < 3.75 {
        let c = [1.0, 3.5156229, 3.0899424, 1.2067492, 0.2659732, 0.0360768, 0.0045813];
        polynomial((x / 3.75).powi(2), &c) * (-x).exp()
    } else {
        let c = [
            0.39894228,
            0.01328592,
            0.00225319,
            -0.00157565,
            0.00916281,
            -0.02057706,
            0.02635537,
            -0.01647633,
            0.00392377,
        ];
        polynomial(3.75 / x, &c) / x.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bessel_by_its_integral() {
        // I0(x) = 1/pi int_0^pi exp(x cos t) dt
        for x in [0.0f64, 0.3, 2.0, 3.74, 3.76, 9.0, 60.0] {
            let n = 20_000;
            let sum: f64 = (0..n)
                .map(|i| (x * ((f64::from(i) + 0.5) / f64::from(n) * std::f64::consts::PI).cos() - x).exp())
                .sum();
            assert!((i0_scaled(x) - sum / f64::from(n)).abs() < 1e-6, "{x}");
        }
    }

    #[test]
    fn the_gel_lies_on_the_ball_and_decays_beyond_it() {
        let (ball, contact) = (2e-3, 1.2e-3);
        let profile = RoundSmoothing::new(&[0.8e-3, 0.4e-3, 0.2e-3], 6e-3, 0.02e-3).press(ball, contact);
        let rim = f64::sqrt(ball * ball - contact * contact);
        let mut last = f64::INFINITY;
        for i in 0..250 {
            let r = f64::from(i) * 0.02e-3;
            let (depth, slope) = profile.depth_and_slope(r);
            let own = if r < contact { (ball * ball - r * r).sqrt() - rim } else { 0.0 };
            assert!(depth >= own - 1e-9 && depth <= last + 1e-9 && slope <= 1e-3, "{r}: {depth} {own} {slope}");
            last = depth;
        }
        assert!((profile.depth_and_slope(0.0).0 - (ball - rim)).abs() < 1e-9);
        assert!(profile.depth_and_slope(4e-3).0 < 0.02 * (ball - rim));
    }

    #[test]
    fn one_gaussian_of_a_gaussian_is_a_wider_gaussian() {
        let smoothing = RoundSmoothing::new(&[0.3e-3], 4e-3, 0.02e-3);
        let gaussian = |r: f64, sigma: f64| (-0.5 * (r / sigma).powi(2)).exp();
        let n = smoothing.passes[0].nrows();
        let narrow = nalgebra::DVector::from_fn(n, |i, _| gaussian(i as f64 * 0.02e-3, 0.4e-3));
        let wide = &smoothing.passes[0] * narrow;
        for i in 0..80 {
            // Deviations add as squares; the peak sinks by the ratio of the squares, in two dimensions.
            let exact = 0.16 / 0.25 * gaussian(f64::from(i) * 0.02e-3, 0.5e-3);
            assert!((wide[i as usize] - exact).abs() < 2e-3, "{i}: {} {exact}", wide[i as usize]);
        }
    }
}
