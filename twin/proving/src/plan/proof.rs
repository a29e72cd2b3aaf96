//! Proofs: second grasps of a plan that hold in the circumstances that really happen, found by a race of many and a climb from the best.
//!
//! Each draw of the circumstances ([`circumstances`]) has a hold of the first object of its own, and grasps are tried from it up to the end of the
//! lift. Many grasps meet few draws and few meet many (successive halving, Karnin, Koren and Somekh 2013): those that are known, proposals, and
//! proposals that are rolled further, so that ring and little finger with what they hold are lifted off the table. Variations of the best race in
//! their turn. What is kept is a set in which one grasp holds where another does not, and its letters come from draws that selected nothing.

use anyhow::{Context as _, Result};
use control::extent::Extent;
use control::odds::{Rehearsed, TryOutcome};
use control::worth::MISSED;
use grasping::sampler::{HandForm, propose, vary};
use grasping::{Grasp, Repertoire, digit_sets};
use hand_model::parameters::Handedness;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use sim::tactile::TactileBoard;

use super::outcomes::{aim_error, letter, outcome};
use super::{Other, Plan, Plans};
use crate::pick_ups::extent;
use crate::rehearsal::circumstances::{Errors, circumstances, errors_of, hold};
use crate::rehearsal::{Snapshot, misaimed, rehearse_last, try_second, wide_errors};
use crate::simulated_world::World;

/// Work for a plan.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Draws under which grasps are selected.
    pub selecting: usize,
    /// Draws, others than those, under which the selected ones are tried.
    pub proving: usize,
    /// The first of those, under which they are tried with wide errors too.
    pub wide: usize,
    /// Proposals beside the grasps that are known, half of them rolled further.
    pub proposals: u32,
    /// Rounds of variations at most.
    pub rounds: usize,
    /// Variations a round.
    pub batch: usize,
}

/// The work for the benchmark's own plans.
pub const EFFORT: Effort = Effort { selecting: 16, proving: 32, wide: 12, proposals: 32, rounds: 2, batch: 12 };

/// Greatest further roll, rad.
const ROLL: f64 = 0.75;
/// Heats before the last one, which has all draws: draws that a grasp has met after it, and grasps that go on.
const HEATS: [(usize, usize); 3] = [(1, 24), (3, 12), (8, 6)];
/// The same of the variations of a round.
const VARIED: [(usize, usize); 3] = [(1, 10), (3, 5), (8, 3)];
/// Grasps that a round starts from.
const PARENTS: usize = 3;
/// No further round is played once so many grasps have held under all draws.
const ENOUGH: usize = 3;
/// Grasps that are kept.
const KEPT: usize = 4;
/// Numbers of the grasps found begin here.
const FIRST_NUMBER: u32 = 2_000_000;
/// Those after another first grasp so much higher.
const ANOTHER: u32 = 100_000;
/// A plan is sure if its best second grasp holds in this share of the draws: no other first grasp is looked for.
const SURE: f64 = 0.92;
/// Draws in which other first grasps are compared.
const GLANCE: usize = 6;

/// Second grasps after one first grasp, with how they went in drawn circumstances.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Proof {
    /// Of each draw the extent of the held object in the palm ([`Extent`]), mm; none where the first grasp did not hold.
    pub holds: Vec<Option<[f64; 6]>>,
    /// The grasps, the best first.
    pub grasps: Vec<Proven>,
}

/// Outcomes of one grasp.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Proven {
    /// Number of the grasp.
    pub grasp: u32,
    /// A letter for each draw that has a hold.
    pub near: String,
    /// The same of the first draws, with a wide error beside the narrow one.
    pub wide: String,
}

impl Proof {
    /// Share of the draws in which the first grasp holds.
    pub fn first_holds(&self) -> f64 {
        self.holds.iter().flatten().count() as f64 / self.holds.len().max(1) as f64
    }

    /// Share of the draws in which the grasp that holds most often holds its object.
    pub fn best(&self) -> f64 {
        let held = |proven: &Proven| proven.near.chars().filter(|letter| *letter == 'h').count();
        self.grasps.iter().map(held).max().unwrap_or(0) as f64 / self.holds.len().max(1) as f64
    }

