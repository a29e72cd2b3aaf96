//! Attraction and diffusion: a chain on E(x) + pull d(x, X*) either reaches X* or stops approaching it.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::Landscape;

/// Parameters of the chains.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AttractionSettings {
    /// Weight of the distance in the energy, energy over distance.
    pub pull: f64,
    /// Temperature, energy.
    pub temperature: f64,
    /// Distance within which a chain has arrived.
    pub near: f64,
    /// Number of steps without a new least distance after which a chain is abandoned.
    #[serde(alias = "patience")]
    pub max_idle_steps: usize,
    /// Number of chains in each direction.
    pub chains: usize,
}

/// Runs one chain from `from` to `to`. Returns the highest energy on its path, including both ends, or `None` if it
/// does not arrive.
pub fn attract<L: Landscape>(
    landscape: &L,
    from: &L::State,
    to: &L::State,
    settings: &AttractionSettings,
    rng: &mut ChaCha8Rng,
) -> Option<f64> {
    let mut walker = landscape.start_chain(from);
    let mut closest = landscape.distance(from, to);
    let mut barrier = landscape.energy(from).max(landscape.energy(to));
    let mut waited = 0;
    while closest > settings.near {
        let (energy, distance) = landscape.step(&mut walker, to, settings.pull, settings.temperature, rng);
        barrier = barrier.max(energy);
        if distance < closest {
            closest = distance;
            waited = 0;
        } else {
            waited += 1;
            if waited == settings.max_idle_steps {
                return None;
            }
        }
    }
    Some(barrier)
}

/// Returns a random generator for each pair of states, chain and direction, so that results do not depend on the order
/// of evaluation.
pub fn chain_rng(seed: u64, question: [u64; 4]) -> ChaCha8Rng {
    let mut key = [0u8; 32];
    for (n, word) in question.into_iter().enumerate() {
        key[8 * n..8 * n + 8].copy_from_slice(&word.to_le_bytes());
    }
    let mut rng = ChaCha8Rng::from_seed(key);
    rng.set_stream(seed);
    rng
}

/// Returns the lowest barrier of the chains that arrive, in both directions between two states.
pub fn lowest_barrier<L: Landscape>(
    landscape: &L,
    a: &L::State,
    b: &L::State,
    settings: &AttractionSettings,
    seed: u64,
    question: [u64; 2],
) -> Option<f64> {
    let mut lowest: Option<f64> = None;
    for chain in 0..settings.chains as u64 {
        for (way, (from, to)) in [(a, b), (b, a)].into_iter().enumerate() {
            let mut rng = chain_rng(seed, [question[0], question[1], chain, way as u64]);
            let found = attract(landscape, from, to, settings, &mut rng);
            lowest = found.into_iter().chain(lowest).min_by(f64::total_cmp);
        }
    }
    lowest
}

#[cfg(test)]
mod tests {
    use super::super::multi_well::MultiWell;
    use super::*;

    const SETTINGS: AttractionSettings =
        AttractionSettings { pull: 2.0, temperature: 0.05, near: 0.1, max_idle_steps: 200, chains: 4 };

    /// With a strong pull a chain crosses, and its barrier is at or slightly above the saddle's energy. With a weak
    /// pull it does not cross.
    #[test]
    fn crosses_when_pulled_and_only_then() {
        let wells = MultiWell::uneven();
        let [a, b] = [[-1.0, -1.0], [1.0, -1.0]];
        let exact = wells.barrier(a, b);
        let found = lowest_barrier(&wells, &a, &b, &SETTINGS, 1, [0, 0]).expect("arrives");
        assert!(found > exact - 0.03 && found < exact + 0.2, "{found} {exact}");
        let weak = AttractionSettings { pull: 0.2, ..SETTINGS };
        assert_eq!(lowest_barrier(&wells, &a, &b, &weak, 1, [0, 0]), None);
    }

    #[test]
    fn a_chain_that_starts_at_its_target_has_arrived() {
        let wells = MultiWell::uneven();
        let found = lowest_barrier(&wells, &[1.0, 1.0], &[1.0, 1.0], &SETTINGS, 1, [0, 0]);
        assert_eq!(found, Some(wells.energy(&[1.0, 1.0])));
    }
}
