//! Seeded random generator of a trial.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Returns the random generator of one trial.
pub fn trial_rng(seed: u64, combination: usize, trial: usize) -> ChaCha8Rng {
    let mut state = seed;
    for id in [combination as u64, trial as u64] {
        state = split_mix(state ^ split_mix(id.wrapping_add(0x5851_f42d_4c95_7f2d)));
    }
    ChaCha8Rng::seed_from_u64(state)
}

/// Performs one step of SplitMix64: a bijection that scatters neighbouring numbers.
pub(crate) fn split_mix(state: u64) -> u64 {
    let mut z = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