    /// The rehearsals of `grasp`, with the errors in axes that turn with its heading; none where it is not among those that were proven.
    pub fn rehearsed(&self, grasp: &Grasp) -> Result<Option<Vec<Rehearsed>>> {
        let Some(proven) = self.grasps.iter().find(|proven| proven.grasp == grasp.id) else { return Ok(None) };
        let narrow = (0..self.holds.len()).map(|number| errors_of(Errors::LeftOver, number));
        let draws = self.holds.iter().zip(narrow).zip(wide_errors(self.holds.len()));
        let draws = draws.filter_map(|((hold, narrow), wide)| {
            let hold = Extent((*hold)?.map(|reach| reach * 1e-3));
            let [narrow, wide] = [narrow, wide].map(|error| aim_error(&error, grasp.yaw));
            Some((hold, narrow, narrow + wide))
        });
        let draws: Vec<_> = draws.collect();
        let near = proven.near.chars().zip(&draws).map(|(letter, (hold, error, _))| (letter, hold, error));
        let wide = proven.wide.chars().zip(&draws).map(|(letter, (hold, _, error))| (letter, hold, error));
        let tried = near.chain(wide).map(|(letter, hold, error)| {
            Ok(Rehearsed { hold: Some(*hold), ..Rehearsed::new(*error, outcome(grasp.id, letter)?) })
        });
        tried.collect::<Result<_>>().map(Some)
    }
}

/// Proves second grasps for those of the `plans` that have no proof, and after another first grasp where that leaves them unsure; `done` is told
/// after each of them. Shows a progress bar unless `quiet`.
pub fn prove(
    world: &World,
    repertoire: &Repertoire,
    plans: &mut Plans,
    effort: Effort,
    quiet: bool,
    done: impl Fn(&Plan) -> Result<()> + Sync,
) -> Result<()> {
    let board = TactileBoard::unit(&world.cell.robot.hand, 0);
    plans.try_each("plans proven", quiet, |plan| {
        if plan.proof.is_none() {
            if let Some((proof, found)) = Race::new(world, repertoire, &board, plan, effort)?.run(plan)? {
                plan.proof = Some(proof);
                plan.variations.extend(found);
            }
            done(plan)?;
        }
        let unsure = plan.proof.as_ref().is_some_and(|proof| proof.best() < SURE);
        if unsure && plan.others.iter().all(|other| other.proof.is_none()) {
            prove_another(world, repertoire, &board, plan, effort)?;
            done(plan)?;
        }
        Ok(())
    })
}

/// Proves second grasps after that first grasp of the repertoire, other than the planned one, after which those that are proven go best.
fn prove_another(
    world: &World,
    repertoire: &Repertoire,
    board: &TactileBoard,
    plan: &mut Plan,
    effort: Effort,
) -> Result<()> {
    let hand = &world.cell.robot.hand;
    let race = Race::new(world, repertoire, board, plan, effort)?;
    let Some(proof) = &plan.proof else { return Ok(()) };
    let proven = |grasp: &&Grasp| proof.grasps.iter().any(|proven| proven.grasp == grasp.id);
    let sets = digit_sets(hand, 2);
    let known = repertoire.of(&plan.second, &sets[1]).chain(&plan.variations);
    let seconds: Vec<Grasp> = known.filter(proven).cloned().collect();
    let mut best: Option<(f64, Grasp)> = None;
    for first in repertoire.of(&plan.first, &sets[0]).filter(|first| first.id != plan.first_grasp) {
        let share = Race { first: first.clone(), ..race.clone() }.glance(&seconds)?;
        if best.as_ref().is_none_or(|(most, _)| share > *most) {
            best = Some((share, first.clone()));
        }
    }
    let Some((_, first)) = best else { return Ok(()) };
    let first_grasp = first.id;
    let another = Race { first, first_number: FIRST_NUMBER + ANOTHER, number: FIRST_NUMBER + ANOTHER, ..race };
    let Some((proof, found)) = another.run(plan)? else { return Ok(()) };
    plan.variations.extend(found);
    match plan.others.iter_mut().find(|other| other.first_grasp == first_grasp) {
        Some(other) => other.proof = Some(proof),
        None => plan.others.push(Other { first_grasp, outcomes: Vec::new(), proof: Some(proof) }),
    }
    Ok(())
}

