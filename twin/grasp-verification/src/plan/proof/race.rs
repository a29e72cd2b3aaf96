//! A race (successive halving): many grasps of a second object meet few draws of the circumstances and few grasps meet
//! many. Variations of the best then race in turn.

use anyhow::{Context as _, Result};
use control::extent::Extent;
use control::odds::TryOutcome;
use control::worth::MISSED;
use dexterous_grasping::sampler::vary;
use dexterous_grasping::{Grasp, Repertoire, digit_sets};
use hand_model::parameters::Handedness;
use nalgebra::Isometry3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sha2::{Digest as _, Sha256};
use sim::tactile::TactileBoard;

use super::{Effort, Hold, Proof, Proven};
use crate::plan::Plan;
use crate::plan::outcomes::{letter, worth};
use crate::proposals::{Proposals, carried};
use crate::rehearsal::circumstances::{Errors, circumstances, hold};
use crate::rehearsal::{Snapshot, misaimed, rehearse_last, try_second, wide_errors};
use crate::simulated_world::World;

/// Largest additional roll, rad.
const ROLL: f64 = 0.75;
/// Heats before the last one, which has all draws. Each is (draws that a grasp has met after it, grasps that go on).
pub(super) const HEATS: [(usize, usize); 3] = [(1, 24), (3, 12), (8, 6)];
/// Heats of the variations of a round, likewise.
pub(super) const VARIED: [(usize, usize); 3] = [(1, 10), (3, 5), (8, 3)];
/// Number of grasps that a round starts from.
pub(super) const PARENTS: usize = 3;
/// Number of grasps that have held under all draws after which no further round is played.
const ENOUGH: usize = 3;
/// Number of grasps that are kept.
const KEPT: usize = 4;
/// First number of the grasps that are found.
pub(super) const FIRST_NUMBER: u32 = 2_000_000;
/// Offset of the numbers of grasps found after another first grasp.
pub(super) const ANOTHER: u32 = 100_000;
/// Number of draws in which other first grasps are compared.
const GLANCE: usize = 6;

/// A grasp with its outcomes under the draws so far, one letter each.
#[derive(Clone)]
pub(super) struct Entrant {
    pub grasp: Grasp,
    tried: String,
}

impl Entrant {
    pub fn new(grasp: Grasp) -> Self {
        Self { grasp, tried: String::new() }
    }

    /// Returns the mean worth of a try.
    pub fn worth(&self) -> f64 {
        worth(self.tried.chars()) / self.tried.len().max(1) as f64
    }

    fn held(&self, draw: usize) -> bool {
        self.tried.as_bytes().get(draw) == Some(&b'h')
    }

    /// Returns the first draw in which it held its object.
    pub fn first_held(&self) -> Option<usize> {
        self.tried.find('h')
    }

    fn always_held(&self, draws: usize) -> bool {
        self.tried.len() == draws && self.tried.bytes().all(|letter| letter == b'h')
    }
}

pub(super) fn rank(entrants: &mut [Entrant]) {
    entrants.sort_by(|a, b| b.worth().total_cmp(&a.worth()).then(a.grasp.id.cmp(&b.grasp.id)));
}

/// Race for one plan.
#[derive(Clone)]
pub(super) struct Race<'a> {
    pub world: &'a World,
    pub repertoire: &'a Repertoire,
    pub board: &'a TactileBoard,
    pub effort: Effort,
    pub first: Grasp,
    /// Planned grasp of the second object.
    planned: Grasp,
    pub rng: ChaCha8Rng,
    /// First number of the grasps found in races after this first grasp. `number` is the next one.
    first_number: u32,
    pub number: u32,
}

impl<'a> Race<'a> {
    /// Creates a race after the planned first grasp.
    pub fn new(
        world: &'a World,
        repertoire: &'a Repertoire,
        board: &'a TactileBoard,
        plan: &Plan,
        effort: Effort,
    ) -> Result<Self> {
        let grasps = plan.grasps(&world.cell.robot.hand, repertoire)?;
        let planned = grasps.second.first().map(|planned| planned.grasp.clone());
        let planned = planned.with_context(|| format!("the plan of {} has no second grasp", plan.first))?;
        let level = if effort.level > 1 { format!(", effort {}", effort.level) } else { String::new() };
        let seed = format!("proof of {}, {}{level}", plan.first, plan.second);
        let rng = ChaCha8Rng::from_seed(Sha256::digest(seed).into());
        let race = Self {
            world,
            repertoire,
            board,
            effort,
            first: grasps.first,
            planned,
            rng,
            first_number: FIRST_NUMBER,
            number: 0,
        };
        Ok(race.numbered(plan, FIRST_NUMBER))
    }

    /// Returns the race with `first` as the first grasp.
    pub fn with_first(&self, first: Grasp) -> Self {
        Self { first, ..self.clone() }
    }

    /// Returns the race after another first grasp, with numbers of its own.
    pub fn after(&self, plan: &Plan, first: Grasp) -> Self {
        self.with_first(first).numbered(plan, FIRST_NUMBER + ANOTHER)
    }

