//! Search for a placement and commands that hold. A few lineages are each improved by steps from their best attempt,
//! and fresh proposals replace the worst lineage if they are better. Lineages that have not led to a hold for some time
//! seldom do (most types are held within that time, or take many times as long); then all of them restart.

use std::cmp::Ordering;
use std::sync::Arc;

use hand_model::{Hand, HandVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::aim::propose;
use super::attempt::{GraspAttempt, vary};
use super::free_postures::FreePostureTable;
use super::trial::{self, AttemptResult, MAX_START_PENETRATION};
use super::types::GraspType;

const LINEAGES_KEPT: usize = 4;
/// Number of attempts after which the search restarts.
const RESTART_INTERVAL: usize = 100;
/// Interval of fresh proposals, attempts.
const FRESH_PROPOSAL_INTERVAL: usize = 4;
/// Maximum number of draws until a proposal's object does not start inside the hand.
const MAX_DRAWS: usize = 24;
/// Range of step sizes, in units of the usual one, and factors on success and on failure.
const STEP_RANGE: (f64, f64) = (0.15, 1.6);
const STEP_GROWTH: f64 = 1.6;
const STEP_SHRINKAGE: f64 = 0.9;

/// A lineage: its best attempt, the result, and the size of the next step.
struct Lineage {
    attempt: GraspAttempt,
    trial: AttemptResult,
    step: f64,
}

impl Lineage {
    /// Orders held attempts first, then by cost.
    fn order(&self, other: &Self) -> Ordering {
        other.trial.held().cmp(&self.trial.held()).then(self.trial.cost.total_cmp(&other.trial.cost))
    }
}

/// Result of a search.
pub struct SearchResult {
    /// Number of attempts made.
    pub tries: usize,
    /// First attempt that holds, or the best one.
    pub attempt: GraspAttempt,
    /// Result of that attempt.
    pub trial: AttemptResult,
}

/// Makes at most `tries` attempts. Returns `None` if `tries` is 0.
pub fn run(
    hand: &Arc<Hand>,
    curls: &FreePostureTable,
    kind: &GraspType,
    seed: u64,
    tries: usize,
) -> Option<SearchResult> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(kind.number as u64);
    let mut kept: Vec<Lineage> = Vec::new();
    let mut best: Option<Lineage> = None;
    let mut made = 0;
    while made < tries && !kept.first().is_some_and(|first| first.trial.held()) {
        if made % RESTART_INTERVAL == 0 {
            best = kept.drain(..).chain(best).min_by(Lineage::order);
        }
        if kept.len() < LINEAGES_KEPT || made % FRESH_PROPOSAL_INTERVAL == 0 {
            let attempt = draw_outside_hand(hand, curls, kind, &mut rng, |rng| propose(hand, curls, kind, rng));
            let enough = if kept.len() < LINEAGES_KEPT { f64::INFINITY } else { kept[LINEAGES_KEPT - 1].trial.cost };
            if let Some(trial) = trial::run(hand, kind, &attempt, enough) {
                kept.truncate(LINEAGES_KEPT - 1);
                kept.push(Lineage { attempt, trial, step: 1.0 });
            }
        } else {
            // Better lineages are chosen more often.
            let chosen = rng.random_range(0..LINEAGES_KEPT).min(rng.random_range(0..LINEAGES_KEPT));
            let parent = &mut kept[chosen];
            let attempt = draw_outside_hand(hand, curls, kind, &mut rng, |rng| vary(&parent.attempt, parent.step, rng));
            let better = trial::run(hand, kind, &attempt, parent.trial.cost);
            let factor = if better.is_some() { STEP_GROWTH } else { STEP_SHRINKAGE };
            parent.step = (parent.step * factor).clamp(STEP_RANGE.0, STEP_RANGE.1);
            if let Some(trial) = better {
                (parent.attempt, parent.trial) = (attempt, trial);
            }
        }
        kept.sort_by(Lineage::order);
        made += 1;
    }
    kept.into_iter().chain(best).min_by(Lineage::order).map(|best| SearchResult {
        tries: made,
        attempt: best.attempt,
        trial: best.trial,
    })
}

/// Draws a proposal whose object does not start inside the hand, or the last one drawn if there is none.
fn draw_outside_hand(
    hand: &Hand,
    curls: &FreePostureTable,
    kind: &GraspType,
    rng: &mut ChaCha8Rng,
    draw: impl Fn(&mut ChaCha8Rng) -> GraspAttempt,
) -> GraspAttempt {
    let mut attempt = draw(rng);
    for _ in 1..MAX_DRAWS {
        let angles: HandVector = curls.posture(hand, &attempt.before, attempt.opposition);
        if curls.penetration(&hand.tree.forward(&angles), &kind.prop, &attempt.place()) <= MAX_START_PENETRATION {
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

    /// The same seed finds the same attempts for any number of threads.
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