/// A grasp and how it went under the draws so far.
#[derive(Clone)]
struct Entrant {
    grasp: Grasp,
    tried: Vec<TryOutcome>,
}

impl Entrant {
    fn new(grasp: Grasp) -> Self {
        Self { grasp, tried: Vec::new() }
    }

    fn worth(&self) -> f64 {
        let worth = |outcome: &TryOutcome| match outcome {
            TryOutcome::Held => 1.0,
            TryOutcome::Missed => MISSED,
            TryOutcome::Contact => 0.0,
        };
        self.tried.iter().map(worth).sum::<f64>() / self.tried.len().max(1) as f64
    }

    fn held(&self, draw: usize) -> bool {
        self.tried.get(draw) == Some(&TryOutcome::Held)
    }

    fn always_held(&self, draws: usize) -> bool {
        self.tried.len() == draws && self.tried.iter().all(|outcome| *outcome == TryOutcome::Held)
    }
}

fn rank(entrants: &mut [Entrant]) {
    entrants.sort_by(|a, b| b.worth().total_cmp(&a.worth()).then(a.grasp.id.cmp(&b.grasp.id)));
}

/// A race for one plan.
#[derive(Clone)]
struct Race<'a> {
    world: &'a World,
    repertoire: &'a Repertoire,
    board: &'a TactileBoard,
    effort: Effort,
    first: Grasp,
    /// The planned grasp of the second object.
    planned: Grasp,
    rng: ChaCha8Rng,
    /// Numbers of the grasps found begin here, and the next of them.
    first_number: u32,
    number: u32,
}

impl<'a> Race<'a> {
    fn new(
        world: &'a World,
        repertoire: &'a Repertoire,
        board: &'a TactileBoard,
        plan: &Plan,
        effort: Effort,
    ) -> Result<Self> {
        let grasps = plan.grasps(&world.cell.robot.hand, repertoire)?;
        let planned = grasps.second.first().map(|planned| planned.grasp.clone());
        let planned = planned.with_context(|| format!("the plan of {} has no second grasp", plan.first))?;
        let rng = ChaCha8Rng::from_seed(Sha256::digest(format!("proof of {}, {}", plan.first, plan.second)).into());
        Ok(Self {
            world,
            repertoire,
            board,
            effort,
            first: grasps.first,
            planned,
            rng,
            first_number: FIRST_NUMBER,
            number: FIRST_NUMBER,
        })
    }

    /// Share of a few draws in which the best of `seconds` holds.
    fn glance(&self, seconds: &[Grasp]) -> Result<f64> {
        let mut held = vec![0; seconds.len()];
        for number in 0..GLANCE {
            let Some(hold) = self.hold(Errors::Wider, number)? else { continue };
            for (second, held) in seconds.iter().zip(&mut held) {
                *held += usize::from(try_second(&hold, second)? == TryOutcome::Held);
            }
        }
        Ok(held.into_iter().max().unwrap_or(0) as f64 / GLANCE as f64)
    }

    /// The proof of the best grasps that are found, and those of them that nobody knew; none where the first grasp holds too seldom.
    fn run(mut self, plan: &Plan) -> Result<Option<(Proof, Vec<Grasp>)>> {
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
        let mut entrants = self.entrants(plan)?;
        heats(&mut entrants, (&HEATS, KEPT), &holds)?;
        for _ in 0..rounds {
            if entrants.is_empty() || entrants.iter().filter(|entrant| entrant.always_held(selecting)).count() >= ENOUGH
            {
                break;
            }
            let parents: Vec<Grasp> = entrants.iter().take(PARENTS).map(|entrant| entrant.grasp.clone()).collect();
            let mut varied: Vec<Entrant> =
                (0..batch).map(|n| Entrant::new(self.varied(&parents[n % parents.len()]))).collect();
            heats(&mut varied, (&VARIED, PARENTS), &holds)?;
            entrants.append(&mut varied);
            rank(&mut entrants);
        }
        let kept = complementary(entrants, selecting)
            .into_iter()
            .map(|entrant| seen(entrant, &holds))
            .collect::<Result<_>>()?;
        drop(holds);
        self.try_kept(kept).map(Some)
    }

    /// The first object held under draw `number`; none where it is not.
    fn hold(&self, errors: Errors, number: usize) -> Result<Option<Snapshot>> {
        hold(self.world, [&self.first, &self.planned], &circumstances(self.world, errors, number), self.board)
    }