    /// Numbers new grasps from `first` on, beyond those that the plan already has.
    pub fn numbered(self, plan: &Plan, first: u32) -> Self {
        let block = first..first + ANOTHER;
        let known = plan.variations.iter().map(|grasp| grasp.id).filter(|id| block.contains(id)).max();
        Self { first_number: first, number: known.map_or(first, |known| known + 1), ..self }
    }

    /// Returns the share of a few draws in which the best of `seconds` holds. If `seconds` is empty, it is the share in
    /// which the first grasp holds.
    pub fn glance(&self, seconds: &[Grasp]) -> Result<f64> {
        let mut held = vec![0; seconds.len().max(1)];
        for number in 0..GLANCE {
            let Some(hold) = self.hold(Errors::Wider, number)? else { continue };
            held[0] += usize::from(seconds.is_empty());
            for (second, held) in seconds.iter().zip(&mut held) {
                *held += usize::from(try_second(&hold, second)? == TryOutcome::Held);
            }
        }
        Ok(held.into_iter().max().unwrap_or(0) as f64 / GLANCE as f64)
    }

    /// Runs the race. Returns the proof of the best grasps and those of them that are new, or `None` if the first grasp
    /// holds too seldom.
    pub fn run(mut self, plan: &Plan) -> Result<Option<(Proof, Vec<Grasp>)>> {
        let Effort { selecting, rounds, batch, .. } = self.effort;
        let mut holds = Vec::with_capacity(selecting);
        for number in 0..2 * selecting {
            if holds.len() < selecting {
                holds.extend(self.hold(Errors::Wider, number)?);
            }
        }
        if holds.len() < selecting {
            return Ok(None);
        }
        let mut entrants = self.entrants(plan, &holds[0])?;
        let outcome = |draw: usize, grasp: &Grasp| try_second(&holds[draw], grasp);
        heats(&mut entrants, (&HEATS, KEPT), selecting, outcome)?;
        for _ in 0..rounds {
            if entrants.is_empty() || entrants.iter().filter(|entrant| entrant.always_held(selecting)).count() >= ENOUGH
            {
                break;
            }
            let parents: Vec<Grasp> = entrants.iter().take(PARENTS).map(|entrant| entrant.grasp.clone()).collect();
            let mut varied: Vec<Entrant> =
                (0..batch).map(|n| Entrant::new(self.varied(&parents[n % parents.len()]))).collect();
            heats(&mut varied, (&VARIED, PARENTS), selecting, outcome)?;
            entrants.append(&mut varied);
            rank(&mut entrants);
        }
        let kept = complementary(entrants, selecting)
            .into_iter()
            .map(|entrant| seen(entrant, &holds))
            .collect::<Result<_>>()?;
        drop(holds);
        self.try_kept(kept, plan).map(Some)
    }

    /// Returns the hold of the first object under draw `number`, or `None` if it is not held.
    pub fn hold(&self, errors: Errors, number: usize) -> Result<Option<Snapshot>> {
        hold(self.world, [&self.first, &self.planned], &circumstances(self.world, errors, number), self.board)
    }

    /// Returns the pose of the first object in the palm over the draws of a proof.
    pub fn recalled(&self) -> Result<Option<Hold>> {
        let object = self.world.object(&self.first.object)?;
        let holds = (0..self.effort.proving).map(|number| self.hold(Errors::LeftOver, number));
        let poses = holds.filter_map(|hold| hold.map(|hold| hold.as_ref().map(in_palm)).transpose());
        Ok(Hold::of(&poses.collect::<Result<Vec<_>>>()?, &object.symmetry))
    }

    /// Returns the known grasps and the proposals next to the object held in `hold`.
    fn entrants(&mut self, plan: &Plan, hold: &Snapshot) -> Result<Vec<Entrant>> {
        let hand = &self.world.cell.robot.hand;
        let digits = digit_sets(hand, 2).swap_remove(1);
        let known = self.repertoire.of(&plan.second, &digits).chain(plan.varied(&plan.second, &digits));
        let mut entrants: Vec<Entrant> = known.cloned().map(Entrant::new).collect();
        let (first, second) = (self.world.object(&plan.first)?, self.world.object(&plan.second)?);
        let proposals = Proposals::new(hand, &second, &digits, Some(&carried(hold, &first)), true)?;
        let side = if hand.parameters.handedness == Handedness::Left { 1.0 } else { -1.0 };
        for n in 0..self.effort.drawn {
            let Some(mut grasp) = proposals.drawn(self.number, &mut self.rng) else { break };
            self.number += 1;
            if n % 2 == 1 {
                grasp.roll += side * self.rng.random_range(0.0..ROLL);
            }
            entrants.push(Entrant::new(grasp));
        }
        for _ in 0..self.effort.synthesized {
            entrants.extend(proposals.synthesized(self.number, &mut self.rng).map(Entrant::new));
            self.number += 1;
        }
        Ok(entrants)
    }

    fn varied(&mut self, parent: &Grasp) -> Grasp {
        self.number += 1;
        vary(parent, self.number - 1, &mut self.rng)
    }

