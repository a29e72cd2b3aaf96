//! A landscape whose minima and barriers are known exactly: W1(x) + W2(y) with W(t) = h (t2 - 1)2 + c (t - t3 / 3).
//!
//! W' = (t2 - 1)(4 h t - c): minima at -1 and 1 with energies -2 c / 3 and 2 c / 3, the saddle between them at c / 4 h.
//! So there are four minima, and the lowest path between two of them follows one coordinate after the other.

use dexterous_grasping::synthesis::langevin::Langevin;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::Landscape;

/// Noise width at step size 1, small enough not to jump over a saddle.
const NOISE_WIDTH: f64 = 0.1;

/// Double well of one coordinate.
#[derive(Debug, Clone, Copy)]
struct Well {
    height: f64,
    tilt: f64,
}

impl Well {
    fn energy(&self, t: f64) -> f64 {
        self.height * (t * t - 1.0).powi(2) + self.tilt * (t - t * t * t / 3.0)
    }

    fn slope(&self, t: f64) -> f64 {
        (t * t - 1.0) * (4.0 * self.height * t - self.tilt)
    }

    fn saddle_energy(&self) -> f64 {
        self.energy(self.tilt / (4.0 * self.height))
    }
}

/// Four wells in the plane.
#[derive(Debug, Clone, Copy)]
pub struct MultiWell {
    wells: [Well; 2],
}

impl MultiWell {
    /// Returns wells with saddles of different heights and minima of different depths.
    pub fn uneven() -> Self {
        Self { wells: [Well { height: 1.0, tilt: 0.3 }, Well { height: 1.6, tilt: -0.45 }] }
    }

    /// Returns the four minima.
    pub fn minima(&self) -> [[f64; 2]; 4] {
        [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
    }

    /// Returns the exact energy of the saddle between two minima, or the minimum's own energy if they are the same.
    pub fn barrier(&self, a: [f64; 2], b: [f64; 2]) -> f64 {
        // Paths along one coordinate, or along both in either order. The barrier is the lowest of their highest points.
        let [x, y] = self.wells;
        let along_x = |fixed: f64| x.saddle_energy() + y.energy(fixed);
        let along_y = |fixed: f64| y.saddle_energy() + x.energy(fixed);
        match (a[0] != b[0], a[1] != b[1]) {
            (false, false) => self.energy(&a),
            (true, false) => along_x(a[1]).min(along_y(a[0]).max(along_x(-a[1])).max(along_y(b[0]))),
            (false, true) => along_y(a[0]).min(along_x(a[1]).max(along_y(-a[0])).max(along_x(b[1]))),
            (true, true) => (along_x(a[1]).max(along_y(b[0]))).min(along_y(a[0]).max(along_x(b[1]))),
        }
    }

    /// Descends the gradient from `start` to the minimum below it.
    pub fn descend(&self, start: [f64; 2]) -> [f64; 2] {
        let mut at = start;
        for _ in 0..4000 {
            at = [0, 1].map(|n| at[n] - 0.02 * self.wells[n].slope(at[n]).clamp(-5.0, 5.0));
        }
        at
    }

    fn slope(&self, at: &[f64; 2]) -> [f64; 2] {
        [self.wells[0].slope(at[0]), self.wells[1].slope(at[1])]
    }
}

/// Returns the energy with the pull, and its gradient.
fn pulled(wells: &MultiWell, at: &[f64; 2], target: &[f64; 2], pull: f64) -> (f64, [f64; 2]) {
    let distance = wells.distance(at, target).max(1e-9);
    let slope = wells.slope(at);
    let gradient = [0, 1].map(|n| slope[n] + pull * (at[n] - target[n]) / distance);
    (wells.energy(at) + pull * distance, gradient)
}

impl Landscape for MultiWell {
    type State = [f64; 2];
    type Walker = [f64; 2];

    fn start_chain(&self, state: &[f64; 2]) -> [f64; 2] {
        *state
    }

