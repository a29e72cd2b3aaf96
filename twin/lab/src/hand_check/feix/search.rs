//! The search for a placement and commands that hold: a few lineages, each improved by steps away from its best
//! attempt, beside fresh proposals that take the place of the worst lineage when they are better. Lineages that have
//! not led to a hold for some time seldom do (most types are held within that, or take many times as long): then all of
//! them begin anew.

use std::cmp::Ordering;
use std::sync::Arc;

use hand_model::{Hand, HandVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::aim::propose;
use super::attempt::{Attempt, vary};
use super::curl::Curls;
use super::trial::{self, BURIED, Trial};
use super::types::GraspType;

const KEPT: usize = 4;
/// Tries after which all begins anew.
const ANEW: usize = 100;
/// One try in so many is fresh.
const FRESH: usize = 4;
/// Proposals drawn at most until one's object does not start inside the hand.
const DRAWS: usize = 24;
/// Least and greatest step, in units of the usual one, and how it grows with success and shrinks with failure.
const STEPS: (f64, f64) = (0.15, 1.6);
const GROWS: f64 = 1.6;
const SHRINKS: f64 = 0.9;

/// An attempt, what came of it, and how far its next neighbour is.
struct Lineage {
    attempt: Attempt,
    trial: Trial,
    step: f64,
}

impl Lineage {
    /// What is held comes first, then what costs least.
    fn order(&self, other: &Self) -> Ordering {
        other.trial.held().cmp(&self.trial.held()).then(self.trial.cost.total_cmp(&other.trial.cost))
    }
}

/// What a search came to.
pub struct Found {
    /// Tries made.
    pub tries: usize,
    /// The first attempt that holds, or the best one.
    pub attempt: Attempt,
    /// What came of it.
    pub trial: Trial,
}

/// Makes `tries` attempts at most; nothing is found by none.
pub fn run(hand: &Arc<Hand>, curls: &Curls, kind: &GraspType, seed: u64, tries: usize) -> Option<Found> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(kind.number as u64);
    let mut kept: Vec<Lineage> = Vec::new();
    let mut best: Option<Lineage> = None;
    let mut made = 0;
    while made < tries && !kept.first().is_some_and(|first| first.trial.held()) {
        if made % ANEW == 0 {
            best = kept.drain(..).chain(best).min_by(Lineage::order);
        }
        if kept.len() < KEPT || made % FRESH == 0 {
            let attempt = outside(hand, curls, kind, &mut rng, |rng| propose(hand, curls, kind, rng));
            let enough = if kept.len() < KEPT { f64::INFINITY } else { kept[KEPT - 1].trial.cost };
            if let Some(trial) = trial::run(hand, kind, &attempt, enough) {
                kept.truncate(KEPT - 1);
                kept.push(Lineage { attempt, trial, step: 1.0 });
            }
        } else {
            // The better ones more often.
            let chosen = rng.random_range(0..KEPT).min(rng.random_range(0..KEPT));
            let parent = &mut kept[chosen];
            let attempt = outside(hand, curls, kind, &mut rng, |rng| vary(&parent.attempt, parent.step, rng));
            let better = trial::run(hand, kind, &attempt, parent.trial.cost);
            let factor = if better.is_some() { GROWS } else { SHRINKS };
            parent.step = (parent.step * factor).clamp(STEPS.0, STEPS.1);
            if let Some(trial) = better {
                (parent.attempt, parent.trial) = (attempt, trial);
            }
        }
        kept.sort_by(Lineage::order);
        made += 1;
    }
    kept.into_iter().chain(best).min_by(Lineage::order).map(|best| Found {
        tries: made,
        attempt: best.attempt,
        trial: best.trial,
    })
}

/// A proposal whose object does not start inside the hand, if one is drawn in time.
fn outside(
    hand: &Hand,
    curls: &Curls,
    kind: &GraspType,
    rng: &mut ChaCha8Rng,
    draw: impl Fn(&mut ChaCha8Rng) -> Attempt,
) -> Attempt {
    let mut attempt = draw(rng);
    for _ in 1..DRAWS {
        let angles: HandVector = curls.posture(hand, &attempt.before, attempt.opposition);
        if curls.buried(&hand.tree.forward(&angles), &kind.prop, &attempt.place()) <= BURIED {
            break;
        }
        attempt = draw(rng);
    }
    attempt
}

#[cfg(test)]
mod tests {
    use super::super::run;
    use super::*;

    /// The same seed finds the same attempts, however many threads look for them.
    #[test]
    fn threads_change_nothing() {
        let hand = Arc::new(Hand::ftac());
        let found = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let outcomes = pool.install(|| run(&hand, 3, 5, &[8, 23], || ()));
            let told = |outcome: &super::super::GraspTypeResult| {
                (outcome.tries, outcome.attempt.clone(), outcome.angles.clone())
            };
            serde_json::to_string(&outcomes.iter().map(told).collect::<Vec<_>>()).expect("text")
        };
        let (one, two) = (found(1), found(2));
        assert!(one.contains("tensions") && one == two, "{one} {two}");
    }
}