    /// The grasps that are known, and proposals.
    fn entrants(&mut self, plan: &Plan) -> Result<Vec<Entrant>> {
        let hand = &self.world.cell.robot.hand;
        let digits = digit_sets(hand, 2).swap_remove(1);
        let known = self.repertoire.of(&plan.second, &digits).chain(&plan.variations);
        let mut entrants: Vec<Entrant> = known.cloned().map(Entrant::new).collect();
        let (form, extent) = (HandForm::of(hand), extent(&*self.world.object(&plan.second)?));
        let side = if hand.parameters.handedness == Handedness::Left { 1.0 } else { -1.0 };
        for n in 0..self.effort.proposals {
            let Some(mut grasp) = propose(&form, &extent, &digits, self.number, &mut self.rng) else { break };
            self.number += 1;
            if n % 2 == 1 {
                grasp.roll += side * self.rng.random_range(0.0..ROLL);
            }
            entrants.push(Entrant::new(grasp));
        }
        Ok(entrants)
    }

    fn varied(&mut self, parent: &Grasp) -> Grasp {
        self.number += 1;
        vary(parent, self.number - 1, &mut self.rng)
    }

    /// Tries the `kept` grasps and the planned one under the draws that selected nothing.
    fn try_kept(&self, mut kept: Vec<Grasp>) -> Result<(Proof, Vec<Grasp>)> {
        if !kept.iter().any(|grasp| grasp.id == self.planned.id) {
            kept.push(self.planned.clone());
        }
        let wide = wide_errors(self.effort.wide);
        let (mut holds, mut grasps) = (Vec::new(), Vec::new());
        grasps.extend(kept.iter().map(|grasp| Proven { grasp: grasp.id, ..Proven::default() }));
        let shape = &self.world.object(&self.first.object)?.shape;
        for number in 0..self.effort.proving {
            let Some(hold) = self.hold(Errors::LeftOver, number)? else {
                holds.push(None);
                continue;
            };
            let truth = hold.robot.truth();
            let Extent(extent) = Extent::of(shape, &(truth.palm.inverse() * truth.objects[0]));
            holds.push(Some(extent.map(|reach| (reach * 1e5).round() / 1e2)));
            for (grasp, proven) in kept.iter().zip(&mut grasps) {
                proven.near.push(letter(try_second(&hold, grasp)?));
                if let Some(error) = wide.get(number) {
                    proven.wide.push(letter(try_second(&hold, &misaimed(grasp, error, 1))?));
                }
            }
        }
        // Those that another race has found are the plan's already.
        kept.retain(|grasp| grasp.id >= self.first_number);
        Ok((Proof { holds, grasps }, kept))
    }
}

/// Plays the heats and one under all draws, after which so many grasps are left, the best first.
fn heats(entrants: &mut Vec<Entrant>, (heats, left): (&[(usize, usize)], usize), holds: &[Snapshot]) -> Result<()> {
    let last = (holds.len(), left);
    for (draws, going_on) in heats.iter().chain([&last]) {
        let draws = &holds.len().min(*draws);
        for entrant in entrants.iter_mut() {
            while entrant.tried.len() < *draws {
                entrant.tried.push(try_second(&holds[entrant.tried.len()], &entrant.grasp)?);
            }
        }
        rank(entrants);
        entrants.truncate(*going_on);
        entrants.retain(|entrant| entrant.worth() > MISSED);
    }
    Ok(())
}

/// The best of `entrants`, and then those that hold most often where none of those before does.
fn complementary(mut entrants: Vec<Entrant>, draws: usize) -> Vec<Entrant> {
    let mut kept: Vec<Entrant> = Vec::new();
    while kept.len() < KEPT && !entrants.is_empty() {
        let open = |draw: &usize| !kept.iter().any(|known| known.held(*draw));
        let covered = |entrant: &Entrant| (0..draws).filter(open).filter(|draw| entrant.held(*draw)).count();
        // Of those that cover as much the one that is worth more: they are in this order.
        let best = (0..entrants.len()).rev().max_by_key(|n| covered(&entrants[*n])).unwrap_or(0);
        let best = entrants.remove(best);
        kept.push(best);
    }
    kept
}