    fn step(
        &self,
        walker: &mut [f64; 2],
        target: &[f64; 2],
        pull: f64,
        temperature: f64,
        rng: &mut ChaCha8Rng,
    ) -> (f64, f64) {
        let kernel = Langevin::new(0.4, &[NOISE_WIDTH, NOISE_WIDTH], temperature);
        let (before, slope) = pulled(self, walker, target, pull);
        let mut by = [0.0; 2];
        kernel.propose(&slope, temperature, rng, &mut by);
        let next = [walker[0] + by[0], walker[1] + by[1]];
        let (after, there) = pulled(self, &next, target, pull);
        if rng.random::<f64>().ln() < kernel.log_ratio((before, &slope), (after, &there), &by, temperature) {
            *walker = next;
        }
        (self.energy(walker), self.distance(walker, target))
    }

    fn energy(&self, state: &[f64; 2]) -> f64 {
        self.wells[0].energy(state[0]) + self.wells[1].energy(state[1])
    }

    fn distance(&self, a: &[f64; 2], b: &[f64; 2]) -> f64 {
        (a[0] - b[0]).hypot(a[1] - b[1])
    }
}

/// Returns minima found from `count` random points in the square from -1.8 to 1.8.
pub fn samples(wells: &MultiWell, count: usize, rng: &mut ChaCha8Rng) -> Vec<[f64; 2]> {
    (0..count)
        .map(|_| {
            let start = [rng.random_range(-1.8..1.8), rng.random_range(-1.8..1.8)];
            // Slightly off the exact minimum, like a sampled one.
            wells.descend(start).map(|t| t + 0.01 * rng.sample::<f64, _>(StandardNormal))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn the_four_minima_are_minima() {
        let wells = MultiWell::uneven();
        for at in wells.minima() {
            assert!(wells.slope(&at).iter().all(|slope| slope.abs() < 1e-12));
            let around = [[0.01, 0.0], [-0.01, 0.0], [0.0, 0.01], [0.0, -0.01]];
            assert!(around.iter().all(|d| wells.energy(&[at[0] + d[0], at[1] + d[1]]) > wells.energy(&at)));
        }
    }

    /// The exact barriers are the minimax energies of a fine grid.
    #[test]
    fn barriers_are_those_of_a_grid() {
        let wells = MultiWell::uneven();
        let (n, at) = (161usize, |k: usize| -1.6 + 3.2 * k as f64 / 160.0);
        let energy = |cell: usize| wells.energy(&[at(cell % n), at(cell / n)]);
        let cell = |p: [f64; 2]| {
            let near = |t: f64| ((t + 1.6) / 3.2 * 160.0).round() as usize;
            near(p[1]) * n + near(p[0])
        };
        // Flood from the lowest cell up. Two minima meet at their barrier.
        let mut order: Vec<usize> = (0..n * n).collect();
        order.sort_by(|a, b| energy(*a).total_cmp(&energy(*b)));
        let [a, b, ..] = wells.minima();
        for (from, to) in wells.minima().into_iter().flat_map(|from| wells.minima().map(|to| (from, to))) {
            let mut group: Vec<usize> = (0..n * n).collect();
            let mut wet = vec![false; n * n];
            fn root(group: &mut [usize], mut x: usize) -> usize {
                while group[x] != x {
                    group[x] = group[group[x]];
                    x = group[x];
                }
                x
            }
            let mut met = f64::INFINITY;
            for &next in &order {
                wet[next] = true;
                let (x, y) = (next % n, next / n);
                for other in [
                    (x > 0).then(|| next - 1),
                    (x + 1 < n).then(|| next + 1),
                    (y > 0).then(|| next - n),
                    (y + 1 < n).then(|| next + n),
                ] {
                    if let Some(other) = other.filter(|other| wet[*other]) {
                        let (p, q) = (root(&mut group, next), root(&mut group, other));
                        group[p] = q;
                    }
                }
                if wet[cell(from)] && wet[cell(to)] && root(&mut group, cell(from)) == root(&mut group, cell(to)) {
                    met = energy(next);
                    break;
                }
            }
            assert!((met - wells.barrier(from, to)).abs() < 2e-3, "{from:?} {to:?}: {met}");
        }
        assert!(wells.barrier(a, b) > wells.energy(&a));
    }

    #[test]
    fn samples_are_near_minima() {
        let wells = MultiWell::uneven();
        for found in samples(&wells, 50, &mut ChaCha8Rng::seed_from_u64(1)) {
            assert!(wells.minima().iter().any(|minimum| wells.distance(&found, minimum) < 0.08));
        }
    }
}