    /// Tries the `kept` grasps and the planned one under the draws that played no part in the selection.
    fn try_kept(&self, mut kept: Vec<Grasp>, plan: &Plan) -> Result<(Proof, Vec<Grasp>)> {
        if !kept.iter().any(|grasp| grasp.id == self.planned.id) {
            kept.push(self.planned.clone());
        }
        let wide = wide_errors(self.effort.wide);
        let (mut holds, mut grasps) = (Vec::new(), Vec::new());
        grasps.extend(kept.iter().map(|grasp| Proven { grasp: grasp.id, ..Proven::default() }));
        let object = self.world.object(&self.first.object)?;
        let mut poses = Vec::new();
        for number in 0..self.effort.proving {
            let Some(hold) = self.hold(Errors::LeftOver, number)? else {
                holds.push(None);
                continue;
            };
            let pose = in_palm(&hold);
            poses.push(pose);
            let Extent(extent) = Extent::of(&object.shape, &pose);
            holds.push(Some(extent.map(|reach| (reach * 1e5).round() / 1e2)));
            for (grasp, proven) in kept.iter().zip(&mut grasps) {
                proven.near.push(letter(try_second(&hold, grasp)?));
                if let Some(error) = wide.get(number) {
                    proven.wide.push(letter(try_second(&hold, &misaimed(grasp, error, 1))?));
                }
            }
        }
        // Grasps that earlier races found already belong to the plan.
        kept.retain(|grasp| grasp.id >= self.first_number && plan.variations.iter().all(|known| known.id != grasp.id));
        let hold = Hold::of(&poses, &object.symmetry);
        Ok((Proof { effort: self.effort.level, holds, hold, grasps }, kept))
    }
}

/// Returns `palm_from_object` of the first object.
fn in_palm(hold: &Snapshot) -> Isometry3<f64> {
    let truth = hold.robot.truth();
    truth.palm.inverse() * truth.objects[0]
}

/// Plays the heats, then one under all draws. `left` entrants remain at most, the best first.
pub(super) fn heats(
    entrants: &mut Vec<Entrant>,
    (heats, left): (&[(usize, usize)], usize),
    all: usize,
    outcome: impl Fn(usize, &Grasp) -> Result<TryOutcome>,
) -> Result<()> {
    let last = (all, left);
    for (draws, going_on) in heats.iter().chain([&last]) {
        let draws = &all.min(*draws);
        for entrant in entrants.iter_mut() {
            while entrant.tried.len() < *draws {
                entrant.tried.push(letter(outcome(entrant.tried.len(), &entrant.grasp)?));
            }
        }
        rank(entrants);
        entrants.truncate(*going_on);
        entrants.retain(|entrant| entrant.worth() > MISSED);
    }
    Ok(())
}

/// Returns the best of `entrants`, then those that hold most often where none of the earlier ones does.
fn complementary(mut entrants: Vec<Entrant>, draws: usize) -> Vec<Entrant> {
    let mut kept: Vec<Entrant> = Vec::new();
    while kept.len() < KEPT && !entrants.is_empty() {
        let open = |draw: &usize| !kept.iter().any(|known| known.held(*draw));
        let covered = |entrant: &Entrant| (0..draws).filter(open).filter(|draw| entrant.held(*draw)).count();
        // The entrants are in order of worth: of those that cover as many draws, the one with the larger worth is
        // taken.
        let best = (0..entrants.len()).rev().max_by_key(|n| covered(&entrants[*n])).unwrap_or(0);
        let best = entrants.remove(best);
        kept.push(best);
    }
    kept
}

/// Returns the grasp of an entrant with the pose in which it holds the object, from the first draw in which it holds to
/// the end of the trial.
fn seen(entrant: Entrant, holds: &[Snapshot]) -> Result<Grasp> {
    let score = entrant.worth();
    let mut grasp = Grasp { score, ..entrant.grasp };
    for (hold, letter) in holds.iter().zip(entrant.tried.chars()) {
        if letter != 'h' {
            continue;
        }
        let (collided, outcome) = rehearse_last(hold, &grasp)?;
        if outcome.held && !collided {
            (grasp.held, grasp.held_joints) = (Some(outcome.palm_from_object), Some(outcome.joints));
            break;
        }
    }
    Ok(grasp)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entrant(id: u32, letters: &str) -> Entrant {
        let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
        let any = repertoire.grasps.values().flatten().next().expect("a grasp");
        Entrant { grasp: Grasp { id, ..any.clone() }, tried: letters.chars().cycle().take(16).collect() }
    }

    /// After the best grasp comes the one that holds where it does not, although others hold more often.
    #[test]
    fn kept_grasps_complement_each_other() {
        let mut entrants = vec![entrant(1, "hhhm"), entrant(2, "hhmm"), entrant(3, "hhmm"), entrant(4, "mmmh")];
        rank(&mut entrants);
        let kept: Vec<u32> = complementary(entrants, 16).iter().map(|entrant| entrant.grasp.id).collect();
        assert_eq!(kept, [1, 4, 2, 3]);
    }
}