/// The grasp of an entrant, with how it holds the object in the first draw in which it does so to the end of the trial.
fn seen(entrant: Entrant, holds: &[Snapshot]) -> Result<Grasp> {
    let mut grasp = Grasp { score: entrant.worth(), ..entrant.grasp };
    for (hold, outcome) in holds.iter().zip(&entrant.tried) {
        if *outcome != TryOutcome::Held {
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

    fn grasp(id: u32) -> Grasp {
        let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
        let any = repertoire.grasps.values().flatten().next().expect("a grasp");
        Grasp { id, yaw: 0.0, ..any.clone() }
    }

    fn entrant(id: u32, letters: &str) -> Entrant {
        let letters = letters.chars().cycle().take(16);
        Entrant { grasp: grasp(id), tried: letters.map(|letter| outcome(id, letter).expect("a letter")).collect() }
    }

    /// After the best grasp comes the one that holds where it does not, although others hold more often.
    #[test]
    fn kept_grasps_complement_each_other() {
        let mut entrants = vec![entrant(1, "hhhm"), entrant(2, "hhmm"), entrant(3, "hhmm"), entrant(4, "mmmh")];
        rank(&mut entrants);
        let kept: Vec<u32> = complementary(entrants, 16).iter().map(|entrant| entrant.grasp.id).collect();
        assert_eq!(kept, [1, 4, 2, 3]);
    }

    /// With little work a plan that is sure gets a proof: some grasps, among them the planned one, and a letter for each draw that has a hold.
    /// Found grasps are the plan's, and say where they hold the object.
    #[test]
    fn a_plan_is_proven() {
        let world =
            World::new(&hand_model::RobotModel::ftac_gen3(), scenarios::Scenario::benchmark()).expect("the world");
        let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
        let mut plans = crate::builtin::plans().expect("the built-in plans");
        plans.plans.retain(|plan| plan.objects() == ["ball_45", "box_50"]);
        plans.plans[0].proof = None;
        let effort = Effort { selecting: 2, proving: 3, wide: 1, proposals: 2, rounds: 1, batch: 2 };
        prove(&world, &repertoire, &mut plans, effort, true, |_| Ok(())).expect("a proof");
        let plan = &plans.plans[0];
        let proof = plan.proof.as_ref().expect("a proof");
        let held = proof.holds.iter().flatten().count();
        assert!(proof.holds.len() == 3 && held > 0 && proof.best() > 0.5, "{proof:?}");
        assert!(proof.grasps.iter().all(|proven| proven.near.len() == held && proven.wide.len() <= 1), "{proof:?}");
        let grasps = plan.grasps(&world.cell.robot.hand, &repertoire).expect("the grasps");
        assert!(!grasps.second[0].rehearsed.is_empty());
        let found = plan.variations.iter().filter(|grasp| grasp.id >= FIRST_NUMBER);
        assert!(found.into_iter().all(|grasp| grasp.held.is_some()));
    }

    /// Letters come back with the errors and holds of their draws; a draw in which the first grasp did not hold has none.
    #[test]
    fn letters_stand_for_circumstances() {
        let holds = vec![None, Some([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), Some([0.0; 6])];
        let proof = Proof { holds, grasps: vec![Proven { grasp: 7, near: "hc".into(), wide: "m".into() }] };
        assert_eq!(proof.rehearsed(&grasp(8)).expect("letters"), None);
        let tried = proof.rehearsed(&grasp(7)).expect("letters").expect("proven");
        let outcomes: Vec<TryOutcome> = tried.iter().map(|one| one.outcome).collect();
        assert_eq!(outcomes, [TryOutcome::Held, TryOutcome::Contact, TryOutcome::Missed]);
        let errors = [1, 2].map(|number| errors_of(Errors::LeftOver, number)).map(|noise| aim_error(&noise, 0.0));
        let wide = aim_error(&wide_errors(2)[1], 0.0);
        assert_eq!(tried.iter().map(|one| one.error).collect::<Vec<_>>(), [errors[0], errors[1], errors[0] + wide]);
        assert_eq!(tried[0].hold.map(|hold| hold.0[2]), Some(0.003));
        assert!((proof.first_holds() - 2.0 / 3.0).abs() < 1e-12 && (proof.best() - 1.0 / 3.0).abs() < 1e-12);
    }
}
